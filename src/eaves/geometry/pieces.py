"""Pieces of a divided polygon, each with an owner: joined, and what hangs loose."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from eaves.geometry.rings import polygon_parts
from eaves.geometry.tolerance import COORDINATE_STEP
from eaves.model import Integers, Values


def pieces_between(outline: Polygon, lines: Sequence[BaseGeometry]) -> list[Polygon]:
    """The pieces that lines cut an outline into."""
    net = shapely.union_all([outline.boundary, *lines], grid_size=COORDINATE_STEP)
    pieces = shapely.get_parts(shapely.polygonize([net]))
    return [piece for piece in pieces if outline.covers(piece.representative_point())]


def joined_pieces(pieces: Sequence[Polygon], owner: list[int], count: int) -> list[Polygon | None]:
    """One polygon for each of `count` owners; what does not hang together with it goes to its neighbours."""
    loose = [
        number
        for label in range(count)
        for number in loose_pieces(pieces, [k for k, holder in enumerate(owner) if holder == label])
    ]
    for number in loose:
        border = borders_of(number, pieces, owner, count)
        border[owner[number]] = 0.0
        if border.max(initial=0.0) > 0.0:
            owner[number] = int(np.argmax(border))
    joined: list[Polygon | None] = []
    for label in range(count):
        members = [piece for piece, number in zip(pieces, owner, strict=True) if number == label]
        parts = polygon_parts(shapely.union_all(members, grid_size=COORDINATE_STEP)) if members else []
        whole = max(parts, key=lambda part: part.area, default=None)
        plain = shapely.remove_repeated_points(whole, 3.0 * COORDINATE_STEP)
        joined.append(shapely.orient_polygons(plain if plain and plain.is_valid else whole))
    return joined


def loose_pieces(pieces: Sequence[Polygon], members: Sequence[int]) -> list[int]:
    """Those of the pieces numbered `members` that are not in the largest part of their union."""
    parts = polygon_parts(shapely.union_all([pieces[k] for k in members], grid_size=COORDINATE_STEP))
    if len(parts) < 2:
        return []
    largest = max(parts, key=lambda part: part.area)
    return [k for k in members if not largest.covers(pieces[k].representative_point())]


def borders_of(number: int, pieces: Sequence[Polygon], owner: Sequence[int], count: int) -> Values:
    """Length (count,) of the border that a piece shares with the pieces of each owner (m)."""
    border = np.zeros(count)
    for k, (piece, holder) in enumerate(zip(pieces, owner, strict=True)):
        if holder >= 0 and k != number and piece.intersects(pieces[number]):
            border[holder] += piece.intersection(pieces[number]).length
    return border


def owned_by_neighbours(pieces: Sequence[Polygon], owner: Sequence[int], count: int) -> list[int]:
    """The owner of each piece, those without one (-1) given to the owner of the longest border with it.

    The piece with the longest border is given first, and its own borders count from then on: a sliver goes
    along its side, not across its tip, which would leave a spike. What touches no owner keeps -1.
    """
    owners, shapes = np.array(owner, np.int64), np.array(pieces, object)
    border = np.zeros((len(shapes), count))
    here, there = shapely.STRtree(shapes).query(shapes, predicate="intersects")
    here, there = here[here != there], there[here != there]
    length = shapely.length(shapely.intersection(shapes[here], shapes[there]))

    def count_borders(pairs: Integers) -> None:
        np.add.at(border, (here[pairs], owners[there[pairs]]), length[pairs])

    count_borders(np.flatnonzero(owners[there] >= 0))
    while (free := np.where(owners < 0, border.max(axis=1, initial=0.0), 0.0)).max(initial=0.0) > 0.0:
        given = int(np.argmax(free))
        owners[given] = np.argmax(border[given])
        count_borders(np.flatnonzero(there == given))
    return list(map(int, owners))
