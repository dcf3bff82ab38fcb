"""The results of a run's steps, each by its unit and with its key: computed once, and found from then on."""

from __future__ import annotations

import json
import logging
import os
import shutil
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eaves.formats import InputError
from eaves.formats.atomic import atomic
from eaves.kernels import inlined_kernel, kernel
from eaves.model import Block, Bounds, CoordinateSystem, PointCloud, Points
from eaves.model.block import extremes
from eaves.model.cloud import GRID_STEP, PER_METRE
from eaves.run.keys import GONE, GROUND, STEPS, Mark, Step, key_of
from eaves.run.part_file import is_whole_part, open_part, save_part
from eaves.run.world_squares import GROUND_SQUARE, squares_of, squares_touching

log = logging.getLogger("eaves")

REQUEST = "request.json"
"""Beside the results that are kept: what the run was asked for."""
FORM = 5
"""Version of the form in which all lies in the folder; another one is refused."""
RECORD = np.dtype(
    [
        ("xyz", "<i4", 3),
        ("point_id", "<i8"),
        ("return_number", "u1"),
        ("number_of_returns", "u1"),
        ("classification", "u1"),
    ]
)
"""A point between reading and the block pass: coordinates in quanta about its block's corner."""
SECONDS = "seconds"
"""The array of a result that says what it cost: no part of what was found."""


@dataclass(frozen=True)
class Task:
    """A unit of a step (a block or a square, a plan of buildings) with the key of the files it reads."""

    unit: Any
    read: str


@dataclass(frozen=True, eq=False)
class Places:
    """Where the points (N,) of a cloud are kept: their numbers among all points of some blocks, which are
    counted on from block to block, and in a block file by file."""

    range_of: Mapping[Block, tuple[int, int]]
    """Block → the first number in it, and the one behind its last."""
    number: NDArray[np.int64]

    def count(self, block: Block) -> int:
        """How many points a block has."""
        start, end = self.range_of[block]
        return end - start

    def within(self, block: Block) -> NDArray[np.int32]:
        """The numbers (K,) in a block of those of the cloud's points that lie in it, in their order."""
        start, end = self.range_of[block]
        own = self.number[(self.number >= start) & (self.number < end)]
        return (own - start).astype(np.int32)

    def of(self, block: Block, among: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
        """Which of some points (by their places in the cloud) lie in a block, and their numbers in it, which
        rise."""
        start, end = self.range_of[block]
        number = self.number[among]
        own = np.flatnonzero((number >= start) & (number < end))
        own = own[np.argsort(number[own], kind="stable")]
        return own, (number[own] - start).astype(np.int32)


@dataclass(frozen=True)
class Store:
    """A folder with `points/` (a folder a block, a file in it a part of an input), `parts/` (a file for every
    part of an input that is in place), a folder for each of `STEPS` (a file a unit, and beside it its mark);
    while a small run lasts also `records/` (a file a part of a compressed input: its records as they are)."""

    folder: Path
    has_returns: bool = True
    has_classes: bool = True
    system: CoordinateSystem = CoordinateSystem()  # noqa: RUF009 (frozen)
    outlasts: bool = False
    """Whether a later run may find the results; only then it is worth knowing what they follow from."""

    def key_of(self, *taken: Any) -> str:
        """The key of what a step takes from the files it reads; empty in a store that does not outlast its
        run, which finds its results by these files alone."""
        return key_of(*taken) if self.outlasts else ""

    def prepare(self, remedy: str = "run without --resume") -> None:
        """Make the folders, where nothing of another form lies in them.

        Raises
        ------
        InputError
            Where something does.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        form = self.folder / "form"
        if any(self.folder.iterdir()) and (not form.exists() or form.read_text() != str(FORM)):
            raise InputError.about(self.folder, "holds parts that another version of eaves wrote", remedy)
        if not form.exists():
            form.write_text(str(FORM))
        for name in ("points", "parts", *(step.name for step in STEPS)):
            (self.folder / name).mkdir(exist_ok=True)

    def write_request(self, stated: Mapping[str, Any]) -> None:
        """Write what the run was asked for: its results can be gone on from."""
        with atomic(self.folder / REQUEST) as temporary:
            temporary.write_text(json.dumps(stated), encoding="utf-8")

    def discard(self) -> None:
        """Remove the folder with everything in it."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def points_path(self, block: Block) -> Path:
        """The folder of a block's points."""
        return self.folder / "points" / block.name

    def records_path(self, name: str) -> Path:
        """The file of the records of a part of an input."""
        return self.folder / "records" / f"{name}.bin"

    def drop_records(self) -> None:
        """Remove the records of the inputs, which only the run that read them can use."""
        shutil.rmtree(self.folder / "records", ignore_errors=True)

    def blocks(self, side: float) -> list[Block]:
        """The blocks that have points, in order."""
        names = [entry.split("_") for entry in os.listdir(self.folder / "points")]
        blocks = sorted(Block(int(column), int(row), side) for column, row in names)
        return [block for block in blocks if not self.has(GONE, block) or self.count_points(block)]

    def count_points(self, block: Block) -> int:
        """How many points a block holds."""
        files = self.points_path(block).glob("*.bin")
        return sum(file.stat().st_size for file in files) // RECORD.itemsize - len(self.gone(block))

    def gone(self, block: Block) -> NDArray[np.int64]:
        """Ids (K,) of the points of a block that later ones have taken the place of."""
        return self.array(GONE, block, "id") if self.has(GONE, block) else np.zeros(0, np.int64)

    def read_points(self, block: Block) -> NDArray[np.void]:
        """The records of all points in a block, by input and part of it, each part's in canonical order."""
        return join_records(self.map_points(block))

    def map_points(self, block: Block) -> list[NDArray[np.void]]:
        """The records of a block's points, an array a file; of a file no more is read than is looked at."""
        path = self.points_path(block)
        files = map_records(sorted(path.glob("*.bin")) if path.exists() else [])
        gone = self.gone(block)
        return [records[~np.isin(records["point_id"], gone)] for records in files] if len(gone) else files

    def load_cloud(self, block: Block, reach: float) -> PointCloud:
        """The points of a block and of its surroundings up to `reach` (m), about the block's corner, in
        canonical order."""
        return self.load_points(block.bounds.buffered(reach), block.origin, block.side)[0]

    def load_points(
        self,
        bounds: Bounds,
        origin: tuple[float, float],
        side: float,
        classified: bool = False,
        ids: bool = True,
    ) -> tuple[PointCloud, Places]:
        """The points within `bounds` (world metres) about `origin`, from blocks of a side (m), in canonical
        order, and where in the blocks they are. With `classified` they bear the classes of the ground step,
        with `ids` their own.
        """
        west, south, east, north = (round(value / GRID_STEP) for value in vars(bounds).values())
        range_of: dict[Block, tuple[int, int]] = {}
        seen, count = [], 0
        rows = np.zeros((north - south) // PER_METRE + 2, np.int64)
        # from south to north and west to east: dealt out to rows of cells, the points are in order where each
        # block has them from one file and the cells of blocks agree
        for near in sorted(squares_touching(bounds, side), key=lambda block: (block.row, block.column)):
            right, up = (round(way / GRID_STEP) for way in near.origin)
            limits, start = (west - right, south - up, east - right, north - up), count
            for records in self.map_points(near):
                which = within_kernel(records["xyz"], *limits, rows)
                if len(which):
                    seen.append((near, records, which, count))
                count += len(records)
            if count > start:
                range_of[near] = start, count
        fields = {"point_id": ids, "return_number": self.has_returns, "number_of_returns": self.has_returns}
        fields["classification"] = self.has_classes
        total, free = int(rows.sum()), np.cumsum(rows) - rows
        arrays = {name: np.empty(total, RECORD[name]) for name, wanted in fields.items() if wanted}
        xyz, number = np.empty((total, 3)), np.empty(total, np.int64)
        ordered = len(seen) == len({near for near, *_ in seen})
        for near, records, which, first in seen:
            right, up = (round(way / GRID_STEP) for way in np.subtract(near.origin, origin))
            ordered &= right % PER_METRE == 0 == up % PER_METRE
            low = south - round(near.origin[1] / GRID_STEP)
            place = deal_kernel(records["xyz"], which, low, free, right, up, GRID_STEP, xyz)
            number[place] = which + first
            for name, values in arrays.items():
                values[place] = records[name].take(which)
        cloud = PointCloud(xyz, origin, **arrays, system=self.system, ordered=ordered)
        order = cloud.canonical_order()
        places = Places(range_of, number.take(order))
        cloud = replace(cloud.take(order), ordered=True)
        return (self._with_ground(cloud, places) if classified else cloud), places

    def _with_ground(self, cloud: PointCloud, places: Places) -> PointCloud:
        count = max((end for _, end in places.range_of.values()), default=0)
        found = {name: np.zeros(count, np.uint8) for name in ("known", "class", "part")}
        for block, (start, end) in places.range_of.items():
            known, classes, part = (values[start:end] for values in found.values())
            for square in squares_of([block.bounds], GROUND_SQUARE):
                if not self.has(GROUND, square):
                    continue
                with open_part(self.path(GROUND, square)) as file:
                    if f"class-{block.name}" in file:
                        all_of = f"number-{block.name}" not in file
                        number = np.s_[:] if all_of else file[f"number-{block.name}"]
                        known[number], classes[number] = 1, file[f"class-{block.name}"]
                        if f"part-{block.name}" in file:
                            part[number] = file[f"part-{block.name}"]
        known, classes, part = (values.take(places.number) for values in found.values())
        if not known.all():
            raise RuntimeError("the ground under some of its points could not be found")
        return cloud.with_(classification=classes, part=part if part.any() else None)

    def ground_seconds(self, block: Block) -> float:
        """CPU seconds of the ground stage in the squares whose south-west corner a block holds."""
        squares = squares_of([block.bounds], GROUND_SQUARE)
        own = [one for one in squares if Block.at(*one.origin, block.side) == block and self.has(GROUND, one)]
        return sum(float(self.array(GROUND, square, SECONDS)) for square in own)

    def path(self, step: Step, unit: Block) -> Path:
        """The file of the result of a step for a block or a square."""
        return self.folder / step.name / f"{unit.name}.npz"

    def has(self, step: Step, unit: Block) -> bool:
        """Whether a result is there."""
        return self.path(step, unit).exists()

    def array(self, step: Step, unit: Block, name: str) -> NDArray[Any]:
        """An array of a result."""
        with open_part(self.path(step, unit)) as file:
            return np.asarray(file[name])

    def units(self, step: Step, side: float) -> list[Block]:
        """The blocks or squares of a side (m) that have results of a step, in order."""
        names = [path.stem.split("_") for path in (self.folder / step.name).glob("*.npz")]
        return sorted(Block(int(column), int(row), side) for column, row in names)

    def mark(self, step: Step, unit: Block) -> Mark | None:
        """The mark of a result; None where there is none that is whole."""
        path = self.path(step, unit).with_suffix(".key")
        if not (path.exists() and self.has(step, unit)):
            return None
        words = path.read_text(encoding="ascii", errors="replace").split()
        if len(words) != len(Mark.__annotations__) or any(len(word) != len(key_of()) for word in words):
            log.warning("%s: the part is damaged; it is computed again", path)
            return None
        return Mark(*words)

    def found(self, step: Step, units: Iterable[Block]) -> list[tuple[str, str]]:
        """The units that have a result, each with the key of what was found."""
        marks = ((unit.name, self.mark(step, unit)) for unit in units)
        return [(name, mark.found) for name, mark in marks if mark is not None]

    def recalls(self, step: Step, unit: Block, read: str, taken: str) -> bool:
        """Whether the result that is there follows from the same, though read from other files; it is marked
        as read from these then, and else it is no more."""
        mark = self.mark(step, unit)
        if taken and mark is not None and mark.taken == taken:
            self._write_mark(step, unit, replace(mark, read=read))
            return True
        self.remove(step, unit)
        return False

    def save(
        self, step: Step, unit: Block, arrays: Mapping[str, NDArray[Any]], read: str, taken: str = ""
    ) -> None:
        """Keep a result with its mark, each whole or not at all."""
        path = self.path(step, unit)
        save_part(path, arrays)
        with zipfile.ZipFile(path) as file:
            members = [(one.filename, one.CRC, one.file_size) for one in file.infolist()]
        found = key_of([one for one in members if not one[0].startswith(SECONDS)])
        self._write_mark(step, unit, Mark(read, taken or read, found))

    def _write_mark(self, step: Step, unit: Block, mark: Mark) -> None:
        path = self.path(step, unit).with_suffix(".key")
        hidden = path.with_name(f".{path.name}-{os.getpid()}")
        hidden.write_text(" ".join(vars(mark).values()), encoding="ascii")
        os.replace(hidden, path)

    def remove(self, step: Step, unit: Block) -> None:
        """Remove a result with its mark."""
        for suffix in (".key", ".npz"):
            self.path(step, unit).with_suffix(suffix).unlink(missing_ok=True)

    def keep_only(self, step: Step, units: Iterable[Block]) -> None:
        """Remove the results of a step for all units but these."""
        kept = {unit.name for unit in units}
        for path in (self.folder / step.name).glob("*.*"):
            if path.stem not in kept:
                path.unlink(missing_ok=True)

    def drop_damaged(self) -> None:
        """Remove the parts that were changed or damaged, with a warning for each: they are computed
        again; and what a writer that was killed left hidden beside them."""
        for left in self.folder.glob("*/.*"):
            if left.is_dir():
                shutil.rmtree(left)
            else:
                left.unlink()
        for step in STEPS:
            for path in sorted((self.folder / step.name).glob("*.npz")):
                if not is_whole_part(path):
                    log.warning("%s: the part is damaged; it is computed again", path)
                    path.unlink()


def map_records(paths: Sequence[Path]) -> list[NDArray[np.void]]:
    """The records of some files, an array each, of which no more is read than is looked at."""
    return [np.asarray(np.memmap(path, RECORD, "c")) for path in paths if path.stat().st_size]


def join_records(some: Sequence[NDArray[np.void]]) -> NDArray[np.void]:
    """Arrays of records, one after the other; one alone is not copied."""
    if len(some) == 1:
        return some[0]
    # numpy joins records field by field, many times as slowly
    data = [np.zeros(0, np.uint8), *(records.view(np.uint8) for records in some)]
    return np.concatenate(data).view(RECORD)


def link_file(source: Path, target: Path) -> None:
    """One file under another name."""
    target.unlink(missing_ok=True)
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, target)


def stored_extent(quanta: NDArray[np.int32], block: Block) -> Bounds | None:
    """World metres (half-open) of points (N, 3) in quanta about a block's corner; None for no points."""
    if len(quanta) == 0:
        return None
    low, high = extremes(quanta[:, :2])
    return Bounds(*map(float, (*low * GRID_STEP, *(high + 1) * GRID_STEP))).translated(*block.origin)


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
