"""The buildings of one owner block after a person's edits: as they were found, or modelled again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray
from shapely import Polygon

from eaves.blocks.block_file import BlockFile
from eaves.buildings.building_file import SavedBuilding, building_arrays, saved_buildings
from eaves.buildings.gather import MARGIN, Gatherer, blocks_in
from eaves.buildings.join import BuildingPlan, about
from eaves.buildings.owned import try_building
from eaves.model import Block, Bounds, BuildingModel, Failure, Footprint
from eaves.model.results import BuildingPoints, BuildingResult
from eaves.run.world_squares import squares_touching

if TYPE_CHECKING:
    from eaves.buildings.owned import BuildingParameters

VERSION, CREATED = "version", "creationDate"
"""Attributes of a building to which an update gave a version."""


@dataclass(frozen=True, eq=False)
class Order:
    """The order for one building.

    Parameters
    ----------
    id : str
        The building's id.
    outlines : tuple of Polygon
        World metres: several between party walls, none for no building.
    flat : bool
        True if its roof is one level plane.
    attributes : mapping
        What the building says of its edits.
    """

    id: str
    outlines: tuple[Polygon, ...]
    flat: bool
    attributes: Mapping[str, str]

    @property
    def parts(self) -> list[tuple[str, Polygon]]:
        """The id and the outline of each building that it asks for."""
        names = [self.id, *(f"{self.id}-{number}" for number in range(2, len(self.outlines) + 1))]
        return list(zip(names, self.outlines, strict=False))


@dataclass(frozen=True, eq=False)
class OwnedOrders:
    """The orders for the buildings of one block, and the key of these as they were found."""

    owner_block: Block
    orders: tuple[Order, ...]
    found: str

    @property
    def blocks(self) -> list[Block]:
        """The block, and those that the outlines lie in."""
        owner = self.owner_block
        bounds = [Bounds(*outline.bounds) for order in self.orders for outline in order.outlines]
        return sorted(
            {owner, *(block for rectangle in bounds for block in squares_touching(rectangle, owner.side))}
        )


@dataclass(frozen=True, eq=False)
class GatheredOrders:
    """All that decides the buildings of one block after its orders: the arrays of those found, and by id the
    outline, about the block's corner, and the points of each building that is asked for."""

    orders: tuple[Order, ...]
    found: Mapping[str, NDArray[Any]]
    outlines: Mapping[str, Footprint]
    points: Mapping[str, BuildingPoints | Failure]


def inputs_of_edited(
    unit: OwnedOrders,
    regions: Mapping[Block, BlockFile],
    found: Mapping[Block, Mapping[str, NDArray[Any]]],
    parameters: BuildingParameters,
) -> GatheredOrders:
    """View of the buildings of a block from which those that orders ask for are computed."""
    owner, computed = unit.owner_block, set(regions)
    gatherer = Gatherer(regions, around=MARGIN if parameters.keeps_low else None)
    outlines, points = {}, {}
    for name, outline in (part for order in unit.orders for part in order.parts):
        footprint = about(Footprint(outline, id=name), owner.origin)
        if footprint is not None:
            touched = blocks_in(owner, Bounds(*footprint.polygon.bounds))
            under = tuple((block, 0) for block in touched if block in computed)
            outlines[name] = footprint
            points[name] = gatherer.gather(owner, BuildingPlan(under, footprint))
    return GatheredOrders(unit.orders, found[owner], outlines, points)


def model_orders(view: GatheredOrders, parameters: BuildingParameters) -> dict[str, NDArray[Any]]:
    """The buildings of a block after its orders, as the arrays of their file: each in the place of the one it
    is of, and behind them those that were not found."""
    orders = {order.id: order for order in view.orders}
    results: list[BuildingResult | SavedBuilding] = []
    for saved in saved_buildings(view.found) if view.found else ():
        order = orders.pop(str(saved.row.values["id"]), None)
        if order is None:
            results.append(saved)
        else:
            results += model_order(order, view, version_of(saved.result), parameters)
    for order in orders.values():
        results += model_order(order, view, {}, parameters)
    return building_arrays(results)


def model_order(
    order: Order, view: GatheredOrders, version: Mapping[str, Any], parameters: BuildingParameters
) -> Iterator[BuildingResult]:
    """The buildings that an order asks for, with the `version` of the building as it was found; an outline
    without an area gives none."""
    block = {"block_id": order.id} if len(order.outlines) > 1 else {}
    for name, _ in order.parts:
        points = view.points.get(name)
        if points is None:
            continue
        if isinstance(points, Failure):
            result = BuildingResult.without_points(points)
        else:
            unit_m = parameters.system.horizontal_unit_m
            result = try_building(points, view.outlines[name], parameters, unit_m, order.flat)
        outcome = result.outcome
        if isinstance(outcome, BuildingModel):
            attributes = {**order.attributes, **outcome.attributes, **block, **version}
            yield replace(result, outcome=outcome.with_(attributes=attributes))
        else:
            edits = ", ".join(order.attributes.values())
            yield replace(result, outcome=replace(outcome, reason=f"{outcome.reason} (edit: {edits})"))


def version_of(result: BuildingResult) -> dict[str, Any]:
    """The attributes that tell of a building's version, where an update gave it one."""
    if not isinstance(result.outcome, BuildingModel):
        return {}
    return {key: value for key, value in result.outcome.attributes.items() if key in (VERSION, CREATED)}
