"""The vertices over the nodes of a plan, the walls between them, and where these touch, as compiled loops."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.geometry.tolerance import COORDINATE_STEP, PLANARITY
from eaves.kernels import inlined_kernel, kernel
from eaves.reconstruct.toolkit.half_edges import OUTSIDE, Integers, leaving_kernel

SAME_HEIGHT = 0.4 * PLANARITY
"""Heights over one node that are nearer than this (m) become one vertex, half of it off each plane: with the
rounding of coordinates within 0.01 feet of it, the limit for files in feet."""


@inlined_kernel
def on_grid(value: float) -> float:
    """A coordinate (m) on the grid of those that are written, as `numpy.round` has it."""
    return float(np.rint(np.rint(value / COORDINATE_STEP) * COORDINATE_STEP * 1e6) / 1e6)


@kernel
def crossings_kernel(
    nodes: NDArray[np.float64],
    start: Integers,
    end: Integers,
    cell: Integers,
    twin: Integers,
    planes: NDArray[np.float64],
) -> tuple[Integers, NDArray[np.float64]]:
    """Where the planes (C, 3) of two cells cross along their edge: its half (K,) and the place (K, 2)."""
    halves, places, count = np.empty(len(start), np.int64), np.empty((len(start), 2)), 0
    for half in range(len(start)):
        if not cell[half] > cell[twin[half]] >= 0:
            continue
        one, other = planes[cell[half]], planes[cell[twin[half]]]
        a, b, c = one[0] - other[0], one[1] - other[1], one[2] - other[2]
        ax, ay, bx, by = (
            nodes[start[half], 0],
            nodes[start[half], 1],
            nodes[end[half], 0],
            nodes[end[half], 1],
        )
        before, after = a * ax + b * ay + c, a * bx + b * by + c
        if not before * after < 0.0 or not min(abs(before), abs(after)) > SAME_HEIGHT:
            continue
        share = before / (before - after)
        x, y = on_grid(ax * (1.0 - share) + bx * share), on_grid(ay * (1.0 - share) + by * share)
        if min(np.hypot(x - ax, y - ay), np.hypot(x - bx, y - by)) > 1.5 * COORDINATE_STEP:
            halves[count], places[count, 0], places[count, 1] = half, x, y
            count += 1
    return halves[:count], places[:count]


@kernel
def columns_kernel(
    nodes: NDArray[np.float64],
    start: Integers,
    cell: Integers,
    twin: Integers,
    following: Integers,
    planes: NDArray[np.float64],
    base: float,
) -> tuple[NDArray[np.float64], Integers, Integers, Integers]:
    """Vertices (V, 3), one for each group of nearly equal heights of the cells over a node; the vertex (H,)
    of each half-edge's cell over its start; the walls; the nodes (K,) at which walls touch.

    Vertices of a node have consecutive numbers, from low to high; the `base` (m) of the outside comes first.
    A wall (W, 4) is foot and top over the start of an edge, foot and top over its end. Walls touch in a
    stretch of a column that more than two of them share.
    """
    leaving, first = leaving_kernel(start, len(nodes))
    height = np.empty(len(start))
    for half in range(len(start)):
        if cell[half] == OUTSIDE:
            height[half] = base
            continue
        a, b, c = planes[cell[half]]
        height[half] = a * nodes[start[half], 0] + b * nodes[start[half], 1] + c
    vertices, vertex, count = np.empty((len(start), 3)), np.empty(len(start), np.int64), 0
    for node in range(len(nodes)):
        some = leaving[first[node] : first[node + 1]]
        for one in range(1, len(some)):
            half, place = some[one], one
            while place > 0:
                other = some[place - 1]
                alike = (cell[half] == OUTSIDE) == (cell[other] == OUTSIDE)
                if (alike and height[half] >= height[other]) or (not alike and cell[other] == OUTSIDE):
                    break
                some[place] = other
                place -= 1
            some[place] = half
        low = 0
        for one in range(1, len(some) + 1):
            if one < len(some) and not (
                height[some[one]] - height[some[one - 1]] > SAME_HEIGHT
                or (cell[some[one]] == OUTSIDE) != (cell[some[one - 1]] == OUTSIDE)
            ):
                continue
            vertices[count, 0], vertices[count, 1] = nodes[node, 0], nodes[node, 1]
            vertices[count, 2] = on_grid(0.5 * (height[some[low]] + height[some[one - 1]]))
            for half in some[low:one]:
                vertex[half] = count
            count, low = count + 1, one
    spans, walls = np.empty((len(start), 4), np.int64), 0
    change = np.zeros(count + 1, np.int64)
    for half in range(len(start)):
        top_start, top_end = vertex[half], vertex[following[half]]
        foot_start, foot_end = vertex[following[twin[half]]], vertex[twin[half]]
        if cell[half] == OUTSIDE or top_start < foot_start or top_end < foot_end:
            continue
        if top_start == foot_start and top_end == foot_end:
            continue
        spans[walls, 0], spans[walls, 1], spans[walls, 2], spans[walls, 3] = (
            foot_start,
            top_start,
            foot_end,
            top_end,
        )
        walls += 1
        change[foot_start] += 1
        change[foot_end] += 1
        change[top_start] -= 1
        change[top_end] -= 1
    shared = np.cumsum(change) > 2
    touching = np.zeros(len(nodes), np.bool_)
    for half in range(len(start)):
        touching[start[half]] |= shared[vertex[half]]
    return vertices[:count], vertex, spans[:walls], np.flatnonzero(touching)
