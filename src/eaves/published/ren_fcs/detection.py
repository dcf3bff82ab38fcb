"""Buildings as what is left of the normalised surface after edges and quadratic gradient (Fc-S)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from scipy import ndimage

from eaves.detect.stage import MIN_HEIGHT_M
from eaves.detect.toolkit.surface_grid import (
    GROUP_M2,
    LIKE_SHARE,
    RIM_M,
    SurfaceDetector,
    SurfaceGrid,
    connected,
    filled,
    height_error,
    mean_in,
    opened_by_area,
    surface_noise,
)
from eaves.methods import Emit, parameter
from eaves.model import Labels, Mask, Scene, Values
from eaves.raster.blur import grown_by_square, shrunk_by_square

BEND_OF_ERROR = 5.0
"""The quadratic gradient of independent heights, in their errors: √(6 + 6 + 1/2) = 3.5, and half as much."""


class Contours(SurfaceDetector):
    """Building labels by Fc-S: the second half, from the normalised surface to buildings.

    The surface is interpolated by nearest neighbour, which keeps the jump at walls, and the terrain found
    from contours (`ground.Contours`) is taken off. Low objects go by height; parts with little edge
    information (Sobel) go, because a building has strong edges. The quadratic gradient, small on roofs level
    or oblique and large on crowns, deletes cells first, which shrinks large vegetation and parts it from
    buildings; only then the size threshold removes what is left of it. The cores grow back, cell by cell, to
    the whole building.

    Formula
    -------
    Quadratic gradient of a cell: Δ²·√(z_xx² + 2 z_xy² + z_yy²), the second differences of the surface (m).

    Fidelity
    --------
    The document prints no number and gives its steps in words only; every threshold here is ours. Steps 4 to
    6 follow its order: edges before vegetation, quadratic gradient before size. Sobel height differences over
    `edge_height` part the high cells; "less edge information" is read as: less than `min_edge` of the rim of
    such a part lies on edges. The "iteration" of step 6 is read as growth from the cores, cell by cell until
    nothing grows, over cells around which at least `min_share` is smooth: a roof of dormers is, a crown is
    not; and then `regrow` over the rim. As much as a ridge or valley of 45° bends is smooth; where cells hold
    few points, their heights on such a roof are known to side / (points + 1) only. A cell of this surface
    takes its highest point, one of the filter's the point nearest to its middle, and heights are over the
    scene's terrain, drawn through the filter's ground points: two readings of the document's one DSM and DTM.

    Fails where
    -----------
    Roofs full of dormers and machinery are as rough as crowns; steep roofs at wide cells; hedges and bridges
    pass as smooth, edged and large; buildings in a slope lose the edge on one side.

    Complexity
    ----------
    A nearest-neighbour search for the empty cells; the rest linear in cells.

    References
    ----------
    [ren_fcs]
    """

    name: ClassVar[str] = "contours"
    idea: ClassVar[str] = "edges keep, quadratic gradient shrinks vegetation, then size decides (Fc-S)"
    paper: ClassVar[str] = "ren_fcs"
    ground_method: ClassVar[str] = "contours"

    min_height: float = parameter(
        MIN_HEIGHT_M,
        "Least height over the terrain: lower objects (cars) are removed.",
        unit="m",
        off=0.0,
        step="low objects go",
        ge=0.0,
    )
    edge_height: float = parameter(
        1.5, "Sobel height difference from which a cell is an edge.", unit="m", gt=0.0
    )
    min_edge: float = parameter(
        0.7,
        "Share of the rim of what lies between edges that must be edge.",
        off=0.0,
        step="edge information (Sobel)",
        ge=0.0,
        le=1.0,
    )
    max_bend: float | None = parameter(
        None,
        "Cells with a larger quadratic gradient are deleted; default: one cell, as a fold of 45° bends, 5 "
        "times the error of a height, or 3 times the ground's own.",
        unit="m",
        off=1e6,
        step="quadratic gradient",
        gt=0.0,
    )
    min_area: float = parameter(
        GROUP_M2, "Smaller groups of smooth cells are vegetation.", unit="m²", off=0.0, step="size", ge=0.0
    )
    min_share: float = parameter(
        LIKE_SHARE,
        "Cores grow over cells around which this share is smooth.",
        off=1.0,
        step="final iteration",
        ge=0.0,
        le=1.0,
    )
    regrow: float = parameter(
        RIM_M, "Distance by which the rim grows.", unit="m", off=0.0, step="final iteration", ge=0.0
    )

    def groups(self, scene: Scene, grid: SurfaceGrid, high: Mask, emit: Emit) -> tuple[Labels, Values]:
        emit("nDSM", grid.cells.raster(grid.height))
        emit("high cells", grid.cells.raster(high))
        emit("Sobel heights", grid.cells.raster(sobel_height(grid.surface)))
        edged = self.keep_edged(grid, high)
        emit("edged groups", grid.cells.raster(edged))
        bend = quadratic_gradient(grid.surface)
        emit("quadratic gradient", grid.cells.raster(bend))
        smooth = edged & (bend <= (self.max_bend or self.derived_bend(scene, grid, bend)))
        emit("smooth cells", grid.cells.raster(smooth))
        core = opened_by_area(
            ndimage.binary_opening(smooth, np.ones((2, 2), bool)), self.min_area / grid.side**2
        )
        emit("cores", grid.cells.raster(core))
        label, count = connected(self.with_rim(grid, self.grown(grid, core, smooth, edged, edged), edged))
        emit("buildings", grid.cells.raster(label))
        return label, mean_in(label, count, smooth)

    def derived_bend(self, scene: Scene, grid: SurfaceGrid, bend: Values) -> float:
        """The largest quadratic gradient (m) of a roof; see the parameter."""
        known = BEND_OF_ERROR * height_error(grid, scene.spacing)
        return max(grid.side, known, 3.0 * surface_noise(bend, grid, 0.3))

    def keep_edged(self, grid: SurfaceGrid, high: Mask) -> Mask:
        """The high cells (H, W) between edges that edges surround, and those edges: step 4.

        Edges inside a group part a roof from the crown beside it, and either from a hillside.
        """
        edge = sobel_height(grid.surface) >= self.edge_height
        between = high & ~edge
        label, count = connected(between)
        rim = between & ~shrunk_by_square(between, 3)
        size = np.bincount(label[rim], minlength=count + 1)
        hits = np.bincount(label[rim & grown_by_square(edge, 3)], minlength=count + 1)
        keep = hits >= self.min_edge * size
        keep[0] = False
        kept = keep[label]
        return np.asarray(kept | (high & edge & grown_by_square(kept, 3)), np.bool_)


def sobel_height(surface: Values) -> Values:
    """Height difference (m, (H, W)) across two cells by Sobel's operator."""
    whole = filled(surface)
    return np.asarray(np.hypot(ndimage.sobel(whole, axis=0), ndimage.sobel(whole, axis=1)) / 4.0, np.float64)


def quadratic_gradient(surface: Values) -> Values:
    """Length (m, (H, W)) of the second differences of the surface."""
    whole = filled(surface)
    line = np.array([1.0, -2.0, 1.0])
    xx, yy = ndimage.convolve1d(whole, line, axis=1), ndimage.convolve1d(whole, line, axis=0)
    half = np.array([-0.5, 0.0, 0.5])
    xy = ndimage.correlate1d(ndimage.correlate1d(whole, half, axis=0), half, axis=1)
    return np.asarray(np.sqrt(xx**2 + 2.0 * xy**2 + yy**2), np.float64)
