"""Changes listed where nothing changed: a scan compared with itself, shaken, moved and thinned.

Each survey is built from its bare points by `eaves build`, and again with every point shaken by 3 mm, moved
by half a cell of detection, and with three quarters of its points. `compare` should list no building as
changed. What it calls unclear it does not claim, and is counted apart.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.survey_variants import Survey, read_survey
from benchmarks.table import keep
from eaves.change.compare import compare
from eaves.pipeline import build

SHAKE_M, HALF_CELL_M, SHARE = 0.003, 0.25, 0.75
SURVEYS = {
    "delft": ("delft/ahn3.laz", 28992),
    "williams": ("williams/williams.laz", 26912),
    "stbarth": ("stbarth/stbarth.laz", 5490),
    "california": ("california/california.laz", 26910),
    "ign_urban": ("ign_urban/*.laz", 2154),
}
"""Files and reference system of each survey; the system serves for metres alone."""
KINDS = ("unchanged", "unclear")
"""What `compare` says of buildings that it does not list as changed."""


def changes_of(survey: Survey) -> Iterator[tuple[str, Survey]]:
    """The survey changed, by the name of the change."""
    rng = np.random.default_rng(48)
    shaken = survey.xyz + rng.normal(0.0, SHAKE_M, survey.xyz.shape)
    yield "shaken by 3 mm", replace(survey, xyz=shaken)
    yield "moved by half a cell", replace(survey, xyz=survey.xyz + [HALF_CELL_M, HALF_CELL_M, 0.0])
    yield "three quarters of the points", survey.take(rng.random(len(survey.xyz)) < SHARE)


def built(survey: Survey, folder: Path) -> Path:
    """The folder of a build of the bare points, with what `compare` reads."""
    folder.mkdir(exist_ok=True)
    survey.write(folder / "points.laz")
    build(folder / "points.laz", folder / "out", overwrite=True)
    return folder / "out"


def rows_of_survey(survey: Survey, folder: Path) -> Iterator[dict[str, object]]:
    """A row for each change."""
    first = built(survey, folder / "first")
    for name, changed in changes_of(survey):
        changes = compare(first, built(changed, folder / "second")).changes
        verdicts = Counter(change.verdict.change for change in changes)
        listed = {kind: number for kind, number in sorted(verdicts.items()) if kind not in KINDS}
        yield {
            "survey": survey.name,
            "change": name,
            "buildings": len(changes),
            "listed as changed": sum(listed.values()),
            "as": ", ".join(f"{kind} {number}" for kind, number in listed.items()) or None,
            "unclear": verdicts["unclear"],
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
    for name, (files, epsg) in SURVEYS.items():
        if not options.only or name in options.only.split(","):
            with tempfile.TemporaryDirectory() as folder:
                survey = read_survey(name, sorted(options.data.glob(files)), epsg)
                rows += rows_of_survey(survey, Path(folder))
    keep(
        "unchanged",
        "Changes listed where nothing changed",
        rows,
        "python -m benchmarks.accuracy.unchanged DATA",
        "Moved by half a cell (0.25 m east and north) every wall lies elsewhere by .35 m, which a comparison "
        "may see; the goal is that it lists none.",
    )


if __name__ == "__main__":
    main()
