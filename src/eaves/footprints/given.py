"""Footprints given by the user: repaired, clipped, and named so that none is lost without a reason."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from eaves.geometry.rings import polygon_parts
from eaves.geometry.tolerance import COORDINATE_STEP
from eaves.model import Bounds, Failure, Footprint

MOST_CORNERS = 3000
"""No building has more; lines and checks of all corners with all others would take hours of a million."""
COARSEST = 1.0
"""No corner is moved so far (m) to have fewer: what has more even so has as many courtyards."""
PART = "given_part"
"""Attribute of what a footprint of several parts becomes: 1 for the largest, which keeps the id."""
MIN_AREA_M2 = 1.0
"""A given footprint, or a part of one, that is smaller is a slip of the pen."""


def repair_footprints(
    shapes: Iterable[BaseGeometry | None],
    ids: Sequence[str] | None = None,
    attributes: Sequence[Mapping[str, Any]] | None = None,
) -> list[Footprint | Failure]:
    """The usable footprints among `shapes` (metres), in their order: valid, single, counter-clockwise; a
    Failure, with a footprint that has id and attributes but no area, for each that has none to build on.

    A shape of several parts, or one that crosses itself, becomes several footprints, the largest first; all
    but the first get "-2", "-3", … behind the id. So does an id that was given before.
    """
    found: list[Footprint | Failure] = []
    used: set[str] = set()
    taken = set() if ids is None else set(map(str, ids))
    for number, shape in enumerate(shapes):
        given = "" if ids is None else str(ids[number])
        kept = {} if attributes is None else dict(attributes[number])
        parts = repaired_parts(shape)
        for place, part in enumerate(parts, 1):
            name = unused_id(given, used | taken if place > 1 else used)
            used.add(name)
            several = {PART: place} if len(parts) > 1 else {}
            found.append(Footprint(part, id=name, attributes=kept | several))
        if not parts:
            name = str(number) if ids is None else given
            reason = f"given footprint '{name}' {defect_of(shape)}"
            nowhere = Footprint(Polygon(), id=name, attributes=kept)
            found.append(Failure("no_area", reason, "outline", nowhere))
    return found


def defect_of(shape: BaseGeometry | None) -> str:
    """Why there is nothing to build on in a shape, in words."""
    if shape is None or shape.is_empty:
        return "has no geometry"
    if not np.isfinite(shapely.get_coordinates(shape)).all():
        return "has coordinates that are no numbers"
    return f"is a {shape.geom_type} without area"


def repaired_parts(shape: BaseGeometry | None) -> list[Polygon]:
    """The valid polygons of a shape, largest first, without parts and holes under `MIN_AREA_M2`."""
    if shape is None or shape.is_empty or not np.isfinite(shapely.get_coordinates(shape)).all():
        return []
    parts = []
    for whole in polygon_parts(shapely.force_2d(shape), COORDINATE_STEP):
        part = lightened(whole)
        if part.area >= MIN_AREA_M2:
            holes = [ring for ring in part.interiors if Polygon(ring).area >= MIN_AREA_M2]
            parts.append(shapely.orient_polygons(Polygon(part.exterior, holes)))
    return sorted(parts, key=lambda part: (-part.area, part.bounds))


def lightened(part: Polygon) -> Polygon:
    """The polygon; of more corners than `MOST_CORNERS` fewer, true to a millimetre, or to the least
    power of two of it that leaves no more."""
    tolerance, light = COORDINATE_STEP, part
    while shapely.get_num_coordinates(light) > MOST_CORNERS and tolerance < COARSEST:
        light = shapely.simplify(part, tolerance)
        tolerance *= 2
    return light


def unused_id(given: str, used: set[str]) -> str:
    """The id, or the first of id-2, id-3, … not in `used`; an empty one stays empty."""
    name, number = given, 1
    while name and name in used:
        number += 1
        name = f"{given}-{number}"
    return name


def clip_footprints(
    footprints: Sequence[Footprint], area: Bounds | BaseGeometry
) -> list[Footprint | Failure]:
    """Each footprint cut to `area`, in order; a Failure for those outside; what was cut carries `clipped`.

    Of a footprint that the border cuts into several pieces the largest stays.
    """
    if isinstance(area, Bounds):
        area = shapely.box(area.west, area.south, area.east, area.north)
    answers: list[Footprint | Failure] = []
    shapely.prepare(area)
    for footprint in footprints:
        if area.contains_properly(footprint.polygon):
            answers.append(footprint)
            continue
        inside = repaired_parts(footprint.polygon.intersection(area))
        if not inside:
            reason = f"given footprint '{footprint.id}' lies outside the area"
            answers.append(Failure("outside", reason, "outline", footprint))
        elif inside[0].area > footprint.polygon.area - MIN_AREA_M2 * COORDINATE_STEP:
            answers.append(footprint)
        else:
            marked = {**footprint.attributes, "clipped": True}
            answers.append(footprint.with_(polygon=inside[0], attributes=marked))
    return answers
