"""Between the passes: regions that share points across a seam become one building, with one owner block."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely import Polygon

from eaves.blocks.block_file import BlockFile
from eaves.footprints.read import as_box
from eaves.geometry.components import connected_groups_kernel
from eaves.geometry.rings import as_polygon
from eaves.model import Block, Bounds, Failure, Footprint
from eaves.run.world_squares import squares_touching


@dataclass(frozen=True, eq=False)
class Seam:
    """The join's view of one block: its regions, and the labelled points near its border."""

    block: Block
    count: int
    point_id: np.ndarray
    label: np.ndarray
    inside: np.ndarray
    """Mask (count + 1,) of the labels that have points inside the block."""

    sides: np.ndarray
    """Sides that each label comes near (`block_file.border_sides`)."""

    @classmethod
    def read(cls, file: BlockFile) -> Seam:
        """The points that the block pass found near the seams of its block."""
        sides = file["sides"]
        return cls(file.block, len(sides) - 1, file["seam_id"], file["seam_label"], (sides & 1) > 0, sides)


@dataclass(frozen=True, eq=False)
class BuildingPlan:
    """The parts a building is joined from: regions (block, label), or blocks under a given footprint."""

    regions: tuple[tuple[Block, int], ...]
    given: Footprint | None = None
    failure: Failure | None = None
    """Why nothing can be computed for a given footprint, about the owner block's corner."""

    @property
    def blocks(self) -> list[Block]:
        """The blocks that it lies in, in order."""
        return sorted({block for block, _ in self.regions})


@dataclass(frozen=True, eq=False)
class OwnedBuildings:
    """The buildings owned by one block."""

    owner_block: Block
    buildings: tuple[BuildingPlan, ...]
    addresses: tuple[Footprint, ...] = ()
    """Between known party walls, about the block's corner (`footprints.addresses`)."""

    @property
    def blocks(self) -> list[Block]:
        """The blocks that the buildings lie in, in order."""
        return sorted({block for building in self.buildings for block in building.blocks})


@dataclass(frozen=True, eq=False)
class JoinedRegions:
    """The regions (R,) of several blocks, block by block, and the component each one is part of."""

    blocks: list[Block]
    owner: np.ndarray
    """Number of the block."""
    label: np.ndarray
    component: np.ndarray
    held: np.ndarray
    """True if points of it lie in its block."""
    sides: np.ndarray


def connect_regions(seams: Sequence[Seam]) -> JoinedRegions:
    """Two regions are in one component when both blocks saw the same point in them."""
    seams = sorted(seams, key=lambda seam: seam.block)
    start = np.cumsum([0, *(seam.count for seam in seams)])
    total = int(start[-1])
    nothing = [np.zeros(0, np.int64)]
    node = np.concatenate(nothing + [seam.label + start[i] - 1 for i, seam in enumerate(seams)])
    point = np.concatenate(nothing + [seam.point_id for seam in seams])
    order = np.lexsort((node, point))
    same = point[order][1:] == point[order][:-1]
    first, second = node[order][:-1][same], node[order][1:][same]
    component = connected_groups_kernel(first, second, int(total))
    owner = np.repeat(np.arange(len(seams)), [seam.count for seam in seams])
    label = np.arange(total) - start[owner] + 1
    held = np.concatenate([np.zeros(0, bool), *(seam.inside[1:] for seam in seams)])
    sides = np.concatenate([np.zeros(0, np.uint8), *(seam.sides[1:] for seam in seams)])
    return JoinedRegions([seam.block for seam in seams], owner, label, component, held, sides)


def blocks_beyond(seams: Sequence[Seam], core: Callable[[Block], bool]) -> set[Block]:
    """The blocks without a seam that may hold more of a building of the core, or terrain around it.

    `core` says whether a block is one of the core's.
    """
    regions, blocks_seen = connect_regions(seams), {seam.block for seam in seams}
    inside = np.array([core(block) for block in regions.blocks], bool)
    in_core = np.zeros(regions.component.max(initial=-1) + 1, bool)
    in_core[regions.component[regions.held & inside[regions.owner]]] = True
    chosen = np.flatnonzero(regions.held & (regions.sides > 1) & in_core[regions.component])
    beyond = set()
    for owner, sides in {(int(regions.owner[k]), int(regions.sides[k])) for k in chosen}:
        block = regions.blocks[owner]
        columns = [0] + [-1] * (sides >> 1 & 1) + [1] * (sides >> 3 & 1)
        rows = [0] + [-1] * (sides >> 2 & 1) + [1] * (sides >> 4 & 1)
        beyond |= {Block(block.column + c, block.row + r, block.side) for c in columns for r in rows}
    return beyond - blocks_seen


def join_regions(seams: Sequence[Seam]) -> list[OwnedBuildings]:
    """Buildings from regions: two regions are one building when both blocks saw the same point in them.

    A building is owned by the first (by column, row) of the blocks that hold points of it, and is
    numbered there in the order of its first label.
    """
    regions = connect_regions(seams)
    grouped: dict[int, list[int]] = {}
    for index in np.flatnonzero(regions.held):
        grouped.setdefault(int(regions.component[index]), []).append(int(index))
    owners: dict[Block, list[tuple[tuple[Block, int], ...]]] = {}
    for parts in sorted(grouped.values()):
        joined = tuple((regions.blocks[regions.owner[part]], int(regions.label[part])) for part in parts)
        owners.setdefault(joined[0][0], []).append(joined)
    return [OwnedBuildings(owner, tuple(map(BuildingPlan, owners[owner]))) for owner in sorted(owners)]


def assign_footprints(
    footprints: Sequence[Footprint], blocks: Sequence[Block], first: Block, lost: Sequence[Failure] = ()
) -> list[OwnedBuildings]:
    """Buildings from given footprints (polygons, world metres), owned by the block of their representative
    point; a footprint without a place belongs to the `first` block.

    Those that meet no block with points, and the `lost` ones, follow as failures: each footprint has a row.
    """
    with_points, side = set(blocks), first.side
    plans: dict[Block, list[BuildingPlan]] = {}
    failures = list(lost)
    for footprint in footprints:
        touched = squares_touching(Bounds(*footprint.polygon.bounds), side)
        under = tuple((block, 0) for block in touched if block in with_points)
        owner = block_of(footprint, first)
        moved = about(footprint, owner.origin)
        if under and moved is not None:
            plans.setdefault(owner, []).append(BuildingPlan(under, moved))
            continue
        code, what = ("outside", "lies far from all points") if moved else ("no_area", "has no area")
        reason = f"given footprint '{footprint.id}' {what}"
        failures.append(Failure(code, reason, "outline", footprint))
    for failure in failures:
        owner = block_of(failure.footprint, first)
        owned_plans = plans.setdefault(owner, [])
        place = failure.footprint or Footprint(Polygon())
        local = shapely.transform(place.polygon, lambda xy, origin=owner.origin: xy - np.array(origin))
        place = place.with_(polygon=local, origin=owner.origin)
        owned_plans.append(BuildingPlan((), place, replace(failure, footprint=place)))
    return [OwnedBuildings(owner, tuple(plans[owner])) for owner in sorted(plans)]


def block_of(footprint: Footprint | None, first: Block) -> Block:
    """The block of a footprint's representative point (world metres), the `first` for one without area."""
    if footprint is None or footprint.polygon.is_empty:
        return first
    point = footprint.polygon.representative_point()
    return Block.at(point.x, point.y, first.side)


def with_addresses(plans: Sequence[OwnedBuildings], addresses: Sequence[Footprint]) -> list[OwnedBuildings]:
    """The owner blocks, each with the addresses (world metres) in the blocks of its buildings."""
    if not addresses:
        return list(plans)
    tree = shapely.STRtree([address.polygon for address in addresses])
    owned = []
    for plan in plans:
        numbers = np.unique(tree.query([as_box(block.bounds) for block in plan.blocks])[1])
        local_addresses = tuple(
            moved for k in numbers if (moved := about(addresses[k], plan.owner_block.origin)) is not None
        )
        owned.append(replace(plan, addresses=local_addresses))
    return owned


def about(address: Footprint, origin: tuple[float, float]) -> Footprint | None:
    """An address in local metres about `origin`; None when it is no polygon there."""
    polygon = as_polygon(shapely.transform(address.polygon, lambda xy: xy - np.array(origin)))
    return None if polygon is None else address.with_(polygon=shapely.orient_polygons(polygon), origin=origin)
