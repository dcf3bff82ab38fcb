"""Building segments by local height texture, for methods that model raw points (Maas)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from scipy import ndimage

from eaves.detect.toolkit.surface_grid import (
    GROUP_M2,
    SurfaceDetector,
    SurfaceGrid,
    connected,
    filled,
    height_error,
    opened_by_area,
    surface_noise,
)
from eaves.methods import Emit, parameter
from eaves.model import Labels, Mask, Scene, Values
from eaves.raster.blur import opened_by_square

TEXTURE_OF_ERROR = 1.4
"""The texture of independent heights, in their errors: √(6/9) = 0.8, and three quarters more."""


class HeightTexture(SurfaceDetector):
    """Building segments, as raw points: high cells of little texture, opened, sized, checked by histogram.

    A fine grid serves only to find the segments. The texture of a cell is how far the heights around it leave
    their plane: little on roofs, much on crowns. High cells of little texture are opened by the narrowest
    building width, and the connected components that stay are held against a least size. The histogram of the
    heights of all raw points in a component must have few low ones: a roof hides the ground, a crown does
    not. The components grow back over cells around which some are smooth and over their rims; all raw points
    in them are the answer. First returns alone are enough.

    Formula
    -------
    Texture: standard deviation of the nine heights of a three by three window about their plane.

    Fidelity
    --------
    The article leaves segmentation open (GIS data or the laser data itself); texture,
    opening, components, size and histogram are those of Maas's companion paper on invariant moments (1999),
    which prints no thresholds. The grid is our choice. The texture of a roof is that of a ridge along a
    row of cells (√2/3 · tan 35° = 1/3 of a side), of its tiles and gutters, or of the scan, which the ground
    shows; where cells hold fewer than two points, the height of a
    cell on a slope is known to about half a spacing only. A ground plan may be given to the later
    stages; it is not used here.

    Fails where
    -----------
    Roofs with many dormers; dense evergreen crowns and hedges that hide the ground; houses narrower than the
    opening.

    Complexity
    ----------
    A nearest-neighbour search for the empty cells; the rest linear in points and cells.

    References
    ----------
    [maas_vosselman1999]
    """

    name: ClassVar[str] = "height_texture"
    idea: ClassVar[str] = "high cells of little height texture, opened, sized, checked by height histogram"
    paper: ClassVar[str] = "maas_vosselman1999"

    max_texture: float | None = parameter(
        None,
        "Cells of more texture are no roof; default: a third of a cell, as at a ridge of two faces of 35°, "
        "1.4 times the error of a height on a roof of 45°, or 3 times the ground's own.",
        unit="m",
        off=1e6,
        step="height texture",
        gt=0.0,
    )
    min_width: float = parameter(
        1.0, "Narrowest building; the side of the opening.", unit="m", off=1e-3, step="opening", gt=0.0
    )
    min_area: float = parameter(
        GROUP_M2, "Smallest area of a building component.", unit="m²", off=0.0, step="size", ge=0.0
    )
    max_low: float = parameter(
        0.2,
        "Components with a larger share of low points are vegetation.",
        off=1.0,
        step="height histogram",
        ge=0.0,
        le=1.0,
    )

    def groups(self, scene: Scene, grid: SurfaceGrid, high: Mask, emit: Emit) -> tuple[Labels, Values]:
        texture = local_texture(grid.surface)
        emit("texture", grid.cells.raster(texture))
        smooth = high & (texture <= (self.max_texture or self.derived_texture(scene, grid, texture)))
        emit("smooth high cells", grid.cells.raster(smooth))
        side = max(1, round(self.min_width / grid.side))
        opened = opened_by_square(smooth, side)
        emit("opened", grid.cells.raster(opened))
        core = opened_by_area(opened, self.min_area / grid.side**2)
        found, count = connected(core)
        low = self.low_share(scene, grid, found, count)
        core = np.r_[False, low <= self.max_low][found]
        emit("components", grid.cells.raster(core))
        whole = self.with_rim(grid, self.grown(grid, core, smooth, high, high), high)
        label, count = connected(whole)
        return label, 1.0 - self.low_share(scene, grid, label, count)

    def derived_texture(self, scene: Scene, grid: SurfaceGrid, texture: Values) -> float:
        """The largest texture (m) of a roof; see the parameter."""
        known = TEXTURE_OF_ERROR * height_error(grid, scene.spacing)
        return max(grid.side / 3.0, known, 3.0 * surface_noise(texture, grid, 0.3))

    def low_share(self, scene: Scene, grid: SurfaceGrid, label: Labels, count: int) -> Values:
        """Share of each component's raw points (count,) in the low bins of its height histogram."""
        height = scene.height[~scene.cloud.noise]
        inside = label.ravel()[grid.cells.cell]
        every = np.bincount(inside, minlength=count + 1)[1:]
        low = np.bincount(inside[height < self.min_height], minlength=count + 1)[1:]
        return np.asarray(low / np.maximum(every, 1), np.float64)


def local_texture(surface: Values) -> Values:
    """Standard deviation (m, (H, W)) of three by three heights about the plane through them."""
    whole = filled(surface)
    ramp, flat = np.array([-1.0, 0.0, 1.0]), np.ones(3)
    mean = ndimage.uniform_filter(whole, 3)
    square = ndimage.uniform_filter((whole - np.median(whole)) ** 2, 3)
    east = ndimage.correlate1d(ndimage.correlate1d(whole, ramp, axis=1), flat, axis=0) / 6.0
    north = ndimage.correlate1d(ndimage.correlate1d(whole, ramp, axis=0), flat, axis=1) / 6.0
    variance = square - (mean - np.median(whole)) ** 2
    # Six of nine cells lie one step off the middle: a slope of g per cell has variance 2/3 g².
    return np.asarray(np.sqrt(np.maximum(variance - (east**2 + north**2) * 2.0 / 3.0, 0.0)), np.float64)
