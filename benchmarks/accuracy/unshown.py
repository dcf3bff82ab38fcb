"""What no return shows: models of 2,000 drawn houses that lack a part in the scan, by the command.

Run `python -m benchmarks.accuracy.unshown [--scenes N] [--keep FOLDER]`. Scene k is drawn by seed k: a
hundred houses on level ground, of every roof and every missing part (`unshown_houses`), one in three beside a
tree. It is built twice, from the points alone and with the true plans as a map. A model is wrong where its
height or volume is off by more than a tenth.

Of the points alone a part without returns cannot be known for a part of a house, so that there the trust
alone is asked for; with the map the volume is.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pyogrio
import shapely
from shapely import affinity

from benchmarks.accuracy.over_returns import risen
from benchmarks.accuracy.unshown_houses import (
    PARTS,
    PLACE,
    ROOFS,
    House,
    Returns,
    draw_house,
    scan,
    tree_beside,
    write_plans,
    write_returns,
)
from benchmarks.table import keep

COMMAND = "python -m benchmarks.accuracy.unshown"
SCENES, A_SIDE, PITCH = 20, 10, 25.0
"""Scenes, houses along a side of one, and metres from house to house."""
DENSITIES, NOISES, TREES = (5.0, 16.0), (0.02, 0.05), 1.0 / 3.0
"""Ranges of the pulses/m² and of the noise (m) of a scene; share of houses beside a tree."""
OFF, QUARTER, LEVEL = 0.1, 0.25, "flat"
"""What makes a model wrong; the share of a plan without returns that forbids high trust where the roof is
not of that type."""
POOR, SIGMAS = 0.3, 3.0
"""RMSE (m), and in sigmas of the scan, over which trust is never high."""
CELL = 1.0
"""Side of the cells (m) that have returns or none."""


@dataclass(frozen=True)
class Scene:
    """A drawn scene, its noise (m), and the folder of its files."""

    houses: tuple[House, ...]
    returns: Returns
    noise: float
    folder: Path


def draw_scene(seed: int, folder: Path) -> Scene:
    """The scene of a seed, written to a folder as `tile.laz` and `map.gpkg`."""
    rng = np.random.default_rng(seed)
    kinds = list(product(ROOFS, PARTS))
    houses, crowns = [], []
    for number in range(A_SIDE**2):
        middle = PITCH * (number % A_SIDE + 0.5), PITCH * (number // A_SIDE + 0.5)
        kind, part = kinds[(number + seed * A_SIDE**2) % len(kinds)]
        house = draw_house(kind, part, middle, rng, bool(rng.uniform() < TREES))
        houses.append(house)
        if house.tree:
            crowns.append(tree_beside(house, rng))
    noise = float(rng.uniform(*NOISES))
    returns = scan(houses, crowns, A_SIDE * PITCH, rng.uniform(*DENSITIES), noise, rng)
    folder.mkdir(parents=True)
    write_returns(folder / "tile.laz", returns)
    write_plans(folder / "map.gpkg", [house.plan for house in houses])
    return Scene(tuple(houses), returns, noise, folder)


def build(scene: Scene, given: bool) -> Path:
    """The folder of a run over a scene, with its map or without."""
    out = scene.folder / ("given" if given else "bare")
    words = ["build", str(scene.folder / "tile.laz"), "-o", str(out), "-q", "--outputs", "footprints,models"]
    words += ["--footprints", str(scene.folder / "map.gpkg"), "--id-field", "id"] if given else []
    subprocess.run([sys.executable, "-m", "eaves", *words], check=True, capture_output=True)
    return out


def empty_share(plan: shapely.Polygon, xy: np.ndarray) -> float:
    """The share of a plan in cells that no return (N, 2) lies in."""
    west, south, east, north = np.floor(plan.bounds)
    x, y = np.meshgrid(np.arange(west, east + 1) + CELL / 2, np.arange(south, north + 1) + CELL / 2)
    cells = np.column_stack([x.ravel(), y.ravel()])
    cells = cells[shapely.contains_xy(plan, *cells.T)]
    filled = set(map(tuple, np.floor(xy).tolist()))
    return float(np.mean([tuple(np.floor(cell)) not in filled for cell in cells])) if len(cells) else 0.0


def judge_run(scene: Scene, given: bool) -> list[dict[str, object]]:
    """A row for each house of a scene: what it is, and what a run says of it."""
    out = build(scene, given)
    world = scene.returns.xyz + (*PLACE, 0.0)
    rises = risen(out, world)
    table = pyogrio.read_dataframe(out / "footprints.gpkg", layer="footprints")
    plans = [affinity.translate(shape, -PLACE[0], -PLACE[1]) for shape in table.geometry]
    tree = shapely.STRtree(plans)
    rows = []
    for number, house in enumerate(scene.houses):
        near = tree.query(house.plan, predicate="intersects")
        shared = [shapely.area(plans[k] & house.plan) for k in near]
        row: dict[str, object] = {
            "given": given, "roof": house.kind, "part": house.part, "tree": house.tree,
            "hidden": house.hidden_share, "scene": str(scene.folder), "number": number,
        }  # fmt: skip
        rows.append(row)
        if not shared or max(shared) < 0.2 * house.plan.area:
            continue
        found = table.iloc[near[int(np.argmax(shared))]]
        plan = plans[near[int(np.argmax(shared))]]
        inside = shapely.contains_xy(plan, *scene.returns.xyz[:, :2].T)
        high = found.h_max - found.h_ground
        row |= {
            "id": found.id, "trust": found.trust, "lod": found.lod, "type": found.roof_type,
            "height": high / house.ridge - 1.0, "volume": found.volume_m3 / house.volume - 1.0,
            "rmse": found.rmse_m, "poor": found.rmse_m > max(POOR, SIGMAS * scene.noise),
            "empty": empty_share(plan, scene.returns.xyz[inside, :2]), "rise": rises.get(str(found.id), 0.0),
            "said": found.review_reason,
        }  # fmt: skip
    return rows


def figures_of(name: str, rows: pd.DataFrame) -> dict[str, object]:
    """A row of the table of some houses."""
    models = rows[rows.volume.notna()]
    is_high = models.trust == "high"
    is_wrong = (models.height.abs() > OFF) | (models.volume.abs() > OFF)
    return {
        "houses": name, "drawn": len(rows), "models": len(models),
        "high": float(is_high.mean()),
        "over their returns": int((models.rise > 0.0).sum()),
        "wrong": int(is_wrong.sum()),
        "wrong and high": int((is_wrong & is_high).sum()),
        "volume within a tenth": float((models.volume.abs() <= OFF).mean()),
        "height within a tenth": float((models.height.abs() <= OFF).mean()),
        "high, a quarter empty, not level": int(
            (is_high & (models["empty"] >= QUARTER) & (models.type != LEVEL)).sum()
        ),
        "high, poor fit": int((is_high & models.poor.astype(bool)).sum()),
    }  # fmt: skip


def table_of(rows: pd.DataFrame) -> list[dict[str, object]]:
    """The table: with the map and without, by what is missing and by roof."""
    table = []
    whole = ("nothing", "a hole")
    for given in (True, False):
        how = "map" if given else "bare"
        own = rows[rows.given == given]
        lacking = own[~own.part.isin(whole)]
        table += [figures_of(f"{how}: all", own), figures_of(f"{how}: a part is missing", lacking)]
        table += [figures_of(f"{how}: {part}", own[own.part == part]) for part in PARTS]
        for roof in ROOFS:
            table.append(figures_of(f"{how}: {roof}, a part missing", lacking[lacking.roof == roof]))
        table.append(figures_of(f"{how}: beside a tree", own[own.tree]))
    return table


def main(words: Sequence[str] | None = None) -> None:
    """Build the scenes and keep the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--scenes", type=int, default=SCENES)
    parser.add_argument("--first", type=int, default=0, help="the seed of the first scene")
    parser.add_argument("--keep", type=Path, help="a folder for scenes, runs and the row of each house")
    parser.add_argument("--name", default="unshown", help="the name of the table")
    asked = parser.parse_args(words)
    place = asked.keep or Path(tempfile.mkdtemp())
    rows: list[dict[str, object]] = []
    seeds = range(asked.first, asked.first + asked.scenes)
    for seed in seeds:
        scene = draw_scene(seed, place / str(seed))
        for given in (True, False):
            rows += judge_run(scene, given)
        print(f"scene {seed}", file=sys.stderr, flush=True)
        if asked.keep is None:
            shutil.rmtree(scene.folder)
    table = pd.DataFrame(rows)
    if asked.keep is not None:
        table.to_csv(place / "houses.csv", index=False)
    note = (
        f"{asked.scenes * A_SIDE**2} houses in {asked.scenes} scenes of seeds {seeds[0]} to {seeds[-1]}, "
        f"each built with its map and bare; {DENSITIES[0]:g} to {DENSITIES[1]:g} pulses/m², noise "
        f"{NOISES[0]:g} to {NOISES[1]:g} m. Wrong: height or volume off by over a tenth."
    )
    keep(asked.name, "What no return shows", table_of(table), COMMAND, note)


if __name__ == "__main__":
    main()
