"""The input of detectors, a classified cloud with its rasters, and their answer."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eaves.kernels import kernel
from eaves.model.block import Bounds
from eaves.model.checks import Grid, Integers, Labels, Mask, Pictured, Points, Values
from eaves.model.cloud import PointCloud


@dataclass(frozen=True)
class Doubt:
    """A place that deserves a look, and why.

    Parameters
    ----------
    x, y : float
        Its middle: metres about the origin of what carries the doubt.
    area_m2 : float
        Its size (m²).
    reason : str
        What the scan does not decide, in words.
    stage : str
        The stage that met it.

    Examples
    --------
    >>> from eaves.model import Doubt
    >>> Doubt(1.0, 2.0, 30.0, "half of the rim continues the terrain", "detect").translated(10.0, 0.0).x
    11.0
    """

    x: float
    y: float
    area_m2: float
    reason: str
    stage: str

    def translated(self, east: float, north: float) -> Doubt:
        """The same doubt about an origin that lies so far (m) to the west and south.

        Parameters
        ----------
        east, north : metres that are added to the place.

        Returns
        -------
        Doubt
            With the place moved and all else the same.
        """
        return replace(self, x=self.x + east, y=self.y + north)


ROOF, WALL, TREE, NOISE, DOUBTFUL = 1, 2, 3, 4, 5
"""Codes of `Regions.part` and of the extra dimension `part` of classified.laz; 0 is none of them. Doubtful
are points in `PointCloud.part` alone, of which a ground filter is not sure."""


@dataclass(frozen=True, eq=False)
class Raster(Pictured):
    """Values of square cells, row 0 north.

    Parameters
    ----------
    values : ndarray (H, W) of float32
        One value a cell; NaN where there is none.
    west, north : float
        The outer corner (local m).
    cell : float
        Side of a cell (m, > 0).

    Examples
    --------
    >>> import numpy as np
    >>> from eaves import Raster
    >>> Raster(np.zeros((2, 3), np.float32), west=10.0, north=20.0, cell=0.5).bounds
    Bounds(west=10.0, south=19.0, east=11.5, north=20.0)
    """

    values: Grid
    west: float
    north: float
    cell: float

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.values.shape[0], self.values.shape[1]

    @property
    def bounds(self) -> Bounds:
        """Local metres, to the outer edges of the cells."""
        rows, columns = self.shape
        return Bounds(self.west, self.north - rows * self.cell, self.west + columns * self.cell, self.north)

    def with_(self, **changes: object) -> Raster:
        """A copy with some fields replaced."""
        return replace(self, **changes)  # type: ignore[arg-type]

    def cell_of(self, xy: Points) -> tuple[Integers, Integers]:
        """Row and column of points (N, 2 or 3); outside the raster they are out of range."""
        column = np.floor((xy[:, 0] - self.west) / self.cell).astype(np.int64)
        row = np.floor((self.north - xy[:, 1]) / self.cell).astype(np.int64)
        return row, column

    def at(self, xy: Points) -> Values:
        """Bilinear values (N,) at points (N, 2 or 3); the nearest cell's beyond the rim; NaN at NaN cells."""
        values, places = np.ascontiguousarray(self.values), np.ascontiguousarray(xy, np.float64)
        return np.asarray(bilinear_kernel(values, self.west, self.north, self.cell, places))


@dataclass(frozen=True, eq=False)
class Scene(Pictured):
    """The input of detectors: a classified cloud with its rasters, all about the same origin.

    Parameters
    ----------
    cloud : PointCloud
        N points with classes 2, 7 and 18 set.
    dtm, dsm : Raster
        Terrain and surface (m).
    spacing : float
        Mean spacing (m) of the points in plan: 1 / √density, over the area where there are points.
    height : ndarray (N,)
        Height (m) of every point above the terrain.
    signs : ndarray or None
        What the detector counted in the surroundings (`Detector.count_signs`); None leaves it with the scene.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> cloud = nine_roofs_on_a_slope(density=1.0).classified()
    >>> eaves.make_scene(cloud, cloud.bounds).dtm.shape
    (204, 204)
    """

    cloud: PointCloud
    dtm: Raster
    dsm: Raster
    spacing: float

    height: Values = field(default_factory=lambda: np.zeros(0))
    signs: NDArray[np.float64] | None = None


@dataclass(frozen=True, eq=False)
class Regions:
    """Label of the building that each point belongs to.

    Parameters
    ----------
    label : ndarray (N,) of int32
        0 for no building, else 1…K.
    score : ndarray (K,)
        Confidence of the detector in each region, 0 to 1.
    part : ndarray (N,) of uint8 or None
        1 roof, 2 wall, 3 tree, 4 noise, 0 none of them, where the method distinguishes them.
    doubts : tuple of Doubt
        Places, in local metres, where the evidence contradicts itself or is missing.

    Examples
    --------
    >>> import numpy as np
    >>> from eaves import Regions
    >>> regions = Regions(np.array([0, 1, 1, 2], np.int32))
    >>> regions.count, regions.mask_of(1).tolist()
    (2, [False, True, True, False])
    """

    label: Labels
    score: Values = field(default_factory=lambda: np.zeros(0))
    part: NDArray[np.uint8] | None = None
    doubts: tuple[Doubt, ...] = ()

    def with_doubts(self, doubts: Iterable[Doubt]) -> Regions:
        """The same regions with these doubts."""
        return replace(self, doubts=tuple(doubts))

    @property
    def count(self) -> int:
        """Number of regions."""
        return int(self.label.max(initial=0))

    def mask_of(self, number: int) -> Mask:
        """The points (N,) of region `number`."""
        return np.asarray(self.label == number)


@kernel
def bilinear_kernel(values: NDArray[Any], west: float, north: float, cell: float, xy: Points) -> Values:
    """Bilinear values (N,) of a raster (H, W) at points (N, 2 or 3), NaN at those without coordinates."""
    rows, columns = values.shape
    heights = np.empty(len(xy))
    for i in range(len(xy)):
        x, y = (xy[i, 0] - west) / cell - 0.5, (north - xy[i, 1]) / cell - 0.5
        if np.isnan(x) or np.isnan(y):
            heights[i] = np.nan
            continue
        x, y = min(max(x, 0.0), columns - 1.0), min(max(y, 0.0), rows - 1.0)
        column, row = min(int(x), max(columns - 2, 0)), min(int(y), max(rows - 2, 0))
        east, south = min(column + 1, columns - 1), min(row + 1, rows - 1)
        fx, fy = x - column, y - row
        top = values[row, column] * (1.0 - fx) + values[row, east] * fx
        bottom = values[south, column] * (1.0 - fx) + values[south, east] * fx
        heights[i] = top * (1.0 - fy) + bottom * fy
    return heights
