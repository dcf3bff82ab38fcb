"""The options that several commands share, each declared once."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

Inputs = Annotated[
    list[str], typer.Argument(help="LAS, LAZ, COPC or text files, folders or globs.", metavar="INPUT…")
]
Out = Annotated[Path, typer.Option("--out", "-o", help="Where to write.")]
Crs = Annotated[
    str | None, typer.Option(help="EPSG code, compound code (28992+5709), or a WKT or PROJJSON file.")
]
CrsForce = Annotated[bool, typer.Option("--crs-force", help="Believe --crs, whatever files and numbers say.")]
Salvage = Annotated[bool, typer.Option("--salvage", help="Of files that are cut off, use what is whole.")]
BoundsText = Annotated[str | None, typer.Option("--bounds", help="west,south,east,north in the CRS's unit.")]
Clip = Annotated[Path | None, typer.Option(help="Polygons; points outside are not used.")]
UseClasses = Annotated[bool, typer.Option("--use-classes", help="Use the file's classes.")]
BuildingClasses = Annotated[
    str | None, typer.Option(help="With --use-classes: the file's classes of buildings, 6,67 if not given.")
]
GroundClasses = Annotated[
    str | None, typer.Option(help="With --use-classes: the file's classes of the ground, 2 if not given.")
]
Classes = Annotated[
    str | None,
    typer.Option(help="Classes to write: 2,3,4,5,6,9,14,15,17 if not given, or 2,3,4,5,6, or 2,6."),
]
Jobs = Annotated[int, typer.Option(help="Processes; 0: one a core, one for small data.", min=0)]
Scheduler = Annotated[str | None, typer.Option(help="An existing Dask cluster: tcp://host:port.")]
Memory = Annotated[
    str | None, typer.Option(help="Bound of the processes' memory together: 4G, 1500M.", metavar="SIZE")
]
Resume = Annotated[bool, typer.Option("--resume", help="Keep parts that are done and match.")]
PerTile = Annotated[
    bool, typer.Option("--per-tile", help="Compute and write tile by tile, as for over 2 billion points.")
]
Keep = Annotated[
    bool,
    typer.Option("--keep", help="Keep what `eaves update` needs, about 100 bytes a point."),
]
Published = Annotated[
    bool, typer.Option("--as-published", help="Every method with the numbers its paper prints.")
]
Config = Annotated[Path | None, typer.Option(help="TOML with a table per stage: method and parameters.")]
Basemap = Annotated[Path | None, typer.Option(help="Aerial image (GeoTIFF) to lay over the terrain.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Only warnings and errors.")]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Also what happens inside.")]
Footprints = Annotated[
    Path | None,
    typer.Option(help="Footprints to use: shapefile, GeoPackage, GeoJSON, FlatGeobuf, GeoParquet."),
]
IdField = Annotated[str | None, typer.Option(help="Field of the footprints that holds their id.")]
FootprintSource = Annotated[
    str | None,
    typer.Option(
        help="Map they are from, if its columns do not tell: bag, bgt, bdtopo, usa-structures, overture, "
        "osm, microsoft or none."
    ),
]
Snap = Annotated[
    bool, typer.Option("--snap-footprints", help="Move given footprints to the eaves in the points.")
]
PartyWalls = Annotated[
    Path | None, typer.Option(help="Polygons of addresses that detected blocks are split into.")
]
BlockSide = Annotated[
    float, typer.Option("--block", help="Side of what is loaded at once to find its ground (m).")
]
Strict = Annotated[bool, typer.Option("--strict", help="Exit with 1 when a building has no model.")]
Units = Annotated[
    str | None, typer.Option(help="How blocks are divided into houses: a method's name, or off.")
]
MethodName = Annotated[str | None, typer.Option(help="Name of the method; see `eaves methods`.")]
Formats = Annotated[
    str,
    typer.Option(
        help="More formats: gpkg,citygml,citygml3,cityjson,obj,glb,3dtiles,dxf,geojson,fgb,parquet."
    ),
]
Outputs = Annotated[
    str, typer.Option(help="Only these, by commas: footprints,models,mask,rasters,classified,report.")
]
Profile = Annotated[bool, typer.Option("--profile", help="Also where the time went, by stage.")]
SourceName = Annotated[
    str | None, typer.Option(help="A published system, whole; see `eaves methods --sources`.")
]
Lod = Annotated[str, typer.Option(help="Finest level of detail: 0, 1.2, 1.3, 2.0, 2.2 or 2.3.")]


@dataclass(frozen=True)
class RunWords:
    """The options of every command that computes."""

    crs: Crs = None
    crs_force: CrsForce = False
    salvage: Salvage = False
    bounds: BoundsText = None
    clip: Clip = None
    use_classes: UseClasses = False
    building_classes: BuildingClasses = None
    ground_classes: GroundClasses = None
    classes: Classes = None
    as_published: Published = False
    block: BlockSide = 240.0
    jobs: Jobs = 0
    scheduler: Scheduler = None
    memory: Memory = None
    resume: Resume = False
    config: Config = None
    quiet: Quiet = False
    verbose: Verbose = False


def with_run_words(command: Callable[..., None]) -> Callable[..., None]:
    """The command with the fields of `RunWords` as options of its own in place of its parameter `words`."""
    names = [field.name for field in fields(RunWords)]

    @wraps(command)
    def whole(**values: Any) -> None:
        words = RunWords(**{name: values.pop(name) for name in names})
        command(**values, words=words)

    hints = get_type_hints(command, include_extras=True)
    shared = get_type_hints(RunWords, include_extras=True)
    own = [
        one.replace(annotation=hints[name], kind=inspect.Parameter.KEYWORD_ONLY)
        for name, one in inspect.signature(command).parameters.items()
        if name != "words"
    ]
    more = [
        inspect.Parameter(
            field.name, inspect.Parameter.KEYWORD_ONLY, default=field.default, annotation=shared[field.name]
        )
        for field in fields(RunWords)
    ]
    whole.__signature__ = inspect.Signature([*own, *more])  # type: ignore[attr-defined]
    whole.__annotations__ = {one.name: one.annotation for one in (*own, *more)}
    return whole
