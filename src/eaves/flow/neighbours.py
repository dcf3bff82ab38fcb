"""The walls that buildings share, known once all are modelled."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
import shapely
from shapely import Polygon

from eaves.buildings.building_file import ANSWERS, Kept
from eaves.figures.party_walls import PARTY_GAP, Walls, wall_figures
from eaves.model import Block, BuildingModel, Failure

HOMES_IN_MEMORY = 16
"""Home blocks whose buildings are kept while those around them are looked at."""


def party_walls(buildings: Kept, owners: Sequence[Block]) -> list[dict[str, float] | None]:
    """The walls each building shares with others, and its free ones, in the order of the store's results;
    None for a building without solids."""

    @lru_cache(maxsize=HOMES_IN_MEMORY)
    def load(owner: int) -> Callable[[int], Walls | None]:
        """The walls of each of an owner block's buildings: measured once, for one has several neighbours."""
        outcomes = buildings.section(owners[owner], ANSWERS)
        return lru_cache(maxsize=None)(lambda number: walls_of(outcomes[number]))

    boxes = np.array([extent_of(buildings, owner) for owner in owners], object)
    first, second = shapely.STRtree(boxes).query(boxes, predicate="dwithin", distance=PARTY_GAP)
    near = {number: {number} for number in range(len(owners))}
    for owner, neighbour in zip(first.tolist(), second.tolist(), strict=True):
        near[owner].add(neighbour)
    walls: list[dict[str, float] | None] = []
    for owner in near:
        walls += walls_in(buildings, owners, owner, sorted(near[owner]), load)
    return walls


def extent_of(buildings: Kept, owner: Block) -> Polygon:
    """The rectangle (world metres) around the buildings that a block owns."""
    outlines = [row.polygon for row in buildings.rows([owner])]
    return shapely.envelope(shapely.geometrycollections(outlines))


def walls_in(
    buildings: Kept,
    owners: Sequence[Block],
    owner: int,
    near: Sequence[int],
    load: Callable[[int], Callable[[int], Walls | None]],
) -> list[dict[str, float] | None]:
    """The walls of the buildings of one owner block, beside those of the owner blocks near it, by number."""
    places = [
        (number, place, row.polygon)
        for number in near
        for place, row in enumerate(buildings.rows([owners[number]]))
    ]
    subjects = [k for k, (number, *_) in enumerate(places) if number == owner]
    shapes = np.array([polygon for *_, polygon in places], object)
    first, second = shapely.STRtree(shapes).query(shapes[subjects], predicate="dwithin", distance=PARTY_GAP)
    return [
        shared_by(places[k][:2], [places[n][:2] for n in np.sort(second[first == subject]).tolist()], load)
        for subject, k in enumerate(subjects)
    ]


def walls_of(outcome: BuildingModel | Failure) -> Walls | None:
    """The walls of a building that has solids."""
    return Walls.of(outcome) if isinstance(outcome, BuildingModel) and outcome.solids else None


def shared_by(
    place: tuple[int, int],
    near: Sequence[tuple[int, int]],
    load: Callable[[int], Callable[[int], Walls | None]],
) -> dict[str, float] | None:
    """The walls (m², `wall_figures`) of the building at `place`, an owner and a number in it."""
    subject = load(place[0])(place[1])
    if subject is None:
        return None
    neighbours = [load(owner)(number) for owner, number in near if (owner, number) != place]
    return wall_figures(subject, [walls for walls in neighbours if walls is not None])
