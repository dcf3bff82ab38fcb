"""beside.html: the pages of two runs in one file, which turn together."""

from __future__ import annotations

import html
import webbrowser
from importlib.resources import files
from pathlib import Path
from string import Template

from eaves.formats import InputError
from eaves.formats.atomic import atomic
from eaves.formats.crs import describe_system, horizontal_crs
from eaves.report.contents import BUILDINGS_SHOWN, POINTS_SHOWN, Contents, read_contents
from eaves.report.page_file import iter_page
from eaves.report.view import describe_run, log, refuse_no_run
from eaves.run.manifest import add_to_manifest

NAME = "beside.html"


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
    for one in folders:
        refuse_no_run(one)
    left, right = (
        read_contents(one, points=POINTS_SHOWN // 2, buildings=BUILDINGS_SHOWN // 2, basemap=basemap)
        for one in folders
    )
    refuse_other_system(left, right)
    path = folders[0] / NAME
    with atomic(path) as temporary:
        temporary.write_text(render_beside(left, right), encoding="utf-8")
    add_to_manifest(folders[0], [path])
    if show and not webbrowser.open(path.resolve().as_uri()):
        log.warning("no browser could be started; open %s", path)
    return path


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
