"""The weights of the signs of a party wall, and how sure walls are: logistic regression on scanned towns.

Prints what stands in `evidence.WEIGHTS` and in `certainty` of `eaves.units.row_walls` beside what is learned
on all towns, on the drawn ones and on the real one alone, and keeps what each finds in towns that it was not
learned on.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon, STRtree, affinity

from benchmarks.accuracy.detection_fit import regression
from benchmarks.accuracy.drawn_blocks import (
    SORTS,
    detached_house,
    drawn_row,
    large_building,
    single_buildings,
)
from benchmarks.accuracy.units import footprints_in, map_row
from benchmarks.table import as_markdown, keep
from eaves.detect import detect_buildings
from eaves.formats import read
from eaves.ground import classify_ground
from eaves.model import Bounds, Failure, Footprint, Mask, PointCloud, Points, Values
from eaves.model.scene import WALL
from eaves.outline import regularise_outlines, trace_outline
from eaves.raster.surfaces import make_scene
from eaves.simulate import scan_town, simulate_town, town_of_model
from eaves.simulate.objects.exact import ExactScene
from eaves.units import divide_block
from eaves.units.row_walls import division, evidence
from eaves.units.row_walls.division import RowUnits, border_odds, borders_between, label_unit_cells
from eaves.units.row_walls.evidence import SHAPE_SIGNS, WEIGHTS, Roofs, traits_of, wall_signs
from eaves.units.row_walls.method import WEIGHTS as SEVERAL
from eaves.units.row_walls.method import RowWalls, directions_of, odds_of_several, traits_of_block
from eaves.units.row_walls.rows import CELL_M, HouseRow, Plan, rows_of

DATA = Path(os.environ.get("EAVES_DATA", "data"))
DENSITY, SPARSE, NOISE = 10.0, 3.0, 0.03
PLACEMENTS_M = ((0.0, 0.0), (0.13, 0.29), (0.31, 0.17), (0.43, 0.47), (0.22, 0.08), (0.07, 0.37))
"""The towns are moved by so much and detected again: what parts of a cell decide is noise, and is learned as
such; Delft's rows are means over them."""
LEAST_HOUSE_M2 = 25.0
"""Smaller true buildings are sheds and do not make a block several."""
DRAWN = (
    (1, "centre", 0.06),
    (2, "centre", 0.06),
    (5, "mixed", 0.09),
    (6, "centre", 0.06),
    (7, "centre", 0.06),
)
"""Seed, style and area (km²) of the drawn towns."""
WALL_SHARE = 0.6
"""A wall of the truth runs through so much of the row's depth, or of a border."""
NEXT_TO = 4
"""Steps beside a true wall that count neither way."""
RIM = 8
"""Steps at both ends of a row that count neither way."""
CLOSE = 3
"""A wall found within so many steps of a true one is there."""
ASIDE_M = 0.75
"""The truth is asked this far on both sides of a border."""


@dataclass(frozen=True, eq=False)
class Detected:
    """A detected block: roof points (N, 3), their heights over the terrain (N,), outline, spacing (m), and
    intensities (N,) where the scan has them."""

    points: Points
    height: Values
    outline: Polygon
    spacing: float
    intensity: Values | None = None


def blocks_of(cloud: PointCloud) -> list[Detected]:
    """The blocks that a run would divide."""
    scene = make_scene(classify_ground(cloud), Bounds.of(cloud.xyz).buffered(3.0))
    regions = detect_buildings(scene)
    roof = np.ones(len(cloud), np.bool_) if regions.part is None else regions.part != WALL
    twice = cloud.return_number < cloud.number_of_returns if cloud.has_returns else np.zeros(len(cloud), bool)
    groups, traced = [], []
    for number in range(1, int(regions.label.max(initial=0)) + 1):
        mine = (regions.label == number) & roof
        boundary = trace_outline(cloud.xyz[mine], scene.spacing, not_last=twice[mine])
        if not isinstance(boundary, Failure):
            groups.append(cloud[mine])
            traced.append(boundary)
    return [
        Detected(
            some.xyz,
            some.xyz[:, 2] - scene.dtm.at(some.xyz),
            one.polygon,
            scene.spacing,
            some.fields.get("intensity"),
        )
        for some, one in zip(groups, regularise_outlines(traced), strict=True)
        if isinstance(one, Footprint)
    ]


def placed_blocks(cloud: PointCloud, moves: Sequence[tuple[float, float]]) -> Iterator[list[Detected]]:
    """The blocks that a run would divide, for each placement (m) of the points; each where it was."""
    for move in moves:
        there = np.array([*move, 0.0])
        yield [
            replace(one, points=one.points - there, outline=affinity.translate(one.outline, *(-there[:2])))
            for one in blocks_of(replace(cloud, xyz=cloud.xyz + there))
        ]


def true_walls(row: HouseRow, tree: STRtree) -> tuple[Mask, Mask]:
    """At which steps (S + 1,) a wall of the truth runs along the row's walls, and which steps count."""
    s, t = row.grid()
    inside = (t >= row.first) & (t < row.last)
    owner = np.full(s.shape, -1)
    owner[inside] = owners_of(np.column_stack(row.place(s[inside], t[inside])), tree)
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


def owners_of(xy: NDArray[np.float64], tree: STRtree) -> NDArray[np.int64]:
    """The true building (N,) at places (N, 2), -1 where there is none."""
    owner = np.full(len(xy), -1)
    place, building = tree.query(shapely.points(xy), predicate="within")
    owner[place] = building
    return owner


def divided(block: Detected) -> tuple[Plan, list[HouseRow], Roofs]:
    """The plan, the rows and the roofs of a block."""
    method = RowWalls()
    plan = Plan.of(block.outline, block.points)
    directions = directions_of(block.outline, method.shortest_front)
    return plan, list(rows_of(plan, directions, method)), Roofs.of(block.points)


def asked(blocks: Sequence[Detected], scene: ExactScene) -> Iterator[tuple[Detected, STRtree]]:
    """The blocks whose walls are known, with the true buildings: the truth takes a row of houses for one."""
    truth = [one.footprint for one in scene.buildings if one.footprint.area > 15.0]
    whole = shapely.union_all([one.footprint for one in scene.buildings if one.kind == "row houses"])
    for block in blocks:
        if not block.outline.intersects(whole):
            yield block, STRtree(truth)


def samples(blocks: Sequence[Detected], scene: ExactScene) -> tuple[NDArray[np.float64], Mask]:
    """Traits (N, K) and truth (N,) of all steps of all rows."""
    traits, walls = [np.zeros((0, SHAPE_SIGNS))], [np.zeros(0, bool)]
    for block, tree in asked(blocks, scene):
        _, rows, roofs = divided(block)
        for row in rows:
            wall, counts = true_walls(row, tree)
            traits.append(traits_of(wall_signs(row, block.points, roofs.noise))[counts, :SHAPE_SIGNS])
            walls.append(wall[counts])
    return np.concatenate(traits), np.concatenate(walls)


Sure = list[tuple[float, bool]]


def found_walls(blocks: Sequence[Detected], scene: ExactScene) -> tuple[Sure, Sure]:
    """Log-odds and truth of the walls found in rows, and of the borders between rows."""
    method = RowWalls()
    walls: Sure = []
    borders: Sure = []
    for block, tree in asked(blocks, scene):
        plan, rows, roofs = divided(block)
        if not rows:
            continue
        odds, shapes = zip(*(roofs.wall_odds(row) for row in rows), strict=True)
        by_shape = list(map(method.walls_of, rows, shapes))
        if odds_of_several(by_shape, shapes, len(block.points), block.outline.area) < 0.0:
            continue
        found = list(map(method.walls_of, rows, odds))
        for units in found:
            walls += walls_in_row(units, tree)
        label = np.zeros(plan.main.shape, np.int32)
        label_unit_cells(plan, label, found, 1)
        owner = np.repeat(np.arange(len(found)), [len(units.walls) + 1 for units in found])
        for (a, b), places in borders_between(label).items():
            if owner[a - 1] == owner[b - 1] or len(places) * CELL_M < method.shortest_border:
                continue
            there = border_is_wall(plan, places, tree)
            if there is not None:
                odds = border_odds(plan, places, roofs)
                borders.append((float(np.clip(odds, -division.MOST_ODDS, division.MOST_ODDS)), there))
    return walls, borders


def walls_in_row(units: RowUnits, tree: STRtree) -> Sure:
    """Log-odds and truth of the inner walls of a row."""
    row, told = units.row, []
    true, _ = true_walls(row, tree)
    near = np.convolve(true, np.ones(2 * CLOSE + 1), "same") > 0
    for wall, sure in zip(units.walls.tolist(), units.certainty.tolist(), strict=True):
        middle = 0.5 * (row.first[wall - 1] + row.last[wall - 1])
        beside = row.place(CELL_M * np.array([wall - 4.0, wall + 4.0]), np.array([middle, middle]))
        if owners_of(np.column_stack(beside), tree).min() >= 0:
            with np.errstate(divide="ignore"):
                odds = float(np.log(sure) - np.log1p(-sure))
            told.append((float(np.clip(odds, -division.MOST_ODDS, division.MOST_ODDS)), bool(near[wall])))
    return told


def border_is_wall(plan: Plan, places: NDArray[np.float64], tree: STRtree) -> bool | None:
    """Whether different true buildings stand on the two sides of a border; None where that is not known."""
    xy = plan.places(*places.T)
    _, _, axes = np.linalg.svd(xy - xy.mean(axis=0), full_matrices=False)
    aside = ASIDE_M * np.array([-axes[0][1], axes[0][0]])
    one, two = owners_of(xy + aside, tree), owners_of(xy - aside, tree)
    known = (one >= 0) & (two >= 0)
    return bool((one != two)[known].mean() > WALL_SHARE) if known.mean() >= 0.5 else None


Known = dict[str, tuple[NDArray[np.float64], Mask]]


def blocks_known(towns: dict[str, ExactScene], blocks: dict[str, list[Detected]]) -> Known:
    """Traits (N, 5) of blocks in which walls are found, and whether they are several buildings (N,), by kind:
    the blocks of towns, and drawn rows, houses and large buildings.
    """
    found: dict[str, list[tuple[NDArray[np.float64], bool]]] = {}

    def note(kind: str, block: Detected, several: bool) -> None:
        traits = block_traits(block)
        if traits is not None:
            found.setdefault(kind, []).append((traits, several))

    for name, scene in towns.items():
        for block, tree in asked(blocks[name], scene):
            within = [
                one
                for one in tree.geometries[tree.query(block.outline, predicate="intersects")]
                if one.area > LEAST_HOUSE_M2 and one.intersection(block.outline).area > 0.5 * one.area
            ]
            note("delfshaven" if "delfshaven" in name else "drawn towns", block, len(within) > 1)
    for density in (10.0, 5.0, 3.0, 1.5):
        for kind, draw, count in (
            ("drawn houses", detached_house, 300),
            ("drawn large buildings", large_building, 100 if density in (10.0, 3.0) else 0),
        ):
            for one in single_buildings(draw, density, count, seed=9):
                note(kind, Detected(one.points, one.points[:, 2], one.outline, one.spacing), False)
    for density in (10.0, 5.0):
        for place, sort in enumerate(SORTS[:-1]):
            for seed in range(100, 110):
                points, houses = drawn_row(sort, density, np.random.default_rng([seed, place]))
                outline = shapely.union_all(houses)
                note("drawn rows", Detected(points, points[:, 2], outline, density**-0.5), True)
    return {
        kind: (np.array([traits for traits, _ in told]), np.array([several for _, several in told]))
        for kind, told in found.items()
    }


def several_rows(known: Known) -> Iterator[dict[str, object]]:
    """One line for each kind of block: what is divided with weights of the others, and with those in use."""
    for kind, (traits, several) in known.items():
        others = [known[other] for other in known if other != kind]
        learned = logistic(*(np.concatenate([other[k] for other in others]) for k in (0, 1)))
        row: dict[str, object] = {"blocks with walls": kind, "one": int((~several).sum())}
        row["several"] = int(several.sum())
        for name, weight in (("left out", learned), ("in use", np.array(list(SEVERAL.values())))):
            divided = traits @ weight > 0.0
            row[f"one, divided, {name}"] = int((divided & ~several).sum())
            row[f"several, divided, {name}"] = int((divided & several).sum())
        yield row


def block_traits(block: Detected) -> NDArray[np.float64] | None:
    """The traits (5,) that tell one building from several, None for a block in which no wall is found."""
    method = RowWalls()
    _, rows, roofs = divided(block)
    odds = [roofs.wall_odds(row)[1] for row in rows]
    found = [method.walls_of(row, own) for row, own in zip(rows, odds, strict=True)]
    if not any(len(units.walls) for units in found):
        return None
    return traits_of_block(found, odds, len(block.points), block.outline.area)


def logistic(traits: NDArray[np.float64], truth: Mask) -> NDArray[np.float64]:
    """Weights (K,) of traits (N, K) that all count alike, with a small ridge."""
    return regression(traits, truth, np.ones(len(truth)), np.full(traits.shape[1], 0.1))


def line_of(told: Sure) -> list[float]:
    """Offset and slope of the calibrated log-odds."""
    odds, truth = np.array(told, float).T
    return [
        round(float(one), 2) for one in logistic(np.column_stack([np.ones(len(odds)), odds]), truth > 0.5)
    ]


def brier(told: Sure, line: Sequence[float]) -> float:
    """Mean square of the difference between the calibrated probabilities and the truth."""
    odds, truth = np.array(told, float).T
    return float(np.mean((1.0 / (1.0 + np.exp(-line[0] - line[1] * odds)) - truth) ** 2))


def divided_all(blocks: Sequence[Detected]) -> list[Polygon]:
    """The units of all blocks."""
    return [
        part
        for one in blocks
        for part in divide_block(
            one.points, one.height, one.outline, one.spacing, intensity=one.intensity
        ).parts
    ]


def main() -> None:
    """Print the weights learned beside those in use, and keep what they find where they were not learned."""
    model = town_of_model(DATA / "towns" / "delfshaven.city.json", trees=1.0)
    towns = {"delfshaven": scan_town(model, DENSITY, NOISE)}
    for seed, style, area in DRAWN:
        town = simulate_town(area, style=style, seed=seed)  # type: ignore[arg-type]
        towns[f"{style} {seed}"] = scan_town(town, DENSITY, NOISE, seed=seed)
    placed = {name: list(placed_blocks(scene.cloud, PLACEMENTS_M)) for name, scene in towns.items()}
    blocks = {name: list(chain.from_iterable(several)) for name, several in placed.items()}
    known = {name: samples(blocks[name], towns[name]) for name in towns}
    sparse = {"delfshaven, sparse": scan_town(model, SPARSE, NOISE)}
    for seed, style, area in DRAWN:
        town = simulate_town(area, style=style, seed=seed)  # type: ignore[arg-type]
        sparse[f"{style} {seed}, sparse"] = scan_town(town, SPARSE, NOISE, seed=seed)
    both = {**towns, **sparse}
    thin = {name: list(placed_blocks(scene.cloud, PLACEMENTS_M)) for name, scene in sparse.items()}
    kinds = blocks_known(
        both, {**blocks, **{name: list(chain.from_iterable(several)) for name, several in thin.items()}}
    )
    learned = logistic(*(np.concatenate([told[k] for told in kinds.values()]) for k in (0, 1)))
    print(
        as_markdown(
            [
                {"block": trait, "in use": used, "learned": round(float(one), 2)}
                for (trait, used), one in zip(SEVERAL.items(), learned, strict=True)
            ]
        )
    )
    keep(
        "unit-several",
        "Units: one building or several, learned and left out",
        list(several_rows(kinds)),
        "python -m benchmarks.accuracy.unit_weights",
        "Blocks in which the division finds a wall: whether they are divided at all. Left out: with weights "
        "learned on all other kinds. Woodford's houses are in none; the traits were chosen with them in "
        "view.",
    )
    cloud = read(DATA / "delft" / "ahn3.laz")
    placed["delft"] = list(placed_blocks(cloud, PLACEMENTS_M))
    there = np.array(cloud.origin)
    maps = {
        "delft": [
            shapely.transform(one, lambda xy: xy - there)
            for one in footprints_in(DATA / "delft" / "footprints.gpkg")
        ],
        "delfshaven": [one.footprint for one in towns["delfshaven"].buildings],
    }
    drawn = [name for name in towns if name != "delfshaven"]
    choices = {"drawn towns": drawn, "delfshaven": ["delfshaven"], "all": list(towns)}
    weights = {
        choice: logistic(*(np.concatenate([known[name][k] for name in names]) for k in (0, 1)))
        for choice, names in choices.items()
    }
    print(
        as_markdown(
            [
                {"sign": sign, "in use": used, **{c: round(float(weights[c][k]), 2) for c in choices}}
                for k, (sign, used) in enumerate(list(WEIGHTS.items())[:SHAPE_SIGNS])
            ]
        )
    )
    used, rows = dict(evidence.WEIGHTS), []
    for choice, weight in [*weights.items(), ("in use", np.array(list(used.values())))]:
        evidence.WEIGHTS.update(zip(used, weight.tolist(), strict=False))
        for name, truth in maps.items():
            learned_on = choices.get(choice, list(towns))
            lines = [map_row(name, divided_all(some), truth) for some in placed[name]]
            row: dict[str, object] = {"weights from": choice, "data": name}
            for measure in ("found", "F1 at .5", "F1 at .7"):
                values = [float(str(line[measure])) for line in lines]
                row[measure] = f"{np.mean(values):.3f} ± {np.std(values):.3f}"
            rows.append({**row, "left out": "yes" if name not in learned_on else "no"})
    told = {name: found_walls(blocks[name], towns[name]) for name in towns}
    for k, (kind, line) in enumerate({"rows": division.OF_ROWS, "borders": division.OF_BORDERS}.items()):
        lines = {c: line_of([one for name in names for one in told[name][k]]) for c, names in choices.items()}
        print(f"certainty, {kind}: in use {line}, learned {lines}")
        for choice, test in (("drawn towns", "delfshaven"), ("all", "delfshaven")):
            print(
                f"  Brier score on {test}: {brier(told[test][k], lines[choice]):.3f} from {choice}, "
                f"{brier(told[test][k], (0.0, 1.0)):.3f} as found"
            )
    keep(
        "unit-weights",
        "Units: the weights of walls, learned and left out",
        rows,
        "python -m benchmarks.accuracy.unit_weights",
        "Means and standard deviations over six placements of the points; weights are learned on all six. "
        "Delft is in none of the sets: its rows are left-out figures of the weights, but the signs were "
        "chosen with Delft in view. The narrowest width was chosen on "
        "delfshaven and drawn towns. Blocks are detected in one piece here, by a run in "
        "`python -m benchmarks.accuracy.units`.",
    )


if __name__ == "__main__":
    main()
