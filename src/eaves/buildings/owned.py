"""The buildings of one owner block: gathered, outlined together, divided, and modelled one by one."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eaves.blocks.block_file import BlockFile
from eaves.buildings.building import (
    broken_result,
    building_pass,
    divide_parts,
    draw_footprints,
    find_doubtful,
)
from eaves.buildings.building_file import SavedBuilding, building_arrays
from eaves.buildings.gather import MARGIN, Gatherer
from eaves.buildings.join import OwnedBuildings
from eaves.footprints.addresses import split_buildings
from eaves.methods import ContractError
from eaves.model import Block, Failure, Footprint
from eaves.model.checks import error_line
from eaves.model.results import BuildingPoints, BuildingResult
from eaves.run.clock import Clock
from eaves.run.keys import key_of

if TYPE_CHECKING:
    from eaves.recipe.recipe import Recipe

log = logging.getLogger("eaves")


@dataclass(frozen=True, eq=False)
class GatheredBuildings:
    """All that decides the buildings of one owner block."""

    owner: Block
    buildings: tuple[BuildingPoints | Failure, ...]
    addresses: tuple[Footprint, ...]


def see_buildings(
    plan: OwnedBuildings, regions: Mapping[Block, BlockFile], points: object, parameters: Any
) -> GatheredBuildings:
    """View of the buildings of an owner block from which they are computed: their points and surroundings."""
    gatherer = Gatherer(regions, around=MARGIN if parameters.keeps_low else None)
    if parameters.snap_footprints:
        plan = gatherer.snapped(plan)
    owner = plan.owner_block
    gathered = tuple(gatherer.gather(owner, building) for building in plan.buildings)
    return GatheredBuildings(owner, gathered, plan.addresses)


def model_buildings(
    seen: GatheredBuildings, earlier: Sequence[SavedBuilding] | None, parameters: Any
) -> dict[str, NDArray[Any]]:
    """Outlines, units, roofs and solids of the buildings of an owner block, as the arrays of their file.

    A building that follows from the same as one of an `earlier` result is taken over from it.
    """
    unit_m = parameters.system.horizontal_unit_m
    before = {building.key: building for building in earlier or () if building.key}
    failures = [building for building in seen.buildings if isinstance(building, Failure)]
    detected = [building for building in seen.buildings if not isinstance(building, Failure)]
    clock = Clock()
    buildings = [part for building in detected for part in divide_parts(building, parameters.outline)]
    footprints = draw_all(buildings, parameters)
    buildings = [replace(building, others=None) for building in buildings]
    clock.lap("outline")
    buildings, footprints = split_buildings(buildings, footprints, seen.addresses, parameters.units)
    clock.lap("units")
    keys = [key_of(building, shape) for building, shape in zip(buildings, footprints, strict=True)]
    todo = [number for number, key in enumerate(keys) if key not in before]
    results: dict[int, BuildingResult | SavedBuilding] = {
        number: before[key] for number, key in enumerate(keys) if key in before
    }
    models = [try_building(buildings[n], footprints[n], parameters, unit_m, check=False) for n in todo]
    results |= dict(zip(todo, models, strict=True))
    checking = Clock()
    for place in recheck(models, parameters, unit_m):
        number = todo[place]
        results[number] = try_building(buildings[number], footprints[number], parameters, unit_m)
    checking.lap("validate")
    ordered = [*map(BuildingResult.without_points, failures), *(results[n] for n in range(len(keys)))]
    if ordered and isinstance(ordered[0], BuildingResult):
        spent = ordered[0].seconds
        spent.update(clock.laps, validate=spent.get("validate", 0.0) + checking.laps["validate"])
    return building_arrays(ordered, [*[""] * len(failures), *keys])


def try_building(
    building: BuildingPoints,
    footprint: Footprint | Failure,
    recipe: Recipe,
    unit_m: float,
    flat: bool = False,
    check: bool = True,
) -> BuildingResult:
    """The answer of `building_pass` for all points, or what is left of a building where it raises: one must
    not take the others of its block with it."""
    try:
        result = building_pass(building, footprint, recipe, unit_m, flat, check)
    except ContractError:  # of a method that returns this no building can be right
        raise
    except Exception as error:
        log.warning("a building of block %s failed: %s", building.owner_block.name, error_line(error))
        log.debug("traceback", exc_info=True)
        result = broken_result(building, error)
    if building.left_out is None or building.counts is None:
        return result
    plane = np.concatenate([result.plane, np.repeat(result.plane, building.counts)])
    return replace(result, point_id=np.concatenate([result.point_id, building.left_out]), plane=plane)


def recheck(results: list[BuildingResult], recipe: Recipe, unit_m: float) -> Iterable[int]:
    """The numbers of unchecked results to be made again with a check; all where one of them breaks it."""
    try:
        return find_doubtful(results, recipe.lod, unit_m)
    except Exception:  # as in try_building
        log.debug("traceback", exc_info=True)
        return range(len(results))


def draw_all(buildings: list[BuildingPoints], recipe: Recipe) -> list[Footprint | Failure]:
    """The footprints of a block's buildings together; one by one where one of them breaks the others."""
    try:
        return draw_footprints(buildings, recipe)
    except ContractError:
        raise
    except Exception as error:  # as in try_building: the others must not go with it
        if len(buildings) == 1:
            log.debug("traceback", exc_info=True)
            return [Failure("internal_error", error_line(error), "outline")]
        return [draw_all([building], recipe)[0] for building in buildings]
