"""The command line. Imports are late: `eaves --help` must answer at once."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from eaves.cli.compute import build, detect, ground, reconstruct
from eaves.cli.results import evaluate, plot, validate, view
from eaves.cli.runs import COMPLETE, INTERRUPTED, count_interrupts, describe_methods, report_error
from eaves.cli.scenes import demo, simulate

app = typer.Typer(
    name="eaves",
    help="From raw airborne LiDAR to building footprints and valid 3D buildings.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def methods(stage: Annotated[str | None, typer.Argument(help="One stage only.")] = None) -> None:
    """Every method: name, idea, paper, parameters."""
    for line in describe_methods(stage):
        typer.echo(line)


for command in (build, ground, detect, reconstruct, validate, evaluate, simulate, view, plot, methods, demo):
    app.command()(command)


def main() -> None:
    """Entry point: a caller's mistake is one line and status 2, never a traceback."""
    with count_interrupts() as interrupts:
        try:
            status = app(standalone_mode=False) or COMPLETE
        except SystemExit as end:  # how typer passes Ctrl-C on
            status = end.code
        except (KeyboardInterrupt, typer.Abort):
            status = INTERRUPTED
        except Exception as error:
            status = INTERRUPTED if interrupts else report_error(error)
    if status == INTERRUPTED or (interrupts and status != COMPLETE):
        typer.echo("interrupted: nothing is half-written; run again with --resume to go on", err=True)
        status = INTERRUPTED
    sys.exit(status)


if __name__ == "__main__":
    main()
