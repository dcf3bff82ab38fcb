"""The command line. Imports are late: `eaves --help` must be quick."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from eaves import extensions
from eaves.cli.runs import (
    COMPLETE,
    INCOMPLETE,
    INTERRUPTED,
    TERMINATED,
    Config,
    Crs,
    DryRun,
    Inputs,
    Jobs,
    Out,
    PanelledCommand,
    Profile,
    Quiet,
    Settings,
    Strict,
    ToCrs,
    Verbose,
    count_interrupts,
    describe_methods,
    describe_sources,
    finish,
    look_in_this_folder,
    progress_display,
    report_aborts,
    report_error,
    run_build,
    show_facts,
    show_plan,
    start_run_log,
    with_run_options,
    with_signature,
)
from eaves.extensions import imported, installed
from eaves.run.memory import collect_rarely

if TYPE_CHECKING:
    from eaves.run.options import RunOptions

NO_MAP = ("footprints", "layer", "id_field", "footprint_source", "snap_footprints", "party_walls")
SETTLED = ("classified", "outputs", "formats", "source", "keep", "per_tile", "steps")


@with_run_options("classified")
def build(
    inputs: Inputs,
    out: Out,
    options: RunOptions,
    settings: Settings = None,
    config: Config = None,
    profile: Profile = False,
    strict: Strict = False,
    dry_run: DryRun = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Build footprints, 3D models and a report from LiDAR. Also writes rasters and classified points.

    Examples:

      eaves build tile.laz -o out
      eaves build tiles/ -o out --footprints map.gpkg --id-field id
      eaves build old.laz -o old --crs srs.wkt
      eaves build tile.laz -o out --lod 1.3 --set detect.min_height=2.5
      eaves build tiles/ -o out --keep
    """
    if dry_run:
        show_plan(inputs, out, options, (config, settings), quiet, verbose)
    summary = run_build(inputs, out, options, (config, settings), quiet, verbose)
    if profile:
        typer.echo(summary.profile(), err=True)
    finish(summary, quiet, options, strict)


def info(
    inputs: Inputs,
    crs: Crs = None,
    to_crs: ToCrs = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Describe a scan before a run. Density, returns, strips, voids, system, what may go wrong.

    At most a million points are read; in larger scans they are sampled evenly over the files.
    """
    show_facts(inputs, crs, to_crs, as_json, quiet, verbose)


@with_run_options(
    *("detect", "outline", "units", "roof", "reconstruct", "lod"),
    *NO_MAP,
    *SETTLED,
    flags={"ground": "--method"},
)
def ground(
    inputs: Inputs,
    out: Out,
    options: RunOptions,
    settings: Settings = None,
    config: Config = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Classify ground (class 2) and noise (7, 18). Writes the same points to OUT.laz or a folder."""
    single = out.suffix.lower() in (".laz", ".las")
    options |= {"lod": "0", "outputs": ("classified",), "classified": out if single else None}
    folder = out.parent if single else out
    finish(
        run_build(inputs, folder, options, (config, settings), quiet, verbose, ground_only=True),
        quiet,
        options,
    )


@with_run_options("units", "roof", "reconstruct", "lod", *NO_MAP, *SETTLED, flags={"detect": "--method"})
def detect(
    inputs: Inputs,
    out: Out,
    options: RunOptions,
    settings: Settings = None,
    config: Config = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Detect buildings. Writes mask, footprints and classified points."""
    options |= {"lod": "0", "outputs": ("footprints", "mask", "classified")}
    finish(run_build(inputs, out, options, (config, settings), quiet, verbose), quiet, options)


@with_run_options(
    *("ground", "detect", "outline", "units", "party_walls"),
    *SETTLED,
    required=("footprints",),
    flags={"reconstruct": "--method"},
)
def reconstruct(
    inputs: Inputs,
    out: Out,
    options: RunOptions,
    settings: Settings = None,
    config: Config = None,
    strict: Strict = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Build models for given footprints. The points may be classified or not."""
    finish(run_build(inputs, out, options, (config, settings), quiet, verbose), quiet, options, strict)


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
    from eaves.upkeep.update import update as run_update

    if inputs and out is None:
        raise ValueError("update with new points: the folder to write is missing; add -o FOLDER")
    if date is not None and not inputs:
        raise ValueError("--date: goes with new points, and none are given; name their files")
    start_run_log(quiet, verbose)
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
    **dict.fromkeys(("build", "info", "ground", "detect", "reconstruct", "update"), "eaves.cli.app"),
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
