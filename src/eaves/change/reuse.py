"""The buildings of an owner block after an update: those that are as they were keep their results."""

from __future__ import annotations

import math
from collections.abc import Sequence, Set
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from eaves.change.points import COVER_CELL
from eaves.geometry.components import connected_groups_kernel
from eaves.model import Block, Failure, Footprint, Mask, Points
from eaves.model.results import BuildingPoints
from eaves.run.block_file import BORDER
from eaves.run.building_file import SavedBuilding
from eaves.run.gather import MARGIN, Found, Gatherer
from eaves.run.join import BuildingPlan, OwnedBuildings
from eaves.run.recipe import Recipe
from eaves.run.region import compute_buildings
from eaves.run.store import Store
from eaves.run.world_squares import ring

REACH = MARGIN + COVER_CELL
"""Points that come or go so near (m) to a building's own touch it: its terrain is known so far around."""

NEAR_BLOCKS = 12
"""Blocks whose points are kept while those around an owner block are looked at."""

MOVED = 0.05
"""The outline of a neighbour has moved when a corner lies farther (m) from where it was."""

BESIDE = 3.0
"""Buildings so near (m) may share edges: more than twice the spacing of the sparsest scan."""


@dataclass(frozen=True, eq=False)
class Owned:
    """The buildings of one owner block as they are planned now, and what lies across its border."""

    now: OwnedBuildings
    around: tuple[tuple[Block, BuildingPlan], ...]
    """Buildings in several blocks that other owner blocks have now."""
    neighbours: tuple[Block, ...]
    """The owner blocks around it that the earlier run had."""


def plans_to_model(
    now: Sequence[OwnedBuildings],
    before: Sequence[OwnedBuildings],
    owners: Sequence[Block],
    near: Set[Block],
) -> list[Owned]:
    """The owner blocks whose buildings may be touched by points that came or went, also if they own none now.

    Parameters
    ----------
    now, before
        The buildings as the regions are joined now, and as those of the earlier run are.
    owners
        The owner blocks of the earlier run that have results.
    near
        The blocks in which, or near which, points came or went, and into which a building goes on that these
        touch.
    """
    mine: dict[Block, set[Block]] = {}
    for plan in (*now, *before):
        blocks = mine.setdefault(plan.owner_block, {plan.owner_block})
        blocks.update(block for one in plan.buildings for block, _ in one.regions)
    spanning = [
        (plan.owner_block, one)
        for plan in now
        for one in plan.buildings
        if len({block for block, _ in one.regions}) > 1
    ]
    plans = {plan.owner_block: plan for plan in now}
    todo = []
    for owner in sorted({*plans, *owners}):
        if near.isdisjoint(mine.get(owner, {owner})):
            continue
        around = ring(owner)
        across = tuple(
            (other, one)
            for other, one in spanning
            if other != owner and any(block in around for block, _ in one.regions)
        )
        neighbours = tuple(one for one in owners if one != owner and one in around)
        todo.append(Owned(plans.get(owner, OwnedBuildings(owner, ())), across, neighbours))
    return todo


def touched_blocks(keys: NDArray[np.int64], side: float) -> set[Block]:
    """The blocks that lie within `BORDER` of some cells (`cell_keys`)."""
    column, row = (keys + 2**31) // 2**32, (keys + 2**31) % 2**32 - 2**31
    place = np.column_stack([column, row]) * COVER_CELL
    steps = (-BORDER, COVER_CELL + BORDER)
    near = [np.floor((place + [right, up]) / side) for right in steps for up in steps]
    found = np.unique(np.concatenate(near).astype(np.int64), axis=0)
    return {Block(int(one), int(other), side) for one, other in found}


def goes_on(
    plans: Sequence[OwnedBuildings], store: Store, near: Set[Block], changed: NDArray[np.int64]
) -> set[Block]:
    """The blocks into which buildings of several blocks go on that lie in some (`near`) and are touched."""
    gatherer, found = Gatherer(store), set[Block]()
    for plan in plans:
        for one in plan.buildings:
            blocks = {block for block, _ in one.regions}
            if one.failure is None and not blocks <= near and not near.isdisjoint(blocks):
                building = gatherer.points_of(plan.owner_block, one)
                if building is not None and is_touched(building, changed):
                    found |= blocks
    return found


def is_touched(building: BuildingPoints | Found, changed: NDArray[np.int64]) -> bool:
    """Whether points near those of a building came or went."""
    place = np.floor((building.xyz[:, :2] + building.owner_block.origin) / COVER_CELL).astype(np.int64)
    if not meets_box(place.min(axis=0), place.max(axis=0), changed):
        return False
    return bool(is_among(cell_keys(place), changed).any())


def model_again(
    owned: Owned, store: Store, before: Store, recipe: Recipe, snap: bool, changed: NDArray[np.int64]
) -> list[bool]:
    """Model an owner block's buildings into `store`; which of its results are those of `before`.

    `changed` are the cells around points that came or went (`changed_keys`).
    """
    return compute_buildings(owned.now, store, recipe, snap, Known(owned, store, before, changed))


@lru_cache(maxsize=1)
def near_gatherer(store: Store) -> Gatherer:
    """Reads the points around owner blocks, of which one follows the other."""
    return Gatherer(store, keep=NEAR_BLOCKS)


class Known:
    """The earlier results of an owner block, and which of them stay.

    A building is touched when points within `REACH` of it came or went: then it is modelled as a build of all
    points would. Any other stays as it is, though what is measured over a whole block, the spacing of its
    points, may have changed in the last digit, and with it which points a detector takes. Neighbours of a
    touched building are drawn with it, for they share edges, and modelled again where that moves their
    outline.
    """

    def __init__(self, owned: Owned, store: Store, before: Store, changed: NDArray[np.int64]) -> None:
        self._changed = changed
        self._results = [one for one in before.saved_buildings(owned.now.owner_block) if len(one.point_id)]
        gatherer = near_gatherer(store)
        found = (gatherer.points_of(owner, plan) for owner, plan in owned.around if plan.failure is None)
        self._around = [one for one in found if one is not None]
        self._beyond: list[tuple[NDArray[np.int64], Polygon]] = []
        for owner in owned.neighbours:
            some = before.saved_buildings(owner)
            self._beyond += [(one.point_id, one.row.polygon) for one in some if len(one.point_id)]
        self._beside: list[SavedBuilding] = []

    def take(
        self, buildings: Sequence[BuildingPoints]
    ) -> tuple[list[SavedBuilding], list[BuildingPoints], list[bool]]:
        """The results that stay, the buildings to draw, and which of these to model."""
        mine = np.arange(len(buildings) + len(self._around)) < len(buildings)
        now: list[BuildingPoints | Found] = [*buildings, *self._around]
        outlines = [*(one.row.polygon for one in self._results), *(outline for _, outline in self._beyond)]
        touched = np.array([is_touched(one, self._changed) for one in now], bool)
        lost = np.array([self._meets(outline) for outline in outlines], bool)
        points = Owners([one.point_id for one in now])
        old = Owners([*(one.point_id for one in self._results), *(ids for ids, _ in self._beyond)])
        while True:  # one that takes points of a touched building, or gives it some, is touched, too
            more = lost | old.sharing(points, touched)
            also = touched | points.sharing(old, more)
            if (more == lost).all() and (also == touched).all():
                break
            lost, touched = more, also
        drawn = touched[mine]
        places = [one.xyz for one in buildings]
        context, beside = beside_some(places, drawn)
        near = beside & ~drawn
        moves = old.sharing(points, np.concatenate([near, np.zeros((~mine).sum(), bool)]))
        kept = []
        for one, is_lost, moved in zip(self._results, lost, moves, strict=False):
            if moved and not is_lost:
                self._beside.append(one)
            elif not is_lost:
                kept.append(one)
        some = np.flatnonzero(context)
        return kept, [buildings[int(k)] for k in some], [bool(drawn[k] or near[k]) for k in some]

    def result_of(self, building: BuildingPoints, footprint: Footprint | Failure) -> SavedBuilding | None:
        """The earlier result of a building beside a touched one, where its outline has not moved."""
        if isinstance(footprint, Failure):
            return None
        for found in self._beside:
            outcome = found.result.outcome
            old = outcome.footprint
            if old is not None and not isinstance(outcome, Failure):
                apart = shapely.hausdorff_distance(old.polygon, footprint.polygon)
                if apart <= MOVED and building.given is None:
                    return found
        return None

    def _meets(self, outline: Polygon) -> bool:
        """Whether points near an outline (world metres) came or went."""
        if outline.is_empty:
            return False
        west, south, east, north = (math.floor(value / COVER_CELL) for value in outline.bounds)
        if not meets_box((west, south), (east, north), self._changed):
            return False
        columns, rows = np.meshgrid(np.arange(west, east + 1), np.arange(south, north + 1))
        place = np.column_stack([columns.ravel(), rows.ravel()])
        place = place[is_among(cell_keys(place), self._changed)]
        cells = shapely.box(*(place * COVER_CELL).T, *((place + 1) * COVER_CELL).T)
        return bool(shapely.intersects(outline, cells).any())


class Owners:
    """Which of some buildings has a point."""

    def __init__(self, point_ids: Sequence[NDArray[np.int64]]) -> None:
        self.count = len(point_ids)
        self._id = np.concatenate([np.zeros(0, np.int64), *point_ids])
        self._owner = np.repeat(np.arange(self.count), [len(one) for one in point_ids])

    def sharing(self, other: Owners, some: Mask) -> Mask:
        """Which buildings (B,) have points of some of the others."""
        found = np.zeros(self.count, bool)
        found[self._owner[np.isin(self._id, other._id[some[other._owner]])]] = True
        return found


def cell_keys(place: NDArray[np.int64]) -> NDArray[np.int64]:
    """Cells (N, 2; column, row) as one number each."""
    return np.asarray(place[:, 0] * 2**32 + place[:, 1])


def is_among(keys: NDArray[np.int64], some: NDArray[np.int64]) -> Mask:
    """Which numbers (N,) are among some in rising order."""
    if not len(some):
        return np.zeros(len(keys), bool)
    place = np.minimum(np.searchsorted(some, keys), len(some) - 1)
    return np.asarray(some[place] == keys)


def meets_box(first: Sequence[int], last: Sequence[int], some: NDArray[np.int64]) -> bool:
    """Whether a cell from `first` to `last` (column, row) is among some in rising order."""
    columns = np.arange(first[0], last[0] + 1) * 2**32
    low, high = columns + first[1], columns + last[1]
    return bool((np.searchsorted(some, low) < np.searchsorted(some, high, "right")).any())


def changed_keys(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """The cells within `REACH` of some (N, 2; column, row), in order, as `cell_keys`."""
    reach = int(np.ceil(REACH / COVER_CELL))
    steps = range(-reach, reach + 1)
    near = [cell_keys(cells + np.array([right, up])) for right in steps for up in steps]
    return np.unique(np.concatenate([np.zeros(0, np.int64), *near]))


def beside_some(places: Sequence[Points], some: Mask) -> tuple[Mask, Mask]:
    """Which of some points' groups (G,) are `some`, or hang together with one over gaps of `BESIDE`; and
    those that are `some`, or lie within `BESIDE` of one."""
    if not places:
        return some, some
    hulls = [shapely.convex_hull(shapely.multipoints(xyz[:, :2])) for xyz in places]
    one, other = shapely.STRtree(hulls).query(hulls, predicate="dwithin", distance=BESIDE)
    group = connected_groups_kernel(one, other, len(hulls))
    near = some.copy()
    near[one[some[other]]] = True
    return np.asarray(np.isin(group, group[some])), near
