"""Detected blocks divided: into the addresses between known party walls, or the units their points show."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import shapely
from shapely import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from eaves.geometry.rings import (
    COORDINATE_STEP,
    joined_pieces,
    owned_by_neighbours,
    pieces_between,
    polygon_parts,
)
from eaves.methods import ContractError, MethodChoice, resolve_method
from eaves.model import Failure, Footprint, Integers
from eaves.model.checks import error_line
from eaves.model.results import BuildingPoints
from eaves.units import UnitMethod, divide_block

log = logging.getLogger("eaves")
Drawn = list[Footprint | Failure]


def divide_buildings(
    buildings: Sequence[BuildingPoints],
    footprints: Sequence[Footprint | Failure],
    method: MethodChoice = None,
    addresses: Sequence[Footprint] = (),
) -> tuple[list[BuildingPoints], Drawn]:
    """Buildings and footprints with every detected block divided into its addresses, else into its units.

    The part with the inner point of an address carries its id; all parts carry its attributes, and what no
    address covers is a building of its own. A block that no address lies in is divided along the party walls
    that the method finds in its points. The points of the block go to the part they lie in or next to.

    A block whose division raises stays one building, with walls of no certainty: it must not take the others
    with it.

    Parameters
    ----------
    buildings : sequence of BuildingPoints
        Those of `trace_buildings`.
    footprints : sequence of Footprint or Failure
        One for each, as `draw_outlines` gives them.
    method : UnitMethod, str, mapping or None
        The method of the units, its name, or its parameters; `off` for none; None is `RowWalls()`.
    addresses : sequence of Footprint
        Between known party walls, about the same origin.

    Returns
    -------
    (list of BuildingPoints, list of Footprint or Failure)
        A building that is divided has its parts in its place.

    Raises
    ------
    ValueError
        When there is not one footprint for each building, or no method has that name.

    Examples
    --------
    >>> import eaves
    >>> eaves.divide_buildings([], [])
    ([], [])
    """
    units = None if method == "off" else resolve_method("units", method)
    assert isinstance(units, UnitMethod | None)
    pieces: list[BuildingPoints] = []
    outlines: Drawn = []
    for building, footprint in zip(buildings, footprints, strict=True):
        whole = [(building, footprint)]
        try:
            divided = list(divided_block(building, footprint, addresses, units))
        except ContractError:
            raise
        except Exception as error:
            log.warning("a block could not be divided and stays one building: %s", error_line(error))
            log.debug("traceback", exc_info=True)
            divided, whole = [], [(replace(building, wall_certainty=0.0), footprint)]
        for piece, outline in divided or whole:
            pieces.append(piece)
            outlines.append(outline)
    return pieces, outlines


def divided_block(
    building: BuildingPoints,
    footprint: Footprint | Failure,
    addresses: Sequence[Footprint],
    units: UnitMethod | None,
) -> Iterator[tuple[BuildingPoints, Footprint | Failure]]:
    """The addresses or units of a detected block with their points; none where it stays whole."""
    if isinstance(footprint, Failure) or building.given is not None:
        return
    parts = parts_of(building, footprint, addresses)
    certainty: Sequence[float | None] = [None] * len(parts)
    if not parts and units is not None:
        parts, certainty = units_of(building, footprint, units)
    if not parts:
        return
    owner = nearest_part(building, [part.polygon for part in parts])
    for k, part in enumerate(parts):
        inside = owner == k
        reason = "no point of the block lies in this address"
        outline = part if inside.any() else Failure("no_points", reason, "outline", part)
        yield building.take(inside, block=footprint, wall_certainty=certainty[k]), outline


def units_of(
    building: BuildingPoints, footprint: Footprint, method: UnitMethod
) -> tuple[list[Footprint], Sequence[float | None]]:
    """The units the points of a block show, and how sure their walls are; none where it stays whole."""
    points = building.roof_points
    height = points[:, 2] - building.terrain.at(points)
    division = divide_block(
        points, height, footprint.polygon, building.spacing, method, building.roof_intensity
    )
    if len(division.parts) < 2:
        return [], ()
    drawn = replace(footprint, id="", score=building.score, attributes={})
    return [drawn.with_(polygon=part) for part in division.parts], division.certainty


def parts_of(
    building: BuildingPoints, footprint: Footprint, addresses: Sequence[Footprint]
) -> list[Footprint]:
    """The parts of one block, those with an address first; none where no address lies in it."""
    touching = [address for address in addresses if address.polygon.intersects(footprint.polygon)]
    shares, unclaimed = split_block(footprint.polygon, touching)
    parts = []
    for address, part in zip(touching, shares, strict=True):
        if part is not None:
            here = part.polygon.contains(address.polygon.representative_point())
            parts.append(part.with_(id=part.id if here else "", score=building.score))
    rest = replace(footprint, id="", score=1.0, attributes={})
    return [*parts, *(rest.with_(polygon=polygon) for polygon in unclaimed)] if parts else []


def nearest_part(building: BuildingPoints, parts: Sequence[Polygon]) -> Integers:
    """The number (N,) of the part that each point lies in, or nearest to."""
    xy = building.xyz[:, :2]
    owner = np.full(len(xy), -1)
    for number, part in enumerate(parts):
        west, south, east, north = part.bounds
        boxed = (
            (owner < 0) & (xy[:, 0] >= west) & (xy[:, 0] <= east) & (xy[:, 1] >= south) & (xy[:, 1] <= north)
        )
        candidates = np.flatnonzero(boxed)
        shapely.prepare(part)
        owner[candidates[shapely.contains_xy(part, xy[candidates])]] = number
    outside = np.flatnonzero(owner < 0)
    point, part_of = shapely.STRtree(parts).query_nearest(shapely.points(xy[outside]), all_matches=True)
    nearest = np.full(len(outside), len(parts))
    np.minimum.at(nearest, point, part_of)
    owner[outside] = nearest
    return owner


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
    half_inside = shapely.area(shared) > 0.5 * shapely.area([address.polygon for address in addresses])
    reach = np.where(half_inside, NARROW_M, HELD_M)
    members = np.flatnonzero(~shapely.is_empty(shapely.buffer(shared, -reach)))
    shares: list[Footprint | None] = [None] * len(addresses)
    if len(members) == 0:
        return shares, [block]
    polygons = [addresses[int(number)].polygon for number in members]
    walls = carried_on_walls(polygons)
    polygons += wide_parts(shapely.difference(block, shapely.union_all(polygons), grid_size=COORDINATE_STEP))
    pieces = pieces_between(block, [*shapely.boundary(polygons), *walls])
    unclaimed = []
    for number, outline in enumerate(joined_pieces(pieces, owners_of(pieces, polygons), len(polygons))):
        if outline is not None and number < len(members):
            shares[int(members[number])] = addresses[int(members[number])].with_(polygon=outline)
        elif outline is not None:
            unclaimed.append(outline)
    return shares, unclaimed


def wide_parts(area: BaseGeometry) -> list[Polygon]:
    """The parts of an area that are wider than an overhang, without what hangs on them that is not."""
    half = 0.5 * OVERHANG_M
    opened = area.buffer(-half, join_style="mitre").buffer(half, join_style="mitre")
    return polygon_parts(shapely.intersection(opened, area, grid_size=COORDINATE_STEP))


def carried_on_walls(polygons: Sequence[Polygon]) -> list[LineString]:
    """The common borders of the polygons, each straight run carried on past both ends."""
    walls = []
    tree = shapely.STRtree(polygons)
    first, second = tree.query(polygons, predicate="dwithin", distance=COORDINATE_STEP)
    for a, b in zip(first[first < second], second[first < second], strict=True):
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
    return owned_by_neighbours(pieces, owner, len(polygons))
