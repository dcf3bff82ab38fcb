"""Do outlines stay where nothing changes? Builds of a survey as it is, shaken, moved, turned and mirrored.

Each survey is built from its bare points by `eaves build`, and again after a change that leaves ground, roofs
and walls as they are. `stay` is the share of the outlines of 20 m² and more that one of the other build meets
with an intersection over union of .85, `back` the same the other way. Neither is a goal alone: who never
divides a row, or keeps large buildings only, stays; so the number of outlines and their F1 against a map or
the drawn town stand beside them, and the agreement of class 6 with the survey's own, as means over all builds
with their spread. Trust should foretell what stays: of the outlines with high trust, and of the others, the
share that a changed build meets is given.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import laspy
import numpy as np
import pyogrio
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from benchmarks.accuracy.units import footprints_in, map_row
from benchmarks.survey_variants import SOMEWHERE_M, Survey, read_survey, survey_of
from benchmarks.table import keep
from eaves.model import Mask
from eaves.model.cloud import BUILDING
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


@dataclass(frozen=True, eq=False)
class Built:
    """The outlines of a build, which of them have high trust, and the intersection over union of its class 6
    with the survey's own."""

    outlines: list[Polygon]
    trusted: Mask
    agreement: float

    @property
    def large(self) -> Mask:
        """Which outlines count."""
        return np.asarray(shapely.area(np.array(self.outlines, object)) >= LEAST_M2)


def built(survey: Survey, folder: Path) -> Built:
    """What a build of the bare points gives."""
    survey.write(folder / "points.laz")
    build(folder / "points.laz", folder / "out", outputs=("footprints", "classified"), overwrite=True)
    path = folder / "out" / "footprints.gpkg"
    _, _, _, columns = pyogrio.raw.read(path, layer="footprints", columns=["trust"])
    roof = np.asarray(laspy.read(folder / "out" / "classified.laz").classification) == BUILDING
    true = survey.truth == BUILDING
    agreement = float((roof & true).sum() / max((roof | true).sum(), 1))
    return Built(footprints_in(path), columns[0] == "high", agreement)


def are_met(some: Sequence[Polygon], others: Sequence[Polygon]) -> Mask:
    """Which of some outlines one of the others meets."""
    tree = shapely.STRtree(others)
    met = np.zeros(len(some), bool)
    for k, outline in enumerate(some):
        near = tree.geometries[tree.query(outline, predicate="intersects")]
        shared = shapely.area(shapely.intersection(near, outline))
        met[k] = bool((shared >= SAME * (outline.area + shapely.area(near) - shared)).any())
    return met


def rows_of_survey(survey: Survey, truth: list[Polygon] | None, folder: Path) -> Iterator[dict[str, object]]:
    """A row for each kind of change, and one for all builds together."""
    base = built(survey, folder)
    builds, rows, met = [base], dict[str, list[tuple[float, float]]](), []
    for seed, change in enumerate(changes_of(survey)):
        other = built(change.survey(survey, seed), folder)
        other = replace(other, outlines=change.undone(other.outlines))
        builds.append(other)
        met.append(are_met(base.outlines, other.outlines))
        met_back = are_met(other.outlines, base.outlines)
        shares = met[-1][base.large].mean(), met_back[other.large].mean()
        rows.setdefault(change.name, []).append((float(shares[0]), float(shares[1])))
    for name, pairs in rows.items():
        stay, back = (round(float(share), 3) for share in np.mean(pairs, axis=0))
        yield {"survey": survey.name, "change": name, "builds": len(pairs), "stay": stay, "back": back}
    stays = np.mean(met, axis=0)
    yield {
        "survey": survey.name,
        "change": "all",
        "builds": len(builds),
        "outlines": mean_with_spread([float(np.count_nonzero(one.large)) for one in builds], 1),
        "F1 at .5": truth
        and mean_with_spread([float(str(map_row("", one.outlines, truth)["F1 at .5"])) for one in builds], 3),
        "class 6": mean_with_spread([one.agreement for one in builds], 4),
        "high trust stays": round(float(stays[base.large & base.trusted].mean()), 3),
        "other trust stays": round(float(stays[base.large & ~base.trusted].mean()), 3),
    }


def mean_with_spread(values: Sequence[float], digits: int) -> str:
    """The mean of values ± their standard deviation."""
    return f"{np.mean(values):.{digits}f} ± {np.std(values):.{digits}f}"


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
    columns = (
        *("survey", "change", "builds", "stay", "back", "outlines", "F1 at .5", "class 6"),
        *("high trust stays", "other trust stays"),
    )
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
