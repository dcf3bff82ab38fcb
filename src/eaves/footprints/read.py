"""Areas and footprints that the user gives, in world metres."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from eaves.footprints.given import PART, clip_footprints, repair_footprints, unusable_footprints
from eaves.formats import InputError, read_polygons
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
) -> tuple[list[Footprint], list[Failure]]:
    """The footprints of a file, repaired and clipped to `area`, and a failure, with what is known of the
    footprint, for each that cannot be used: none is lost.

    Raises
    ------
    InputError
        When `id_field` leaves a footprint without an id, or gives two the same.
    """
    shapes, ids, attributes, _ = read_polygons(path, id_field=id_field, target=system, keep_all=True)
    if id_field is not None:
        refuse_ids(path, id_field, [row[id_field] for row in attributes])
    unusable = unusable_footprints(shapes, ids, attributes)
    whole = repair_footprints(shapes, ids, attributes)
    parts = [footprint for footprint in whole if footprint.attributes.get(PART, 1) > 1]
    if parts:
        log.warning(
            "%s: footprints of several parts give a row for each part, the first: '%s'", path, parts[0].id
        )
    clipped = clip_footprints(whole, area)
    inside = [footprint for footprint in clipped if isinstance(footprint, Footprint)]
    outside = [failure for failure in clipped if isinstance(failure, Failure)]
    for failures in (unusable, outside):
        if failures:
            log.warning(
                "%s: %d footprints cannot be modelled, the first: %s", path, len(failures), failures[0].reason
            )
    return inside, [*unusable, *outside]


def refuse_ids(path: Path, id_field: str, ids: Sequence[object]) -> None:
    """Nothing, when every footprint has an id of its own.

    Raises
    ------
    InputError
        With how many have none, or which one occurs more than once.
    """
    remedy = f"mend the field, name another one, or leave --id-field {id_field} out: then they are numbered"
    empty = sum(one is None or str(one).strip() == "" for one in ids)
    if empty:
        raise InputError.about(path, f"{empty} of {len(ids)} footprints have no '{id_field}'", remedy)
    often = [name for name, count in Counter(map(str, ids)).items() if count > 1]
    if often:
        rule = f"{len(often)} values of '{id_field}' occur more than once (the first: '{often[0]}')"
        raise InputError.about(path, rule, remedy)
