"""Objects that no reference model has, on buildings and in streets.

Vents, skylights, solar panels, plant and balconies are building points that lie on no roof face; without them
a simulated roof is too clean. Cars, fences, power lines and bridges stand in streets.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from eaves.model import BRIDGE_DECK, BUILDING, UNCLASSIFIED, WIRE, WIRE_TOWER
from eaves.simulate.objects.exact import ExactBuilding, ExactFace
from eaves.simulate.objects.surfaces import (
    UP,
    Corridor,
    ScannedSurfaces,
    Terrain,
    closed,
    curtain,
    curtains,
    fan,
    upright_box,
)

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


def park_car(x: float, y: float, ground: float, angle: float, rng: np.random.Generator) -> ScannedSurfaces:
    """A car, or one time in eight a van: a body and a cabin."""
    if rng.random() < 0.125:
        return ScannedSurfaces.of(upright_box(x, y, ground + 0.3, (5.5, 2.0, 2.1), angle), UNCLASSIFIED)
    length, height = rng.uniform(3.8, 4.9), rng.uniform(1.4, 1.65)
    body = upright_box(x, y, ground + 0.2, (length, 1.8, 0.65), angle)
    cabin = upright_box(x, y, ground + 0.8, (0.55 * length, 1.6, height - 0.8), angle)
    return ScannedSurfaces.of([*body, *cabin], UNCLASSIFIED)


def park_lorry(x: float, y: float, ground: float, angle: float, rng: np.random.Generator) -> ScannedSurfaces:
    """A bus, a lorry or one container or two: a box 6 to 13 m long."""
    size = rng.uniform(6.0, 13.0), rng.uniform(2.4, 2.6), rng.choice([2.6, 3.2, 4.0, 5.2])
    return ScannedSurfaces.of(upright_box(x, y, ground, size, angle), UNCLASSIFIED)


def put_fence(
    start: NDArray[np.float64], end: NDArray[np.float64], terrain: Terrain, rng: np.random.Generator
) -> ScannedSurfaces:
    """A thin fence or garden wall of 0.9 to 2 m along a segment; it follows the ground in steps of 2 m."""
    length = float(np.hypot(*(end - start)))
    plan = start + np.linspace(0.0, 1.0, max(2, int(length / 2.0) + 1))[:, None] * (end - start)
    low = np.column_stack([plan, terrain.at(plan) - 0.2])
    high = low + (0.2 + rng.uniform(0.9, 2.0)) * UP
    return ScannedSurfaces.of(curtains(low, high), UNCLASSIFIED)


def hang_power_line(
    start: NDArray[np.float64], end: NDArray[np.float64], terrain: Terrain, rng: np.random.Generator
) -> ScannedSurfaces:
    """Masts every 60 m or so, 16 to 26 m high, and three wires between them that sag by 2 %."""
    length = float(np.hypot(*(end - start)))
    spans = max(1, round(length / 60.0))
    feet = start + np.linspace(0.0, 1.0, spans + 1)[:, None] * (end - start)
    ground, height = terrain.at(feet), rng.uniform(16.0, 26.0)
    along = (end - start) / length
    left = np.array([-along[1], along[0]])
    angle = float(np.arctan2(along[1], along[0]))
    masts = []
    for foot, level in zip(feet, ground, strict=True):
        masts += upright_box(foot[0], foot[1], level - 0.5, (0.5, 0.5, height + 0.5), angle)
        masts += upright_box(foot[0], foot[1], level + height - 0.3, (0.3, 5.0, 0.3), angle)
    wires = []
    share = np.linspace(0.0, 1.0, 13)
    for aside in (-2.4, 0.0, 2.4):
        for k in range(spans):
            ends = np.column_stack([feet[k : k + 2] + aside * left, ground[k : k + 2] + height])
            line = ends[0] + share[:, None] * (ends[1] - ends[0])
            line[:, 2] -= 0.02 * (length / spans) * 4 * share * (1 - share)
            wires += [_ribbon(line[m], line[m + 1], left, 0.04) for m in range(len(share) - 1)]
    return ScannedSurfaces.join([ScannedSurfaces.of(masts, WIRE_TOWER), ScannedSurfaces.of(wires, WIRE)])


def _ribbon(
    p: NDArray[np.float64], q: NDArray[np.float64], left: NDArray[np.float64], half: float
) -> NDArray[np.float64]:
    """A level strip about a segment: as much of a beam as a wire throws back, without its upright side."""
    side = np.array([*left, 0.0]) * half
    return fan(np.stack([p - side, q - side, q + side, p + side]))


def span_bridge(x: float, y: float, corridor: Corridor, terrain: Terrain) -> ScannedSurfaces:
    """A bridge 8 m wide across a canal, its axis through (x, y), its deck joining the ground of the banks."""
    across = np.array([-np.sin(corridor.angle), np.cos(corridor.angle)])
    along = np.array([across[1], -across[0]])
    offset = float((np.array([x, y]) - [corridor.x, corridor.y]) @ across)
    middle = np.array([x, y]) - offset * across
    plan = [middle + (corridor.reach + 1.0) * side * across for side in (-1.0, 1.0)]
    level = terrain.at(np.stack(plan)) + 0.15
    crown = float(level.max()) + 0.4
    stations = [
        (plan[0], level[0]),
        (middle - 3 * across, crown),
        (middle + 3 * across, crown),
        (plan[1], level[1]),
    ]
    pieces = []
    for (p, low), (q, high) in pairwise(stations):
        corners = ((p, low, -4), (q, high, -4), (q, high, 4), (p, low, 4))
        deck = np.stack([[*(end + aside * along), level_there] for end, level_there, aside in corners])
        pieces.append(fan(deck))
        for a, b in ((0, 1), (3, 2)):
            rail = deck[[a, b]]
            pieces.append(curtain(rail, rail + UP))
    return ScannedSurfaces.of(pieces, BRIDGE_DECK)
