"""Two epochs compared against the exact list of changes: `python -m benchmarks.accuracy.change [FOLDER]`.

The judging towns chose none of the constants; the others were looked at while the rules were made. With
`strips` for a folder it takes the strips of real scans, of which each two are epochs of one town, and the
even and odd pulses of one: nothing changed there.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import shapely

from benchmarks.scale.identical import write_part
from eaves.change.compare import compare
from eaves.change.verdict import BuildingChange
from eaves.formats import read_polygons
from eaves.pipeline import build
from eaves.run.manifest import read_facts
from eaves.simulate import Survey, later_survey, simulate_epochs, write_changes, write_simulation

TOWNS = (
    ("mixed, slope, 10 and 6/m²", 9101, 0.06, 0.3, 10.0, 6.0, "mixed", "slope"),
    ("suburb, hilly, 4 and 12/m², unchanged", 9102, 0.06, 0.0, 4.0, 12.0, "suburb", "hilly"),
    ("suburb, flat, 25 and 8/m²", 9103, 0.06, 0.3, 25.0, 8.0, "suburb", "flat"),
    ("centre, flat, 15 and 6/m², unchanged", 9104, 0.06, 0.0, 15.0, 6.0, "centre", "flat"),
    ("mixed, hilly, 5 and 10/m²", 9105, 0.1, 0.4, 5.0, 10.0, "mixed", "hilly"),
    ("suburb, slope, 8 and 5/m²", 9106, 0.1, 0.4, 8.0, 5.0, "suburb", "slope"),
    ("centre, flat, 6 and 9/m²", 9107, 0.1, 0.4, 6.0, 9.0, "centre", "flat"),
    ("mixed, flat, 4 and 6/m², unchanged", 9108, 0.15, 0.0, 4.0, 6.0, "mixed", "flat"),
    ("suburb, hilly, 7 and 4/m², unchanged", 9109, 0.15, 0.0, 7.0, 4.0, "suburb", "hilly"),
    ("centre, slope, 5 and 8/m², unchanged", 9110, 0.15, 0.0, 5.0, 8.0, "centre", "slope"),
    ("suburb, slope, 8 and 5/m²", 9111, 0.12, 0.4, 8.0, 5.0, "suburb", "slope"),
    ("centre, flat, 6 and 9/m²", 9112, 0.12, 0.4, 6.0, 9.0, "centre", "flat"),
    ("mixed, flat, 4 and 6/m², unchanged", 9113, 0.15, 0.0, 4.0, 6.0, "mixed", "flat"),
    ("suburb, hilly, 7 and 4/m²", 9114, 0.12, 0.4, 7.0, 4.0, "suburb", "hilly"),
    ("centre, slope, 5 and 8/m², unchanged", 9115, 0.15, 0.0, 5.0, 8.0, "centre", "slope"),
    ("mixed, flat, 4 and 6/m²", 9116, 0.12, 0.4, 4.0, 6.0, "mixed", "flat"),
)
"""Name, seed, area (km²), share that changes, densities of both, style, terrain."""
JUDGING = (9111, 9112, 9113, 9114, 9115, 9116)
"""Seeds of the towns that nobody looked at."""
SMALLEST_M2 = 10.0
"""Buildings from this area on count."""
GROUPS = {
    "new": "came or went",
    "demolished": "came or went",
    "extended": "extended or raised",
    "partly demolished": "extended or raised",
    "raised": "extended or raised",
    "lowered": "extended or raised",
    "roof replaced": "extended or raised",
}
"""What of the target's rows a change is counted in."""
SAME_SIGN = {
    **dict.fromkeys(("new", "extended"), "came"),
    **dict.fromkeys(("demolished", "partly demolished"), "went"),
    **dict.fromkeys(("raised", "lowered", "roof replaced"), "moved"),
}
"""A house in a row whose outline two runs divide otherwise is as well an extension of its neighbour: what
counts is where a roof came, went, or moved."""
NEAR_M = {"partly demolished": 8.0}
"""How far outside the new outline a change may lie: what went is outside."""


@dataclass
class Score:
    """Counts of one town."""

    found: Counter[str] = field(default_factory=Counter)
    named: Counter[str] = field(default_factory=Counter)
    """Of those found, the ones a row calls by the very word."""
    missed: Counter[str] = field(default_factory=Counter)
    right: Counter[str] = field(default_factory=Counter)
    false: Counter[str] = field(default_factory=Counter)
    sure: Counter[str] = field(default_factory=Counter)
    """Rows that tell a change, right or false, by their certainty."""
    buildings: int = 0
    unclear: int = 0
    misses: list[str] = field(default_factory=list)

    def __iadd__(self, other: Score) -> Score:
        for name in ("found", "named", "missed", "right", "false", "sure"):
            getattr(self, name).update(getattr(other, name))
        self.misses += other.misses
        self.buildings += other.buildings
        self.unclear += other.unclear
        return self


def score_town(folder: Path, old: Path, new: Path) -> Score:
    """Compare two runs, and hold what is told against changes.gpkg of a folder."""
    changes = compare(old, new, folder / "work").changes
    truth, _, rows, _ = read_polygons(folder / "changes.gpkg")
    told = [one for one in changes if one.verdict.patches]
    score = Score(buildings=len(rows))
    score.unclear = sum(one.verdict.change == "unclear" for one in changes)
    explained: set[int] = set()
    for polygon, row in zip(truth, rows, strict=True):
        if row["change"] == "unchanged" or polygon.area < SMALLEST_M2:
            continue
        near = shapely.buffer(polygon, NEAR_M.get(row["change"], 0.5))
        hits = [k for k, one in enumerate(told) if tells(one, row["change"], near)]
        explained.update(hits)
        (score.found if hits else score.missed)[GROUPS[row["change"]]] += 1
        words = {word for k in hits for word in (told[k].verdict.change, *told[k].verdict.also)}
        score.named[GROUPS[row["change"]]] += row["change"] in words
        if row["change"] not in words:
            size = f"{polygon.area:.0f} m², {row['area_m2']:+.0f} m², {row['height_m']:+.1f} m"
            score.misses.append(f"{row['change']} ({size}): {', '.join(sorted(words)) or 'nothing'} told")
    for k, one in enumerate(told):
        (score.right if k in explained else score.false)[GROUPS[one.verdict.change]] += 1
        score.sure[f"{one.certainty} {'right' if k in explained else 'false'}"] += 1
        if k not in explained:
            score.misses.append(
                f"false: {one.verdict.change}, {one.polygon.area:.0f} m²: {one.verdict.reason}"
            )
    return score


def tells(one: BuildingChange, change: str, near: shapely.Polygon) -> bool:
    """Whether a change that was told is of the kind and at the place of one that was made."""
    kinds = {SAME_SIGN[kind] for kind in (one.verdict.change, *one.verdict.also)}
    xy = np.concatenate(one.verdict.patches)
    return SAME_SIGN[change] in kinds and int(shapely.contains_xy(near, xy[:, 0], xy[:, 1]).sum()) >= 4


def make_town(folder: Path, town: Sequence[Any]) -> tuple[Path, Path]:
    """Simulate and build a town's two epochs, where that was not done; the runs."""
    _, seed, area, changed, first, second, style, terrain = town
    runs = folder / "old-run", folder / "new-run"
    if not all("found" in read_facts(run) for run in runs):
        epochs = simulate_epochs(area, terrain, seed=seed, style=style, changed=changed)
        surveys = (Survey(first), epochs.old, seed), (later_survey(second), epochs.new, seed + 1000)
        for name, (survey, there, own), run in zip(("old", "new"), surveys, runs, strict=True):
            scene = survey.scan(there, own)
            points = write_simulation(scene, folder / name)["points"]
            build(points, run, lod="0", outputs=("footprints", "rasters", "classified"), jobs=1)
        write_changes(epochs.changes, scene, folder)
    return runs


def main(place: Path) -> None:
    """Print a row a town, and the sums of those that were looked at and of those that judge."""
    parts = {"looked at": (Score(), Score()), "judging": (Score(), Score())}
    print(
        "| town | buildings | came or went | extended or raised | false | unclear |\n"
        "|---|---|---|---|---|---|"
    )
    for number, town in enumerate(TOWNS, 1):
        folder = place / f"j{number}"
        score = score_town(folder, *make_town(folder, town))
        print(row_of(f"{town[0]} ({town[1]})", score), flush=True)
        part = parts["judging" if town[1] in JUDGING else "looked at"][0 if town[3] else 1]
        part += score
    for name, (changed, quiet) in parts.items():
        print(f"\n{name}:")
        print_sums(changed, quiet)


def print_sums(changed: Score, quiet: Score) -> None:
    """Print the measures of towns that changed and of those that did not, and each miss."""
    for name in ("came or went", "extended or raised"):
        found, missed = changed.found[name], changed.missed[name]
        right, false = changed.right[name], changed.false[name]
        print(
            f"{name}: named {changed.named[name]} of {found + missed}, "
            f"completeness {found / max(found + missed, 1):.3f} ({found} of {found + missed}), "
            f"correctness {right / max(right + false, 1):.3f} ({right} of {right + false})"
        )
    wrong = sum(quiet.false.values()) + quiet.unclear
    share = wrong / max(quiet.buildings, 1)
    print(f"false changes in unchanged towns: {wrong} of {quiet.buildings} ({share:.2%})")
    unclear, all_of = changed.unclear + quiet.unclear, changed.buildings + quiet.buildings
    print(f"unclear: {unclear} of {all_of} ({unclear / max(all_of, 1):.2%})")
    for word in ("high", "medium", "low"):
        right, false = ((changed.sure + quiet.sure)[f"{word} {how}"] for how in ("right", "false"))
        print(f"certainty {word}: {right} of {right + false} rows right")
    print("\n".join(f"- {miss}" for miss in (*changed.misses, *quiet.misses)))


STRIPS = ("delft/ahn3.laz", "california/california.laz")
"""Scans that say of each point which strip it is of."""
HALVED = "delft/ahn3.laz"
"""The one of which even and odd pulses are two epochs, too."""
LEAST_POINTS = 10_000
"""What has fewer is no strip, but a rest of one."""


def compare_strips(place: Path) -> None:
    """Print what is said of each two strips of real scans."""
    print("| scan | strips | points | verdicts |\n|---|---|---|---|")
    for name in STRIPS:
        path = Path(os.environ["EAVES_DATA"]) / name
        las = laspy.read(path)
        source = np.asarray(las.point_source_id)
        numbers, counts = np.unique(source, return_counts=True)
        pulse = np.unique(las.gps_time, return_inverse=True)[1] % 2
        strips = {str(number): source == number for number in numbers[counts >= LEAST_POINTS].tolist()}
        halves = {"even": pulse == 0, "odd": pulse == 1} if name == HALVED else {}
        runs = {}
        for number, mine in {**strips, **halves}.items():
            file = place / path.stem / f"{number}.laz"
            write_part(las, mine, file)
            runs[number] = place / path.stem / f"run-{number}"
            build(str(file), runs[number], lod="0", outputs=("footprints", "classified"), jobs=1)
        for one, other in (*combinations(strips, 2), *combinations(halves, 2)):
            comparison = compare(runs[one], runs[other], place / path.stem / "work")
            points = " and ".join(f"{int({**strips, **halves}[number].sum()):,}" for number in (one, other))
            told = ", ".join(f"{count} {verdict}" for verdict, count in comparison.counts.items())
            print(f"| {path.stem} | {one} and {other} | {points} | {told} |", flush=True)


def row_of(name: str, score: Score) -> str:
    """A row of the table."""
    cells = [
        f"{score.found[group]} of {score.found[group] + score.missed[group]}, {score.named[group]} named"
        for group in ("came or went", "extended or raised")
    ]
    wrong = sum(score.false.values())
    return f"| {name} | {score.buildings} | {' | '.join(cells)} | {wrong} | {score.unclear} |"


if __name__ == "__main__":
    if sys.argv[1:] == ["strips"]:
        with tempfile.TemporaryDirectory() as folder:
            compare_strips(Path(folder))
    elif len(sys.argv) > 1:
        main(Path(sys.argv[1]))
    else:
        with tempfile.TemporaryDirectory() as folder:
            main(Path(folder))
