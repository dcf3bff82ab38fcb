"""The commands that compute: build, and its presets ground, detect and reconstruct."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eaves.cli.options import (
    Footprints,
    Formats,
    IdField,
    Inputs,
    Lod,
    MethodName,
    Out,
    PartyWalls,
    PerTile,
    RunWords,
    Snap,
    Strict,
    Units,
    with_run_words,
)
from eaves.cli.runs import finish, run_build


@with_run_words
def build(
    inputs: Inputs,
    out: Out,
    words: RunWords,
    footprints: Footprints = None,
    id_field: IdField = None,
    snap_footprints: Snap = False,
    party_walls: PartyWalls = None,
    lod: Lod = "2.2",
    ground_method: MethodName = None,
    detect_method: MethodName = None,
    outline_method: MethodName = None,
    units: Units = None,
    roof_method: MethodName = None,
    reconstruct_method: MethodName = None,
    formats: Formats = "",
    per_tile: PerTile = False,
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
        footprints=footprints,
        id_field=id_field,
        snap_footprints=snap_footprints,
        party_walls=party_walls,
        formats=tuple(name.strip() for name in formats.split(",") if name.strip()),
        per_tile=per_tile,
    )
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
        snap_footprints=snap_footprints,
    )
    finish(summary, words.quiet, strict)
