"""The commands that compute: build, and ground, detect and reconstruct, which are builds of some outputs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from eaves.cli.options import (
    Config,
    Crs,
    DryRun,
    Inputs,
    Out,
    Profile,
    Quiet,
    Settings,
    Strict,
    ToCrs,
    Verbose,
    with_run_options,
)
from eaves.cli.runs import finish, run_build, show_facts, show_plan

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
