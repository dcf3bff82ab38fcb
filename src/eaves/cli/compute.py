"""The commands that compute: build, and ground, detect and reconstruct, which are builds of some outputs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eaves.cli.options import (
    Footprints,
    FootprintSource,
    Formats,
    IdField,
    Inputs,
    Keep,
    Lod,
    MethodName,
    Out,
    Outputs,
    PartyWalls,
    PerTile,
    Profile,
    RunWords,
    Snap,
    SourceName,
    Strict,
    Units,
    with_run_words,
)
from eaves.cli.runs import finish, names_in, run_build


@with_run_words
def build(
    inputs: Inputs,
    out: Out,
    words: RunWords,
    footprints: Footprints = None,
    id_field: IdField = None,
    footprint_source: FootprintSource = None,
    snap_footprints: Snap = False,
    party_walls: PartyWalls = None,
    lod: Annotated[
        str | None,
        typer.Option(
            help="Finest level of detail: 0, 1.2, 1.3, 2.0, 2.2 or 2.3, or what the source delivers."
        ),
    ] = None,
    source: SourceName = None,
    ground_method: MethodName = None,
    detect_method: MethodName = None,
    outline_method: MethodName = None,
    units: Units = None,
    roof_method: MethodName = None,
    reconstruct_method: MethodName = None,
    formats: Formats = "",
    outputs: Outputs = "",
    profile: Profile = False,
    per_tile: PerTile = False,
    keep: Keep = False,
    strict: Strict = False,
) -> None:
    """Points in; footprints, 3D buildings and a report out. Also rasters and the classified points."""
    names = {"ground": ground_method, "detect": detect_method, "outline": outline_method}
    names |= {"units": units, "roof": roof_method, "reconstruct": reconstruct_method}
    summary = run_build(
        inputs,
        out,
        words,
        names,
        lod=lod,
        source=source,
        footprints=footprints,
        id_field=id_field,
        footprint_source=footprint_source,
        snap_footprints=snap_footprints,
        party_walls=party_walls,
        formats=names_in(formats),
        outputs=names_in(outputs),
        per_tile=per_tile,
        keep=keep,
    )
    if profile:
        typer.echo(summary.profile(), err=True)
    finish(summary, words.quiet, strict)


@with_run_words
def ground(inputs: Inputs, out: Out, words: RunWords, method: MethodName = None) -> None:
    """Which points are ground (class 2) and noise (7, 18). The same points, to OUT.laz or a folder."""
    single = out.suffix.lower() in (".laz", ".las")
    summary = run_build(
        inputs,
        out.parent if single else out,
        words,
        {"ground": method},
        lod="0",
        outputs=("classified",),
        classified=out if single else None,
        ground_only=True,
    )
    finish(summary, words.quiet)


@with_run_words
def detect(
    inputs: Inputs,
    out: Out,
    words: RunWords,
    method: MethodName = None,
    ground_method: MethodName = None,
    outline_method: MethodName = None,
) -> None:
    """Where buildings are: mask, footprints, classified points. The mask is a GeoTIFF with world file."""
    names = {"detect": method, "ground": ground_method, "outline": outline_method}
    outputs = ("footprints", "mask", "classified")
    finish(run_build(inputs, out, words, names, lod="0", outputs=outputs), words.quiet)


@with_run_words
def reconstruct(
    inputs: Inputs,
    out: Out,
    words: RunWords,
    footprints: Annotated[Path, typer.Option(help="The footprints to model.")],
    id_field: IdField = None,
    footprint_source: FootprintSource = None,
    snap_footprints: Snap = False,
    lod: Lod = "2.2",
    roof_method: MethodName = None,
    method: MethodName = None,
    strict: Strict = False,
) -> None:
    """Models for given footprints. The points may be classified or not."""
    summary = run_build(
        inputs,
        out,
        words,
        {"roof": roof_method, "reconstruct": method},
        lod=lod,
        footprints=footprints,
        id_field=id_field,
        footprint_source=footprint_source,
        snap_footprints=snap_footprints,
    )
    finish(summary, words.quiet, strict)
