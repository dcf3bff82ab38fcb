"""The whole job: tiles in, results and the report out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from eaves.pipeline import Recipe
from eaves.tiling.build import Options
from eaves.tiling.build import build as build_files
from eaves.tiling.outputs import Summary
from eaves.tiling.region import Tell
from eaves.viewer.contents import BUILDINGS_SHOWN, POINTS_SHOWN, get_ready
from eaves.viewer.report import write_report
from eaves.viewer.sample import Heard


def build(
    inputs: str | Path | Sequence[str | Path],
    out: str | Path,
    recipe: Recipe | None = None,
    options: Options | None = None,
    tell: Tell = lambda stage, done, total: None,
) -> Summary:
    """Footprints, models, rasters, classified points and report.html, in the folder `out`.

    See `eaves.tiling.build.build` for the parameters; this adds the report that people open first (not to a
    run by tiles, which is more than a page holds).

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> from eaves.simulate import write_simulation
    >>> files = write_simulation(truth, "nine")
    >>> summary = eaves.build(files["points"], "out")
    >>> summary.found == summary.modelled + sum(summary.failures.values())
    True
    >>> (summary.folder / "report.html").exists()
    True
    """
    heard = Heard(POINTS_SHOWN, BUILDINGS_SHOWN)
    waits = options is not None and (options.jobs > 1 or options.scheduler is not None)

    def tell_and_get_ready(stage: str, done: int, total: int) -> None:
        tell(stage, done, total)
        if waits and stage == "buildings" and done == 1:  # the others compute meanwhile
            get_ready()

    summary = build_files(inputs, out, recipe, options, tell_and_get_ready, heard)
    if "tiles" in summary.run:
        return summary
    return replace(summary, files=(*summary.files, write_report(summary, heard)))
