"""The command `eaves compare`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eaves.cli import COMPLETE, INCOMPLETE, Crs, Jobs, Out, Quiet, Verbose, progress_display, start_run_log


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
    from eaves.change.compare import run_comparison

    start_run_log(quiet, verbose)
    with progress_display(quiet) as progress:
        text, whole = run_comparison(old, new, out, crs, jobs, progress)
    if not quiet:
        typer.echo(text)
    raise typer.Exit(COMPLETE if whole else INCOMPLETE)
