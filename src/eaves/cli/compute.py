"""The commands that compute: build, update, and ground, detect and reconstruct, builds of some outputs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eaves.cli.options import (
    Config,
    Crs,
    DryRun,
    Inputs,
    Jobs,
    Out,
    Profile,
    Quiet,
    Settings,
    Strict,
    ToCrs,
    Verbose,
    with_run_options,
)
from eaves.cli.runs import (
    COMPLETE,
    INCOMPLETE,
    finish,
    look_in_this_folder,
    progress_display,
    run_build,
    show_facts,
    show_plan,
    start_run_log,
)

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
