"""Buildings of a CityJSON file as the evaluation uses them: roofs, all faces, footprint, volume, heights."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from eaves.formats import CityObject, has_corners, read_cityjson
from eaves.geometry import FaceTable, RoofFaces, polygon_parts
from eaves.model import GROUND_SURFACE, LOCAL_METRES, ROOF_SURFACE, CoordinateSystem, Points

FLATTEST = 0.02
"""Upward share of a normal over which a face without a known surface type counts as a roof."""

Rings = list[Points]


@dataclass(frozen=True, eq=False)
class CityBuilding:
    """One building with its parts at one level of detail, in world metres.

    `roofs` and `faces` are the roof faces and all faces; `lod` is the level ("" when there
    is no model); `lods` are all levels the file has of it.
    """

    id: str
    lod: str
    lods: tuple[str, ...]
    roofs: FaceTable
    faces: FaceTable
    footprint: Polygon | MultiPolygon
    system: CoordinateSystem = LOCAL_METRES

    @property
    def volume(self) -> float:
        """Volume (m³) the faces enclose, by the divergence theorem."""
        return self.faces.volume

    @property
    def height(self) -> float:
        """Highest minus lowest vertex (m)."""
        return float(np.ptp(self.faces.corners[:, 2])) if self.faces else 0.0


def read_buildings(path: str | Path, lod: str | None = None) -> list[CityBuilding]:
    """The buildings of a file, each at one level of detail (None: its finest); parts join their building."""
    objects = read_cityjson(path)
    members: dict[str, list[CityObject]] = defaultdict(list)
    for item in objects.values():
        if item.type in ("Building", "BuildingPart"):
            members[item.parents[0] if item.parents else item.id].append(item)
    return [_city_building(name, items, lod) for name, items in members.items()]


def roofs_of(buildings: Sequence[CityBuilding], origin: tuple[float, float]) -> RoofFaces:
    """The roof faces of buildings about an origin; `owner` is the number of the building."""
    table = FaceTable.join([item.roofs for item in buildings]).moved(-np.array([*origin, 0.0]))
    return RoofFaces.of(table, np.repeat(np.arange(len(buildings)), [len(item.roofs) for item in buildings]))


def _city_building(name: str, items: list[CityObject], lod: str | None) -> CityBuilding:
    geometries = [(item, geometry) for item in items for geometry in item.geometries]
    lods = tuple(sorted({geometry.lod for _, geometry in geometries}))
    finest = lod if lod is not None else max((level for level in lods if level >= "1"), default="")
    faces: list[Rings] = []
    is_roof: list[bool] = []
    ground: list[Polygon] = []
    for item, geometry in geometries:
        for face in geometry.faces:
            if not has_corners(face):
                continue
            rings = [item.vertices[list(ring)] for ring in face.rings]
            if geometry.lod == finest:
                faces.append(rings)
                is_roof.append(face.surface == ROOF_SURFACE or (not face.surface and _faces_up(rings)))
            if geometry.lod == "0" or (face.surface == GROUND_SURFACE and geometry.lod == finest):
                ground.append(_shadow(rings))
    plan = ground or [_shadow(rings) for rings, up in zip(faces, is_roof, strict=True) if up]
    footprint = shapely.union_all([shapely.make_valid(shape) for shape in plan], grid_size=0.001)
    if footprint.geom_type not in ("Polygon", "MultiPolygon"):  # damaged faces have lines for a shadow
        footprint = MultiPolygon(polygon_parts(footprint))
    table = FaceTable.of(faces)
    roofs = table.take(np.array(is_roof, bool))
    return CityBuilding(name, finest if faces else "", lods, roofs, table, footprint, items[0].system)


def _shadow(rings: Rings) -> Polygon:
    return Polygon(rings[0][:, :2], [ring[:, :2] for ring in rings[1:]])


def _faces_up(rings: Rings) -> bool:
    return bool(FaceTable.of([rings]).normals[0, 2] > FLATTEST)
