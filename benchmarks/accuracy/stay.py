"""Do outlines stay where nothing changes? Builds of a survey as it is, shaken, moved, turned and mirrored.

Each survey is built from its bare points by `eaves build`, and again after a change that leaves ground, roofs
and walls as they are. `stay` is the share of the outlines of 20 m² and more that one of the other build meets
with an intersection over union of .85, `back` the same the other way. Neither is a goal alone: who never
divides a row, or keeps large buildings only, stays; so the number of outlines and their F1 against a map or
the drawn town stand beside them, as means over all builds with their spread.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from benchmarks.accuracy.units import footprints_in, map_row
from benchmarks.survey_variants import SOMEWHERE_M, Survey, read_survey, survey_of
from benchmarks.table import keep
from eaves.pipeline import build
from eaves.simulate import scan_town, simulate_town

LEAST_M2, SAME = 20.0, 0.85
SHAKES = 2
MOVES_M = ((0.13, 0.29), (0.31, 0.17), (0.43, 0.47), (20.37, 7.61))
TOWNS = {"drawn centre": ("centre", 61), "drawn mixed town": ("mixed", 62)}
"""Style and seed of towns that chose nothing."""


@dataclass(frozen=True, eq=False)
class Changed:
    """A change by its name: x, y become `turn` (2, 2) · (x, y) + `move` (2,), shaken by `noise` (m)."""

    name: str
    turn: NDArray[np.float64]
    move: NDArray[np.float64]
    noise: float = 0.0

    def survey(self, survey: Survey, seed: int) -> Survey:
        """The survey after it."""
        xyz = survey.xyz + np.random.default_rng(seed).normal(0.0, self.noise, survey.xyz.shape)
        return replace(survey, xyz=np.column_stack([xyz[:, :2] @ self.turn.T + self.move, xyz[:, 2]]))

    def undone(self, outlines: Sequence[Polygon]) -> list[Polygon]:
        """Outlines of the changed survey where they lie in the first."""
        back = np.linalg.inv(self.turn)
        return [
            shapely.make_valid(shapely.transform(one, lambda xy: (xy - self.move) @ back.T))
            for one in outlines
        ]


def changes_of(survey: Survey) -> Iterator[Changed]:
    """Every change of a survey."""
    same, none = np.eye(2), np.zeros(2)
    middle = np.round(survey.xyz[:, :2].mean(axis=0)) + [0.37, 0.21]
    cosine, sine = np.cos(np.radians(30.0)), np.sin(np.radians(30.0))
    yield from [Changed("shaken by 2 mm", same, none, 0.002)] * SHAKES
    for move in MOVES_M:
        yield Changed("moved by parts of a cell", same, np.array(move))
    for name, turn in (
        ("turned by 30°", np.array([[cosine, -sine], [sine, cosine]])),
        ("mirrored", np.array([[-1.0, 0.0], [0.0, 1.0]])),
    ):
        yield Changed(name, turn, middle - turn @ middle)


def built(survey: Survey, folder: Path) -> list[Polygon]:
    """The outlines that a build of the bare points gives."""
    survey.write(folder / "points.laz")
    build(folder / "points.laz", folder / "out", outputs=("footprints",), overwrite=True)
    return footprints_in(folder / "out" / "footprints.gpkg")


def share_met(some: Sequence[Polygon], others: Sequence[Polygon]) -> float:
    """The share of some outlines, of those large enough, that one of the others meets."""
    tree, large = shapely.STRtree(others), [one for one in some if one.area >= LEAST_M2]
    met = 0
    for one in large:
        near = tree.geometries[tree.query(one, predicate="intersects")]
        shared = shapely.area(shapely.intersection(near, one))
        met += bool((shared >= SAME * (one.area + shapely.area(near) - shared)).any())
    return met / max(len(large), 1)


def rows_of_survey(survey: Survey, truth: list[Polygon] | None, folder: Path) -> Iterator[dict[str, object]]:
    """A row for each kind of change, and one for all builds together."""
    base = built(survey, folder)
    builds, rows = [base], dict[str, list[tuple[float, float]]]()
    for seed, change in enumerate(changes_of(survey)):
        other = change.undone(built(change.survey(survey, seed), folder))
        builds.append(other)
        rows.setdefault(change.name, []).append((share_met(base, other), share_met(other, base)))
    for name, shares in rows.items():
        stay, back = (round(float(one), 3) for one in np.mean(shares, axis=0))
        yield {"survey": survey.name, "change": name, "builds": len(shares), "stay": stay, "back": back}
    count = [sum(one.area >= LEAST_M2 for one in outlines) for outlines in builds]
    row: dict[str, object] = {"survey": survey.name, "change": "all", "builds": len(builds)}
    row["outlines"] = f"{np.mean(count):.1f} ± {np.std(count):.1f}"
    if truth is not None:
        score = [float(str(map_row("", outlines, truth)["F1 at .5"])) for outlines in builds]
        row["F1 at .5"] = f"{np.mean(score):.3f} ± {np.std(score):.3f}"
    yield row


def surveys(data: Path) -> dict[str, Callable[[], tuple[Survey, list[Polygon] | None]]]:
    """Each survey with its map, by name."""

    def drawn(name: str) -> tuple[Survey, list[Polygon]]:
        style, seed = TOWNS[name]
        scene = scan_town(simulate_town(0.04, style=style, seed=seed), 8.0, 0.03, seed=seed)  # type: ignore[arg-type]
        place = np.array([*scene.cloud.origin, 0.0]) + SOMEWHERE_M
        truth = [shapely.transform(one.footprint, lambda xy: xy + place[:2]) for one in scene.buildings]
        return survey_of(name, scene), truth

    delft = data / "delft"
    return {
        "delft": lambda: (
            read_survey("delft", [delft / "ahn3.laz"], 28992),
            footprints_in(delft / "footprints.gpkg"),
        ),
        "williams": lambda: (read_survey("williams", [data / "williams" / "williams.laz"], 26912), None),
        **{name: lambda name=name: drawn(name) for name in TOWNS},  # type: ignore[misc]
    }


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path)
    parser.add_argument("--only", default="", help="Names of surveys, by commas.")
    options = parser.parse_args()
    rows: list[dict[str, object]] = []
    for name, opened in surveys(options.data).items():
        if not options.only or name in options.only.split(","):
            with tempfile.TemporaryDirectory() as folder:
                rows += rows_of_survey(*opened(), Path(folder))
    columns = ("survey", "change", "builds", "stay", "back", "outlines", "F1 at .5")
    keep(
        "stay",
        "Outlines that stay where nothing changes",
        [{column: row.get(column) for column in columns} for row in rows],
        "python -m benchmarks.accuracy.stay DATA",
        "From bare points by the steps of the command. The drawn towns chose nothing; Delft was looked at "
        "while rows of houses were worked on; no weight is fitted on it, nor on Williams.",
    )


if __name__ == "__main__":
    main()
