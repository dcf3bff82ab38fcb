"""Puts the points and the terrain of one building together from the results of the blocks it lies in."""

from __future__ import annotations

import logging
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from itertools import groupby, pairwise
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from eaves.blocks.block_file import BlockFile, Candidates
from eaves.footprints.read import as_box
from eaves.footprints.snap import snap_footprints
from eaves.geometry.inside import connected_groups_kernel
from eaves.geometry.rings import as_polygon
from eaves.methods import ContractError
from eaves.model import Block, Bounds, Failure, Footprint, Points, Raster
from eaves.model.block import squares_touching
from eaves.model.checks import error_line
from eaves.model.cloud import snap
from eaves.model.results import BuildingPoints
from eaves.model.scene import WALL
from eaves.raster.surfaces import CELL, heights_under
from eaves.reconstruct.stage import BlockPart, draw_block
from eaves.roof import segment_roof
from eaves.roof.toolkit.regions import crown_points
from eaves.run.keys import key_of

if TYPE_CHECKING:
    from eaves.recipe.recipe import Recipe

log = logging.getLogger("eaves")


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


T = TypeVar("T")

MARGIN = 2.0
"""Terrain is known this far (m) around a building's points, and all else where its walls are looked for."""
TRUSTED_SHARE = 0.2
"""Under a given footprint the detector's points are taken if at least this share of the high points."""


class Gatherer:
    """Reads the results of blocks as buildings need them, and keeps the last few."""

    def __init__(self, regions: Mapping[Block, BlockFile], around: float | None = None) -> None:
        self._around = around
        read = partial(read_result, regions)
        self.candidates = lru_cache(4)(lambda block: read(block, BlockFile.candidates))
        self.terrain_of = lru_cache(16)(lambda block, name: read(block, lambda file: file.raster(name)))

    def parts(self, owner: Block, blocks: Iterable[Block]) -> Iterator[tuple[Candidates, Points]]:
        """The points of those blocks that have any, and how far (3,) they are moved to lie about the corner
        of the owner block."""
        for block in blocks:
            candidates = self.candidates(block)
            if candidates is not None:
                yield candidates, np.array([*np.subtract(block.origin, owner.origin), 0.0])

    def gather(self, owner: Block, plan: BuildingPlan) -> BuildingPoints | Failure:
        """The building's points about the corner of its owner block, with the terrain around them."""
        if plan.failure is not None:
            return plan.failure
        building_points = self.points_of(owner, plan)
        if building_points is None:
            return Failure("no_points", "no point above the ground lies in it", "outline", plan.given)
        reach = Bounds.of(building_points["xyz"])
        if plan.given is not None:
            reach = reach.union(Bounds(*plan.given.polygon.bounds))
        around, others, margin = None, None, reach.buffered(MARGIN)
        if self._around is not None:
            around = self.near(owner, plan.blocks, reach.buffered(self._around), free=False)
        if plan.given is None:
            others = self.near(owner, blocks_in(owner, margin), margin, free=True)
        ground = self.terrain(owner, margin, "ground")
        heights, beside = None, None
        if plan.given is not None:
            beside = is_seen_beside(plan.given.polygon, ground)
            heights = None if beside else self.nearest_ground(owner, plan)
        return BuildingPoints(
            owner_block=owner,
            **building_points,
            terrain=self.terrain(owner, margin),
            ground_seen=ground,
            ground_nearest=heights,
            ground_beside=beside,
            given=plan.given,
            others=others,
            around=around,
        )

    def points_of(self, owner: Block, plan: BuildingPlan) -> dict[str, Any] | None:
        """The building's points about the corner of its owner block, with their spacing and the score, as
        `BuildingPoints` names them; None where it has none."""
        columns: dict[str, list[NDArray[Any]]] = {
            name: [] for name in ("xyz", "point_id", "part", "not_last", "intensity")
        }
        score, spacing = 0.0 if plan.given is None else 1.0, 1.0
        for block, label in plan.regions:
            for result, shift in self.parts(owner, [block]):
                spacing = result.spacing
                if plan.given is None:
                    chosen = result.numbers_of(label)
                    score = max(score, float(result.score[label - 1]) if len(result.score) else 1.0)
                else:
                    chosen = points_under(result, plan.given, shift)
                columns["xyz"].append(result.xyz[chosen] + shift)
                for name in ("point_id", "part", "not_last", "intensity"):
                    if getattr(result, name) is not None:
                        columns[name].append(getattr(result, name)[chosen])
        if not sum(map(len, columns["xyz"])):
            return None
        joined = {name: np.concatenate(pieces) for name, pieces in columns.items() if pieces}
        return joined | {"xyz": snap(joined["xyz"]), "spacing": spacing, "score": score}

    def near(self, owner: Block, blocks: Iterable[Block], reach: Bounds, free: bool) -> Points:
        """The points (K, 3) of some blocks within `reach`, about the owner block's corner: all of them, or
        the high ones that are `free`, no building's."""
        pieces = [np.zeros((0, 3))]
        for result, shift in self.parts(owner, blocks):
            rows = result.between(reach.south - shift[1], reach.north - shift[1])
            places = result.xyz[rows] + shift
            inside = reach.contains(places)
            if free:
                inside &= result.high[rows] & (result.label[rows] == 0)
            pieces.append(places[inside])
        return snap(np.concatenate(pieces))

    def nearest_ground(self, owner: Block, plan: BuildingPlan) -> Points | None:
        """The cells (K, 3) with ground that are nearest to a given footprint, and `MARGIN` farther, in the
        blocks it lies in; None when there are none. What is called ground under the footprint itself is not
        taken, nor what it touches: without ground around it a roof is the lowest surface, and passes for
        it."""
        assert plan.given is not None
        polygon, pieces = plan.given.polygon, []
        for block in plan.blocks:
            ground, terrain = self.terrain_of(block, "ground"), self.terrain_of(block, "dtm")
            if ground is None or terrain is None:
                continue
            xy = cells_of(ground) + np.subtract(block.origin, owner.origin)
            off = ~shapely.contains_xy(polygon.buffer(np.sqrt(2.0) * ground.cell), *xy.T)
            pieces.append(np.column_stack([xy, terrain.values[ground.values == 1]])[off])
        cells = np.concatenate([np.zeros((0, 3)), *pieces])
        if not len(cells):
            return None
        distance = shapely.distance(polygon, shapely.points(cells[:, :2]))
        return np.asarray(cells[distance <= distance.min() + MARGIN])

    def snapped(self, plan: OwnedBuildings) -> OwnedBuildings:
        """The plan with its given footprints moved to the eaves in the points, neighbours together."""
        buildings = [building for building in plan.buildings if building.failure is None]
        failures = tuple(building for building in plan.buildings if building.failure is not None)
        footprints = [building.given for building in buildings if building.given is not None]
        points, spacing = [], 1.0
        for result, shift in self.parts(plan.owner_block, plan.blocks):
            roof = (result.label > 0) & (result.part != WALL)
            points.append(result.xyz[roof] + shift)
            spacing = result.spacing
        if not points:
            return plan
        moved = snap_footprints(footprints, np.concatenate(points), spacing)
        pairs = zip(buildings, moved, strict=True)
        snapped = tuple(replace(building, given=outline) for building, outline in pairs)
        return replace(plan, buildings=snapped + failures)

    def terrain(self, owner: Block, bounds: Bounds, name: str = "dtm") -> Raster:
        """The terrain inside `bounds` (about the owner block's corner), or where ground was seen (`ground`);
        NaN where no block knows it."""
        west, south = np.floor(bounds.west / CELL) * CELL, np.floor(bounds.south / CELL) * CELL
        columns, rows = int(np.ceil((bounds.east - west) / CELL)), int(np.ceil((bounds.north - south) / CELL))
        north = south + rows * CELL
        values = np.full((rows, columns), np.nan, np.float32)
        for block in blocks_in(owner, Bounds(west, south, bounds.east, north)):
            tile = self.terrain_of(block, name)
            if tile is None:
                continue
            column = round((tile.west + block.origin[0] - owner.origin[0] - west) / CELL)
            top = round((north - (tile.north + block.origin[1] - owner.origin[1])) / CELL)
            height, width = tile.shape
            r0, r1 = max(top, 0), min(top + height, rows)
            c0, c1 = max(column, 0), min(column + width, columns)
            if r0 < r1 and c0 < c1:
                values[r0:r1, c0:c1] = tile.values[r0 - top : r1 - top, c0 - column : c1 - column]
        return Raster(values, float(west), float(north), CELL)


def read_result(regions: Mapping[Block, BlockFile], block: Block, take: Callable[[BlockFile], T]) -> T | None:
    """Value that `take` reads from the result of a block; None where it failed or has no points."""
    return take(regions[block]) if block in regions else None


def blocks_in(owner: Block, bounds: Bounds) -> list[Block]:
    """The blocks that `bounds` (about the owner block's corner) reach into."""
    return squares_touching(bounds.translated(*owner.origin), owner.side)


def cells_of(ground: Raster) -> Points:
    """The centres (K, 2) of the cells that hold ground."""
    rows, columns = np.nonzero(ground.values == 1)
    return np.column_stack(
        [ground.west + (columns + 0.5) * ground.cell, ground.north - (rows + 0.5) * ground.cell]
    )


def is_seen_beside(polygon: Polygon, ground: Raster) -> bool:
    """True if ground was seen beside an outline and within `MARGIN` of it, off the cells that it touches."""
    xy = cells_of(ground)
    xy = xy[Bounds(*polygon.bounds).buffered(MARGIN).contains(xy)]
    wide, narrow = polygon.buffer(MARGIN), polygon.buffer(np.sqrt(2.0) * ground.cell)
    shapely.prepare([wide, narrow])
    xy = xy[~shapely.intersects_xy(narrow, *xy.T)]
    return bool(shapely.contains_xy(wide, *xy.T).any())


def points_under(result: Candidates, given: Footprint, shift: np.ndarray) -> NDArray[np.int64]:
    """The numbers (K,) of a block's points that belong to a given footprint: the detector's or the high."""
    west, south, east, north = given.polygon.bounds
    rows = result.between(south - shift[1], north - shift[1])
    x, y = (result.xyz[rows, :2] + shift[:2]).T
    inside = (x >= west) & (x <= east) & (y >= south) & (y <= north)
    shapely.prepare(given.polygon)
    inside[inside] = shapely.contains_xy(given.polygon, x[inside], y[inside])
    number = rows.start + np.flatnonzero(inside)
    high = result.high[number]
    detected = result.label[number] > 0
    trusted = detected.sum() >= TRUSTED_SHARE * max(high.sum(), 1)
    return np.asarray(number[detected if trusted else high])


House = tuple[BuildingPoints, Footprint | Failure]


def select_roof(building: BuildingPoints) -> NDArray[np.int64]:
    """The points of a building that show its roof: not those on its walls, nor of crowns over it.

    Parameters
    ----------
    building : BuildingPoints
        One of `divide_buildings`, of N points.

    Returns
    -------
    ndarray (M,) of int64
        Their numbers, ascending.

    Raises
    ------
    AttributeError
        When it is no BuildingPoints.

    Examples
    --------
    >>> import eaves
    >>> buildings = []                                   # of divide_buildings
    >>> [building.xyz[eaves.select_roof(building)] for building in buildings]
    []
    """
    roof = np.flatnonzero(building.part != WALL)
    return roof[~crown_points(building.xyz[roof], building.roof_not_last)]


def random_numbers_of(points: Points) -> np.random.Generator:
    """Random numbers that follow from roof points (N, 3): nothing else changes their roof."""
    return np.random.default_rng(int(key_of(points), 16))


def draw_blocks(
    buildings: Sequence[BuildingPoints],
    footprints: Sequence[Footprint | Failure],
    recipe: Recipe,
    known: Container[int] = (),
) -> list[BlockPart | None]:
    """The parts that houses wall to wall have of their block's roof, each block drawn as one.

    Parameters
    ----------
    buildings : sequence of BuildingPoints
        Those of `divide_buildings`.
    footprints : sequence of Footprint or Failure
        One for each.
    recipe : Recipe
        The methods.
    known : container of int
        Numbers of buildings of which no part is asked for.

    Returns
    -------
    list of BlockPart or None
        One for each, for `reconstruct_building`, with the roof planes of its points; None for a building that
        is modelled by itself: one alone, between known walls, or of a block that cannot be drawn.

    Raises
    ------
    ValueError
        When there is not one footprint for each building.

    Examples
    --------
    >>> import eaves
    >>> eaves.draw_blocks([], [], eaves.make_recipe())
    []
    """
    drawn: list[BlockPart | None] = []
    for group in in_blocks(buildings, footprints):
        parts: Sequence[BlockPart | None] = [None] * len(group)
        divided = len(group) > 1 and all(house.wall_certainty is not None for house, _ in group)
        if divided and len(drawn) not in known and recipe.lod != "0" and recipe.reconstruct.draws_blocks:
            try:
                parts = parts_of(group, recipe) or parts
            except ContractError:
                raise
            except Exception as error:  # it must not take its houses with it
                log.warning("a block could not be drawn, its houses stand alone: %s", error_line(error))
                log.debug("traceback", exc_info=True)
        drawn += parts
    return drawn


def in_blocks(
    buildings: Sequence[BuildingPoints], footprints: Sequence[Footprint | Failure]
) -> Iterator[list[House]]:
    """The buildings with their footprints, those of one divided block together."""
    houses = enumerate(zip(buildings, footprints, strict=True))

    def block_of(numbered: tuple[int, House]) -> int:
        number, (building, _) = numbered
        return -1 - number if building.block is None else id(building.block)

    return ([house for _, house in group] for _, group in groupby(houses, block_of))


def building_keys(
    buildings: Sequence[BuildingPoints], footprints: Sequence[Footprint | Failure]
) -> list[str]:
    """The key of what each building follows from: a house in a block from all of it."""
    keys = []
    for group in in_blocks(buildings, footprints):
        whole = key_of(*(one for house in group for one in house))
        keys += [whole] if len(group) == 1 else [key_of(whole, number) for number in range(len(group))]
    return keys


def parts_of(group: Sequence[House], recipe: Recipe) -> list[BlockPart] | None:
    """The parts of the houses of one block; None where it cannot be drawn."""
    first, _ = group[0]
    assert first.block is not None
    base, _ = heights_under(first.block, first.terrain, first.ground_nearest)
    outlines = [one if isinstance(one, Footprint) else one.footprint for _, one in group]
    polygons = [outline.polygon for outline in outlines if outline is not None]
    if not np.isfinite(base) or len(polygons) < len(group):
        return None
    roofs = [house.xyz[select_roof(house)] for house, _ in group]
    points, ends = np.vstack(roofs), np.cumsum([0, *map(len, roofs)])
    planes = segment_roof(points, first.spacing, recipe.roof, rng=random_numbers_of(points))
    block = draw_block(points, polygons, planes, base, recipe.reconstruct)
    if isinstance(block, Failure):
        return None
    parts = []
    for number, (begin, end) in enumerate(pairwise(ends.tolist())):
        own = [(plane, (plane.members >= begin) & (plane.members < end)) for plane in planes]
        kept = [replace(plane, members=plane.members[mine] - begin) for plane, mine in own if mine.any()]
        parts.append(BlockPart(block, number, kept))
    return parts
