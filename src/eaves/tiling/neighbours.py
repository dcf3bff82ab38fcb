"""What buildings know of each other only when all are modelled: the walls they share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
import shapely

from eaves.model import Block, BuildingModel, Failure
from eaves.reconstruct.party_walls import PARTY_GAP, party_wall_area
from eaves.tiling.store import Store

HOMES_IN_MEMORY = 16
"""Home blocks whose buildings are kept while those around them are looked at."""


def party_walls(store: Store, homes: Sequence[Block]) -> list[float | None]:
    """The area (m²) of the walls each building shares with others, in the order of the store's results;
    None for a building without solids.
    """

    @lru_cache(maxsize=HOMES_IN_MEMORY)
    def load(home: int) -> list[BuildingModel | Failure]:
        return list(store.answers([homes[home]]))

    places: list[tuple[int, int]] = []
    polygons = []
    for home in range(len(homes)):
        for number, digest in enumerate(store.digests([homes[home]])):
            places.append((home, number))
            polygons.append(digest.polygon)
    shapes = np.array(polygons, object)
    one, other = shapely.STRtree(shapes).query(shapes, predicate="dwithin", distance=PARTY_GAP)
    order = np.lexsort((other, one))
    one, other = one[order], other[order]
    first = np.searchsorted(one, np.arange(len(places) + 1))
    return [
        shared_by(places[number], [places[near] for near in other[first[number] : first[number + 1]]], load)
        for number in range(len(places))
    ]


def shared_by(
    place: tuple[int, int],
    near: Sequence[tuple[int, int]],
    load: Callable[[int], list[BuildingModel | Failure]],
) -> float | None:
    """The party walls (m²) of the building at `place`, a home and a number in it, with those `near` it."""
    model = load(place[0])[place[1]]
    if not isinstance(model, BuildingModel) or not model.solids:
        return None
    answers = [load(home)[number] for home, number in near if (home, number) != place]
    models = [answer for answer in answers if isinstance(answer, BuildingModel)]
    return round(party_wall_area(model, models), 2)
