"""The surface of a scene on a grid, and the steps that the grid detectors share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from eaves.detect.stage import MIN_HEIGHT_M, STOREY_M, Detector
from eaves.detect.toolkit.cells import Cells, side_near
from eaves.methods import Emit, ignore, parameter
from eaves.model import Labels, Mask, Regions, Scene, Values
from eaves.model.scene import ROOF

LEAST_POINTS = 4
"""Fewer points make no surface."""
GROUP_M2, LIKE_SHARE, RIM_M = 10.0, 0.2, 1.0
"""The least group of cells like a roof (m²), the share of such cells around those that a core grows over, and
how far and by what step in height the rim grows (m)."""


@dataclass(frozen=True, eq=False)
class SurfaceGrid:
    """Square cells with the surface and its height over the terrain, (H, W) each; NaN far from any point."""

    cells: Cells
    surface: Values
    height: Values

    @property
    def side(self) -> float:
        """Side of a cell (m)."""
        return self.cells.side

    def high(self, least: float) -> Mask:
        """The cells (H, W) at least so high (m) over the terrain."""
        return np.nan_to_num(self.height, nan=-np.inf) >= least


class SurfaceDetector(Detector):
    """A detector that finds cores of roof on the grid of the surface, and grows them."""

    cell: float | None = parameter(
        None, "Side of a cell; default: the spacing, at least 0.5.", unit="m", gt=0.0
    )
    min_height: float = parameter(
        MIN_HEIGHT_M, "Least height over the terrain: lower objects (cars) are removed.", unit="m", ge=0.0
    )
    min_area: float = parameter(GROUP_M2, "Smaller groups of cells are vegetation.", unit="m²", ge=0.0)
    window: float = parameter(
        3.5, "Side of the window in which the cells like a roof are counted.", unit="m", gt=0.0
    )
    min_share: float = parameter(
        LIKE_SHARE, "Cores grow over cells around which this share is like a roof.", off=1.0, ge=0.0, le=1.0
    )
    storey: float = parameter(
        STOREY_M, "Largest step in height between the parts of a building.", unit="m", gt=0.0
    )
    max_step: float = parameter(RIM_M, "Largest step in height at the rim.", unit="m", gt=0.0)
    regrow: float = parameter(RIM_M, "Distance by which the rim grows.", unit="m", off=0.0, ge=0.0)

    @property
    def buffer(self) -> float:
        return 30.0

    def label(self, scene: Scene, emit: Emit = ignore) -> Regions:
        grid = nearest_surface(scene, self.cell or side_near(max(0.5, self.usual_cell(scene.spacing))))
        if grid is None:
            return Regions(np.zeros(len(scene.cloud), np.int32), np.zeros(0))
        label, score = self.groups(scene, grid, grid.high(self.min_height), emit)
        number = np.zeros(len(scene.cloud), np.int32)
        used = np.flatnonzero(~scene.cloud.noise)
        inside = label.ravel()[grid.cells.cell]
        roof = (inside > 0) & (scene.height[used] >= self.min_height) & ~scene.cloud.ground[used]
        number[used[roof]] = inside[roof]
        return Regions(number, score, np.where(number > 0, ROOF, 0).astype(np.uint8))

    def usual_cell(self, spacing: float) -> float:
        """Side (m) of a cell in a scan of that spacing (m); see the parameter."""
        return spacing

    def groups(self, scene: Scene, grid: SurfaceGrid, high: Mask, emit: Emit) -> tuple[Labels, Values]:
        """Numbers (H, W) of the buildings 1…K among the `high` cells (H, W), and their scores (K,)."""
        raise NotImplementedError

    def grown(self, grid: SurfaceGrid, core: Mask, like: Mask, mixed: Mask, among: Mask) -> Mask:
        """The core (H, W) grown, by up to a storey, over `mixed` cells around which enough of the cells
        `among` are like a roof; (H, W) each."""
        share = share_around(like, among, round(self.window / grid.side))
        rounds = int((self.buffer - 10.0) / grid.side)
        return grow_back(core, mixed & (share >= self.min_share), grid.surface, self.storey, rounds)

    def with_rim(self, grid: SurfaceGrid, grown: Mask, allowed: Mask) -> Mask:
        """The grown cells (H, W), with the rim that is allowed (H, W)."""
        return grow_back(grown, allowed, grid.surface, self.max_step, round(self.regrow / grid.side))


def nearest_surface(scene: Scene, side: float) -> SurfaceGrid | None:
    """The surface by nearest neighbour, which keeps the jump at walls; None without points.

    Each cell takes the highest of its points, or the height of the nearest point up to three cells from its
    middle.
    """
    used = np.flatnonzero(~scene.cloud.noise)
    if len(used) < LEAST_POINTS:
        return None
    xyz = scene.cloud.xyz[used]
    cells = Cells.of(xyz, side, margin=2)
    surface = cells.extreme(xyz[:, 2])
    empty = np.flatnonzero(~np.isfinite(surface))
    surface[empty] = np.nan
    if len(empty):
        answer = cKDTree(xyz[:, :2]).query(cells.centres(empty), distance_upper_bound=3.0 * side)
        distance, nearest = np.asarray(answer[0]), np.asarray(answer[1])
        near = np.isfinite(distance)
        surface[empty[near]] = xyz[nearest[near], 2]
    terrain = scene.dtm.at(cells.centres(np.arange(cells.size)))
    return SurfaceGrid(cells, surface.reshape(cells.shape), (surface - terrain).reshape(cells.shape))


def connected(mask: Mask) -> tuple[Labels, int]:
    """Numbers (H, W) of the connected groups (eight neighbours) of a mask, and how many there are."""
    label, count = ndimage.label(mask, np.ones((3, 3)))
    return np.asarray(label, np.int32), int(count)


def opened_by_area(mask: Mask, least: float) -> Mask:
    """The connected groups (eight neighbours) of a mask (H, W) with at least so many cells."""
    label, count = connected(mask)
    size = np.bincount(label.ravel(), minlength=count + 1)
    keep = size >= least
    keep[0] = False
    return np.asarray(keep[label], np.bool_)


def grow_back(core: Mask, allowed: Mask, surface: Values, max_step: float, rounds: int) -> Mask:
    """The core (H, W) grown cell by cell into `allowed` where the surface steps by less than `max_step` (m).

    It stops when nothing grows, or after so many rounds: what was shrunk is grown back, and no more.
    """
    grown = core.copy()
    for _ in range(rounds):
        reached = np.zeros_like(grown)
        padded, heights = np.pad(grown, 1), np.pad(surface, 1, constant_values=np.nan)
        for row, column in ((0, 1), (2, 1), (1, 0), (1, 2)):
            window = (slice(row, row + core.shape[0]), slice(column, column + core.shape[1]))
            step = np.nan_to_num(np.abs(heights[window] - surface), nan=np.inf)
            reached |= padded[window] & (step < max_step)
        reached &= allowed & ~grown
        if not reached.any():
            break
        grown |= reached
    return grown


def share_around(mask: Mask, among: Mask, width: int) -> Values:
    """Share (H, W) of the cells `among` in a window of `width` cells that are set in a mask (H, W)."""
    size = 2 * (width // 2) + 1
    hits = ndimage.uniform_filter((mask & among).astype(np.float64), size, mode="constant")
    every = ndimage.uniform_filter(among.astype(np.float64), size, mode="constant")
    # a running sum leaves a rounding error where nothing is; a window holds whole cells
    return np.asarray(np.round(hits * size**2) / np.maximum(np.round(every * size**2), 1.0), np.float64)


def height_error(grid: SurfaceGrid, spacing: float) -> float:
    """Error (m) of the height of a cell on a roof of 45°.

    The highest of n points of a cell lies 1/(n + 1) of its side from the upper rim, give or take as much.
    """
    return grid.side / ((grid.side / spacing) ** 2 + 1.0)


def surface_noise(feature: Values, grid: SurfaceGrid, below: float) -> float:
    """The noise of a feature (m, (H, W)) of a surface: its lower quartile on level ground.

    Ground under `below` (m) is the one surface of a scan that is as smooth as its ranges are; a quartile
    leaves kerbs, cars and the rims of everything out.
    """
    ground = feature[np.isfinite(grid.height) & (np.abs(np.nan_to_num(grid.height)) < below)]
    return float(np.quantile(ground, 0.25)) if len(ground) else 0.0


def mean_in(label: Labels, count: int, values: Values | Mask) -> Values:
    """Mean of values, or share of a mask, in each segment 1…`count` of labels: of cells (H, W), or of some of
    them (K,)."""
    size = np.bincount(label.ravel(), minlength=count + 1)[1:]
    total = np.bincount(label.ravel(), weights=values.ravel(), minlength=count + 1)[1:]
    return np.asarray(total / np.maximum(size, 1), np.float64)


def filled(surface: Values) -> Values:
    """The surface (H, W) with its gaps taken from the nearest cell."""
    gap = ~np.isfinite(surface)
    if not gap.any() or gap.all():
        return np.nan_to_num(surface)
    nearest = ndimage.distance_transform_edt(gap, return_distances=False, return_indices=True)
    return np.asarray(surface[tuple(nearest)], np.float64)
