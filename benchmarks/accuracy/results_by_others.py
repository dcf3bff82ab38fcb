"""The folder of a run as other people's libraries read it: pyogrio, laspy, and trimesh for the solids."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import geopandas
import laspy
import mapbox_earcut
import numpy as np
import pyogrio
import shapely
import trimesh
from numpy.typing import NDArray


@dataclass(frozen=True)
class Body:
    """A solid of a CityJSON file as a closed mesh in metres, with the areas of its surfaces by kind."""

    name: str
    lod: str
    mesh: trimesh.Trimesh
    areas: Counter[str]
    plan: float
    closed: bool
    """Whether each edge is walked once in each direction."""


class Result:
    """The folder of a run, opened by other libraries."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.run = json.loads((folder / "run.json").read_text("utf-8"))
        self.footprints, self.roofs = self.layer("footprints"), self.layer("roof_planes")
        self.rows = self.footprints.set_index("id", drop=False)
        self.modelled = self.footprints[self.footprints["lod"].notna()]
        lines = (folder / "buildings.city.jsonl").read_text("utf-8").splitlines()
        self.head, *self.features = map(json.loads, lines)
        axes = self.footprints.crs.axis_info if self.footprints.crs else []
        self.unit = axes[0].unit_conversion_factor if axes else 1.0
        self.up = axes[2].unit_conversion_factor if len(axes) > 2 else self.unit
        self.points = {path.name: laspy.read(path) for path in sorted(folder.glob("classified*.laz"))}

    def layer(self, name: str) -> geopandas.GeoDataFrame:
        """A layer of footprints.gpkg, footprints with all columns; an empty one where it is not there."""
        path = self.folder / "footprints.gpkg"
        if name not in pyogrio.list_layers(path)[:, 0]:
            return geopandas.GeoDataFrame({"id": []})
        frame = pyogrio.read_dataframe(path, layer=name)
        return frame.merge(self.layer("attributes"), on="id", how="left") if name == "footprints" else frame

    def places(self, feature: dict[str, Any]) -> NDArray[np.float64]:
        """The vertices of a feature in metres."""
        scale, shift = (np.array(self.head["transform"][key]) for key in ("scale", "translate"))
        written = np.asarray(feature["vertices"], float).reshape(-1, 3)
        return (written * scale + shift) * [self.unit, self.unit, self.up]

    @cached_property
    def bodies(self) -> dict[str, list[Body]]:
        """Building → its solids, those of its parts and of the objects on its roof."""
        found: dict[str, list[Body]] = {}
        for feature in self.features:
            places, own = self.places(feature), found.setdefault(feature["id"], [])
            centre = places.mean(axis=0) if len(places) else 0.0
            for name, thing in feature["CityObjects"].items():
                for geometry in thing.get("geometry", []):
                    if geometry["type"] == "Solid":
                        body = body_of(geometry, places - centre)
                        own.append(Body(thing["type"] + " " + name, str(geometry["lod"]), *body))
                        own[-1].mesh.apply_translation(centre)
        return found


def body_of(
    geometry: dict[str, Any], places: NDArray[np.float64]
) -> tuple[trimesh.Trimesh, Counter[str], float, bool]:
    """Mesh, areas by surface, plan of the roof, and whether it is closed, of a Solid."""
    points, triangles, count = [], [], 0
    areas, edges, plan = Counter[str](), Counter[tuple[int, int]](), 0.0
    semantics = geometry["semantics"]
    for face, value in zip(geometry["boundaries"][0], semantics["values"][0], strict=True):
        kind = semantics["surfaces"][value]["type"]
        ring = places[face[0]]
        normal = np.cross(ring - ring[0], np.roll(ring, -1, 0) - ring[0]).sum(0)
        normal /= np.linalg.norm(normal) or 1.0
        u = np.cross(normal, [0, 0, 1] if abs(normal[2]) < 0.9 else [1, 0, 0])
        u /= np.linalg.norm(u)
        points.append(np.vstack([places[one] for one in face]))
        flat = points[-1] @ np.column_stack([u, np.cross(normal, u)])
        ends = np.cumsum([len(one) for one in face]).astype(np.uint32)
        area = shapely.Polygon(flat[: ends[0]], np.split(flat, ends)[1:-1]).area
        areas[kind] += area
        edges.update(edge for one in face for edge in zip(one, one[1:] + one[:1], strict=True))
        plan += area * normal[2] if kind == "RoofSurface" else 0.0
        triangles.append(mapbox_earcut.triangulate_float64(flat, ends).reshape(-1, 3) + count)
        count += len(points[-1])
    mesh = trimesh.Trimesh(np.vstack(points), np.vstack(triangles), process=True)
    mesh.merge_vertices(digits_vertex=5)
    mesh.fix_normals()
    closed = all(number == 1 == edges[end, start] for (start, end), number in list(edges.items()))
    return mesh, areas, plan, closed


def share_volume(one: trimesh.Trimesh, two: trimesh.Trimesh) -> tuple[float, float]:
    """The volume (m³) that two meshes have in common, and how thick it is (m)."""
    if (one.bounds[0] >= two.bounds[1]).any() or (two.bounds[0] >= one.bounds[1]).any():
        return 0.0, 0.0
    shift = -one.bounds.mean(axis=0)
    meshes = [mesh.copy().apply_translation(shift) for mesh in (one, two)]
    common = trimesh.boolean.intersection(meshes, engine="manifold", check_volume=False)
    volume = abs(float(common.volume)) if len(common.vertices) else 0.0
    return volume, 2.0 * volume / common.area if volume else 0.0
