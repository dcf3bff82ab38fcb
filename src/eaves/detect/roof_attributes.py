"""Buildings by the attributes of roof cells: normal, roughness, gradient density, three operators."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from scipy import ndimage

from eaves.detect.contours import filled
from eaves.detect.stage import Detector
from eaves.detect.toolkit.cells import side_near
from eaves.detect.toolkit.surface_grid import (
    EIGHT,
    SurfaceGrid,
    connected,
    grow_back,
    nearest_surface,
    no_regions,
    opened_by_area,
    regions_of_cells,
    share_in,
)
from eaves.methods import Emit, ignore, parameter
from eaves.model import Mask, Regions, Scene, Values


class RoofAttributes(Detector):
    """Building labels from what the surface of roofs is like, cell by cell and segment by segment.

    Cells off the ground are described by the micro surface normal and the roughness of the four heights
    around each corner. A cell is roof-like when it is smooth and at least three of its neighbours have a like
    normal. Groups of roof-like cells too small for a building are opened away by area, and those that stay
    are reconstructed by dilation under the normalised surface. A segment in which steep gradients are dense
    is vegetation, the others are buildings.

    |n| = √{[Δy(z₀₁+z₀₀-z₁₁-z₁₀)]² + [Δx(z₀₁+z₁₁-z₁₀-z₀₀)]² + 4(ΔxΔy)²} (eq. 1) and
    R = ½|z₁₁+z₀₀-z₀₁-z₁₀| (eq. 2); the index i runs along x. On a plane 2ΔxΔy/|n| is the cosine of the slope.

    Fidelity
    --------
    Equations, ground filter and the rule of gradient density are the document's. Its flow
    chart and the figure of the three operators are not in the text; they are taken as (1) opening by area,
    (2) reconstruction by dilation under the normalised surface, (3) removal of cells with fewer than three
    neighbours of like normal. No threshold is printed; ours follow the spacing, because the height of a cell
    on a slope is known to about half a spacing only.

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
    min_height: float = parameter(2.0, "Least height of a roof over the terrain.", unit="m", ge=0.0)
    max_roughness: float | None = parameter(
        None,
        "Rougher cells are no roof; default: half a spacing, at least 0.15.",
        unit="m",
        symbol="R",
        gt=0.0,
    )
    like_normal: float = parameter(
        20.0, "Normals closer than this are alike.", unit="degree", gt=0.0, le=90.0
    )
    like_neighbours: int = parameter(3, "Neighbours of like normal that a roof cell has.", unit="cell", ge=0)
    min_area: float = parameter(6.0, "Smaller groups of roof-like cells are opened away.", unit="m²", ge=0.0)
    steep: float = parameter(60.0, "Slope of a gradient that counts.", unit="degree", gt=0.0, lt=90.0)
    max_density: float = parameter(
        0.35, "Segments with a larger share of such gradients are vegetation.", ge=0.0, le=1.0
    )
    max_step: float = parameter(1.0, "Largest step in height of the reconstruction.", unit="m", gt=0.0)
    regrow: float = parameter(2.0, "How far the reconstruction reaches.", unit="m", ge=0.0)

    @property
    def buffer(self) -> float:
        return 30.0

    def label(self, scene: Scene, emit: Emit = ignore) -> Regions:
        grid = nearest_surface(scene, self.cell or side_near(max(0.5, 1.5 * scene.spacing)))
        if grid is None:
            return no_regions(scene)
        high = grid.high(self.min_height)
        normal = micro_normals(grid.surface, grid.side)
        rough = roughness(grid.surface)
        emit("cosine of slope", normal[..., 2])
        emit("roughness", rough)
        smooth = high & (rough <= (self.max_roughness or max(0.15, 0.5 * scene.spacing)))
        roof = smooth & (count_like(normal, smooth, self.like_normal) >= self.like_neighbours)
        emit("roof-like cells", roof)
        core = opened_by_area(roof, self.min_area / grid.side**2)
        emit("large groups", core)
        whole = grow_back(core, high, grid.surface, self.max_step, round(self.regrow / grid.side))
        emit("segments", whole)
        return self.judge(scene, grid, whole, normal)

    def judge(self, scene: Scene, grid: SurfaceGrid, whole: Mask, normal: Values) -> Regions:
        """The segments (H, W) whose gradients are not dense."""
        label, count = connected(whole)
        inner = ndimage.binary_erosion(whole, EIGHT)
        steep = inner & (normal[..., 2] < np.cos(np.radians(self.steep)))
        inside = np.where(inner, label, 0)
        density = share_in(inside, count, steep)
        keep = np.r_[False, density <= self.max_density]
        return regions_of_cells(scene, grid, np.where(keep[label], label, 0), 1.0 - density, self.min_height)


def corner_heights(surface: Values) -> tuple[Values, Values, Values, Values]:
    """Heights z00, z10, z01, z11 (H, W) of each cell and its neighbours east (i + 1) and north (j + 1)."""
    whole = np.pad(filled(surface), ((1, 0), (0, 1)), mode="edge")
    return whole[1:, :-1], whole[1:, 1:], whole[:-1, :-1], whole[:-1, 1:]


def micro_normals(surface: Values, side: float) -> Values:
    """Upward unit normals (H, W, 3) of the micro surfaces; eq. 1 is the length before division."""
    z00, z10, z01, z11 = corner_heights(surface)
    east = side * (z00 + z01 - z10 - z11)
    north = side * (z00 + z10 - z01 - z11)
    vector = np.stack([east, north, np.full_like(east, 2.0 * side * side)], axis=-1)
    return np.asarray(vector / np.linalg.norm(vector, axis=-1, keepdims=True), np.float64)


def roughness(surface: Values) -> Values:
    """Half the absolute twist (m, (H, W)) of each cell's four heights: eq. 2."""
    z00, z10, z01, z11 = corner_heights(surface)
    return np.asarray(0.5 * np.abs(z11 + z00 - z01 - z10), np.float64)


def count_like(normal: Values, mask: Mask, angle_deg: float) -> Values:
    """How many of the eight neighbours in `mask` (H, W) have a normal within the angle (degrees), (H, W)."""
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
