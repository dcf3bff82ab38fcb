"""Surfaces of any width that stand over the terrain: vertical steps all round, and no way up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from eaves.geometry.components import connected_groups_kernel
from eaves.kernels import kernel
from eaves.methods import Method, parameter
from eaves.model import Grid, Labels, Mask, Values
from eaves.raster.nearest import nearest_cells

Integers = NDArray[np.int64]

UNKNOWN, DOWN, UP, LEVEL, VOID = KINDS = range(5)
KIND_COUNT = len(KINDS)
"""Kinds of what lies beyond a piece of rim; void, where nothing was measured at all."""
LOOK_CELLS = 2
"""What is beyond a rim is looked for so far: walls and eaves hide the ground at their foot. The terrain
beneath a raised surface is drawn from that as near; cells of none within twice as much are its parapets."""


class PlateauRules(Method):
    """When a surface stands over the terrain."""

    wall: float = parameter(
        2.0,
        "Least height of the walls of a surface that stands on the terrain, or the side of a cell where that "
        "is more; half as much parts surfaces.",
        unit="m",
        gt=0,
    )
    wall_share: float = parameter(
        0.85, "Share of its rim to the terrain that must be walls, where it is known.", gt=0, le=1
    )
    rim_known: float = parameter(
        0.3, "Least share of its rim that must face terrain, where little of it faces nothing.", ge=0, le=1
    )
    rim_void: float = parameter(
        0.4, "Largest share of its rim beyond which nothing was measured.", ge=0, le=1
    )
    wide_area: float = parameter(
        200.0, "Smaller surfaces are left to the opening, and it has the last word on them.", unit="m²", gt=0
    )


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

    def rims(self, which: Mask) -> Values:
        """Sides of cells of each surface (K + 1, KINDS) by kind, counting the contacts (E,) picked."""
        key = self.contacts[which, 0] * KIND_COUNT + self.contacts[which, 2]
        rims = np.bincount(key, self.length[which], KIND_COUNT * len(self.area))
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
    known = np.isfinite(heights)
    z = np.where(known, heights, ndimage.minimum_filter(np.where(known, heights, np.inf), 3))
    z = np.where(np.isfinite(z), z, np.nan).astype(np.float32)
    square, count = ndimage.label(squares_kernel(z, np.float32(step)))
    label = cells_kernel(np.asarray(square, np.int32))
    area = np.bincount(label.ravel(), minlength=count + 1).astype(np.float64) * cell * cell
    area[0] = 0.0
    sides = rim_kernel(z, known, label, LOOK_CELLS, max(rules.wall, cell), step)
    key, length = np.unique(sides, return_counts=True)
    one, rest = np.divmod(key, KIND_COUNT * (count + 1))
    contacts = np.stack([one, rest // KIND_COUNT, rest % KIND_COUNT], axis=-1)
    return Surfaces(cell, z, label, np.asarray(area, np.float64), contacts, length.astype(np.float64))


def judge_surfaces(surfaces: Surfaces, rules: PlateauRules) -> PlateauVerdict:
    """Verdict on surfaces: which are terrain, and which stand over it.

    The widest surface is terrain, and so are low ones that hardly step down, such as courtyards. All others
    are taken for raised, in groups of those that touch, until their boundary contradicts it: a surface that
    meets terrain is terrain too unless `wall_share` of what is known steps down to it by a wall; so is one in
    a group whose outer rim does not, or is hardly known. What is low in terrain's company no longer is a
    wall's foot, so the strongest contradictions come first.
    """
    area, contacts = surfaces.area, surfaces.contacts
    one, other, _ = contacts.T
    wide = area >= rules.wide_area
    everything = surfaces.rims(np.ones(len(contacts), bool))
    rim, stepped = everything.sum(axis=1), everything[:, DOWN:VOID].sum(axis=1)
    widest = int(np.argmax(area))
    terrain = wide & (everything[:, DOWN] <= (1.0 - rules.wall_share) * stepped)
    terrain &= height_over(surfaces, widest, terrain) < rules.wall
    terrain[widest] = True
    terrain[0] = False
    while True:
        facing = surfaces.rims(terrain[other] & (other > 0))
        met = facing[:, DOWN:VOID].sum(axis=1)
        share = facing[:, DOWN] / np.maximum(met, 1.0)
        joined = facing[:, LEVEL] + facing[:, UP]
        # little of a rim need meet terrain where a third of that is joined to it
        heard = np.maximum(met, 3 * joined) >= (1.0 - rules.wall_share) * rim
        objects = ~terrain & wide & heard & (met > 0) & (share < rules.wall_share)
        if objects.any():
            terrain |= objects & (share <= max(0.5, float(share[objects].min())))
            continue
        inner = ~terrain[one] & ~terrain[other] & (other > 0)
        group = connected_groups_kernel(one[inner], other[inner], len(area))
        count = int(group.max()) + 1
        down, together, void, outer = (
            np.bincount(group, np.where(terrain, 0.0, of), count)
            for of in (facing[:, DOWN], met, everything[:, VOID], rim)
        )
        outer -= np.bincount(group[one[inner]], surfaces.length[inner], count)
        outer = np.maximum(outer, 1.0)
        known = (together >= rules.rim_known * outer) & (void <= rules.rim_void * outer)
        stands = known & (down >= rules.wall_share * together)
        objects = ~terrain & wide & ~stands[group]
        if not objects.any():
            break
        first = np.where(met > 0, share, 2.0)
        terrain |= objects & (first <= max(0.5, float(first[objects].min())))
    has_wide = np.bincount(group, ~terrain & wide, count) > 0
    raised = ~terrain & (stands & has_wide)[group]
    # a scrap goes with its group unless it meets the terrain without a wall, or lies low in the group
    low = np.where(met > 0, share < rules.wall_share, everything[:, DOWN] < 0.5 * stepped)
    raised &= wide | ~low
    raised[0] = False
    return PlateauVerdict(terrain, raised)


def height_over(surfaces: Surfaces, base: int, wanted: Mask) -> Values:
    """Height (K + 1,) of each wanted surface over the surface `base` where they are nearest; 0 for the
    others.
    """
    over = np.zeros(len(surfaces.area))
    at = np.flatnonzero(wanted[surfaces.label])
    if len(at) == 0:
        return over
    there = surfaces.label == base
    rows, columns = np.divmod(at, there.shape[1])
    near_rows, near_columns = nearest_cells(there, rows, columns)
    away = np.hypot(near_rows - rows, near_columns - columns)
    own = surfaces.label.ravel()[at]
    order = np.lexsort((at, away, own))
    first = order[np.r_[True, np.diff(own[order]) > 0]]
    over[own[first]] = surfaces.z.ravel()[at[first]] - surfaces.z[near_rows[first], near_columns[first]]
    return over


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
def rim_kernel(z: Grid, known: Mask, label: Labels, looks: int, down: float, step: float) -> Integers:
    """For each side of a cell (H, W) on a surface's rim: surface, surface beyond, and kind, as one number.

    The first surface within `looks` cells is what is beyond; one's own means that there is no rim.
    """
    rows, columns = z.shape
    count = np.int64(label.max()) + 1
    found = np.empty(4 * rows * columns, np.int64)
    used = 0
    for row in range(rows):
        for column in range(columns):
            mine = label[row, column]
            if mine == 0:
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
                        kind = UNKNOWN if known[r, c] else kind
                        continue
                    if label[r, c] == mine:
                        beyond = mine
                        break
                    if not known[r, c]:
                        continue
                    beyond = label[r, c]
                    fall = z[row, column] - z[r, c]
                    kind = DOWN if fall >= down else (UP if fall <= -step else LEVEL)
                    break
                if beyond != mine:
                    found[used] = (mine * count + beyond) * KIND_COUNT + kind
                    used += 1
    return found[:used].copy()
