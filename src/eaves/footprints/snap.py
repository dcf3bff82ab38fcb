"""Given footprints moved to the eaves in the points; what they share stays shared."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from shapely import Polygon

from eaves.geometry.rings import COORDINATE_STEP, shared_rings
from eaves.model import Footprint, Integers, Points, Values
from eaves.outline.global_fit import GlobalFit
from eaves.outline.toolkit.edges import edge_shift_kernel

REACH_M = 1.5
"""Farthest that an edge moves: a wide overhang, or a map a metre off."""
LEAST_LENGTH = 3.0
"""Shorter edges, in spacings, tell nothing of their own."""
FIT = GlobalFit()
"""The outline method whose blur of an edge (m) and reach from roof to wall points (m) hold here, too."""
LEAST_POINTS = 9
"""Fewer points behind an edge tell nothing."""
STIFFNESS = 0.05
"""Weight of staying in place, against 1 for a measured edge: keeps blunt corners from sliding away."""


def snap_footprints(footprints: Sequence[Footprint], points: Points, spacing: float) -> list[Footprint]:
    """The footprints (same local metres as `points` (N, 3), roof points) with their free edges at the eaves.

    Edges that two footprints share are party walls and move only with their ends. Every other edge long
    enough to tell moves along its normal to where the points behind it end, at most `REACH_M`: first all of
    them together by the one shift that serves most, then each by what is left. A vertex goes where its
    edges take it, so common vertices stay common. The vertices of a footprint that would become invalid go
    with the common shift only.
    """
    if len(footprints) == 0 or len(points) == 0:
        return list(footprints)
    nodes, rings, owner = shared_rings([footprint.polygon for footprint in footprints])
    first, second = free_edges(rings)
    moved = base = nodes
    for together in (True, False):
        shift, normal, length = edge_shifts(moved, first, second, points, spacing)
        finite = np.isfinite(shift)
        if not finite.any():
            break
        if together:
            moved = base = moved + common_shift(shift[finite], normal[finite], length[finite])
        else:
            moved = moved + vertex_moves(len(nodes), first, second, shift, normal, length)
    base, moved = (np.round(xy / COORDINATE_STEP) * COORDINATE_STEP for xy in (base, moved))
    while True:
        polygons = [
            polygon_of([moved[ring] for ring, holder in zip(rings, owner, strict=True) if holder == number])
            for number in range(len(footprints))
        ]
        spoilt = {
            number
            for number, (polygon, source) in enumerate(zip(polygons, footprints, strict=True))
            if not polygon.is_valid or polygon.area < 0.5 * source.polygon.area
        }
        nodes_of = [ring for ring, holder in zip(rings, owner, strict=True) if holder in spoilt]
        back = np.unique(np.concatenate([*nodes_of, np.zeros(0, np.int64)]))
        if (moved[back] == base[back]).all():
            break
        moved[back] = base[back]
    shifted = base[0] - nodes[0]
    return [
        footprint.with_(
            polygon=shapely.orient_polygons(
                shapely.transform(footprint.polygon, lambda xy: xy + shifted) if number in spoilt else polygon
            )
        )
        for number, (footprint, polygon) in enumerate(zip(footprints, polygons, strict=True))
    ]


def polygon_of(rings: list[Values]) -> Polygon:
    """The polygon of an outer ring and its holes; an empty one where vertices fell together."""
    outer, *holes = rings
    return Polygon(outer, [hole for hole in holes if len(hole) > 2]) if len(outer) > 2 else Polygon()


def free_edges(rings: list[Integers]) -> tuple[Integers, Integers]:
    """The vertices where the edges of one polygon only start and end, (E,) each."""
    first = np.concatenate(rings)
    second = np.concatenate([np.roll(ring, -1) for ring in rings])
    key = np.minimum(first, second) * (first.max() + 1) + np.maximum(first, second)
    _, which, count = np.unique(key, return_inverse=True, return_counts=True)
    alone = count[which] == 1
    return first[alone], second[alone]


def edge_shifts(
    nodes: Values,
    first: Integers,
    second: Integers,
    points: Points,
    spacing: float,
) -> tuple[Values, Values, Values]:
    """Distance (E,) of each edge from the end of the points, its inward normal (E, 2) and its length (E,).

    NaN where the edge is short, has no points behind it, or the points go on before it (a building that the
    map does not know).
    """
    run = nodes[second] - nodes[first]
    length = np.maximum(np.hypot(*run.T), COORDINATE_STEP)
    normal = np.stack([-run[:, 1], run[:, 0]], axis=1) / length[:, None]
    offset = (normal * nodes[first]).sum(axis=1)
    outside, inside = REACH_M + 2.0 * spacing, REACH_M + 4.0 * spacing
    shift = edge_shift_kernel(
        points,
        normal,
        offset,
        nodes[first],
        length,
        outside,
        inside,
        2.0 * spacing,
        FIT.blur,
        FIT.least_beside,
        LEAST_POINTS,
    )
    useless = (length < LEAST_LENGTH * spacing) | (np.abs(shift) > REACH_M)
    return np.where(useless, np.nan, shift), normal, length


def common_shift(shift: Values, normal: Values, length: Values) -> Values:
    """The one translation (2,) that serves the edges best; overhangs on opposite sides cancel."""
    weight = length / length.sum()
    matrix = (normal * weight[:, None]).T @ normal + STIFFNESS * np.eye(2)
    return np.asarray(np.linalg.solve(matrix, (normal * (weight * shift)[:, None]).sum(axis=0)))


def vertex_moves(
    count: int,
    first: Integers,
    second: Integers,
    shift: Values,
    normal: Values,
    length: Values,
) -> Values:
    """Displacement (count, 2) of each vertex that moves its edges by `shift` (E,) along their normals."""
    finite = np.isfinite(shift)
    step = np.where(finite, shift, 0.0)
    matrix = np.tile(STIFFNESS * np.eye(2), (count, 1, 1))
    right = np.zeros((count, 2))
    weight = np.minimum(length / 3.0, 1.0)
    outer = weight[:, None, None] * normal[:, :, None] * normal[:, None, :]
    for end in (first, second):
        np.add.at(matrix, end, outer)
        np.add.at(right, end, normal * (weight * step)[:, None])
    return np.asarray(np.linalg.solve(matrix, right[:, :, None])[:, :, 0])
