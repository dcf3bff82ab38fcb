"""Windows with round sides, cut from surveys, built by the command's own function: none may fail.

usage: python -m benchmarks.scale.windows DATA [--number 1000] [--first 0] [--log FILE.jsonl]

The sides of a window are multiples of 1 to 240 m where the survey reaches one, its coordinates are rounded to
1 mm to 1 m, and the three outermost points of every side are put onto it: agencies deliver such tiles. What
lies in it is left alone or made hard (`KINDS`). A window of more than `MOST_POINTS` is thinned to that many.

A window fails when the run raises, says of a part that it failed, or is incomplete. An outline is asked for
when the build of the whole survey has it, it has `LEAST_M2` or more, and it lies `MARGIN` inside the window:
it is missed when no outline of the window touches it, and cut when they cover less than half of it. That is
asked of windows that have all points of the survey, or each of them twice, rounded to a centimetre or finer;
other kinds are other scenes. Twice the points look like a denser scan: of a sparse one less is drawn then.

A window is made of its number alone: `--first N --number 1` makes it again, and keeps no table. A log goes on
where it ended.
"""

from __future__ import annotations

import argparse
import json
import logging
import os
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pyogrio
import shapely
from numpy.typing import NDArray

import eaves
from benchmarks.table import as_markdown, keep
from eaves.model import Bounds, Mask, Points

SURVEYS = {
    "delft": "delft/ahn3.laz",
    "delft_small": "misc/delft_small.laz",
    "amsterdam": "ahn3_ground/Amsterdam*.las",
    "biesbosch": "ahn3_ground/Biesbosch*.las",
    "ign_urban": "ign_urban/*.laz",
    "ign_buildings": "ign_buildings/*postValidation.laz",
    "ign_sparse": "ign_sparse/*.laz",
    "stbarth": "stbarth/stbarth.laz",
    "california": "california/california.laz",
    "vaihingen": "vaihingen/clip3.laz",
    "williams": "williams/williams.laz",
    "conifers": "misc/lidR_MixedConifer.laz",
    "topography": "misc/lidR_Topography.laz",
}
MULTIPLES = (1, 10, 20, 40, 80, 240)
STEPS = (0.001, 0.01, 0.1, 0.5, 1.0)
SIDES = 15.0, 80.0
"""Shortest and longest side (m) that is drawn, before it is moved outwards to a multiple."""
MOST_POINTS = 100_000
ON_A_SIDE = 3
LEAST_M2, MARGIN, FINEST = 50.0, 5.0, 0.01
NAMES = ("return_number", "number_of_returns", "classification")


@dataclass(frozen=True)
class Cloud:
    """Points (N, 3), m, and their fields (N, 3): return, returns, class."""

    xyz: Points
    fields: NDArray[np.uint8]

    def take(self, some: Mask | NDArray[np.int64]) -> Cloud:
        """Some of the points."""
        return Cloud(self.xyz[some], self.fields[some])

    def lifted(self, rise: Points | NDArray[np.float64]) -> Cloud:
        """Each point raised by its `rise` (N,), m."""
        return replace(self, xyz=self.xyz + np.c_[np.zeros((len(rise), 2)), rise])


Kind = Callable[[Cloud, np.random.Generator], Cloud]


def thinned(cloud: Cloud, rng: np.random.Generator) -> Cloud:
    """A half to a fiftieth of the points."""
    return cloud.take(rng.random(len(cloud.xyz)) < rng.uniform(0.02, 0.5))


def flat(cloud: Cloud, rng: np.random.Generator) -> Cloud:
    """All points at one height."""
    return cloud.lifted(rng.integers(-5, 500) - cloud.xyz[:, 2])


def on_a_ramp(cloud: Cloud, rng: np.random.Generator) -> Cloud:
    """The scene on a slope of up to 0.7 along either axis."""
    away = cloud.xyz[:, :2] - cloud.xyz[:, :2].min(axis=0)
    return cloud.lifted(away @ rng.uniform(-0.7, 0.7, 2))


def doubled(cloud: Cloud, rng: np.random.Generator) -> Cloud:
    """Each point twice."""
    return cloud.take(np.repeat(np.arange(len(cloud.xyz)), 2))


def few(cloud: Cloud, rng: np.random.Generator) -> Cloud:
    """One to twelve of the points."""
    return cloud.take(rng.permutation(len(cloud.xyz))[: rng.integers(1, 13)])


def with_holes(cloud: Cloud, rng: np.random.Generator) -> Cloud:
    """Without the points of six discs, each up to half as wide as the window."""
    xy = cloud.xyz[:, :2]
    middles, widest = xy[rng.integers(0, len(xy), 6)], float(np.ptp(xy, axis=0).max()) / 4.0
    radii = rng.uniform(0.0, widest, len(middles))
    return cloud.take((np.linalg.norm(xy[:, None] - middles, axis=2) > radii).all(axis=1))


def noisy(cloud: Cloud, rng: np.random.Generator) -> Cloud:
    """Heights scatter by 0.3 m, one in a hundred by 50 m."""
    stray = rng.random(len(cloud.xyz)) < 0.01
    return cloud.lifted(rng.normal(0.0, np.where(stray, 50.0, 0.3)))


def half_lifted(cloud: Cloud, rng: np.random.Generator) -> Cloud:
    """The points east or north of the middle lifted by 3, 30 or 300 m."""
    axis = rng.integers(0, 2)
    beyond = cloud.xyz[:, axis] > np.median(cloud.xyz[:, axis])
    return cloud.lifted(beyond * rng.choice([3.0, 30.0, 300.0]))


def last_echoes(cloud: Cloud, rng: np.random.Generator) -> Cloud:
    """The last echo of each pulse."""
    return cloud.take(cloud.fields[:, 0] == cloud.fields[:, 1])


def upside_down(cloud: Cloud, rng: np.random.Generator) -> Cloud:
    """What is high is low."""
    z = cloud.xyz[:, 2]
    return cloud.lifted(z.min() + z.max() - 2.0 * z)


def one_column(cloud: Cloud, rng: np.random.Generator) -> Cloud:
    """The points of half a metre, or all on one line."""
    x = cloud.xyz[:, 0]
    some = cloud.take(np.abs(x - rng.choice(x)) <= 0.25)
    wide = rng.random() < 0.5
    return some if wide else replace(some, xyz=np.c_[np.full(len(some.xyz), x[0]), some.xyz[:, 1:]])


KINDS: dict[str, Kind] = {
    "plain": lambda cloud, rng: cloud,
    "thinned": thinned,
    "flat": flat,
    "on a ramp": on_a_ramp,
    "doubled": doubled,
    "one to twelve points": few,
    "with holes": with_holes,
    "noisy": noisy,
    "half of it lifted": half_lifted,
    "last echoes": last_echoes,
    "upside down": upside_down,
    "one column": one_column,
}
SAME_SCENE = ("plain", "doubled")
KIND_OF_WINDOW = [*KINDS, *(4 * SAME_SCENE)]
"""Those that leave the scene as it is come more often: of them outlines are asked."""


@dataclass(frozen=True)
class Survey:
    """A survey, and what its whole gives."""

    name: str
    files: list[Path]
    folder: Path

    @cached_property
    def cloud(self) -> Cloud:
        """All points, file by file."""
        read = [laspy.read(path) for path in self.files]
        xyz = np.concatenate([np.asarray(one.xyz) for one in read])
        fields = [np.column_stack([np.asarray(one[name], np.uint8) for name in NAMES]) for one in read]
        return Cloud(xyz, np.concatenate(fields))

    @cached_property
    def outlines(self) -> list[shapely.Polygon]:
        """The outlines of the whole that are large enough to be asked for."""
        points, out = self.folder / f"{self.name}.laz", self.folder / self.name
        write_points(self.cloud, points, 0.001)
        found, failed = outlines_of(points, out)
        if failed:
            raise SystemExit(f"{self.name}: the whole survey failed, so nothing can be asked: {failed[0]}")
        return [one for one in found if one.area >= LEAST_M2]


@dataclass(frozen=True)
class Window:
    """A window, made of its number alone."""

    number: int
    survey: str
    kind: str
    multiple: int
    step: float
    bounds: Bounds
    cloud: Cloud
    whole: bool
    """Whether every point of the survey in it is there."""

    @property
    def tells(self) -> bool:
        """Whether its outlines should be those of the survey."""
        return self.whole and self.kind in SAME_SCENE and self.step <= FINEST


def drawn_bounds(xyz: Points, multiple: int, rng: np.random.Generator) -> Bounds:
    """A rectangle around a point of the survey: sides of whole metres, moved outwards to the next multiple
    where the survey reaches as far."""
    low, high = np.ceil(xyz[:, :2].min(axis=0)), np.floor(xyz[:, :2].max(axis=0))
    middle, half = xyz[rng.integers(len(xyz)), :2], rng.uniform(*SIDES, 2) / 2.0
    first = np.maximum(np.floor(middle - half), low)
    last = np.minimum(np.ceil(middle + half), high)
    outer, far = np.floor(first / multiple) * multiple, np.ceil(last / multiple) * multiple
    west, south = np.where(outer >= low, outer, first)
    east, north = np.where(far <= high, far, last)
    return Bounds(float(west), float(south), float(east), float(north))


def on_the_sides(cloud: Cloud, bounds: Bounds) -> Cloud:
    """The outermost points of each side put onto it."""
    xyz = cloud.xyz.copy()
    sides = ((0, bounds.west, 1), (1, bounds.south, 1), (0, bounds.east, -1), (1, bounds.north, -1))
    for axis, side, sign in sides:
        xyz[np.argsort(sign * xyz[:, axis], kind="stable")[:ON_A_SIDE], axis] = side
    return replace(cloud, xyz=xyz)


def make_window(number: int, surveys: dict[str, Survey]) -> Window:
    """The window of a number; another place is drawn where a kind leaves no point."""
    rng = np.random.default_rng(number)
    name, kind = str(rng.choice(list(surveys))), str(rng.choice(KIND_OF_WINDOW))
    multiple, step = int(rng.choice(MULTIPLES)), float(rng.choice(STEPS))
    every = surveys[name].cloud
    while True:
        bounds = drawn_bounds(every.xyz, multiple, rng)
        x, y = every.xyz[:, 0], every.xyz[:, 1]
        inside = np.flatnonzero(
            (x >= bounds.west) & (x <= bounds.east) & (y >= bounds.south) & (y <= bounds.north)
        )
        some = rng.permutation(inside)[:MOST_POINTS]
        cloud = every.take(np.sort(some))
        if len(some):
            cloud = KINDS[kind](on_the_sides(cloud, bounds), rng)
        if len(cloud.xyz):
            return Window(number, name, kind, multiple, step, bounds, cloud, len(some) == len(inside))


def write_points(cloud: Cloud, path: Path, step: float) -> None:
    """A file of the points with coordinates rounded to a step (m)."""
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = np.full(3, step)
    header.offsets = np.r_[np.floor(cloud.xyz[0, :2] / 1000.0) * 1000.0, 0.0]
    las = laspy.LasData(header)
    las.X, las.Y, las.Z = np.rint((cloud.xyz - header.offsets) / step).astype(np.int32).T
    for name, values in zip(NAMES, cloud.fields.T, strict=True):
        las[name] = values
    las.write(path)


def outlines_of(points: Path, out: Path) -> tuple[list[shapely.Polygon], tuple[str, ...]]:
    """What a run outlines, and what failed in it."""
    try:
        summary = eaves.build(points, out, crs="metres", outputs=("footprints",), jobs=1)
    except Exception as error:  # every one is a finding
        return [], (f"{type(error).__name__}: {error}",)
    failed = summary.failed or (() if summary.complete else ("incomplete",))
    found = pyogrio.raw.read(out / "footprints.gpkg", layer="footprints", columns=[])[2]
    return list(shapely.from_wkb(found)), failed


def judge(window: Window, survey: Survey, folder: Path) -> dict[str, Any]:
    """What became of a window."""
    points, out = folder / "window.laz", folder / f"window-{window.number}"
    write_points(window.cloud, points, window.step)
    found, failed = outlines_of(points, out)
    inner = window.bounds.buffered(-MARGIN)
    box = shapely.box(inner.west, inner.south, inner.east, inner.north)
    asked = [one for one in survey.outlines if box.contains(one)] if window.tells else []
    drawn = shapely.union_all(found)
    there = [round(drawn.intersection(one).area / one.area, 2) for one in asked]
    return {
        "number": window.number,
        "survey": window.survey,
        "kind": window.kind,
        "multiple": window.multiple,
        "step": window.step,
        "points": len(window.cloud.xyz),
        "bounds": [window.bounds.west, window.bounds.south, window.bounds.east, window.bounds.north],
        "found": len(found),
        "failed": list(failed),
        "there": there,
        "missed": [[round(value, 1) for value in one.bounds] for one in asked if not drawn.intersects(one)],
    }


def rows_by_kind(results: list[dict[str, Any]]) -> list[dict[str, object]]:
    """The table: a row for each kind, and one for all."""
    rows = []
    for kind in (*KINDS, "all"):
        of_kind = [one for one in results if kind in (one["kind"], "all")]
        rows.append(
            {
                "kind": kind,
                "windows": len(of_kind),
                "points": sum(one["points"] for one in of_kind),
                "outlines": sum(one["found"] for one in of_kind),
                "failed": sum(bool(one["failed"]) for one in of_kind),
                "outlines asked": sum(len(one["there"]) for one in of_kind),
                "cut": sum(share < 0.5 for one in of_kind for share in one["there"]),
                "missed": sum(len(one["missed"]) for one in of_kind),
            }
        )
    return rows


def main() -> None:
    """Build the windows and keep the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("data", type=Path, nargs="?", default=Path(os.environ.get("EAVES_DATA", "data")))
    parser.add_argument("--number", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--log", type=Path)
    given = parser.parse_args()
    logging.disable()
    warnings.simplefilter("ignore")
    done = {}
    if given.log and given.log.exists():
        done = {one["number"]: one for one in map(json.loads, given.log.read_text().splitlines())}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        surveys = {key: Survey(key, sorted(given.data.glob(place)), folder) for key, place in SURVEYS.items()}
        surveys = {key: survey for key, survey in surveys.items() if survey.files}
        for number in range(given.first, given.first + given.number):
            if number in done:
                continue
            window = make_window(number, surveys)
            with tempfile.TemporaryDirectory() as place:
                done[number] = judge(window, surveys[window.survey], Path(place))
            if done[number]["failed"] or done[number]["missed"]:
                print(json.dumps(done[number]), flush=True)
            if given.log:
                with given.log.open("a") as log:
                    log.write(json.dumps(done[number]) + "\n")
    rows = rows_by_kind([done[number] for number in range(given.first, given.first + given.number)])
    if given.first:
        print(as_markdown(rows))
        return
    command = f"python -m benchmarks.scale.windows DATA --number {given.number}"
    keep("windows", "Windows with round sides", rows, command, __doc__.split("\n\n")[3])


if __name__ == "__main__":
    main()
