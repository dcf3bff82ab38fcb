"""The terrain (DTM) and the surface (DSM) as rasters."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from eaves.geometry.neighbours import measure_spacing
from eaves.model import Bounds, Mask, PointCloud, Raster, Scene
from eaves.raster.grid import empty_raster, heights_of, highest_points, mean_heights
from eaves.raster.interpolate import fill_linear, fill_nearest

CELL = 0.5
"""Side of a cell of the rasters (m)."""


def make_dtm(cloud: PointCloud, bounds: Bounds, cell: float = CELL) -> Raster:
    """The terrain over `bounds` (local m), linear between ground points; NaN only when there is no ground
    at all.

    A cell with ground points holds their mean height; the others are linear in the triangles of the cells
    around the gap, and beyond the outermost ground points take the nearest height.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> cloud = truth.classified()
    >>> dtm = eaves.make_dtm(cloud, cloud.bounds, cell=1.0)
    >>> bool(dtm.values.max() < cloud.xyz[:, 2].max())
    True
    """
    ground = cloud.xyz.take(np.flatnonzero(cloud.ground), axis=0)
    mean, _ = mean_heights(ground, bounds, cell)
    raster = Raster(mean, bounds.west, bounds.north, cell)
    if (
        len(ground) and not np.isfinite(mean).any()
    ):  # all of it lies outside: the nearest is all there is to say
        centre = np.array([(bounds.west + bounds.east) / 2, (bounds.south + bounds.north) / 2])
        nearest = np.argmin(((ground[:, :2] - centre) ** 2).sum(axis=1))
        return empty_raster(bounds, cell, float(ground[nearest, 2]))
    return fill_linear(raster)


def find_gaps(cloud: PointCloud, dtm: Raster, width: float) -> Mask:
    """The cells (H, W) of a DTM that are over `width` (m) from any ground point: closed, not measured."""
    _, count = mean_heights(cloud.xyz[cloud.ground], dtm.bounds, dtm.cell)
    if not (count > 0).any():
        return np.ones(dtm.shape, bool)
    return np.asarray(ndimage.distance_transform_edt(count == 0, sampling=dtm.cell) > width)


def make_dsm(cloud: PointCloud, bounds: Bounds, cell: float = CELL, close: float = 1.0) -> Raster:
    """The height of the highest point of each cell, noise left out.

    Empty cells take the nearest value up to `close` (m) away, which keeps the jump at walls; larger gaps
    stay NaN.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> dsm = eaves.make_dsm(truth.cloud, truth.cloud.bounds, cell=1.0)
    >>> dsm.values.shape, dsm.cell
    ((102, 102), 1.0)
    """
    noise = cloud.noise
    xyz = cloud.xyz.take(np.flatnonzero(~noise), axis=0) if noise.any() else cloud.xyz
    top = heights_of(highest_points(xyz, bounds, cell), xyz[:, 2])
    return fill_nearest(Raster(top, bounds.west, bounds.north, cell), close)


def make_scene(cloud: PointCloud, bounds: Bounds, cell: float = CELL) -> Scene:
    """A classified cloud with its terrain, its surface and every point's height; `bounds` in local metres.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> cloud = truth.classified()
    >>> scene = eaves.make_scene(cloud, cloud.bounds)
    >>> bool(abs(scene.height[cloud.classification == 2]).max() < 0.5)
    True
    """
    dtm, dsm = make_dtm(cloud, bounds, cell), make_dsm(cloud, bounds, cell)
    return Scene(cloud, dtm, dsm, measure_spacing(cloud.xyz), cloud.xyz[:, 2] - dtm.at(cloud.xyz))
