"""A block's outline split into its addresses along known party walls."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from shapely import LineString, Polygon

from eaves.geometry.polygons import polygon_parts
from eaves.geometry.tolerance import COORDINATE_STEP
from eaves.model import Footprint

OVERHANG_M = 3.0
"""A party wall is carried on past its ends by this much, across the overhang to the eaves."""


def split_block(block: Polygon, addresses: Sequence[Footprint]) -> list[Footprint | None]:
    """The part of a block's outline that belongs to each address; None for an address outside the block.

    The outlines of the addresses cut the block, their party walls carried on to the eaves. A piece belongs
    to the address that covers most of it; a piece that none covers goes to the neighbour it shares the
    longest border with. So the parts fill the block, without gap or overlap, and neighbours share their
    edges.
    """
    polygons = [address.polygon for address in addresses]
    cuts = [block.boundary, *(polygon.boundary for polygon in polygons), *carried_on_walls(polygons)]
    pieces = [
        piece
        for piece in shapely.get_parts(
            shapely.polygonize([shapely.union_all(cuts, grid_size=COORDINATE_STEP)])
        )
        if block.covers(piece.representative_point())
    ]
    owner = owners_of(pieces, polygons)
    answers: list[Footprint | None] = []
    for number, address in enumerate(addresses):
        mine = [piece for piece, one in zip(pieces, owner, strict=True) if one == number]
        parts = polygon_parts(shapely.union_all(mine, grid_size=COORDINATE_STEP)) if mine else []
        if not parts:
            answers.append(None)
        else:
            answers.append(
                address.with_(polygon=shapely.orient_polygons(max(parts, key=lambda part: part.area)))
            )
    return answers


def carried_on_walls(polygons: Sequence[Polygon]) -> list[LineString]:
    """The common borders of the polygons, each straight run carried on past both ends."""
    walls = []
    tree = shapely.STRtree(polygons)
    one, other = tree.query(polygons, predicate="dwithin", distance=COORDINATE_STEP)
    for a, b in zip(one[one < other], other[one < other], strict=True):
        common = shapely.line_merge(polygons[a].boundary.intersection(polygons[b].boundary))
        for line in shapely.get_parts(common):
            if line.geom_type != "LineString" or line.length < COORDINATE_STEP:
                continue
            xy = np.asarray(line.coords)
            for end, inner in ((xy[0], xy[1]), (xy[-1], xy[-2])):
                away = (end - inner) / np.hypot(*(end - inner))
                walls.append(LineString([end, end + OVERHANG_M * away]))
    return walls


def owners_of(pieces: Sequence[Polygon], polygons: Sequence[Polygon]) -> list[int]:
    """The number of the polygon each piece belongs to, -1 for a piece that touches none."""
    owner = []
    for piece in pieces:
        covered = shapely.area(shapely.intersection(piece, polygons))
        best = int(np.argmax(covered))
        owner.append(best if covered[best] > 0.5 * piece.area else -1)
    changed = True
    while changed:
        changed = False
        for number in np.flatnonzero(np.array(owner) < 0):
            lost = pieces[int(number)]
            border = np.zeros(len(polygons))
            for piece, one in zip(pieces, owner, strict=True):
                if one >= 0 and piece.intersects(lost):
                    border[one] += piece.intersection(lost).length
            if border.max(initial=0.0) > 0.0:
                owner[number] = int(np.argmax(border))
                changed = True
    return owner
