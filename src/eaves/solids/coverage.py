"""A polygon cut into cells that share their nodes and edges: the plan of a building model."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from eaves.geometry.inside import points_in_polygons
from eaves.geometry.tolerance import COORDINATE_STEP
from eaves.model import Points, Values
from eaves.solids.half_edges import (
    OUTSIDE,
    Integers,
    follow_kernel,
    merge_kernel,
    regions_kernel,
    rings_kernel,
)

OVERSHOOT = 0.01
"""Distance (m) by which a line runs past the one it ends on, so that rounding leaves no gap; a shorter one is
none."""


@dataclass(frozen=True, eq=False)
class Coverage:
    """Half-edges between nodes; the cell to the left of each. Every half-edge has its twin, the way back.

    `nodes` (V, 2) are places in plan, `start`, `end` and `cell` (H,) describe the half-edges. The outside has
    half-edges too, with cell `OUTSIDE`.
    """

    nodes: NDArray[np.float64]
    start: Integers
    end: Integers
    cell: Integers

    @cached_property
    def count(self) -> int:
        """Number of cells."""
        return int(self.cell.max(initial=-1)) + 1

    @cached_property
    def neighbours(self) -> tuple[Integers, Integers]:
        """`twin` and `following`."""
        twin, following = follow_kernel(self.nodes, self.start, self.end, self.cell)
        return twin, following

    @property
    def twin(self) -> Integers:
        """Number of the half-edge that goes the other way (H,)."""
        return self.neighbours[0]

    @property
    def following(self) -> Integers:
        """The half-edge (H,) that comes next on the ring around the cell to the left.

        Where a cell touches itself in a node, the ring follows what lies between, so every ring is simple.
        """
        return self.neighbours[1]

    @cached_property
    def length(self) -> Values:
        """Length (H,) of every half-edge (m)."""
        step = self.nodes[self.end] - self.nodes[self.start]
        return np.asarray(np.hypot(step[:, 0], step[:, 1]))

    @cached_property
    def measures(self) -> tuple[Integers, Integers, Integers, Values, Values, Integers]:
        """`ring_order`, `ring_cell`, `ring_area`, `area` and `outer_ring`."""
        half_edges = (self.nodes, self.start, self.end, self.cell, self.following, self.count)
        halves, first, ring_cell, ring_area, area, outer = rings_kernel(*half_edges)
        return halves, first, ring_cell, ring_area, area, outer

    @property
    def ring_order(self) -> tuple[Integers, Integers]:
        """The half-edges (H,) ring by ring, and where each ring starts among them (R + 1,)."""
        return self.measures[:2]

    @property
    def ring_cell(self) -> Integers:
        """The cell (R,) to the left of every ring."""
        return self.measures[2]

    @property
    def ring_area(self) -> Values:
        """Signed area of every ring, positive when counter-clockwise (m²)."""
        return self.measures[3]

    @property
    def area(self) -> Values:
        """Area (C,) of every cell (m²)."""
        return self.measures[4]

    @property
    def outer_ring(self) -> Integers:
        """The first counter-clockwise ring (C,) of every cell, -1 for a cell without area to stand on: with
        none, or with a ring of fewer than three edges.
        """
        return self.measures[5]

    def polygons(self) -> NDArray[np.object_]:
        """The cells (C,) as shapely polygons; empty where a cell has no outer ring."""
        return self._polygons

    @cached_property
    def _polygons(self) -> NDArray[np.object_]:
        halves, first = self.ring_order
        outer = np.append(self.outer_ring, -1)[self.ring_cell]
        numbers = np.flatnonzero(outer >= 0)
        numbers = numbers[np.lexsort((numbers, numbers != outer[numbers], self.ring_cell[numbers]))]
        shapes = np.full(self.count, Polygon(), object)
        if len(numbers) == 0:
            return shapes
        size = np.diff(first)[numbers]
        step = np.arange(int(size.sum())) - np.repeat(np.cumsum(size) - size, size)
        places = self.nodes[self.start[halves[np.repeat(first[numbers], size) + step]]]
        rings = shapely.linearrings(places, indices=np.repeat(np.arange(len(numbers)), size))
        cells, owner = np.unique(self.ring_cell[numbers], return_inverse=True)
        shapes[cells] = shapely.polygons(rings, indices=owner.ravel())
        return shapes

    def cells_of(self, points: Points) -> tuple[Integers, Integers]:
        """Pairs of point and cell (K,), (K,): which cell each of the points (N, 3) lies in; on a border, in
        several.
        """
        halves = np.flatnonzero(np.append(self.outer_ring, -1)[self.cell] >= 0)
        halves = halves[np.argsort(self.cell[halves], kind="stable")]
        start, end = self.nodes[self.start[halves]], self.nodes[self.end[halves]]
        return points_in_polygons(points, start, end, self.cell[halves], self.count)

    def cells_merged(self, label: Integers, located: tuple[Integers, Integers]) -> tuple[Integers, Integers]:
        """The answer of `cells_of` once cells of like label (C,) are `merged`, from its answer before."""
        point, cell = located
        region = self.regions(label)[0][cell]
        inside = region != OUTSIDE
        point, region = point[inside], region[inside]
        if len(point) and (point[1:] == point[:-1]).any():
            key = np.unique(point * self.count + region)
            point, region = key // self.count, key % self.count
        return point, region

    def merged(self, label: Integers) -> tuple[Coverage, Integers]:
        """Neighbouring cells of like label (C,) made one, and the label of each new cell.

        Cells with label `OUTSIDE` leave the coverage.
        """
        label = np.ascontiguousarray(label, np.int64)
        *parts, first = merge_kernel(self.nodes, self.start, self.end, self.cell, self.twin, label)
        return Coverage(*parts), label[first]

    def regions(self, label: Integers) -> tuple[Integers, Integers]:
        """The number (C,) of the connected region of like label that each cell is in, and the first cell of
        each region.

        Cells with label `OUTSIDE` have that number.
        """
        region, first = regions_kernel(self.cell, self.twin, np.ascontiguousarray(label, np.int64))
        return region, first

    def split(self, halves: Integers, places: NDArray[np.float64]) -> Coverage:
        """A new node at `places` (K, 2) on each of the edges `halves` (K,), given by one of their halves."""
        if len(halves) == 0:
            return self
        middle = len(self.nodes) + np.arange(len(halves))
        end = self.end.copy()
        back = self.twin[halves]
        end[halves] = middle
        end[back] = middle
        return Coverage(
            np.vstack([self.nodes, places]),
            np.concatenate([self.start, middle, middle]),
            np.concatenate([end, self.end[halves], self.end[back]]),
            np.concatenate([self.cell, self.cell[halves], self.cell[back]]),
        )

    def translated(self, nodes: NDArray[np.float64]) -> Coverage:
        """The same graph with other places for its nodes."""
        return replace(self, nodes=nodes)


def coverage_of(polygons: NDArray[np.object_], grid: float) -> Coverage | None:
    """The coverage of polygons that share nodes (coordinates on the grid, m), or None when they overlap."""
    shapes = shapely.orient_polygons(polygons)
    rings, owner = shapely.get_rings(shapes, return_index=True)
    if len(rings) == 0:
        return None
    places, ring = shapely.get_coordinates(rings, return_index=True)
    steps = np.round(places / grid).astype(np.int64)
    low = steps.min(axis=0)
    width = int(steps[:, 1].max() - low[1]) + 1
    key = (steps[:, 0] - low[0]) * width + steps[:, 1] - low[1]
    distinct, first, number = np.unique(key, return_index=True, return_inverse=True)
    goes_on = ring[:-1] == ring[1:]
    start, end, cell = number[:-1][goes_on], number[1:][goes_on], owner[ring[:-1]][goes_on]
    size = len(distinct)
    forward, back = start * size + end, end * size + start
    sorted_forward = np.sort(forward)
    if np.any(sorted_forward[1:] == sorted_forward[:-1]) or np.any(start == end):
        return None
    place = np.minimum(np.searchsorted(sorted_forward, back), len(forward) - 1)
    alone = sorted_forward[place] != back
    return Coverage(
        np.round(steps[first] * grid, 6),
        np.concatenate([start, end[alone]]).astype(np.int64),
        np.concatenate([end, start[alone]]).astype(np.int64),
        np.concatenate([cell, np.full(int(alone.sum()), OUTSIDE)]).astype(np.int64),
    )


NARROWEST_NECK = 0.03
"""What is held together or apart by less than this (m) touches, for all that can be built: parts of a
footprint, a segment and a corner that it passes."""

SMALLEST_PART = 0.1
"""Parts of a footprint, and cells between a wall and a border of the roof, that are smaller (m²) are none."""


def through_corners(segments: NDArray[np.float64], corners: NDArray[np.float64]) -> NDArray[np.object_]:
    """The segments (S, 4) as lines that bend through the corners (K, 2) they would nearly touch, or
    end there."""
    ends = segments.reshape(-1, 2, 2)
    lines = np.asarray(shapely.linestrings(ends), object)
    tree = shapely.STRtree(shapely.points(corners))
    number, corner = tree.query(lines, predicate="dwithin", distance=NARROWEST_NECK)
    step = ends[number, 1] - ends[number, 0]
    length = np.maximum(np.hypot(step[:, 0], step[:, 1]), COORDINATE_STEP)
    along = ((corners[corner] - ends[number, 0]) * step).sum(axis=1) / length**2
    order = np.lexsort((corner, along, number))
    number, place = number[order], corners[corner[order]]
    line_numbers, first = np.unique(number, return_index=True)
    last = np.searchsorted(number, line_numbers, side="right") - 1
    stays = [
        np.hypot(*(ends[line_numbers, k] - place[indices]).T) >= NARROWEST_NECK
        for k, indices in enumerate((first, last))
    ]
    number = np.concatenate([line_numbers[stays[0]], number, line_numbers[stays[1]]])
    order = np.argsort(number, kind="stable")
    path = np.concatenate([ends[line_numbers[stays[0]], 0], place, ends[line_numbers[stays[1]], 1]])[order]
    number = number[order]
    bent = np.bincount(number, minlength=len(lines)) > 1
    path, number = path[bent[number]], number[bent[number]]
    lines[bent] = shapely.linestrings(path, indices=np.cumsum(np.diff(number, prepend=-1) > 0) - 1)
    return lines


def cut_polygons(
    polygons: NDArray[np.object_], lines: NDArray[np.object_]
) -> tuple[NDArray[np.object_], Integers]:
    """The cells (C,) that lines cut polygons into, on the grid of coordinates, and the polygon of each."""
    net = shapely.union_all(lines, grid_size=COORDINATE_STEP)
    cells = shapely.get_parts(shapely.polygonize(shapely.get_parts(net)))
    cell, owner = shapely.STRtree(polygons).query(shapely.point_on_surface(cells), predicate="within")
    return cells[cell], owner
