"""Edits carried out: buildings modelled again by what a user says of them, in a layer over those found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import shapely
from shapely import Polygon

from eaves.buildings.building import building_pass
from eaves.buildings.building_file import Kept, SavedBuilding, as_found, building_arrays
from eaves.buildings.gather import Gatherer, blocks_in
from eaves.buildings.join import BuildingPlan, about, block_of
from eaves.change.edits import Order
from eaves.change.upkeep.versions import version_of
from eaves.flow.region import Region
from eaves.flow.step import results_of
from eaves.flow.steps import REGIONS
from eaves.model import Block, Bounds, BuildingModel, Failure, Footprint
from eaves.model.results import BuildingResult
from eaves.run.keys import EDITED

OVERLAP_M2 = 1.0
"""An edited outline that covers more of a neighbour than this (m²) is reported."""


@dataclass
class Corrected:
    """The result of edits: ids of buildings modelled and removed, edits that gave no model with the reason,
    and the owner blocks whose buildings are others now."""

    modelled: list[str] = field(default_factory=list)
    removed: list[str] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)
    touched: set[Block] = field(default_factory=set)


def outlines_in(kept: Kept, side: float) -> dict[str, Polygon]:
    """Id → outline (world metres) of buildings that are kept."""
    return {str(row.values["id"]): row.polygon for row in kept.rows(kept.owners(side))}


def correct(region: Region, orders: Sequence[Order]) -> Corrected:
    """Carry out all orders on a region's buildings, and take back what is ordered no more."""
    store, side = region.store, region.run.side
    found, edited = as_found(store), Kept(store, (EDITED,))
    home = {str(row.values["id"]): owner for owner in found.owners(side) for row in found.rows([owner])}
    by_owner: dict[Block, list[Order]] = {}
    for order in orders:
        owner = home.get(order.id) or block_of(Footprint(order.outlines[0]), side)
        by_owner.setdefault(owner, []).append(order)
    done = Corrected(touched={*by_owner, *edited.owners(side)})
    for count, owner in enumerate(sorted(done.touched), 1):
        if owner in by_owner:
            corrected = with_corrections(region, owner, by_owner[owner], done)
            store.save(EDITED, owner, building_arrays(corrected))
        else:
            store.remove(EDITED, owner)
        region.progress("buildings", count, len(done.touched))
    return done


def with_corrections(
    region: Region, owner: Block, orders: Sequence[Order], done: Corrected
) -> list[BuildingResult | SavedBuilding]:
    """The buildings of an owner block after its orders."""
    results: list[BuildingResult | SavedBuilding] = []
    wanted = {order.id: order for order in orders}
    for saved in as_found(region.store).saved(owner):
        order = wanted.pop(str(saved.row.values["id"]), None)
        if order is None:
            results.append(saved)
        elif not order.outlines:
            done.removed.append(order.id)
        else:
            results += model_order(region, owner, order, done, version_of(saved.result))
    for order in wanted.values():
        results += model_order(region, owner, order, done, {})
    return results


def model_order(
    region: Region, owner: Block, order: Order, done: Corrected, version: Mapping[str, Any]
) -> list[BuildingResult]:
    """One building for each outline of an order, with the `version` of the building as it was found."""
    results = []
    for number, outline in enumerate(order.outlines, 1):
        name = order.id if number == 1 else f"{order.id}-{number}"
        given = about(Footprint(outline, id=name, attributes=dict(order.provenance)), owner.origin)
        if given is None:
            done.failed.append(f"{name}: its outline has no area")
            continue
        result = model_outline(region, owner, given, order.flat)
        outcome = result.outcome
        if isinstance(outcome, BuildingModel):
            block = {"block_id": order.id} if len(order.outlines) > 1 else {}
            attributes = {**outcome.attributes, **order.provenance, **block, **version}
            result = replace(result, outcome=outcome.with_(attributes=attributes))
        else:
            done.failed.append(f"{name}: {outcome.reason}")
        done.modelled.append(name)
        results.append(result)
    return results


def model_outline(region: Region, owner: Block, given: Footprint, flat: bool) -> BuildingResult:
    """The result of an outline about the owner block's corner."""
    store, recipe = region.store, region.run.recipe
    touched = set(blocks_in(owner, Bounds(*given.polygon.bounds)))
    under = tuple((block, 0) for block in region.blocks if block in touched)
    building = Gatherer(results_of(REGIONS, store, region.blocks)).gather(owner, BuildingPlan(under, given))
    if isinstance(building, Failure):
        return BuildingResult.without_points(building)
    return building_pass(building, given, recipe, store.system.horizontal_unit_m, flat=flat)


def overlaps(orders: Sequence[Order], shown: Mapping[str, Polygon]) -> list[str]:
    """Edited outlines that cover a part of another building that is shown."""
    edited = {order.id: shapely.union_all(order.outlines) for order in orders if order.outlines}
    names = list(shown)
    tree = shapely.STRtree([shown[name] for name in names])
    words = []
    for name, outline in edited.items():
        for k in tree.query(outline, predicate="intersects"):
            other = names[k]
            own = other == name or other.startswith(f"{name}-")
            if own or (other in edited and other < name):
                continue
            area = shapely.intersection(outline, shown[other]).area
            if area > OVERLAP_M2:
                words.append(f"{name}: its outline covers {area:.1f} m² of {other}")
    return words
