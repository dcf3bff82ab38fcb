"""Reading once: every point of every file goes to the block it lies in."""

from __future__ import annotations

import os
import uuid
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, Protocol
from zlib import crc32

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from eaves.formats import Chunk, InputError, Source, iter_chunks
from eaves.formats.inputs import refuse_change
from eaves.kernels import kernel
from eaves.model import GRID_STEP, Block, Bounds, Points
from eaves.model.cloud import canonical_order
from eaves.run.index import Index, open_unchanged
from eaves.run.keys import UNKEYED, key_of
from eaves.run.store import Store
from eaves.run.world_squares import ring

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
            if has_repeated_kernel(records["xyz"], *(records[name] for name in IDENTITY)):
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
def has_repeated_kernel(
    quanta: NDArray[np.int32],
    number: NDArray[np.uint8],
    count: NDArray[np.uint8],
    moment: NDArray[np.uint16],
) -> bool:
    """True if two of the points (N, 3), in canonical order, that follow on each other are identical."""
    for i in range(1, len(quanta)):
        if (
            quanta[i, 0] == quanta[i - 1, 0]
            and quanta[i, 1] == quanta[i - 1, 1]
            and quanta[i, 2] == quanta[i - 1, 2]
            and number[i] == number[i - 1]
            and count[i] == count[i - 1]
            and moment[i] == moment[i - 1]
        ):
            return True
    return False


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
