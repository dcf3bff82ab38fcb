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
from eaves.methods import Method, parameter
from eaves.model import BRIDGE_DECK, GRID_STEP, WATER, Bounds, Doubt, Grid, Labels, Mask, PointCloud, Values
from eaves.raster.blur import (
    ONWARD,
    closed_by_square,
    group_cells,
    grown_by_square,
    neighbour_pairs,
    opened_by_square,
    steps_within,
)
from eaves.raster.grid import WorldGrids, highest_in_squares, lowest_in_squares

STAGE = "classes"
Classes = NDArray[np.uint8]


class DeckRules(Method):
    """The limits of decks of bridges, and of water. Chosen on `delft` and `autzen`, by eye."""

    widest: float = parameter(
        30.0,
        "Largest width of a deck, six lanes and two footways: wider is terrain or a roof. A deck is "
        "followed four times as far.",
        unit="m",
        gt=0.0,
    )
    step: float = parameter(
        0.5,
        "Rise up to which a surface continues from cell to cell, and distance within which a point is of "
        "it: a kerb, or a slope of one in three.",
        unit="m",
        gt=0.0,
    )
    fall: float = parameter(
        2.0,
        "Least depth of known ground beside a deck, within two cells: a person walks beneath. A bank of "
        "earth, one in two at the most, falls less in two cells of 1.5 m.",
        unit="m",
        gt=0.0,
    )
    water_fall: float = parameter(
        0.7,
        "Least depth of the lowest rim near by, where nothing returns beside a deck.",
        unit="m",
        gt=0.0,
    )
    water_width: float = parameter(
        4.5,
        "Side of a square that fits into a hole in the data if it is water: the shadow of a wall is "
        "narrower.",
        unit="m",
        gt=0.0,
    )
    water_share: float = parameter(
        0.4, "Share of the usual points below which cells in a hole are water.", ge=0.0
    )
    least_area: float = parameter(
        10.0, "Smallest area of a bridge; a smaller strip is a boat or a stair.", unit="m²", ge=0.0
    )
    terrain_area: float = parameter(
        300.0, "Smallest area of a surface that a deck's ends join.", unit="m²", ge=0.0
    )


RULES = DeckRules()


@dataclass(frozen=True, eq=False)
class Decks(WorldGrids):
    """Decks in cells (H, W) of a side `cell` (m), numbered as in `Floor`.

    `level` is the height of the deck, NaN where there is none; `water` is how high a point of water may lie,
    or NaN.
    """

    level: Grid
    water: Grid


def look_around(
    floor: Floor, bounds: Bounds, raised: Patch | None, rules: DeckRules = RULES
) -> tuple[Decks, Mask]:
    """All that decides the decks within `bounds`: heights (`level`) and counts (`water`) of the cells seen
    from there, and in which of them (H, W) something stands over the terrain (`raised`)."""
    floor = floor.in_wide_cells()
    count = floor.count.astype(np.float32)
    window = Decks(floor.west, floor.north, floor.cell, floor.heights(), count)
    window = window.cropped(bounds.buffered(4.0 * rules.widest))
    return window, raised_in(window, raised)


def decks_of(window: Decks, roofs: Mask, bounds: Bounds, rules: DeckRules = RULES) -> Decks:
    """The decks within `bounds`, of what `look_around` saw from there."""
    level, doubts = find_decks(window.level, window.cell, roofs, rules)
    placed = tuple(
        doubt.translated(window.west * window.cell, (window.north + 1) * window.cell) for doubt in doubts
    )
    wet = water_heights(window.level, window.water, window.cell, rules)
    return Decks(window.west, window.north, window.cell, level, wet, doubts=placed).cropped(bounds)


def raised_in(window: Decks, raised: Patch | None) -> Mask:
    """The cells (H, W) in which something stands over the terrain."""
    roofs = np.zeros(window.level.shape, bool)
    if raised is None:
        return roofs
    east, north = raised.centres(np.isfinite(raised.ceiling))
    row = window.north - np.floor(north / window.cell).astype(np.int64)
    column = np.floor(east / window.cell).astype(np.int64) - window.west
    height, width = window.level.shape
    inside = (row >= 0) & (column >= 0) & (row < height) & (column < width)
    roofs[row[inside], column[inside]] = True
    return roofs


def wet_or_bridged(cloud: PointCloud, decks: Sequence[Decks], rules: DeckRules = RULES) -> Classes:
    """`BRIDGE_DECK` or `WATER` for the points (N,) of a cloud on either, 0 for the others."""
    classes = np.zeros(len(cloud), np.uint8)
    for deck in decks:
        said = np.isfinite(deck.level) | np.isfinite(deck.water)
        if not said.any():
            continue
        rows, columns = (np.flatnonzero(said.any(axis=axis)) for axis in (1, 0))
        west, south = (deck.west + columns[0]) * deck.cell, (deck.north - rows[-1]) * deck.cell
        east, north = (deck.west + columns[-1] + 1) * deck.cell, (deck.north - rows[0] + 1) * deck.cell
        extent = Bounds(west, south, east, north).translated(-cloud.origin[0], -cloud.origin[1])
        points = np.flatnonzero(extent.buffered(deck.cell).contains(cloud.xyz))
        right, up = (round(value / GRID_STEP) for value in cloud.origin)
        side = round(deck.cell / GRID_STEP)
        column = (np.rint(cloud.xyz[points, 0] / GRID_STEP).astype(np.int64) + right) // side - deck.west
        row = deck.north - (np.rint(cloud.xyz[points, 1] / GRID_STEP).astype(np.int64) + up) // side
        inside = (row >= 0) & (column >= 0) & (row < said.shape[0]) & (column < said.shape[1])
        points, place = points[inside], (row[inside], column[inside])
        z = cloud.xyz[points, 2]
        with np.errstate(invalid="ignore"):
            classes[points[z <= deck.water[place]]] = WATER
            on = np.abs(z - deck.level[place]) <= rules.step
        classes[points[on]] = BRIDGE_DECK
    return classes


def water_heights(heights: Grid, count: Grid, cell: float, rules: DeckRules) -> Grid:
    """Greatest height (H, W) of a point of water, NaN where there is none: in cells of a wide hole and the
    few cells in it that something returned from, low, flat and gapped."""
    hole, lowest = water_of(heights, cell, rules)
    finite = np.isfinite(heights)
    side = max(2, round(rules.water_width / cell))
    among = closed_by_square(np.pad(hole, side), side)[side:-side, side:-side]
    few = count <= rules.water_share * np.median(count[finite]) if finite.any() else finite
    wet = among & finite & few & (heights <= lowest + rules.step)
    return np.where(wet, lowest + rules.step, np.nan).astype(np.float32)


def find_decks(heights: Grid, cell: float, roofs: Mask, rules: DeckRules = RULES) -> tuple[Grid, list[Doubt]]:
    """The height (H, W) of the decks among the lowest heights (H, W) of cells of a side (m), NaN elsewhere.

    `roofs` marks cells known to be no terrain. Doubts count metres from the north-west corner of the cells.
    """
    finite = np.isfinite(heights)
    water, level = water_of(heights, cell, rules)
    z = np.where(finite, heights, np.where(water, level, np.nan)).astype(np.float32)
    between, line = find_between(z, water, cell, rules)
    land = terrain_beside(z, finite & ~between & ~roofs, cell, rules)
    joined = extended_deck(z, land, rules)
    label, _ = even_groups(z, between, rules.step, 2)
    deck, doubts = np.zeros(finite.shape, bool), []
    for number, here in enumerate(ndimage.find_objects(label), 1):
        strip = label[here] == number
        area = float(strip.sum()) * cell * cell
        if area < rules.least_area or not joined[here][strip].any():
            continue
        ends, length, middle = deck_ends(strip, joined[here], line[here])
        if ends == 2:
            deck[here] |= strip
        elif (length * cell) ** 2 >= 2.0 * area:
            row, column = (span.start + at + 0.5 for span, at in zip(here, middle, strict=True))
            reason = "a bridge or a building: it falls off along both sides, and terrain carries on one end"
            doubts.append(Doubt(round(column * cell, 2), round(-row * cell, 2), area, reason, STAGE))
    falls = (np.float32(limit) for limit in (rules.step, rules.fall, rules.water_fall))
    edge = beside_falls(z, water, *falls) & grown_by_square(deck, 3)
    deck = grown_deck(deck, z, (between | edge) & ~roofs, rules)
    return with_edges(np.where(deck, heights, np.nan), z, land, rules).astype(np.float32), doubts


def grown_deck(deck: Mask, z: Grid, allowed: Mask, rules: DeckRules) -> Mask:
    """Decks (H, W) with the cells next to them that go on from them, of those allowed."""
    reach = grown_by_square(deck, 5) & (allowed | deck)
    label, _ = even_groups(z, reach, rules.step, 1)
    with_deck = np.unique(label[deck])
    return np.asarray(np.isin(label, with_deck[with_deck > 0]))


def with_edges(deck: Grid, z: Grid, land: Mask, rules: DeckRules) -> Grid:
    """The heights (H, W) of decks with the cells at their edges, whose lowest points lie beneath."""
    finite = np.isfinite(deck)
    top = highest_in_squares(np.where(finite, deck, np.float32(-np.inf)), 1)
    beside = ~finite & np.isfinite(top)
    lower = ~np.isfinite(z) | (top - np.nan_to_num(z) >= rules.water_fall)
    # a railing's foot or a stray echo leaves single cells open
    closed = closed_by_square(np.pad(finite, 2), 3)[2:-2, 2:-2]
    return np.asarray(np.where(beside & (lower | (closed & ~land)), top, deck))


def water_of(heights: Grid, cell: float, rules: DeckRules) -> tuple[Mask, Grid]:
    """The wide holes (H, W) inside the data, and the height (H, W) of the lowest rim near each cell."""
    finite = np.isfinite(heights)
    side = max(2, round(rules.water_width / cell))
    hole = ~finite & inside_data(finite)
    core = opened_by_square(hole, side)
    wide = ndimage.binary_propagation(core, np.ones((3, 3)), mask=hole)
    lowest = lowest_in_squares(np.where(finite, heights, np.float32(np.inf)), round(rules.widest / cell) // 2)
    return np.asarray(wide & np.isfinite(lowest)), lowest


def inside_data(finite: Mask) -> Mask:
    """The cells (H, W) that lie between known ones along their row or their column."""
    inside = np.zeros(finite.shape, bool)
    for axis in (0, 1):
        before, after = (np.logical_or.accumulate(mask, axis) for mask in (finite, np.flip(finite, axis)))
        inside |= before & np.flip(after, axis)
    return inside


def find_between(z: Grid, water: Mask, cell: float, rules: DeckRules) -> tuple[Mask, NDArray[np.uint8]]:
    """The cells (H, W) between two falls no farther apart than a deck is wide, and which of the four lines is
    the shortest across."""
    shortest, line = np.full(z.shape, np.inf, np.float32), np.zeros(z.shape, np.uint8)
    falls = np.float32(rules.fall), np.float32(rules.water_fall)
    for number, (down, right) in enumerate(ONWARD):
        slant = float(np.hypot(down, right))
        most = max(1, int(rules.widest / (cell * slant)))
        between_kernel(
            z, water, down, right, most, np.float32(rules.step * slant), *falls, shortest, line, number
        )
    return np.isfinite(shortest), line


def terrain_beside(z: Grid, level: Mask, cell: float, rules: DeckRules) -> Mask:
    """The cells (H, W) of broad surfaces among those of a mask."""
    label, count = even_groups(z, level, rules.step, 1)
    broad = np.bincount(label.ravel(), minlength=count + 1) * cell * cell >= rules.terrain_area
    broad[0] = False
    return np.asarray(broad[label])


def extended_deck(z: Grid, land: Mask, rules: DeckRules) -> Mask:
    """The cells (H, W) that land within two cells carries on, a step up or down."""
    rows, columns = z.shape
    wide_z, wide_land = np.pad(z, 2, constant_values=np.nan), np.pad(land, 2)
    joined = np.zeros(z.shape, bool)
    for down, right in np.ndindex(5, 5):
        window = np.s_[down : down + rows, right : right + columns]
        joined |= wide_land[window] & (np.abs(wide_z[window] - z) <= rules.step)
    return joined


def deck_ends(strip: Mask, joined: Mask, line: NDArray[np.uint8]) -> tuple[int, float, Values]:
    """Number of ends of a strip of cells (H, W) that meet land, by the cells that do (`joined`); its length
    (cells), its middle (2,).

    It runs at right angles to the mean of the lines that are the shortest across its cells.
    """
    cells = np.argwhere(strip)
    middle = cells.mean(axis=0)
    twice = 2.0 * np.array([np.arctan2(down, right) for down, right in ONWARD])[line[strip]]
    angle = 0.5 * float(np.arctan2(np.sin(twice).mean(), np.cos(twice).mean()))
    along = (cells - middle) @ np.array([np.cos(angle), -np.sin(angle)])
    length, meets = float(np.ptp(along)), along[joined[strip]]
    ends = int((meets - along.min() <= length / 3).any()) + int((along.max() - meets <= length / 3).any())
    return ends, length + 1.0, middle


def even_groups(z: Grid, mask: Mask, step: float, reach: int) -> tuple[Labels, int]:
    """Numbers (H, W) of the groups of cells of a mask that go on from each other, and how many there are.

    Cells up to `reach` apart go on from each other when they differ by `step` (m) or less.
    """
    first, second = neighbour_pairs(mask, steps=steps_within(reach))
    level = z.ravel()
    joined = np.abs(level[first] - level[second]) <= np.float32(step)
    return group_cells(mask, first[joined], second[joined])


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
            if not falls_off(z, water, row, column, -down, -right, step, fall, water_fall):
                continue
            for length in range(most):
                r, c = row + length * down, column + length * right
                if falls_off(z, water, r, c, down, right, step, fall, water_fall):
                    across = (length + 1) * np.sqrt(np.float64(down * down + right * right))
                    for k in range(length + 1):
                        y, x = row + k * down, column + k * right
                        if across < shortest[y, x]:
                            shortest[y, x], line[y, x] = across, number
                    break
                y, x = r + down, c + right
                if y < 0 or x < 0 or y >= rows or x >= columns or water[y, x]:
                    break
                if not abs(z[y, x] - z[r, c]) <= step:
                    break


@kernel
def falls_off(
    z: Grid, water: Mask, row: int, column: int, down: int, right: int, step: float, fall: float, wet: float
) -> bool:
    """True if known ground well below, or water, lies beside a cell in a direction, within two cells."""
    rows, columns = z.shape
    for k in range(1, 3):
        y, x = row + k * down, column + k * right
        if y < 0 or x < 0 or y >= rows or x >= columns:
            return False
        if water[y, x]:
            return bool(z[row, column] - z[y, x] >= wet)
        if z[row, column] - z[y, x] >= fall:
            return True
        if abs(z[y, x] - z[row, column]) <= step:
            return False
    return False


@kernel
def beside_falls(z: Grid, water: Mask, step: float, fall: float, water_fall: float) -> Mask:
    """The cells (H, W) that fall off on a side."""
    rows, columns = z.shape
    beside = np.zeros((rows, columns), np.bool_)
    for row in range(rows):
        for column in range(columns):
            if water[row, column] or np.isnan(z[row, column]):
                continue
            for down, right in ((0, 1), (1, 0), (0, -1), (-1, 0)):
                if falls_off(z, water, row, column, down, right, step, fall, water_fall):
                    beside[row, column] = True
    return beside
