"""Opening the page of a run that is there already."""

from __future__ import annotations

import logging
import webbrowser
from pathlib import Path

from eaves.formats import InputError
from eaves.report.contents import read_contents
from eaves.report.page_file import write_page
from eaves.run.manifest import add_to_manifest, read_facts

log = logging.getLogger("eaves")


def open_report(
    folder: str | Path,
    show: bool = True,
    again: bool = False,
    around: str | None = None,
    basemap: str | Path | None = None,
) -> Path:
    """The report.html of a run's folder, opened in the browser if `show`; made when missing, older than the
    run, `again`, `around` a building of a large run that the page does not draw, or with an aerial image.

    Raises
    ------
    InputError
        When the folder holds no run, or the image is none of it.
    """
    folder = Path(folder)
    path, footprints = folder / "report.html", folder / "footprints.gpkg"
    refuse_no_run(folder)
    wanted = again or around is not None or basemap is not None
    if wanted or not path.exists() or path.stat().st_mtime < footprints.stat().st_mtime:
        written = write_page(read_contents(folder, around=around, basemap=basemap), describe_run(folder))
        add_to_manifest(folder, [written])
    if show and not webbrowser.open(path.resolve().as_uri()):
        log.warning("no browser could be started; open %s", path)
    return path


def refuse_no_run(folder: Path) -> None:
    """Raise when a folder holds no run."""
    if not (folder / "footprints.gpkg").exists():
        raise InputError.about(folder, "holds no footprints.gpkg", "give the folder of a run of eaves build")


def describe_run(folder: Path) -> str:
    """The summary of a run from its run.json, as the run reported it."""
    from eaves.model.summary import Summary

    run = read_facts(folder)
    if not run:
        return "the run left no run.json"
    return Summary(
        folder=folder,
        points=run.get("points", 0),
        found=run.get("found", 0),
        modelled=run.get("modelled", 0),
        by_lod=run.get("by_lod", {}),
        trust=run.get("trust", {}),
        failures=run.get("failures", {}),
        fallbacks=run.get("fallbacks", {}),
        seconds=run.get("stage_cpu_seconds", {}),
        elapsed=run.get("elapsed_seconds", 0.0),
        files=(),
        failed=tuple(run.get("incomplete", ())),
        run=run,
    ).as_text()
