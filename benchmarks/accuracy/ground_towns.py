"""The ground filters on drawn old towns: terraces, sunken courts, halls in the slope, of which all is known.

`python -m benchmarks.accuracy.ground_towns [--unseen] [--rivals]`. Numbers were chosen on the seeds that are
scanned by default; those of `--unseen` had no say. `--rivals` adds the sources' filters, and CSF where its
package `cloth-simulation-filter` is installed.
"""

from __future__ import annotations

import argparse
import importlib.util
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from benchmarks.accuracy.ground import METHODS, SMRF, by_smrf, doubt_figures
from benchmarks.accuracy.old_town import NODES_M, simulate_old_town
from benchmarks.table import keep
from eaves.ground import classify_ground
from eaves.model import Mask, PointCloud
from eaves.model.cloud import GROUND, WATER
from eaves.simulate.flight import Pattern
from eaves.simulate.scanner import Scanner, scan_town

COMMAND = "python -m benchmarks.accuracy.ground_towns"
SCANS: tuple[tuple[float, float, Pattern, bool], ...] = (
    (30.0, 0.02, "lines", False),
    (8.0, 0.02, "ellipse", False),
    (3.0, 0.03, "zigzag", False),
    (1.0, 0.05, "zigzag", True),
    (0.67, 0.08, "lines", True),
    (0.5, 0.05, "zigzag", False),
)
"""Points/m², noise (m), pattern, last pulses only and without their numbers."""
SEEDS, UNSEEN = (1, 2, 3, 4, 5, 6), (9101, 9102, 9103, 9104, 9105, 9106)
AREA_KM2 = 0.0625
HALL_M2 = 150.0
"""Buildings larger than this are halls here."""
WALL_SLOPE = 1.5
"""Points on walls of the terrain, which lean by half a metre, are not counted: steeper than this."""


@dataclass(frozen=True, eq=False)
class Drawn:
    """A scan with its truth (N,): ground, the levels between walls, halls, and what is counted at all."""

    name: str
    cloud: PointCloud
    truth: Mask
    level: Mask
    hall: Mask
    counted: Mask


def draw(seed: int, density: float, noise: float, pattern: Pattern, last: bool) -> Drawn:
    """One town, scanned once."""
    old = simulate_old_town(AREA_KM2, seed)
    scene = scan_town(old.town, density, noise, pattern, seed, scanner=Scanner(divergence=5e-4))
    cloud = scene.cloud.with_(classification=None, point_id=None)
    assert cloud.return_number is not None and cloud.number_of_returns is not None
    kept = np.flatnonzero(cloud.return_number == cloud.number_of_returns) if last else np.arange(len(cloud))
    cloud = cloud.take(kept)
    if last:
        cloud = PointCloud.from_world(cloud.xyz + [*cloud.origin, 0.0], cloud.origin)
    truth = scene.truth_class[kept] == GROUND
    wide = [one.number for one in old.town.buildings if one.footprint.area > HALL_M2]
    level = np.zeros(len(cloud), bool)
    for one in old.levels:
        level |= one.contains(cloud.xyz)
    name = f"{seed}: {density:g}/m²{', last' if last else ''}"
    step = np.array([NODES_M / 2.0, 0.0, 0.0])
    rises = [
        old.town.terrain.at(cloud.xyz + by) - old.town.terrain.at(cloud.xyz - by)
        for by in (step, step[[1, 0, 2]])
    ]
    wall = truth & (np.hypot(*rises) > WALL_SLOPE * NODES_M)
    on_roof = (scene.plane[kept] > 0) & np.isin(scene.building[kept], wide)
    counted = (scene.truth_class[kept] != WATER) & ~wall
    return Drawn(name, cloud, truth, level & truth & counted, on_roof, counted)


def draw_all(seeds: tuple[int, ...]) -> Iterator[Drawn]:
    """Every seed with a scan of its own, and with the next but two."""
    for number, seed in enumerate(seeds):
        for scan in (number, number + 3):
            yield draw(seed, *SCANS[scan % len(SCANS)])


def judge(drawn: Drawn, found: PointCloud) -> dict[str, object]:
    """What a classified cloud is worth."""
    ground = found.ground
    wrong = ground != drawn.truth
    return {
        "total error %": 100.0 * float(wrong[drawn.counted].mean()),
        "type I %": 100.0 * float((~ground)[drawn.truth & drawn.counted].mean()),
        "type II %": 100.0 * float(ground[~drawn.truth & drawn.counted].mean()),
        "levels kept": float(ground[drawn.level].mean()),
        "halls found": float((~ground)[drawn.hall].mean()),
        **doubt_figures(found, drawn.truth, drawn.counted),
    }


def by_csf(cloud: PointCloud, rigidness: int) -> PointCloud:
    """Ground by the authors' CSF with its defaults, slopes smoothed afterwards."""
    import CSF

    cloth = CSF.CSF()
    cloth.params.bSloopSmooth = True
    cloth.params.rigidness = rigidness
    cloth.setPointCloud(cloud.xyz)
    ground, rest = CSF.VecInt(), CSF.VecInt()
    cloth.do_filtering(ground, rest, False)
    classes = np.ones(len(cloud), np.uint8)
    classes[np.asarray(ground, np.int64)] = GROUND
    return cloud.with_(classification=classes)


def filters(rivals: bool) -> dict[str, Callable[[PointCloud], PointCloud]]:
    """Each filter by its name."""
    names = METHODS if rivals else ["adaptive_tin"]
    found: dict[str, Callable[[PointCloud], PointCloud]] = {
        name: partial(classify_ground, method=METHODS[name]) for name in names
    }
    found[SMRF] = by_smrf
    if rivals and importlib.util.find_spec("CSF"):
        found |= {f"CSF, rigidness {k}": partial(by_csf, rigidness=k) for k in (1, 2, 3)}
    return found


def main() -> None:
    """Print and keep the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--unseen", action="store_true", help="seeds that had no say in any number")
    parser.add_argument("--rivals", action="store_true", help="the sources' filters too")
    wanted = parser.parse_args()
    rows: list[dict[str, object]] = []
    methods = filters(wanted.rivals)
    for drawn in draw_all(UNSEEN if wanted.unseen else SEEDS):
        for name, method in methods.items():
            found = method(drawn.cloud)
            rows.append({"town": drawn.name, "method": name, "points": len(found), **judge(drawn, found)})
    for name in methods:
        some = [row for row in rows if row["method"] == name and row["town"] != "mean"]
        means = {key: float(np.mean([float(str(row[key])) for row in some])) for key in list(some[0])[3:]}
        rows.append({"town": "mean", "method": name, "points": "", **means})
    words = COMMAND + " --unseen" * wanted.unseen + " --rivals" * wanted.rivals
    keep(f"ground-towns{'-unseen' * wanted.unseen}", "Ground: drawn old towns", rows, words)


if __name__ == "__main__":
    main()
