"""The commands about time: compare, and what goes on after the first run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eaves.cli.options import Crs, Jobs, Out, Quiet
from eaves.cli.runs import COMPLETE, INCOMPLETE, progress_display, start_log


def begin(quiet: bool) -> None:
    """What each of these commands does first: without pandas, which pyogrio would load, it starts in half the
    time."""
    from eaves.run.workers import import_pyogrio_alone

    import_pyogrio_alone()
    start_log(quiet)


def compare(
    old: Annotated[Path, typer.Argument(help="What `eaves build` wrote for the first epoch, or its scan.")],
    new: Annotated[Path, typer.Argument(help="The same for the second epoch.")],
    out: Out,
    crs: Crs = None,
    jobs: Jobs = 0,
    quiet: Quiet = False,
) -> None:
    """What was built, raised, extended or taken down between two epochs. A layer, a table, a page.

    Scans that were not built yet are built first, into OUT/old and OUT/new:

      eaves compare run-2018 run-2024 -o changes
      eaves compare ahn3.laz ahn5.laz -o changes
    """
    from eaves.cli.comparison import run_comparison

    begin(quiet)
    with progress_display(quiet) as progress:
        text, whole = run_comparison(old, new, out, crs, jobs, progress)
    if not quiet:
        typer.echo(text)
    raise typer.Exit(COMPLETE if whole else INCOMPLETE)


def rebuild(
    folder: Annotated[Path, typer.Argument(help="What `eaves build --keep` wrote.", metavar="OUT")],
    edits: Annotated[
        Path | None,
        typer.Option(
            help="Polygons with a field verdict, and id where they are of a building; or a CSV of both."
        ),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Model buildings again that were corrected. Edits in OUT/footprints.gpkg, made in QGIS, or in a file.

    A changed outline, a deleted or a new feature, several features of one id (party walls), and the verdicts
    'no building', 'is a building', 'flat roof', 'footprint', 'party walls':

      eaves rebuild out
      eaves rebuild out --edits verdicts.gpkg
    """
    from eaves.change.rebuild import rebuild as run_rebuild

    begin(quiet)
    with progress_display(quiet) as progress:
        done = run_rebuild(folder, edits, progress)
    if not quiet:
        typer.echo(done.as_text())
    for told in (*done.conflicts, *done.failed) if quiet else ():
        typer.echo(told, err=True)
    raise typer.Exit(COMPLETE if done.summary.complete and not done.failed else INCOMPLETE)


def update(
    folder: Annotated[Path, typer.Argument(help="What `eaves build --keep` wrote.", metavar="OUT")],
    inputs: Annotated[
        list[str], typer.Argument(help="The new points: files, folders or globs.", metavar="INPUTS...")
    ],
    out: Out,
    date: Annotated[
        str | None, typer.Option(help="Of the new scan, 2026-05-31; else the latest in the files' headers.")
    ] = None,
    jobs: Jobs = 0,
    quiet: Quiet = False,
) -> None:
    """A later scan of a part of a run's area. Only what its points change is computed again.

    Everything else is taken over, models byte for byte; ids and edits are kept:

      eaves update out new_tiles/ -o out2
    """
    from eaves.change.update import update as run_update

    begin(quiet)
    with progress_display(quiet) as progress:
        done = run_update(folder, inputs, out, date, jobs, progress)
    if not quiet:
        typer.echo(done.as_text())
        typer.echo(f"results in {out}")
    for told in done.conflicts if quiet else ():
        typer.echo(told, err=True)
    for reason in done.summary.failed:
        typer.echo(f"incomplete: {reason}", err=True)
    raise typer.Exit(COMPLETE if done.summary.complete else INCOMPLETE)


def calibrate(
    folder: Annotated[Path, typer.Argument(help="What `eaves build --keep` wrote.", metavar="OUT")],
    edits: Annotated[
        Path | None, typer.Argument(help="Verdicts, as `eaves rebuild --edits` takes them.", metavar="EDITS")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="The configuration; else OUT/calibration.toml.")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """The detector fitted to a survey by verdicts. Written only where it is better on those left out.

    At least 20 verdicts; those of OUT/edits.gpkg count, too:

      eaves calibrate out verdicts.gpkg
      eaves build tiles/ -o out2 --config out/calibration.toml
    """
    from eaves.change.calibrate import calibrate as run_calibrate

    begin(quiet)
    with progress_display(quiet) as progress:
        done = run_calibrate(folder, edits, out, progress)
    if not quiet:
        typer.echo(done.as_text())
