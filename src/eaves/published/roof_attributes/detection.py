"""Buildings by the attributes of roof cells: normal, roughness, gradient density, three operators."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from scipy import ndimage

from eaves.detect.toolkit.surface_grid import (
    GROUP_M2,
    RIM_M,
    SurfaceDetector,
    SurfaceGrid,
    connected,
    filled,
    height_error,
    mean_in,
    opened_by_area,
    share_around,
    surface_noise,
)
from eaves.methods import Emit, parameter
from eaves.model import Labels, Mask, Scene, Values

ANGLE_OF_ERROR = 1.65
"""Two slopes of independent errors differ by less than this many of one in three of four cases."""


class RoofAttributes(SurfaceDetector):
    """Building labels from what the surface of roofs is like, cell by cell and segment by segment.

    High cells are described by the micro surface normal and the roughness of the four heights around each
    corner. First the gradient density: high cells around which steep gradients are dense are vegetation.
    Of what is left a cell is roof-like when it is smooth and at least three of its neighbours have a like
    normal. Groups of roof-like cells too small or too narrow for a building are opened away, and those that
    stay are reconstructed by dilation under the normalised surface.

    Formula
    -------
    |n| = √{[Δy(z₀₁+z₀₀-z₁₁-z₁₀)]² + [Δx(z₀₁+z₁₁-z₁₀-z₀₀)]² + 4(ΔxΔy)²} (eq. 1) and
    R = ½|z₁₁+z₀₀-z₀₁-z₁₀| (eq. 2); the index i runs along x. On a plane 2ΔxΔy/|n| is the cosine of the slope.

    Fidelity
    --------
    Equations, ground filter and the rule of gradient density are the document's. The density is counted on
    the raw high cells, before anything is smoothed away, within a window around each: the document counts it
    in a segmented region, which `as_published` does; where crowns touch roofs that is one region. Its flow
    chart and the figure of the three operators are not in the text; they are taken as (1) removal of cells
    with fewer than three neighbours of like normal, (2) opening, by area and by the narrowest building, (3)
    reconstruction by dilation under the normalised surface, cell by cell over cells of low gradient density
    around which some are roof-like, and over the rim. By default the opening by the narrowest building comes
    last, for roofs with dormers are narrow before; `as_published` has it second. What is lower than
    `min_height` is not off the ground: the document has no height. No threshold is printed. A ridge or hip
    of two faces of 45° is a roof's: across a cell it twists its heights by √½ of a side, more than tiles,
    gutters and the scan do, whose roughness the ground shows.

    Fails where
    -----------
    Roofs with many dormers; steep roofs at low density; trees of a smooth closed canopy; hedges.

    Complexity
    ----------
    A nearest-neighbour search for the empty cells; the rest linear in cells.

    References
    ----------
    [roof_attributes]
    """

    name: ClassVar[str] = "roof_attributes"
    idea: ClassVar[str] = "micro normals, roughness, gradient density and three morphological operators"
    paper: ClassVar[str] = "roof_attributes"

    cell: float | None = parameter(
        None, "Side of a cell; default: 1.5 spacings, at least 0.5.", unit="m", symbol="Δ", gt=0.0
    )
    steep: float = parameter(60.0, "Slope of a gradient that counts.", unit="degree", gt=0.0, lt=90.0)
    max_density: float = parameter(
        0.45,
        "Cells around which more of the high cells are steep are vegetation.",
        off=1.0,
        step="gradient density",
        ge=0.0,
        le=1.0,
    )
    around_cells: bool = parameter(
        True, "The density is counted in a window around each cell, not in segments of high cells.", off=False
    )
    max_roughness: float | None = parameter(
        None,
        "Rougher cells are no roof; default: √½ cells, as a fold of 45° across a cell twists it, or 3 "
        "times the ground's own.",
        unit="m",
        symbol="R",
        off=1e6,
        step="surface roughness",
        gt=0.0,
    )
    like_normal: float | None = parameter(
        None,
        "Normals closer than this are alike; default: 1.65 times the error of a slope, 10 to 45.",
        unit="degree",
        gt=0.0,
        le=90.0,
    )
    like_neighbours: int = parameter(
        3,
        "Neighbours of like normal that a roof cell has.",
        unit="cell",
        off=0,
        step="operator 1: like normals",
        ge=0,
    )
    min_area: float = parameter(
        GROUP_M2,
        "Smaller groups of roof-like cells are opened away.",
        unit="m²",
        off=0.0,
        step="operator 2: opening",
        ge=0.0,
    )
    min_width: float = parameter(
        2.0,
        "Narrowest building; the side of the opening.",
        unit="m",
        off=1e-3,
        step="operator 2: opening",
        gt=0.0,
    )
    late_opening: bool = parameter(
        True,
        "The opening by the narrowest building follows the reconstruction: dormers make roofs narrow before.",
        off=False,
    )
    min_share: float = parameter(
        0.1,
        "The reconstruction runs over cells around which this share is roof-like.",
        off=1.0,
        step="operator 3: reconstruction",
        ge=0.0,
        le=1.0,
    )
    regrow: float = parameter(
        RIM_M,
        "Distance by which the rim grows.",
        unit="m",
        off=0.0,
        step="operator 3: reconstruction",
        ge=0.0,
    )

    def usual_cell(self, spacing: float) -> float:
        return 1.5 * spacing

    def groups(self, scene: Scene, grid: SurfaceGrid, high: Mask, emit: Emit) -> tuple[Labels, Values]:
        normal = micro_normals(grid.surface, grid.side)
        rough = roughness(grid.surface)
        emit("cosine of slope", grid.cells.raster(normal[..., 2]))
        emit("roughness", grid.cells.raster(rough))
        least, steep = self.min_area / grid.side**2, normal[..., 2] < np.cos(np.radians(self.steep))
        if self.around_cells:
            density = share_around(steep, high, round(self.window / grid.side))
        else:
            segment, count = connected(high)
            density = np.r_[0.0, mean_in(segment, count, steep)][segment]
        emit("gradient density", grid.cells.raster(np.where(high, density, np.nan)))
        calm = high & (density <= self.max_density)
        emit("calm cells", grid.cells.raster(calm))
        smooth = calm & (rough <= (self.max_roughness or self.derived_roughness(grid, rough)))
        like = self.like_normal or self.derived_angle(scene, grid)
        roof = smooth & (count_like(normal, smooth, like) >= self.like_neighbours)
        emit("roof-like cells", grid.cells.raster(roof))
        square = np.ones((max(1, round(self.min_width / grid.side)),) * 2, bool)
        core = opened_by_area(roof if self.late_opening else ndimage.binary_opening(roof, square), least)
        emit("opened groups", grid.cells.raster(core))
        grown = self.grown(grid, core, roof, calm, high)
        if self.late_opening:
            grown = opened_by_area(ndimage.binary_opening(grown, square), least)
        whole = self.with_rim(grid, grown, high)
        emit("segments", grid.cells.raster(whole))
        label, count = connected(whole)
        return label, 1.0 - mean_in(label, count, density)

    def derived_angle(self, scene: Scene, grid: SurfaceGrid) -> float:
        """The largest angle (degrees) between like normals; see the parameter."""
        error = height_error(grid, scene.spacing) / grid.side
        return float(np.clip(np.degrees(ANGLE_OF_ERROR * error), 10.0, 45.0))

    def derived_roughness(self, grid: SurfaceGrid, rough: Values) -> float:
        """The largest roughness (m) of a roof; see the parameter."""
        return float(max(grid.side * np.sqrt(0.5), 3.0 * surface_noise(rough, grid, 0.3)))


def cell_corner_heights(surface: Values) -> tuple[Values, Values, Values, Values]:
    """Heights z00, z10, z01, z11 (H, W) of each cell and its neighbours east (i + 1) and north (j + 1)."""
    whole = np.pad(filled(surface), ((1, 0), (0, 1)), mode="edge")
    return whole[1:, :-1], whole[1:, 1:], whole[:-1, :-1], whole[:-1, 1:]


def micro_normals(surface: Values, side: float) -> Values:
    """Upward unit normals (H, W, 3) of the micro surfaces; eq. 1 is the length before division."""
    z00, z10, z01, z11 = cell_corner_heights(surface)
    east = side * (z00 + z01 - z10 - z11)
    north = side * (z00 + z10 - z01 - z11)
    vector = np.stack([east, north, np.full_like(east, 2.0 * side * side)], axis=-1)
    return np.asarray(vector / np.linalg.norm(vector, axis=-1, keepdims=True), np.float64)


def roughness(surface: Values) -> Values:
    """Half the absolute twist (m, (H, W)) of each cell's four heights: eq. 2."""
    z00, z10, z01, z11 = cell_corner_heights(surface)
    return np.asarray(0.5 * np.abs(z11 + z00 - z01 - z10), np.float64)


def count_like(normal: Values, mask: Mask, angle_deg: float) -> Values:
    """Number (H, W) of the eight neighbours in `mask` (H, W) with a normal within the angle (degrees)."""
    rows, columns = mask.shape
    padded = np.pad(normal, ((1, 1), (1, 1), (0, 0)))
    there = np.pad(mask, 1)
    count = np.zeros(mask.shape)
    for row in range(3):
        for column in range(3):
            if (row, column) == (1, 1):
                continue
            window = (slice(row, row + rows), slice(column, column + columns))
            cosine = (padded[window] * normal).sum(axis=-1)
            count += there[window] & (cosine >= np.cos(np.radians(angle_deg)))
    return count
