"""The command `eaves evaluate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eaves.cli import Quiet, Verbose, start_log


def evaluate(
    what: Annotated[
        str,
        typer.Argument(help="What to evaluate: ground, detection, footprints, planes or models."),
    ],
    result: Annotated[
        Path,
        typer.Argument(help="File to evaluate, from eaves or any other program."),
    ],
    reference: Annotated[Path, typer.Argument(help="Reference to compare it with.")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder for the JSON report, tables and maps.")
    ] = None,
    footprints: Annotated[
        Path | None, typer.Option(help="For models: polygons whose points count; default: the models' own.")
    ] = None,
    lod: Annotated[
        str | None,
        typer.Option(help="For models: 1.2, 1.3, 2.0, 2.2 or 2.3; default: each building's finest."),
    ] = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Measure how well a result agrees with a reference. docs/evaluation.md explains the measures.

    Example:

      eaves evaluate detection out/mask.tif tile.laz
    """
    from eaves.evaluate import evaluate_files

    start_log(quiet, verbose)
    evaluation = evaluate_files(what, result, reference, out, lod=lod, footprints=footprints)
    if not quiet:
        typer.echo(evaluation.as_text())
