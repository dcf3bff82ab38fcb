"""The options that several commands share, each declared once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Inputs = Annotated[
    list[str], typer.Argument(help="LAS, LAZ, COPC or text files, folders or globs.", metavar="INPUT…")
]
Out = Annotated[Path, typer.Option("--out", "-o", help="Where to write.")]
Crs = Annotated[
    str | None, typer.Option(help="EPSG code, compound code (28992+5709), or a WKT or PROJJSON file.")
]
BoundsText = Annotated[str | None, typer.Option("--bounds", help="west,south,east,north in the CRS's unit.")]
Clip = Annotated[Path | None, typer.Option(help="Polygons; points outside are not used.")]
UseClasses = Annotated[bool, typer.Option("--use-classes", help="Believe the file's classes.")]
Jobs = Annotated[int, typer.Option(help="Processes; 0 means one a core.", min=0)]
Scheduler = Annotated[str | None, typer.Option(help="An existing Dask cluster: tcp://host:port.")]
Resume = Annotated[bool, typer.Option("--resume", help="Keep parts that are done and match.")]
PerTile = Annotated[
    bool, typer.Option("--per-tile", help="Compute and write tile by tile, as for over 2 billion points.")
]
Published = Annotated[
    bool, typer.Option("--as-published", help="Every method with the numbers its paper prints.")
]
Config = Annotated[Path | None, typer.Option(help="TOML with a table per stage: method and parameters.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Only warnings and errors.")]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Also what happens inside.")]
Footprints = Annotated[Path | None, typer.Option(help="Footprints to use instead of our own.")]
IdField = Annotated[str | None, typer.Option(help="Field of the footprints that holds their id.")]
Snap = Annotated[
    bool, typer.Option("--snap-footprints", help="Move given footprints to the eaves in the points.")
]
PartyWalls = Annotated[
    Path | None, typer.Option(help="Polygons of addresses that detected blocks are split into.")
]
BlockSide = Annotated[float, typer.Option("--block", help="Side of a block (m).", min=6)]
Strict = Annotated[bool, typer.Option("--strict", help="Exit with 1 when a building has no model.")]
Units = Annotated[
    str | None, typer.Option(help="How blocks are divided into houses: a method's name, or off.")
]
MethodName = Annotated[str | None, typer.Option(help="Name of the method; see `eaves methods`.")]
Formats = Annotated[
    str, typer.Option(help="More formats, comma-separated: obj,glb,3dtiles,cityjson,geojson,fgb,parquet.")
]
