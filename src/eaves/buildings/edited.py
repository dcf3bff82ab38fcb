"""The buildings of one owner block after a person's edits: as they were found, or modelled again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

from eaves.blocks.block_file import BlockFile
from eaves.buildings.building_file import SavedBuilding, building_arrays, saved_buildings
from eaves.buildings.gather import MARGIN, BuildingPlan, Gatherer, about, blocks_in
from eaves.buildings.owned import RoofOfPoints, try_building
from eaves.geometry.planes import median
from eaves.methods import MethodChoice
from eaves.model import Block, Bounds, BuildingModel, Failure, Footprint, Points, RoofPlane
from eaves.model.block import squares_touching
from eaves.model.results import BuildingPoints, BuildingResult
from eaves.reconstruct import Reconstructor, reconstruct_building
from eaves.reconstruct.arrangement import Arrangement
from eaves.reconstruct.toolkit.stated_faces import StatedFace, lay_faces
from eaves.roof import RoofMethod
from eaves.run.keys import key_of

if TYPE_CHECKING:
    from eaves.buildings.owned import BuildingParameters

VERSION, CREATED = "version", "creationDate"
"""Attributes of a building to which an update gave a version."""

FLAT, COARSER, FINER, GABLE, HIP = "flat", "coarser", "finer", "gable", "hip"
"""Shapes of a roof that a person states."""
PRICED = {COARSER: 4.0, FINER: 0.25}
"""The price of a roof face in those of the recipe: at a quarter and at four times of it most roofs show
another number of faces."""


@dataclass(frozen=True)
class StatedRoof(RoofOfPoints):
    """What a person states of a roof.

    Parameters
    ----------
    base : float or None
        Height (m) of its base.
    shape : str
        Its shape, empty for that of its points.
    changes : tuple of StatedFace or float
        Faces that are laid over it (world metres), and heights (m) of its eaves, to which all of it is
        raised, in their order.
    method : Reconstructor or None
        The method of a shape that one of its own makes.
    code : tuple of str
        The digests of that method's code.
    """

    shape: str = ""
    changes: tuple[StatedFace | float, ...] = ()
    method: Reconstructor | None = None
    code: tuple[str, ...] = ()

    @property
    def holds(self) -> bool:
        """True if a shape or a face is stated."""
        return bool(self.shape) or any(isinstance(change, StatedFace) for change in self.changes)

    def planes(
        self, points: Points, spacing: float, method: RoofMethod, rng: np.random.Generator
    ) -> list[RoofPlane]:
        """The planes of the points, for a shape that has a price with faces at that price; of a flat roof the
        level one at their median height."""
        if self.shape == FLAT:
            level = median(points[:, 2])
            rmse = float(np.sqrt(np.mean((points[:, 2] - level) ** 2)))
            return [RoofPlane((0.0, 0.0, level), np.arange(len(points)), rmse)]
        price = getattr(method, "price", None)
        if price is not None and self.shape in PRICED:
            method = method.model_copy(update={"price": price * PRICED[self.shape]})
        return super().planes(points, spacing, method, rng)

    def model(
        self,
        points: Points,
        footprint: Footprint,
        planes: list[RoofPlane],
        base: float,
        method: MethodChoice,
    ) -> tuple[BuildingModel | Failure, Points]:
        """The model of the points after all changes, and the points, raised with the roof."""
        chosen = self.method or method
        limits = chosen if isinstance(chosen, Arrangement) else Arrangement()
        faces: list[StatedFace] = []
        outcome = found = reconstruct_building(points, footprint, planes, base, chosen)
        for change in self.changes:
            if isinstance(outcome, Failure) or isinstance(found, Failure):
                break
            if isinstance(change, StatedFace):
                faces.append(change.about(footprint.origin))
            else:
                rise = change - float(outcome.attributes["h_eaves"])
                points, faces = points + [0.0, 0.0, rise], [face.raised(rise) for face in faces]
                planes = [raised(plane, rise) for plane in planes]
                outcome = found = reconstruct_building(points, footprint, planes, base, chosen)
            if faces and isinstance(found, BuildingModel):
                outcome = lay_faces(found, faces, points, base, limits)
        return outcome, points


def raised(plane: RoofPlane, rise: float) -> RoofPlane:
    """The plane of points that lie higher by so much (m)."""
    a, b, c = plane.coefficients
    return replace(plane, coefficients=(a, b, c + rise))


@dataclass(frozen=True, eq=False)
class OrderedPart:
    """A building that an order asks for: its id, its outline (world metres), its roof, and what it says of
    its edits."""

    id: str
    outline: Polygon
    roof: StatedRoof
    attributes: Mapping[str, str]


@dataclass(frozen=True, eq=False)
class Order:
    """The order for one building.

    Parameters
    ----------
    id : str
        The building's id.
    parts : tuple of OrderedPart
        Several between party walls, none for no building.
    attributes : mapping
        What the building says of its edits.
    stays : bool
        True if it is right as it was found.
    """

    id: str
    parts: tuple[OrderedPart, ...]
    attributes: Mapping[str, str]
    stays: bool = False

    @property
    def outlines(self) -> tuple[Polygon, ...]:
        """The outlines of its parts."""
        return tuple(part.outline for part in self.parts)

    @property
    def modelled(self) -> tuple[OrderedPart, ...]:
        """The parts that are to be modelled."""
        return () if self.stays else self.parts


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
    for part in (part for order in unit.orders for part in order.modelled):
        name = part.id
        footprint = about(Footprint(part.outline, id=name), owner.origin)
        if footprint is not None:
            touched = blocks_in(owner, Bounds(*footprint.polygon.bounds))
            under = tuple((block, 0) for block in touched if block in computed)
            outlines[name] = footprint
            points[name] = gatherer.gather(owner, BuildingPlan(under, footprint))
    return GatheredOrders(unit.orders, found[owner], outlines, points)


def model_orders(
    view: GatheredOrders, earlier: Sequence[SavedBuilding] | None, parameters: BuildingParameters
) -> dict[str, NDArray[Any]]:
    """The buildings of a block after its orders, as the arrays of their file: each in the place of the one it
    is of, and behind them those that were not found. One that follows from the same as one of an `earlier`
    result is taken over from it."""
    orders = {order.id: order for order in view.orders}
    before = {building.key: building for building in earlier or () if building.key}
    results: list[tuple[BuildingResult | SavedBuilding, str]] = []
    for saved in saved_buildings(view.found) if view.found else ():
        order = orders.pop(str(saved.row.values["id"]), None)
        if order is None:
            results.append((saved, ""))
        elif order.stays:
            results.append((confirmed(saved, order), ""))
        else:
            results += model_order(order, view, version_of(saved.result), before, parameters)
    for order in orders.values():
        results += model_order(order, view, {}, before, parameters)
    return building_arrays([result for result, _ in results], [key for _, key in results])


def confirmed(saved: SavedBuilding, order: Order) -> BuildingResult:
    """A building as it was found, which says that a person looked at it."""
    result = saved.result
    if not isinstance(result.outcome, BuildingModel):
        return result
    attributes = {**order.attributes, **result.outcome.attributes}
    return replace(result, outcome=result.outcome.with_(attributes=attributes))


def model_order(
    order: Order,
    view: GatheredOrders,
    version: Mapping[str, Any],
    before: Mapping[str, SavedBuilding],
    parameters: BuildingParameters,
) -> Iterator[tuple[BuildingResult | SavedBuilding, str]]:
    """The buildings that an order asks for, with the `version` of the building as it was found, each with the
    key of what it follows from; an outline without an area gives none."""
    block = {"block_id": order.id} if len(order.parts) > 1 else {}
    for part in order.parts:
        points = view.points.get(part.id)
        if points is None:
            continue
        key = key_of(part, points, view.outlines[part.id], version, block)
        if key in before:
            yield before[key], key
            continue
        if isinstance(points, Failure):
            result = BuildingResult.without_points(points)
        else:
            unit_m = parameters.system.horizontal_unit_m
            result = try_building(points, view.outlines[part.id], part.roof, parameters, unit_m)
        outcome = result.outcome
        if isinstance(outcome, BuildingModel):
            attributes = {**part.attributes, **outcome.attributes, **block, **version}
            yield replace(result, outcome=outcome.with_(attributes=attributes)), key
        else:
            edits = ", ".join(part.attributes.values())
            reason = f"{outcome.reason} (edit: {edits})"
            yield replace(result, outcome=replace(outcome, reason=reason)), key


def version_of(result: BuildingResult) -> dict[str, Any]:
    """The attributes that tell of a building's version, where an update gave it one."""
    if not isinstance(result.outcome, BuildingModel):
        return {}
    return {key: value for key, value in result.outcome.attributes.items() if key in (VERSION, CREATED)}
