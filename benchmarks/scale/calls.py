"""Calls as strangers type them: those who know geopandas, laspy, rasterio, scikit-image or trimesh.

Each call is a line of Python and an expression of what is right, checked against what the command
`eaves build` gives of the same points. A call is right, refused (one sentence without a `--flag`, where the
call has no meaning), refused though it has one, or wrong: another value, or an error of something else.

usage: python -m benchmarks.scale.calls [--name WORD]
"""

from __future__ import annotations

import argparse
import ast
import logging
import os
import subprocess
import sys
import tempfile
import warnings
from collections import Counter
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.scale.silence.houses import draw_houses, in_world, write_points
from benchmarks.table import keep

VERDICTS = ("right", "refused", "refused, has a meaning", "wrong")
LONGEST_SENTENCE = 400
"""Characters of a refusal; more is no sentence."""


@dataclass(frozen=True)
class Call:
    """A call: what it carries over, the line, and what holds of its `value`; None where it has no meaning."""

    of: str
    line: str
    right: str | None


TABLE = "first users"
CALLS = [
    # points, as laspy and numpy users hold them
    Call("laspy", "eaves.read(tile)", "len(value) == len(las.points)"),
    Call("laspy", "eaves.read(str(tile))", "len(value) == len(las.points)"),
    Call("laspy", "eaves.read([tile])", "len(value) == len(las.points)"),
    Call("laspy", "eaves.read(folder)", "len(value) == len(las.points)"),
    Call(TABLE, "eaves.read(tile, bounds=(w, s, w + 40, s + 40))", "0 < len(value) < len(las.points)"),
    Call("geopandas", "eaves.read(tile, bounds=parcels.total_bounds)", "0 < len(value) <= len(las.points)"),
    Call("rasterio", "eaves.read(tile, bounds=[w, s, w + 40, s + 40])", "0 < len(value) < len(las.points)"),
    Call("geopandas", "eaves.read(bare, crs=28992)", "'28992' in value.system.code"),
    Call("geopandas", "eaves.read(bare, crs='EPSG:28992')", "'28992' in value.system.code"),
    Call("geopandas", "eaves.read(bare, crs=parcels.crs)", "'28992' in value.system.code"),
    Call("laspy", "eaves.PointCloud.from_laspy(las)", "same_points(value)"),
    Call("laspy", "eaves.PointCloud.from_laspy(las).system.code", "'28992' in value"),
    Call(
        TABLE,
        "eaves.classify_ground(eaves.PointCloud(xyz=las.xyz))",
        "same_classes(value)",
    ),
    Call(TABLE, "eaves.PointCloud(las.xyz).world", "np.abs(value - las.xyz).max() < 1e-3"),
    Call("numpy", "eaves.PointCloud.from_world(las.xyz)", "same_points(value)"),
    Call("numpy", "eaves.PointCloud(np.asfortranarray(las.xyz))", "same_points(value)"),
    Call("numpy", "eaves.PointCloud(las.xyz.tolist())", "same_points(value)"),
    Call("numpy", "len(cloud)", "value == len(las.points)"),
    Call(TABLE, "cloud[cloud.xyz[:, 2] > 12.0]", "len(value) == (las.xyz[:, 2] > 12.0).sum()"),
    Call("numpy", "cloud[:100]", "len(value) == 100"),
    Call("numpy", "cloud[np.arange(10)]", "len(value) == 10"),
    Call("numpy", "ground[ground.ground]", "value.ground.all() and len(value) == ground.ground.sum()"),
    Call(TABLE, "cloud.world", "np.abs(np.sort(value, 0) - np.sort(las.xyz, 0)).max() < 1e-3"),
    Call("laspy", "cloud.world[:, 0].max()", "abs(value - las.x.max()) < 1e-3"),
    Call(TABLE, "tuple(cloud.bounds)", "len(value) == 4 and value[0] < value[2]"),
    Call("rasterio", "west, south, east, north = cloud.bounds", "north - south > 80"),
    Call("geopandas", "shapely.box(*cloud.bounds).area", "value > 7000"),
    Call("geopandas", "cloud.crs", "value is not None and value.to_epsg() == 28992"),
    Call("laspy", "eaves.PointCloud.from_laspy(las).number_of_returns.max()", "value == 1"),
    # the stages, as scikit-image's functions are called
    Call("scikit-image", "eaves.classify_ground(cloud)", "same_classes(value)"),
    Call("scikit-image", "eaves.classify_ground(cloud, 'adaptive_tin')", "same_classes(value)"),
    Call("scikit-image", "eaves.classify_ground(cloud, method=eaves.AdaptiveTin())", "same_classes(value)"),
    Call("laspy", "eaves.classify_ground(las)", "same_classes(value)"),
    Call(TABLE, "eaves.make_scene(ground)", "abs(value.spacing - scene.spacing) < 1e-9"),
    Call(TABLE, "eaves.make_dtm(ground)", "abs(np.nanmedian(value.values) - 10.0) < 0.1"),
    Call("rasterio", "eaves.make_dsm(ground)", "np.nanmax(value.values) > 15.0"),
    Call("rasterio", "eaves.make_dsm(ground, cell=1.0)", "value.cell == 1.0"),
    Call("rasterio", "eaves.make_dtm(ground).bounds.width", "value >= 89"),
    Call("scikit-image", "eaves.detect_buildings(scene)", "value.label.max() == 3"),
    Call("scikit-image", "eaves.detect_buildings(ground)", "value.label.max() == 3"),
    Call("scikit-image", "eaves.detect_buildings(scene, min_area=20)", "value.label.max() == 3"),
    Call(TABLE, "eaves.trace_outline(p)", "len(value.rings) == 1"),
    Call("scikit-image", "eaves.trace_outline(p, method='alpha_shape')", "len(value.rings) == 1"),
    Call(TABLE, "eaves.regularise_outlines(boundary)", "abs(value.polygon.area / plan.area - 1) < 0.1"),
    Call(
        "scikit-image",
        "eaves.regularise_outlines([boundary])[0]",
        "abs(value.polygon.area / plan.area - 1) < 0.1",
    ),
    Call("shapely", "eaves.regularise_outlines(boundary).area", "abs(value / plan.area - 1) < 0.1"),
    Call(TABLE, "eaves.segment_roof(p)", "len(value) == 2"),
    Call("scikit-image", "eaves.segment_roof(p, method='region_growing')", "len(value) == 2"),
    Call("scikit-image", "eaves.segment_roof(p)[0].slope", "0.3 < value < 0.8"),
    Call(
        TABLE,
        "eaves.reconstruct_building(ground.xyz[regions.label == 1], footprint, planes, scene)",
        "abs(value.attributes['volume_m3'] / volume - 1) < 0.1",
    ),
    Call(
        TABLE,
        "eaves.reconstruct_building(p, footprint, planes, 10.0)",
        "abs(value.attributes['volume_m3'] / volume - 1) < 0.1",
    ),
    Call("scikit-image", "eaves.reconstruct_building(p, footprint, planes)", None),
    Call("trimesh", "eaves.to_trimesh(model).is_watertight", "value"),
    Call("trimesh", "eaves.to_trimesh(model).volume", "abs(value / volume - 1) < 0.1"),
    Call(
        "shapely", "shapely.geometry.shape(footprint).centroid.x", "abs(value - world_plan.centroid.x) < 0.5"
    ),
    Call(TABLE, "footprint.world", "(value & world_plan).area / (value | world_plan).area > 0.9"),
    Call(TABLE, "model.world['2.2'][0].vertices", "value[:, 0].min() > 85000"),
    Call("geopandas", "gpd.GeoSeries([footprint.world], crs=cloud.crs)", "len(value) == 1"),
    Call("scikit-image", "eaves.validate_model(model)", "value == []"),
    # the doors
    Call("geopandas", "eaves.find_buildings(tile)", "len(value.footprints) == 3"),
    Call("geopandas", "eaves.find_buildings(str(tile)).footprints", "same_table(value)"),
    Call("geopandas", "eaves.find_buildings([tile]).footprints", "same_table(value)"),
    Call("laspy", "eaves.find_buildings(las).footprints", "same_table(value)"),
    Call("numpy", "eaves.find_buildings(las.xyz, crs=28992).footprints", "same_table(value)"),
    Call("numpy", "eaves.find_buildings(las.xyz, crs='EPSG:28992').footprints", "same_table(value)"),
    Call("numpy", "eaves.find_buildings(las.xyz)", None),
    Call("numpy", "eaves.find_buildings(las.xyz, crs='metres').footprints", "len(value) == 3"),
    Call("numpy", "eaves.find_buildings(las.xyz[:, :2], crs=28992)", None),
    Call("numpy", "eaves.find_buildings(np.zeros((0, 3)), crs=28992)", None),
    Call("numpy", "eaves.find_buildings(with_nan, crs=28992).footprints", "same_table(value)"),
    Call(
        "numpy",
        "eaves.find_buildings(np.round(las.xyz * 1000).astype(int) / 1000, crs=28992).footprints",
        "same_table(value)",
    ),
    Call(
        "numpy",
        "eaves.find_buildings(las.xyz.astype(np.float32), crs=28992)",
        "len(value.footprints) == 3 and any('float32' in line and 'cm' in line for line in said)",
    ),
    Call("numpy", "eaves.find_buildings(cloud).footprints", "same_table(value)"),
    Call("geopandas", "found.footprints.crs", "value.to_epsg() == 28992"),
    Call("geopandas", "found.footprints.area.sum()", "abs(value / reference.area.sum() - 1) < 1e-6"),
    Call("geopandas", "found.footprints.sjoin(parcels).index.nunique()", "value == 3"),
    Call(
        "geopandas",
        "found.footprints[found.footprints.trust == 'high']",
        "len(value) == (reference.trust == 'high').sum()",
    ),
    Call("geopandas", "found.footprints.to_crs(4326).total_bounds", "3 < value[0] < 8"),
    Call("geopandas", "found.footprints.to_file(place / 'f.gpkg')", "(place / 'f.gpkg').exists()"),
    Call("geopandas", "found.planes", "len(value) == len(reference_planes)"),
    Call("geopandas", "found.planes.slope_deg.max()", "abs(value - reference_planes.slope_deg.max()) < 1e-6"),
    Call("geopandas", "found.doubts", "len(value) == 0"),
    Call("trimesh", "found.models", "set(value) == set(reference.id)"),
    Call(
        "trimesh",
        "sum(mesh.volume for mesh in found.models.values())",
        "abs(value / reference.volume_m3.sum() - 1) < 0.01",
    ),
    Call("trimesh", "all(mesh.is_watertight for mesh in found.models.values())", "value"),
    Call("numpy", "len(found)", "value == 3"),
    Call("cjio", "found.cityjson['type']", "value == 'CityJSON'"),
    Call("geopandas", "eaves.find_buildings(tile, footprints=parcels).footprints", "len(value) == 3"),
    Call(
        "geopandas",
        "eaves.find_buildings(tile, footprints=parcels.to_crs(4326)).footprints",
        "len(value) == 3",
    ),
    Call(
        "geopandas",
        "eaves.find_buildings(tile, footprints=parcels.set_crs(None, allow_override=True)).footprints",
        "len(value) == 3",
    ),
    Call(
        "geopandas", "eaves.find_buildings(tile, footprints=parcels.geometry).footprints", "len(value) == 3"
    ),
    Call("rasterio", "eaves.find_buildings(tile, bounds=parcels.total_bounds).footprints", "len(value) == 3"),
    Call(
        "geopandas",
        "eaves.find_buildings(tile, clip=parcels.iloc[:1].buffer(8)).footprints",
        "len(value) == 1",
    ),
    # whole runs
    Call("geopandas", "eaves.build(tile, new()).footprints", "same_table(value)"),
    Call(TABLE, "eaves.build(tile, new(), lod=1.2).footprints.lod.max()", "value == '1.2'"),
    Call(TABLE, "eaves.build(tile, new(), lod=2.2).footprints", "same_table(value)"),
    Call("geopandas", "eaves.build(tile, new(), lod=3)", None),
    Call(TABLE, "eaves.build(bare, new(), crs=28992).footprints", "same_table(value)"),
    Call(TABLE, "eaves.build(tile, new(), outputs='footprints').footprints", "same_table(value)"),
    Call(TABLE, "eaves.build(tile, new(), formats='glb').folder", "(value / 'buildings.glb').exists()"),
    Call(
        "geopandas", "eaves.build(tile, new(), formats=['.geojson']).folder", "list(value.glob('*.geojson'))"
    ),
    Call("geopandas", "eaves.build(tile, new(), bounds=parcels.total_bounds).footprints", "len(value) == 3"),
    Call(TABLE, "eaves.build(tile, new(), footprints=parcels).footprints", "len(value) == 3"),
    Call(
        "geopandas",
        "eaves.build(tile, new(), footprints=parcels, id_field='name').footprints.id",
        "set(value) == {'0', '1', '2'}",
    ),
    Call(TABLE, "eaves.build(cloud, new()).footprints", "same_table(value)"),
    Call("laspy", "eaves.build(las, new()).footprints", "same_table(value)"),
    Call("geopandas", "eaves.build(tile, new(), lods='2.2')", None),
    Call("geopandas", "eaves.build(tile, new(), detect={'min_height': 2.5}).footprints", "len(value) == 3"),
    # finished runs
    Call(TABLE, "eaves.open_results(run).footprints", "same_table(value)"),
    Call("geopandas", "eaves.open_results(str(run)).planes", "len(value) == len(reference_planes)"),
    Call("trimesh", "len(eaves.open_results(run).models)", "value == 3"),
    Call("geopandas", "eaves.open_results(place)", None),
    Call(
        "rasterio",
        "rasterio.open(eaves.open_results(run).folder / 'dsm.tif').crs",
        "value.to_epsg() == 28992",
    ),
    Call(TABLE, "eaves.update(kept, later, new()).footprints", "len(value) == 3"),
    Call(
        "geopandas",
        "eaves.compare(run, run).table",
        "(value.change == 'unchanged').all() and len(value) == 3",
    ),
    Call(TABLE, "eaves.to_geopandas(eaves.model_buildings(tile))", "same_table(value)"),
    Call(TABLE, "eaves.to_geopandas(eaves.model_buildings(tile)).crs", "value.to_epsg() == 28992"),
    Call(TABLE, "eaves.to_geopandas(read_cityjson(run / 'buildings.city.jsonl'))", "len(value) == 3"),
    Call(TABLE, "eaves.evaluate.footprints(found.footprints, parcels).mean_iou", "value > 0.85"),
    Call(TABLE, "eaves.evaluate.ground(ground.ground, ground.ground).total_error", "value == 0"),
    Call(
        "geopandas",
        "eaves.evaluate.footprints(found.footprints.to_crs(4326), parcels).mean_iou",
        "value > 0.85",
    ),
    Call("geopandas", "found", "'3 buildings' in repr(value)"),
]


def environment(place: Path) -> dict[str, Any]:
    """The names that the calls use: points, a map, the run of the command, and what each stage gives."""
    import geopandas
    import laspy
    import shapely

    import eaves
    from eaves.formats import read_cityjson

    drawn = draw_houses(np.random.default_rng(0))
    (place / "tiles").mkdir()
    tile = write_points(place / "tiles" / "tile.laz", in_world(drawn.xyz))
    bare = write_points(place / "bare.laz", in_world(drawn.xyz), None)
    run, kept = place / "run", place / "kept"
    for out, more in ((run, ()), (kept, ("--keep",))):
        command = [sys.executable, "-m", "eaves", "build", str(tile), "-q", "-o", str(out), *more]
        subprocess.run(command, check=True)
    west = drawn.xyz[drawn.xyz[:, 0] < 45.0]
    later = write_points(place / "later.laz", in_world(west + np.array([0.0, 0.0, 0.002])))
    las = laspy.read(tile)
    w, s = las.x.min(), las.y.min()
    plans = [
        shapely.transform(house.plan, lambda xy: in_world(np.column_stack([xy, 0 * xy[:, 0]]))[:, :2])
        for house in drawn.houses
    ]
    parcels = geopandas.GeoDataFrame({"name": list("012")}, geometry=plans, crs="EPSG:28992")
    cloud = eaves.read(tile)
    ground = eaves.classify_ground(cloud)
    scene = eaves.make_scene(ground, ground.bounds)
    regions = eaves.detect_buildings(scene)
    p = ground.xyz[regions.label == 1]
    boundary = eaves.trace_outline(p, scene.spacing, origin=ground.origin)
    footprint = eaves.regularise_outlines([boundary])[0]
    planes = eaves.segment_roof(p, scene.spacing)
    reference = geopandas.read_file(run / "footprints.gpkg", layer="footprints")
    numbers = iter(range(1000))
    own = max(range(len(plans)), key=lambda k: plans[k].intersection(world_of(footprint, cloud)).area)

    def same_table(table: Any) -> bool:
        """True if a table has the buildings of the command, with their heights and volumes."""
        columns = ["id", "area_m2", "volume_m3", "h_max", "trust"]
        ours, theirs = (one.sort_values("id")[columns].reset_index(drop=True) for one in (table, reference))
        exact = shapely.equals_exact(
            table.sort_values("id").geometry.values, reference.sort_values("id").geometry.values, 1e-3
        )
        return bool(ours.equals(theirs) and exact.all())

    def same_points(value: Any) -> bool:
        """True if a cloud has the coordinates of `eaves.read`, to the last bit, about the same origin."""
        one, other = value.in_canonical_order(), cloud.in_canonical_order()
        return bool(one.origin == other.origin and np.array_equal(one.xyz, other.xyz))

    def same_classes(value: Any) -> bool:
        """True if a cloud has the classes that `eaves.read` and `classify_ground` give."""
        one, other = value.in_canonical_order(), ground.in_canonical_order()
        return bool(np.array_equal(one.classification, other.classification))

    with_nan = np.vstack([las.xyz, np.full((1, 3), np.nan)])
    names = dict(locals()) | {
        "gpd": geopandas,
        "np": np,
        "rasterio": import_module("rasterio"),
        "folder": place / "tiles",
        "model": eaves.reconstruct_building(p, footprint, planes, 10.0),
        "reference_planes": geopandas.read_file(run / "footprints.gpkg", layer="roof_planes"),
        "new": lambda: place / f"new-{next(numbers)}",
        "plan": plans[own],
        "world_plan": plans[own],
        "volume": drawn.houses[own].volume,
        "read_cityjson": read_cityjson,
    }
    try:
        names["found"] = eaves.find_buildings(tile)
    except Exception:
        names["found"] = eaves.build(tile, place / "found")
    return names


def world_of(footprint: Any, cloud: Any) -> Any:
    """The polygon of a footprint that counts from the origin of a cloud, in the world."""
    from shapely import affinity

    return affinity.translate(footprint.polygon, *cloud.origin)


class Said(logging.Handler):
    """What is logged while a call runs."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep a line."""
        self.lines.append(record.getMessage())


def evaluated(line: str, names: dict[str, Any]) -> Any:
    """The value of a line of Python, which may assign names."""
    tree = ast.parse(line)
    scope = dict(names)
    if isinstance(tree.body[-1], ast.Expr):
        return eval(line, scope), scope
    exec(line, scope)
    return None, scope


def verdict_of(call: Call, names: dict[str, Any]) -> tuple[str, str]:
    """The verdict on a call, and what is wrong."""
    said = Said()
    logging.getLogger().addHandler(said)
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            value, scope = evaluated(call.line, names)
        scope["said"] = [*said.lines, *(str(one.message) for one in caught)]
    except Exception as error:
        line = str(error)
        clear = (
            isinstance(error, ValueError | TypeError | OSError | ImportError)
            and "--" not in line
            and "\n" not in line
            and 20 < len(line) < LONGEST_SENTENCE
            and is_ours(error)
        )
        told = f"{type(error).__name__}: {line}"[:160]
        if clear:
            return (VERDICTS[1] if call.right is None else VERDICTS[2]), told
        return VERDICTS[3], told
    finally:
        logging.getLogger().removeHandler(said)
    if call.right is None:
        return VERDICTS[3], "accepted without a word"
    try:
        right = eval(call.right, {**scope, "value": value})
    except Exception as error:
        return VERDICTS[3], f"{type(error).__name__}: {error}"[:160]
    return (VERDICTS[0], "") if right else (VERDICTS[3], f"another value: {value!r}"[:160])


def is_ours(error: BaseException) -> bool:
    """True if an error was raised by a line of eaves, and not of a library under it."""
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    return trace is not None and f"{os.sep}eaves{os.sep}" in trace.tb_frame.f_code.co_filename


def main() -> None:
    """Run the calls and keep the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--name", default="", help="only the lines that contain this; no table is kept")
    asked = parser.parse_args()
    rows: list[dict[str, object]] = []
    with tempfile.TemporaryDirectory() as place:
        names = environment(Path(place))
        for call in CALLS:
            if asked.name not in call.line:
                continue
            verdict, wrong = verdict_of(call, names)
            print(f"{verdict:24}{call.line:90}{wrong}", flush=True)
            rows.append(
                {"of": call.of, "call": f"`{call.line}`", "verdict": verdict, "what": wrong.replace("|", "/")}
            )
    counts = Counter(str(row["verdict"]) for row in rows)
    note = ", ".join(f"{verdict}: {counts[verdict]}" for verdict in VERDICTS) + f"; of {len(rows)}"
    print(note)
    if not asked.name:
        keep("calls", "Calls of strangers", rows, "python -m benchmarks.scale.calls", note)


if __name__ == "__main__":
    main()
