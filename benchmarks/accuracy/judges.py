"""All that a run writes, read by other people's libraries and held against one another.

usage: python -m benchmarks.accuracy.judges [SURVEY ...] [--work FOLDER] [--given FOLDER ...]

GDAL (pyogrio, geopandas, rasterio), laspy, cjio, trimesh with manifold3d, and QGIS and val3dity where they are
there (EAVES_QGIS_PYTHON or /usr/bin/python3; EAVES_VAL3DITY) say how large, how high, how many and where. No
line of the package's own readers is used. Surveys are built into the folder; those that are there are taken.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import tempfile
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations
from pathlib import Path
from typing import Any

import geopandas
import laspy
import mapbox_earcut
import numpy as np
import pandas as pd
import pyogrio
import pyproj
import rasterio
import rasterio.features
import shapely
import trimesh
from numpy.typing import NDArray

from benchmarks.table import keep

COMMAND = "python -m benchmarks.accuracy.judges"
SHARE, LENGTH_M, AREA_M2, VOLUME_M3 = 1e-3, 0.002, 0.02, 0.05
"""What files may differ by: a share, and what their own digits allow (coordinates of a millimetre)."""
COMMON_M3 = 0.0005
"""Less volume than this in two solids is none (m³)."""
RIM_M = 1.0
"""Outlines at the rim of the points reach so far (m) beyond the cells that hold any."""
THIN_M = 0.003
"""Neighbours share corners on a grid of a millimetre: what both have and is thinner (m) is rounding."""
MEASURES = {"RoofSurface": "roof_area_m2", "WallSurface": "wall_area_m2"}


@dataclass
class Judged:
    """What was compared, and what contradicts, a line each."""

    compared: Counter[str] = field(default_factory=Counter)
    wrong: dict[str, list[str]] = field(default_factory=lambda: defaultdict(list))
    notes: list[str] = field(default_factory=list)

    def hold(self, what: str, name: str, one: Any, other: Any, limit: float = 0.0) -> None:
        """Compare two values of one thing: numbers to a limit or a thousandth, all else as it is."""
        self.compared[what] += 1
        if isinstance(one, float | int | np.number) and isinstance(other, float | int | np.number):
            same = bool(abs(one - other) <= max(limit, (SHARE if limit else 0.0) * abs(other)))
        else:
            same = one == other
        if not same:
            self.wrong[what].append(f"{name}: {one} and {other}")


@dataclass(frozen=True)
class Body:
    """A solid of a CityJSON file as a closed mesh in metres, with the areas of its surfaces by their kinds."""

    name: str
    lod: str
    mesh: trimesh.Trimesh
    areas: Counter[str]
    plan: float
    closed: bool
    """Whether each edge is walked once in each direction."""


NO_BODY = Body("", "0", trimesh.Trimesh(), Counter(), 0.0, True)


class Result:
    """The folder of a run, opened by other libraries."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.run = json.loads((folder / "run.json").read_text("utf-8"))
        self.footprints = self.layer("footprints")
        self.roofs = self.layer("roof_planes")
        lines = (folder / "buildings.city.jsonl").read_text("utf-8").splitlines()
        self.head, self.features = json.loads(lines[0]), [json.loads(line) for line in lines[1:]]
        crs = self.footprints.crs
        axes = [] if crs is None else crs.axis_info
        self.unit = axes[0].unit_conversion_factor if axes else 1.0
        self.up = axes[2].unit_conversion_factor if len(axes) > 2 else self.unit
        if "vertical_unit_m" in self.run:
            self.up = self.run["vertical_unit_m"]

    def layer(self, name: str) -> geopandas.GeoDataFrame:
        """A layer of footprints.gpkg."""
        return pyogrio.read_dataframe(self.folder / "footprints.gpkg", layer=name)

    @cached_property
    def rows(self) -> pd.DataFrame:
        """The footprints by their ids."""
        return self.footprints.set_index("id", drop=False)

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

    @cached_property
    def points(self) -> dict[str, laspy.LasData]:
        """The classified points, by file."""
        return {path.name: laspy.read(path) for path in sorted(self.folder.glob("classified*.laz"))}


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
        flat = np.column_stack(
            [np.vstack([places[one] for one in face]) @ v for v in (u, np.cross(normal, u))]
        )
        ends = np.cumsum([len(one) for one in face]).astype(np.uint32)
        area = shapely.Polygon(flat[: ends[0]], np.split(flat, ends)[1:-1]).area
        areas[kind] += area
        edges.update(edge for one in face for edge in zip(one, one[1:] + one[:1], strict=True))
        plan += area * normal[2] if kind == "RoofSurface" else 0.0
        triangles.append(mapbox_earcut.triangulate_float64(flat, ends).reshape(-1, 3) + count)
        points.append(np.vstack([places[one] for one in face]))
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


def judge_counts_and_ids(result: Result, judged: Judged) -> None:
    """Numbers of buildings, faces and objects, and ids, in every file."""
    rows, run = result.rows, result.run
    judged.hold("counts", "found", run["found"], len(rows))
    judged.hold("counts", "modelled", run["modelled"], int(rows["lod"].notna().sum()))
    judged.hold("counts", "by_lod", run["by_lod"], rows["lod"].value_counts().to_dict())
    judged.hold("ids", "twice", int(rows.index.duplicated().sum()), 0)
    modelled = set(rows.index[rows["lod"].notna()])
    written = [feature["id"] for feature in result.features]
    judged.hold("ids", "CityJSONSeq", sorted(written), sorted(rows.index))
    judged.hold("ids", "roof_planes", set(result.roofs["building_id"]) <= modelled, True)
    review = pd.read_csv(result.folder / "review.csv", dtype={"id": str})
    layer = pyogrio.list_layers(result.folder / "footprints.gpkg")[:, 0]
    listed = list(result.layer("review")["id"].astype(str)) if "review" in layer else []
    judged.hold("ids", "review.csv", list(review["id"]), listed)
    judged.hold("ids", "review", set(review["id"]) <= set(rows.index), True)
    page = (result.folder / "report.html").read_text("utf-8") if run["found"] <= 2000 else ""
    for name in rows.index if page else ():
        judged.hold("ids", f"{name} on the page", name in page, True)
    numbers = set().union(*(np.unique(np.asarray(las.building_id)) for las in result.points.values()))
    judged.hold("ids", "classified", numbers - {0} <= set(rows["number"]), True)
    for suffix in (".geojson", ".fgb", ".parquet"):
        for path in result.folder.glob(f"*{suffix}"):
            if "footprints" in path.stem:
                read = geopandas.read_parquet if suffix == ".parquet" else pyogrio.read_dataframe
                judged.hold("ids", path.name, sorted(read(path)["id"].astype(str)), sorted(rows.index))
    planes = result.roofs.groupby("building_id").size()
    for feature in result.features:
        row, things = rows.loc[feature["id"]], feature["CityObjects"].values()
        if feature["id"] in modelled and result.bodies[feature["id"]]:
            judged.hold("counts", feature["id"], int(planes.get(feature["id"], 0)), row["roof_face_count"])
        kinds = Counter(thing["type"] for thing in things)
        if pd.notna(row.get("installation_count")):
            judged.hold(
                "counts", f"objects on {row['id']}", kinds["BuildingInstallation"], row["installation_count"]
            )


def judge_sizes(result: Result, judged: Judged) -> None:
    """Areas, volumes and heights of the tables against those of the written geometry, and attributes."""
    unit2, planes = result.unit**2, result.roofs.set_index("building_id")
    for row in result.footprints.itertuples():
        judged.hold(
            "areas",
            f"{row.id} footprint",
            row.geometry.area * unit2 if row.geometry else 0.0,
            row.area_m2,
            AREA_M2,
        )
    for feature in result.features:
        name, row = feature["id"], result.rows.loc[feature["id"]]
        told = feature["CityObjects"][name].get("attributes", {})
        for key in sorted(told.keys() & set(result.rows.columns)):
            one, other = told[key], row[key]
            if not isinstance(one, list | dict) and not (one is None and pd.isna(other)):
                judged.hold("attributes", f"{name} {key}", one, other, 0.01)
        bodies = [body for body in result.bodies[name] if body.lod == row["lod"]]
        whole = [body for body in bodies if not body.name.startswith("BuildingInstallation")]
        if not whole:
            continue
        areas = sum((body.areas for body in whole), Counter())
        for kind, column in MEASURES.items():
            judged.hold("areas", f"{name} {column}", areas[kind], row[column], AREA_M2)
        judged.hold(
            "areas", f"{name} roof in plan", sum(b.plan for b in whole), row["roof_projected_m2"], AREA_M2
        )
        judged.hold(
            "areas",
            f"{name} roof_planes",
            planes.loc[[name], "projected_m2"].sum(),
            row["roof_projected_m2"],
            AREA_M2 * len(planes.loc[[name]]),
        )
        judged.hold(
            "areas",
            f"{name} quarters",
            sum(row[f"roof_area_{q}_m2"] for q in ("flat", *"nesw")),
            row["roof_area_m2"],
            AREA_M2,
        )
        judged.hold(
            "areas",
            f"{name} walls",
            row["party_wall_area_m2"] + row["free_wall_area_m2"],
            row["wall_area_m2"],
            AREA_M2 * 5,
        )
        judged.hold("volumes", name, float(sum(b.mesh.volume for b in whole)), row["volume_m3"], VOLUME_M3)
        judged.hold("volumes", f"{name} closed", all(b.closed for b in bodies), True)
        top = max(b.mesh.bounds[1, 2] for b in whole)
        if row["lod"] >= "2.0":
            judged.hold("heights", f"{name} top", float(top), row["h_max"], LENGTH_M)
        low = planes.loc[[name], "h_low"].min()
        order = low - LENGTH_M <= row["h_eaves"] <= row["h_ridge"] + LENGTH_M <= row["h_max"] + 2 * LENGTH_M
        judged.hold(
            "heights",
            f"{name} eaves {row['h_eaves']} ridge {row['h_ridge']}",
            bool(order or row["lod"] < "2"),
            True,
        )
        if row["floor_storeys"] > 1 and pd.isna(row.get("given_storeys")):
            fits = row["floor_area_m2"] * 2.2 <= row["volume_m3"] * (1.0 + SHARE)
            judged.hold(
                "storeys", f"{name} {row['floor_area_m2']} m² in {row['volume_m3']} m³", bool(fits), True
            )


def judge_overlaps(result: Result, judged: Judged) -> None:
    """Volume that solids of one building, and of neighbours, share; outlines of neighbours that overlap."""
    for name, bodies in result.bodies.items():
        for one, two in combinations(bodies, 2):
            if one.lod == two.lod:
                common, _ = share_volume(one.mesh, two.mesh)
                what = f"{name} {one.lod} {one.name}, {two.name} (m³)"
                judged.hold("overlaps within", what, common, 0.0, COMMON_M3)
    frame = result.footprints[result.footprints["lod"].notna()]
    one, two = frame.sindex.query(frame.geometry, predicate="intersects")
    for a, b in zip(one[one < two], two[one < two], strict=True):
        names = frame["id"].iloc[a], frame["id"].iloc[b]
        common = frame.geometry.iloc[a].intersection(frame.geometry.iloc[b])
        thick = 2.0 * common.area / common.length * result.unit if common.area else 0.0
        if result.run.get("footprints") and thick > THIN_M:
            judged.notes.append(f"{common.area:.2f} of the map's {names[0]} and {names[1]} are the same")
            continue
        judged.hold("overlaps of neighbours", f"outlines {names} (m thick)", thick, 0.0, THIN_M)
        lod = max(body.lod for name in names for body in result.bodies[name] or [NO_BODY])
        pairs = [[body for body in result.bodies[name] if body.lod == lod] for name in names]
        thickness = max((share_volume(x.mesh, y.mesh)[1] for x in pairs[0] for y in pairs[1]), default=0.0)
        judged.hold("overlaps of neighbours", f"{lod} {names} (m thick)", thickness, 0.0, THIN_M)


def judge_rasters_and_systems(result: Result, judged: Judged) -> None:
    """Systems and bounds of all files; the mask against the footprints; terrain and surface under roofs."""
    frame, unit, code = result.footprints, result.unit, result.run["crs"] or ""
    rasters = {name: rasterio.open(result.folder / f"{name}.tif") for name in ("mask", "dtm", "dsm")}
    systems = {f"{name}.tif": image.crs and image.crs.to_wkt() for name, image in rasters.items()}
    systems |= {name: las.header.parse_crs() for name, las in result.points.items()}
    systems |= {"roof_planes": result.roofs.crs, "run.json": code or frame.crs}
    for name, crs in systems.items():
        both = [None if one is None else pyproj.CRS(one) for one in (crs, frame.crs)]
        both = [one.sub_crs_list[0] if one is not None and one.is_compound else one for one in both]
        if (
            crs is None
            and name in result.points
            and int(result.points[name].point_format.id) < 6
            and not code
        ):
            judged.notes.append(f"{name}: a system without a code has no place in its point format")
            continue
        judged.hold("systems", name, *[None if one is None else one.name for one in both])
    said = result.head["metadata"].get("referenceSystem", "").rsplit("/", 1)[-1]
    if "+" not in code:
        judged.hold("systems", "CityJSONSeq", said, code.removeprefix("EPSG:"))
    west, south, east, north = rasters["dsm"].bounds
    box = shapely.box(west, south, east, north).buffer(RIM_M / result.unit)
    judged.hold("bounds", "rasters", len({image.bounds for image in rasters.values()}), 1)
    for row in frame[frame["lod"].notna()].itertuples():
        judged.hold("bounds", f"{row.id} in the rasters", bool(box.covers(row.geometry)), True)
    everything = [result.places(feature) for feature in result.features if feature["vertices"]]
    if everything:
        corners = np.vstack(everything)[:, :2] / unit
        whole = frame[frame["lod"].notna()].total_bounds
        for k, side in enumerate((*corners.min(axis=0), *corners.max(axis=0))):
            judged.hold(
                "bounds",
                f"CityJSONSeq and footprints, side {k}",
                float(side),
                float(whole[k]),
                2 * LENGTH_M / unit,
            )
    mask = rasters["mask"].read(1)
    shapes = [shape for shape in frame.geometry if shape is not None and not shape.is_empty]
    burnt = (
        rasterio.features.rasterize(shapes, mask.shape, transform=rasters["mask"].transform)
        if shapes
        else mask * 0
    )
    judged.hold("mask", "cells", int(((mask > 0) != (burnt > 0)).sum()), 0)
    terrain, surface = (rasters[name].read(1, masked=True) for name in ("dtm", "dsm"))
    for row in frame[frame["lod"].notna()].itertuples():
        point = row.geometry.representative_point()
        place = rasters["dtm"].index(point.x, point.y)
        high = float(surface[place]) * result.up if surface[place] is not np.ma.masked else row.h_max
        judged.hold("heights", f"{row.id} surface {high:.2f}", bool(row.h_ground - 3.0 <= high), True)
    del terrain


def judge_points(result: Result, judged: Judged) -> None:
    """Classes and numbers of the points under each footprint."""
    total, frame = 0, result.footprints.set_index("number")
    count: Counter[int] = Counter()
    for name, las in result.points.items():
        total += len(las)
        number, classes = np.asarray(las.building_id), np.asarray(las.classification)
        judged.hold(
            "classes", f"{name}: of buildings, not of class 6", int((classes[number > 0] != 6).sum()), 0
        )
        head = las.header
        for axis, k in zip("xyz", range(3), strict=True):
            values = np.asarray(las[axis])
            judged.hold(
                "bounds",
                f"{name} {axis}",
                bool(
                    len(values) == 0
                    or (values.min() >= head.mins[k] - 1e-6 and values.max() <= head.maxs[k] + 1e-6)
                ),
                True,
            )
        for one, own in pd.Series(np.flatnonzero(number)).groupby(number[number > 0]):
            count[int(one)] += len(own)
            outline = frame.geometry.loc[one].buffer(2.0 / result.unit)
            inside = shapely.contains_xy(outline, np.asarray(las.x)[own], np.asarray(las.y)[own])
            judged.hold(
                "classes", f"{name}: points of {one} off its footprint", float((~inside).mean()), 0.0, 0.05
            )
    windowed = result.run["bounds"] is not None or result.run["clip"] is not None
    judged.hold("counts", "points", total, result.run["points_used" if windowed else "points"])
    for number, row in frame[frame["points"].notna()].iterrows():
        judged.hold(
            "classes", f"points of {row['id']}", bool(row["points"] == 0 or count[int(number)] > 0), True
        )


def judge_by_programs(result: Result, judged: Judged) -> None:
    """cjio, QGIS and val3dity, where they are there."""
    whole = result.folder / "buildings.city.json"
    if whole.exists():
        from cjio import cityjson

        with whole.open(encoding="utf-8") as file:
            model = cityjson.CityJSON(file)
        judged.hold(
            "counts",
            "cjio",
            model.number_top_co()
            if hasattr(model, "number_top_co")
            else len([c for c in model.j["CityObjects"].values() if "parents" not in c]),
            len(result.features),
        )
    python = os.environ.get("EAVES_QGIS_PYTHON", "/usr/bin/python3")
    done = subprocess.run(
        [python, "-c", QGIS, str(result.folder / "buildings.qgz")],
        capture_output=True,
        text=True,
        env={**os.environ, "QT_QPA_PLATFORM": "offscreen", "PYTHONPATH": ""},
        check=False,
    )
    if done.returncode == 0:
        told = json.loads(done.stdout.splitlines()[-1])
        judged.hold("QGIS", "system of the project", told["valid"], result.footprints.crs is not None)
        judged.hold("QGIS", "layers", told["broken"], [])
        judged.hold("QGIS", "footprints", told["counts"].get("footprints"), len(result.rows))
    else:
        judged.notes.append("no QGIS")
    if program := os.environ.get("EAVES_VAL3DITY"):
        report = result.folder / "val3dity.json"
        subprocess.run(
            [program, "--report", report, result.folder / "buildings.city.jsonl"],
            capture_output=True,
            check=False,
        )
        judged.hold("val3dity", "errors", sorted(json.loads(report.read_text())["all_errors"]), [])


QGIS = """
import json, sys
from qgis.core import QgsApplication, QgsProject
app = QgsApplication([], False); app.initQgis(); project = QgsProject.instance(); project.read(sys.argv[1])
layers = project.mapLayers().values()
counts = {l.source().split("layername=")[-1].split("|")[0]: l.featureCount() for l in layers if hasattr(l, "featureCount")}
print(json.dumps({"valid": project.crs().isValid(), "broken": [l.name() for l in layers if not l.isValid()], "counts": counts}))
"""
FORMATS = "cityjson,obj,glb,geojson,fgb,parquet,citygml,citygml3,dxf,gpkg"
KINDS = (
    *("counts", "ids", "attributes", "areas", "volumes", "heights", "storeys", "overlaps within"),
    *("overlaps of neighbours", "systems", "bounds", "mask", "classes", "QGIS", "val3dity"),
)
NOTE = """Contradictions of what was compared. Files are read by pyogrio, geopandas, rasterio, laspy, cjio, trimesh with
manifold3d, and QGIS 3.22.

By design: geometry and rasters are in the unit of the reference system, every other figure in metres, as names
and titles of columns say; `h_max` is the top of the roof that was measured where LoD 1.2 or 1.3 is written; a
building without a model has its place, and no level; classified points of a building that hang over its outline
stay its points (up to 2 m, a twentieth); outlines of a map that overlap by themselves are said, not changed.

"""
JUDGES = (
    judge_counts_and_ids,
    judge_sizes,
    judge_overlaps,
    judge_rasters_and_systems,
    judge_points,
    judge_by_programs,
)


def judge(folder: Path) -> Judged:
    """All judges on the folder of a run."""
    result, judged = Result(folder), Judged()
    for one in JUDGES:
        one(result, judged)
    return judged


SURVEYS = {
    "delft": ("delft/ahn3.laz", ()),
    "delft, given": ("delft/ahn3.laz", ("--footprints", "delft/footprints.gpkg", "--use-classes")),
    "delft, LoD 2.3": ("delft/ahn3.laz", ("--lod", "2.3")),
    "ign_urban": ("ign_urban/*.laz", ()),
    "ign_urban, LoD 2.3": ("ign_urban/*.laz", ("--lod", "2.3")),
    "williams": ("williams/williams.laz", ()),
    "williams, LoD 2.3": ("williams/williams.laz", ("--lod", "2.3")),
    "ucla": ("ucla/royce.laz", ()),
    "ucla, LoD 2.3": ("ucla/royce.laz", ("--lod", "2.3")),
    "woodford": ("woodford/woodford.laz", ()),
    "autzen": ("autzen/autzen_full.laz", ("--crs", "autzen/srs.wkt")),
    **{f"town {seed}": (f"town {seed}", ("--formats", FORMATS)) for seed in (1, 2, 3)},
}
"""The points, and the words behind them; of drawn towns the seed."""


def built(name: str, work: Path) -> Path:
    """The folder of a survey's results, built by the command where it is not there."""
    data, out = Path(os.environ["EAVES_DATA"]), work / name.replace(",", "").replace(" ", "-")
    if (out / "manifest.json").exists() and json.loads((out / "manifest.json").read_text())["complete"]:
        return out
    points, words = SURVEYS[name]
    if points.startswith("town"):
        scene = work / f"{out.name}-scene"
        run("simulate", "-o", scene, "--seed", points.split()[1], "--area", "0.03", "--crs", "EPSG:25832")
        inputs = [scene / "points.laz"]
    else:
        inputs = sorted(data.glob(points))
    run("build", *inputs, "-o", out, *[data / word if "/" in word else word for word in words])
    return out


def run(*words: str | Path) -> None:
    """A command of eaves."""
    subprocess.run(["eaves", *map(str, words), "-q"], check=True)


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("surveys", nargs="*", default=list(SURVEYS))
    parser.add_argument("--work", type=Path)
    options = parser.parse_args()
    rows, notes = [], []
    with tempfile.TemporaryDirectory() as temporary:
        for name in options.surveys:
            judged = judge(built(name, options.work or Path(temporary)))
            row = {"survey": name}
            for what in KINDS:
                compared, wrong = judged.compared[what], judged.wrong[what]
                row[what] = f"{len(wrong)} of {compared:,}" if compared else "–"
                notes += [f"- {name}, {what}: {one}" for one in wrong[:5]]
            rows.append(row)
            notes += [f"- {name}: {one}" for one in judged.notes[:5]]
            print(row, flush=True)
    keep(
        "judges",
        "What is written, read by others and held against one another",
        rows,
        COMMAND,
        NOTE + "\n".join(notes),
    )


if __name__ == "__main__":
    main()
