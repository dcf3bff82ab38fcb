"""Roofs of which a part shows no return, and given outlines in which no roof stands.

A model is right where its height and its volume are within a tenth of the truth and no corner of it lies over
its returns. It is marked as not known where its trust is not high and its row names the reason: what no point
shows, what no point supports, or that none is a roof (`MARKED`). The judge counts both as right: what is not
known of one building is said in its row, in the report and in the list for review, not in the messages of a
run. So no message is looked for, and a model that is neither is wrong in silence.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path

import numpy as np
import pyogrio
import shapely
from shapely import affinity

from benchmarks.accuracy.over_returns import risen
from benchmarks.accuracy.unshown_houses import (
    GROUND,
    PLACE,
    Crown,
    House,
    Returns,
    draw_house,
    scan,
    tree_beside,
    write_plans,
    write_returns,
)
from benchmarks.scale.silence import Drawn, Variant

KIND, SIDE, DENSITY, NOISE = "unseen", 50.0, 10.0, 0.03
"""The kind, side of a scene (m), pulses/m² and noise (m)."""
OFF = 0.1
"""Share by which height and volume may be off."""
NO_MESSAGE = r"(?!)"
"""Matches nothing."""
MARKED = re.compile(
    "no point|not supported|no ground was seen|nothing was seen|no return|no roof|no model|RMSE|within 0.2 m"
)
"""What a row must say of a building that is not known."""
PLACES = (16.0, 25.0), (38.0, 25.0)
"""The house that is judged and one of which all is seen."""


def judge_of(house: House | None, returns: Returns, plan: shapely.Polygon) -> Callable[[Path], str]:
    """The judge of the building that stands on a plan; the house may be none at all."""

    def judge(out: Path) -> str:
        table = pyogrio.read_dataframe(out / "footprints.gpkg", layer="footprints")
        there = affinity.translate(plan, *PLACE)
        shared = [0.0 if shape is None else shapely.area(shape & there) for shape in table.geometry]
        if not shared or max(shared) < 0.2 * plan.area:
            return "" if house is None else "the house is not there"
        row = table.iloc[int(np.argmax(shared))]
        rises = risen(out, returns.xyz + (*PLACE, 0.0)).get(str(row.id), 0.0)
        if rises:
            return f"{rises:.1f} m over its returns"
        reason = f"{row.review_reason} {row.failure_code} {row.failure_reason}"
        if row.trust != "high" and MARKED.search(reason):
            return ""
        if house is None:
            return (
                f"a building of {row.h_max - row.h_ground:.1f} m where none is, trust {row.trust}: {reason}"
            )
        high = row.h_max - row.h_ground
        off = [
            f"{name} {is_:.0f} for {true:.0f}"
            for name, is_, true in (("m³", row.volume_m3, house.volume), ("m", high, house.ridge))
            if not abs(is_ / true - 1.0) <= OFF
        ]
        return f"{', '.join(off)}, trust {row.trust}: {row.review_reason}" if off else ""

    return judge


def written(
    folder: Path,
    returns: Returns,
    house: House | None,
    plan: shapely.Polygon,
    other: House | None,
    given: bool,
) -> Drawn:
    """The variant of a scene, with the plan of what is judged and that of the other house as a map."""
    words = ["build", str(write_returns(folder / "tile.laz", returns)), "-o", "OUT"]
    if given:
        plans = [plan] if other is None else [plan, other.plan]
        words += ["--footprints", str(write_plans(folder / "map.gpkg", plans)), "--id-field", "id"]
    return Drawn(words, judge_of(house, returns, plan), NO_MESSAGE)


def lacking(roof: str, part: str, given: bool, tree: bool = False) -> Variant:
    """A house that shows nothing of a part."""

    def draw(folder: Path, rng: np.random.Generator) -> Drawn:
        house = draw_house(roof, part, PLACES[0], rng)
        other = draw_house("gable", "nothing", PLACES[1], rng)
        crowns = [tree_beside(house, rng)] if tree else []
        returns = scan([house, other], crowns, SIDE, DENSITY, NOISE, rng)
        return written(folder, returns, house, house.plan, other, given)

    name = f"{roof}, {part} unseen" + (", beside a tree" if tree else "") + (", map" if given else "")
    return Variant(KIND, name, draw)


def under_crowns(
    name: str, high: float, crowns: int, share: float = 1.0, pierced: float = 0.4, split: float = 0.6
) -> Variant:
    """A given outline of 3 × 4 m under crowns, with a shed so high in it, or none (0); `share` is how large
    the crowns are, `pierced` and `split` how many pulses go through, and have one more echo."""

    def draw(folder: Path, rng: np.random.Generator) -> Drawn:
        shed = draw_house("flat", "nothing", PLACES[0], rng)
        plan = affinity.translate(shapely.box(-1.5, -2.0, 1.5, 2.0), *PLACES[0])
        roof = type(shed.roof)(shapely.box(-1.5, -2.0, 1.5, 2.0), shed.roof.faces, shed.roof.join)
        shed = House("flat", "nothing", roof, PLACES[0], 0.0, high, shed.hidden)
        other = draw_house("gable", "nothing", PLACES[1], rng)
        trees = [
            Crown(
                (
                    PLACES[0][0] + rng.uniform(-1, 1),
                    PLACES[0][1] + rng.uniform(-1, 1),
                    GROUND + rng.uniform(8, 13),
                ),
                share * rng.uniform(3.0, 4.5),
                share * rng.uniform(2.5, 4.0),
                pierced,
                split,
            )
            for _ in range(crowns)
        ]
        houses = [shed, other] if high else [other]
        returns = scan(houses, trees, SIDE, DENSITY, NOISE, rng)
        return written(folder, returns, shed if high else None, plan, other, True)

    return Variant(KIND, name, draw)


def hedge(high: float) -> Variant:
    """A given outline over a hedge."""

    def draw(folder: Path, rng: np.random.Generator) -> Drawn:
        other = draw_house("gable", "nothing", PLACES[1], rng)
        plan = affinity.translate(shapely.box(-1.0, -5.0, 1.0, 5.0), *PLACES[0])
        returns = scan([other], [], SIDE, DENSITY, NOISE, rng)
        inside = np.flatnonzero(shapely.contains_xy(plan, *returns.xyz[:, :2].T))
        leafy = inside[rng.uniform(size=len(inside)) < 0.9]
        returns.xyz[leafy, 2] += high * rng.uniform(0.4, 1.0, len(leafy))
        return written(folder, returns, None, plan, other, True)

    return Variant(KIND, f"a hedge of {high:g} m, map", draw)


def variants() -> Iterator[Variant]:
    """The variants of this kind."""
    parts = ("a face", "half a face", "a corner", "a strip")
    for roof, part in product(("gable", "hip", "L", "flat", "two levels"), parts):
        yield lacking(roof, part, given=True)
    for roof, part in product(("gable", "flat"), parts):
        yield lacking(roof, part, given=False)
    for roof, given in product(("gable", "hip"), (True, False)):
        yield lacking(roof, "a face", given, tree=True)
    yield under_crowns("a shed under a crown, map", 2.1, 1)
    yield under_crowns("a shed under three crowns, map", 2.4, 3)
    yield under_crowns("nothing under a crown, map", 0.0, 1)
    yield under_crowns("nothing under two crowns, map", 0.0, 2)
    yield under_crowns("nothing under a small crown, map", 0.0, 1, 0.6)
    yield under_crowns("a shed under a crown of single echoes, map", 2.1, 1, pierced=0.2, split=0.0)
    yield under_crowns("nothing under a crown of single echoes, map", 0.0, 1, pierced=0.2, split=0.0)
    yield under_crowns("nothing under a dense crown, map", 0.0, 2, pierced=0.1, split=0.3)
    yield under_crowns("bare ground, map", 0.0, 0)
    yield hedge(1.8)
    yield hedge(3.5)
    yield lacking("gable", "nothing", given=True)
    yield lacking("gable", "nothing", given=False)
    yield lacking("gable", "a hole", given=True)
    yield lacking("flat", "a hole", given=True)
    yield lacking("L", "nothing", given=True, tree=True)
