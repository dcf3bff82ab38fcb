"""The walls between houses of two real towns: how well they are told, by weights that never saw the town.

The walls of a map's houses are set beside lines 2.2 m inside them: the area under the curve of the log-odds.
Then the blocks are divided, and the units held against the map. What drawn towns do not show, rises and
reflectance, is weighed by the walls of the other town (`left out`), without reflectance (`no intensity`), or
not at all (`drawn signs`); the shipped weights (`in use`) have seen both. The other signs have the weights of
drawn towns throughout.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.stats import rankdata
from shapely import LineString, Polygon, STRtree

from benchmarks.accuracy.unit_weights import PLACEMENTS_M, Detected, divided_all, placed_blocks
from benchmarks.accuracy.units import footprints_in, map_row
from benchmarks.table import keep
from eaves.formats import read
from eaves.geometry.rings import polygon_parts
from eaves.model import Mask, Values
from eaves.units.row_walls import evidence
from eaves.units.row_walls.evidence import CELL_M, SHAPE_SIGNS, Roofs, traits_of, wall_signs
from eaves.units.row_walls.rows import HouseRow

TOWNS = {"delft": ("ahn3.laz", "footprints.gpkg", 6), "rows": ("points.laz", "map.gpkg", 2)}
"""Points, map, and how many placements are divided."""
SHORTEST_M, HOUSE_M2 = 5.0, 25.0
"""Walls and houses that are smaller are not asked about."""
INSIDE_M, CLEAR_M = 2.2, 1.4
"""A false line lies so far inside a house, and at least this far from any outline."""
HALF_M = 5.0
"""Ground on either side of a line that is looked at (m)."""
NEAR = 2
"""Steps by which a map's wall may be off."""
RIDGE, TURNS = 0.3, 8


@dataclass(frozen=True, eq=False)
class Town:
    """A town's blocks by placement, and its map about the same origin."""

    name: str
    placed: list[list[Detected]]
    houses: list[Polygon]

    @classmethod
    def of(cls, data: Path, name: str) -> Town:
        """The town in a folder of the data."""
        points, houses, placements = TOWNS[name]
        cloud = read(data / name / points, fields=("intensity",))
        there = np.array(cloud.origin)
        shapes = [
            shapely.transform(one, lambda xy: xy - there) for one in footprints_in(data / name / houses, None)
        ]
        whole = [part for shape in shapes for part in polygon_parts(shape)]
        return cls(name, list(placed_blocks(cloud, PLACEMENTS_M[:placements])), whole)


def party_walls(houses: Sequence[Polygon]) -> Iterator[NDArray[np.float64]]:
    """Ends (2, 2) of the straight walls that two houses share."""
    large = np.array([one for one in houses if one.area >= HOUSE_M2], object)
    first, second = STRtree(large).query(large, predicate="dwithin", distance=0.2)
    for a, b in zip(first[first < second], second[first < second], strict=True):
        common = shapely.intersection(large[a].boundary, shapely.buffer(large[b], 0.15))
        lines = [part for part in shapely.get_parts(common) if part.geom_type == "LineString"]
        pieces = [np.asarray(line.coords)[k : k + 2] for line in lines for k in range(len(line.coords) - 1)]
        if not pieces:
            continue
        longest = max(pieces, key=lambda ends: float(np.hypot(*np.diff(ends, axis=0)[0])))
        way = np.diff(longest, axis=0)[0]
        way = way / np.hypot(*way)
        away = [(ends - longest[0]) @ np.array([-way[1], way[0]]) for ends in pieces]
        along = [
            (ends - longest[0]) @ way
            for ends, off in zip(pieces, away, strict=True)
            if np.abs(off).max() < 0.5
        ]
        low, high = min(map(np.min, along)), max(map(np.max, along))
        if high - low >= SHORTEST_M:
            yield longest[0] + np.array([[low], [high]]) * way


def asked_lines(town: Town) -> Iterator[tuple[Detected, NDArray[np.float64], bool]]:
    """Ends (2, 2) of true walls and of false lines, each with its block and the truth."""
    blocks, houses = town.placed[0], np.array(town.houses, object)
    tree = STRtree([one.outline for one in blocks])
    near = STRtree(houses)
    for ends in party_walls(town.houses):
        way = np.diff(ends, axis=0)[0]
        side = INSIDE_M * np.array([way[1], -way[0]]) / np.hypot(*way)
        for shift, true in ((0.0 * side, True), (side, False), (-side, False)):
            line = LineString(ends + shift)
            about = houses[near.query(line, predicate="intersects")]
            within = [one for one in about if one.intersection(line).length > 0.85 * line.length]
            if not true and (
                not within
                or min(one.boundary.distance(line.interpolate(0.5, normalized=True)) for one in within)
                < CLEAR_M
            ):
                continue
            for k in tree.query(line, predicate="intersects"):
                if blocks[k].outline.intersection(line).length > 0.8 * line.length:
                    yield blocks[k], ends + shift, true


def traits_at(block: Detected, roofs: Roofs, ends: NDArray[np.float64]) -> Values:
    """The traits (2 · `NEAR` + 1, K) of a line and of its neighbours."""
    across = np.diff(ends, axis=0)[0]
    length = float(np.hypot(*across))
    across = across / length
    along = np.array([across[1], -across[0]])
    steps = round(2.0 * HALF_M / CELL_M)
    row = HouseRow(ends[0] - HALF_M * along, along, across, np.zeros(steps), np.full(steps, length))
    s, t = row.coordinates(block.points[:, :2])
    here = (s > -1.0) & (s < 2.0 * HALF_M + 1.0) & (t > -1.0) & (t < length + 1.0)
    seen = None if roofs.reflectance is None else roofs.reflectance[here]
    traits = traits_of(wall_signs(row, block.points[here], roofs.noise, seen))
    return traits[steps // 2 - NEAR : steps // 2 + NEAR + 1]


def lines_of(town: Town) -> tuple[Values, Mask]:
    """The traits (L, steps, K) of lines and whether each is a wall (L,)."""
    roofs = {id(one): Roofs.of(one.points, one.intensity) for one in town.placed[0]}
    told = [(traits_at(block, roofs[id(block)], ends), true) for block, ends, true in asked_lines(town)]
    return np.array([traits for traits, _ in told]), np.array([true for _, true in told])


def learned(samples: Sequence[tuple[Values, Mask]], drawn: Values) -> Values:
    """The weights (K,): of `drawn` signs as they are, of the others by logistic regression upon those.

    A map's wall may be off by a step or two: each line counts where its odds are best, found in turns.
    """
    weights = drawn.copy()
    traits, truth = (np.concatenate([one[k] for one in samples]) for k in (0, 1))
    sign = np.where(truth, -1.0, 1.0)
    for _ in range(TURNS):
        best = traits[np.arange(len(truth)), (traits @ weights).argmax(axis=1)]
        known, free = best[:, :SHAPE_SIGNS] @ drawn[:SHAPE_SIGNS], best[:, SHAPE_SIGNS:]

        def loss(own: Values, known: Values = known, free: Values = free) -> float:
            return float(np.logaddexp(0.0, sign * (known + free @ own)).sum() + RIDGE * (own**2).sum())

        weights[SHAPE_SIGNS:] = minimize(loss, weights[SHAPE_SIGNS:]).x
    return weights


def area_under(odds: Values, truth: Mask) -> float:
    """Area under the curve of odds (N,): the share of pairs of a wall and no wall that they put in order."""
    ranks, walls = rankdata(odds), int(truth.sum())
    return float((ranks[truth].sum() - walls * (walls + 1) / 2) / (walls * (len(truth) - walls)))


def town_rows(
    town: Town, lines: tuple[Values, Mask], weights: dict[str, Values]
) -> Iterator[dict[str, object]]:
    """One line for each set of weights."""
    traits, truth = lines
    used = dict(evidence.WEIGHTS)
    for name, weight in weights.items():
        evidence.WEIGHTS.update(zip(used, weight.tolist(), strict=True))
        dark = weight[-1] == 0.0
        blocks = [[replace(one, intensity=None) if dark else one for one in some] for some in town.placed]
        found = [map_row(town.name, divided_all(some), town.houses) for some in blocks]
        row: dict[str, object] = {"data": town.name, "weights": name}
        row |= dict(zip(("rise", "contrast"), np.round(weight[SHAPE_SIGNS:], 2).tolist(), strict=True))
        row["AUC"] = round(area_under((traits @ weight).max(axis=1), truth), 3)
        for measure in ("found", "F1 at .5", "F1 at .7"):
            values = [float(str(line[measure])) for line in found]
            row[measure] = f"{np.mean(values):.3f} ± {np.std(values):.3f}"
        yield row
    evidence.WEIGHTS.update(used)


def main() -> None:
    """Both towns, by each set of weights."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    towns = {name: Town.of(parser.parse_args().data, name) for name in TOWNS}
    samples = {name: lines_of(town) for name, town in towns.items()}
    drawn = np.array(list(evidence.WEIGHTS.values()))
    signs = np.where(np.arange(len(drawn)) < SHAPE_SIGNS, drawn, 0.0)
    every = learned(list(samples.values()), drawn)
    print("in use", dict(evidence.WEIGHTS), "learned on both", np.round(every, 2))
    rows = []
    for name, town in towns.items():
        other = learned([told for place, told in samples.items() if place != name], drawn)
        dark = np.concatenate([other[:-1], [0.0]])
        weights = {"drawn signs": signs, "left out, no intensity": dark, "left out": other, "in use": drawn}
        rows += list(town_rows(town, samples[name], weights))
    keep(
        "walls",
        "Walls",
        rows,
        "python -m benchmarks.accuracy.walls DATA",
        "AUC: walls of the map beside lines 2.2 m inside its houses. F1: units of the blocks against the "
        "map, means over placements of the points (six, two). The map of `rows` (Amsterdam) was seen by the "
        "forms of the signs, as Delft's was; left out are the weights.",
    )


if __name__ == "__main__":
    main()
