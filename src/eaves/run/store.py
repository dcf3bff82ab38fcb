"""The working folder of a run: points by block, results by block and building, each written whole or not."""

from __future__ import annotations

import json
import logging
import os
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eaves.formats.atomic import atomic
from eaves.kernels import kernel
from eaves.model import Block, Bounds, BuildingModel, CoordinateSystem, Failure, PointCloud, Points
from eaves.model.cloud import GRID_STEP
from eaves.model.results import BlockResult, BuildingResult
from eaves.run.block_file import BlockFile, save_block
from eaves.run.building_file import (
    ANSWERS,
    ROWS,
    SavedBuilding,
    Section,
    read_planes,
    read_section,
    read_small_section,
    save_buildings,
)
from eaves.run.part_file import is_sound, open_part, save_part
from eaves.run.rows import BuildingRow
from eaves.run.world_squares import GROUND_SQUARE, squares_of

log = logging.getLogger("eaves")

REQUEST = "request.json"
"""Beside the parts of a run that keeps them: what it was asked for."""
SUPERSEDED = "superseded.npy"
"""Beside the parts of an updated run: the ids of the points that others have taken the place of."""
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
SMALL_PART = 1 << 21
"""Parts of buildings up to this size (bytes) stay in memory once they were read."""
COMPUTED = ("floors", "squares", "decks", "ground", "blocks", "buildings")
"""Folders of what was computed of the points."""


@dataclass(frozen=True, eq=False)
class Piece:
    """Some points of a block: their numbers `which` (K,) among the `count` that it has."""

    block: Block
    which: NDArray[np.int64]
    count: int


@dataclass(frozen=True, eq=False)
class GroundPiece:
    """What the ground stage says of some points (K,) of a block, which has them by these numbers."""

    block: Block
    number: NDArray[np.int64]
    classification: NDArray[np.uint8]
    part: NDArray[np.uint8] | None


@dataclass(frozen=True)
class Store:
    """A folder with `points/` (a folder a block, a file in it a part of an input), `parts/` (a file for every
    part of an input that is in place), `floors/`, `blocks/`, `buildings/` (a file a block each), `squares/`,
    `decks/`, `ground/` (a file a square of their own size), and `plan.json`; while a small run lasts also
    `records/` (a file a part of a compressed input: its records as they are)."""

    folder: Path
    has_returns: bool = True
    has_classes: bool = True
    system: CoordinateSystem = CoordinateSystem()  # noqa: RUF009 (frozen)

    def prepare(self) -> None:
        """Make the folders."""
        for name in ("points", "parts", *COMPUTED):
            (self.folder / name).mkdir(parents=True, exist_ok=True)

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
        return sorted(Block(int(column), int(row), side) for column, row in names)

    def count_points(self, block: Block) -> int:
        """How many points a block holds."""
        return sum(file.stat().st_size for file in self.points_path(block).glob("*.bin")) // RECORD.itemsize

    def read_points(self, block: Block) -> NDArray[np.void]:
        """The records of all points in a block, by input and place in it."""
        path = self.points_path(block)
        files = sorted(path.glob("*.bin")) if path.exists() else []
        ends = np.cumsum([0, *(file.stat().st_size // RECORD.itemsize for file in files)])
        records = np.empty(ends[-1], RECORD)
        for start, end, path in zip(ends[:-1], ends[1:], files, strict=True):
            with path.open("rb") as file:  # numpy joins records field by field, many times as slowly
                file.readinto(records[start:end].view(np.uint8).data)
        return records

    def superseded(self) -> NDArray[np.int64]:
        """Ids (K,) of the points that an update has put others in the place of."""
        path = self.folder / SUPERSEDED
        return np.load(path, allow_pickle=False) if path.exists() else np.zeros(0, np.int64)

    def load_cloud(self, block: Block, reach: float) -> PointCloud:
        """The points of a block and of its surroundings up to `reach` (m), about the block's corner."""
        return self.load_points(block.bounds.buffered(reach), block.origin, block.side)[0]

    def load_points(
        self, bounds: Bounds, origin: tuple[float, float], side: float, classified: bool = False
    ) -> tuple[PointCloud, list[Piece]]:
        """The points within `bounds` (world metres) about `origin`, from blocks of a side (m), and where in
        the blocks they are. With `classified` they bear the classes that `save_ground` kept.
        """
        west, south, east, north = (round(value / GRID_STEP) for value in vars(bounds).values())
        first, last = Block.at(bounds.west, bounds.south, side), Block.at(bounds.east, bounds.north, side)
        pieces, taken = [], []
        for column in range(first.column, last.column + 1):
            for row in range(first.row, last.row + 1):
                near = Block(column, row, side)
                records = self.read_points(near)
                right, up = (round(way / GRID_STEP) for way in near.origin)
                quanta = records["xyz"]
                which = within_kernel(quanta, west - right, south - up, east - right, north - up)
                if len(which):  # of the neighbours only the rim is kept while the others are read
                    whole = len(which) == len(records)
                    pieces.append(Piece(near, which, len(records)))
                    taken.append(records if whole else records.take(which))
        ends = np.cumsum([0, *map(len, taken)])
        xyz = np.empty((ends[-1], 3))
        for start, records, piece in zip(ends[:-1], taken, pieces, strict=True):
            right, up = (round(way / GRID_STEP) for way in np.subtract(piece.block.origin, origin))
            metres_kernel(records["xyz"], right, up, GRID_STEP, xyz[start : start + len(records)])

        def joined(name: str) -> NDArray[Any]:
            return np.concatenate([np.zeros(0, RECORD[name]), *(records[name] for records in taken)])

        cloud = PointCloud(
            xyz=xyz,
            origin=origin,
            return_number=joined("return_number") if self.has_returns else None,
            number_of_returns=joined("number_of_returns") if self.has_returns else None,
            classification=joined("classification") if self.has_classes else None,
            point_id=joined("point_id"),
            system=self.system,
        )
        return (self._with_ground(cloud, pieces) if classified else cloud), pieces

    def save_ground(self, square: Block, ground: Sequence[GroundPiece], about: dict[str, Any]) -> None:
        """Keep the classes that the ground stage gave to the points in a square, block by block."""
        arrays: dict[str, NDArray[Any]] = {"about": np.frombuffer(json.dumps(about).encode(), np.uint8)}
        for one in ground:
            arrays[f"number-{one.block.name}"] = one.number.astype(np.int32)
            arrays[f"class-{one.block.name}"] = one.classification
            if one.part is not None:
                arrays[f"part-{one.block.name}"] = one.part
        save_part(self.path("ground", square), arrays)

    def ground_seconds(self, block: Block) -> float:
        """CPU seconds of the ground stage in the squares whose south-west corner a block holds."""
        total = 0.0
        for square in squares_of([block.bounds], GROUND_SQUARE):
            if Block.at(*square.origin, block.side) == block and self.has("ground", square):
                with open_part(self.path("ground", square)) as file:
                    total += json.loads(file["about"].tobytes())["seconds"]
        return total

    def _with_ground(self, cloud: PointCloud, pieces: Sequence[Piece]) -> PointCloud:
        classes = [np.zeros(0, np.uint8)]
        parts = [np.zeros(0, np.uint8)]
        for piece in pieces:
            of_all, part = np.zeros(piece.count, np.uint8), np.zeros(piece.count, np.uint8)
            told = np.zeros(piece.count, bool)
            for square in squares_of([piece.block.bounds], GROUND_SQUARE):
                path = self.path("ground", square)
                if not path.exists():
                    continue
                with open_part(path) as file:
                    if f"class-{piece.block.name}" in file:
                        found = file[f"class-{piece.block.name}"]
                        # of all points, in their order, where a block is a square
                        whole = len(found) == piece.count
                        number = np.s_[:] if whole else file[f"number-{piece.block.name}"]
                        of_all[number], told[number] = found, True
                        if f"part-{piece.block.name}" in file:
                            part[number] = file[f"part-{piece.block.name}"]
            if not told[piece.which].all():
                raise RuntimeError("the ground under some of its points could not be found")
            classes.append(of_all.take(piece.which))
            parts.append(part.take(piece.which))
        joined = np.concatenate(parts)
        return cloud.with_(classification=np.concatenate(classes), part=joined if joined.any() else None)

    def path(self, kind: str, block: Block) -> Path:
        """The file of a block's or a square's result: `kind` is one of `COMPUTED`."""
        return self.folder / kind / f"{block.name}.npz"

    def has(self, kind: str, block: Block) -> bool:
        """Whether a block's result is there."""
        return self.path(kind, block).exists()

    def forget(self, kind: str) -> None:
        """Remove all results of a kind."""
        for path in (self.folder / kind).iterdir():
            if path.is_file():
                path.unlink()

    def save_block(self, result: BlockResult) -> None:
        """Keep what the block pass found in one block."""
        save_block(self.path("blocks", result.block), result)

    def open_block(self, block: Block) -> BlockFile:
        """What the block pass found in one block; to be used in a `with` statement."""
        return BlockFile(self.path("blocks", block), block)

    def save_buildings(
        self, owner: Block, results: Sequence[BuildingResult | SavedBuilding]
    ) -> dict[str, Section]:
        """Keep the buildings owned by one block; the sections of their file."""
        return save_buildings(self.path("buildings", owner), results)

    def saved_buildings(self, owner: Block) -> list[SavedBuilding]:
        """The buildings owned by one block, as they were saved."""
        if not self.has("buildings", owner):
            return []
        rows, answers = self.section(owner, ROWS), self.section(owner, ANSWERS)
        planes = enumerate(self.planes(owner))
        return [SavedBuilding(rows, answers, number, *told) for number, told in planes]

    def building_rows(self, owners: Sequence[Block]) -> Iterator[BuildingRow]:
        """What is told of all buildings, owner block by owner block."""
        for owner in owners:
            if self.has("buildings", owner):
                yield from self.section(owner, ROWS)

    def planes(self, owner: Block) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int32]]]:
        """Ids and roof planes (0 for none) of the points of each building owned by one block."""
        if self.has("buildings", owner):
            yield from read_planes(self.path("buildings", owner))

    def answers(self, owners: Sequence[Block]) -> Iterator[BuildingModel | Failure]:
        """All buildings, owner block by owner block."""
        for owner in owners:
            if self.has("buildings", owner):
                yield from self.section(owner, ANSWERS)

    def section(self, owner: Block, name: str) -> Section:
        """A section of the file of an owner block's buildings."""
        path = self.path("buildings", owner)
        state = path.stat()
        if state.st_size > SMALL_PART:
            return read_section(path, name)
        return read_small_section(path, name, (state.st_mtime_ns, state.st_size))

    def drop_damaged(self) -> None:
        """Remove the parts that are not as they were written, with a warning for each: they are computed
        again."""
        for kind in COMPUTED:
            for path in sorted((self.folder / kind).glob("*.npz")):
                if not is_sound(path):
                    log.warning("%s: the part is damaged; it is computed again", path)
                    path.unlink()

    def matches(self, plan: dict[str, Any]) -> bool:
        """Whether the folder was made by the same plan (inputs, recipe, version)."""
        path = self.folder / "plan.json"
        try:
            return bool(json.loads(path.read_text(encoding="utf-8")) == plan)
        except FileNotFoundError:
            return False
        except (ValueError, RecursionError):
            log.warning("%s: the plan of the earlier run is damaged; all is computed anew", path)
            return False

    def keep_request(self, told: dict[str, Any], blocks: Sequence[Block], owners: Sequence[Block]) -> None:
        """Write what the run was asked for, with the blocks it computed and those that own buildings."""
        places = {
            name: [[block.column, block.row] for block in some]
            for name, some in (("blocks", blocks), ("owners", owners))
        }
        with atomic(self.folder / REQUEST) as temporary:
            temporary.write_text(json.dumps({**told, **places}), encoding="utf-8")

    def keep_plan(self, plan: dict[str, Any]) -> None:
        """Write the plan that everything in the folder belongs to."""
        with atomic(self.folder / "plan.json") as temporary:
            temporary.write_text(json.dumps(plan), encoding="utf-8")


def link_file(source: Path, target: Path) -> None:
    """One file under another name."""
    target.unlink(missing_ok=True)
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, target)


def extent_of(quanta: NDArray[np.int32], block: Block) -> Bounds | None:
    """World metres (half-open) of points (N, 3) in quanta about a block's corner; None for no points."""
    if len(quanta) == 0:
        return None
    low, high = quanta[:, :2].min(axis=0) * GRID_STEP, (quanta[:, :2].max(axis=0) + 1) * GRID_STEP
    return Bounds(*map(float, (*low, *high))).translated(*block.origin)


@kernel
def within_kernel(
    quanta: NDArray[np.int32], west: int, south: int, east: int, north: int
) -> NDArray[np.int64]:
    """Numbers (K,) of the points (N, 3) inside a window; all in quanta."""
    which, count = np.empty(len(quanta), np.int64), 0
    for i in range(len(quanta)):
        which[count] = i
        count += west <= quanta[i, 0] < east and south <= quanta[i, 1] < north
    return which[:count]


@kernel
def metres_kernel(quanta: NDArray[np.int32], right: int, up: int, quantum: float, xyz: Points) -> None:
    """The places of points in quanta (N, 3), moved by whole quanta, in metres into `xyz` (N, 3)."""
    for i in range(len(quanta)):
        xyz[i, 0] = (quanta[i, 0] + right) * quantum
        xyz[i, 1] = (quanta[i, 1] + up) * quantum
        xyz[i, 2] = quanta[i, 2] * quantum
