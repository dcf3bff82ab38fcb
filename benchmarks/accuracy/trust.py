"""How far trust can be trusted: learned on towns of which every roof is known, each left out.

A building is right when nine tenths of its plan lie within 0.2 m of the true roof. Prints what stands in
`eaves.buildings.trust` beside what is learned on all towns, and keeps how often buildings of each class are
right in a town that the weights were not learned on.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import shapely
from numpy.typing import NDArray

from benchmarks.table import as_markdown, keep
from eaves.buildings import trust
from eaves.formats.vectors.geopackage import read_details
from eaves.geometry.roof_fit import RoofFaces, collect_faces, fit_roof
from eaves.model import Mask, Values
from eaves.pipeline import build
from eaves.simulate import scan_town, simulate_town, town_of_model, write_simulation
from eaves.simulate.objects.exact import ExactScene

DATA = Path(os.environ.get("EAVES_DATA", "data"))
TOWNS = (
    ("suburb, 10/m²", 41, "suburb", "flat", 10.0, 0.02),
    ("centre, 15/m²", 42, "centre", "slope", 15.0, 0.02),
    ("mixed, 4/m²", 43, "mixed", "hilly", 4.0, 0.03),
    ("mixed, 25/m²", 44, "mixed", "terraced", 25.0, 0.02),
    ("suburb, 1.5/m²", 45, "suburb", "hilly", 1.5, 0.05),
)
"""Name, seed, style, terrain, density and noise (m) of the drawn towns."""
AREA_KM2 = 0.09
NEAR_M, RIGHT_SHARE = 0.2, 0.9
"""A building is right when so much of its plan lies so near (m) to the true roof."""
STEP_M = 0.5
"""Distance (m) of the places at which roofs are compared."""
SMALLEST_M2 = 10.0
"""Smaller buildings are left out."""


@dataclass(frozen=True, eq=False)
class Judged:
    """The columns of buildings, and whether they are right (B,)."""

    rows: list[dict[str, Any]]
    right: Mask


def scenes() -> dict[str, ExactScene]:
    """The scanned towns by name."""
    found = {}
    for name, seed, style, terrain, density, noise in TOWNS:
        town = simulate_town(AREA_KM2, terrain=terrain, style=style, seed=seed)  # type: ignore[arg-type]
        found[name] = scan_town(town, density, noise, seed=seed)
    model = town_of_model(DATA / "towns" / "delfshaven.city.json", trees=1.0)
    found["delfshaven, 10/m²"] = scan_town(model, 10.0, 0.03)
    return found


def judged(scene: ExactScene, folder: Path) -> Judged:
    """What a run of a scene says of its buildings, and which are right."""
    files = write_simulation(scene, folder / "truth")
    build([str(files["points"])], folder / "built", outputs=("footprints",))
    path = folder / "built" / "footprints.gpkg"
    names, _, shapes, columns = pyogrio.raw.read(path, layer="footprints")
    rows = [dict(zip(names["fields"], values, strict=True)) for values in zip(*columns, strict=True)]
    details = read_details(path)
    rows = [row | details.get(row["id"], {}) for row in rows]
    plans = shapely.from_wkb(shapes)
    there = np.flatnonzero([shape is not None and shape.area >= SMALLEST_M2 for shape in plans])
    true_faces = collect_faces(
        [rings_of(face.polygon, face.coefficients) for one in scene.buildings for face in one.faces],
        [one.number for one in scene.buildings for _ in one.faces],
    )
    origin = np.array(scene.cloud.origin)
    names, _, shapes, columns = pyogrio.raw.read(path, layer="roof_planes", columns=["building_id"])
    owner = {rows[k]["id"]: k for k in range(len(rows))}
    built = collect_faces(
        [
            [shapely.get_coordinates(ring, include_z=True)[:-1] - [*origin, 0.0] for ring in rings(shape)]
            for shape in shapely.from_wkb(shapes)
        ],
        [owner[name] for name in columns[0]],
    )
    right = [near_share(plans[k], origin, built, true_faces) >= RIGHT_SHARE for k in there]
    return Judged([clean(rows[k]) for k in there], np.array(right))


def clean(row: dict[str, Any]) -> dict[str, Any]:
    """The row with None for what is not a number."""
    return {
        name: None if isinstance(value, float) and np.isnan(value) else value for name, value in row.items()
    }


def rings(shape: shapely.Polygon) -> list[shapely.LinearRing]:
    """The outer ring and the holes."""
    return [shape.exterior, *shape.interiors]


def rings_of(polygon: shapely.Polygon, plane: tuple[float, float, float]) -> list[NDArray[np.float64]]:
    """The rings (M, 3) of a true face."""
    found = []
    for ring in rings(polygon):
        xy = shapely.get_coordinates(ring)[:-1]
        found.append(np.column_stack([xy, xy @ np.array(plane[:2]) + plane[2]]))
    return found


def near_share(
    plan: shapely.Polygon, origin: NDArray[np.float64], built: RoofFaces, true_faces: RoofFaces
) -> float:
    """Share of a building's plan (world metres) that lies near to the true roof."""
    here = shapely.transform(plan, lambda xy: xy - origin)
    west, south, east, north = here.bounds
    x, y = np.meshgrid(np.arange(west + 0.25, east, STEP_M), np.arange(south + 0.25, north, STEP_M))
    xy = np.column_stack([x.ravel(), y.ravel()])
    xy = xy[shapely.contains_xy(here, xy)]
    places = np.column_stack([xy, np.zeros(len(xy))])
    if not len(places):
        return 0.0
    apart = fit_roof(places, built).vertical - fit_roof(places, true_faces).vertical
    return float((np.abs(apart) <= NEAR_M).mean())


def learned(towns: Sequence[Judged]) -> NDArray[np.float64]:
    """Weights (K,) of the traits, by Newton's method with a small ridge; each town counts alike."""
    traits = np.vstack([[trust.trust_traits(row) for row in town.rows] for town in towns])
    right = np.concatenate([town.right for town in towns])
    count = np.concatenate([np.full(len(town.rows), 100.0 / len(town.rows)) for town in towns])
    weight = np.zeros(traits.shape[1])
    for _ in range(60):
        chance = 1.0 / (1.0 + np.exp(-traits @ weight))
        slope = traits.T @ (count * (right - chance)) - 0.5 * weight
        bend = (traits.T * (count * chance * (1.0 - chance))) @ traits + 0.5 * np.eye(len(weight))
        weight += np.linalg.solve(bend, slope)
    return weight


def chances(town: Judged, weight: NDArray[np.float64]) -> Values:
    """The probability (B,) that each building is right."""
    traits = np.array([trust.trust_traits(row) for row in town.rows])
    return np.asarray(1.0 / (1.0 + np.exp(-traits @ weight)))


def class_row(name: str, weights: str, chance: Values, right: Mask) -> dict[str, object]:
    """One line: how many buildings have each class, and the share of them that is right."""
    row: dict[str, object] = {"town": name, "weights from": weights, "buildings": len(right)}
    row["right"] = round(float(right.mean()), 3)
    bounds = {"high": (trust.HIGH, 2.0), "medium": (trust.LOW, trust.HIGH), "low": (-1.0, trust.LOW)}
    for kind, (low, high) in bounds.items():
        mine = (chance >= low) & (chance < high)
        row[kind] = int(mine.sum())
        row[f"{kind}: right"] = round(float(right[mine].mean()), 3) if mine.any() else None
    row["said"] = round(float(chance.mean()), 3)
    row["Brier"] = round(float(np.mean((chance - right) ** 2)), 3)
    return row


def main() -> None:
    """Print the weights, and keep how often each class is right where it was not learned."""
    towns = {}
    with tempfile.TemporaryDirectory() as name:
        for number, (town, scene) in enumerate(scenes().items()):
            towns[town] = judged(scene, Path(name) / str(number))
    whole = learned(list(towns.values()))
    print(
        as_markdown(
            [
                {"trait": trait, "in use": used, "learned": round(float(one), 2)}
                for (trait, used), one in zip(trust.WEIGHTS.items(), whole, strict=True)
            ]
        )
    )
    rows, every = [], []
    for town, one in towns.items():
        family = town.split(",")[0]
        others = [other for name, other in towns.items() if name.split(",")[0] != family]
        chance = chances(one, learned(others))
        every.append((chance, one.right))
        rows.append(class_row(town, "the others", chance, one.right))
    rows.append(class_row("all", "the others", *(np.concatenate(both) for both in zip(*every, strict=True))))
    used = np.array(list(trust.WEIGHTS.values()))
    right = np.concatenate([one.right for one in towns.values()])
    chance = np.concatenate([chances(one, used) for one in towns.values()])
    rows.append(class_row("all", "all, in use", chance, right))
    keep(
        "trust",
        "Trust of buildings, learned and left out",
        rows,
        "python -m benchmarks.accuracy.trust",
        f"A building is right when {RIGHT_SHARE:.0%} of its plan lie within {NEAR_M} m of the true roof. A "
        "town left out is left out with all scans of its kind (suburb, mixed, delfshaven).",
    )


if __name__ == "__main__":
    main()
