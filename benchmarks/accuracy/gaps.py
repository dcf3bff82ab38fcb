"""Roofs with holes: half of the points of every roof of Delft deleted in discs, and what models do there."""

from __future__ import annotations

import json
import os
import tempfile
from collections import Counter
from pathlib import Path

import laspy
import numpy as np
import pyogrio
import shapely
from numpy.typing import NDArray

from benchmarks.table import keep
from eaves.formats import iter_cityjson
from eaves.geometry.roof_fit import collect_faces, fit_roof
from eaves.model.building import ROOF_SURFACE
from eaves.pipeline import build

DATA = Path(os.environ.get("EAVES_DATA", "data"))
SOURCE = DATA / "delft" / "ahn3.laz"
MAP = DATA / "delft" / "footprints.gpkg"
GAPS_M = (1.0, 5.0)
"""Diameters (m) of the discs, spread evenly."""
DELETED = 0.5
"""Share of each roof's points that goes."""
LEAST_LEFT, MOST_DISCS = 0.4, 2000
"""A disc that would leave less is drawn at its smallest, or not; so many are tried."""
COVERED = 0.1
"""A building is lost when no model stands over so much of its plan."""
OVER_M = 0.3
"""A vertex may stand this much (m) over the highest measured roof point of its building."""
NEAR_M = 0.2
"""A deleted point this near (m) to the model is predicted."""
SEEDS = (1, 2)


def with_gaps(points: laspy.LasData, number: NDArray[np.int64], seed: int) -> NDArray[np.bool_]:
    """Which points (N,) stay; `number` (N,) is that of the building, 0 for none."""
    rng = np.random.default_rng(seed)
    xy = np.column_stack([points.x, points.y])
    stays = np.ones(len(xy), bool)
    order = np.argsort(number, kind="stable")
    cuts = np.searchsorted(number[order], np.arange(1, number.max() + 2))
    for mine in np.split(order, cuts)[1:-1]:
        left = np.ones(len(mine), bool)
        for _ in range(MOST_DISCS):
            if not len(mine) or left.mean() <= 1.0 - DELETED:
                break
            centre = xy[mine[rng.choice(np.flatnonzero(left))]]
            apart = np.hypot(*(xy[mine] - centre).T)
            for size in (rng.uniform(*GAPS_M), GAPS_M[0]):
                after = left & (apart > 0.5 * size)
                if after.mean() >= LEAST_LEFT:
                    left = after
                    break
        stays[mine[~left]] = False
    return stays


def buildings_of(folder: Path) -> dict[str, tuple[int, str | None]]:
    """Number and finest level of each building, by its id."""
    names, _, _, columns = pyogrio.raw.read(folder / "footprints.gpkg", layer="footprints")
    table = dict(zip(names["fields"], columns, strict=True))
    return {
        name: (int(number), lod)
        for name, number, lod in zip(table["id"], table["number"], table["lod"], strict=True)
    }


def highest_vertices(folder: Path) -> dict[str, float]:
    """The highest vertex (m) of each model."""
    found: dict[str, float] = {}
    for item in iter_cityjson(folder / "buildings.city.jsonl"):
        name = item.parents[0] if item.parents else item.id
        for geometry in item.geometries:
            if geometry.solids:
                found[name] = max(found.get(name, -np.inf), float(item.vertices[:, 2].max()))
    return found


def roof_rings(folder: Path) -> list[list[NDArray[np.float64]]]:
    """The rings of all roof faces of the finest models."""
    found = []
    for item in iter_cityjson(folder / "buildings.city.jsonl"):
        finest = max((one.lod for one in item.geometries if one.solids), default=None)
        for geometry in item.geometries:
            if geometry.lod != finest:
                continue
            for solid in geometry.solids:
                for face in solid[0]:
                    if face.surface == ROOF_SURFACE:
                        found.append([item.vertices[list(ring)] for ring in face.rings])
    return found


def gap_row(name: str, folder: Path, options: dict[str, object]) -> dict[str, object]:
    """One line: the run of the whole points, and of those with gaps."""
    build([str(SOURCE)], folder / "whole", **options)
    whole = laspy.read(folder / "whole" / "classified.laz")
    number = np.asarray(whole["building_id"], np.int64)
    number[np.asarray(whole.classification) != 6] = 0
    before = buildings_of(folder / "whole")
    levels: Counter[str] = Counter()
    lost = over = count = 0
    most, near, covered = -np.inf, [], []
    for seed in SEEDS:
        stays = with_gaps(whole, number, seed)
        source = laspy.read(SOURCE)
        source.points = source.points[stays]
        source.write(folder / f"{seed}.laz")
        out = folder / f"gaps {seed}"
        build([str(folder / f"{seed}.laz")], out, **options)
        after, tops = buildings_of(out), highest_vertices(out)
        shares = covered_shares(folder / "whole", out)
        lost += int((shares < COVERED).sum())
        covered.append(float(shares.mean()))
        thin = laspy.read(out / "classified.laz")
        mine = np.asarray(thin["building_id"], np.int64)
        highest = np.full(mine.max() + 1, -np.inf)
        np.maximum.at(highest, mine, np.asarray(thin.z))
        for one, (place, lod) in after.items():
            levels[str(lod)] += 1
            if one in tops and place < len(highest) and np.isfinite(highest[place]):
                count += 1
                excess = tops[one] - highest[place]
                most, over = max(most, excess), over + (excess > OVER_M)
        rings = roof_rings(out)
        gone = np.flatnonzero(~stays)
        shift = np.array([float(np.mean(whole.x)), float(np.mean(whole.y)), 0.0])
        faces = collect_faces([[ring - shift for ring in one] for one in rings], [0] * len(rings))
        places = np.column_stack([whole.x[gone], whole.y[gone], whole.z[gone]]) - shift
        near.append(float((np.abs(fit_roof(places, faces).distance) <= NEAR_M).mean()))
    return {
        "run": name,
        "buildings": len(before),
        "lost in 2 runs": lost,
        "models": count,
        "plan with a model": round(float(np.mean(covered)), 3),
        f"over {OVER_M} m": over,
        "most (m)": round(most, 2),
        "deleted points within 0.2 m": round(float(np.mean(near)), 3),
        "levels": json.dumps(dict(sorted(levels.items(), reverse=True))).replace('"', ""),
    }


def covered_shares(whole: Path, out: Path) -> NDArray[np.float64]:
    """The share of the plan (B,) of each building of a run over which another has models."""
    one, other = (
        pyogrio.raw.read(folder / "footprints.gpkg", layer="footprints", columns=["lod"])
        for folder in (whole, out)
    )
    modelled = np.array([lod not in (None, "0") for lod in other[3][0]])
    plans = shapely.from_wkb(other[2])[modelled]
    tree = shapely.STRtree(plans)
    shares = []
    for plan in shapely.from_wkb(one[2]):
        near = shapely.union_all(plans[tree.query(plan, predicate="intersects")])
        shares.append(shapely.intersection(near, plan).area / plan.area)
    return np.array(shares)


def main() -> None:
    """Write the table."""
    with tempfile.TemporaryDirectory() as name:
        rows = [
            gap_row("footprints of the map", Path(name) / "map", {"footprints": str(MAP)}),
            gap_row("bare points", Path(name) / "bare", {}),
        ]
    keep(
        "gaps",
        "Half of each roof's points deleted in discs of 1 to 5 m: Delft",
        rows,
        "python -m benchmarks.accuracy.gaps",
        f"Two runs of different gaps. A vertex more than {OVER_M} m over the highest point of its building "
        "in the thinned scan has run away; a building is lost when no model stands over a tenth of its plan. "
        "Outlines of bare points lose what the gaps take from their rim and the widest holes.",
    )


if __name__ == "__main__":
    main()
