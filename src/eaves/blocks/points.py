"""Which points of a block count: none that later scans replace, one for its neighbours in a dense scan;
heights before images smoothed them; and by how much two inputs differ in height."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from types import SimpleNamespace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from eaves.geometry.neighbours import thin_kernel
from eaves.kernels import kernel
from eaves.model import GRID_STEP, NOISE_CLASSES, Block, Bounds, Mask, Points
from eaves.model.cloud import PER_METRE, canonical_order
from eaves.raster.blur import cell_of, closed_by_square, gridded, number_squares, without_blur
from eaves.run.points import IDENTITY, first_kernel, tied_kernel
from eaves.run.store import join_records

SHARPENED_MARGIN = 30.0
"""Width (m) of the surroundings of a block that are sharpened with it: ten times a blur of 3 m."""


@dataclass(frozen=True, eq=False)
class Smoothed:
    """The points (N, 3) of a block, in metres about its corner, and those around it (M, 3)."""

    own: Points
    around: Points


def inputs_of_sharpened(block: Block, points: Mapping[Block, NDArray[Any]], parameters: object) -> Smoothed:
    """The points of a block and of its surroundings, as they were read."""
    own, around = np.zeros((0, 3)), list[Points]()
    limits = np.array([-SHARPENED_MARGIN, block.side + SHARPENED_MARGIN])
    for square in sorted(points, key=lambda block: (block.row, block.column)):
        xyz = points[square]["xyz"] * GRID_STEP + [*np.subtract(square.origin, block.origin), 0.0]
        if square == block:
            own = xyz
        near = ((xyz[:, :2] >= limits[0]) & (xyz[:, :2] < limits[1])).all(axis=1)
        around.append(xyz[near])
    return Smoothed(own, np.concatenate([own[:0], *around]))


def find_sharpened(view: Smoothed, parameters: SimpleNamespace) -> dict[str, NDArray[Any]]:
    """Heights (N,) of the points of a block, in quanta, by `without_blur` of the surface that they and those
    around show, in cells of one spacing; copies stay copies, for points of a cell are moved alike."""
    if not len(view.own):
        return {}
    cell = cell_of(view.around)
    side = int(np.ceil((np.ptp(view.around[:, :2], axis=0).max() + cell) / cell))
    corner = view.around[:, :2].min(axis=0)
    surface, _ = gridded(view.around, cell, (side, side), (float(corner[0]), float(corner[1])))
    change = without_blur(surface, parameters.blur, cell) - surface
    column, row = np.floor((view.own[:, :2] - corner) / cell).astype(np.int64).T
    quanta = np.round((view.own[:, 2] + change[row, column]) / GRID_STEP)
    return {"z": quanta.astype(np.int32)}


Records = NDArray[Any]

COVER_CELL = 1.0
"""Cells (m), fixed to the world, in which the new points' area is decided: as fine as a border of tiles
needs, and wide enough that a scan of one point a square metre fills most of them."""

GAP_CELLS = 2
"""Gaps between new points up to twice so many cells wide are covered, too: missing scan lines, dark roofs. In
wider ones (water, the shadow of a tower) nothing new is known, and the earlier points stay."""

MARGIN = 2 * GAP_CELLS + 1
"""Cells around a block that decide what of it is covered."""

SAME = ("x", "y", "z", "return_number", "number_of_returns", "classification")
"""Two points that agree in these are one: a tile delivered again changes only what differs in it."""


class Scans(Protocol):
    """What decides which points are earlier ones."""

    @property
    def generations(self) -> Sequence[int]:
        """The number of the first input of each later scan."""


def inputs_of_superseded(
    block: Block, scans: Mapping[Block, list[tuple[int, Records]]], parameters: object
) -> dict[Block, list[tuple[int, Records]]]:
    """The points of a block, first, and of those around it, by the number of their input."""
    return {block: scans[block], **scans}


def find_superseded(
    view: Mapping[Block, list[tuple[int, Records]]], parameters: Scans
) -> dict[str, NDArray[np.int64]]:
    """The points of a block that are superseded: earlier points where later ones cover their place, but of
    two that agree the later one. Their ids (K,), ascending, those (G,) that went for the last scan, and
    how many of its points came, and of the earlier ones went.

    What is covered follows from the new points alone: not from the tiles they came in, nor from their order.
    """
    block = next(iter(view))
    records = join_records([points for _, points in view[block]])
    number = np.concatenate([np.full(len(points), scan, np.int64) for scan, points in view[block]])
    stays = np.ones(len(records), bool)
    came, gone = 0, np.zeros(0, np.int64)
    for first, end in pairwise((*parameters.generations, np.iinfo(np.int64).max)):
        old = np.flatnonzero(stays & (number < first))
        new = np.flatnonzero((number >= first) & (number < end))
        covered = old[covers_place(view, block, first, int(end), records[old])]
        same, again = pair_same(records[covered], records[new])
        came, gone = int((~again).sum()), covered[~same]
        stays[gone] = False
        stays[new[again]] = False
    ids = records["point_id"]
    return {"id": np.sort(ids[~stays]), "gone": ids[gone], "counts": np.array([came, len(gone)])}


def covers_place(
    scans: Mapping[Block, list[tuple[int, Records]]], block: Block, first: int, end: int, records: Records
) -> Mask:
    """Mask (N,) of a block's points in the area that points of some inputs cover: cells of `COVER_CELL` that
    hold points other than noise, closed."""
    corner = np.floor(np.array(block.origin) / COVER_CELL).astype(np.int64) - MARGIN
    count = int(np.ceil(block.side / COVER_CELL)) + 1 + 2 * MARGIN
    grid = np.zeros((count, count), bool)
    for square, files in scans.items():
        later = join_records([points for scan, points in files if first <= scan < end])
        place = scan_cells(later[~np.isin(later["classification"], NOISE_CLASSES)], square) - corner
        place = place[((place >= 0) & (place < count)).all(axis=1)]
        grid[place[:, 0], place[:, 1]] = True
    closed = closed_by_square(grid, MARGIN)
    place = scan_cells(records, block) - corner
    return np.asarray(closed[place[:, 0], place[:, 1]])


def pair_same(old: Records, new: Records) -> tuple[Mask, Mask]:
    """Masks of the old (N,) and of the new points (M,) that agree in all of `SAME`, paired one to one."""
    records = np.concatenate([old, new])
    is_new = np.arange(len(records)) >= len(old)
    x, y, z = records["xyz"].T
    names = records.dtype["fields"].names or () if "fields" in (records.dtype.names or ()) else ()
    fields = (records["fields"][name] for name in names)
    columns = [x, y, z, *(records[name] for name in SAME[3:]), *fields]
    order = np.lexsort((is_new, *columns))
    starts = np.ones(len(records), bool)
    if len(records):
        starts[1:] = np.any([column[order][1:] != column[order][:-1] for column in columns], axis=0)
    group = np.cumsum(starts) - 1
    count = np.bincount(group)
    fresh = np.bincount(group, weights=is_new[order]).astype(np.int64)
    pairs = np.minimum(fresh, count - fresh)[group]
    rank = np.arange(len(records)) - np.flatnonzero(starts)[group]
    rank = np.where(is_new[order], rank - (count - fresh)[group], rank)
    paired = np.zeros(len(records), bool)
    paired[order] = rank < pairs
    return paired[: len(old)], paired[len(old) :]


def scan_cells(records: Records, block: Block) -> NDArray[np.int64]:
    """World cells (N, 2; column, row) of a block's points."""
    world = records["xyz"][:, :2] * GRID_STEP + np.array(block.origin)
    return np.asarray(np.floor(world / COVER_CELL).astype(np.int64))


ENOUGH_PER_M2 = 40.0
"""Points per m² of a surface that decide a building: of a denser scan (overlapping strips, drones, images)
one stands for its neighbours. Twice the density of national surveys, which the methods' numbers are for; from
there on neither time nor memory grow."""
FEW_PER_M2 = 10.0
"""So few points per m² of a whole block cost little, wherever in it they lie."""
SIDE = 0.16
"""Side (m) of the cells, and height of their levels, in which one point stands for the others: of a surface
no more than `ENOUGH_PER_M2` stay. Whole cells fill a block."""
BAND = 4
"""Rows of 1 m cells that are thinned at a time; whole cells of `SIDE` fill them."""
AREA_CELL = 0.5
"""Side (m) of the cells in which is counted how much of a block has points."""


def inputs_of_thinned(
    block: Block, points: Mapping[Block, list[Records]], parameters: object
) -> tuple[Block, list[Records]]:
    """A block with its points, those of each file in canonical order."""
    return block, points[block]


def find_thinned(view: tuple[Block, Sequence[Records]], parameters: object) -> dict[str, NDArray[Any]]:
    """The points that stand for all of a block, in canonical order, as bytes; of all its points, file by
    file, the number (N,) of the one that stands for each; how many are copies of others, with the ids of one
    and of its copy. Nothing where they are not dense, and none is a copy.

    Cells, fixed to the world, hold the points of all files: how these cut the area changes nothing. Memory
    follows the rows in work and what is kept.
    """
    block, files = view
    cells = np.zeros((int(np.ceil(block.side / AREA_CELL)),) * 2, np.bool_)
    for records in files:
        cover_kernel(records["xyz"], round(AREA_CELL / GRID_STEP), cells)
    places = np.empty(sum(map(len, files)), np.uint32)
    kept = list[Records]()
    starts = np.cumsum([0, *map(len, files)])[:-1]
    bands = int(np.ceil(block.side / BAND))
    limits = [bands_kernel(records["xyz"], BAND * PER_METRE, bands) for records in files]
    filled = np.flatnonzero(np.diff(np.reshape(limits, (len(files), -1)).sum(axis=0))).tolist()

    def records_in(band: int) -> Records:
        return join_records(
            [file[slice(*rows[band : band + 2])] for file, rows in zip(files, limits, strict=True)]
        )

    def places_in(band: int) -> NDArray[np.int64]:
        return np.concatenate(
            [first + np.arange(*rows[band : band + 2]) for first, rows in zip(starts, limits, strict=True)]
        )

    copies = list[tuple[NDArray[np.int64], NDArray[np.int64]]]()
    example = np.zeros(0, np.int64)
    for band in filled:
        records = records_in(band)
        order = (
            canonical_order(records["xyz"] * GRID_STEP, records["return_number"])
            if len(files) > 1
            else np.arange(len(records))  # those of one file are in canonical order
        )
        places[places_in(band)] = order
        again, original = copies_in(records, order)
        if len(again) and not len(example):
            example = records["point_id"][[original[0], again[0]]]
        copies.append((again, original))
    copied = sum(len(again) for again, _ in copies)
    distinct = len(places) - copied
    dense = distinct > max(ENOUGH_PER_M2 * AREA_CELL**2 * cells.sum(), FEW_PER_M2 * block.side**2)
    if not dense and not copied:
        return {}
    for band, (again, original) in zip(filled, copies, strict=True):
        records = records_in(band)
        here = places_in(band)
        chosen, stands = thin(records, places[here].astype(np.int64), again, original, dense)
        places[here] = stands + sum(map(len, kept))
        kept.append(chosen)
    return {
        "records": join_records(kept).view(np.uint8),
        "stands": places,
        "copies": np.array([copied, *example], np.int64),
    }


def thin(
    records: Records,
    order: NDArray[np.int64],
    again: NDArray[np.int64],
    original: NDArray[np.int64],
    dense: bool,
) -> tuple[Records, NDArray[np.int64]]:
    """Those of some points (N,) that stand for all, in canonical order, and the number (N,) of the one that
    stands for each: `original` (K,) for its copies `again`, and for its neighbours where they are `dense`.
    The canonical `order` is that of all."""
    stands = np.arange(len(records))
    stands[again] = original
    if dense:
        quanta = np.ascontiguousarray(records["xyz"])
        own = np.flatnonzero(stands == np.arange(len(stands)))
        rank = np.searchsorted(own, stands)
        stands = own[thin_kernel(quanta[own], records["return_number"][own], round(SIDE / GRID_STEP))][rank]
    chosen = order[(stands == np.arange(len(stands)))[order]]
    place = np.empty(len(stands), np.int64)
    place[chosen] = np.arange(len(chosen))
    return records.take(chosen), place[stands]


def copies_in(records: Records, order: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The numbers (K,) of those of some points (N,) that are copies, and of what each is a copy of: of
    identical ones (`IDENTITY`) the one with the largest class, for a copy may be classified, then the least
    id. The canonical `order` (N,) is that of all."""
    tied = tied_kernel(records["xyz"], order)
    rows = order[np.union1d(tied, tied + 1)]
    columns = [*records["xyz"][rows].T, *(records[name][rows] for name in IDENTITY)]
    by = np.lexsort((records["point_id"][rows], -records["classification"][rows].astype(int), *columns))
    starts = np.ones(len(rows), bool)
    starts[1:] = np.any([column[by][1:] != column[by][:-1] for column in columns], axis=0)
    first = np.maximum.accumulate(np.where(starts, np.arange(len(rows)), 0))
    again = np.sort(rows[by][~starts])
    originals = np.empty(len(records), np.int64)
    originals[rows[by]] = rows[by][first]
    return again, originals[again]


@kernel
def cover_kernel(quanta: NDArray[np.int32], side: int, cells: NDArray[np.bool_]) -> None:
    """Mark the cells of a side (quanta) that hold any of the points (N, 3) of a block."""
    for i in range(len(quanta)):
        cells[quanta[i, 1] // side, quanta[i, 0] // side] = True


@kernel
def bands_kernel(quanta: NDArray[np.int32], height: int, count: int) -> NDArray[np.int64]:
    """Where each of `count` bands of a height (quanta) begins among points (N, 3) in canonical order, and
    where the last one ends, (count + 1,)."""
    starts = np.empty(count + 1, np.int64)
    for band in range(count + 1):
        starts[band] = first_kernel(quanta, 1, band * height, 0, len(quanta))
    return starts


Heights = Mapping[tuple[int, int], NDArray[np.float64]]
"""Pair of inputs, by number → differences (N,) of the heights of the second and the first (m)."""

CELLS = 1.5, 3.0, 6.0
"""Sides (m) of the cells in which each input has a plane; those that allow more comparisons are taken. Whole
cells fill a block."""
REACH = 6.0
"""Distance (m) from the area that two inputs share of the points that are compared."""
LOW = 0.5
"""The ground of a cell is among the points that lie so little (m) over its lowest: no crown, no car."""
FEWEST_POINTS, ROUGH, STEEP, NARROW = 6, 0.1, 1.0, 0.005
"""A plane takes so many points, which lie within so much (m) of it (root mean square); it rises by less than
this, and the variance of the points is over this share of the cell's area in every direction."""
ENOUGH_POINTS, ENOUGH_PLACES = 60_000, 200
"""Of so many points of an input in a block, and of so many places there, those evenly spread are taken."""
PLACES, STEP, AGREE = 12, 0.2, 75.0
"""A step takes so many places and metres, and in so many of a hundred places it is met within its half: walls
that stand along a part of a seam are none."""


@dataclass(frozen=True, eq=False)
class Planes:
    """Planes of an input, a cell each: column and row (N, 2), rising; centre (N, 3), slopes (N, 2)."""

    cell: NDArray[np.int64]
    centre: Points
    slope: NDArray[np.float64]


def shared_places(boxes: NDArray[np.float64], block: Block) -> Bounds | None:
    """Bounds within a block and its rim where boxes (N, 4) of inputs overlap or adjoin; None for nowhere."""
    window = np.array(list(block.bounds.buffered(REACH)))
    low, high = np.maximum(boxes[:, :2], window[:2]), np.minimum(boxes[:, 2:], window[2:])
    found = None
    for a, b in combinations(np.flatnonzero((low < high).all(axis=1)), 2):
        corner, end = np.maximum(low[a], low[b]) - REACH, np.minimum(high[a], high[b]) + REACH
        if (end - corner > REACH).all():
            corner, end = np.maximum(corner, window[:2]), np.minimum(end, window[2:])
            place = Bounds(*map(float, (*corner, *end)))
            found = place if found is None else found.union(place)
    return found


def compare_heights(block: Block, points: Mapping[int, Sequence[Points]]) -> Heights:
    """The differences of the heights of inputs in a block.

    Each input has a plane in every cell where its lowest points are flat. Two planes in one cell, or in cells
    side by side, are compared half-way between their centres: slopes are no steps, and what is rough is left
    out.

    Parameters
    ----------
    block : Block
        The block; a pair of cells counts where the first of them lies in it.
    points : mapping
        Number of an input to its points (N, 3) about the block's corner (m), in pieces.
    """
    clouds = {number: np.concatenate(points[number]) for number in sorted(points)}
    found: dict[tuple[int, int], NDArray[np.float64]] = {}
    for cell in CELLS:
        planes = {number: planes_of(xyz, cell) for number, xyz in clouds.items()}
        for a, b in combinations(planes, 2):
            values = differences(planes[a], planes[b], round(block.side / cell))
            if len(values) > len(found.get((a, b), ())):
                found[a, b] = values
    return {pair: values[:: -(-len(values) // ENOUGH_PLACES)] for pair, values in found.items()}


def planes_of(xyz: Points, side: float) -> Planes:
    """The planes of the lowest of points (N, 3) in the cells of a side (m) where these are flat."""
    xyz = xyz[:: max(len(xyz) // ENOUGH_POINTS, 1)]
    place = np.floor(xyz[:, :2] / side).astype(np.int64)
    of, count = number_squares(xyz[:, :2], side)
    cell, lowest = np.empty((len(count), 2), np.int64), np.full(len(count), np.inf)
    cell[of] = place
    np.minimum.at(lowest, of, xyz[:, 2])
    low = xyz[:, 2] < lowest[of] + LOW
    xyz, of = xyz[low], of[low]
    many = np.bincount(of, minlength=len(cell))
    centre = np.column_stack([np.bincount(of, values, len(cell)) / many for values in xyz.T])
    x, y, z = (xyz - centre[of]).T
    xx, xy, yy, xz, yz, zz = (
        np.bincount(of, a * b, len(cell)) / many for a, b in ((x, x), (x, y), (y, y), (x, z), (y, z), (z, z))
    )
    least = (xx + yy) / 2 - np.hypot((xx - yy) / 2, xy)
    wide = (many >= FEWEST_POINTS) & (least > NARROW * side**2)
    area = np.where(wide, xx * yy - xy**2, 1.0)
    slope = np.column_stack([yy * xz - xy * yz, xx * yz - xy * xz]) / area[:, None]
    rest = (zz - slope[:, 0] * xz - slope[:, 1] * yz) * many / np.maximum(many - 3, 1)
    flat = wide & (rest < ROUGH**2) & (np.abs(slope).max(axis=1, initial=0.0) < STEEP)
    return Planes(cell[flat], centre[flat], slope[flat])


def differences(first: Planes, second: Planes, count: int) -> NDArray[np.float64]:
    """By how much (N,) planes of the second input lie over those of the first in the same cells of a block of
    `count` cells a side, and in those side by side."""
    pieces = [rises(first, second, right, up, count) for right, up in ((0, 0), (1, 0), (0, 1))]
    pieces += [-rises(second, first, right, up, count) for right, up in ((1, 0), (0, 1))]
    return np.concatenate(pieces)


def rises(first: Planes, second: Planes, right: int, up: int, count: int) -> NDArray[np.float64]:
    """By how much (N,) the second planes lie over the first ones that are `right` and `up` cells to the west
    and south."""
    inside = np.flatnonzero(((first.cell >= 0) & (first.cell < count)).all(axis=1))
    width = count + round(4 * REACH / min(CELLS))  # with the rim
    key = (first.cell[inside] + (right, up)) @ (width, 1)
    _, i, j = np.intersect1d(key, second.cell @ (width, 1), assume_unique=True, return_indices=True)
    i = inside[i]
    half = (second.centre[j, :2] - first.centre[i, :2]) / 2
    rise = ((first.slope[i] + second.slope[j]) * half).sum(axis=1)
    between: NDArray[np.float64] = second.centre[j, 2] - first.centre[i, 2] - rise
    return between


def find_steps(heights: Sequence[Heights]) -> list[tuple[float, int, int, int]]:
    """The steps between inputs, of the differences in some blocks, the highest first: metres, both inputs,
    and the number of places."""
    found = []
    for a, b in sorted({pair for block in heights for pair in block}):
        values = np.concatenate([block[a, b] for block in heights if (a, b) in block])
        step = float(np.median(values))
        off = float(np.percentile(np.abs(values - step), AGREE))
        if len(values) >= PLACES and abs(step) > max(STEP, 2 * off):
            found.append((step, a, b, len(values)))
    return sorted(found, key=lambda entry: -abs(entry[0]))
