"""The commands about time: compare, update."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eaves.cli.options import Crs, Jobs, Out, Quiet, Verbose
from eaves.cli.runs import COMPLETE, INCOMPLETE, look_in_this_folder, progress_display, start_log


def begin(quiet: bool, verbose: bool) -> None:
    """Start the log, and import libraries without what they bring along, which would double the start."""
    from eaves.run.workers import import_libraries_alone

    import_libraries_alone()
    start_log(quiet, verbose)


def compare(
    old: Annotated[Path, typer.Argument(help="Folder of `eaves build` for the first epoch, or its scan.")],
    new: Annotated[Path, typer.Argument(help="The same for the second epoch.")],
    out: Out,
    crs: Crs = None,
    jobs: Jobs = 0,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Compare two epochs: built, demolished, raised, extended. Writes a layer, a table and a page.

    Scans are built first, into OUT/old and OUT/new:

      eaves compare run-2018 run-2024 -o changes
      eaves compare ahn3.laz ahn5.laz -o changes
    """
    from eaves.cli.comparison import run_comparison

    begin(quiet, verbose)
    with progress_display(quiet) as progress:
        text, whole = run_comparison(old, new, out, crs, jobs, progress)
    if not quiet:
        typer.echo(text)
    raise typer.Exit(COMPLETE if whole else INCOMPLETE)


def update(
    folder: Annotated[
        Path, typer.Argument(help="Folder of `eaves build`; for new points with --keep.", metavar="OUT")
    ],
    inputs: Annotated[
        list[str] | None, typer.Argument(help="New points: files, folders or globs.", metavar="[INPUTS...]")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder of the output; with new points not OUT.")
    ] = None,
    edits: Annotated[
        Path | None,
        typer.Option(help="Polygons with a field verdict, and id for those of a building; or a CSV of both."),
    ] = None,
    date: Annotated[
        str | None,
        typer.Option(help="Date of the new scan (2026-05-31); default: the latest in the files' headers."),
    ] = None,
    methods: Annotated[
        list[str] | None,
        typer.Option(
            "--method",
            help="Import this method, which the run was built with; may be repeated.",
            metavar="MODULE:CLASS",
        ),
    ] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Overwrite edits and other results in the output folder.")
    ] = False,
    jobs: Jobs = 0,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Update a run with new points, with corrections, or both.

    With new points, the results equal a build of all valid points; ids and edits are kept. Corrected
    buildings are modelled again; a run without --keep is computed again for that. Corrections are edits of
    OUT/footprints.gpkg in QGIS, or a file: a changed outline, a deleted or a new feature, several features of
    one id (party walls), and the verdicts 'no building', 'is a building', 'flat roof', 'footprint', 'party
    walls'.

    Examples:

      eaves update out new_tiles/ -o out2
      eaves update out
      eaves update out --edits verdicts.gpkg
    """
    from eaves.change.upkeep.update import update as run_update

    if inputs and out is None:
        raise ValueError("update with new points: the folder to write is missing; add -o FOLDER")
    if date is not None and not inputs:
        raise ValueError("--date: goes with new points, and none are given; name their files")
    begin(quiet, verbose)
    named = methods or []
    look_in_this_folder(named)
    with progress_display(quiet) as progress:
        done = run_update(folder, inputs or (), out, date, jobs, progress, overwrite, True, edits, named)
    if not quiet:
        typer.echo(done.as_text())
        typer.echo(f"results in {out or folder}")
    for line in (*done.corrected.conflicts, *done.corrected.failed) if quiet else ():
        typer.echo(line, err=True)
    for reason in done.failed:
        typer.echo(f"incomplete: {reason}", err=True)
    raise typer.Exit(COMPLETE if done.complete and not done.corrected.failed else INCOMPLETE)
