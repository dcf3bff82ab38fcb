"""The points of a block with its surroundings, from the store, in canonical order."""

from __future__ import annotations

import os
import uuid
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, BinaryIO, Protocol
from zlib import crc32

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from eaves.formats import Chunk, InputError, Source, iter_chunks
from eaves.formats.inputs import refuse_change
from eaves.kernels import inlined_kernel, kernel
from eaves.model import GRID_STEP, Block, Bounds, PointCloud, Points
from eaves.model.block import ring, squares_touching
from eaves.model.cloud import PER_METRE, canonical_order
from eaves.run.index import Index, open_unchanged
from eaves.run.keys import UNKEYED, key_of
from eaves.run.store import RECORD, Store, join_records, map_records

PART_POINTS = 4_000_000
"""Records of each part in which a longer file is read by several processes, about."""
BOX_TOLERANCE = 1.0
"""Distance (m) of points outside the box of their header from which it is wrong; writers round boxes, but
not by metres."""


@dataclass(frozen=True)
class FileSlice:
    """The k-th of n runs of an input's records."""

    number: int
    first: int
    """The id of the input's first point."""
    crs: str | None
    to_crs: str
    k: int
    n: int
    mark: bytes
    """Fingerprint of the file when the run began."""
    path: Path = field(metadata=UNKEYED)
    count: int = field(metadata=UNKEYED)
    box: Bounds = field(metadata=UNKEYED)
    """Bounding box of the points by the header, world metres."""
    source: Source | None = field(metadata=UNKEYED, compare=False)
    """Given where opening it again would read its points."""

    @property
    def name(self) -> str:
        return f"{self.number:07d}-{self.k:04d}"

    @property
    def label(self) -> str:
        """What it is of, for messages."""
        return str(self.path)

    def opened(self) -> Source:
        """The input, as the index knows it."""
        return self.source or open_unchanged(self.path, self.crs, self.count, self.to_crs)


def number_of(name: str) -> int:
    """The number of the input that a part is of, by the part's name."""
    return int(name.partition("-")[0])


@dataclass(frozen=True)
class PartFacts:
    """What is known of a part of an input whose points are in their blocks.

    Parameters
    ----------
    records : int
        Read of it.
    unread : str or None
        Why not all were.
    blocks : mapping
        Bytes and checksum of its file in each block, by the block's name.
    repeated : sequence of str
        Names of the blocks in which points of it are identical.
    extent : Bounds or None
        Of its points (world metres), where they lie outside the box of the header.
    """

    records: int
    unread: str | None
    blocks: Mapping[str, Sequence[int]]
    repeated: Sequence[str]
    extent: Bounds | None


@dataclass(frozen=True)
class Window:
    """Selection of the points a run uses, world metres: in the bounds and the clip area, where given."""

    bounds: Bounds | None = None
    clip: BaseGeometry | None = None

    def holds(self, xyz: Points) -> NDArray[np.bool_]:
        """Mask (N,) of the points (N, 3) that are used; they have coordinates (`iter_chunks`)."""
        usable = np.ones(len(xyz), bool)
        if self.bounds is not None:
            usable &= self.bounds.contains(xyz)
        if self.clip is not None:
            usable &= shapely.contains_xy(self.clip, xyz[:, 0], xyz[:, 1])
        return np.asarray(usable)


def file_slices(index: Index, numbers: Iterable[int] | None = None) -> list[FileSlice]:
    """All parts of the inputs of some numbers, or of all, in order."""
    starts = index.starts
    parts = []
    for number in range(len(index)) if numbers is None else map(int, numbers):
        count, source = int(index.entries["count"][number]), index.kept.get(number)
        n = 1 if source is not None and source.kind == "text" else max(1, -(-count // PART_POINTS))
        file = (number, int(starts[number]), index.crs, index.to_crs)
        mark, path, box = index.mark(number), index.path(number), index.bounds(number)
        parts += [FileSlice(*file, k, n, mark, path, count, box, source) for k in range(n)]
    return parts


def keys_of_points(parts: Mapping[str, PartFacts]) -> dict[str, str]:
    """The key of the points of each block, by its name, of the parts by their names."""
    files: dict[str, list[Any]] = {}
    for name in sorted(parts):
        for block, file in parts[name].blocks.items():
            files.setdefault(block, []).append([name, file])
    return {block: key_of(entries) for block, entries in files.items()}


class Reading(Protocol):
    """What decides which points are read, and into which blocks."""

    @property
    def side(self) -> float:
        """Of blocks (m)."""

    @property
    def window(self) -> Window:
        """The points that are used."""

    @property
    def fields(self) -> Sequence[str]:
        """The fields of points that are read beside coordinates, returns and classes."""


def inputs_of_points(part: FileSlice, parameters: object) -> FileSlice:
    """A part of an input, from which its points follow."""
    return part


def read_slice(part: FileSlice, writer: SliceWriter, parameters: Reading) -> PartFacts:
    """Write every usable point of a part to its block; what is known of it.

    The records of a compressed file are kept whole as well where the writer has room for them: the classified
    points are written from them, for to decompress them again costs many times as much.

    Withheld points and points without a position stay out. Of a damaged input the points before the damage
    are used; a resumed run tries it again.
    """
    window, read, extent, unread = parameters.window, 0, None, None
    try:
        try:
            source = part.opened()
            # all points but a COPC file's are decompressed anyway: those outside tell whether the header lies
            bounds = window.bounds if source.kind == "copc" else None
            copy = writer.copy() if source.kind in ("laz", "copc") and bounds is None else None
            share = part.k, part.n
            for chunk in iter_chunks(source, bounds, part=share, copy=copy, fields=parameters.fields):
                box = Bounds.of(chunk.xyz)
                extent = box if extent is None else extent.union(box)
                partition_chunk(chunk, part.first, parameters.side, window, writer)
                read += len(chunk)
            refuse_change(part.path, part.mark)
        except InputError as error:
            unread = str(error)
        written = writer.finish(unread is None)
    except BaseException:
        writer.discard()
        raise
    inside = part.box.buffered(BOX_TOLERANCE)
    lies = extent is not None and inside.union(extent) != inside
    return PartFacts(read, unread, written, tuple(writer.repeated), extent if lies else None)


def partition_chunk(chunk: Chunk, first: int, side: float, window: Window, writer: SliceWriter) -> None:
    """Hand a chunk's usable points to the writer, block by block; `first` is the id its file begins with."""
    usable = window.holds(chunk.xyz)
    if not usable.any():
        return
    inside = chunk if usable.all() else chunk.take(usable)
    records = np.zeros(len(inside), writer.record)
    # the block follows from the rounded place: it counts from the block's corner and lies short of its end
    east, north, height = (np.rint(column / GRID_STEP) for column in inside.xyz.T)
    steps = round(side / GRID_STEP)
    column, row = np.floor(east / steps).astype(np.int64), np.floor(north / steps).astype(np.int64)
    places = (east - column * steps, north - row * steps, height)
    for axis, place in enumerate(places):
        records["xyz"][:, axis] = place
    records["point_id"] = inside.position + first
    defaults = {"return_number": 1, "number_of_returns": 1, "classification": 0, "moment": 0}
    for name, missing in defaults.items():
        values = getattr(inside, name)
        records[name] = missing if values is None else values
    for name, values in inside.fields.items():
        records["fields"][name] = values
    place = (column - column.min()) * (int(np.ptp(row)) + 1) + row - row.min()
    if int(place.max()) < 2**16:  # so few blocks: sixteen bits sort by radix, twenty times as fast
        place = place.astype(np.uint16)
    order = np.argsort(place, kind="stable")
    for group in np.split(order, np.flatnonzero(np.diff(place[order])) + 1):
        block = Block(int(column[group[0]]), int(row[group[0]]), side)
        writer.append(block, records.take(group))


class SliceWriter:
    """The files of one part: hidden until all of it is written, so that neither a killed process nor two that
    do the same work leave a point twice."""

    def __init__(self, store: Store, part: FileSlice) -> None:
        self._store, self._name = store, part.name
        self._hidden = f".{part.name}-{uuid.uuid4().hex}"
        self._blocks: set[str] = set()
        self._copy: BinaryIO | None = None
        self.repeated: list[str] = []
        """Names of the blocks in which points are identical."""

    @property
    def record(self) -> np.dtype[np.void]:
        """The layout of a point."""
        return self._store.record

    def copy(self) -> BinaryIO | None:
        """The file of the part's records as they are; None where they are not kept."""
        if not self._store.copies:
            return None
        path = self._store.records_path(self._hidden)
        path.parent.mkdir(exist_ok=True)
        self._copy = path.open("wb")
        return self._copy

    def append(self, block: Block, records: NDArray[Any]) -> None:
        """Add records to a block's points."""
        folder = self._store.points_path(block)
        if block.name not in self._blocks:
            folder.mkdir(exist_ok=True)
            self._blocks.add(block.name)
        with (folder / self._hidden).open("ab") as file:
            file.write(records.data)

    def finish(self, complete: bool) -> dict[str, tuple[int, int]]:
        """Put the points of each block in canonical order, once for all that reads them, and show the files,
        the copy of the records when it is `complete`. Bytes and checksum of each block's file."""
        if self._copy is not None:
            self._copy.close()
            if complete:
                os.replace(self._copy.name, self._store.records_path(self._name))
            else:
                os.unlink(self._copy.name)
            self._copy = None
        written = {}
        for block in sorted(self._blocks):
            path = self._store.folder / "points" / block / self._hidden
            records = np.fromfile(path, self.record)
            order = canonical_order(records["xyz"] * GRID_STEP, records["return_number"])
            records = records.take(order)
            tied = tied_kernel(records["xyz"], np.arange(len(records)))
            if np.all([records[name][tied] == records[name][tied + 1] for name in IDENTITY], axis=0).any():
                self.repeated.append(block)
            data = records.view(np.uint8).data
            with path.open("rb+") as file:
                file.write(data)
            written[block] = len(data), crc32(data)
            # not forced to the disk: who goes on from it checks its size and checksum
            os.replace(path, path.with_name(f"{self._name}.bin"))
        return written

    def discard(self) -> None:
        """Remove the files."""
        if self._copy is not None:
            self._copy.close()
            os.unlink(self._copy.name)
        for block in self._blocks:
            (self._store.folder / "points" / block / self._hidden).unlink(missing_ok=True)


IDENTITY = ("return_number", "number_of_returns", "moment")
"""Points at one place (to the tenth of a millimetre) that agree in these are the same point, delivered again:
two returns of a pulse have other numbers, two pulses have other times. Files without times state none."""


@kernel
def tied_kernel(quanta: NDArray[np.int32], order: NDArray[np.int64]) -> NDArray[np.int64]:
    """The places (K,) in an order of points (N, 3) at which one lies where the next one does."""
    places, count = np.empty(len(order), np.int64), 0
    for k in range(len(order) - 1):
        i, j = order[k], order[k + 1]
        if quanta[i, 0] == quanta[j, 0] and quanta[i, 1] == quanta[j, 1] and quanta[i, 2] == quanta[j, 2]:
            places[count] = k
            count += 1
    return places[:count]


TOO_FEW = 10
"""So few points in a block and its eight neighbours hold no terrain."""
FEW = 100
"""So few are looked at: they are no survey when they are sparser than `SPARSEST`."""
SPARSEST = 0.01
"""Points a square metre, a fifteenth of the sparsest survey that is worth a terrain."""


def find_isolated_blocks(store: Store, blocks: Sequence[Block]) -> dict[Block, int]:
    """The blocks not worth a computation, with how many points they hold.

    A damaged file strews its points over a continent: a block each would cost days, a raster over all of them
    more than there is. The answer depends on the points of a block and its neighbours only.
    """
    counts = {block: store.count_points(block) for block in blocks}
    isolated = {}
    for block in blocks:
        neighbours = ring(block)
        count = sum(counts.get(neighbour, 0) for neighbour in neighbours)
        if count < TOO_FEW or (count < FEW and density(store, neighbours) < SPARSEST):
            isolated[block] = counts[block]
    return isolated


def density(store: Store, blocks: Sequence[Block]) -> float:
    """Points per square metre of the rectangle around the points of some blocks."""
    xy = np.concatenate(
        [store.read_points(block)["xyz"][:, :2] * GRID_STEP + np.array(block.origin) for block in blocks]
    )
    area = float(np.prod(np.ptp(xy, axis=0)))
    return len(xy) / max(area, 1.0)


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


def load_window(
    store: Store, block: Block, reach: float, ids: bool = True, names: Sequence[str] = ()
) -> PointWindow:
    """The points of a block and of its surroundings up to `reach` (m), with `ids` their own, and with those
    of the other fields in the store that are named."""
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
    others = {name: np.empty(total) for name in names}
    for square, records, which, first in pieces:
        right, up = (round(way / GRID_STEP) for way in np.subtract(square.origin, block.origin))
        ordered &= right % PER_METRE == 0 == up % PER_METRE
        low = south - round(square.origin[1] / GRID_STEP)
        place = deal_kernel(records["xyz"], which, low, free, right, up, GRID_STEP, first, xyz, number)
        for name, values in arrays.items():
            put_kernel(records[name], which, place, values)
        for name, values in others.items():
            put_kernel(records["fields"][name], which, place, values)
    cloud = PointCloud(xyz, block.origin, **arrays, fields=others, system=store.system, ordered=ordered)
    if not ordered:
        order = cloud.canonical_order()
        cloud, number = replace(cloud.take(order), ordered=True), number.take(order)
    return PointWindow(block, cloud, number, ranges, ends)


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
    first: int,
    xyz: Points,
    number: NDArray[np.int64],
) -> NDArray[np.int64]:
    """Deal points (K of N, 3) out to the places that are `free` in their rows of cells, counted from `south`:
    their coordinates, moved by whole quanta, in metres into `xyz`, what they are counted from `first` into
    `number`, and the places (K,)."""
    place = np.empty(len(which), np.int64)
    for k in range(len(which)):
        i = which[k]
        row = quanta[i, 1] // PER_METRE - south // PER_METRE
        place[k] = free[row]
        free[row] += 1
        xyz[place[k], 0] = (quanta[i, 0] + right) * quantum
        xyz[place[k], 1] = (quanta[i, 1] + up) * quantum
        xyz[place[k], 2] = quanta[i, 2] * quantum
        number[place[k]] = first + i
    return place


@kernel
def put_kernel(
    values: NDArray[Any], which: NDArray[np.int64], place: NDArray[np.int64], column: NDArray[Any]
) -> None:
    """Write what some points (K of N) have of a column of records to their places (K,) in another one."""
    for k in range(len(which)):
        column[place[k]] = values[which[k]]
