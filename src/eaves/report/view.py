"""Opening the page of a run that is there already, or the pages of two in one file, which turn together."""

from __future__ import annotations

import html
import logging
import webbrowser
from importlib.resources import files
from pathlib import Path
from string import Template

from eaves.formats import InputError
from eaves.formats.crs import describe_system, horizontal_crs
from eaves.formats.whole_files import atomic
from eaves.model.summary import Summary
from eaves.report.contents import BUILDINGS_SHOWN, POINTS_SHOWN, Contents, read_contents
from eaves.report.page_file import iter_page, write_page
from eaves.run.manifest import add_to_manifest, read_facts

log = logging.getLogger("eaves")

BESIDE = "beside.html"


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
    redraw = again or around is not None or basemap is not None
    if redraw or not path.exists() or path.stat().st_mtime < footprints.stat().st_mtime:
        written = write_page(read_contents(folder, around=around, basemap=basemap), describe_run(folder))
        add_to_manifest(folder, [written])
    return opened_page(path) if show else path


def opened_page(path: Path) -> Path:
    """A page, opened in the browser."""
    if not webbrowser.open(path.resolve().as_uri()):
        log.warning("no browser could be started; open %s", path)
    return path


def refuse_no_run(folder: Path) -> None:
    """Raise when a folder holds no run."""
    if not (folder / "footprints.gpkg").exists():
        raise InputError.about(folder, "holds no footprints.gpkg", "give the folder of a run of eaves build")


def describe_run(folder: Path) -> str:
    """The summary of a run from its run.json, as the run reported it."""
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


def open_beside(
    folder: str | Path, other: str | Path, show: bool = True, basemap: str | Path | None = None
) -> Path:
    """The pages of two runs side by side, in a file in the first one's folder, opened in the browser if
    `show`; each draws half as much as a page alone.

    Raises
    ------
    InputError
        When a folder holds no run, or the two are in different reference systems.
    """
    folders = Path(folder), Path(other)
    for run_folder in folders:
        refuse_no_run(run_folder)
    left, right = (
        read_contents(run_folder, points=POINTS_SHOWN // 2, buildings=BUILDINGS_SHOWN // 2, basemap=basemap)
        for run_folder in folders
    )
    refuse_other_system(left, right)
    path = folders[0] / BESIDE
    with atomic(path) as temporary:
        temporary.write_text(render_beside(left, right), encoding="utf-8")
    add_to_manifest(folders[0], [path])
    return opened_page(path) if show else path


def refuse_other_system(left: Contents, right: Contents) -> None:
    """Raise when two runs cannot be shown in one frame."""
    systems = horizontal_crs(left.system), horizontal_crs(right.system)
    if systems[0] != systems[1]:
        raise InputError.about(
            right.folder,
            f"is in {describe_system(right.system)} and {left.folder} in {describe_system(left.system)}",
            "build both in one system, or use eaves compare",
        )


def render_beside(left: Contents, right: Contents) -> str:
    """The page as text, with both pages inside."""
    place = files("eaves.report").joinpath("page")
    names = [contents.folder.resolve().name for contents in (left, right)]
    pages = [
        html.escape("".join(iter_page(contents, describe_run(contents.folder)))) for contents in (left, right)
    ]
    return Template(place.joinpath("beside.html").read_text("utf-8")).substitute(
        title=html.escape(" and ".join(names)),
        style=place.joinpath("style.css").read_text("utf-8"),
        script=place.joinpath("beside.js").read_text("utf-8"),
        left_name=html.escape(names[0]),
        right_name=html.escape(names[1]),
        left=pages[0],
        right=pages[1],
    )
