"""Dense settlements, a tower of 120 m and a domed church, drawn and built by the command.

usage: python -m benchmarks.scale.settlements [--kinds medina informal] [--densities 5 15 50]

Houses touch and lanes are 1 to 3 m wide. Areas found and wrong are shares of the true area of roofs. Of
lanes and courts, ground seen is the share of the settlement's cells of half a metre with a point
of theirs, ground kept the share of their points that are class 2.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import geopandas
import laspy
import numpy as np
import shapely

from benchmarks.table import keep
from eaves.model import Bounds
from eaves.simulate import scan_town, write_simulation
from eaves.simulate.objects.exact import Mass
from eaves.simulate.objects.houses import (
    Design,
    Masses,
    draw_town_house,
    flat,
    gable,
    lifted,
    plan_rectangle,
    shed,
)
from eaves.simulate.objects.streets import Placement
from eaves.simulate.objects.surfaces import Foliage, ScannedSurfaces, make_terrain
from eaves.simulate.town import BuildingSite, Town

COMMAND = "python -m benchmarks.scale.settlements"
SIDE_M = 120.0
EDGE_M = 6.0
"""Free ground around a settlement."""
HOUSES_IN_A_ROW = 10
"""Between two cross lanes."""
SEED = 11


def town_house(width: float, depth: float, rng: np.random.Generator) -> Masses:
    """Two to four storeys under a gable along the lane."""
    return lifted(gable(width, depth, rng.uniform(0.5, 0.9)), rng.uniform(6.0, 11.0))


def court_house(width: float, depth: float, rng: np.random.Generator) -> Masses:
    """Flat, with a parapet, around a court where there is room for one."""
    height = rng.uniform(5.0, 9.0)
    if min(width, depth) < 9.0:
        return lifted(flat(width, depth, rng.uniform(0.5, 1.1)), height)
    court = plan_rectangle(0.35 * width, 0.35 * depth)
    plan = shapely.Polygon(plan_rectangle(width, depth).exterior, [court.exterior])
    return (Mass(plan, ((0.0, 0.0, height),)),)


def shack(width: float, depth: float, rng: np.random.Generator) -> Masses:
    """One storey, now and then two, under a sheet that leans a little."""
    height = rng.uniform(2.3, 3.4) + (rng.random() < 0.2) * 2.6
    return lifted(shed(width, depth, rng.uniform(0.02, 0.15)), height)


House = Callable[[float, float, np.random.Generator], Masses]
KINDS: dict[str, tuple[House, tuple[float, float], tuple[float, float], tuple[float, float]]] = {
    "old town": (town_house, (2.0, 3.0), (5.0, 8.0), (8.0, 12.0)),
    "medina": (court_house, (1.2, 2.5), (7.0, 13.0), (8.0, 13.0)),
    "informal": (shack, (1.0, 1.6), (3.0, 6.5), (4.0, 7.0)),
}
"""The house, and least and most of the width of lanes, the front of a house and its depth (m)."""


def draw_settlement(kind: str, seed: int) -> Town:
    """Rows of houses back to back, with lanes between them."""
    house, lanes, fronts, depths = KINDS[kind]
    rng, site = np.random.default_rng([seed, len(kind)]), empty_site()
    y = -SIDE_M / 2
    while y < SIDE_M / 2:
        for depth in rng.uniform(*depths, 2):
            x, count = -SIDE_M / 2, 0
            while x < SIDE_M / 2:
                width = float(rng.uniform(*fronts))
                design = Design(kind, house(width, float(depth), rng))
                site.build(Placement(design, x + width / 2, y + float(depth) / 2, 0.0))
                count += 1
                x += width + (rng.uniform(*lanes) if count % HOUSES_IN_A_ROW == 0 else 0.0)
            y += float(depth)
        y += rng.uniform(*lanes)
    return finished(site)


def draw_tower_and_dome(seed: int) -> Town:
    """A tower of 120 m, a church with a dome of 7 m over a square, and houses around them."""
    rng, site = np.random.default_rng([seed, 120]), empty_site()
    tower = lifted(flat(30.0, 24.0, 1.2), 120.0) + lifted(flat(8.0, 8.0), 125.0)
    turn = np.arange(24) * np.pi / 12
    drum = shapely.Polygon(7.0 * np.column_stack([np.cos(turn), np.sin(turn)]))
    rise = np.radians([15.0, 40.0, 65.0])
    tilt, foot = -1 / np.tan(rise), 22.0 + 7.0 / np.sin(rise)
    planes = [
        (t * np.cos(a), t * np.sin(a), f) for t, f in zip(tilt, foot, strict=True) for a in turn + np.pi / 24
    ]
    nave = lifted(gable(34.0, 12.0, 1.0), 12.0) + lifted(flat(16.0, 16.0), 16.0)
    site.build(Placement(Design("tower", tower), -25.0, 10.0, 0.3))
    site.build(Placement(Design("domed church", (*nave, Mass(drum, tuple(planes)))), 25.0, -15.0, 0.2))
    for x, y in rng.uniform(-SIDE_M / 2, SIDE_M / 2, (40, 2)):
        site.build(Placement(draw_town_house(9.0, 10.0, rng), float(x), float(y), float(rng.uniform(0, 3))))
    return finished(site)


def empty_site() -> BuildingSite:
    half = SIDE_M / 2 + EDGE_M
    bounds = Bounds(-half, -half, half, half)
    return BuildingSite(bounds, make_terrain("flat", bounds, np.random.default_rng(SEED)))


def finished(site: BuildingSite) -> Town:
    return Town(site.bounds, site.terrain, tuple(site.buildings), ScannedSurfaces.of([], 1), Foliage.join([]))


def rows(town: Town, kind: str, densities: list[float]) -> Iterator[dict[str, object]]:
    """What a run by the command reaches at each density."""
    for density in densities:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            files = write_simulation(scan_town(town, density, 0.03, seed=SEED), folder / "drawn")
            words = ["build", files["points"], "-o", folder / "out", "--crs", "metres", "--jobs", "1", "-q"]
            subprocess.run([sys.executable, "-m", "eaves", *map(str, words)], check=True)
            yield {"kind": kind, "points/m²": density, **judge(files, folder / "out", town)}


def judge(files: dict[str, Path], out: Path, town: Town) -> dict[str, object]:
    """Areas against the true outlines, ground against the true classes, heights of the highest roof."""
    drawn, made = laspy.read(files["points"]), laspy.read(out / "classified.laz")
    true = geopandas.read_file(files["vectors"], layer="footprints").geometry
    found = geopandas.read_file(out / "footprints.gpkg", layer="footprints")
    known, area = true.union_all(), found.geometry.union_all()
    near = known.buffer(1.6).buffer(-1.6)
    xy, ground = np.column_stack([drawn.x, drawn.y]), np.asarray(drawn.classification) == 2
    lanes = ground & shapely.contains_xy(near, xy[:, 0], xy[:, 1])
    order = [np.lexsort((np.asarray(one.z), np.asarray(one.y), np.asarray(one.x))) for one in (drawn, made)]
    kept = np.zeros(len(ground), bool)
    kept[order[0]] = np.asarray(made.classification)[order[1]] == 2
    cells = [
        len(np.unique(np.floor(2 * xy[some]), axis=0)) for some in (lanes, shapely.contains_xy(near, *xy.T))
    ]
    return {
        "ground seen": cells[0] / cells[1],
        "true": len(true),
        "found": len(found),
        "area found": area.intersection(known).area / known.area,
        "area wrong": area.difference(known).area / known.area,
        "ground kept": float(kept[lanes].mean()),
        "highest m": float(found["measuredHeight"].max()),
        "high trust": int((found["trust"] == "high").sum()),
    }


def main() -> None:
    """Print and keep the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument(
        "--kinds", nargs="+", choices=[*KINDS, "tower and dome"], default=[*KINDS, "tower and dome"]
    )
    parser.add_argument("--densities", nargs="+", type=float, default=[5.0, 15.0, 50.0])
    given = parser.parse_args()
    table: list[dict[str, object]] = []
    for kind in given.kinds:
        town = draw_settlement(kind, SEED) if kind in KINDS else draw_tower_and_dome(SEED)
        for row in rows(town, kind, given.densities):
            print(row, flush=True)
            table.append(row)
    note = "To reach: area found .9, ground kept .8."
    keep("settlements", "Dense settlements, a tower and a dome", table, COMMAND, note)


if __name__ == "__main__":
    main()
