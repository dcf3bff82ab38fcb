"""Objects on buildings that no reference model has: vents, skylights, solar panels, plant, balconies.

Their points are building points that lie on no roof face; without them a simulated roof is too clean.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from eaves.model.cloud import BUILDING
from eaves.simulate.objects.exact import ExactBuilding, ExactFace
from eaves.simulate.objects.surfaces import UP, ScannedSurfaces, closed, curtains, fan, upright_box

FROM_EDGE = 0.6
"""The least distance of objects from the edge of a face (m)."""

FLAT = 0.09
"""Tangent of the slope (5°) below which a face carries plant instead of skylights."""

AREA_PER_PIECE = 30.0
"""Mean roof area (m²) of one piece."""

PANELS_SHARE = 0.15
"""Share of the pitched faces with room for them that carry solar panels."""

BALCONY_KINDS = ("town house", "slab", "tower", "courtyard", "U-shape")
"""The beginnings of the kinds of buildings with balconies."""

BALCONY_SHARE = 0.35
"""Share of the places for a balcony that have one."""

PLACE_STEP, STOREY_STEP = 5.5, 2.8
"""Places for balconies along a wall and up it (m)."""

Patch = NDArray[np.float64]


def install(
    building: ExactBuilding, free: Callable[[NDArray[np.float64]], bool], rng: np.random.Generator
) -> ScannedSurfaces:
    """The clutter of one building; `free` returns whether nothing is built at a place (x, y)."""
    pieces: list[Patch] = []
    for face in building.faces:
        inner = shapely.buffer(face.polygon, -FROM_EDGE, join_style="mitre")
        if inner.is_empty:
            continue
        gradient = np.array(face.coefficients[:2])
        for _ in range(int(rng.poisson(face.polygon.area / AREA_PER_PIECE))):
            place = _somewhere(inner, rng)
            if place is not None:
                pieces += _piece(face, place, gradient, rng)
        if np.hypot(*gradient) > FLAT and rng.random() < PANELS_SHARE:
            pieces += _panels(face, inner, gradient, rng)
    if building.kind.startswith(BALCONY_KINDS):
        pieces += _balconies(building, free, rng)
    return ScannedSurfaces.of(pieces, BUILDING, building.number)


def _somewhere(inner: shapely.Polygon, rng: np.random.Generator) -> NDArray[np.float64] | None:
    """A place inside; None when four tries miss."""
    west, south, east, north = inner.bounds
    for x, y in rng.uniform((west, south), (east, north), (4, 2)):
        if shapely.contains_xy(inner, x, y):
            return np.array([x, y])
    return None


def _piece(
    face: ExactFace, place: NDArray[np.float64], gradient: NDArray[np.float64], rng: np.random.Generator
) -> list[Patch]:
    """Plant on a flat roof; a vent or a skylight on a pitched one."""
    foot = float(face.height_at(place[None, :])[0])
    angle = float(np.arctan2(gradient[1], gradient[0]))
    if np.hypot(*gradient) < FLAT:
        size = rng.uniform(0.3, 2.0), rng.uniform(0.3, 1.6), rng.uniform(0.3, 1.5)
        return upright_box(place[0], place[1], foot - 0.1, size, rng.uniform(0.0, np.pi))
    if rng.random() < 0.5:
        wide = rng.uniform(0.15, 0.35)
        return upright_box(place[0], place[1], foot - 0.3, (wide, wide, rng.uniform(0.6, 1.0)), angle)
    return _raised(face, place, angle, (1.0, 0.8), 0.12)


def _raised(
    face: ExactFace, place: NDArray[np.float64], angle: float, size: tuple[float, float], lift: float
) -> list[Patch]:
    """A rectangle over a pitched face and parallel to it, `lift` metres above, with its rim."""
    along = np.array([np.cos(angle), np.sin(angle)])
    across = np.array([-along[1], along[0]])
    signs = ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))
    plan = np.stack([place + a * size[0] * along + b * size[1] * across for a, b in signs])
    low = np.column_stack([plan, face.height_at(plan)])
    high = low + lift * UP
    return [fan(high), *curtains(closed(low), closed(high))]


def _panels(
    face: ExactFace, inner: shapely.Polygon, gradient: NDArray[np.float64], rng: np.random.Generator
) -> list[Patch]:
    """A field of solar panels, 12 cm above the roof, where it fits."""
    angle = float(np.arctan2(gradient[1], gradient[0]))
    place = _somewhere(inner, rng)
    if place is None:
        return []
    field = _raised(face, place, angle, (rng.uniform(1.6, 3.3), rng.uniform(2.0, 6.0)), 0.12)
    outline = shapely.convex_hull(shapely.MultiPoint(field[0].reshape(-1, 3)[:, :2]))
    return field if inner.contains(outline) else []


def _balconies(
    building: ExactBuilding, free: Callable[[NDArray[np.float64]], bool], rng: np.random.Generator
) -> list[Patch]:
    """Balconies in front of the walls, from the second storey to below the eaves."""
    eaves = min(float(face.height_at(shapely.get_coordinates(face.polygon)).min()) for face in building.faces)
    levels = np.arange(building.base + STOREY_STEP, eaves - 1.5, STOREY_STEP)
    ring = shapely.get_coordinates(shapely.orient_polygons(building.walls).exterior)
    pieces: list[Patch] = []
    for start, end in pairwise(ring):
        length = float(np.hypot(*(end - start)))
        along = (end - start) / max(length, 1e-9)
        outward = np.array([along[1], -along[0]])
        for at in np.arange(PLACE_STEP / 2, length - PLACE_STEP / 2, PLACE_STEP):
            deep = rng.uniform(1.0, 1.6)
            middle = start + at * along + deep / 2 * outward
            if rng.random() < BALCONY_SHARE and free(middle + deep * outward):
                angle = float(np.arctan2(along[1], along[0]))
                for level in levels:
                    pieces += _balcony(middle, float(level), deep, angle)
    return pieces


def _balcony(middle: NDArray[np.float64], level: float, deep: float, angle: float) -> list[Patch]:
    """A slab 3 m wide with a parapet of 1 m around it."""
    return [
        *upright_box(middle[0], middle[1], level - 0.2, (3.0, deep, 0.2), angle),
        *upright_box(middle[0], middle[1], level, (3.0, deep, 1.0), angle, with_top=False),
    ]
