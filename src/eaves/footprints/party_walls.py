"""A block's outline split into its addresses along known party walls."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from shapely import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from eaves.geometry.pieces import borders_of, joined_pieces
from eaves.geometry.rings import polygon_parts
from eaves.geometry.tolerance import COORDINATE_STEP
from eaves.model import Footprint
from eaves.outline.toolkit.shared_edges import welded_outlines

OVERHANG_M = 3.0
"""Distance by which a party wall is extended past its ends, across the overhang to the eaves."""
HELD_M = 1.0
"""A block holds an address when a disc of this radius fits into what they share …"""
NARROW_M = 0.5
"""… or one of this radius, when they share more than half of the address: passages, narrow annexes."""


def split_block(
    block: Polygon, addresses: Sequence[Footprint]
) -> tuple[list[Footprint | None], list[Polygon]]:
    """The part of a block's outline that belongs to each address, and the parts that belong to none.

    None stands for an address that the block does not hold (`HELD_M`, `NARROW_M`). The outlines of the
    addresses cut the block, their party walls carried on to the eaves. A piece belongs to the address that
    covers most of it; a piece that none covers goes to the neighbour it shares the longest border with,
    unless it is wider than an overhang: then it is a building that the addresses leave out. So the parts
    fill the block, without gap or overlap, and neighbours share their edges.
    """
    shared = shapely.intersection(block, [address.polygon for address in addresses])
    mostly = shapely.area(shared) > 0.5 * shapely.area([address.polygon for address in addresses])
    reach = np.where(mostly, NARROW_M, HELD_M)
    held = np.flatnonzero(~shapely.is_empty(shapely.buffer(shared, -reach)))
    answers: list[Footprint | None] = [None] * len(addresses)
    if len(held) == 0:
        return answers, [block]
    polygons = [addresses[int(number)].polygon for number in held]
    walls = carried_on_walls(polygons)
    polygons += wide_parts(shapely.difference(block, shapely.union_all(polygons), grid_size=COORDINATE_STEP))
    cuts = [block.boundary, *(polygon.boundary for polygon in polygons), *walls]
    pieces = [
        piece
        for piece in shapely.get_parts(
            shapely.polygonize([shapely.union_all(cuts, grid_size=COORDINATE_STEP)])
        )
        if block.covers(piece.representative_point())
    ]
    parts = joined_pieces(pieces, owners_of(pieces, polygons), len(polygons))
    there = [number for number, part in enumerate(parts) if part is not None]
    rest = []
    for number, part in zip(
        there, welded_outlines([part for part in parts if part is not None]), strict=True
    ):
        plain = shapely.remove_repeated_points(part, 3.0 * COORDINATE_STEP)
        whole = shapely.orient_polygons(plain if plain.is_valid else part)
        if number < len(held):
            answers[int(held[number])] = addresses[int(held[number])].with_(polygon=whole)
        else:
            rest.append(whole)
    return answers, rest


def wide_parts(area: BaseGeometry) -> list[Polygon]:
    """The parts of an area that are wider than an overhang, without what hangs on them that is not."""
    half = 0.5 * OVERHANG_M
    opened = area.buffer(-half, join_style="mitre").buffer(half, join_style="mitre")
    return polygon_parts(shapely.intersection(opened, area, grid_size=COORDINATE_STEP))


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
            border = borders_of(int(number), pieces, owner, len(polygons))
            if border.max(initial=0.0) > 0.0:
                owner[number] = int(np.argmax(border))
                changed = True
    return owner
