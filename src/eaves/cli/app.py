"""The command line. Imports are late: `eaves --help` must be quick."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Sequence
from typing import Annotated, cast

import typer

from eaves import extensions
from eaves.cli.options import PanelledCommand, with_signature
from eaves.cli.runs import (
    COMPLETE,
    INTERRUPTED,
    TERMINATED,
    count_interrupts,
    describe_methods,
    describe_sources,
    report_aborts,
    report_error,
)
from eaves.extensions import imported, installed
from eaves.run.memory import collect_rarely


def show_version(wanted: bool) -> None:
    """Print the version and exit."""
    if wanted:
        from importlib.metadata import version

        typer.echo(f"eaves {version('eaves')}")
        raise typer.Exit(COMPLETE)


def first(
    wanted: Annotated[
        bool,
        typer.Option("--version", callback=show_version, is_eager=True, help="Print the version and exit."),
    ] = False,
) -> None:
    """From raw airborne LiDAR to building footprints and valid 3D buildings."""


def doctor(
    test: Annotated[bool, typer.Option(help="Also build a small scene of known houses.")] = True,
) -> None:
    """Check the installation. Versions, drivers, grids, cores, caches, a self-test."""
    from eaves.cli.doctor import run_doctor

    raise typer.Exit(run_doctor(test))


def methods(
    stage: Annotated[str | None, typer.Argument(help="Show the methods of this stage only.")] = None,
    sources: Annotated[bool, typer.Option("--sources", help="List the published systems instead.")] = False,
) -> None:
    """List the methods. Name, idea, paper, parameters."""
    for line in describe_sources() if sources else describe_methods(stage):
        typer.echo(line)


COMMANDS = {
    **dict.fromkeys(("build", "info", "ground", "detect", "reconstruct", "update"), "eaves.cli.compute"),
    **dict.fromkeys(("validate", "view"), "eaves.cli.results"),
    **dict.fromkeys(("methods", "doctor"), "eaves.cli.app"),
}
"""Command of the core → its module; only those asked for are imported. Installed packages bring others."""


def command_of(name: str, place: str, listed: bool) -> Callable[..., None]:
    """The function of a command; one that cannot be imported is `listed` with the reason."""

    def broken() -> None:
        pass

    try:
        return cast(Callable[..., None], imported(place if ":" in place else f"{place}:{name}"))
    except ValueError as error:
        if not listed:
            raise
        broken.__name__, broken.__doc__ = name, f"Not available: {str(error).partition(';')[0]}."
        return broken


def commands_of(asked: str = "") -> list[Callable[..., None]]:
    """The function of a command if there is such a one, else those of all."""
    places = COMMANDS if asked in COMMANDS else {**COMMANDS, **installed(extensions.COMMANDS)}
    return [command_of(name, place, not asked) for name, place in places.items() if asked in ("", name)]


def make_app(commands: Sequence[Callable[..., None]] = ()) -> typer.Typer:
    """The application of some commands, by default of all."""
    made = typer.Typer(
        name="eaves",
        help="From raw airborne LiDAR to building footprints and valid 3D buildings.",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
    )
    made.callback()(first)
    for command in commands or commands_of():
        made.command(cls=PanelledCommand)(with_signature(command))
    return made


def without_options(command: Callable[..., None]) -> Callable[..., None]:
    """A command as the list of all shows it: the options of each cost more to read than to print."""

    def listed() -> None:
        pass

    listed.__name__, listed.__doc__ = command.__name__, command.__doc__
    return listed


def main() -> None:
    """Entry point: a caller's mistake is one line and status 2, never a traceback."""
    report_aborts()
    collect_rarely()
    # matrices here are small: a second thread of BLAS only waits, and each process would have its own
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with count_interrupts() as interrupts:
        try:
            asked = commands_of(sys.argv[1]) if len(sys.argv) > 1 else []
            if not asked and "_EAVES_COMPLETE" not in os.environ:
                asked = [without_options(command) for command in commands_of()]
            status = make_app(asked)(standalone_mode=False) or COMPLETE
        except SystemExit as end:  # how typer passes Ctrl-C on
            status = end.code
        except (KeyboardInterrupt, typer.Abort) as end:  # typer takes a file's end for Ctrl-C, too
            cause = end.__cause__
            status = report_error(cause) if isinstance(cause, EOFError) else INTERRUPTED
        except Exception as error:
            status = INTERRUPTED if interrupts else report_error(error)
    if status == INTERRUPTED or (interrupts and status != COMPLETE):
        status = TERMINATED if interrupts[:1] == [signal.SIGTERM] else INTERRUPTED
        word = "terminated" if status == TERMINATED else "interrupted"
        typer.echo(f"{word}: nothing is half-written; run again with --resume to go on", err=True)
    sys.exit(status)


if __name__ == "__main__":
    main()
