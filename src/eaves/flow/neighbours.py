"""The walls that buildings share, known once all are modelled."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
import shapely

from eaves.buildings.building_file import ANSWERS, Kept
from eaves.figures.party_walls import PARTY_GAP, Walls, wall_figures
from eaves.model import Block, BuildingModel, Failure

HOMES_IN_MEMORY = 16
"""Home blocks whose buildings are kept while those around them are looked at."""


def party_walls(kept: Kept, owners: Sequence[Block]) -> list[dict[str, float] | None]:
    """The walls each building shares with others, and its free ones, in the order of the store's results;
    None for a building without solids."""

    @lru_cache(maxsize=HOMES_IN_MEMORY)
    def load(owner: int) -> Callable[[int], Walls | None]:
        """The walls of each of an owner block's buildings: measured once, for one has several neighbours."""
        answers = kept.section(owners[owner], ANSWERS)
        return lru_cache(maxsize=None)(lambda number: walls_of(answers[number]))

    places = [
        (owner, number, row.polygon)
        for owner in range(len(owners))
        for number, row in enumerate(kept.rows([owners[owner]]))
    ]
    shapes = np.array([polygon for *_, polygon in places], object)
    one, other = shapely.STRtree(shapes).query(shapes, predicate="dwithin", distance=PARTY_GAP)
    order = np.lexsort((other, one))
    one, other = one[order], other[order]
    first = np.searchsorted(one, np.arange(len(places) + 1))
    return [
        shared_by(place, [places[k][:2] for k in other[first[number] : first[number + 1]]], load)
        for number, (*place, _) in enumerate(places)
    ]


def walls_of(answer: BuildingModel | Failure) -> Walls | None:
    """The walls of a building that has solids."""
    return Walls.of(answer) if isinstance(answer, BuildingModel) and answer.solids else None


def shared_by(
    place: Sequence[int],
    near: Sequence[Sequence[int]],
    load: Callable[[int], Callable[[int], Walls | None]],
) -> dict[str, float] | None:
    """The walls (m², `wall_figures`) of the building at `place`, an owner and a number in it."""
    own = load(place[0])(place[1])
    if own is None:
        return None
    others = [load(owner)(number) for owner, number in near if [owner, number] != [*place]]
    return wall_figures(own, [walls for walls in others if walls is not None])
