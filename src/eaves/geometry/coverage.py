"""A polygon cut into cells that share their nodes and edges: the plan of a building model."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from shapely import Polygon

from eaves.model import Values

Integers = NDArray[np.int64]

OUTSIDE = -1
"""The cell number of everything that is not covered."""


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
    def twin(self) -> Integers:
        """Number of the half-edge that goes the other way (H,)."""
        size = len(self.nodes)
        there, back = self.start * size + self.end, self.end * size + self.start
        order = np.argsort(there, kind="stable")
        return np.asarray(order[np.searchsorted(there[order], back)])

    @cached_property
    def length(self) -> Values:
        """Length (H,) of every half-edge (m)."""
        step = self.nodes[self.end] - self.nodes[self.start]
        return np.asarray(np.hypot(step[:, 0], step[:, 1]))

    @cached_property
    def following(self) -> Integers:
        """The half-edge (H,) that comes next on the ring around the cell to the left.

        Where a cell touches itself in a node, the ring follows what lies between, so every ring is simple.
        """
        size = self.count + 1
        leaving, arriving = self.start * size + self.cell + 1, self.end * size + self.cell + 1
        step = self.nodes[self.end] - self.nodes[self.start]
        angle = np.arctan2(step[:, 1], step[:, 0])
        order = np.lexsort((angle, leaving))
        first = np.searchsorted(leaving[order], arriving, side="left")
        last = np.searchsorted(leaving[order], arriving, side="right")
        answer = order[np.minimum(first, len(order) - 1)]
        for half in np.flatnonzero(last - first > 1):
            choices = order[first[half] : last[half]]
            back = np.arctan2(-step[half, 1], -step[half, 0])
            turn = np.mod(angle[choices] - back, 2.0 * np.pi)
            answer[half] = choices[np.argmin(np.where(turn > 0.0, turn, 2.0 * np.pi))]
        return np.asarray(answer)

    @cached_property
    def rings(self) -> list[tuple[int, Integers]]:
        """Every ring as (cell to its left, half-edges in order)."""
        following, seen = self.following.tolist(), [False] * len(self.start)
        answer = []
        for first in range(len(seen)):
            if seen[first]:
                continue
            ring, half = [], first
            while not seen[half]:
                seen[half] = True
                ring.append(half)
                half = following[half]
            answer.append((int(self.cell[first]), np.array(ring)))
        return answer

    @cached_property
    def ring_area(self) -> Values:
        """Signed area of each of `rings`, positive when counter-clockwise (m²)."""
        x, y = (self.nodes - self.nodes[:1]).T
        cross = x[self.start] * y[self.end] - x[self.end] * y[self.start]
        return np.array([0.5 * cross[ring].sum() for _, ring in self.rings])

    @cached_property
    def area(self) -> Values:
        """Area (C,) of every cell (m²)."""
        cells = np.array([cell for cell, _ in self.rings], np.int64)
        inside = cells >= 0
        return np.asarray(
            np.bincount(cells[inside], self.ring_area[inside], minlength=self.count), np.float64
        )

    def polygons(self) -> NDArray[np.object_]:
        """The cells (C,) as shapely polygons."""
        outer: list[NDArray[np.float64] | None] = [None] * self.count
        holes: list[list[NDArray[np.float64]]] = [[] for _ in range(self.count)]
        for (cell, ring), area in zip(self.rings, self.ring_area, strict=True):
            if cell == OUTSIDE:
                continue
            places = self.nodes[self.start[ring]]
            if area > 0.0 and outer[cell] is None:
                outer[cell] = places
            else:
                holes[cell].append(places)
        answer = np.empty(self.count, object)
        for cell in range(self.count):
            shell = outer[cell]
            fits = shell is not None and len(shell) > 2 and all(len(hole) > 2 for hole in holes[cell])
            answer[cell] = Polygon(shell, holes[cell]) if fits else Polygon()
        return answer

    def merged(self, label: Integers) -> tuple[Coverage, Integers]:
        """Neighbouring cells of like label (C,) made one, and the label of each new cell.

        Cells with label `OUTSIDE` leave the coverage.
        """
        region, first = self.regions(label)
        region = np.append(region, OUTSIDE)
        new_left = region[self.cell]
        stays = new_left != new_left[self.twin]
        answer = Coverage(self.nodes, self.start[stays], self.end[stays], new_left[stays]).compact()
        return answer, np.asarray(label[first])

    def regions(self, label: Integers) -> tuple[Integers, Integers]:
        """The number (C,) of the connected region of like label that each cell is in, and the first cell of
        each region.

        Cells with label `OUTSIDE` have that number.
        """
        padded = np.append(label, OUTSIDE)
        left, right = padded[self.cell], padded[self.cell[self.twin]]
        inner = (left == right) & (left != OUTSIDE) & (self.cell != OUTSIDE)
        pairs = (self.cell[inner], self.cell[self.twin][inner])
        graph = coo_matrix((np.ones(len(pairs[0]), np.int8), pairs), shape=(self.count, self.count))
        group = connected_components(graph, directed=False)[1].astype(np.int64)
        kept = np.flatnonzero(label != OUTSIDE)
        first = np.full(int(group.max(initial=-1)) + 1, self.count)
        np.minimum.at(first, group[kept], kept)
        order = np.argsort(first, kind="stable")
        used = int((first < self.count).sum())
        number = np.full(len(first) + 1, OUTSIDE)
        number[order[:used]] = np.arange(used)
        region = np.where(label == OUTSIDE, OUTSIDE, number[group])
        return np.asarray(region, np.int64), first[order[:used]]

    def compact(self) -> Coverage:
        """The same coverage without the nodes that no edge uses."""
        used, numbers = np.unique(np.concatenate([self.start, self.end]), return_inverse=True)
        half = len(self.start)
        return Coverage(self.nodes[used], numbers[:half], numbers[half:], self.cell)

    def parts(self) -> list[tuple[Coverage, Integers]]:
        """The connected pieces of the coverage, each with the cells it is made of."""
        inner = (self.cell != OUTSIDE) & (self.cell[self.twin] != OUTSIDE)
        pairs = (self.cell[inner], self.cell[self.twin][inner])
        graph = coo_matrix((np.ones(len(pairs[0]), np.int8), pairs), shape=(self.count, self.count))
        number, group = connected_components(graph, directed=False)
        if number <= 1:
            return [(self, np.arange(self.count))]
        answer = []
        owner = np.append(group, OUTSIDE)
        side = np.where(self.cell == OUTSIDE, owner[self.cell[self.twin]], owner[self.cell])
        for piece in range(number):
            cells = np.flatnonzero(group == piece)
            numbers = np.full(self.count + 1, OUTSIDE)
            numbers[cells] = np.arange(len(cells))
            mine = side == piece
            part = Coverage(self.nodes, self.start[mine], self.end[mine], numbers[self.cell[mine]])
            answer.append((part.compact(), cells))
        return answer

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

    def moved(self, nodes: NDArray[np.float64]) -> Coverage:
        """The same graph with other places for its nodes."""
        return replace(self, nodes=nodes)


def coverage_of(polygons: NDArray[np.object_], grid: float) -> Coverage | None:
    """The coverage of polygons that share nodes (coordinates on the grid, m), or None when they overlap."""
    shapes = shapely.orient_polygons(polygons)
    rings, owner = shapely.get_rings(shapes, return_index=True)
    if len(rings) == 0:
        return None
    places, ring = shapely.get_coordinates(rings, return_index=True)
    whole = np.round(places / grid).astype(np.int64)
    low = whole.min(axis=0)
    width = int(whole[:, 1].max() - low[1]) + 1
    key = (whole[:, 0] - low[0]) * width + whole[:, 1] - low[1]
    found, first, number = np.unique(key, return_index=True, return_inverse=True)
    goes_on = ring[:-1] == ring[1:]
    start, end, cell = number[:-1][goes_on], number[1:][goes_on], owner[ring[:-1]][goes_on]
    size = len(found)
    there, back = start * size + end, end * size + start
    if len(np.unique(there)) < len(there) or np.any(start == end):
        return None
    alone = ~np.isin(back, there)
    return Coverage(
        np.round(whole[first] * grid, 6),
        np.concatenate([start, end[alone]]).astype(np.int64),
        np.concatenate([end, start[alone]]).astype(np.int64),
        np.concatenate([cell, np.full(int(alone.sum()), OUTSIDE)]).astype(np.int64),
    )
