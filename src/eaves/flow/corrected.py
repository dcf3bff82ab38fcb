"""Edits carried out: buildings modelled again by what a user says of them, in a layer over those found."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Self

import shapely
from shapely import Polygon

from eaves.buildings.building_file import SavedBuildings, load_buildings, load_found
from eaves.buildings.edited import Order, OwnedOrders, inputs_of_edited, model_orders
from eaves.buildings.gather import block_of
from eaves.flow.edits import Edit, edits_of_layer, read_edits, settle, write_edits
from eaves.flow.refusals import EDITS, LAYER
from eaves.flow.region import Region, ensure_points
from eaves.flow.run import Run
from eaves.flow.step import BUILDINGS, REGIONS, Input, Step, ensure
from eaves.flow.tiles import by_tile, evict
from eaves.model import Block, CoordinateSystem, Footprint
from eaves.run import keys
from eaves.run.keys import NAMED
from eaves.run.manifest import is_changed, known_files

if TYPE_CHECKING:
    from eaves.flow.region import Region
if TYPE_CHECKING:
    pass

OVERLAP_M2 = 1.0
"""An edited outline that covers more of a neighbour than this (m²) is reported."""


@dataclass(frozen=True, eq=False)
class Corrected:
    """The result of edits: ids of buildings modelled and removed, edits that gave no model with the reason,
    conflicts in words, and the owner blocks whose buildings are others, or were by earlier edits."""

    modelled: tuple[str, ...] = ()
    removed: tuple[str, ...] = ()
    failed: tuple[str, ...] = ()
    conflicts: tuple[str, ...] = ()
    touched: frozenset[Block] = frozenset()


def outlines_in(buildings: SavedBuildings, side: float) -> dict[str, Polygon]:
    """Id → outline (world metres) of buildings that are kept."""
    return {str(row.values["id"]): row.polygon for row in buildings.rows(buildings.owners(side))}


def kept_edits(folder: Path, system: CoordinateSystem) -> list[Edit]:
    """The edits that a run's folder keeps."""
    path = folder / EDITS
    return list(read_edits(path, system)) if path.exists() else []


def changed_in_layer(folder: Path, system: CoordinateSystem, shown: dict[str, Polygon]) -> list[Edit]:
    """The changes of a user in the run's footprints.gpkg, where it is not as the run wrote it, of the
    buildings `shown`, by id."""
    path, entry = folder / LAYER, known_files(folder).get(LAYER)
    if not path.exists() or not entry or not is_changed(path, entry):
        return []
    return edits_of_layer(path, system, shown)


def correct(region: Region, edits: Sequence[Edit]) -> Corrected:
    """Carry out all edits on a region's buildings, and take back what is edited no more."""
    side, edited = region.run.side, region.buildings.only(EDITED.name)
    detected = region.buildings.only(NAMED, BUILDINGS.name)
    orders, conflicts = settle(edits, outlines_in(detected, side))
    home = {str(row.values["id"]): owner for owner in detected.owners(side) for row in detected.rows([owner])}
    orders = [order for order in orders if order.outlines or order.id in home]
    by_owner: dict[Block, list[Order]] = {}
    for order in orders:
        owner = home.get(order.id) or block_of(Footprint(order.outlines[0]), region.run.first_block)
        by_owner.setdefault(owner, []).append(order)
    touched = frozenset([*by_owner, *edited.owners(side)])
    keys = detected.keys(by_owner)
    units = [
        OwnedOrders(owner, tuple(by_owner[owner]), keys.get(owner.name, "")) for owner in sorted(by_owner)
    ]
    model_edits(region, units)
    conflicts += overlaps(orders, outlines_in(region.buildings, side))
    return Corrected(
        tuple(part.id for order in orders for part in order.modelled),
        tuple(order.id for order in orders if not order.parts),
        tuple(reason for unit in units for reason in failures_in(unit, edited)),
        tuple(conflicts),
        touched,
    )


def failures_in(unit: OwnedOrders, edited: SavedBuildings) -> Iterator[str]:
    """The buildings that the orders of a block ask for and of which there is no model, with the reason."""
    if edited.path(unit.owner_block) is None:
        return  # the whole block failed, which the run says
    rows = {str(row.values["id"]): row for row in edited.rows([unit.owner_block])}
    for name in (part.id for order in unit.orders for part in order.modelled):
        row = rows.get(name)
        if row is None:
            yield f"{name}: its outline has no area"
        elif not row.modelled:
            yield f"{name}: {row.values['failure_reason']}"


def overlaps(orders: Sequence[Order], shown: Mapping[str, Polygon]) -> list[str]:
    """Edited outlines that cover a part of another building that is shown."""
    edited = {order.id: shapely.union_all(order.outlines) for order in orders if order.outlines}
    names = list(shown)
    tree = shapely.STRtree([shown[name] for name in names])
    conflicts = []
    for name, outline in edited.items():
        for k in tree.query(outline, predicate="intersects"):
            neighbour = names[k]
            is_part = neighbour == name or neighbour.startswith(f"{name}-")
            if is_part or (neighbour in edited and neighbour < name):
                continue
            area = shapely.intersection(outline, shown[neighbour]).area
            if area > OVERLAP_M2:
                conflicts.append(f"{name}: its outline covers {area:.1f} m² of {neighbour}")
    return conflicts


log = logging.getLogger("eaves")


@dataclass(frozen=True)
class CarriedEdits:
    """The edits that a build finds in its folder."""

    run: Run
    edits: Sequence[Edit]

    @classmethod
    def of(cls, run: Run) -> Self:
        """Those in the folder of a run."""
        return cls(run, kept_edits(run.folder, run.index.system))

    def correct(self, region: Region, owners: list[Block]) -> list[Block]:
        """Carry them out on the buildings of a region, which `owners` own, and say of each that gave nothing
        why; the blocks that own buildings then."""
        corrected = correct(region, self.edits)
        log.info("%d edits of an earlier run are carried over", len(self.edits))
        for reason in (*corrected.conflicts, *corrected.failed):
            log.warning("edit: %s", reason)
        return region.buildings.owners(region.run.side)

    def keep(self) -> Path:
        """Write the file of the edits again, as those of this build; its path."""
        path = self.run.folder / EDITS
        write_edits(path, self.edits, self.run.index.system)
        return path


def model_edits(region: Region, units: Sequence[OwnedOrders]) -> None:
    """The buildings of some owner blocks after a person's edits."""
    region.store.evict_others(EDITED.name, [unit.owner_block for unit in units])
    for group in by_tile(region, units):
        ensure_points(region, EDITED, group)
        ensure(region, EDITED, group)
        if region.run.by_tiles:
            evict(region)


EDITED = Step(
    name=keys.EDITED,
    code=keys.BUILDINGS_CODE,
    takes=(REGIONS.around(1), Input(load=load_found)),
    inputs_of=inputs_of_edited,
    run=model_orders,
    reads=("roof", "reconstruct", "lod", "overhangs", "keeps_low", "from_raster"),
    earlier=load_buildings,
    shown=True,
    persistent=True,
)
