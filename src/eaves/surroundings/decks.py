"""Water and bridges: wide low holes in the data, and level strips between falls that terrain carries on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from eaves.ground.toolkit.floor import Floor
from eaves.ground.toolkit.wide_objects import Patch
from eaves.kernels import kernel
from eaves.model import Bounds, Grid, Labels, Mask, PointCloud, Values
from eaves.model.cloud import BRIDGE_DECK, GRID_STEP, WATER
from eaves.model.doubt import Doubt
from eaves.raster.groups import group_cells, neighbour_pairs, steps_within
from eaves.raster.squares import closed_by_square, grown_by_square, opened_by_square

LINES = ((0, 1), (1, 1), (1, 0), (1, -1))
"""Four lines through a cell: one of them crosses any strip at an angle of 67° or more."""
OPEN, FALL, WET = 0, 1, 2
"""What ends a level run: neither of the others; known ground well below; a wide hole in the data."""
STAGE = "classes"
Classes = NDArray[np.uint8]


@dataclass(frozen=True)
class DeckRules:
    """What counts as the deck of a bridge; lengths in m. Chosen on `delft` and `autzen`, by eye."""

    around: float = 120.0
    """So far from a place its deck is followed."""
    widest: float = 30.0
    """Six lanes and two footways; what is wider is terrain or a roof."""
    step: float = 0.5
    """A surface goes on from cell to cell up to this rise: a kerb, or a slope of one in three."""
    gap: int = 2
    """Cells so near continue each other: a railing or an echo gone astray spoils one between."""
    fall: float = 2.0
    """Known ground beside a deck lies deeper by so much, within two cells: a person walks beneath. A bank of
    earth, one in two at the most, falls less in two cells of 1.5 m."""
    water_fall: float = 0.7
    """Where nothing returns beside a deck, the lowest rim near by lies deeper by so much."""
    faint: float = 0.4
    """Next to a deck, within `gap` cells, so much of either fall is enough: its ends lie low."""
    water_width: float = 4.5
    """A hole in the data is water when a square so wide fits in: the shadow of a wall is narrower."""
    water_near: float = 12.0
    """The rim of a hole is looked for within so much."""
    least_area: float = 10.0
    """A smaller strip (m²) is no bridge, but a boat or a stair."""
    terrain_area: float = 300.0
    """A deck's ends join a surface of at least so many m²."""
    over_water: float = 0.8
    """With water along so much of both sides one joined end is enough: the other may be a stair, or lie
    beyond the data."""
    water_share: float = 0.4
    """Cells among those of a hole that hold less than this share of the usual points are water ..."""
    water_flat: float = 0.3
    """... if they lie no higher over the lowest near by: what returns from water is gapped and flat."""
    on_deck: float = 0.5
    """A point within so much of the height of a deck's cell is on it: not a person, nor a railing's top."""
    steepest: float = 0.15
    """A deck leans less on the whole; rows of seats and ramps to a roof lean more."""
    slender: float = 2.5
    """A strip joined at one end alone, so many times longer than wide, may be a bridge or a building."""


RULES = DeckRules()


@dataclass(frozen=True, eq=False)
class Decks:
    """Decks in cells (H, W) of a side `cell` (m), numbered as in `Floor`.

    `level` is the height of the deck, NaN where there is none; `base` how low a point may lie that is of it:
    over water nothing else lies beneath its edge. `water` is how high a point of water may lie, or NaN.
    """

    west: int
    north: int
    cell: float
    level: Grid
    base: Grid
    water: Grid
    doubts: tuple[Doubt, ...] = ()

    def cropped(self, bounds: Bounds) -> Decks:
        """The cells within `bounds` (world metres, whole cells)."""
        first, last = round(bounds.west / self.cell), round(bounds.east / self.cell)
        bottom, top = round(bounds.south / self.cell), round(bounds.north / self.cell) - 1
        rows = slice(max(0, self.north - top), max(0, self.north - bottom + 1))
        columns = slice(max(0, first - self.west), max(0, last - self.west))
        inside = tuple(
            one
            for one in self.doubts
            if bounds.west <= one.x < bounds.east and bounds.south <= one.y < bounds.north
        )
        west, north = max(self.west, first), min(self.north, top)
        level, base, water = (grid[rows, columns].copy() for grid in (self.level, self.base, self.water))
        return Decks(west, north, self.cell, level, base, water, inside)


def look_around(
    floor: Floor, bounds: Bounds, raised: Patch | None, rules: DeckRules = RULES
) -> tuple[Decks, Mask]:
    """All that decides the decks within `bounds`: heights (`level`) and counts (`water`) of the cells seen
    from there, and in which of them (H, W) something stands over the terrain (`raised`)."""
    floor = floor.in_wide_cells()
    heights = floor.heights()
    seen = Decks(floor.west, floor.north, floor.cell, heights, heights, floor.count.astype(np.float32))
    seen = seen.cropped(bounds.buffered(rules.around))
    return seen, raised_in(seen, raised)


def decks_of(seen: Decks, roofs: Mask, bounds: Bounds, rules: DeckRules = RULES) -> Decks:
    """The decks within `bounds`, of what `look_around` saw from there."""
    level, base, doubts = find_decks(seen.level, seen.cell, roofs, rules)
    placed = tuple(one.translated(seen.west * seen.cell, (seen.north + 1) * seen.cell) for one in doubts)
    wet = water_heights(seen.level, seen.water, seen.cell, rules)
    return Decks(seen.west, seen.north, seen.cell, level, base, wet, placed).cropped(bounds)


def raised_in(seen: Decks, raised: Patch | None) -> Mask:
    """The cells (H, W) in which something stands over the terrain."""
    roofs = np.zeros(seen.level.shape, bool)
    if raised is None:
        return roofs
    rows, columns = np.nonzero(np.isfinite(raised.ceiling))
    north, east = (raised.north - rows + 0.5) * raised.cell, (raised.west + columns + 0.5) * raised.cell
    row = seen.north - np.floor(north / seen.cell).astype(np.int64)
    column = np.floor(east / seen.cell).astype(np.int64) - seen.west
    height, width = seen.level.shape
    inside = (row >= 0) & (column >= 0) & (row < height) & (column < width)
    roofs[row[inside], column[inside]] = True
    return roofs


def wet_or_bridged(cloud: PointCloud, decks: Sequence[Decks], rules: DeckRules = RULES) -> Classes:
    """`BRIDGE_DECK` or `WATER` for the points (N,) of a cloud on either, 0 for the others."""
    found = np.zeros(len(cloud), np.uint8)
    for one in decks:
        said = np.isfinite(one.level) | np.isfinite(one.water)
        if not said.any():
            continue
        rows, columns = (np.flatnonzero(said.any(axis=axis)) for axis in (1, 0))
        west, south = (one.west + columns[0]) * one.cell, (one.north - rows[-1]) * one.cell
        east, north = (one.west + columns[-1] + 1) * one.cell, (one.north - rows[0] + 1) * one.cell
        near = Bounds(west, south, east, north).translated(-cloud.origin[0], -cloud.origin[1])
        there = np.flatnonzero(near.buffered(one.cell).contains(cloud.xyz))
        right, up = (round(value / GRID_STEP) for value in cloud.origin)
        side = round(one.cell / GRID_STEP)
        column = (np.rint(cloud.xyz[there, 0] / GRID_STEP).astype(np.int64) + right) // side - one.west
        row = one.north - (np.rint(cloud.xyz[there, 1] / GRID_STEP).astype(np.int64) + up) // side
        inside = (row >= 0) & (column >= 0) & (row < said.shape[0]) & (column < said.shape[1])
        there, place = there[inside], (row[inside], column[inside])
        z = cloud.xyz[there, 2]
        with np.errstate(invalid="ignore"):
            found[there[z <= one.water[place]]] = WATER
            on = (z <= one.level[place] + rules.on_deck) & (z >= one.base[place])
        found[there[on]] = BRIDGE_DECK
    return found


def water_heights(heights: Grid, count: Grid, cell: float, rules: DeckRules) -> Grid:
    """How high (H, W) a point of water may lie, NaN where there is none: in cells of a wide hole and the few
    cells in it that something returned from, low, flat and gapped."""
    hole, lowest = water_of(heights, cell, rules)
    known = np.isfinite(heights)
    side = max(2, round(rules.water_width / cell))
    among = closed_by_square(np.pad(hole, side), side)[side:-side, side:-side]
    few = count <= rules.water_share * np.median(count[known]) if known.any() else known
    wet = among & known & few & (heights <= lowest + rules.water_flat)
    return np.where(wet, lowest + rules.water_flat, np.nan).astype(np.float32)


def find_decks(
    heights: Grid, cell: float, roofs: Mask, rules: DeckRules = RULES
) -> tuple[Grid, Grid, list[Doubt]]:
    """The height (H, W) of the decks among the lowest heights (H, W) of cells of a side (m), NaN elsewhere,
    and how low their points may lie (H, W).

    `roofs` marks cells known to be no terrain. Doubts count metres from the north-west corner of the cells.
    """
    known = np.isfinite(heights)
    water, level = water_of(heights, cell, rules)
    z = np.where(known, heights, np.where(water, level, np.nan)).astype(np.float32)
    between, sides, line = find_between(z, water, cell, rules)
    land = terrain_beside(z, known & ~between & ~roofs, cell, rules)
    joined = extended_deck(z, land, rules)
    label, _ = even_groups(z, between, rules.step, rules.gap)
    deck, wet, doubts = np.zeros(known.shape, bool), np.zeros(known.shape, bool), []
    for number, window in enumerate(ndimage.find_objects(label), 1):
        rows, columns = (slice(max(0, one.start - 3), one.stop + 3) for one in window)
        here = (rows, columns)
        mine = label[here] == number
        area = float(mine.sum()) * cell * cell
        if area < rules.least_area or not joined[here][mine].any():
            continue
        ends, length, middle, lean = deck_ends(mine, z[here], joined[here], line[here])
        if lean > rules.steepest * cell:
            continue
        over_water = bool((sides[here][mine] == WET).mean() >= rules.over_water)
        if ends == 2 or (ends == 1 and over_water):
            deck[here] |= mine
            wet[here] |= mine & over_water
        elif (
            ends == 1
            and length * cell * length * cell >= rules.slender * area
            and area >= 4 * rules.least_area
        ):
            x, y = (columns.start + middle[1] + 0.5) * cell, -(rows.start + middle[0] + 0.5) * cell
            reason = "a bridge or a building: it falls off along both sides, and terrain carries on one end"
            doubts.append(Doubt(round(x, 2), round(y, 2), area, reason, STAGE))
    faint, *_ = find_between(z, water, cell, rules, rules.faint)
    edge = beside_falls(
        z, water, np.float32(rules.step), np.float32(rules.fall), np.float32(rules.water_fall)
    )
    edge &= grown_by_square(deck, 3)
    deck = grown_deck(deck, z, (faint | edge) & ~roofs, rules)
    level = with_edges(np.where(deck, heights, np.nan), z, land, rules)
    wet = grown_by_square(wet, 2 * rules.gap + 1) & np.isfinite(level)
    base = np.where(wet, -np.inf, level - rules.on_deck)
    return level.astype(np.float32), base.astype(np.float32), doubts


def grown_deck(deck: Mask, z: Grid, allowed: Mask, rules: DeckRules) -> Mask:
    """Decks (H, W) with the cells next to them that go on from them, of those allowed."""
    reach = grown_by_square(deck, 2 * rules.gap + 1) & (allowed | deck)
    label, _ = even_groups(z, reach, rules.step, 1)
    with_deck = np.unique(label[deck])
    return np.asarray(np.isin(label, with_deck[with_deck > 0]))


def with_edges(found: Grid, z: Grid, land: Mask, rules: DeckRules) -> Grid:
    """The heights (H, W) of decks with the cells at their edges, whose lowest points lie beneath."""
    known = np.isfinite(found)
    top = ndimage.maximum_filter(np.where(known, found, -np.inf), 3)
    near = ~known & np.isfinite(top)
    lower = ~np.isfinite(z) | (top - np.nan_to_num(z) >= rules.water_fall)
    # a railing's foot or an echo gone astray leaves single cells open
    closed = closed_by_square(np.pad(known, 2), 3)[2:-2, 2:-2]
    return np.asarray(np.where(near & (lower | (closed & ~land)), top, found))


def water_of(heights: Grid, cell: float, rules: DeckRules) -> tuple[Mask, Grid]:
    """The wide holes (H, W) inside the data, and the height (H, W) of the lowest rim near each cell."""
    known = np.isfinite(heights)
    side = max(2, round(rules.water_width / cell))
    hole = ~known & inside_data(known)
    core = opened_by_square(hole, side)
    wide = ndimage.binary_propagation(core, np.ones((3, 3)), mask=hole)
    around = 2 * round(rules.water_near / cell) + 1
    lowest = ndimage.minimum_filter(np.where(known, heights, np.inf), around)
    return np.asarray(wide & np.isfinite(lowest)), lowest


def inside_data(known: Mask) -> Mask:
    """The cells (H, W) that lie between known ones along one of the four lines."""
    inside = np.zeros(known.shape, bool)
    for down, right in LINES:
        inside |= seen_along(known, down, right) & seen_along(known[::-1, ::-1], down, right)[::-1, ::-1]
    return inside


@kernel
def seen_along(known: Mask, down: int, right: int) -> Mask:
    """Which cells (H, W) have a known one before them on the line through them, or are known."""
    rows, columns = known.shape
    seen = known.copy()
    for row in range(rows):
        for step in range(columns):
            column = step if right >= 0 else columns - 1 - step
            y, x = row - down, column - right
            if 0 <= y < rows and 0 <= x < columns and seen[y, x]:
                seen[row, column] = True
    return seen


def find_between(
    z: Grid, water: Mask, cell: float, rules: DeckRules, share: float = 1.0
) -> tuple[Mask, NDArray[np.uint8], NDArray[np.uint8]]:
    """The cells (H, W) between two falls no farther apart than a deck is wide, what is beside them, and which
    of the lines is the shortest across; a `share` of the falls is enough."""
    between, sides = np.zeros(z.shape, bool), np.zeros(z.shape, np.uint8)
    shortest, line = np.full(z.shape, np.inf, np.float32), np.zeros(z.shape, np.uint8)
    falls = np.float32(share * rules.fall), np.float32(share * rules.water_fall)
    for number, (down, right) in enumerate(LINES):
        slant = float(np.hypot(down, right))
        most = max(1, int(rules.widest / (cell * slant)))
        step = np.float32(rules.step * slant)
        between_kernel(z, water, down, right, most, step, *falls, between, sides, shortest, line, number)
    return between, sides, line


def terrain_beside(z: Grid, level: Mask, cell: float, rules: DeckRules) -> Mask:
    """The cells (H, W) of broad surfaces among those of a mask."""
    label, count = even_groups(z, level, rules.step, 1)
    broad = np.bincount(label.ravel(), minlength=count + 1) * cell * cell >= rules.terrain_area
    broad[0] = False
    return np.asarray(broad[label])


def extended_deck(z: Grid, land: Mask, rules: DeckRules) -> Mask:
    """The cells (H, W) that land within `gap` cells carries on, a step up or down."""
    rows, columns, gap = *z.shape, rules.gap
    wide_z, wide_land = np.pad(z, gap, constant_values=np.nan), np.pad(land, gap)
    joined = np.zeros(z.shape, bool)
    for down in range(2 * gap + 1):
        for right in range(2 * gap + 1):
            there = np.s_[down : down + rows, right : right + columns]
            joined |= wide_land[there] & (np.abs(wide_z[there] - z) <= rules.step)
    return joined


def deck_ends(mine: Mask, z: Grid, joined: Mask, line: NDArray[np.uint8]) -> tuple[int, float, Values, float]:
    """How many ends of a strip of cells (H, W) land carries on, of those it does (`joined`); its length
    (cells), its middle (2,), and how much its plane rises from cell to cell (m).

    It runs at right angles to the mean of the lines that are the shortest across its cells.
    """
    rows, columns = np.nonzero(mine)
    middle = np.array([rows.mean(), columns.mean()])
    away = np.c_[rows, columns] - middle
    twice = 2.0 * np.array([np.arctan2(down, right) for down, right in LINES])[line[mine]]
    angle = 0.5 * float(np.arctan2(np.sin(twice).mean(), np.cos(twice).mean()))
    axis = np.array([np.cos(angle), -np.sin(angle)])
    along = away @ axis
    low, high = float(along.min()), float(along.max())
    third = (high - low) / 3.0
    meets = joined[mine]
    ends = int((meets & (along <= low + third)).any()) + int((meets & (along >= high - third)).any())
    slopes = np.linalg.lstsq(
        np.c_[rows - middle[0], columns - middle[1]], z[mine] - z[mine].mean(), rcond=None
    )[0]
    return ends, high - low + 1.0, middle, float(np.hypot(*slopes))


def even_groups(z: Grid, mask: Mask, step: float, reach: int) -> tuple[Labels, int]:
    """Numbers (H, W) of the groups of cells of a mask that go on from each other, and how many there are.

    Cells up to `reach` apart go on from each other when they differ by `step` (m) or less.
    """
    one, two = neighbour_pairs(mask, steps=steps_within(reach))
    level = z.ravel()
    joined = np.abs(level[one] - level[two]) <= np.float32(step)
    return group_cells(mask, one[joined], two[joined])


@kernel
def between_kernel(
    z: Grid,
    water: Mask,
    down: int,
    right: int,
    most: int,
    step: float,
    fall: float,
    water_fall: float,
    between: Mask,
    sides: NDArray[np.uint8],
    shortest: Grid,
    line: NDArray[np.uint8],
    number: int,
) -> None:
    """Mark the cells of level runs of at most so many cells that fall off at both ends, along one line."""
    rows, columns = z.shape
    for row in range(rows):
        for column in range(columns):
            if water[row, column] or np.isnan(z[row, column]):
                continue
            back = side_kernel(z, water, row, column, -down, -right, step, fall, water_fall)
            if back == OPEN:
                continue
            for length in range(most):
                r, c = row + length * down, column + length * right
                ahead = side_kernel(z, water, r, c, down, right, step, fall, water_fall)
                if ahead != OPEN:
                    side = WET if back == WET and ahead == WET else FALL
                    across = (length + 1) * np.sqrt(np.float64(down * down + right * right))
                    for k in range(length + 1):
                        y, x = row + k * down, column + k * right
                        between[y, x] = True
                        sides[y, x] = max(sides[y, x], side)
                        if across < shortest[y, x]:
                            shortest[y, x], line[y, x] = across, number
                    break
                y, x = r + down, c + right
                if y < 0 or x < 0 or y >= rows or x >= columns or water[y, x]:
                    break
                if not abs(z[y, x] - z[r, c]) <= step:
                    break


@kernel
def side_kernel(
    z: Grid, water: Mask, row: int, column: int, down: int, right: int, step: float, fall: float, wet: float
) -> int:
    """What is beside a cell in a direction: known ground well below within two cells, water, or neither."""
    rows, columns = z.shape
    for k in range(1, 3):
        y, x = row + k * down, column + k * right
        if y < 0 or x < 0 or y >= rows or x >= columns:
            return OPEN
        if water[y, x]:
            return WET if z[row, column] - z[y, x] >= wet else OPEN
        if np.isnan(z[y, x]):
            continue
        if z[row, column] - z[y, x] >= fall:
            return FALL
        if abs(z[y, x] - z[row, column]) <= step:
            return OPEN
    return OPEN


@kernel
def beside_falls(z: Grid, water: Mask, step: float, fall: float, water_fall: float) -> Mask:
    """The cells (H, W) that fall off on a side."""
    rows, columns = z.shape
    found = np.zeros((rows, columns), np.bool_)
    for row in range(rows):
        for column in range(columns):
            if water[row, column] or np.isnan(z[row, column]):
                continue
            for down, right in ((0, 1), (1, 0), (0, -1), (-1, 0)):
                if side_kernel(z, water, row, column, down, right, step, fall, water_fall) != OPEN:
                    found[row, column] = True
    return found
