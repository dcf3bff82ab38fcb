"""The result of the block pass in one block, as one file of which a reader takes only the arrays it needs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eaves.model import (
    BUILDING,
    GRID_STEP,
    GROUND,
    NOISE_CLASSES,
    Block,
    Bounds,
    Doubt,
    Labels,
    Points,
    Raster,
    Values,
)
from eaves.model.results import BlockResult
from eaves.raster.surfaces import CELL
from eaves.run.store import SECONDS, STARTS, PartFile, packed, unpack

CANDIDATE_HEIGHT = 1.0
"""Points lower than this (m) over the terrain belong to no roof."""
BORDER = 6.0
"""A region with points this near (m) to a side of its block may go on, or need terrain, beyond it: more than
the seam, the gap a detector bridges and the margin of terrain around a building."""


@dataclass(frozen=True, eq=False)
class Candidates:
    """The points (M,) of a block that can belong to a building, in its canonical order; all but noise where
    buildings are to know what lies below and around them.
    """

    block: Block
    xyz: Points
    point_id: NDArray[np.int64]
    label: Labels
    part: NDArray[np.uint8]
    high: NDArray[np.bool_]
    """True if a given footprint may take the point: high over the terrain, neither ground nor noise."""
    score: NDArray[np.float64]
    """Of each label, (K,)."""
    spacing: float
    not_last: NDArray[np.bool_]
    """True if the pulse returned once more from below."""
    intensity: Values | None = None
    """None where no method of the units takes it."""

    def numbers_of(self, label: int) -> NDArray[np.int64]:
        """The numbers (K,), ascending, of the points that bear a label."""
        order, first = self._by_label
        return order[first[label] : first[label + 1]] if label + 1 < len(first) else order[:0]

    def between(self, south: float, north: float) -> slice:
        """The points in the rows of 1 m cells that reach from `south` to `north` (m): they lie together."""
        limits = np.floor([south - GRID_STEP, north + GRID_STEP])
        return slice(*np.searchsorted(self._row, limits + [0.0, 1.0]).tolist())

    @cached_property
    def _by_label(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        order = np.argsort(self.label, kind="stable")
        labels = np.arange(int(self.label.max(initial=0)) + 2)
        return order, np.searchsorted(self.label[order], labels)

    @cached_property
    def _row(self) -> NDArray[np.float64]:
        return np.floor(self.xyz[:, 1] + 0.5 * GRID_STEP)


@dataclass(frozen=True, eq=False)
class BlockMetadata:
    """The little that the whole run needs to know of a block."""

    block: Block
    extent: Bounds
    """World metres of the points in the block."""
    seconds: dict[str, float]
    doubts: tuple[Doubt, ...] = ()


def block_extent(notes: Sequence[BlockMetadata]) -> Bounds:
    """World metres of all points used, widened to whole cells."""
    if not notes:
        return Bounds(0.0, 0.0, CELL, CELL)
    extent = reduce(Bounds.union, (note.extent for note in notes))
    west, south = np.floor(extent.west / CELL) * CELL, np.floor(extent.south / CELL) * CELL
    east, north = (np.floor(extent.east / CELL) + 1) * CELL, (np.floor(extent.north / CELL) + 1) * CELL
    return Bounds(float(west), float(south), float(east), float(north))


def block_arrays(result: BlockResult) -> dict[str, NDArray[Any]]:
    """A result as the arrays of its file."""
    excluded = np.zeros(256, bool)  # a class in each place
    excluded[list(NOISE_CLASSES)] = True
    usable = ~excluded[result.classification]
    high = (result.height >= CANDIDATE_HEIGHT) & usable & (result.classification != GROUND)
    candidate = (result.label > 0) | high | (result.keeps_low & usable)
    count = int(max(result.label.max(initial=0), result.seam_label.max(initial=0)))
    # what was found outside given footprints is a building, too, though it is not modelled
    classes = np.where(result.vegetation > 0, result.vegetation, result.classification)
    classes[result.label > 0] = BUILDING
    about = {
        "spacing": result.spacing,
        "extent": result.extent,
        "doubts": result.doubts,
        "corner": [result.dtm.west, result.dtm.north, result.dtm.cell],
    }
    return {
        "seconds": packed(result.seconds),
        "about": packed(about),
        "classification": classes,
        "part": result.part,
        "candidate": np.packbits(candidate),
        "label": result.label[candidate].astype(np.min_scalar_type(count)),
        "high": np.packbits(high[candidate]),
        "score": result.score,
        "dtm": result.dtm.values,
        "ground": ground_cells(result),
        "dsm": result.dsm.values,
        "seam_id": result.seam_id,
        "seam_label": result.seam_label,
        "sides": border_sides(result, count),
    }


def ground_cells(result: BlockResult) -> NDArray[np.uint8]:
    """1 for the cells (H, W) of the terrain that hold a ground point: elsewhere it is interpolated."""
    dtm, ground = result.dtm, result.xyz[result.classification == GROUND]
    row, column = dtm.cell_of(ground)
    cells = np.zeros(dtm.shape, np.uint8)
    cells[np.clip(row, 0, dtm.shape[0] - 1), np.clip(column, 0, dtm.shape[1] - 1)] = 1
    return cells


def border_sides(result: BlockResult, count: int) -> NDArray[np.uint8]:
    """For labels 0 to `count`: 1 when points of it lie in the block, plus 2, 4, 8, 16 when some lie near its
    west, south, east, north side; 0 for label 0."""
    sides, labelled = np.zeros(count + 1, np.uint8), np.flatnonzero(result.label)
    label, (x, y) = result.label[labelled], result.xyz[labelled, :2].T
    sides[label] = 1
    far = result.block.side - BORDER
    for bit, beside in ((2, x < BORDER), (4, y < BORDER), (8, x >= far), (16, y >= far)):
        touched = np.zeros(count + 1, bool)
        touched[label[beside]] = True
        sides[touched] |= bit
    return sides


def inputs_of_shown(
    block: Block,
    regions: Mapping[Block, BlockFile],
    ground: Mapping[Block, Mapping[str, NDArray[Any]]],
    parameters: object,
) -> dict[str, NDArray[Any]]:
    """What a run's files show of a block, as arrays; of its ground what it began with, and its seconds."""
    file = regions[block]
    arrays = {name: file[name] for name in ("about", "dtm", "dsm")} | {STARTS: ground[block][STARTS]}
    seconds = file.metadata().seconds
    return arrays | {SECONDS: packed({**seconds, "ground": float(ground[block][SECONDS])})}


def show_block(arrays: dict[str, NDArray[Any]], parameters: object) -> dict[str, NDArray[Any]]:
    """The arrays, as they are seen."""
    return arrays


class BlockFile:
    """The file of one block, or the arrays that would be in it."""

    def __init__(
        self,
        file: Path | Mapping[str, NDArray[Any]],
        block: Block,
        read_points: Callable[[Block], NDArray[np.void]],
    ) -> None:
        self.block, self._read_points = block, read_points
        self._file = PartFile(file) if isinstance(file, Path) else file
        self.about: dict[str, Any] = unpack(self._file["about"])

    def __getitem__(self, name: str) -> NDArray[Any]:
        """One array, read now; see `block_arrays` for the names."""
        return self._file[name]

    def metadata(self) -> BlockMetadata:
        """Extent, seconds and doubts."""
        seconds = unpack(self._file["seconds"])
        return BlockMetadata(self.block, self.about["extent"], seconds, self.about["doubts"])

    def raster(self, name: str) -> Raster:
        """`dtm`, `dsm` or `ground` (1 where a cell holds a ground point), about the block's corner."""
        return Raster(self[name], *self.about["corner"])

    @cached_property
    def candidate(self) -> NDArray[np.int64]:
        """The numbers (M,) of the points that can belong to a building."""
        return np.flatnonzero(np.unpackbits(self["candidate"]))

    def points(self, which: NDArray[np.integer]) -> NDArray[np.void]:
        """The records of some (K,) of the block's points, as the store keeps them."""
        number = self._number
        return self._read_points(self.block).take(which if number is None else number.take(which))

    def point_id(self) -> NDArray[np.int64]:
        """The ids (N,) of the block's points."""
        ids, number = self._read_points(self.block)["point_id"], self._number
        return ids.copy() if number is None else ids.take(number)

    @property
    def _number(self) -> NDArray[np.int64] | None:
        """The places (N,) of the block's points in the store; None where they lie in their order."""
        file = self["from_file"]
        if not len(file):
            return None
        # the points of each file are in canonical order, as all of them are
        number = np.empty(len(file), np.int64)
        number[np.argsort(file, kind="stable")] = np.arange(len(file))
        return number

    def candidates(self) -> Candidates:
        """The points that can belong to a building."""
        which = self.candidate
        points = self.points(which)
        others: NDArray[Any] = points["fields"] if "fields" in (points.dtype.names or ()) else points
        has_intensity = "intensity" in (others.dtype.names or ())
        return Candidates(
            self.block,
            points["xyz"] * GRID_STEP,
            np.ascontiguousarray(points["point_id"]),
            self["label"].astype(np.int32),
            self["part"][which],
            np.unpackbits(self["high"], count=len(which)).astype(bool),
            self["score"],
            self.about["spacing"],
            np.asarray(points["return_number"] < points["number_of_returns"]),
            others["intensity"].copy() if has_intensity else None,
        )
