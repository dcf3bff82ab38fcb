"""The commands that compute: build, and ground, detect and reconstruct, which are builds of some outputs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from eaves.cli.options import (
    AllowEmpty,
    Config,
    Inputs,
    Out,
    Profile,
    Quiet,
    Strict,
    Verbose,
    with_run_options,
)
from eaves.cli.runs import finish, run_build

if TYPE_CHECKING:
    from eaves.run.options import RunOptions

NO_MAP = ("footprints", "id_field", "footprint_source", "snap_footprints", "party_walls")
SETTLED = ("classified", "outputs", "formats", "source", "keep", "per_tile")


@with_run_options("classified")
def build(
    inputs: Inputs,
    out: Out,
    options: RunOptions,
    config: Config = None,
    profile: Profile = False,
    strict: Strict = False,
    allow_empty: AllowEmpty = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Points in; footprints, 3D buildings and a report out. Also rasters and the classified points."""
    summary = run_build(inputs, out, options, config, quiet, verbose)
    if profile:
        typer.echo(summary.profile(), err=True)
    finish(summary, quiet, allow_empty, strict)


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
    config: Config = None,
    allow_empty: AllowEmpty = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Which points are ground (class 2) and noise (7, 18). The same points, to OUT.laz or a folder."""
    single = out.suffix.lower() in (".laz", ".las")
    options |= {"lod": "0", "outputs": ("classified",), "classified": out if single else None}
    folder = out.parent if single else out
    finish(run_build(inputs, folder, options, config, quiet, verbose, ground_only=True), quiet, allow_empty)


@with_run_options("units", "roof", "reconstruct", "lod", *NO_MAP, *SETTLED, flags={"detect": "--method"})
def detect(
    inputs: Inputs,
    out: Out,
    options: RunOptions,
    config: Config = None,
    allow_empty: AllowEmpty = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Where buildings are: mask, footprints, classified points. The mask is a GeoTIFF with world file."""
    options |= {"lod": "0", "outputs": ("footprints", "mask", "classified")}
    finish(run_build(inputs, out, options, config, quiet, verbose), quiet, allow_empty)


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
    config: Config = None,
    strict: Strict = False,
    allow_empty: AllowEmpty = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Models for given footprints. The points may be classified or not."""
    finish(run_build(inputs, out, options, config, quiet, verbose), quiet, allow_empty, strict)
