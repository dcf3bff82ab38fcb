"""Halls, factories, stadiums: what stands over the terrain, however wide, and the terrain beneath it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from eaves.geometry.inside import connected_groups_kernel
from eaves.ground.toolkit.floor import LEAST_M2, Floor
from eaves.kernels import kernel
from eaves.methods import Method, parameter
from eaves.model import GRID_STEP, Bounds, Doubt, Grid, Integers, Labels, Mask, PointCloud, Points, Values
from eaves.raster.grid import WorldGrids, lowest_in_squares
from eaves.raster.interpolate import ADJOINING, interpolate_cells, near_cells

KINDS = ("unknown", "down", "up", "level", "void")
UNKNOWN, DOWN, UP, LEVEL, VOID = range(len(KINDS))
KIND_COUNT = len(KINDS)
"""Kinds of what lies beyond a piece of rim; void, where nothing was measured at all."""
LOOK_CELLS = 2
"""What is beyond a rim is looked for so far: walls and eaves hide the ground at their foot. The terrain
beneath a raised surface is drawn from that as near; cells of none within twice as much are its parapets."""


class PlateauRules(Method):
    """When a surface stands over the terrain, and how far off it points of it lie."""

    tolerance_gain: float = parameter(7.0, "Tolerance of a surface, in roughnesses.", symbol="t/ρ", gt=0)
    tolerance_least: float = parameter(0.1, "The same, at least.", unit="m", symbol="t", ge=0)
    tolerance_most: float = parameter(0.4, "The same, at most.", unit="m", symbol="t", ge=0)
    wall: float = parameter(
        2.0,
        "Least height of the walls of a surface that stands on the terrain, or the side of a cell where that "
        "is more; half as much parts surfaces.",
        unit="m",
        gt=0,
    )
    up_weight: float = parameter(
        0.5,
        "What a metre of rim that goes up, or to crowns and machines, says for terrain, in metres that step "
        "down.",
        ge=0,
    )
    void_weight: float = parameter(
        0.75, "The same of a metre beyond which nothing was measured, such as the rim of the data.", ge=0
    )
    level_weight: float = parameter(4.0, "The same of a metre that meets terrain level.", ge=0)
    window: float = parameter(
        27.0, "Widest window of the opening; what is wider was found by its walls.", unit="m", gt=0
    )

    @property
    def wide_area(self) -> float:
        """Surfaces (m²) less than half a window long and broad are left to the opening."""
        return (self.window / 2.0) ** 2

    def tolerance(self, roughness: float) -> float:
        """Largest distance, along z, m, from a level surface of what belongs to it."""
        return min(self.tolerance_most, max(self.tolerance_least, self.tolerance_gain * roughness))


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Surfaces numbered from 1: `label` (H, W) of each cell, 0 for none; `area` (K + 1,), m²; and what lies
    beyond their rims.

    `contacts` (E, 3) are surface, surface beyond (0: none), kind; `length` (E,) counts sides of cells.
    """

    cell: float
    z: Grid
    label: Labels
    area: Values
    contacts: Integers
    length: Values

    @property
    def rims(self) -> Values:
        """Sides of cells of each surface (K + 1, KINDS) by kind."""
        key = self.contacts[:, 0] * KIND_COUNT + self.contacts[:, 2]
        rims = np.bincount(key, self.length, KIND_COUNT * len(self.area))
        return np.asarray(rims.reshape(-1, KIND_COUNT), np.float64)


@dataclass(frozen=True, eq=False)
class PlateauVerdict:
    """Of each surface (K + 1,): whether it is terrain, whether it stands over it."""

    terrain: Mask
    raised: Mask


def find_surfaces(heights: Grid, cell: float, rules: PlateauRules) -> Surfaces:
    """The surfaces in lowest heights (H, W), NaN where unknown, of cells of a side (m).

    Squares of two by two cells with no step between them join where they share two cells: a way from one
    surface to another is at least two cells wide.
    """
    step = min(rules.wall, max(rules.wall / 2, cell))
    occupied = np.isfinite(heights)
    z = np.where(occupied, heights, np.float32(np.inf))
    z = np.where(occupied, heights, lowest_in_squares(z, 1))
    z[np.isinf(z)] = np.nan
    square, count = ndimage.label(squares_kernel(z, np.float32(step)))
    label = cells_kernel(square)
    area = np.bincount(label.ravel(), minlength=count + 1).astype(np.float64) * cell * cell
    area[0] = 0.0
    sides = rim_kernel(z, occupied, label, LOOK_CELLS, max(rules.wall, cell))
    key, length = np.unique(sides, return_counts=True)
    surface, code = np.divmod(key, KIND_COUNT * (count + 1))
    contacts = np.stack([surface, code // KIND_COUNT, code % KIND_COUNT], axis=-1)
    return Surfaces(cell, z, label, area, contacts, length.astype(np.float64))


def judge_surfaces(surfaces: Surfaces, rules: PlateauRules) -> PlateauVerdict:
    """Verdict on surfaces: which are terrain, and which stand over it.

    An object steps down on its rim; terrain is what others stand on, and what terrain leads to. So a surface
    is terrain unless more of its rim steps down than is weighed up by what goes up, what is void and what
    meets wide terrain level. The widest is terrain, and what it reaches follows until nothing changes.
    """
    surface, beyond, kind = surfaces.contacts.T
    rims, count = surfaces.rims, len(surfaces.area)
    stands = rims[:, DOWN] - rules.up_weight * (rims[:, UP] + rims[:, UNKNOWN])
    stands -= rules.void_weight * rims[:, VOID]
    wide = surfaces.area >= rules.wide_area
    terrain, before = np.arange(count) == np.argmax(surfaces.area), np.zeros(count, bool)
    while (terrain != before).any():
        before, meets = terrain, (kind == LEVEL) & (terrain & wide)[beyond]
        level = np.bincount(surface[meets], surfaces.length[meets], count)
        terrain = terrain | (stands <= rules.level_weight * level)
        terrain[0] = False
    over = ~terrain
    over[0] = False
    inner = over[surface] & over[beyond]
    group = connected_groups_kernel(surface[inner], beyond[inner], count)
    has_wide = np.bincount(group, over & wide) > 0
    return PlateauVerdict(terrain & wide, over & has_wide[group])


@kernel
def squares_kernel(z: Grid, step: float) -> Mask:
    """Mask (H - 1, W - 1) of the squares of two by two cells (H, W) with no rise over `step` between them."""
    rows, columns = z.shape
    even = np.zeros((max(0, rows - 1), max(0, columns - 1)), np.bool_)
    for row in range(rows - 1):
        for column in range(columns - 1):
            a, b = z[row, column], z[row, column + 1]
            c, d = z[row + 1, column], z[row + 1, column + 1]
            even[row, column] = (
                abs(a - b) <= step and abs(c - d) <= step and abs(a - c) <= step and abs(b - d) <= step
            )
    return even


@kernel
def cells_kernel(square: Labels) -> Labels:
    """Labels (H + 1, W + 1) of the cells of labelled squares (H, W).

    A cell that two surfaces share at a corner goes to the one that is numbered higher.
    """
    rows, columns = square.shape[0] + 1, square.shape[1] + 1
    label = np.zeros((rows, columns), np.int32)
    for row in range(rows - 1):
        for column in range(columns - 1):
            for r in (row, row + 1):
                for c in (column, column + 1):
                    label[r, c] = max(label[r, c], square[row, column])
    return label


@kernel
def rim_kernel(z: Grid, occupied: Mask, label: Labels, looks: int, wall: float) -> Integers:
    """For each side of a cell (H, W) on a surface's rim: surface, surface beyond, and kind, as one number.

    The first surface within `looks` cells is what is beyond; one's own means that there is no rim.
    """
    rows, columns = z.shape
    count = np.int64(label.max()) + 1
    sides = np.empty(4 * rows * columns, np.int64)
    count_sides = 0
    for row in range(rows):
        for column in range(columns):
            surface = label[row, column]
            if surface == 0:
                continue
            for side in range(4):
                dr = 1 if side == 1 else (-1 if side == 3 else 0)
                dc = 1 if side == 0 else (-1 if side == 2 else 0)
                beyond, kind = 0, VOID
                for k in range(1, looks + 1):
                    r, c = row + k * dr, column + k * dc
                    if r < 0 or c < 0 or r >= rows or c >= columns:
                        break
                    if label[r, c] == 0:
                        kind = UNKNOWN if occupied[r, c] else kind
                        continue
                    if label[r, c] == surface:
                        beyond = surface
                        break
                    if not occupied[r, c]:
                        continue
                    beyond = label[r, c]
                    fall = z[row, column] - z[r, c]
                    kind = DOWN if fall >= wall else (UP if fall <= -wall else LEVEL)
                    break
                if beyond != surface:
                    sides[count_sides] = (surface * count + beyond) * KIND_COUNT + kind
                    count_sides += 1
    return sides[:count_sides].copy()


BAND_ROWS = 128
"""Rows of cells for which the patches are compared at once; it bounds memory and decides no result."""
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
        parts = [np.zeros((0, 3))]
        for patch in self.patches:
            inside = np.isfinite(patch.terrain)
            x, y = patch.centres(inside)
            points = np.c_[x - origin[0], y - origin[1], patch.terrain[inside]]
            parts.append(points[bounds.contains(points)])
        return np.concatenate(parts)

    def doubts_in(self, bounds: Bounds) -> tuple[Doubt, ...]:
        """The doubts within `bounds`, world metres."""
        doubts = [doubt for patch in self.patches for doubt in patch.doubts]
        return tuple(doubt for doubt in doubts if bounds.contains(np.array([[doubt.x, doubt.y]]))[0])


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
    doubts = find_doubts(floor, surfaces, verdict, rules.window**2)
    if not raised.any():
        return Patch(floor.west, floor.north, floor.cell, nothing, nothing, doubts=doubts)
    region = near_cells(raised, ADJOINING) | (near_cells(raised, (2 * LOOK_CELLS) ** 2) & ~terrain)
    support = terrain & near_cells(region, LOOK_CELLS**2) & np.isfinite(floor.lowest)
    beneath = nothing
    if support.sum() >= 3:
        hidden = region & ~terrain
        beneath = np.where(hidden, interpolate_cells(surfaces.z, support, hidden), nothing)
    visible = terrain & np.isfinite(surfaces.z)
    ground = np.where(visible, surfaces.z, beneath)
    ceiling = np.where(region, ground + rules.wall / 2 + rise_within(ground), np.nan)
    core = ~near_cells(~raised, ADJOINING)
    return Patch(
        floor.west,
        floor.north,
        floor.cell,
        ceiling.astype(np.float32),
        np.where(core, ground, np.nan).astype(np.float32),
        doubts=doubts,
    )


def rise_within(ground: Grid) -> Grid:
    """Rise (H, W), m, of the terrain within a cell; 0 where it is unknown."""
    if min(ground.shape) < 2:
        return np.zeros_like(ground)
    south, east = np.gradient(ground)
    return np.asarray(np.nan_to_num(np.hypot(south, east)), np.float32)


def find_doubts(floor: Floor, surfaces: Surfaces, verdict: PlateauVerdict, large: float) -> tuple[Doubt, ...]:
    """The surfaces as `large` (m²) or larger that were left in the terrain though more than half of their
    known rim steps down, and islands of data as large as a roof, from `LEAST_M2` to twice as long and broad:
    nothing lower beside tells terrain from a roof, and clips of a scan may hold a roof and nothing else.

    The place of each is that of its cell nearest to its centre.
    """
    everything = surfaces.rims
    rim, stepped = everything.sum(axis=1), everything[:, DOWN:VOID].sum(axis=1)
    share = everything[:, DOWN] / np.maximum(stepped, 1.0)
    doubtful = ~verdict.raised & (share > 0.5) & (surfaces.area >= large)
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
    alone = ~stands & (area >= LEAST_M2) & (area <= 4 * large)
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
    lowest = np.inf
    for height in ceiling.ravel():
        lowest = float(height) if height < lowest else lowest
    for i in range(len(xyz) if lowest < np.inf else 0):
        if xyz[i, 2] <= lowest:
            continue
        column = (np.int64(np.rint(xyz[i, 0] / GRID_STEP)) + right) // side - west
        row = north - (np.int64(np.rint(xyz[i, 1] / GRID_STEP)) + up) // side
        if 0 <= row < rows and 0 <= column < columns and xyz[i, 2] > ceiling[row, column]:
            over[i] = True


@kernel
def middle_kernel(values: NDArray[np.float32]) -> Grid:
    """The middle (H, W) of some values (K, H, W), the upper one of two; NaN is more than any."""
    looks, rows, columns = values.shape
    middle = np.empty((rows, columns), np.float32)
    sorted_values = np.empty(looks, np.float32)
    for row in range(rows):
        for column in range(columns):
            for k in range(looks):
                value, place = values[k, row, column], k
                while place > 0 and (np.isnan(sorted_values[place - 1]) or sorted_values[place - 1] > value):
                    sorted_values[place] = sorted_values[place - 1]
                    place -= 1
                sorted_values[place] = value
            middle[row, column] = sorted_values[looks // 2]
    return middle
