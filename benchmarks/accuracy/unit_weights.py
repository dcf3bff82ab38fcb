"""The weights of the signs of a party wall: logistic regression on scanned towns whose walls are known.

Prints what stands in `eaves.units.row_walls.evidence.WEIGHTS`.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from benchmarks.accuracy.outline_detected import detected_groups, drawn_together
from benchmarks.table import as_markdown
from eaves.methods import make_method
from eaves.model import Mask
from eaves.outline import OutlineMethod
from eaves.simulate import scan_town, simulate_town, town_of_model
from eaves.simulate.exact import ExactScene
from eaves.units.row_walls.evidence import WEIGHTS, traits_of, wall_signs
from eaves.units.row_walls.method import RowWalls, directions_of
from eaves.units.row_walls.rows import Plan, Row, rows_of

DATA = Path(os.environ.get("EAVES_DATA", "data"))
DENSITY, NOISE = 10.0, 0.03
LEAST_M2 = 40.0
"""Smaller volumes hold no row."""
WALL_SHARE = 0.6
"""A wall of the truth runs through so much of the row's depth."""
NEXT_TO = 4
"""Steps beside a true wall that count neither way."""
RIM = 8
"""Steps at both ends of a row that count neither way."""


def scenes() -> Iterator[ExactScene]:
    """A real town's models and three drawn towns, scanned."""
    yield scan_town(town_of_model(DATA / "towns" / "delfshaven.city.json", trees=1.0), DENSITY, NOISE)
    for seed, style, area in ((1, "centre", 0.06), (2, "centre", 0.06), (5, "mixed", 0.09)):
        yield scan_town(simulate_town(area, style=style, seed=seed), DENSITY, NOISE, seed=seed)  # type: ignore[arg-type]


def true_walls(row: Row, tree: shapely.STRtree) -> tuple[Mask, Mask]:
    """At which steps (S + 1,) a wall of the truth runs along the row's walls, and which steps count."""
    s, t = row.grid()
    inside = (t >= row.first) & (t < row.last)
    owner = np.full(s.shape, -1)
    place, building = tree.query(shapely.points(row.place(s[inside], t[inside])), predicate="within")
    some = np.full(int(inside.sum()), -1)
    some[place] = building
    owner[inside] = some
    both = (owner[:, 1:] >= 0) & (owner[:, :-1] >= 0)
    change = both & (owner[:, 1:] != owner[:, :-1])
    wide = change.copy()
    wide[:, 1:] |= change[:, :-1]
    wide[:, :-1] |= change[:, 1:]
    count = both.sum(axis=0)
    share = np.zeros(len(row.first) + 1)
    share[1:-1] = np.where(count > 4, wide.sum(axis=0) / np.maximum(count, 1), 0.0)
    wall = share > WALL_SHARE
    near = np.convolve(wall, np.ones(2 * NEXT_TO + 1), "same") > 0
    counts = np.zeros(len(share), bool)
    counts[RIM:-RIM] = (count > 4)[RIM - 1 : -RIM + 1]
    return wall, counts & (wall | ~near)


def samples(scene: ExactScene) -> tuple[NDArray[np.float64], Mask]:
    """Traits (N, K) and truth (N,) of all steps of all rows of a scene; rows of the truth itself left out."""
    method = make_method("outline")
    assert isinstance(method, OutlineMethod)
    groups, spacing = detected_groups(scene.cloud)
    traits, walls = [], []
    truth = [one.footprint for one in scene.buildings if one.footprint.area > 15.0]
    whole = [one.footprint for one in scene.buildings if one.kind == "row houses"]
    tree = shapely.STRtree(truth)
    for group in groups:
        for outline in drawn_together([group], spacing, method):
            if outline.area < LEAST_M2 or any(outline.intersects(row) for row in whole):
                continue
            method = RowWalls()
            plan = Plan.of(outline, [outline], group)
            for row in rows_of(plan, directions_of(outline, method.shortest_edge), method.row_limits()):
                wall, counts = true_walls(row, tree)
                traits.append(traits_of(wall_signs(row, group, NOISE))[counts])
                walls.append(wall[counts])
    return np.concatenate(traits), np.concatenate(walls)


def logistic(traits: NDArray[np.float64], truth: Mask) -> NDArray[np.float64]:
    """Weights (K,) by Newton's method, with a small ridge."""
    weight = np.zeros(traits.shape[1])
    for _ in range(60):
        chance = 1.0 / (1.0 + np.exp(-traits @ weight))
        slope = traits.T @ (truth - chance) - 0.1 * weight
        bend = (traits.T * (chance * (1.0 - chance))) @ traits + 0.1 * np.eye(len(weight))
        weight += np.linalg.solve(bend, slope)
    return weight


def main() -> None:
    """Print the weights learned beside those in use."""
    found = [samples(scene) for scene in scenes()]
    weights = logistic(np.concatenate([one for one, _ in found]), np.concatenate([two for _, two in found]))
    rows = [
        {"sign": name, "in use": used, "learned": round(float(weight), 2)}
        for (name, used), weight in zip(WEIGHTS.items(), weights, strict=True)
    ]
    print(as_markdown(rows))


if __name__ == "__main__":
    main()
