"""A polygon cut into cells that share nodes and edges, the plan of a model, and its half-edges."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from eaves.geometry.inside import members_kernel, points_in_polygons, unite_kernel
from eaves.geometry.rings import COORDINATE_STEP
from eaves.kernels import inlined_kernel, kernel
from eaves.model import Integers, Mask, Points, Values

OUTSIDE = -1
"""The cell number of everything that is not covered."""

MOST_ROUNDS = 40
"""Passes after which improving a plan stops, finished or not; nearly all end by themselves after a few."""


@kernel
def follow_kernel(
    nodes: NDArray[np.float64], start: Integers, end: Integers, cell: Integers
) -> tuple[Integers, Integers]:
    """The half-edge (H,) that goes the other way, and the one (H,) that comes next on the ring around the
    cell to the left.

    Where a cell touches itself in a node, the ring follows what lies between, so every ring is simple.
    """
    leaving, first = members_kernel(start, len(nodes))
    twin, following = np.full(len(start), -1), np.full(len(start), -1)
    for half in range(len(start)):
        node, least = end[half], np.inf
        for place in range(first[node], first[node + 1]):
            candidate = leaving[place]
            if twin[half] < 0 and end[candidate] == start[half]:
                twin[half] = candidate
            if cell[candidate] != cell[half]:
                continue
            if following[half] < 0:
                following[half] = candidate
                continue
            back = np.arctan2(nodes[start[half], 1] - nodes[node, 1], nodes[start[half], 0] - nodes[node, 0])
            if least == np.inf:
                least = turn_from(back, nodes, node, end[following[half]])
            turn = turn_from(back, nodes, node, end[candidate])
            if turn < least:
                least, following[half] = turn, candidate
    return twin, following


@inlined_kernel
def turn_from(back: float, nodes: NDArray[np.float64], node: int, to: int) -> Any:
    """The angle (radians, over 0) to the left from the direction `back` to that from one node to another."""
    angle = np.arctan2(nodes[to, 1] - nodes[node, 1], nodes[to, 0] - nodes[node, 0])
    turn = np.mod(angle - back, 2.0 * np.pi)
    return turn if turn > 0.0 else 2.0 * np.pi


@kernel
def compact_kernel(
    nodes: NDArray[np.float64], start: Integers, end: Integers, cell: Integers
) -> tuple[NDArray[np.float64], Integers, Integers, Integers]:
    """Nodes, starts, ends and cells without the nodes that no half-edge uses."""
    number = np.full(len(nodes), -1)
    for half in range(len(start)):
        number[start[half]] = number[end[half]] = 0
    count = 0
    for node in range(len(nodes)):
        if number[node] == 0:
            number[node] = count
            count += 1
    corners = np.empty((count, 2))
    for node in range(len(nodes)):
        if number[node] >= 0:
            corners[number[node], 0], corners[number[node], 1] = nodes[node, 0], nodes[node, 1]
    return corners, number[start], number[end], cell


@kernel
def contract_kernel(
    nodes: NDArray[np.float64],
    start: Integers,
    end: Integers,
    cell: Integers,
    count: int,
    target: Integers,
) -> tuple[NDArray[np.float64], Integers, Integers, Integers, Integers]:
    """Nodes, starts, ends and cells with every node moved into node `target` (V,), and which of `count` cells
    are kept; no cell where edges would fall together otherwise than by closing a cell up."""
    none = np.zeros(0, np.int64)
    start, end = target[start], target[end]
    leaving, first = members_kernel(start, len(nodes))
    stays = start != end
    for half in range(len(start)):
        for place in range(first[end[half]], first[end[half] + 1]):
            candidate = leaving[place]
            if end[candidate] == start[half] and cell[candidate] == cell[half]:
                stays[half] = False
    start, end, cell = start[stays], end[stays], cell[stays]
    leaving, first = members_kernel(start, len(nodes))
    for half in range(len(start)):
        alike, back = 0, 0
        for place in range(first[start[half]], first[start[half] + 1]):
            alike += end[leaving[place]] == end[half]
        for place in range(first[end[half]], first[end[half] + 1]):
            back += end[leaving[place]] == start[half]
        if alike != 1 or back != 1:
            return nodes, start, end, cell, none
    number = np.full(count + 1, OUTSIDE)
    for owner in cell:
        if owner != OUTSIDE:
            number[owner] = 0
    survivors = np.flatnonzero(number[:count] == 0)
    for new in range(len(survivors)):
        number[survivors[new]] = new
    nodes, start, end, cell = compact_kernel(nodes, start, end, number[cell])
    return nodes, start, end, cell, survivors


@kernel
def straighten_kernel(
    nodes: NDArray[np.float64],
    start: Integers,
    end: Integers,
    cell: Integers,
    count: int,
    reach: float,
    rounds: int,
) -> tuple[NDArray[np.float64], Integers, Integers, Integers, Integers]:
    """Nodes, starts, ends and cells without nodes of two edges on the line of their neighbours, and which of
    `count` cells are kept.

    Nodes may be `reach` (m) away from that line. Nodes side by side go in different rounds.
    """
    survivors = np.arange(count)
    for _ in range(rounds):
        size = len(nodes)
        degree, before, after = np.zeros(size, np.int64), np.full(size, -1), np.full(size, -1)
        for half in range(len(start)):
            node = start[half]
            degree[node] += 1
            if before[node] < 0:
                before[node] = end[half]
            after[node] = end[half]
        chosen, target, changed = np.zeros(size, np.bool_), np.arange(size), False
        for node in range(size):
            if degree[node] != 2:
                continue
            a, b = before[node], after[node]
            chord_x, chord_y = nodes[b, 0] - nodes[a, 0], nodes[b, 1] - nodes[a, 1]
            x, y = nodes[node, 0] - nodes[a, 0], nodes[node, 1] - nodes[a, 1]
            length = max(np.hypot(chord_x, chord_y), 1e-9)
            away = abs(chord_x * y - chord_y * x) / length
            along = (x * chord_x + y * chord_y) / (length * length)
            needless = away <= reach and 0.0 < along < 1.0
            if needless and not chosen[a] and not chosen[b]:
                chosen[node], target[node], changed = True, a, True
        if not changed:
            break
        simpler = contract_kernel(nodes, start, end, cell, len(survivors), target)
        if len(simpler[4]) == 0:
            break
        nodes, start, end, cell = simpler[0], simpler[1], simpler[2], simpler[3]
        survivors = survivors[simpler[4]]
    return nodes, start, end, cell, survivors


@kernel
def regions_kernel(cell: Integers, twin: Integers, label: Integers) -> tuple[Integers, Integers]:
    """The number (C,) of the connected region of like `label` (C,) that each cell is in, and the first cell
    of each region; regions are counted in the order of their first cells. Cells labelled `OUTSIDE` keep that.
    """
    head = np.arange(len(label))
    for half in range(len(cell)):
        left, right = cell[half], cell[twin[half]]
        if left != OUTSIDE and right != OUTSIDE and label[left] == label[right] != OUTSIDE:
            unite_kernel(head, left, right)
    region, number = np.full(len(label), OUTSIDE), np.full(len(label), OUTSIDE)
    first, count = np.empty(len(label), np.int64), 0
    for k in range(len(label)):
        if label[k] == OUTSIDE:
            continue
        top = k
        while head[top] != top:
            top = head[top]
        if number[top] == OUTSIDE:
            number[top], first[count] = count, k
            count += 1
        region[k] = number[top]
    return region, first[:count]


@kernel
def merge_kernel(
    nodes: NDArray[np.float64],
    start: Integers,
    end: Integers,
    cell: Integers,
    twin: Integers,
    label: Integers,
) -> tuple[NDArray[np.float64], Integers, Integers, Integers, Integers]:
    """Nodes, starts, ends and cells with neighbouring cells of like `label` (C,) made one, and the first of
    the cells that each new one is made of. Cells labelled `OUTSIDE` are left out."""
    region, first = regions_kernel(cell, twin, label)
    new = np.full(len(cell), OUTSIDE)
    for half in range(len(cell)):
        if cell[half] != OUTSIDE:
            new[half] = region[cell[half]]
    stays = new != new[twin]
    nodes, start, end, cell = compact_kernel(nodes, start[stays], end[stays], new[stays])
    return nodes, start, end, cell, first


@kernel
def corner_rank_kernel(nodes: NDArray[np.float64], start: Integers, end: Integers, is_rim: Mask) -> Integers:
    """2 for corners of the rims, on half-edges that `is_rim` (H,) holds, and nodes where several meet, 1 for
    other nodes on them, 0 for nodes inside (V,)."""
    count, first, last = np.zeros((3, len(nodes)), np.int64)
    for half in np.flatnonzero(is_rim):
        node = start[half]
        if count[node] == 0:
            first[node] = end[half]
        last[node] = end[half]
        count[node] += 1
    rank = np.minimum(count, 2)
    for node in np.flatnonzero(count == 2):
        before_x, before_y = nodes[node] - nodes[first[node]]
        after_x, after_y = nodes[last[node]] - nodes[node]
        cross = before_x * after_y - before_y * after_x
        size = max(np.hypot(before_x, before_y) * np.hypot(after_x, after_y), 1e-9)
        if abs(cross) / size < 0.02 and before_x * after_x + before_y * after_y > 0.0:
            rank[node] = 1
    return rank


@kernel
def ring_order_kernel(following: Integers) -> tuple[Integers, Integers]:
    """The half-edges (H,) ring by ring, each `following` (H,) another, and where rings start (R + 1,)."""
    visited = np.zeros(len(following), np.bool_)
    halves, first = np.empty(len(following), np.int64), np.zeros(len(following) + 1, np.int64)
    rings, count = 0, 0
    for half in range(len(following)):
        if visited[half]:
            continue
        while not visited[half]:
            visited[half] = True
            halves[count] = half
            count += 1
            half = following[half]
        rings += 1
        first[rings] = count
    return halves, first[: rings + 1]


@kernel
def rings_kernel(
    nodes: NDArray[np.float64],
    start: Integers,
    end: Integers,
    cell: Integers,
    following: Integers,
    count: int,
) -> tuple[Integers, Integers, Integers, NDArray[np.float64], NDArray[np.float64], Integers]:
    """The half-edges (H,) ring by ring, where rings start (R + 1,), the cell and the signed area (R,; m²) of
    each, the area (C,; m²) of each of `count` cells, and the first counter-clockwise ring (C,) of it, -1
    where there is none or one of its rings has fewer than three edges.
    """
    halves, first = ring_order_kernel(following)
    ring_cell, ring_area = np.empty(len(first) - 1, np.int64), np.empty(len(first) - 1)
    area, outer = np.zeros(count), np.full(count, -1)
    for ring in range(len(first) - 1):
        owner = cell[halves[first[ring]]]
        total = 0.0
        for place in range(first[ring], first[ring + 1]):
            half = halves[place]
            ax, ay = nodes[start[half], 0] - nodes[0, 0], nodes[start[half], 1] - nodes[0, 1]
            bx, by = nodes[end[half], 0] - nodes[0, 0], nodes[end[half], 1] - nodes[0, 1]
            total += ax * by - bx * ay
        ring_cell[ring], ring_area[ring] = owner, 0.5 * total
        if owner >= 0:
            area[owner] += ring_area[ring]
            if outer[owner] == -1 and ring_area[ring] > 0.0:
                outer[owner] = ring
    for ring in range(len(first) - 1):
        if ring_cell[ring] >= 0 and first[ring + 1] - first[ring] < 3:
            outer[ring_cell[ring]] = -1
    return halves, first, ring_cell, ring_area, area, outer


@kernel
def sliver_kernel(
    nodes: NDArray[np.float64],
    start: Integers,
    end: Integers,
    cell: Integers,
    twin: Integers,
    is_rim: Mask,
    area: NDArray[np.float64],
    smallest: float,
    narrowest: float,
) -> Integers:
    """The cell (C,) that each goes to: itself, or where it has an `area` (C,; m²) under `smallest`, or is
    narrower (m) than `narrowest`, the neighbour that it shares most with, but for what `is_rim` (H,). The
    smallest go first; those beside them wait.

    The width is that of the rectangle that has the cell's area and perimeter; a square's where none has.
    """
    length, perimeter, shared = np.empty(len(start)), np.zeros(len(area)), np.zeros(len(area))
    for half in range(len(start)):
        a, b = nodes[start[half]], nodes[end[half]]
        length[half] = np.hypot(b[0] - a[0], b[1] - a[1])
        if cell[half] != OUTSIDE:
            perimeter[cell[half]] += length[half]
            if not is_rim[half]:
                shared[cell[half]] += length[half]
    excess = np.sqrt(np.maximum(perimeter * perimeter - 16.0 * area, 0.0))
    bad = ((area < smallest) | (0.25 * (perimeter - excess) < narrowest)) & (shared > 0.0)
    target, waits, beside = np.arange(len(area)), np.zeros(len(area), np.bool_), np.zeros(len(area))
    around, first = members_kernel(cell + 1, len(area) + 1)
    for worst in np.argsort(np.where(bad, area, np.inf), kind="mergesort")[: np.sum(bad)]:
        best = worst
        for half in around[first[worst + 1] : first[worst + 2]]:
            if not is_rim[half]:
                beside[cell[twin[half]]] += length[half]
        for half in around[first[worst + 1] : first[worst + 2]]:
            other = cell[twin[half]]
            longer = beside[other] > beside[best] or (beside[other] == beside[best] and other < best)
            if not is_rim[half] and longer:
                best = other
        clash = waits[worst] or waits[best]
        for half in around[first[worst + 1] : first[worst + 2]]:
            if not is_rim[half]:
                beside[cell[twin[half]]] = 0.0
                waits[cell[twin[half]]] |= not clash
        if not clash:
            target[worst], waits[worst] = best, True
    return target


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


def cut_polygons(
    polygons: NDArray[np.object_], lines: NDArray[np.object_]
) -> tuple[NDArray[np.object_], Integers]:
    """The cells (C,) that lines cut polygons into, on the grid of coordinates, and the polygon of each."""
    net = shapely.union_all(lines, grid_size=COORDINATE_STEP)
    cells = shapely.get_parts(shapely.polygonize(shapely.get_parts(net)))
    cell, owner = shapely.STRtree(polygons).query(shapely.point_on_surface(cells), predicate="within")
    return cells[cell], owner
