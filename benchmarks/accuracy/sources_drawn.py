"""The five published systems on five drawn towns of which everything is known: mean and spread.

Run `python -m benchmarks.accuracy.sources_drawn [--chains NAME...]`.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pyogrio
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmarks.accuracy.detection import read as read_classes
from benchmarks.accuracy.sources import against_classes, against_objects
from benchmarks.table import keep
from eaves.detect import detect_buildings
from eaves.ground import classify_ground
from eaves.model.cloud import BUILDING, GROUND, HIGH_VEGETATION, MEDIUM_VEGETATION, NOISE_CLASSES
from eaves.model.scene import NOISE, ROOF, TREE, WALL
from eaves.pipeline import build
from eaves.raster.surfaces import make_scene
from eaves.recipe.recipe import make_recipe, sources

COMMAND = "python -m benchmarks.accuracy.sources_drawn"
SEEDS = (9401, 9402, 9403, 9404, 9405)
TOWN = ("--area", "0.02", "--density", "6", "--terrain", "hilly", "--trees", "1")
"""Wooded towns on hills, a tenth of a square kilometre in all; no seed chose a parameter."""
TOUCHING = 1.0
"""A building whose plan is this near (m) to points of trees touches vegetation."""
NAME = "town"
Row = dict[str, Any]


def draw_town(folder: Path, seed: int) -> Path:
    """The folder of a drawn town and its scan."""
    words = [sys.executable, "-m", "eaves", "simulate", "-o", str(folder), "--quiet", *TOWN]
    subprocess.run([*words, "--seed", str(seed)], check=True)
    return folder


def beside_trees(town: Path) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Number of the building of every point (N,), 0 for none, and which buildings (B + 1,) touch trees."""
    points = laspy.read(town / "points.laz")
    owner = np.asarray(points.building_id).astype(np.int64)
    classes = np.asarray(points.classification)
    trees = np.isin(classes, (MEDIUM_VEGETATION, HIGH_VEGETATION))
    tree = cKDTree(np.asarray(points.xyz)[trees][:, :2])
    frame = pyogrio.read_dataframe(town / "reference.gpkg", layer="footprints")
    touching = np.zeros(owner.max() + 1, bool)
    for number, plan in zip(frame.number, frame.geometry, strict=True):
        if number < len(touching):
            rim = shapely.get_coordinates(shapely.segmentize(shapely.force_2d(plan).exterior, 0.5))[:, :2]
            touching[number] = bool(np.isfinite(tree.query(rim, distance_upper_bound=TOUCHING)[0]).any())
    return owner, touching


def against_vegetation(town: Path, out: Path) -> Row:
    """Share of the building points found, and of the buildings half found, where trees touch and elsewhere;
    and the error of the ground in per cent of all points."""
    points = laspy.read(town / "points.laz")
    written = [laspy.read(path) for path in sorted(out.glob("classified*.laz"))]
    place = np.concatenate([np.asarray(file.xyz) for file in written])
    classes = np.concatenate([np.asarray(file.classification) for file in written])
    got = classes[cKDTree(place).query(np.asarray(points.xyz))[1]]
    owner, touching = beside_trees(town)
    found = np.bincount(owner, got == BUILDING) / np.maximum(np.bincount(owner), 1)
    row: Row = {"DTM error %": 100.0 * float(((got == GROUND) != (points.classification == GROUND)).mean())}
    for name, some in (("touching trees", touching), ("free", ~touching)):
        some = some & (np.bincount(owner) > 0)
        some[0] = False
        inside = some[owner]
        row[f"points found, {name}"] = float((got[inside] == BUILDING).mean()) if some.any() else np.nan
        row[f"buildings found, {name}"] = float((found[some] >= 0.5).mean()) if some.any() else np.nan
    return row


def of_parts(town: Path, published: bool) -> Row:
    """Recall and precision of the walls, trees, outliers and roofs of xiao2014 against what was drawn."""
    cloud, classes = read_classes([town / "points.laz"])
    points = laspy.read(town / "points.laz")
    order = cKDTree(np.asarray(points.xyz)).query(cloud.xyz + [*cloud.origin, 0.0])[1]
    plane, owner = np.asarray(points.plane_id)[order], np.asarray(points.building_id)[order]
    recipe = make_recipe(source="xiao2014", published=published)
    ground = classify_ground(cloud, recipe.ground)
    scene = make_scene(ground, ground.bounds)
    assert recipe.detect is not None
    regions = detect_buildings(scene, recipe.detect)
    assert ground.part is not None and regions.part is not None
    marked = {
        "walls": (ground.part == WALL, (owner > 0) & (plane == 0)),
        "trees": (ground.part == TREE, np.isin(classes, (MEDIUM_VEGETATION, HIGH_VEGETATION))),
        "outliers": (ground.noise | (ground.part == NOISE), np.isin(classes, NOISE_CLASSES)),
        "roofs": (regions.part == ROOF, (owner > 0) & (plane > 0)),
    }
    row: Row = {}
    for name, (got, want) in marked.items():
        both = float((got & want).sum())
        row[f"{name}: recall"], row[f"{name}: precision"] = both / want.sum(), both / max(got.sum(), 1)
    return row


def spread(rows: list[Row]) -> Row:
    """Mean and standard deviation of every figure over the seeds that have it."""
    table = {name: np.array([row[name] for row in rows], np.float64) for name in rows[0]}
    return {name: f"{np.nanmean(one):.3f} ± {np.nanstd(one, ddof=1):.3f}" for name, one in table.items()}


def chain_rows(towns: list[Path], folder: Path, chains: list[str]) -> list[Row]:
    """One row a chain and mode."""
    rows = []
    for chain in chains:
        for published in (False, True):
            each: list[Row] = []
            for town in towns:
                out = folder / f"{town.name}-{chain}-{published}"
                before = time.process_time()
                build(town / "points.laz", out, source=chain, as_published=published, jobs=1)
                seconds = time.process_time() - before
                areas, objects = against_classes(town, NAME, out), against_objects(town, NAME, out)
                compl, corr = map(float, str(objects.pop("objects over 10 m²")).split("/"))
                row = {name: areas[name] for name in ("compl.", "corr.", "IoU")}
                row |= {"objects compl.": compl, "objects corr.": corr}
                each.append(row | against_vegetation(town, out) | {"CPU s": seconds})
            rows.append({"chain": chain + (", as published" if published else "")} | spread(each))
            print(json.dumps(rows[-1], ensure_ascii=False), flush=True)
    return rows


def main() -> None:
    """Print and keep the two tables."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--chains", nargs="+", choices=sources(), default=list(sources()), metavar="NAME")
    chosen = options.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        towns = [draw_town(folder / f"seed{seed}", seed) for seed in SEEDS]
        keep(
            "sources-drawn",
            "Five drawn towns",
            chain_rows(towns, folder, chosen.chains),
            COMMAND,
            f"Mean and standard deviation over the seeds {', '.join(map(str, SEEDS))} of `eaves simulate "
            f"{' '.join(TOWN)} --seed SEED`, then `eaves build points.laz -o OUT --source NAME "
            "[--as-published] --jobs 1`; "
            "CPU seconds without the start of Python. Areas and "
            "objects (over 10 m²) as in *-sources.md; DTM error: points taken for ground or not, wrongly. "
            f"Touching trees: buildings with points of trees within {TOUCHING:g} m of their plan; found: "
            "half of a building's points.",
        )
        parts = []
        for published in (False, True):
            chain = "xiao2014" + (", as published" if published else "")
            parts.append({"chain": chain} | spread([of_parts(town, published) for town in towns]))
        keep(
            "sources-parts",
            "Parts of xiao2014",
            parts,
            COMMAND,
            "In memory, on the towns of sources-drawn. Walls are those of buildings (fences and trunks count "
            "against precision); outliers are points of classes 7 and 18, those marked as noise or in small "
            "smooth regions.",
        )


if __name__ == "__main__":
    main()
