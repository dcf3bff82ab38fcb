"""The terrain (DTM) and the surface (DSM) as rasters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely

from eaves.geometry.neighbours import measure_spacing
from eaves.model import Bounds, Footprint, PointCloud, Points, Raster, Scene
from eaves.model.checks import check_positive, check_type
from eaves.raster.grid import empty_raster, heights_of, highest_points, mean_heights
from eaves.raster.interpolate import fill_linear, fill_linear_twice, fill_nearest

CELL = 0.5
"""Side of a cell of the rasters (m)."""
LARGEST_RASTER = 10_000_000_000
"""Cells of a raster in one file, 50 km by 50 km: more cost time though they are empty."""


def is_large(extent: Bounds) -> bool:
    """True if a raster over an extent (world metres) has more cells than one file holds."""
    return extent.width * extent.height / CELL**2 > LARGEST_RASTER


def make_dtm(cloud: PointCloud, bounds: Bounds | None = None, cell: float = CELL) -> Raster:
    """The terrain over `bounds`, linear between ground points.

    A cell with ground points holds their mean height; the others are linear in the triangles of the cells
    around the gap, and beyond the outermost ground points take the nearest height.

    Parameters
    ----------
    cloud : PointCloud
        N points with classes; class 2 is the ground, and there must be at least one such point.
    bounds : Bounds or None
        West, south, east, north of the raster (local m); by default those of the cloud.
    cell : float
        Side of a cell (m, > 0).

    Returns
    -------
    Raster
        Heights (H, W) float32 in metres, row 0 north; no cell is NaN.

    Raises
    ------
    TypeError
        When an argument has another type.
    ValueError
        When the cloud has no classes or no ground point, the bounds are not finite, or `cell` is not above 0.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> cloud = truth.classified()
    >>> dtm = eaves.make_dtm(cloud, cell=1.0)
    >>> bool(dtm.values.max() < cloud.xyz[:, 2].max())
    True
    """
    bounds = checked_bounds(cloud, bounds, cell)
    check_ground(cloud)
    return terrain_of(cloud, bounds, cell)


def terrain_of(
    cloud: PointCloud, bounds: Bounds, cell: float = CELL, beneath: Points | None = None
) -> Raster:
    """The terrain of `make_dtm`; NaN everywhere when the cloud has no ground point.

    `beneath` (K, 3) are points of terrain that was not seen, which count as ground.
    """
    return fill_linear(mean_terrain(cloud, bounds, cell, beneath))


def mean_terrain(cloud: PointCloud, bounds: Bounds, cell: float, beneath: Points | None) -> Raster:
    """The mean height of the ground points of each cell, NaN where there is none; when all are outside the
    bounds the height of the nearest, everywhere."""
    ground = cloud.xyz.take(np.flatnonzero(cloud.ground), axis=0)
    if beneath is not None and len(beneath):
        ground = np.concatenate([ground, beneath])
    mean, _ = mean_heights(ground, bounds, cell)
    raster = Raster(mean, bounds.west, bounds.north, cell)
    if len(ground) and not np.isfinite(mean).any():  # all ground points are outside the bounds
        centre = np.array([(bounds.west + bounds.east) / 2, (bounds.south + bounds.north) / 2])
        nearest = np.argmin(((ground[:, :2] - centre) ** 2).sum(axis=1))
        return empty_raster(bounds, cell, float(ground[nearest, 2]))
    return raster


def make_dsm(
    cloud: PointCloud, bounds: Bounds | None = None, cell: float = CELL, close: float = 1.0
) -> Raster:
    """The height of the highest point of each cell, noise left out.

    Empty cells take the nearest value up to `close` (m) away, which keeps the step at walls; larger gaps stay
    NaN.

    Parameters
    ----------
    cloud : PointCloud
        N points; those of classes 7 and 18 are left out.
    bounds : Bounds or None
        West, south, east, north of the raster (local m); by default those of the cloud.
    cell : float
        Side of a cell (m, > 0).
    close : float
        Distance (m, ≥ 0) over which empty cells are filled.

    Returns
    -------
    Raster
        Heights (H, W) float32 in metres, row 0 north; NaN where no point is near.

    Raises
    ------
    TypeError
        When an argument has another type.
    ValueError
        When the bounds are not finite, or `cell` is not above 0.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> dsm = eaves.make_dsm(truth.cloud, cell=1.0)
    >>> dsm.values.shape, dsm.cell
    ((102, 102), 1.0)
    """
    bounds = checked_bounds(cloud, bounds, cell)
    noise = cloud.noise
    xyz = cloud.xyz.take(np.flatnonzero(~noise), axis=0) if noise.any() else cloud.xyz
    top = heights_of(highest_points(xyz, bounds, cell), xyz[:, 2])
    return fill_nearest(Raster(top, bounds.west, bounds.north, cell), close)


def make_scene(cloud: PointCloud, bounds: Bounds | None = None, cell: float = CELL) -> Scene:
    """A classified cloud with its terrain, its surface and every point's height above the terrain.

    Parameters
    ----------
    cloud : PointCloud
        N points with classes, at least one of them ground (class 2).
    bounds : Bounds or None
        West, south, east, north of the rasters (local m); by default those of the cloud.
    cell : float
        Side of a cell (m, > 0).

    Returns
    -------
    Scene
        The cloud, `dtm` and `dsm` (H, W), `spacing` (m) and `height` (N,) in metres.

    Raises
    ------
    TypeError
        When an argument has another type.
    ValueError
        When the cloud has no classes or no ground point, the bounds are not finite, or `cell` is not above 0.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> cloud = truth.classified()
    >>> scene = eaves.make_scene(cloud)
    >>> bool(abs(scene.height[cloud.classification == 2]).max() < 0.5)
    True
    """
    bounds = checked_bounds(cloud, bounds, cell)
    check_ground(cloud)
    return scene_of(cloud, bounds, cell)


def scene_of(cloud: PointCloud, bounds: Bounds, cell: float = CELL, beneath: Points | None = None) -> Scene:
    """The scene of `make_scene`; terrain and heights are NaN when the cloud has no ground point.

    `beneath` (K, 3) are points of the terrain under what is wide.
    """
    return scene_over(terrain_of(cloud, bounds, cell, beneath), cloud, bounds)


def scene_over(dtm: Raster, cloud: PointCloud, bounds: Bounds) -> Scene:
    """The scene of a cloud over a terrain within `bounds`."""
    dsm = make_dsm(cloud, bounds, dtm.cell)
    return Scene(cloud, dtm, dsm, measure_spacing(cloud.xyz), cloud.xyz[:, 2] - dtm.at(cloud.xyz))


def two_scenes(
    cloud: PointCloud, other: PointCloud, bounds: Bounds, cell: float = CELL, beneath: Points | None = None
) -> tuple[Scene, Scene]:
    """The scene of `scene_of`, and that of the same points in other classes, of which more are ground; the
    surface is that of the first."""
    means = (mean_terrain(points, bounds, cell, beneath) for points in (cloud, other))
    dtm, richer = fill_linear_twice(*means)
    scene = scene_over(dtm, cloud, bounds)
    return scene, replace(scene, cloud=other, dtm=richer, height=cloud.xyz[:, 2] - richer.at(cloud.xyz))


def heights_under(
    footprint: Footprint, terrain: Raster, nearest: Points | None = None
) -> tuple[float, float]:
    """The lowest terrain height on the outline, or of the nearest ground where that is given, and its 5th
    percentile (m); NaN where no terrain is known."""
    rim = shapely.segmentize(footprint.polygon, terrain.cell)
    heights = terrain.at(shapely.get_coordinates(rim)) if nearest is None else nearest[:, 2]
    heights = heights[np.isfinite(heights)]
    if len(heights) == 0:
        return float("nan"), float("nan")
    return float(heights.min()), float(np.percentile(heights, 5))


def checked_bounds(cloud: PointCloud, bounds: Bounds | None, cell: float) -> Bounds:
    """The bounds of a raster, by default those of its cloud; TypeError or ValueError when none can be made of
    these arguments."""
    check_type(cloud, PointCloud, "cloud", "use eaves.read(path) or PointCloud(xyz)")
    bounds = cloud.bounds if bounds is None else bounds
    check_type(bounds, Bounds, "bounds", "use cloud.bounds or Bounds(west, south, east, north)")
    check_positive(cell, "cell")
    if not (bounds.width >= 0 and bounds.height >= 0 and np.isfinite([bounds.width, bounds.height]).all()):
        raise ValueError(
            f"bounds must run from west to east and from south to north in finite metres, not {bounds}; "
            "leave points without coordinates out"
        )
    return bounds


def check_ground(cloud: PointCloud) -> None:
    """Raise ValueError when no point of a cloud is ground."""
    if not cloud.ground.any():
        raise ValueError(
            f"cloud must have ground points (class 2), and none of its {len(cloud)} points is; "
            "call classify_ground(cloud) first"
        )
