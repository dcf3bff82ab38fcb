"""Heights of a cloud of images whose walls were smoothed, as they were before, where anything is decided."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eaves.model import GRID_STEP, Block, Points
from eaves.raster.blur import cell_of, gridded, without_blur

MARGIN = 30.0
"""Width (m) of the surroundings of a block that are sharpened with it: ten times a blur of 3 m."""


@dataclass(frozen=True, eq=False)
class Smoothed:
    """The points (N, 3) of a block, in metres about its corner, and those around it (M, 3)."""

    own: Points
    around: Points


def inputs_of_sharpened(block: Block, points: Mapping[Block, NDArray[Any]], parameters: object) -> Smoothed:
    """The points of a block and of its surroundings, as they were read."""
    own, around = np.zeros((0, 3)), list[Points]()
    limits = np.array([-MARGIN, block.side + MARGIN])
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
