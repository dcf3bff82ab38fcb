"""The command `eaves edit`."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Annotated

import typer

from eaves.cli import Jobs, Quiet, Verbose, start_log


def edit(
    folder: Annotated[
        Path, typer.Argument(help="Folder of `eaves build`, at best with --keep.", metavar="OUT")
    ],
    summary: Annotated[
        bool,
        typer.Option("--summary", help="Say which reasons of the review led to edits, and end."),
    ] = False,
    browser: Annotated[bool, typer.Option(help="Open the page in the browser.")] = True,
    port: Annotated[int, typer.Option(help="Local port; 0: any free port.", min=0, max=65535)] = 0,
    jobs: Jobs = 1,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Correct the buildings of a run in the browser, each modelled again at once.

    Every action is kept in OUT/edits.gpkg; Save writes the files of the run as `eaves update OUT` does.
    """
    from eaves.edit.review import summarise_folder

    start_log(quiet, verbose)
    if summary:
        typer.echo(summarise_folder(folder))
        return
    from eaves.edit.actions import Session
    from eaves.edit.server import Desk, serve_desk

    with closing(Session(folder, max(jobs, 1))) as session:
        serve_desk(Desk(session), port, browser, lambda words: None if quiet else typer.echo(words))
