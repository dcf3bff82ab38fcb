"""Halls, factories, stadiums: what stands over the terrain, however wide, and the terrain beneath it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from eaves.ground.toolkit.floor import Floor, WorldGrids
from eaves.ground.toolkit.plateaus import (
    DOWN,
    LOOK_CELLS,
    VOID,
    PlateauRules,
    PlateauVerdict,
    Surfaces,
    find_surfaces,
    judge_surfaces,
)
from eaves.kernels import kernel
from eaves.model import Bounds, Grid, Mask, PointCloud, Points
from eaves.model.cloud import GRID_STEP
from eaves.model.doubt import Doubt
from eaves.raster.interpolate import interpolate_cells
from eaves.raster.nearest import ADJOINING, near_cells

DOUBT_M2 = 500.0
"""Word is given of surfaces so large that were left in the terrain though more than half of their known rim
steps down. It decides what is said, no result."""
ISLAND_M2, ISLAND_MOST_M2 = 50.0, 2_500.0
"""... and of islands of data from 50 m² to 50 by 50 m: nothing lower beside tells terrain from a roof."""
BAND_ROWS = 128
"""Rows of cells for which the patches are compared at once; it bounds memory and decides no result."""
Integers = NDArray[np.int64]
Place = tuple[Integers, ...]


@dataclass(frozen=True, eq=False)
class Patch(WorldGrids):
    """Extrusion surfaces in a rectangle of cells (H, W) of a side `cell` (m), numbered as in `Floor`.

    `ceiling`: the height from which on points are none of the terrain's, NaN where there is nothing raised;
    `terrain`: the height of the terrain well inside a raised surface, NaN elsewhere.
    """

    ceiling: Grid
    terrain: Grid

    def cells_at(self, floor: Floor, rows: Integers, columns: Integers, right: int, up: int) -> Place:
        """Indices of the cells here that hold the cells of a floor in some rows and columns: they are several
        times as wide and counted `right` and `up` of the floor's cells too far.
        """
        times = round(self.cell / floor.cell)
        top = (self.north + 1) * times - 1 - up - floor.north
        left = floor.west + right - self.west * times
        return np.ix_((rows + top) // times, (columns + left) // times)


@dataclass(frozen=True, eq=False)
class WideObjects:
    """Large objects over the terrain in some patches of the world."""

    patches: tuple[Patch, ...] = ()

    def over(self, cloud: PointCloud) -> Mask:
        """The points (N,) of a cloud that stand over the terrain beneath a raised surface."""
        over = np.zeros(len(cloud), bool)
        for patch in self.patches:
            right, up = (round(value / GRID_STEP) for value in cloud.origin)
            about = right, up, round(patch.cell / GRID_STEP), patch.west, patch.north
            over_kernel(cloud.xyz, *about, patch.ceiling, over)
        return over

    def terrain_beneath(self, bounds: Bounds, origin: tuple[float, float]) -> Points:
        """Points (K, 3) of the terrain beneath, those within `bounds`; local metres about `origin`."""
        found = [np.zeros((0, 3))]
        for patch in self.patches:
            rows, columns = np.nonzero(np.isfinite(patch.terrain))
            x = (patch.west + columns + 0.5) * patch.cell - origin[0]
            y = (patch.north - rows + 0.5) * patch.cell - origin[1]
            points = np.c_[x, y, patch.terrain[rows, columns]]
            found.append(points[bounds.contains(points)])
        return np.concatenate(found)

    def doubts_in(self, bounds: Bounds) -> tuple[Doubt, ...]:
        """The doubts within `bounds`, world metres."""
        some = [doubt for patch in self.patches for doubt in patch.doubts]
        return tuple(one for one in some if bounds.contains(np.array([[one.x, one.y]]))[0])


def find_wide_objects(floor: Floor, rules: PlateauRules) -> Patch:
    """Large objects over the terrain on a floor, in its cells.

    Where they hold too few points wider ones are looked at, in all places that their borders can have on
    those of the floor, and most of these places decide: a wide cell at a wall shows what is lower, and where
    it lies decides how much of a lane or a yard between buildings is seen. That costs what one look at the
    floor's own cells does.
    """
    times = round(floor.in_wide_cells().cell / floor.cell)
    if times == 1:
        return find_in_cells(floor, rules)
    places = [(right, up) for right in range(times) for up in range(times)]
    return most_of(
        floor,
        [find_in_cells(floor.in_shifted_cells(times, *place), rules) for place in places],
        places,
    )


def most_of(floor: Floor, patches: Sequence[Patch], places: Sequence[tuple[int, int]]) -> Patch:
    """Majority of several patches, in the cells of a floor. A cell of a patch holds several of these, counted
    so many to the right and up too far; a doubt is said once, and of nothing that is raised.
    """
    rows, columns = floor.shape
    ceiling, terrain = (np.empty(floor.shape, np.float32) for _ in range(2))
    for top in range(0, rows, BAND_ROWS):
        here = np.s_[top : top + BAND_ROWS]
        cells = [
            patch.cells_at(floor, np.arange(rows)[here], np.arange(columns), *place)
            for patch, place in zip(patches, places, strict=True)
        ]
        pairs = list(zip(patches, cells, strict=True))
        ceiling[here] = middle_kernel(np.stack([patch.ceiling[at] for patch, at in pairs]))
        terrain[here] = middle_kernel(np.stack([patch.terrain[at] for patch, at in pairs]))
    doubts: list[Doubt] = []
    for patch, (right, up) in zip(patches, places, strict=True):
        for one in patch.doubts:
            doubt = one.translated(-right * floor.cell, -up * floor.cell)
            row = floor.north - int(np.floor(doubt.y / floor.cell))
            column = int(np.floor(doubt.x / floor.cell)) - floor.west
            row, column = min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)
            apart = float(np.sqrt(doubt.area_m2))
            said = any(np.hypot(doubt.x - other.x, doubt.y - other.y) < apart for other in doubts)
            if not said and not np.isfinite(ceiling[row, column]):
                doubts.append(doubt)
    return Patch(floor.west, floor.north, floor.cell, ceiling, terrain, doubts=tuple(doubts))


def find_in_cells(floor: Floor, rules: PlateauRules) -> Patch:
    """Large objects over the terrain on a floor, seen in its cells as they are."""
    surfaces = find_surfaces(floor.heights(), floor.cell, rules)
    verdict = judge_surfaces(surfaces, rules)
    terrain, raised = verdict.terrain[surfaces.label], verdict.raised[surfaces.label]
    nothing = np.full(floor.shape, np.nan, np.float32)
    doubts = find_doubts(floor, surfaces, verdict)
    if not raised.any():
        return Patch(floor.west, floor.north, floor.cell, nothing, nothing, doubts=doubts)
    inside = raised | enclosed_by_terrain(raised, terrain)
    region = near_cells(inside, ADJOINING) | (near_cells(inside, (2 * LOOK_CELLS) ** 2) & ~terrain)
    support = terrain & near_cells(region, LOOK_CELLS**2) & np.isfinite(floor.lowest)
    beneath = nothing
    if support.sum() >= 3:
        wanted = region & ~terrain
        beneath = np.where(wanted, interpolate_cells(surfaces.z, support, wanted), nothing)
    known = terrain & np.isfinite(surfaces.z)
    ground = np.where(known, surfaces.z, beneath)
    ceiling = np.where(region, ground + rules.wall / 2 + rise_within(ground), np.nan)
    core = ~near_cells(~inside, ADJOINING)
    return Patch(
        floor.west,
        floor.north,
        floor.cell,
        ceiling.astype(np.float32),
        np.where(core, ground, np.nan).astype(np.float32),
        doubts=doubts,
    )


def enclosed_by_terrain(raised: Mask, terrain: Mask) -> Mask:
    """The cells (H, W) in neither that only raised ones enclose: machines, skylights, holes in the data."""
    group, count = ndimage.label(~raised & ~terrain)
    touched = np.bincount(group[near_cells(terrain, 1)], minlength=count + 1) > 0
    around = np.bincount(group[near_cells(raised, 1)], minlength=count + 1) > 0
    inner = around & ~touched
    for side in (group[0], group[-1], group[:, 0], group[:, -1]):
        inner[side] = False
    inner[0] = False
    return np.asarray(inner[group])


def rise_within(ground: Grid) -> Grid:
    """Rise (H, W), m, of the terrain within a cell; 0 where it is unknown."""
    if min(ground.shape) < 2:
        return np.zeros_like(ground)
    south, east = np.gradient(ground)
    return np.asarray(np.nan_to_num(np.hypot(south, east)), np.float32)


def find_doubts(floor: Floor, surfaces: Surfaces, verdict: PlateauVerdict) -> tuple[Doubt, ...]:
    """The large surfaces left in the terrain though much of their rim steps down, and islands of data as
    large as a roof: clips of a scan may hold a roof and nothing else.

    The place of each is that of its cell nearest to its centre.
    """
    everything = surfaces.rims(np.ones(len(surfaces.contacts), bool))
    rim, stepped = everything.sum(axis=1), everything[:, DOWN:VOID].sum(axis=1)
    share = everything[:, DOWN] / np.maximum(stepped, 1.0)
    doubtful = ~verdict.raised & (share > 0.5)
    doubtful &= surfaces.area >= DOUBT_M2
    doubtful[np.argmax(surfaces.area)] = False
    doubts = []
    for k in np.flatnonzero(doubtful):
        cut = everything[k, VOID] > 0.5 * rim[k]
        reason = (
            f"left in the terrain: a surface of {surfaces.area[k]:.0f} m² that steps down on "
            f"{100 * share[k]:.0f} % of its known rim" + (", cut by the rim of the data" if cut else "")
        )
        doubts.append(wide_doubt(floor, surfaces.label == k, reason))
    island, count = ndimage.label(np.isfinite(floor.lowest), np.ones((3, 3)))
    area = np.bincount(island.ravel(), minlength=count + 1) * floor.cell**2
    stands = np.bincount(island[verdict.raised[surfaces.label]], minlength=count + 1) > 0
    alone = ~stands & (area >= ISLAND_M2) & (area <= ISLAND_MOST_M2)
    alone[0] = False
    for k in np.flatnonzero(alone):
        reason = f"left in the terrain: {area[k]:.0f} m² with nothing measured around, which may be a roof"
        doubts.append(wide_doubt(floor, island == k, reason))
    return tuple(doubts)


def wide_doubt(floor: Floor, mask: Mask, reason: str) -> Doubt:
    """A doubt at the cell of a mask (H, W) nearest to its centre."""
    rows, columns = np.nonzero(mask)
    middle = int(np.argmin((rows - rows.mean()) ** 2 + (columns - columns.mean()) ** 2))
    return Doubt(
        x=float((floor.west + columns[middle] + 0.5) * floor.cell),
        y=float((floor.north - rows[middle] + 0.5) * floor.cell),
        area_m2=float(len(rows) * floor.cell**2),
        stage="ground",
        reason=reason,
    )


@kernel
def over_kernel(
    xyz: Points, right: int, up: int, side: int, west: int, north: int, ceiling: Grid, over: Mask
) -> None:
    """Mark in `over` (N,) the points over the ceiling (H, W) of their cells."""
    rows, columns = ceiling.shape
    for i in range(len(xyz)):
        column = (np.int64(np.rint(xyz[i, 0] / GRID_STEP)) + right) // side - west
        row = north - (np.int64(np.rint(xyz[i, 1] / GRID_STEP)) + up) // side
        if 0 <= row < rows and 0 <= column < columns and xyz[i, 2] > ceiling[row, column]:
            over[i] = True


@kernel
def middle_kernel(values: NDArray[np.float32]) -> Grid:
    """The middle (H, W) of some values (K, H, W), the upper one of two; NaN is more than any."""
    looks, rows, columns = values.shape
    middle = np.empty((rows, columns), np.float32)
    one = np.empty(looks, np.float32)
    for row in range(rows):
        for column in range(columns):
            for k in range(looks):
                value, place = values[k, row, column], k
                while place > 0 and (np.isnan(one[place - 1]) or one[place - 1] > value):
                    one[place] = one[place - 1]
                    place -= 1
                one[place] = value
            middle[row, column] = one[looks // 2]
    return middle
