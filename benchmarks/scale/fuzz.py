"""The inputs that commands take, how each is mutated, and what a command may do with them.

`benchmarks.scale.hostile` gives every input to the command that users give it to. A refusal must
be one line and leave nothing behind; what is written in spite of the damage must open.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import laspy
import pyproj
from tests.formats.copc_writer import write_copc

from benchmarks.scale.map_mutations import hurt_database, hurt_json
from benchmarks.scale.mutations import Mutate, either, hurt_bytes, hurt_words
from benchmarks.scale.point_mutations import hurt_points
from eaves.formats import iter_cityjson, open_source, read_polygons
from eaves.formats.vectors.geopackage import Row, write_polygons
from eaves.pipeline import build
from eaves.simulate import scan_town, simulate_town, write_simulation

SIDE = 40
"""Of the scene and of a block (m)."""


@dataclass(frozen=True)
class Kind:
    """One kind of input: the whole file, how it is hurt, and the command it is given to."""

    name: str
    whole: Path
    mutate: Mutate
    words: Callable[[Path, Path], list[str]]


def write_whole(place: Path) -> None:
    """Write a whole input of every kind that the commands read, of a village of a few houses."""
    town = write_simulation(scan_town(simulate_town(0.01, seed=5), 2.0, seed=5), place / "town")
    las, points = laspy.read(town["points"]), place / "a.laz"
    las.points = las.points[(las.x < las.x.min() + SIDE) & (las.y < las.y.min() + SIDE)]
    las.write(place / "a.las")
    las.write(points)
    # COPC knows the newer point formats only.
    write_copc(place / "a.copc.laz", laspy.convert(las, point_format_id=6, file_version="1.4"), levels=2)
    rows = (f"{x:.2f} {y:.2f} {z:.2f}" for x, y, z in las.xyz)
    (place / "a.xyz").write_text("\n".join(rows) + "\n")
    out = place / "out"
    build(str(points), out)
    footprints = place / "footprints.gpkg"
    shutil.copy(out / "footprints.gpkg", footprints)
    polygons, ids, _, system = read_polygons(footprints)
    rows_of = [Row(polygon, {"id": name}) for polygon, name in zip(polygons, ids, strict=True)]
    for name in ("a.fgb", "a.geojson"):
        write_polygons(place / name, rows_of, system)
    shutil.copy(out / "buildings.city.jsonl", place / "a.city.jsonl")
    shutil.copy(out / "mask.tif", place / "a.tif")
    (place / "a.wkt").write_text(pyproj.CRS.from_epsg(28992).to_wkt())
    (place / "a.toml").write_text('[detect]\nmethod = "planar_patches"\n[outline]\nmethod = "alpha_shape"\n')


def make_kinds(place: Path) -> list[Kind]:
    """Each kind of input with the command it is given to; the whole ones lie in `place`."""
    points, footprints, out = place / "a.laz", place / "footprints.gpkg", place / "out"

    def build(path: Path, target: Path) -> list[str]:
        return ["build", str(path), "-o", str(target), "-q", "--jobs", "1"]

    def with_footprints(path: Path, target: Path) -> list[str]:
        return [*build(points, target), "--footprints", str(path)]

    def detect(path: Path, target: Path) -> list[str]:
        return ["detect", *build(path, target)[1:]]

    def ground(path: Path, target: Path) -> list[str]:
        return ["ground", *detect(path, target / "ground.laz")[1:]]

    def validate(path: Path, target: Path) -> list[str]:
        return ["validate", str(path)]

    def judge(what: str) -> Callable[[Path, Path], list[str]]:
        name = {"models": "buildings.city.jsonl"}.get(what, "footprints.gpkg")
        return lambda path, target: ["evaluate", what, str(out / name), str(path), "-o", str(target)]

    def clipped(path: Path, target: Path) -> list[str]:
        return [*detect(points, target), "--clip", str(path)]

    def placed(path: Path, target: Path) -> list[str]:
        return [*ground(points, target), "--crs", str(path)]

    def scanned(path: Path, target: Path) -> list[str]:
        return ["simulate", "-o", str(target), "--model", str(path), "--density", "0.2", "-q"]

    def configured(path: Path, target: Path) -> list[str]:
        return [*build(points, target), "--config", str(path)]

    las, base, document = (either(0.6, mine, other) for mine, other in (
        (hurt_points, hurt_bytes), (hurt_database, hurt_bytes), (hurt_json, hurt_words)
    ))  # fmt: skip
    city = place / "a.city.jsonl"
    return [
        Kind("LAS", place / "a.las", las, build),
        Kind("LAZ", points, las, detect),
        Kind("COPC", place / "a.copc.laz", las, build),
        Kind("text points", place / "a.xyz", hurt_words, ground),
        Kind("GeoPackage footprints", footprints, base, with_footprints),
        Kind("FlatGeobuf footprints", place / "a.fgb", hurt_bytes, with_footprints),
        Kind("GeoJSON footprints", place / "a.geojson", document, with_footprints),
        Kind("CityJSONSeq to validate", city, document, validate),
        Kind("CityJSONSeq to compare with", city, document, judge("models")),
        Kind("CityJSONSeq to scan", city, document, scanned),
        Kind("GeoPackage to compare with", footprints, base, judge("footprints")),
        Kind("GeoTIFF to compare with", place / "a.tif", hurt_bytes, judge("detection")),
        Kind("GeoJSON to clip by", place / "a.geojson", document, clipped),
        Kind("coordinate system", place / "a.wkt", hurt_words, placed),
        Kind("configuration", place / "a.toml", hurt_words, configured),
    ]


def wrong_with(status: int, said: str, out: Path) -> str:
    """What breaks the promise, or nothing."""
    if status not in (0, 1, 2):
        return f"exit status {status}"
    if status == 2 and len(said.strip().splitlines()) < 1:
        return "a refusal without a word"
    if status == 2 and len([line for line in said.splitlines() if line.startswith("error:")]) != 1:
        return "a refusal that is not one line"
    left = sorted(path for path in out.rglob("*") if path.is_file()) if out.exists() else []
    if any(path.name.startswith(".") or path.parent.name.startswith(".") for path in left if status != 1):
        return f"a half-written file: {left[0].name}"
    try:
        for path in left:
            open_again(path)
    except Exception as error:  # whatever its reader raises, the file is no good
        return f"{path.name} does not open: {error}"
    return ""


def open_again(path: Path) -> None:
    """Open a written file; whatever its reader raises, if it cannot be."""
    if path.name.endswith((".city.jsonl", ".city.json")):
        for _ in iter_cityjson(path):
            pass
    elif path.suffix in (".gpkg", ".fgb", ".geojson"):
        read_polygons(path)
    elif path.suffix in (".las", ".laz"):
        open_source(path)
    elif path.suffix == ".json":
        json.loads(path.read_text())
