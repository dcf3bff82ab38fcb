"""The points of a block with its surroundings, from the store, in canonical order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eaves.kernels import inlined_kernel, kernel
from eaves.model import GRID_STEP, Block, Bounds, PointCloud, Points
from eaves.model.cloud import PER_METRE
from eaves.run.store import RECORD, Store, join_records, map_records
from eaves.run.world_squares import squares_touching


@dataclass(frozen=True, eq=False)
class PointWindow:
    """The points (N,) of a block and of its surroundings.

    Parameters
    ----------
    block : Block
        The block.
    cloud : PointCloud
        The points about its corner, in canonical order.
    number : ndarray
        Their numbers (N,) among all points of the blocks they lie in, which count on from block to block, and
        in a block from file to file.
    ranges : mapping
        Block to the first number in it, and the one behind its last.
    ends : sequence of int
        Number of points that each file of the block holds with those before it.
    """

    block: Block
    cloud: PointCloud
    number: NDArray[np.int64]
    ranges: Mapping[Block, tuple[int, int]]
    ends: Sequence[int]

    @property
    def inside(self) -> NDArray[np.int32]:
        """The numbers (K,) in the block's files of the points that lie in the block, in their order."""
        start, end = self.ranges.get(self.block, (0, 0))
        inside = self.number[(self.number >= start) & (self.number < end)] - start
        return inside.astype(np.int32)

    @property
    def file(self) -> NDArray[Any]:
        """The number (K,) of the file of each point inside the block; empty where all are of one file, though
        others had points here that were superseded."""
        inside = self.inside if len({0, *self.ends}) > 2 else self.inside[:0]
        return np.searchsorted(self.ends, inside, "right").astype(np.min_scalar_type(len(self.ends)))

    def with_ground(self, ground: Mapping[Block, Mapping[str, NDArray[np.uint8]]]) -> PointCloud:
        """The points with the classes and parts that the ground step gave those of each block.

        Raises
        ------
        RuntimeError
            Where it failed in a block.
        """
        if not self.ranges:
            return self.cloud
        count = max(end for _, end in self.ranges.values())
        classes, parts = np.zeros(count, np.uint8), np.zeros(count, np.uint8)
        for block, (start, end) in self.ranges.items():
            if block not in ground:
                raise RuntimeError("the ground under some of its points could not be found")
            result = ground[block]
            classes[start:end] = result["class"]
            parts[start:end] = result.get("part", 0)
        part = parts.take(self.number)
        return self.cloud.with_(classification=classes.take(self.number), part=part if part.any() else None)


def load_window(store: Store, block: Block, reach: float, ids: bool = True) -> PointWindow:
    """The points of a block and of its surroundings up to `reach` (m), with `ids` their own."""
    bounds = block.bounds.buffered(reach)
    west, south, east, north = (round(value / GRID_STEP) for value in bounds)
    ranges: dict[Block, tuple[int, int]] = {}
    pieces, count, ends = [], 0, list[int]()
    rows = np.zeros((north - south) // PER_METRE + 2, np.int64)
    # from south to north and west to east: dealt out to rows of cells, the points are in order where each
    # block has them from one file and the cells of blocks agree
    for square in sorted(squares_touching(bounds, block.side), key=lambda block: (block.row, block.column)):
        right, up = (round(way / GRID_STEP) for way in square.origin)
        limits, start = (west - right, south - up, east - right, north - up), count
        for records in store.map_points(square):
            which = within_kernel(records["xyz"], *limits, rows)
            if len(which):
                pieces.append((square, records, which, count))
            count += len(records)
            if square == block:
                ends.append(count - start)
        if pieces and pieces[-1][0] == square:
            ranges[square] = start, count
    fields = {"point_id": ids, "return_number": store.has_returns, "number_of_returns": store.has_returns}
    fields["classification"] = store.has_classes
    total, free = int(rows.sum()), np.cumsum(rows) - rows
    arrays = {name: np.empty(total, RECORD[name]) for name, needed in fields.items() if needed}
    xyz, number = np.empty((total, 3)), np.empty(total, np.int64)
    ordered = len(pieces) == len({square for square, *_ in pieces})
    others = {name: np.empty(total) for name in store.fields}
    for square, records, which, first in pieces:
        right, up = (round(way / GRID_STEP) for way in np.subtract(square.origin, block.origin))
        ordered &= right % PER_METRE == 0 == up % PER_METRE
        low = south - round(square.origin[1] / GRID_STEP)
        place = deal_kernel(records["xyz"], which, low, free, right, up, GRID_STEP, xyz)
        number[place] = which + first
        chosen = records.take(which)  # to take from a column would copy the whole of it first
        for name, values in arrays.items():
            values[place] = np.ascontiguousarray(chosen[name])
        for name, values in others.items():
            values[place] = np.ascontiguousarray(chosen["fields"][name])
    cloud = PointCloud(xyz, block.origin, **arrays, fields=others, system=store.system, ordered=ordered)
    order = cloud.canonical_order()
    return PointWindow(block, replace(cloud.take(order), ordered=True), number.take(order), ranges, ends)


def load_points(store: Store, block: Block) -> tuple[NDArray[Any], bool]:
    """The points of a block, and whether the files classify them."""
    return store.read_points(block), store.has_classes


def load_chosen(store: Store, block: Block) -> NDArray[Any]:
    """The points of a block that methods see, with heights as they were read."""
    return join_records(store.map_chosen(block))


def load_files(store: Store, block: Block) -> list[NDArray[Any]]:
    """All points of a block, those of each file in canonical order."""
    return store.map_all(block)


def load_scans(store: Store, block: Block) -> list[tuple[int, NDArray[Any]]]:
    """The points of a block as they were read, those of each file with the number of its input."""
    return [
        (scan, records)
        for scan, path in store.scan_files(block)
        for records in map_records([path], store.record)
    ]


def load_inputs(store: Store, block: Block, bounds: Bounds) -> dict[int, list[Points]]:
    """The points (N, 3) within world metres as they were read, about a block's corner (m): input, by number,
    to those in each of its files."""
    points: dict[int, list[Points]] = {}
    for square in squares_touching(bounds, block.side):
        limits = [round(value / GRID_STEP) for value in bounds.translated(*-np.array(square.origin))]
        shift = (*np.subtract(square.origin, block.origin), 0.0)
        rows = np.zeros((limits[3] - limits[1]) // PER_METRE + 2, np.int64)
        for number, records in load_scans(store, square):
            which = within_kernel(records["xyz"], *limits, rows)
            if len(which):
                points.setdefault(number, []).append(records["xyz"].take(which, axis=0) * GRID_STEP + shift)
    return points


@kernel
def within_kernel(
    quanta: NDArray[np.int32], west: int, south: int, east: int, north: int, rows: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Numbers (K,) of the points (N, 3) inside a window, all in quanta, which are counted in their `rows` of
    cells from its south. The points are in canonical order: in each row no more is looked at than the cells
    that the window touches."""
    which, count, end = np.empty(len(quanta), np.int64), 0, first_kernel(quanta, 1, south, 0, len(quanta))
    while end < len(quanta) and quanta[end, 1] // PER_METRE * PER_METRE < north:
        start, row = end, quanta[end, 1] // PER_METRE
        end, before = first_kernel(quanta, 1, (row + 1) * PER_METRE, start, len(quanta)), count
        for i in range(first_kernel(quanta, 0, west, start, end), end):
            if quanta[i, 0] // PER_METRE * PER_METRE >= east:
                break
            which[count] = i
            count += west <= quanta[i, 0] < east and south <= quanta[i, 1] < north
        rows[row - south // PER_METRE] += count - before
    return which[:count]


@inlined_kernel
def first_kernel(quanta: NDArray[np.int32], axis: int, level: int, start: int, end: int) -> Any:
    """The first of some points, whose cells rise along an axis, that lies in the cell of a level or after."""
    while start < end:
        middle = (start + end) // 2
        if quanta[middle, axis] // PER_METRE < level // PER_METRE:
            start = middle + 1
        else:
            end = middle
    return start


@kernel
def deal_kernel(
    quanta: NDArray[np.int32],
    which: NDArray[np.int64],
    south: int,
    free: NDArray[np.int64],
    right: int,
    up: int,
    quantum: float,
    xyz: Points,
) -> NDArray[np.int64]:
    """Deal points (K of N, 3) out to the places that are `free` in their rows of cells, counted from `south`:
    their coordinates, moved by whole quanta, in metres into `xyz`, and the places (K,)."""
    place = np.empty(len(which), np.int64)
    for k in range(len(which)):
        i = which[k]
        row = quanta[i, 1] // PER_METRE - south // PER_METRE
        place[k] = free[row]
        free[row] += 1
        xyz[place[k], 0] = (quanta[i, 0] + right) * quantum
        xyz[place[k], 1] = (quanta[i, 1] + up) * quantum
        xyz[place[k], 2] = quanta[i, 2] * quantum
    return place
