"""The buildings of one owner block: gathered, outlined together, divided, and modelled one by one."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

from eaves.buildings.building import (
    broken_result,
    building_pass,
    divide_parts,
    draw_footprints,
    find_doubtful,
)
from eaves.buildings.building_file import Kept, SavedBuilding, save_buildings
from eaves.buildings.gather import MARGIN, Gatherer
from eaves.buildings.join import OwnedBuildings
from eaves.footprints.addresses import split_buildings
from eaves.model import Failure, Footprint
from eaves.model.results import BuildingPoints, BuildingResult
from eaves.run.clock import Clock
from eaves.run.keys import BUILDINGS
from eaves.run.store import Store, Task

if TYPE_CHECKING:
    from eaves.recipe.recipe import Recipe

log = logging.getLogger("eaves")


def keep_buildings(task: Task, store: Store, recipe: Recipe, snap: bool = False) -> None:
    """The building pass for the buildings owned by one block, kept in the store.

    A building that follows from the same as one that was there is taken over from it.
    """
    plan: OwnedBuildings = task.unit
    owner, step = plan.owner_block, BUILDINGS.key(recipe, store.system)
    gatherer = Gatherer(store, around=MARGIN if recipe.keeps_low else None)
    if snap:
        plan = gatherer.snapped(plan)
    gathered = [gatherer.gather(owner, building) for building in plan.buildings]
    before = {one.key: one for one in Kept(store, (BUILDINGS,)).saved(owner) if one.key}
    taken = store.key_of(step, gathered, plan.addresses)
    if store.recalls(BUILDINGS, owner, task.read, taken):
        return
    results: list[BuildingResult | SavedBuilding] = [
        BuildingResult.without_points(none) for none in gathered if isinstance(none, Failure)
    ]
    keys = [""] * len(results)
    whole = [building for building in gathered if not isinstance(building, Failure)]
    clock = Clock()
    buildings = [part for building in whole for part in divide_parts(building, recipe.outline)]
    footprints = draw_all(buildings, recipe)
    buildings = [replace(building, others=None) for building in buildings]
    clock.lap("outline")
    buildings, footprints = split_buildings(buildings, footprints, plan.addresses, recipe.units)
    clock.lap("units")
    own = [store.key_of(step, one, shape) for one, shape in zip(buildings, footprints, strict=True)]
    made = [number for number, key in enumerate(own) if key not in before]
    found: dict[int, BuildingResult | SavedBuilding] = {
        number: before[key] for number, key in enumerate(own) if key in before
    }
    models = [try_building(buildings[n], footprints[n], recipe, store, check=False) for n in made]
    found |= dict(zip(made, models, strict=True))
    checking = Clock()
    for place in recheck(models, recipe, store):
        number = made[place]
        found[number] = try_building(buildings[number], footprints[number], recipe, store)
    checking.lap("validate")
    results += [found[number] for number in range(len(own))]
    if results and isinstance(results[0], BuildingResult):
        spent = results[0].seconds
        spent.update(clock.laps, validate=spent.get("validate", 0.0) + checking.laps["validate"])
    save_buildings(store, BUILDINGS, owner, results, task.read, taken, [*keys, *own])


def try_building(
    building: BuildingPoints, footprint: Footprint | Failure, recipe: Recipe, store: Store, check: bool = True
) -> BuildingResult:
    """The answer of `building_pass`, or what is left of a building where it raises: one must not take the
    others of its block with it."""
    try:
        return building_pass(building, footprint, recipe, store.system.horizontal_unit_m, False, check)
    except Exception as error:
        name = building.owner_block.name
        log.warning("a building of block %s failed: %s: %s", name, type(error).__name__, error)
        log.debug("traceback", exc_info=True)
        return broken_result(building, error)


def recheck(results: list[BuildingResult], recipe: Recipe, store: Store) -> Iterable[int]:
    """The numbers of unchecked results to be made again with a check; all where one of them breaks it."""
    try:
        return find_doubtful(results, recipe.lod, store.system.horizontal_unit_m)
    except Exception:  # as in try_building
        log.debug("traceback", exc_info=True)
        return range(len(results))


def draw_all(buildings: list[BuildingPoints], recipe: Recipe) -> list[Footprint | Failure]:
    """The footprints of a block's buildings together; one by one where one of them breaks the others."""
    try:
        return draw_footprints(buildings, recipe)
    except Exception as error:  # as in try_building: the others must not go with it
        if len(buildings) == 1:
            log.debug("traceback", exc_info=True)
            return [Failure("internal_error", f"{type(error).__name__}: {error}", "outline")]
        return [draw_all([building], recipe)[0] for building in buildings]
