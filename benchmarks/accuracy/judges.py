"""All that a run writes, read by other people's libraries and held against one another.

usage: python -m benchmarks.accuracy.judges [SURVEY ...] [--work FOLDER]

GDAL (pyogrio, geopandas, rasterio), laspy, cjio, trimesh with manifold3d, and QGIS and val3dity where they
are there (EAVES_QGIS_PYTHON or /usr/bin/python3; EAVES_VAL3DITY) say how large, how high, how many and where.
Surveys are built into the folder or taken from there; the table keeps the rows of those that are not named.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import tempfile
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import pandas as pd
import pyogrio
import pyproj
import rasterio
import rasterio.features
import shapely

from benchmarks.accuracy.results_by_others import Result, share_volume
from benchmarks.table import keep, kept_rows

COMMAND = "python -m benchmarks.accuracy.judges"
SHARE, LENGTH_M, AREA_M2, VOLUME_M3 = 1e-3, 0.002, 0.02, 0.05
"""The share that files may differ by, and what their digits allow (coordinates of a millimetre)."""
COMMON_M3 = 0.0005
"""Less volume than this in two solids is none (m³)."""
RIM_M = 1.0
"""Outlines at the rim of the points reach so far (m) beyond the cells that hold any."""
THIN_M = 0.003
"""Neighbours share corners on a grid of a millimetre: what both have and is thinner (m) is rounding."""
Check = tuple[str, str, Any, Any] | tuple[str, str, Any, Any, float] | str
"""Kind, name, two values of one thing and how far they may differ; or a note."""


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


def judge_counts_and_ids(result: Result) -> Iterator[Check]:
    """Numbers of buildings, faces and objects, and ids, in every file."""
    rows, run, modelled = result.rows, result.run, set(result.modelled["id"])
    yield "counts", "found", run["found"], len(rows)
    yield "counts", "modelled", run["modelled"], len(modelled)
    yield "counts", "by_lod", run["by_lod"], rows["lod"].value_counts().to_dict()
    yield "ids", "twice", int(rows.index.duplicated().sum()), 0
    yield "ids", "CityJSONSeq", sorted(feature["id"] for feature in result.features), sorted(rows.index)
    yield "ids", "roof_planes", set(result.roofs["building_id"]) <= modelled, True
    review = list(pd.read_csv(result.folder / "review.csv", dtype={"id": str})["id"])
    yield "ids", "review.csv", review, list(result.layer("review")["id"].astype(str))
    yield "ids", "review", set(review) <= set(rows.index), True
    page = (result.folder / "report.html").read_text("utf-8") if run["found"] <= 2000 else ""
    for name in rows.index if page else ():
        yield "ids", f"{name} on the page", name in page, True
    numbers = set().union(*(np.unique(np.asarray(las.building_id)) for las in result.points.values()))
    yield "ids", "classified", numbers - {0} <= set(rows["number"]), True
    for path in result.folder.glob("*footprints*"):
        if path.suffix in (".geojson", ".fgb", ".parquet"):
            read = geopandas.read_parquet if path.suffix == ".parquet" else pyogrio.read_dataframe
            yield "ids", path.name, sorted(read(path)["id"].astype(str)), sorted(rows.index)
    planes = result.roofs.groupby("building_id").size()
    for feature in result.features:
        name, row = feature["id"], rows.loc[feature["id"]]
        if name in modelled and result.bodies[name]:
            yield "counts", name, int(planes.get(name, 0)), row["roof_face_count"]
        objects = Counter(thing["type"] for thing in feature["CityObjects"].values())["BuildingInstallation"]
        if pd.notna(row.get("installation_count")):
            yield "counts", f"objects on {name}", objects, row["installation_count"]


def judge_sizes(result: Result) -> Iterator[Check]:
    """Areas, volumes and heights of the tables against those of the written geometry, and attributes."""
    planes = result.roofs.set_index("building_id")
    for row in result.footprints.itertuples():
        area = row.geometry.area * result.unit**2 if row.geometry else 0.0
        yield "areas", f"{row.id} footprint", area, row.area_m2, AREA_M2
    for feature in result.features:
        name, row = feature["id"], result.rows.loc[feature["id"]]
        attributes = feature["CityObjects"][name].get("attributes", {})
        for key in sorted(attributes.keys() & set(result.rows.columns)):
            one, other = attributes[key], row[key]
            if not isinstance(one, list | dict) and not (one is None and pd.isna(other)):
                yield "attributes", f"{name} {key}", one, other, 0.01
        bodies = [body for body in result.bodies[name] if body.lod == row["lod"]]
        whole = [body for body in bodies if not body.name.startswith("BuildingInstallation")]
        if not whole:
            continue
        areas, own = sum((body.areas for body in whole), Counter()), planes.loc[[name]]
        quarters = sum(row[f"roof_area_{quarter}_m2"] for quarter in ("flat", *"nesw"))
        walls = row["party_wall_area_m2"] + row["free_wall_area_m2"]
        for what, column, area, limit in (
            ("", "roof_area_m2", areas["RoofSurface"], AREA_M2),
            ("", "wall_area_m2", areas["WallSurface"], AREA_M2),
            ("roof in plan", "roof_projected_m2", sum(body.plan for body in whole), AREA_M2),
            ("roof_planes", "roof_projected_m2", own["projected_m2"].sum(), AREA_M2 * len(own)),
            ("quarters", "roof_area_m2", quarters, AREA_M2),
            ("walls", "wall_area_m2", walls, AREA_M2 * 5),
        ):
            yield "areas", f"{name} {what or column}", area, row[column], limit
        volume, low, eaves, ridge = row["volume_m3"], own["h_low"].min(), row["h_eaves"], row["h_ridge"]
        yield "volumes", name, float(sum(body.mesh.volume for body in whole)), volume, VOLUME_M3
        yield "volumes", f"{name} closed", all(body.closed for body in bodies), True
        if row["lod"] >= "2.0":
            top = float(max(body.mesh.bounds[1, 2] for body in whole))
            yield "heights", f"{name} top", top, row["h_max"], LENGTH_M
        order = low - LENGTH_M <= eaves <= ridge + LENGTH_M <= row["h_max"] + 2 * LENGTH_M
        yield "heights", f"{name} eaves {eaves} ridge {ridge}", bool(order or row["lod"] < "2"), True
        if row["floor_storeys"] > 1 and pd.isna(row.get("given_storeys")):
            fits, floor = row["floor_area_m2"] * 2.2 <= volume * (1.0 + SHARE), row["floor_area_m2"]
            yield "storeys", f"{name} {floor} m² in {volume} m³", bool(fits), True


def judge_overlaps(result: Result) -> Iterator[Check]:
    """Volume that solids of one building, and of neighbours, share; outlines of neighbours that overlap."""
    for name, bodies in result.bodies.items():
        for one, two in combinations(bodies, 2):
            if one.lod == two.lod:
                common, what = share_volume(one.mesh, two.mesh)[0], f"{one.lod} {one.name}, {two.name} (m³)"
                yield "overlaps within", f"{name} {what}", common, 0.0, COMMON_M3
    frame, kind = result.modelled, "overlaps of neighbours"
    one, two = frame.sindex.query(frame.geometry, predicate="intersects")
    for a, b in zip(one[one < two], two[one < two], strict=True):
        names = frame["id"].iloc[a], frame["id"].iloc[b]
        common = frame.geometry.iloc[a].intersection(frame.geometry.iloc[b])
        thick = 2.0 * common.area / common.length * result.unit if common.area else 0.0
        if result.run.get("footprints") and thick > THIN_M:
            yield f"{common.area:.2f} of the map's {names[0]} and {names[1]} are the same"
            continue
        yield kind, f"outlines {names} (m thick)", thick, 0.0, THIN_M
        lod = max((body.lod for name in names for body in result.bodies[name]), default="0")
        pairs = [[body for body in result.bodies[name] if body.lod == lod] for name in names]
        thickness = max((share_volume(x.mesh, y.mesh)[1] for x in pairs[0] for y in pairs[1]), default=0.0)
        yield kind, f"{lod} {names} (m thick)", thickness, 0.0, THIN_M


def judge_rasters_and_systems(result: Result) -> Iterator[Check]:
    """Systems and bounds of all files; the mask against the footprints; terrain and surface under roofs."""
    frame, unit, code, modelled = result.footprints, result.unit, result.run["crs"] or "", result.modelled
    rasters = {name: rasterio.open(result.folder / f"{name}.tif") for name in ("mask", "dtm", "dsm")}
    systems = {f"{name}.tif": image.crs and image.crs.to_wkt() for name, image in rasters.items()}
    systems |= {name: las.header.parse_crs() for name, las in result.points.items()}
    systems |= {"roof_planes": result.roofs.crs, "run.json": code or frame.crs}
    for name, crs in systems.items():
        las = result.points.get(name)
        if crs is None and las is not None and int(las.point_format.id) < 6 and not code:
            yield f"{name}: a system without a code has no place in its point format"
            continue
        both = [None if one is None else pyproj.CRS(one) for one in (crs, frame.crs)]
        both = [one.sub_crs_list[0] if one is not None and one.is_compound else one for one in both]
        yield ("systems", name, *[None if one is None else one.name for one in both])
    said = result.head["metadata"].get("referenceSystem", "").rsplit("/", 1)[-1]
    if "+" not in code:
        yield "systems", "CityJSONSeq", said, code.removeprefix("EPSG:")
    box = shapely.box(*rasters["dsm"].bounds).buffer(RIM_M / unit)
    yield "bounds", "rasters", len({image.bounds for image in rasters.values()}), 1
    terrain, surface = rasters["dtm"], rasters["dsm"].read(1, masked=True)
    for row in modelled.itertuples():
        yield "bounds", f"{row.id} in the rasters", bool(box.covers(row.geometry)), True
        point = row.geometry.representative_point()
        place = terrain.index(point.x, point.y)
        high = float(surface[place]) * result.up if surface[place] is not np.ma.masked else row.h_max
        yield "heights", f"{row.id} surface {high:.2f}", bool(row.h_ground - 3.0 <= high), True
    everything = [result.places(feature) for feature in result.features if feature["vertices"]]
    corners = np.vstack(everything)[:, :2] / unit if everything else np.zeros((0, 2))
    sides = (*corners.min(axis=0), *corners.max(axis=0)) if everything else ()
    for k, (side, other) in enumerate(zip(sides, modelled.total_bounds, strict=False)):
        name = f"CityJSONSeq and footprints, side {k}"
        yield "bounds", name, float(side), float(other), 2 * LENGTH_M / unit
    mask, shapes = rasters["mask"].read(1), [one for one in frame.geometry if one]
    burnt = np.zeros_like(mask)
    if shapes:
        rasterio.features.rasterize(shapes, out=burnt, transform=rasters["mask"].transform)
    yield "mask", "cells", int(((mask > 0) != (burnt > 0)).sum()), 0


def judge_points(result: Result) -> Iterator[Check]:
    """Classes and numbers of the points under each footprint."""
    frame, count = result.footprints.set_index("number"), Counter[int]()
    for name, las in result.points.items():
        number, classes, head = np.asarray(las.building_id), np.asarray(las.classification), las.header
        off = int((classes[number > 0] != 6).sum())
        yield "classes", f"{name}: of buildings, not of class 6", off, 0
        for axis, low, high in zip("xyz", head.mins - 1e-6, head.maxs + 1e-6, strict=True):
            values = np.asarray(las[axis])
            yield "bounds", f"{name} {axis}", bool(((values >= low) & (values <= high)).all()), True
        for one, own in pd.Series(np.flatnonzero(number)).groupby(number[number > 0]):
            count[int(one)] += len(own)
            outline = frame.geometry.loc[one].buffer(2.0 / result.unit)
            inside = shapely.contains_xy(outline, np.asarray(las.x)[own], np.asarray(las.y)[own])
            yield "classes", f"{name}: points of {one} off its footprint", float((~inside).mean()), 0.0, 0.05
    windowed = result.run["bounds"] is not None or result.run["clip"] is not None
    total = sum(map(len, result.points.values()))
    yield "counts", "points", total, result.run["points_used" if windowed else "points"]
    for number, row in frame[frame["points"].notna()].iterrows():
        yield "classes", f"points of {row['id']}", bool(row["points"] == 0 or count[int(number)] > 0), True


def judge_by_programs(result: Result) -> Iterator[Check]:
    """cjio, QGIS and val3dity, where they are there."""
    if (whole := result.folder / "buildings.city.json").exists():
        from cjio import cityjson

        with whole.open(encoding="utf-8") as file:
            objects = cityjson.CityJSON(file).j["CityObjects"].values()
        yield "counts", "cjio", len([one for one in objects if "parents" not in one]), len(result.features)
    python = os.environ.get("EAVES_QGIS_PYTHON", "/usr/bin/python3")
    command = [python, "-c", QGIS, str(result.folder / "buildings.qgz")]
    plain = {**os.environ, "QT_QPA_PLATFORM": "offscreen", "PYTHONPATH": ""}
    done = subprocess.run(command, capture_output=True, text=True, env=plain, check=False)
    if done.returncode == 0:
        seen = json.loads(done.stdout.splitlines()[-1])
        yield "QGIS", "system of the project", seen["valid"], result.footprints.crs is not None
        yield "QGIS", "layers", seen["broken"], []
        yield "QGIS", "footprints", seen["counts"].get("footprints"), len(result.rows)
    else:
        yield "no QGIS"
    if program := os.environ.get("EAVES_VAL3DITY"):
        report, models = result.folder / "val3dity.json", result.folder / "buildings.city.jsonl"
        subprocess.run([program, "--report", report, models], capture_output=True, check=False)
        yield "val3dity", "errors", sorted(json.loads(report.read_text())["all_errors"]), []


QGIS = """
import json, sys
from qgis.core import QgsApplication, QgsProject
app = QgsApplication([], False); app.initQgis(); project = QgsProject.instance(); project.read(sys.argv[1])
layers = project.mapLayers().values(); rows = [one for one in layers if hasattr(one, "featureCount")]
counts = {one.source().split("layername=")[-1].split("|")[0]: one.featureCount() for one in rows}
broken = [one.name() for one in layers if not one.isValid()]
print(json.dumps({"valid": project.crs().isValid(), "broken": broken, "counts": counts}))
"""
FORMATS = "cityjson,obj,glb,geojson,fgb,parquet,citygml,citygml3,dxf,gpkg"
KINDS = (
    *("counts", "ids", "attributes", "areas", "volumes", "heights", "storeys", "overlaps within"),
    *("overlaps of neighbours", "systems", "bounds", "mask", "classes", "QGIS", "val3dity"),
)
NOTE = """Contradictions of what was compared. Files are read by pyogrio, geopandas, rasterio, laspy, cjio,
trimesh with manifold3d, and QGIS 3.22.

By design: geometry and rasters are in the unit of the reference system, every other figure in metres; `h_max`
is the top of the roof that was measured where LoD 1.2 or 1.3 is written; a building without a model has its
place, and no level; classified points of a building that hang over its outline stay its points (up to 2 m, a
twentieth); outlines of a map that overlap are said, not changed; autzen's system has no place in its points.

"""
JUDGES = (
    *(judge_counts_and_ids, judge_sizes, judge_overlaps, judge_rasters_and_systems, judge_points),
    judge_by_programs,
)


def judge(folder: Path) -> Judged:
    """All judges on the folder of a run."""
    result, judged = Result(folder), Judged()
    for one in JUDGES:
        for check in one(result):
            if isinstance(check, str):
                judged.notes.append(check)
            else:
                judged.hold(*check)
    return judged


SURVEYS = {
    "delft": ("delft/ahn3.laz", ()),
    "delft, given": ("delft/ahn3.laz", ("--footprints", "delft/footprints.gpkg", "--use-classes")),
    "ign_urban": ("ign_urban/*.laz", ()),
    "williams": ("williams/williams.laz", ()),
    "ucla": ("ucla/royce.laz", ()),
    "woodford": ("woodford/woodford.laz", ()),
    "autzen": ("autzen/autzen_full.laz", ("--crs", "autzen/srs.wkt")),
    **{f"town {seed}": (f"town {seed}", ("--formats", FORMATS)) for seed in (1, 2, 3)},
}
"""The points, and the words behind them; of drawn towns the seed."""
for name in ("delft", "ign_urban", "williams", "ucla"):
    SURVEYS[f"{name}, LoD 2.3"] = SURVEYS[name][0], ("--lod", "2.3")


def built(name: str, work: Path) -> Path:
    """The folder of a survey's results, built by the command where it is not there."""
    data, out = Path(os.environ["EAVES_DATA"]), work / name.replace(",", "").replace(" ", "-")
    if (out / "run.json").exists() and json.loads((out / "run.json").read_text())["complete"]:
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
    rows, notes = {str(row["survey"]): row for row in kept_rows("judges")}, []
    with tempfile.TemporaryDirectory() as temporary:
        for name in options.surveys:
            judged = judge(built(name, options.work or Path(temporary)))
            rows[name] = {"survey": name}
            for what in KINDS:
                compared, wrong = judged.compared[what], judged.wrong[what]
                rows[name][what] = f"{len(wrong)} of {compared:,}" if compared else "–"
                notes += [f"- {name}, {what}: {one}" for one in wrong[:5]]
            notes += [f"- {name}: {one}" for one in judged.notes[:5]]
            print(rows[name], flush=True)
    title = "What is written, read by others and held against one another"
    keep("judges", title, list(rows.values()), COMMAND, NOTE + "\n".join(notes))


if __name__ == "__main__":
    main()
