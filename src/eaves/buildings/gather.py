"""Puts the points and the terrain of one building together from the results of the blocks it lies in."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any, TypeVar

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from eaves.blocks.block_file import BlockFile, Candidates
from eaves.buildings.join import BuildingPlan, OwnedBuildings
from eaves.footprints.snap import snap_footprints
from eaves.model import Block, Bounds, Failure, Footprint, Points, Raster
from eaves.model.cloud import snap
from eaves.model.results import BuildingPoints
from eaves.model.scene import WALL
from eaves.raster.surfaces import CELL
from eaves.run.world_squares import squares_touching

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
