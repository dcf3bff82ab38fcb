"""Reading once: every point of every file goes to the block it lies in."""

from __future__ import annotations

import logging
import os
import uuid
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO
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
from eaves.run.keys import PARTS, READING, code_digest, key_of
from eaves.run.part_file import as_arrays, load_part
from eaves.run.store import Store
from eaves.run.world_squares import ring

log = logging.getLogger("eaves")

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
    path: Path
    crs: str | None
    to_crs: str
    count: int
    box: Bounds
    """Bounding box of the points by the header, world metres."""
    k: int
    n: int
    mark: bytes
    """Fingerprint of the file when the run began."""
    source: Source | None
    """Given where opening it again would read its points."""

    @property
    def name(self) -> str:
        return f"{self.number:07d}-{self.k:04d}"

    def opened(self) -> Source:
        """The input, as the index knows it."""
        return self.source or open_unchanged(self.path, self.crs, self.count, self.to_crs)


@dataclass(frozen=True)
class PartFacts:
    """What is known of a part that is in place."""

    records: int
    """Read of it."""
    unread: str | None
    """Why not all were."""
    blocks: Mapping[str, Sequence[int]]
    """Bytes and checksum of its file in each block, by the block's name."""
    repeated: Sequence[str] = ()
    """Names of the blocks in which points of it are identical."""


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
        file = (number, int(starts[number]), index.path(number), index.crs, index.to_crs)
        shared = (*file, count, index.bounds(number))
        parts += [FileSlice(*shared, k, n, index.mark(number), source) for k in range(n)]
    return parts


def key_of_part(part: FileSlice, store: Store, side: float, window: Window) -> str:
    """The key of all that the points of a part follow from."""
    code = code_digest(READING)
    place = (part.mark, part.first, part.k, part.n, part.crs, part.to_crs, side, window)
    return key_of(code, store.system, *place, *store.fields)


def known_parts(store: Store, index: Index, side: float, window: Window) -> dict[str, PartFacts]:
    """The facts of the parts of inputs that were read, by name, and whose points are as they were left; what
    else lies in the folders of points is removed."""
    numbers = {path.stem.split("-")[0] for path in (store.folder / PARTS).glob("*-*.part")}
    places = sorted(int(number) for number in numbers if number.isdigit())
    parts = file_slices(index, [number for number in places if number < len(index)])
    keys = ((part, key_of_part(part, store, side, window)) for part in parts)
    known = {part.name: facts for part, key in keys if (facts := known_part(store, part, key)) is not None}
    for path in (store.folder / "points").glob("*/*.bin"):
        if path.stem not in known:
            path.unlink()
    for folder in (store.folder / "points").iterdir():
        if not any(folder.iterdir()):
            folder.rmdir()
    store.evict_others(PARTS, [part for part in parts if part.name in known])
    return known


def known_part(store: Store, part: FileSlice, key: str) -> PartFacts | None:
    """The facts of a part; None where there are none of the key, or points of it were changed."""
    mark = store.mark(PARTS, part)
    if mark is None or mark.read != key:
        return None
    facts: PartFacts = load_part(store.path(PARTS, part))
    for block, (size, checksum) in facts.blocks.items():
        place = store.folder / "points" / block / f"{part.name}.bin"
        if place.exists() and (place.stat().st_size != size or crc32(place.read_bytes()) != checksum):
            log.warning("%s: the part is damaged; its points are read again", place)
            return None
    return facts


def keys_of_points(parts: Mapping[str, PartFacts]) -> dict[str, str]:
    """The key of the points of each block, by its name, of the parts by their names."""
    files: dict[str, list[Any]] = {}
    for name in sorted(parts):
        for block, file in parts[name].blocks.items():
            files.setdefault(block, []).append([name, file])
    return {block: key_of(entries) for block, entries in files.items()}


def partition_slice(
    task: tuple[FileSlice, str],
    store: Store,
    side: float,
    window: Window,
    copied: bool = False,
    progress: Callable[[int], None] = lambda points: None,
) -> tuple[PartFacts, Bounds | None]:
    """Write every usable point of a part to its block's folder; its facts, with their mark, come last.

    The `task` is a part with its key (`key_of_part`), which the mark bears. Where they are `copied`, the
    records of a compressed file are kept whole as well: the classified points are written from them, for to
    decompress them again costs many times as much.

    Withheld points and points without a position stay out. `progress` is called with the number of points
    read. Of a damaged input the points before the damage are used; a resumed run tries it again.
    """
    part, key = task
    writer = SliceWriter(store, part.name)
    read, extent, unread = 0, None, None
    try:
        try:
            source = part.opened()
            # all points but a COPC file's are decompressed anyway: those outside tell whether the header lies
            bounds = window.bounds if source.kind == "copc" else None
            copy = writer.copy() if copied and source.kind in ("laz", "copc") and bounds is None else None
            share = part.k, part.n
            for chunk in iter_chunks(source, bounds, part=share, copy=copy, fields=store.fields):
                box = Bounds.of(chunk.xyz)
                extent = box if extent is None else extent.union(box)
                partition_chunk(chunk, part.first, side, window, writer)
                read += len(chunk)
                progress(len(chunk))
            refuse_change(part.path, part.mark)
        except InputError as error:
            unread = str(error)
        written = writer.finish(unread is None)
    except BaseException:
        writer.discard()
        raise
    inside = part.box.buffered(BOX_TOLERANCE)
    lies = extent is not None and inside.union(extent) != inside
    facts = PartFacts(read, unread, written, writer.repeated)
    store.save(PARTS, part, as_arrays(facts), key)
    return facts, extent if lies else None


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

    def __init__(self, store: Store, name: str) -> None:
        self._store, self._name = store, name
        self._hidden = f".{name}-{uuid.uuid4().hex}"
        self._blocks: set[str] = set()
        self._copy: BinaryIO | None = None
        self.repeated: list[str] = []
        """Names of the blocks in which points are identical."""

    @property
    def record(self) -> np.dtype[np.void]:
        """The layout of a point."""
        return self._store.record

    def copy(self) -> BinaryIO:
        """The file of the part's records as they are."""
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
            tied = tied_kernel(records["xyz"], np.arange(len(order))) if len(order) > 1 else order[:0]
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
