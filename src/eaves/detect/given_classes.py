"""Buildings from the file's own classes: connected groups of class-6 points."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from eaves.detect.stage import Detector
from eaves.detect.toolkit.cells import Cells
from eaves.detect.toolkit.surface_grid import connected
from eaves.methods import Emit, ignore, parameter
from eaves.model import BUILDING, Regions, Scene
from eaves.model.scene import ROOF


class GivenClasses(Detector):
    """Regions of the points that the file has as buildings.

    Points of the building classes are put in cells about as wide as the spacing allows; cells that touch,
    also by a corner, are one building. The classes are used as they are.

    Formula
    -------
    label = 8-connected component of the cells that hold a point of `classes`

    Fidelity
    --------
    No paper: this is the meaning of `--use-classes`; the class numbers are those of [las14].

    Fails where
    -----------
    The vendor's classes are wrong. Buildings less than a cell apart become one.

    Complexity
    ----------
    One pass over the points of the class, one labelling of the grid.

    References
    ----------
    [las14].
    """

    name: ClassVar[str] = "given_classes"
    idea: ClassVar[str] = "Believe the file: connected points of the building classes."
    paper: ClassVar[str] = "las14"

    classes: tuple[int, ...] = parameter((BUILDING, 67), "LAS classes that mean building.")
    cell: float | None = parameter(
        None,
        "Cell in which points count as connected; default: twice the spacing, at least 0.5.",
        unit="m",
        gt=0,
    )

    @property
    def buffer(self) -> float:
        return 30.0

    def label(self, scene: Scene, emit: Emit = ignore) -> Regions:
        cloud = scene.cloud
        label = np.zeros(len(cloud), np.int32)
        if cloud.classification is None:
            return Regions(label)
        chosen = np.flatnonzero(np.isin(cloud.classification, self.classes))
        if len(chosen) == 0:
            return Regions(label)
        side = self.cell or max(0.5, 2.0 * scene.spacing)
        cells = Cells.of(cloud.xyz[chosen], side)
        groups, count = connected((cells.count > 0).reshape(cells.shape))
        emit("building cells", groups)
        label[chosen] = groups.ravel()[cells.cell]
        part = np.zeros(len(cloud), np.uint8)
        part[chosen] = ROOF
        return Regions(label, np.ones(count), part)
