"""The working folder of a run: points by block, results by block and building, each written whole or not."""

from __future__ import annotations

import json
import pickle
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eaves.formats.atomic import atomic
from eaves.model import Block, Bounds, CoordinateSystem, PointCloud
from eaves.model.cloud import QUANTUM
from eaves.pipeline import BlockResult, BuildingResult

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


@dataclass(frozen=True)
class Store:
    """A folder with `points/`, `blocks/` and `buildings/`, one file a block in each, and `plan.json`."""

    folder: Path
    has_returns: bool = True
    has_classes: bool = True
    system: CoordinateSystem = CoordinateSystem()  # noqa: RUF009 (frozen)

    def prepare(self) -> None:
        """Make the folders."""
        for name in ("points", "blocks", "buildings"):
            (self.folder / name).mkdir(parents=True, exist_ok=True)

    def discard(self) -> None:
        """Remove the folder with everything in it."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def points_path(self, block: Block) -> Path:
        """The file of a block's points."""
        return self.folder / "points" / f"{block.name}.bin"

    def append_points(self, block: Block, records: np.ndarray[Any, Any]) -> None:
        """Add records to a block's points."""
        with self.points_path(block).open("ab") as file:
            file.write(records.tobytes())

    def blocks(self, side: float) -> list[Block]:
        """The blocks that have points, in order."""
        names = [path.stem.split("_") for path in (self.folder / "points").glob("*.bin")]
        return sorted(Block(int(column), int(row), side) for column, row in names)

    def load_cloud(self, block: Block, reach: float) -> PointCloud:
        """The points of a block and of its surroundings up to `reach` (m), about the block's corner."""
        steps = int(np.ceil(reach / block.side))
        window = block.bounds.grown(reach).moved(-block.origin[0], -block.origin[1])
        pieces = []
        for column in range(block.column - steps, block.column + steps + 1):
            for row in range(block.row - steps, block.row + steps + 1):
                near = Block(column, row, block.side)
                path = self.points_path(near)
                if not path.exists():
                    continue
                records = np.fromfile(path, RECORD)
                shift = np.round((np.array(near.origin) - block.origin) / QUANTUM).astype(np.int64)
                if near != block:
                    records = records[within(records["xyz"], window.moved(*(-shift * QUANTUM)))]
                pieces.append(((records["xyz"] + np.append(shift, 0)) * QUANTUM, records))
        xyz = np.concatenate([piece[0] for piece in pieces])
        records = np.concatenate([piece[1] for piece in pieces])
        return PointCloud(
            xyz=xyz,
            origin=block.origin,
            return_number=records["return_number"].copy() if self.has_returns else None,
            number_of_returns=records["number_of_returns"].copy() if self.has_returns else None,
            classification=records["classification"].copy() if self.has_classes else None,
            point_id=records["point_id"].copy(),
            system=self.system,
        )

    def save(self, kind: str, block: Block, value: object) -> None:
        """Keep a block's result: `kind` is `blocks` or `buildings`."""
        with atomic(self.folder / kind / f"{block.name}.pickle") as temporary:
            temporary.write_bytes(pickle.dumps(value, protocol=5))

    def forget(self, kind: str) -> None:
        """Remove all results of a kind."""
        for path in (self.folder / kind).glob("*.pickle"):
            path.unlink()

    def has(self, kind: str, block: Block) -> bool:
        """Whether a block's result is there."""
        return (self.folder / kind / f"{block.name}.pickle").exists()

    def load_block(self, block: Block) -> BlockResult:
        """The block pass's result for one block."""
        result: BlockResult = pickle.loads((self.folder / "blocks" / f"{block.name}.pickle").read_bytes())
        return result

    def load_buildings(self, block: Block) -> list[BuildingResult]:
        """The building pass's results for the buildings at home in one block."""
        results: list[BuildingResult] = pickle.loads(
            (self.folder / "buildings" / f"{block.name}.pickle").read_bytes()
        )
        return results

    def results(self, homes: list[Block]) -> Iterator[BuildingResult]:
        """All buildings, home block by home block."""
        for home in homes:
            if self.has("buildings", home):
                yield from self.load_buildings(home)

    def matches(self, plan: dict[str, Any]) -> bool:
        """Whether the folder was made by the same plan (inputs, recipe, version)."""
        path = self.folder / "plan.json"
        return path.exists() and json.loads(path.read_text(encoding="utf-8")) == plan

    def keep_plan(self, plan: dict[str, Any]) -> None:
        """Write the plan that the folder belongs to; the last thing written when all points are in place."""
        with atomic(self.folder / "plan.json") as temporary:
            temporary.write_text(json.dumps(plan), encoding="utf-8")


def within(quanta: NDArray[np.int32], window: Bounds) -> NDArray[np.int64]:
    """Numbers (K,) of the points, in quanta (N, 3), inside a window whose sides are whole quanta (m)."""
    west, south, east, north = (round(side / QUANTUM) for side in vars(window).values())
    x, y = quanta[:, 0], quanta[:, 1]
    return np.flatnonzero((x >= west) & (x < east) & (y >= south) & (y < north))
