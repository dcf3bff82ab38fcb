"""The commands about results: validate, view."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from eaves.cli.runs import COMPLETE, INCOMPLETE, Basemap, Quiet, Verbose, start_log

MODELS = "buildings.city.jsonl"
"""Of a run."""


def validate(
    file: Annotated[
        Path,
        typer.Argument(help="CityJSON or CityJSONSeq file, or folder of `eaves build`.", metavar="FILE|OUT"),
    ],
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Check every solid and every file of a run. The exit status is 1 if there is a defect.

    Defects of solids have the codes of val3dity. Files of a run that are missing or modified are reported.
    """
    from eaves.formats import InputError
    from eaves.run.manifest import check_folder, files_of_run
    from eaves.validate import validate_file

    start_log(quiet, verbose)
    if not file.exists():
        raise InputError.about(file, "does not exist", "give a CityJSON file, or a folder of `eaves build`")
    changed = check_folder(file) if file.is_dir() else []
    findings = []
    for models in files_of_run(file, MODELS) if file.is_dir() else [file]:
        findings += validate_file(models) if models.exists() else []
    defects = [f"{one.code} {one.name}: {one.building} {one.where}: {one.detail}" for one in findings]
    for line in (*changed, *defects):
        typer.echo(printable(line))
    if not quiet:
        whole = ", whole" if file.is_dir() and not changed else ""
        typer.echo(f"{file}: {len(findings)} findings" if findings else f"{file}: valid{whole}, no findings")
    raise typer.Exit(INCOMPLETE if findings or changed else COMPLETE)


def printable(text: str) -> str:
    """Text with all that could begin a line, move a terminal or not be written as an escape."""
    return "".join(one if one.isprintable() else one.encode("unicode_escape").decode("ascii") for one in text)


def view(
    folder: Annotated[Path, typer.Argument(help="Folder of `eaves build`.", metavar="OUT")],
    browser: Annotated[bool, typer.Option(help="Open the page in a browser, or only write it.")] = True,
    again: Annotated[bool, typer.Option("--again", help="Regenerate the page.")] = False,
    around: Annotated[
        str | None, typer.Option(help="For large runs: draw the surroundings of this building id.")
    ] = None,
    basemap: Basemap = None,
    beside: Annotated[
        Path | None,
        typer.Option(help="Folder of another run, to show side by side with linked views.", metavar="OUT2"),
    ] = None,
    serve: Annotated[
        bool, typer.Option("--serve", help="Serve the page of a run of any size until Ctrl-C.")
    ] = False,
    port: Annotated[
        int, typer.Option(help="With --serve: local port; 0: any free port.", min=0, max=65535)
    ] = 8017,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Open the 3D page of a run. It is generated if missing; --serve shows runs of any size."""
    from eaves.report.view import open_beside, open_report, open_site, serve_run

    start_log(quiet, verbose)
    if sum((around is not None, beside is not None, serve)) > 1:
        raise ValueError("--around, --beside, --serve: not together; give one of them")
    if serve:
        with suppress(KeyboardInterrupt):  # the way to end it
            site = open_site(folder, again, basemap)
            serve_run(site, port, browser, lambda words: None if quiet else typer.echo(words))
        return
    if beside is None:
        path = open_report(folder, browser, again, around, basemap)
    else:
        path = open_beside(folder, beside, browser, basemap)
    if not quiet:
        typer.echo(f"report: {path}")
