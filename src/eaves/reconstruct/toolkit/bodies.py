"""The bodies of objects on a roof: what stands over the building's solids, and nothing of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from eaves.geometry.rings import polygon_parts
from eaves.geometry.tolerance import COORDINATE_STEP
from eaves.model import Solid
from eaves.model.building import ROOF_SURFACE
from eaves.reconstruct.toolkit.columns import SAME_HEIGHT
from eaves.reconstruct.toolkit.coverage import coverage_of
from eaves.reconstruct.toolkit.undersides import RoofPlan, cells_of, close_slabs

CLEARANCE = SAME_HEIGHT + COORDINATE_STEP
"""A body begins so far (m) over the planes of the roof: what rounding and shared vertices move both by."""

OVER_BORDER = 2.0 * COORDINATE_STEP
"""A higher face counts up to so far (m) beyond its border, for the corners of a body are rounded."""

LOWEST = 0.05
"""A body is at least so high (m)."""

NARROWEST = 0.04
"""Pieces of a body narrower than this (m) are left out."""


def stand_bodies(
    solids: tuple[Solid, ...], outlines: Sequence[Polygon], tops: Sequence[float]
) -> list[Solid | None]:
    """The body of each object: what its outline holds between the roof of the solids and its top (m), where
    no object before it stands. None where nothing is left.
    """
    roofs = [RoofPlan.of(solid) for solid in solids]
    polygons, planes = (
        np.concatenate([getattr(roof, name) for roof in roofs]) for name in ("polygons", "planes")
    )
    corners = [
        solid.vertices[list(chain.from_iterable(face.rings))]
        for solid in solids
        for face in solid.faces
        if face.surface == ROOF_SURFACE
    ]
    pairs = zip(corners, planes, strict=True)
    off = np.array([np.abs(some[:, :2] @ plane[:2] + plane[2] - some[:, 2]).max() for some, plane in pairs])
    bodies: list[Solid | None] = []
    taken: BaseGeometry = Polygon()
    for outline, top in zip(outlines, tops, strict=True):
        free = shapely.difference(outline, taken, grid_size=COORDINATE_STEP)
        pieces = list(pieces_of(free, top, polygons, planes, off))
        bodies.append(raise_pieces(pieces, top))
        taken = shapely.union(taken, outline)
    return bodies


def pieces_of(
    outline: BaseGeometry,
    top: float,
    polygons: NDArray[np.object_],
    planes: NDArray[np.float64],
    off: NDArray[np.float64],
) -> Iterator[tuple[Polygon, NDArray[np.float64]]]:
    """The pieces of an outline over the roof faces (F,), and the plane (3,) on which the body of each begins,
    clear of all faces under it, which are `off` (F,; m) their planes at most.
    """
    near = np.flatnonzero(shapely.intersects(polygons, outline))
    middle = shapely.get_coordinates(shapely.point_on_surface(shapely.intersection(polygons[near], outline)))
    heights = middle @ planes[near, :2].T
    order = near[np.argsort(-(np.diag(heights) + planes[near, 2]), kind="stable")]
    for face in order.tolist():
        reach = shapely.buffer(polygons[face], OVER_BORDER, join_style="mitre")
        piece = shapely.intersection(outline, reach, grid_size=COORDINATE_STEP)
        outline = shapely.difference(outline, reach, grid_size=COORDINATE_STEP)
        above = 0.0
        for other in near.tolist():
            places = shapely.get_coordinates(shapely.intersection(piece, polygons[other]))
            rise = places @ (planes[other] - planes[face])[:2] + (planes[other] - planes[face])[2]
            above = max(above, float(rise.max(initial=0.0)) + off[other] * (len(places) > 0))
        floor = planes[face] + [0.0, 0.0, above + CLEARANCE]
        for part in polygon_parts(below(piece, floor, top - LOWEST)):
            if 2.0 * part.area > NARROWEST * part.length:
                yield part, floor


def below(piece: BaseGeometry, plane: NDArray[np.float64], height: float) -> BaseGeometry:
    """Where in a piece of plan a plane (3,) lies under a height (m)."""
    a, b, c = plane
    steep = float(np.hypot(a, b))
    west, south, east, north = piece.bounds if not piece.is_empty else (0.0, 0.0, 0.0, 0.0)
    middle = np.array([0.5 * (west + east), 0.5 * (south + north)])
    room = height - float(middle @ [a, b]) - c
    reach = east - west + north - south
    if room >= steep * reach or piece.is_empty:
        return piece
    if room <= -steep * reach:
        return Polygon()
    uphill, across = np.array([a, b]) / steep, np.array([-b, a]) / steep
    foot = middle + uphill * (room / steep)
    sides = [foot + across * reach, foot - across * reach]
    far = uphill * 3.0 * reach
    return shapely.intersection(piece, Polygon([*sides, sides[1] - far, sides[0] - far]))


def raise_pieces(pieces: list[tuple[Polygon, NDArray[np.float64]]], top: float) -> Solid | None:
    """The largest body of pieces that hang together, from their planes up to the top (m); where it would
    touch itself that of the largest piece, without its small corners.
    """
    if not pieces:
        return None
    largest, floor = max(pieces, key=lambda piece: piece[0].area)
    smooth = shapely.simplify(shapely.buffer(largest, -NARROWEST, join_style="mitre"), 0.5 * NARROWEST)
    for some in (pieces, [(part, floor) for part in polygon_parts(smooth)[:1]]):
        polygons = np.array([polygon for polygon, _ in some], object)
        cells, owner = cells_of(polygons, shapely.boundary(polygons))
        plan = coverage_of(cells, COORDINATE_STEP)
        if plan is not None:
            level = RoofPlan(polygons, np.tile([0.0, 0.0, top], (len(some), 1)), (None,) * len(some), top)
            floors = np.array([some[number][1] for number in owner])
            bodies, touching = close_slabs(plan, level, owner, np.zeros(len(owner), bool), floors)
            if len(touching) == 0:
                return max(bodies, key=lambda body: float(np.ptp(body.vertices[:, :2], axis=0).prod()))
    return None
