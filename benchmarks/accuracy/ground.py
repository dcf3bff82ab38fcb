"""How good the ground filters are: real samples and simulated towns.

`python -m benchmarks.accuracy.ground [--command] [--left-out] [--rules] [--towns]`, EAVES_DATA set.
Maps of the errors are drawn by `benchmarks.gallery.ground`.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Literal
from unittest.mock import patch

import laspy
import numpy as np
from scipy import ndimage

from benchmarks.accuracy.late_echoes import SEEDS, Scan, read_scan
from benchmarks.accuracy.smrf import ground_by_smrf
from benchmarks.table import keep
from eaves import build, make_recipe
from eaves.evaluate.matching import evaluate_ground
from eaves.geometry.neighbours import measure_spacing
from eaves.ground import GroundMethod, classify_ground
from eaves.ground.adaptive_tin import AdaptiveTin
from eaves.ground.toolkit.floor import doubts_within
from eaves.model import GROUND, NOISE_CLASSES, Mask, PointCloud, Points
from eaves.published.ren_fcs.ground import ContourGround
from eaves.published.xiao2014.smooth_region import SmoothRegion
from eaves.raster.grid import cell_centres, whole_cells
from eaves.raster.surfaces import make_dtm
from eaves.simulate.scanner import scan_town
from eaves.simulate.town import simulate_town

COMMAND = "python -m benchmarks.accuracy.ground"
ISPRS = ("11", "12", "21", "31", "41", "51", "52", "53")
CROPS = ("Amsterdam", "Biesbosch")
METHODS: dict[str, GroundMethod] = {
    "adaptive_tin": AdaptiveTin(),
    "adaptive_tin, plain": AdaptiveTin(
        seed_cell=40.0, distance_share=2.8, angle=14.0, angle_share=0.0, rounds=1000
    ),
    "smooth_region": SmoothRegion(),
    "smooth_region, as published": SmoothRegion.as_published(),
    "contours": ContourGround(),
}
OTHERS: dict[str, list[float | None]] = {
    "SMRF, one set": [9.13, 3.09, 1.85, 2.47, 10.47, 3.35, 4.11, 7.28, 5.22, 4.89, 1.95],
    "CSF, best one set": [32.02, 4.30, 5.59, 7.36, 16.72, 16.95, 41.74, 34.05, 19.84, 10.47, 22.56],
    "Axelsson, by sample": [10.76, 3.25, 4.25, 4.78, 13.91, 2.72, 3.07, 8.91, 6.46, None, None],
    "SMRF, by sample": [8.28, 2.92, 1.10, 0.91, 5.91, 1.43, 3.82, 2.43, 3.35, None, None],
}
"""Total errors in per cent of others: each ISPRS sample, their mean, the two crops."""
PLACES, PLACES_SEED = 6, 5
"""Random places at which the command is judged."""
SMRF = "SMRF, five numbers"
LEFT_OUT = {
    "window": (20.0, 24.0, 27.0),
    "object_slope": (0.06, 0.1, 0.14),
    "distance_share": (0.65, 0.85),
    "level_weight": (2.0, 4.0),
}
LEFT_OUT_PLACES = 3
"""Numbers that are chosen anew without each sample, and places of which the mean is taken."""
RULES_TOWNS, RULES_SEED = 3, 407
"""Unseen towns, each scanned twice, and the scan of the drawn kinds, on which each rule is switched off."""
Filter = Callable[[PointCloud], PointCloud]
PATCH_M2 = 4.0
"""Smaller patches of wrong ground are not asked of doubts."""


@dataclass(frozen=True)
class Sample:
    """A cloud with the truth of its points; `classes` are the reference's where it has any."""

    cloud: PointCloud
    truth: Mask
    classes: np.ndarray | None = None


def read_isprs(data: Path, name: str) -> Sample:
    rows = np.loadtxt(data / "isprs_filter" / f"samp{name}.txt")
    return Sample(PointCloud.from_world(rows[:, :3]), rows[:, 3] == 0)


def read_las(path: Path) -> Sample:
    las = laspy.read(path)
    cloud = PointCloud.from_world(
        np.c_[las.x, las.y, las.z],
        return_number=np.asarray(las.return_number),
        number_of_returns=np.asarray(las.number_of_returns),
    )
    classes = np.asarray(las.classification)
    return Sample(cloud, classes == 2, classes)


def percent(part: Mask, whole: Mask) -> float:
    return float(100.0 * (part & whole).sum() / max(1, whole.sum()))


def total_error(sample: Sample, ground: Mask, ignored: tuple[int, ...] = ()) -> float:
    """Total error in per cent, without the points of the ignored classes."""
    counted = np.ones(len(ground), bool)
    if sample.classes is not None:
        counted = ~np.isin(sample.classes, ignored)
    return 100.0 * evaluate_ground(ground[counted], sample.truth[counted]).total_error


def compare_methods(data: Path) -> None:
    """Total errors of every method on the samples, beside those of others."""
    samples = {name: read_isprs(data, name) for name in ISPRS}
    crops = {name: read_las(data / "ahn3_ground" / f"{name}_manually_classified.las") for name in CROPS}
    columns = [*ISPRS, "mean", *CROPS]
    rows: list[dict[str, object]] = []
    for label, method in METHODS.items():
        errors: list[float | None] = [
            total_error(s, classify_ground(s.cloud, method).ground) for s in samples.values()
        ]
        errors.append(float(np.mean([e for e in errors if e is not None])))
        errors += [total_error(s, classify_ground(s.cloud, method).ground, (9,)) for s in crops.values()]
        rows.append({"method": label, **dict(zip(columns, errors, strict=True))})
    rows += [
        {"method": label, **dict(zip(columns, figures, strict=True))} for label, figures in OTHERS.items()
    ]
    note = "Total error in per cent; Amsterdam and Biesbosch without water (class 9)."
    keep("ground-samples", "Ground: total error on the samples", rows, COMMAND, note)


def judge_dense(data: Path) -> None:
    """Delft and the crops against their classes, with and without water and bridges."""
    paths = {name: data / "ahn3_ground" / f"{name}_manually_classified.las" for name in CROPS}
    paths["Delft"] = data / "delft" / "ahn3.laz"
    rows: list[dict[str, object]] = []
    for (name, path), (label, method) in product(paths.items(), METHODS.items()):
        sample = read_las(path)
        assert sample.classes is not None
        ground = classify_ground(sample.cloud, method).ground
        score = evaluate_ground(ground, sample.truth)
        dry = ~np.isin(sample.classes, (9, 26))
        rows.append(
            {
                "data": name,
                "method": label,
                "total error %": 100.0 * score.total_error,
                "type I %": 100.0 * score.type_1,
                "type II %": 100.0 * score.type_2,
                "F1": score.f1,
                "F1 without water, bridges": evaluate_ground(ground[dry], sample.truth[dry]).f1,
                "class 6 called ground %": percent(ground, sample.classes == 6),
                "water called ground %": percent(ground, sample.classes == 9),
                "bridge called ground %": percent(ground, sample.classes == 26),
            }
        )
    note = "Delft by others: SMRF F1 0.960 (1.0 % of class 6), CSF 0.954 (0.5 %), WhiteboxTools 0.930."
    keep("ground-dense", "Ground: dense data with classes", rows, COMMAND, note)


def root_mean_square(errors: np.ndarray) -> float | None:
    return float(np.sqrt(np.mean(errors**2))) if len(errors) else None


def judge_towns() -> None:
    """Simulated towns: total error, and the DTM under buildings where the terrain has no step."""
    rows: list[dict[str, object]] = []
    terrains: tuple[Literal["hilly", "terraced"], ...] = ("hilly", "terraced")
    for terrain, trees, density in product(terrains, (1.0, 3.0), (1.0, 5.0, 25.0)):
        town = simulate_town(0.0256, terrain=terrain, trees=trees, seed=4)
        scene = scan_town(town, density=density, seed=4)
        cloud = classify_ground(scene.cloud)
        truth = scene.truth_class == 2
        score = evaluate_ground(cloud.ground, truth)
        dtm = make_dtm(cloud, town.bounds)
        row, column = dtm.cell_of(scene.cloud.xyz)
        inside = (row >= 0) & (row < dtm.shape[0]) & (column >= 0) & (column < dtm.shape[1])
        inside &= scene.building > 0
        building = np.zeros(dtm.shape, np.int64)
        building[row[inside], column[inside]] = scene.building[inside]
        height = town.terrain.at(cell_centres(dtm)).reshape(dtm.shape)
        steps = np.hypot(*np.gradient(height, dtm.cell)) > 1.0
        stepped = np.isin(building, np.unique(building[steps]))
        error = dtm.values - height
        rows.append(
            {
                "terrain": terrain,
                "trees": trees,
                "points/m²": density,
                "points": len(truth),
                "total error %": 100.0 * score.total_error,
                "type I %": 100.0 * score.type_1,
                "type II %": 100.0 * score.type_2,
                "DTM RMSE under buildings m": root_mean_square(error[(building > 0) & ~stepped]),
                "the same, over a step m": root_mean_square(error[(building > 0) & stepped]),
            }
        )
    keep(
        "ground-towns",
        "Ground: simulated towns",
        rows,
        f"{COMMAND} --towns",
        "To reach: 1.5 %, 0.15 m under buildings with no terrain step beneath.",
    )


def doubt_figures(cloud: PointCloud, truth: Mask, counted: Mask) -> dict[str, float]:
    """Of patches of ground lost or false over 4 m² in a classified cloud, how many there are and how many
    touch a doubt; and the share of the area that doubts cover. Cells of 1 m or a spacing.
    """
    cell = max(1.0, measure_spacing(cloud.xyz))
    bounds = whole_cells(cloud.bounds, cell)
    shape = round(bounds.height / cell) + 1, round(bounds.width / cell) + 1
    row, column = ((bounds.north - cloud.xyz[:, 1]) / cell).astype(int), cloud.xyz[:, 0] - bounds.west
    home = row * shape[1] + (column / cell).astype(int)
    points, wrong = (
        np.bincount(home, some, shape[0] * shape[1]).reshape(shape)
        for some in (counted, counted & (cloud.ground != truth))
    )
    patch, count = ndimage.label(2 * wrong > points, np.ones((3, 3)))
    large = np.bincount(patch.ravel(), minlength=count + 1) * cell**2 > PATCH_M2
    large[0] = False
    said, area = np.zeros(shape, bool), 0.0
    for doubt in doubts_within(cloud, cloud.bounds.translated(*cloud.origin)):
        area += doubt.area_m2
        x, y = doubt.x - cloud.origin[0] - bounds.west, bounds.north - doubt.y + cloud.origin[1]
        first, last = (np.array([y, x]) + half * np.sqrt(doubt.area_m2) for half in (-0.5, 0.5))
        (top, left), (bottom, right) = np.maximum(first / cell, 0).astype(int), (last / cell).astype(int) + 1
        said[top:bottom, left:right] = True
    touched = np.zeros(count + 1, bool)
    touched[patch[said]] = True
    return {
        "wrong patches": float(large.sum()),
        "touched by a doubt": float((large & touched).sum()),
        "doubts cover %": 100.0 * area / (cell**2 * float((points > 0).sum())),
    }


def judge_doubts(data: Path) -> None:
    """What the doubts on the ISPRS samples are worth."""
    rows: list[dict[str, object]] = []
    for name in ISPRS:
        sample = read_isprs(data, name)
        found = classify_ground(sample.cloud)
        rows.append({"sample": name, **doubt_figures(found, sample.truth, np.ones(len(found), bool))})
    patches, touched, cover = (
        [float(str(row[key])) for row in rows]
        for key in ("wrong patches", "touched by a doubt", "doubts cover %")
    )
    note = f"{sum(touched) / sum(patches):.2f} of the patches are touched; mean cover {np.mean(cover):.2f} %."
    keep("ground-doubts", "Ground: doubts on the samples", rows, COMMAND, note)


def by_command(xyz: Points, truth: Mask) -> float:
    """Total error in per cent of points (N, 3) as `eaves ground` classifies them, square by square."""
    header = laspy.LasHeader(point_format=1, version="1.2")
    header.scales, header.offsets = np.full(3, 0.01), np.floor(xyz.min(axis=0))
    las = laspy.LasData(header)
    las.x, las.y, las.z = xyz.T
    las.user_data = truth.astype(np.uint8)
    with tempfile.TemporaryDirectory() as folder:
        given, answer = Path(folder) / "given.las", Path(folder) / "answer.laz"
        las.write(given)
        command = [sys.executable, "-m", "eaves", "ground", str(given), "-o", str(answer), "-q"]
        subprocess.run([*command, "--crs", "EPSG:32632", "--jobs", "1"], check=True)
        result = laspy.read(answer)
    wrong = (np.asarray(result.classification) == 2) != (np.asarray(result.user_data) == 1)
    return 100.0 * float(wrong.mean())


def judge_command(data: Path) -> None:
    """Total errors on the ISPRS samples by the command: where they lie, and moved to random places."""
    moves = np.random.default_rng(PLACES_SEED).uniform(0.0, 240.0, (PLACES, 2)).round(2)
    rows: list[dict[str, object]] = []
    for name in ISPRS:
        sample = np.loadtxt(data / "isprs_filter" / f"samp{name}.txt")
        xyz, truth = sample[:, :3], sample[:, 3] == 0
        moved = [by_command(xyz + [*move, 0.0], truth) for move in moves]
        rows.append(
            {
                "sample": name,
                "where it lies %": by_command(xyz, truth),
                "mean of places %": float(np.mean(moved)),
                "best place %": min(moved),
                "worst place %": max(moved),
                f"{SMRF} %": 100.0 * float(np.mean(ground_by_smrf(xyz) != truth)),
            }
        )
    here, places, worst = (
        [float(str(row[name])) for row in rows]
        for name in ("where it lies %", "mean of places %", "worst place %")
    )
    note = (
        f"Mean {np.mean(here):.2f} % where the samples lie; {np.mean(places):.2f} % over {PLACES} random "
        f"places (each sample moved by up to 240 m, the same moves for all), at most {max(worst):.2f} %. "
        "Where borders of cells fall decides thin samples, so the mean over places is the figure to quote. "
        f"SMRF: {np.mean([float(str(row['SMRF, five numbers %'])) for row in rows]):.2f} %."
    )
    keep("ground-command", "Ground: by the command", rows, f"{COMMAND} --command", note)


def by_smrf(cloud: PointCloud) -> PointCloud:
    """The cloud with ground by SMRF with one set of five numbers."""
    return cloud.with_(classification=np.where(ground_by_smrf(cloud.xyz), GROUND, 1).astype(np.uint8))


def error_over_places(sample: Sample, find: Filter) -> float:
    """Mean total error of a sample at the first places of the command."""
    shifts = np.random.default_rng(PLACES_SEED).uniform(0.0, 240.0, (LEFT_OUT_PLACES, 2))
    clouds = (PointCloud.from_world(sample.cloud.world + [*shift, 0.0]) for shift in shifts)
    return float(np.mean([total_error(sample, find(cloud).ground) for cloud in clouds]))


def judge_left_out(data: Path) -> None:
    """Each sample by the set of numbers that the other seven choose, at the first places of the command."""
    samples = {name: read_isprs(data, name) for name in ISPRS}
    sets = [dict(zip(LEFT_OUT, values, strict=True)) for values in product(*LEFT_OUT.values())]
    errors = np.empty((len(sets), len(samples)))
    for row, numbers in enumerate(sets):
        find = partial(classify_ground, method=AdaptiveTin(**numbers))
        for column, sample in enumerate(samples.values()):
            errors[row, column] = error_over_places(sample, find)
    rows: list[dict[str, object]] = []
    for column, name in enumerate(samples):
        chosen = int(np.argmin(np.delete(errors, column, axis=1).mean(axis=1)))
        words = ", ".join(f"{key} {value:g}" for key, value in sets[chosen].items())
        rows.append(
            {
                "sample": name,
                "left out %": errors[chosen, column],
                "best for it %": errors[:, column].min(),
                f"{SMRF} %": total_error(samples[name], ground_by_smrf(samples[name].cloud.xyz)),
                "set chosen by the others": words,
            }
        )
    mean, best = np.mean([float(str(row["left out %"])) for row in rows]), errors.mean(axis=1).min()
    note = (
        f"{len(sets)} sets, means of {LEFT_OUT_PLACES} places. Mean when each sample's set is chosen by the "
        f"other seven: {mean:.2f} %; the best one set for all: {best:.2f} %."
    )
    keep("ground-left-out", "Ground: leave-one-out choice", rows, f"{COMMAND} --left-out", note)


def late_error(scan: Scan, method: AdaptiveTin | None) -> float:
    """Total error in per cent of a scan's own points as a build classifies them, late echoes among them."""
    late = scan.with_echoes(SEEDS[0])
    if method is None:
        ground = by_smrf(late.cloud()).ground
    else:
        with tempfile.TemporaryDirectory() as folder:
            recipe = make_recipe({"ground": method}, lod="0")
            build(late.xyz, folder, recipe, outputs=("classified",), jobs=1, crs="EPSG:28992")
            ground = np.asarray(laspy.read(Path(folder) / "classified.laz").classification) == GROUND
    own = ~np.isin(scan.classes, (*NOISE_CLASSES, 9, 26))
    return 100.0 * float((ground[: len(own)] != (scan.classes == GROUND))[own].mean())


def judge_rules(data: Path) -> None:
    """Errors of everything with each rule of the ground switched off."""
    from benchmarks.accuracy.ablation import target_of
    from benchmarks.accuracy.ablation_rules import GROUND as RULES
    from benchmarks.accuracy.ground_kinds import DENSITIES, KINDS, scan
    from benchmarks.accuracy.ground_towns import UNSEEN, draw_all, judge

    samples = {name: read_isprs(data, name) for name in ISPRS}
    crops = {name: read_las(data / "ahn3_ground" / f"{name}_manually_classified.las") for name in CROPS}
    delft, towns = read_las(data / "delft" / "ahn3.laz"), list(draw_all(UNSEEN[:RULES_TOWNS]))
    kinds = [scan(kind, density, RULES_SEED) for kind, density in product(KINDS, DENSITIES)]
    echoes = read_scan(data / "delft" / "ahn3.laz", "delft")
    rows: list[dict[str, object]] = []
    for label, off in [("none", {}), (SMRF, {}), *((rule.name, rule.off) for rule in RULES)]:
        moved = {name.split(".")[1]: value for name, value in off.items() if ":" not in name}
        with ExitStack() as patches:
            for name, value in off.items():
                if ":" in name:
                    patches.enter_context(patch.object(*target_of(name), value))
            find = by_smrf if label == SMRF else partial(classify_ground, method=AdaptiveTin(**moved))
            errors = [error_over_places(sample, find) for sample in samples.values()]
            drawn = [judge(town, find(town.cloud)) for town in towns]
            pairs = [(find(cloud).ground, truth) for cloud, truth in kinds]
            rows.append(
                {
                    "off": label,
                    "ISPRS %": float(np.mean(errors)),
                    "worst %": float(np.max(errors)),
                    **{
                        f"{name} %": total_error(one, find(one.cloud).ground, (9, 26))
                        for name, one in {**crops, "Delft": delft}.items()
                    },
                    "Delft, late echoes %": late_error(
                        echoes, None if label == SMRF else AdaptiveTin(**moved)
                    ),
                    **{
                        f"towns: {key}": float(np.mean([float(str(row[key])) for row in drawn]))
                        for key in ("total error %", "levels kept", "halls found")
                    },
                    "kinds: ground lost %": 100.0 * float(np.mean([(t & ~g).mean() for g, t in pairs])),
                    "objects taken %": 100.0 * float(np.mean([(~t & g).mean() for g, t in pairs])),
                }
            )
    note = (
        f"Total errors with one rule switched off; ISPRS: mean of {LEFT_OUT_PLACES} places; without water "
        "and bridges; late echoes: as a whole run classifies them, bridges looked for; drawn old towns of "
        "seeds that had no say, and the squares of `ground_kinds`."
    )
    keep("ground-rules", "Ground: each rule switched off", rows, f"{COMMAND} --rules", note)


def judge_moved(data: Path) -> None:
    """Mean total errors of the ISPRS samples with each number of `adaptive_tin` moved by a quarter."""
    samples = [read_isprs(data, name) for name in ISPRS]

    def mean_error(**moved: object) -> float:
        method = AdaptiveTin(**moved)
        return float(np.mean([total_error(s, classify_ground(s.cloud, method).ground) for s in samples]))

    rows: list[dict[str, object]] = []
    for name, value in AdaptiveTin().model_dump().items():
        if not isinstance(value, int | float) or isinstance(value, bool):
            continue
        sides = [type(value)(round(value * share, 6)) for share in (0.75, 1.25)]
        if isinstance(value, int):
            sides = [min(sides[0], value - 1), max(sides[1], value + 1)]
        errors = [mean_error(**{name: side}) for side in sides]
        rows.append({"number": name, "value": value, "- 25 %": errors[0], "+ 25 %": errors[1]})
    worst = max(max(float(str(row["- 25 %"])), float(str(row["+ 25 %"]))) for row in rows)
    note = (
        f"Mean total error of the eight samples as clouds, per cent; {mean_error():.2f} as it is, "
        f"at most {worst:.2f}."
    )
    keep("ground-moved", "Ground: each number moved by a quarter", rows, f"{COMMAND} --moved", note)


def main() -> None:
    """Print and keep the tables that are asked for; those of the real samples by default."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--command", action="store_true", help="the samples by `eaves ground`")
    parser.add_argument("--left-out", action="store_true", help="each sample by what the others choose")
    parser.add_argument("--rules", action="store_true", help="each rule switched off")
    parser.add_argument("--moved", action="store_true", help="each number moved by a quarter")
    parser.add_argument("--towns", action="store_true", help="simulated towns")
    wanted = parser.parse_args()
    if wanted.towns:
        judge_towns()
    folder = os.environ.get("EAVES_DATA")
    if not folder:
        print("EAVES_DATA names no folder with the benchmark data: only simulated towns can be judged")
        return
    data = Path(folder)
    if wanted.command:
        judge_command(data)
    if wanted.left_out:
        judge_left_out(data)
    if wanted.rules:
        judge_rules(data)
    if wanted.moved:
        judge_moved(data)
    if not any(vars(wanted).values()):
        compare_methods(data)
        judge_dense(data)
        judge_doubts(data)


if __name__ == "__main__":
    main()
