"""How far trust can be trusted: learned on towns of which every roof is known, each left out.

A building is right when nine tenths of its plan lie within 0.2 m of the true roof, and nine tenths of its
outline within 1 m of the true one, and the other way round. Of row houses the whole row is looked at. Prints
what stands in `eaves.figures.rows` beside what is learned on all towns, and keeps how often buildings of
each class are right in a town that the weights were not learned on.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import shapely
from numpy.typing import NDArray
from shapely import STRtree

from benchmarks.accuracy.detection_fit import regression
from benchmarks.accuracy.drawn_blocks import detached_house, large_building
from benchmarks.table import as_markdown, keep
from eaves.figures import rows as trust
from eaves.formats.vectors.polygons import read_details
from eaves.geometry.face_table import FaceTable, RoofFaces, fit_roof
from eaves.model import Mask, Values
from eaves.model.cloud import UNCLASSIFIED
from eaves.pipeline import build
from eaves.simulate import Town, scan_town, simulate_town, write_simulation
from eaves.simulate.objects.exact import ExactScene
from eaves.simulate.objects.houses import DETACHED_SHARES, Design
from eaves.simulate.objects.streets import TownStyle, draw_block
from eaves.simulate.objects.surfaces import Foliage, ScannedSurfaces, TerrainKind, upright_box
from eaves.simulate.town import lay_site

TOWNS = (
    ("suburb, 10/m²", 41, "suburb", "flat", 10.0, 0.02, 1.0, 0),
    ("centre, 15/m²", 42, "centre", "slope", 15.0, 0.02, 1.0, 0),
    ("mixed, 4/m²", 43, "mixed", "hilly", 4.0, 0.03, 1.0, 0),
    ("mixed, 25/m²", 44, "mixed", "terraced", 25.0, 0.02, 1.0, 0),
    ("suburb, 1.5/m²", 45, "suburb", "hilly", 1.5, 0.05, 1.0, 0),
    ("crowns, 4/m²", 46, "suburb", "flat", 4.0, 0.03, 2.5, 0),
    ("crowns, 12/m²", 47, "suburb", "slope", 12.0, 0.02, 2.5, 0),
    ("crowns, 8/m²", 56, "suburb", "hilly", 8.0, 0.03, 3.0, 0),
    ("yards, 8/m²", 48, "suburb", "flat", 8.0, 0.02, 1.0, 12),
    ("yards, 3/m²", 49, "mixed", "flat", 3.0, 0.03, 2.0, 12),
    ("yards, 15/m²", 58, "mixed", "slope", 15.0, 0.02, 1.5, 12),
    ("wings, 4/m²", 61, "suburb", "flat", 4.0, 0.03, 1.5, 0),
    ("wings, 8/m²", 62, "mixed", "slope", 8.0, 0.03, 2.5, 0),
    ("wings, 15/m²", 63, "suburb", "hilly", 15.0, 0.02, 2.0, 0),
)
"""Name, seed, style, terrain, density, noise (m), share of trees and yards of trailers of the drawn towns."""
AREA_KM2 = 0.09
NEAR_M, RIGHT_SHARE = 0.2, 0.9
"""A building is right when so much of its plan lies so near (m) to the true roof."""
STEP_M, RIM_M = 0.5, 1.0
"""Distance (m) of the places at which roofs and outlines are compared; nearer outlines agree."""
SMALLEST_M2 = 10.0
"""Smaller buildings are left out."""


@dataclass(frozen=True, eq=False)
class Judged:
    """The columns of buildings, and whether they are right (B,)."""

    rows: list[dict[str, Any]]
    right: Mask


def scenes() -> Iterator[tuple[str, ExactScene]]:
    """The scanned towns with their names."""
    for name, seed, style, terrain, density, noise, trees, yards in TOWNS:
        draw = winged_town if name.startswith("wings") else simulate_town
        town = draw(AREA_KM2, terrain=terrain, style=style, seed=seed, trees=trees)  # type: ignore[operator]
        parked = ScannedSurfaces.join([town.furniture, *park_trailers(town, yards, seed)])
        yield name, scan_town(replace(town, furniture=parked), density, noise, seed=seed)


def winged_town(area_km2: float, *, terrain: TerrainKind, style: TownStyle, seed: int, trees: float) -> Town:
    """A town whose detached houses have garages, cross gables, wings and porches, or are large and of several
    heights, one of nine."""
    site, plots, _ = lay_site(area_km2, None, terrain, seed, style)
    for number, plot in enumerate(plots):
        rng = np.random.default_rng([seed, 98, number])
        whole = bool(site.bounds.buffered(-10.0).contains(plot.corners()).all())
        draw_block(plot, style, whole, True, rng)
        for placement in plot.placements:
            if placement.design.kind in DETACHED_SHARES:
                masses = large_building(rng) if rng.random() < 1 / 9 else detached_house(rng)
                house = Design("of many wings", masses, float(rng.uniform(0.1, 0.6)))
                placement = replace(placement, design=house)
            site.build(placement)
        site.furnish(plot, trees, 2.5, rng)
    site.install(seed)
    return Town(
        site.bounds,
        site.terrain,
        tuple(site.buildings),
        ScannedSurfaces.join(site.surfaces),
        Foliage.join(site.leaves),
    )


def park_trailers(town: Town, yards: int, seed: int) -> Iterator[ScannedSurfaces]:
    """Rows of two to six trailers side by side where nothing is built."""
    rng, tree = np.random.default_rng([seed, 99]), STRtree([one.footprint for one in town.buildings])
    low, high = (
        [town.bounds.west + 25, town.bounds.south + 25],
        [town.bounds.east - 25, town.bounds.north - 25],
    )
    while yards:
        place, angle, count = rng.uniform(low, high), rng.uniform(0.0, np.pi), int(rng.integers(2, 7))
        across = np.array([-np.sin(angle), np.cos(angle)])
        places = place + 3.6 * np.arange(count)[:, None] * across
        if len(tree.query(shapely.LineString(places), predicate="dwithin", distance=9.0)):
            continue
        yards -= 1
        for (x, y), level in zip(places.tolist(), town.terrain.at(places).tolist(), strict=True):
            size = (float(rng.choice([6.1, 12.2, 13.6])), 2.55, 2.7)
            yield ScannedSurfaces.of(upright_box(x, y, level + 0.9, size, angle), UNCLASSIFIED)


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
    true_faces = RoofFaces.of(
        FaceTable.of(
            [rings_of(face.polygon, face.coefficients) for one in scene.buildings for face in one.faces]
        ),
        [one.number for one in scene.buildings for _ in one.faces],
    )
    origin = np.array(scene.cloud.origin)
    names, _, shapes, columns = pyogrio.raw.read(path, layer="roof_planes", columns=["building_id"])
    owner = {rows[k]["id"]: k for k in range(len(rows))}
    built = RoofFaces.of(
        FaceTable.of(
            [
                [shapely.get_coordinates(ring, include_z=True)[:-1] - [*origin, 0.0] for ring in rings(shape)]
                for shape in shapely.from_wkb(shapes)
            ]
        ),
        [owner[name] for name in columns[0]],
    )
    houses = [shapely.transform(one.footprint, lambda xy: xy + origin) for one in scene.buildings]
    kinds = [one.kind for one in scene.buildings]
    in_row = STRtree([house for house, kind in zip(houses, kinds, strict=True) if kind == "row houses"])
    joined = shapely.union_all(shapely.buffer(houses, 0.01, join_style="mitre"))
    blocks = shapely.get_parts(shapely.buffer(joined, -0.01, join_style="mitre"))
    right = []
    for k in there:
        plan = plans[k]
        if len(in_row.query(plan, predicate="intersects")):
            units = [row["block_id"] == rows[k]["block_id"] for row in rows]
            plan = shapely.union_all(plans[units])
        drawn = is_drawn_right(plan, houses, blocks)
        right.append(drawn and near_share(plans[k], origin, built, true_faces) >= RIGHT_SHARE)
    return Judged([clean(rows[k]) for k in there], np.array(right))


def is_drawn_right(
    plan: shapely.Polygon, houses: Sequence[shapely.Polygon], blocks: NDArray[np.object_]
) -> bool:
    """Whether an outline is that of one house, or of houses side by side of one block."""
    hit = [house for house in houses if house.intersects(plan)]
    within = [house for house in hit if house.intersection(plan).area > 0.5 * house.area]
    least = max(5.0, 0.1 * plan.area)
    if not hit or np.count_nonzero(shapely.area(shapely.intersection(blocks, plan)) > least) > 1:
        return False
    true = max(
        [*hit, shapely.union_all(within)], key=lambda one: one.intersection(plan).area / one.union(plan).area
    )
    return min(rim_share(plan, true), rim_share(true, plan)) >= RIGHT_SHARE


def rim_share(one: shapely.Polygon, other: shapely.Polygon) -> float:
    """Share of the outline of one polygon within `RIM_M` of that of another."""
    places = shapely.points(shapely.get_coordinates(shapely.segmentize(one.boundary, STEP_M)))
    return float((shapely.distance(places, other.boundary) <= RIM_M).mean())


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
    return regression(traits, right, count, np.full(traits.shape[1], 0.5))


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
        for number, (town, scene) in enumerate(scenes()):
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
        f"A building is right when {RIGHT_SHARE:.0%} of its plan lie within {NEAR_M} m of the true roof, "
        f"and as much of its outline within {RIM_M:g} m of the true one and the other way round. A town that "
        "is left out is so with all towns of its kind (suburb, centre, mixed, crowns, yards, wings).",
    )


if __name__ == "__main__":
    main()
