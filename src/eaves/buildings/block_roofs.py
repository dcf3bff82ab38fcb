"""The roofs of buildings before they are modelled: of the houses of a block drawn as one."""

from __future__ import annotations

import logging
from collections.abc import Container, Iterator, Sequence
from dataclasses import replace
from itertools import groupby, pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from eaves.methods import ContractError
from eaves.model import Failure, Footprint, Points
from eaves.model.checks import error_line
from eaves.model.results import BuildingPoints
from eaves.model.scene import WALL
from eaves.raster.surfaces import heights_under
from eaves.reconstruct.stage import BlockPart, draw_block
from eaves.roof import segment_roof
from eaves.roof.toolkit.crowns import crown_points
from eaves.run.keys import key_of

if TYPE_CHECKING:
    from eaves.recipe.recipe import Recipe

log = logging.getLogger("eaves")

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
