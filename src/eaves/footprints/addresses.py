"""Detected blocks divided: into the addresses between known party walls, or the units their points show."""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import GEOSException, Polygon

from eaves.footprints.party_walls import split_block
from eaves.model import Failure, Footprint
from eaves.model.results import BuildingPoints
from eaves.units import UnitMethod, divide_block

log = logging.getLogger("eaves")
Drawn = list[Footprint | Failure]


def split_buildings(
    buildings: Sequence[BuildingPoints],
    footprints: Drawn,
    addresses: Sequence[Footprint],
    units: UnitMethod | None = None,
) -> tuple[list[BuildingPoints], Drawn]:
    """Buildings and footprints with every detected block divided into its addresses, else into its units.

    The part with the inner point of an address carries its id; all parts carry its attributes, and what no
    address covers is a building of its own. A block that no address lies in is divided along the party walls
    that `units` finds in its points. The points of the block go to the part they lie in or next to.
    """
    pieces: list[BuildingPoints] = []
    outlines: Drawn = []
    for building, footprint in zip(buildings, footprints, strict=True):
        parts: list[Footprint] = []
        certainty: Sequence[float | None] = ()
        if not isinstance(footprint, Failure) and building.given is None:
            parts = parts_of(building, footprint, addresses)
            certainty = [None] * len(parts)
            if not parts and units is not None:
                parts, certainty = units_of(building, footprint, units)
        if not parts:
            pieces.append(building)
            outlines.append(footprint)
            continue
        assert isinstance(footprint, Footprint)
        owner = nearest_part(building, [part.polygon for part in parts])
        for k, part in enumerate(parts):
            inside = owner == k
            pieces.append(building.take(inside, block=footprint, wall_certainty=certainty[k]))
            reason = "no point of the block lies in this address"
            outlines.append(part if inside.any() else Failure("no_points", reason, "outline", part))
    return pieces, outlines


def units_of(
    building: BuildingPoints, footprint: Footprint, method: UnitMethod
) -> tuple[list[Footprint], Sequence[float | None]]:
    """The units the points of a block show, and how sure their walls are; none where it stays whole."""
    points = building.roof_points
    height = points[:, 2] - building.terrain.at(points)
    try:
        division = divide_block(points, height, footprint.polygon, building.spacing, method)
    except GEOSException as error:
        log.warning("a block could not be divided into units and stays one building: %s", error)
        return [], ()
    if len(division.parts) < 2:
        return [], ()
    parts = [Footprint(part, origin=footprint.origin, score=building.score) for part in division.parts]
    return parts, division.certainty


def parts_of(
    building: BuildingPoints, footprint: Footprint, addresses: Sequence[Footprint]
) -> list[Footprint]:
    """The parts of one block, those with an address first; none where no address lies in it."""
    near = [address for address in addresses if address.polygon.intersects(footprint.polygon)]
    try:
        found, rest = split_block(footprint.polygon, near)
    except GEOSException as error:
        log.warning("a block could not be split into its addresses and stays one building: %s", error)
        return []
    parts = []
    for address, part in zip(near, found, strict=True):
        if part is not None:
            here = part.polygon.contains(address.polygon.representative_point())
            parts.append(part.with_(id=part.id if here else "", score=building.score))
    return [*parts, *(Footprint(polygon, origin=footprint.origin) for polygon in rest)] if parts else []


def nearest_part(building: BuildingPoints, parts: Sequence[Polygon]) -> NDArray[np.int64]:
    """The number (N,) of the part that each point lies in, or nearest to."""
    xy = building.xyz[:, :2]
    owner = np.full(len(xy), -1)
    for number, part in enumerate(parts):
        west, south, east, north = part.bounds
        near = (
            (owner < 0) & (xy[:, 0] >= west) & (xy[:, 0] <= east) & (xy[:, 1] >= south) & (xy[:, 1] <= north)
        )
        some = np.flatnonzero(near)
        shapely.prepare(part)
        owner[some[shapely.contains_xy(part, xy[some])]] = number
    left = np.flatnonzero(owner < 0)
    point, part_of = shapely.STRtree(parts).query_nearest(shapely.points(xy[left]), all_matches=True)
    nearest = np.full(len(left), len(parts))
    np.minimum.at(nearest, point, part_of)
    owner[left] = nearest
    return owner
