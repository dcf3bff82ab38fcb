"""Areas and footprints that the user gives, in world metres."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from eaves.footprints.given import clip_footprints, repair_footprints, unusable_footprints
from eaves.formats import read_polygons
from eaves.model import Bounds, CoordinateSystem, Failure, Footprint

log = logging.getLogger("eaves")


def in_metres(bounds: Bounds | None, system: CoordinateSystem) -> Bounds | None:
    """Bounds given in the system's unit, in metres."""
    if bounds is None:
        return None
    unit = system.horizontal_unit_m
    return Bounds(bounds.west * unit, bounds.south * unit, bounds.east * unit, bounds.north * unit)


def read_area(path: Path, system: CoordinateSystem) -> BaseGeometry:
    """The union of a file's polygons, prepared for many questions."""
    area = shapely.union_all(shapely.make_valid(read_polygons(path, target=system)[0]))
    shapely.prepare(area)
    return area


def area_of(boxes: NDArray[np.float64], bounds: Bounds | None, clip: BaseGeometry | None) -> BaseGeometry:
    """Where footprints are used: the rectangle around the boxes (F, 4) of all files that have points, within
    `bounds` and `clip`.

    Not the union of the boxes: between those of neighbouring files are gaps of a point spacing, which would
    cut the footprints that cross them.
    """
    if not len(boxes):
        return shapely.Polygon()
    area: BaseGeometry = shapely.box(*boxes[:, :2].min(axis=0), *boxes[:, 2:].max(axis=0))
    for limit in (None if bounds is None else as_box(bounds), clip):
        if limit is not None:
            area = shapely.intersection(area, limit)
    return area


def as_box(bounds: Bounds) -> shapely.Polygon:
    """Bounds as a polygon."""
    return shapely.box(bounds.west, bounds.south, bounds.east, bounds.north)


def read_footprints(
    path: Path, id_field: str | None, system: CoordinateSystem, area: BaseGeometry
) -> list[Footprint]:
    """The footprints of a file, repaired and clipped to `area`; what is left out is counted in a warning."""
    polygons, ids, attributes, _ = read_polygons(path, id_field=id_field, target=system)
    unusable = unusable_footprints(polygons, ids)
    if unusable:
        log.warning("%s: %d footprints left out, the first: %s", path, len(unusable), unusable[0].reason)
    clipped = clip_footprints(repair_footprints(polygons, ids, attributes), area)
    inside = [footprint for footprint in clipped if not isinstance(footprint, Failure)]
    if len(inside) < len(clipped):
        log.warning("%s: %d footprints lie outside the points, left out", path, len(clipped) - len(inside))
    return inside
