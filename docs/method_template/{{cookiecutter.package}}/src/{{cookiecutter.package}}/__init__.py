"""A detector of buildings for eaves."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from eaves import Detector, Regions, Scene
from eaves.methods import Emit, ignore, parameter
from scipy import ndimage


class {{ cookiecutter.class_name }}(Detector):
    """Groups of cells in which most points are high above the terrain."""

    name: ClassVar[str] = "{{ cookiecutter.method }}"
    idea: ClassVar[str] = "Cells with many high points, in connected groups."

    least_height: float = parameter(2.5, "Height of the lowest roof above the terrain.", unit="m", gt=0.0)
    cell: float = parameter(1.0, "Side of a cell; a divisor of a block's 240 m.", unit="m", gt=0.0)

    def label(self, scene: Scene, emit: Emit = ignore) -> Regions:
        """A number for every point of the scene: that of its building, 0 for none."""
        column, row = np.floor(scene.cloud.xyz[:, :2] / self.cell).astype(int).T
        column, row = column - column.min(), row - row.min()
        high = (scene.height > self.least_height) & ~scene.cloud.noise
        count, total = (np.zeros((row.max() + 1, column.max() + 1)) for _ in range(2))
        np.add.at(total, (row, column), 1)
        np.add.at(count, (row[high], column[high]), 1)
        groups, _ = ndimage.label(count > 0.5 * np.maximum(total, 1))
        emit("groups", groups)
        return Regions(np.where(high, groups[row, column], 0).astype(np.int32))
