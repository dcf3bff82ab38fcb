"""Maps of given footprints: which layer, which system, which id, what lies twice, in which format."""

from __future__ import annotations

import json
import re
import sqlite3
import zipfile
from collections.abc import Callable, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path

import geopandas
import numpy as np
import pandas
import pyogrio
import pyogrio.raw
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon, affinity
from shapely.geometry.base import BaseGeometry

from benchmarks.scale.silence import Drawn, Variant
from benchmarks.scale.silence.houses import (
    PLACE,
    SIDE,
    SYSTEM,
    Scene,
    draw_houses,
    in_world,
    measured_wrong,
    write_points,
)

Judge = Callable[[Path], str]
Rows = geopandas.GeoDataFrame
DOUBLED = r"\b\d+ (footprints?|polygons?|pairs?)[^.;\"]{0,80}(overlap|twice|lies? |doubl)"
"""What is said of polygons that stand for the same building, with how many there are."""
CURVE_POLYGON, LINE = 10, 2
"""Types of WKB."""


def plans_of(scene: Scene) -> list[Polygon]:
    """The plans of the houses in the world."""
    return [affinity.translate(house.plan, *PLACE) for house in scene.houses]


def table(shapes: Sequence[BaseGeometry | None], system: object = SYSTEM, **columns: object) -> Rows:
    """A layer of these shapes and columns; ids a, b, c, … where none are given."""
    columns = columns or {"id": [chr(97 + n) for n in range(len(shapes))]}
    return geopandas.GeoDataFrame(columns, geometry=list(shapes), crs=system)


def parcels_of(scene: Scene) -> list[Polygon]:
    """Four parcels which together are the whole scene."""
    half = SIDE / 2
    corners = [(x, y) for x in (0.0, half) for y in (0.0, half)]
    return [affinity.translate(shapely.box(x, y, x + half, y + half), *PLACE) for x, y in corners]


def write_layers(path: Path, layers: Sequence[tuple[str, Rows]]) -> Path:
    """A GeoPackage of these layers in their order; the path."""
    for name, rows in layers:
        rows.to_file(path, layer=name, driver="GPKG", engine="pyogrio")
    return path


def mapped_wrong(
    scene: Scene, ids: Sequence[str] = (), quiet: str | None = None, rows: int | None = None
) -> Judge:
    """The judge of a run with a map: every house once among the models; with `ids` these ids in any order;
    with `quiet` nothing of this pattern in run.json; with `rows` so many rows, failures counted."""

    def judge(out: Path) -> str:
        found = pyogrio.read_dataframe(out / "footprints.gpkg", layer="footprints")
        failed = (
            found.failure_code.fillna("") != "" if "failure_code" in found else np.zeros(len(found), bool)
        )
        kept = out / "modelled.gpkg"
        found[~failed].to_file(kept, layer="footprints", driver="GPKG", engine="pyogrio")
        said = [measured_wrong(scene, layer=kept.name)(out)]
        kept.unlink()
        if ids and sorted(ids) != sorted(map(str, found.id)):
            said.append(f"ids {sorted(map(str, found.id))} for {sorted(ids)}")
        if rows is not None and len(found) != rows:
            said.append(f"{len(found)} rows for {rows}")
        if quiet is not None:
            told = re.search(quiet, (out / "run.json").read_text(encoding="utf-8"))
            said.append(f"says {told[0]!r}" if told else "")
        return "; ".join(filter(None, said))

    return judge


def drawn(
    folder: Path,
    rng: np.random.Generator,
    write: Callable[[Path, Scene], Path],
    cause: str = "never said",
    judge: Callable[[Scene], Judge] = mapped_wrong,
    words: Sequence[str] = (),
) -> Drawn:
    """Houses, their points, a map written by `write`, and the command that takes both."""
    scene = draw_houses(rng)
    points = write_points(folder / "tile.laz", in_world(scene.xyz))
    given = write(folder, scene)
    command = ["build", str(points), "-o", "OUT", "--footprints", str(given), *words]
    return Drawn([*command, "--outputs", "footprints,models"], judge(scene), cause)


def layered(*names: str) -> Callable[[Path, Scene], Path]:
    """What writes a GeoPackage of polygon layers: parcels under all names but the last, then the houses."""

    def write(folder: Path, scene: Scene) -> Path:
        parcels = table(parcels_of(scene), number=[1, 2, 3, 4])
        layers = [(name, parcels) for name in names[:-1]]
        return write_layers(folder / "map.gpkg", [*layers, (names[-1], table(plans_of(scene)))])

    return write


def single(
    change: Callable[[Scene], Rows], name: str = "map.gpkg", driver: str | None = None, **options: object
) -> Callable[[Path, Scene], Path]:
    """What writes a file of one layer."""

    def write(folder: Path, scene: Scene) -> Path:
        rows = change(scene)
        if name.endswith(".parquet"):
            rows.to_parquet(folder / name)
        else:
            rows.to_file(folder / name, driver=driver, engine="pyogrio", **options)
        return folder / name

    return write


def houses(scene: Scene) -> Rows:
    """The houses as they are."""
    return table(plans_of(scene))


def moved(system: int) -> Callable[[Scene], Rows]:
    """The houses in another system."""
    return lambda scene: houses(scene).to_crs(system)


def without_system(system: int | None = None) -> Callable[[Scene], Rows]:
    """The houses in a system that the file does not say."""

    def change(scene: Scene) -> Rows:
        rows = houses(scene) if system is None else houses(scene).to_crs(system)
        return rows.set_crs(None, allow_override=True)

    return change


def plane_geojson(system: int | None = None, swapped: bool = False) -> Callable[[Path, Scene], Path]:
    """What writes GeoJSON without the member `crs`, in any system, also with the coordinates exchanged."""

    def write(folder: Path, scene: Scene) -> Path:
        rows = houses(scene) if system is None else houses(scene).to_crs(system)
        if swapped:
            rows = rows.set_geometry(shapely.transform(rows.geometry.values, lambda xy: xy[:, ::-1]))
        features = [
            {"type": "Feature", "properties": {"id": name}, "geometry": json.loads(shapely.to_geojson(shape))}
            for name, shape in zip(rows.id, rows.geometry, strict=True)
        ]
        text = json.dumps({"type": "FeatureCollection", "features": features})
        (folder / "map.geojson").write_text(text, encoding="utf-8")
        return folder / "map.geojson"

    return write


def with_also(also: Callable[[list[Polygon]], list[Polygon]]) -> Callable[[Path, Scene], Path]:
    """What writes the houses and further polygons made of them."""
    return single(lambda scene: table(plans_of(scene) + also(plans_of(scene))))


def half_over(plan: Polygon) -> Polygon:
    """The plan, moved along its longest side by half of it."""
    corners = np.array(plan.exterior.coords)
    sides = np.diff(corners, axis=0)
    step = sides[np.argmax(np.hypot(*sides.T))] / 2
    return affinity.translate(plan, *step)


def other_start(plan: Polygon) -> Polygon:
    """The same plan from another corner, the other way round, with a corner more on a side."""
    corners = np.array(plan.exterior.coords)[:-1]
    ring = np.roll(corners, 2, axis=0)[::-1]
    return Polygon(np.vstack([ring, (ring[-1] + ring[0]) / 2]))


def identified(values: Sequence[object] | NDArray[np.generic], name: str) -> Callable[[Scene], Rows]:
    """The houses with a column of ids."""
    return lambda scene: table(plans_of(scene), **{name: values})


def write_curves(folder: Path, scene: Scene) -> Path:
    """A GeoPackage of curve polygons whose rings are lines."""
    wkb = []
    for plan in plans_of(scene):
        ring = np.array(plan.exterior.coords)
        head = np.array([1], np.uint8).tobytes() + np.array([CURVE_POLYGON, 1], "<u4").tobytes()
        line = np.array([1], np.uint8).tobytes() + np.array([LINE, len(ring)], "<u4").tobytes()
        wkb.append(head + line + ring.astype("<f8").tobytes())
    path = folder / "map.gpkg"
    ids = [np.array(["a", "b", "c"], object)]
    kind = {"geometry_type": "Unknown", "crs": "EPSG:28992", "driver": "GPKG"}
    pyogrio.raw.write(path, np.array(wkb, object), ids, ["id"], **kind)
    with closing(sqlite3.connect(path)) as database, database:
        database.execute("UPDATE gpkg_geometry_columns SET geometry_type_name = 'CURVEPOLYGON'")
    return path


def write_zip(folder: Path, scene: Scene) -> Path:
    """A shapefile in a zip archive."""
    shape = single(houses, "map.shp")(folder, scene)
    path = folder / "map.zip"
    with zipfile.ZipFile(path, "w") as archive:
        for part in folder.glob("map.*"):
            if part != path:
                archive.write(part, part.name)
    shape.unlink()
    return path


def write_years(folder: Path, scene: Scene) -> Path:
    """Two layers of buildings: an old one, shifted by 30 m, and the true one."""
    old = table([affinity.translate(plan, 30.0, 0.0) for plan in plans_of(scene)])
    return write_layers(folder / "map.gpkg", [("buildings_2009", old), ("buildings_2024", houses(scene))])


def write_known(folder: Path, scene: Scene) -> Path:
    """Parcels, and a layer whose name says nothing and whose columns are those of the BAG."""
    known = table(
        plans_of(scene),
        identificatie=[f"050310000001860{n}" for n in range(3)],
        bouwjaar=[1950, 1960, 1970],
        status=["Pand in gebruik"] * 3,
        aantal_verblijfsobjecten=[1, 1, 1],
    )
    return write_layers(folder / "map.gpkg", [("a", table(parcels_of(scene))), ("b", known)])


def write_empty_first(folder: Path, scene: Scene) -> Path:
    """A layer of buildings without a feature, then one of another name with the houses."""
    full = houses(scene)
    return write_layers(folder / "map.gpkg", [("buildings", full.iloc[:0]), ("survey", full)])


def write_points_first(folder: Path, scene: Scene) -> Path:
    """A layer of points and a table without shapes, then the houses under a name that says nothing."""
    places = table([plan.centroid for plan in plans_of(scene)])
    path = write_layers(folder / "map.gpkg", [("addresses", places)])
    pyogrio.write_dataframe(pandas.DataFrame({"key": [1]}), path, layer="codes", driver="GPKG", append=True)
    return write_layers(path, [("x1", houses(scene))])


def write_points_only(folder: Path, scene: Scene) -> Path:
    """A map of points alone."""
    return write_layers(folder / "map.gpkg", [("pts", table([plan.centroid for plan in plans_of(scene)]))])


def slivers(scene: Scene) -> Rows:
    """The first house as two halves which overlap by 5 cm, as digitised maps have them, and the others."""
    first, *others = plans_of(scene)
    corners = np.array(first.exterior.coords)
    far = Polygon([corners[0], (corners[0] + corners[1]) / 2, (corners[3] + corners[2]) / 2, corners[3]])
    near = first.difference(far).buffer(0.05, join_style="mitre")
    return table([far, near, *others])


def halves_wrong(scene: Scene) -> Judge:
    """The judge of `slivers`: four models, nothing said of what overlaps."""

    def judge(out: Path) -> str:
        found = pyogrio.read_dataframe(out / "footprints.gpkg", layer="footprints")
        told = re.search(DOUBLED, (out / "run.json").read_text(encoding="utf-8"))
        modelled = int((found.failure_code.fillna("") == "").sum())
        return f"says {told[0]!r}" if told else "" if modelled == 4 else f"{modelled} models"

    return judge


def parcels_wrong(scene: Scene) -> Judge:
    """The judge of a run that was told to take the parcels: four rows."""

    def judge(out: Path) -> str:
        found = pyogrio.read_dataframe(out / "footprints.gpkg", layer="footprints")
        return "" if len(found) == 4 else f"{len(found)} rows"

    return judge


FLOATS = np.array([503100000018603.0, 503100000018604.0, 503100000018605.0])
TEXTS = [str(int(number)) for number in FLOATS]
UNREADABLE = r"(map\.\w+).*(ogr2ogr|unzip|unpack)"
"""A refusal of a format names the file and a command that makes one that is read."""
SITUATIONS: dict[str, Callable[[Path, np.random.Generator], Drawn]] = {
    # Which layer
    "parcels before buildings": partial(drawn, write=layered("cadastral parcels", "buildings")),
    "parcels before building": partial(drawn, write=layered("Parcel", "Building")),
    "percelen before gebouwen": partial(drawn, write=layered("percelen", "gebouwen")),
    "perceel before bag_pand": partial(drawn, write=layered("perceel", "bag_pand")),
    "Flurstuecke before Gebaeude": partial(drawn, write=layered("Flurstuecke", "Gebaeude")),
    "Flurstücke before Gebäude": partial(drawn, write=layered("Flurstücke", "Gebäude")),
    "parcelles before batiments": partial(drawn, write=layered("parcelles", "wegen", "batiments")),
    "parcelas before edificios": partial(drawn, write=layered("parcelas", "edificios")),
    "dzialki before budynki": partial(drawn, write=layered("dzialki", "budynki")),
    "columns of a known map": partial(
        drawn, write=write_known, judge=partial(mapped_wrong, ids=[f"050310000001860{n}" for n in range(3)])
    ),
    "no layer looks like buildings": partial(drawn, write=layered("a1", "b1"), cause=r"a1.*b1.*--layer"),
    "two layers of buildings": partial(
        drawn, write=write_years, cause=r"buildings_2009.*buildings_2024.*--layer"
    ),
    "the layer is named": partial(drawn, write=layered("a1", "b1"), words=["--layer", "b1"]),
    "the parcels are named": partial(
        drawn, write=layered("parcels", "buildings"), words=["--layer", "parcels"], judge=parcels_wrong
    ),
    "a layer is named that is not there": partial(
        drawn, write=layered("a1", "b1"), words=["--layer", "c1"], cause=r"no layer 'c1'.*a1.*b1"
    ),
    "an empty layer of buildings first": partial(drawn, write=write_empty_first),
    "points and a table first": partial(drawn, write=write_points_first),
    "points alone": partial(drawn, write=write_points_only, cause=r"map\.gpkg.*Point.*polygon"),
    # What lies twice
    "a polygon twice": partial(drawn, write=with_also(lambda plans: plans[:1]), cause=DOUBLED),
    "a polygon twice, another start": partial(
        drawn, write=with_also(lambda plans: [other_start(plans[1])]), cause=DOUBLED
    ),
    "the layer twice": partial(drawn, write=with_also(lambda plans: plans), cause=DOUBLED),
    "half over another": partial(drawn, write=with_also(lambda plans: [half_over(plans[0])]), cause=DOUBLED),
    "a small one inside": partial(
        drawn, write=with_also(lambda plans: [affinity.scale(plans[2], 0.5, 0.5)]), cause=DOUBLED
    ),
    "control: halves with a sliver": partial(drawn, write=single(slivers), judge=halves_wrong),
    "control: plain": partial(
        drawn, write=single(houses), judge=partial(mapped_wrong, quiet=DOUBLED, ids=["a", "b", "c"], rows=3)
    ),
    # Which id
    "ids as floats": partial(
        drawn, write=single(identified(FLOATS, "pand_id")), judge=partial(mapped_wrong, ids=TEXTS)
    ),
    "ids as floats, named": partial(
        drawn,
        write=single(identified(FLOATS, "number")),
        judge=partial(mapped_wrong, ids=TEXTS),
        words=["--id-field", "number"],
    ),
    "ids as floats, one missing": partial(
        drawn,
        write=single(identified([*FLOATS[:2], np.nan], "number")),
        words=["--id-field", "number"],
        cause=r"1 of 3 footprints have no 'number'",
    ),
    "ids as floats, two alike": partial(
        drawn,
        write=single(identified(FLOATS[[0, 0, 1]], "number")),
        words=["--id-field", "number"],
        cause=r"'number' occur.*'503100000018603'",
    ),
    "ids with leading zeros": partial(
        drawn,
        write=single(identified(["007", "008", "009"], "code")),
        judge=partial(mapped_wrong, ids=["007", "008", "009"]),
        words=["--id-field", "code"],
    ),
    "ids of 17 digits": partial(
        drawn,
        write=single(identified(np.array([10000000000000001, 10000000000000003, 7]), "code")),
        judge=partial(mapped_wrong, ids=["10000000000000001", "10000000000000003", "7"]),
        words=["--id-field", "code"],
    ),
    # Which system
    "plane GeoJSON without crs": partial(
        drawn, write=plane_geojson(), cause=r"ogr2ogr -a_srs EPSG:28992 \S+\.geojson \S*map\.geojson"
    ),
    "plane GeoJSON of another system": partial(
        drawn, write=plane_geojson(25831), cause=r"ogr2ogr -a_srs EPSG:\S+ \S+\.geojson \S*map\.geojson"
    ),
    "GeoJSON in degrees": partial(drawn, write=plane_geojson(4326)),
    "GeoJSON in degrees, exchanged": partial(
        drawn, write=plane_geojson(4326, swapped=True), cause=r"map\.geojson.*no polygon meets the points"
    ),
    "shapefile without .prj": partial(drawn, write=single(without_system(), "map.shp")),
    "shapefile without .prj, in degrees": partial(
        drawn, write=single(without_system(4326), "map.shp"), cause=r"map\.shp.*degrees.*ogr2ogr -a_srs"
    ),
    "shapefile without .prj, of another system": partial(
        drawn, write=single(without_system(25831), "map.shp"), cause=r"map\.shp.*no polygon meets"
    ),
    "another system": partial(drawn, write=single(moved(25831))),
    "web mercator": partial(drawn, write=single(moved(3857))),
    # Which shapes
    "multipolygons": partial(
        drawn, write=single(lambda scene: table([MultiPolygon([plan]) for plan in plans_of(scene)]))
    ),
    "3D polygons": partial(
        drawn, write=single(lambda scene: table([shapely.force_3d(plan, 7.0) for plan in plans_of(scene)]))
    ),
    "curve polygons": partial(drawn, write=write_curves),
    "a row without shape": partial(
        drawn,
        write=single(lambda scene: table([*plans_of(scene), None])),
        judge=partial(mapped_wrong, rows=4),
    ),
    # Which format
    "SpatiaLite": partial(
        drawn,
        write=single(houses, "map.sqlite", "SQLite", SPATIALITE="YES", layer="houses"),
        cause=UNREADABLE,
    ),
    "SQLite of OGR": partial(drawn, write=single(houses, "map.sqlite", "SQLite"), cause=UNREADABLE),
    "KML": partial(drawn, write=single(moved(4326), "map.kml", "KML"), cause=UNREADABLE),
    "GML": partial(drawn, write=single(houses, "map.gml", "GML"), cause=UNREADABLE),
    "zipped shapefile": partial(drawn, write=write_zip, cause=UNREADABLE),
    "FlatGeobuf": partial(drawn, write=single(houses, "map.fgb", "FlatGeobuf")),
    "GeoParquet": partial(drawn, write=single(houses, "map.parquet")),
}


def variants() -> list[Variant]:
    """The variants of this kind."""
    return [Variant("maps", name, draw) for name, draw in SITUATIONS.items()]
