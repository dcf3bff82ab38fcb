"""Buildings read back from CityJSON as the values that the writers of other formats take."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from eaves.formats.models.cityjson_read import CityObject, iter_cityjson
from eaves.model import BLOCK_SIDE, BuildingModel, Failure, Footprint, Installation, Solid
from eaves.model.building import LODS

INSTALLATION = "BuildingInstallation"


def read_models(path: str | Path) -> Iterator[BuildingModel | Failure]:
    """The buildings of a CityJSONSeq file one by one, with their parts and what stands on their roofs.

    Coordinates are those of the file, to its step of 1 mm; roof planes are not kept in it.

    Raises
    ------
    InputError
        When the file is missing or damaged.
    """
    for _, parts in groupby(iter_cityjson(path), key=lambda one: one.parents[0] if one.parents else one.id):
        yield model_of(list(parts))


def model_of(parts: Sequence[CityObject]) -> BuildingModel | Failure:
    """A building from its objects, the Building first; a Failure where it has no solid."""
    places = [one.vertices[:, :2] for one in parts if len(one.vertices)] or [np.zeros((1, 2))]
    west, south = np.concatenate(places).min(axis=0)
    origin = float(west // BLOCK_SIDE * BLOCK_SIDE), float(south // BLOCK_SIDE * BLOCK_SIDE)
    solids: dict[str, tuple[Solid, ...]] = {}
    for one in parts:
        for geometry in one.geometries if one.type != INSTALLATION else ():
            if geometry.is_solid and geometry.lod in LODS:
                solids[geometry.lod] = (*solids.get(geometry.lod, ()), *one.as_solids(geometry, origin))
    attributes = dict(parts[0].attributes)
    score = float(attributes.pop("score", None) or 0.0)
    footprint = Footprint(outline_of(parts[0], origin), origin, parts[0].id, score)
    if not solids:
        code, reason = (str(attributes.pop(f"failure_{name}", "")) for name in ("code", "reason"))
        return Failure(code, reason, footprint=footprint.with_(attributes=attributes))
    bodies = [one for one in parts if one.type == INSTALLATION and one.geometries]
    objects = tuple(installation_of(one, origin) for one in bodies)
    return BuildingModel(footprint, dict(sorted(solids.items())), (), attributes, objects)


def outline_of(building: CityObject, origin: tuple[float, float]) -> Polygon:
    """The polygon (metres about `origin`) of LoD 0; an empty one where there is none."""
    for geometry in building.lod("0"):
        for face in (face for shells in geometry.solids for shell in shells for face in shell):
            outer, *holes = (building.vertices[list(ring), :2] - origin for ring in face.rings)
            return Polygon(outer, holes)
    return Polygon()


def installation_of(one: CityObject, origin: tuple[float, float]) -> Installation:
    """An object on a roof; its outline is that of its roof faces in plan."""
    solid = one.as_solids(one.geometries[0], origin)[0]
    about: dict[str, Any] = dict(one.attributes)
    faces = [Polygon(solid.vertices[list(face.rings[0]), :2]) for face in solid.faces if face.rings]
    plan = shapely.union_all([face for face in faces if face.is_valid and face.area > 0.0])
    outline = max(plan.geoms, key=lambda part: part.area) if isinstance(plan, MultiPolygon) else plan
    return Installation(
        str(about.get("function", "")),
        outline if isinstance(outline, Polygon) else Polygon(),
        float(solid.vertices[:, 2].max()),
        float(about.get("height_m") or 0.0),
        int(about.get("points") or 0),
        solid,
    )
