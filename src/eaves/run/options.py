"""The options of a run, each declared once: signatures, docs, the command line and run.json follow."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, ParamSpec, TypedDict, TypeVar, cast, get_args, get_type_hints

from eaves.formats import InputError
from eaves.formats.crs import crs_text
from eaves.methods import MethodChoice
from eaves.model import LODS, Bounds

EVERYTHING = ("footprints", "models", "mask", "rasters", "classified", "report")
"""The outputs there are; see `eaves.flow.outputs`, and `eaves.report` for the last."""
METHOD_OPTIONS = ("ground", "detect", "outline", "units", "roof", "reconstruct")
POLYGONS = ("clip", "footprints", "party_walls")
"""The options that name a file of polygons."""


@dataclass(frozen=True)
class Option:
    """The declaration of a keyword beside its type: the sentence of docs and help, and its default."""

    sentence: str
    default: Any = None
    again: bool = False
    """True if a kept run is opened with it again; a path is kept as one that holds from any folder."""
    recorded: bool = False
    """True if run.json states it as given; what methods, inputs and polygons say follows from those."""
    metavar: str | None = None
    flag: str | None = None
    """On the command line, where it is not the keyword's own name."""
    panel: str = "expert"
    """The heading of the help of `eaves build` that lists it."""


def method_option(flag: str) -> Option:
    """The option of a stage."""
    return Option(
        "Method of the stage: its name, `module:Class`, or a table of its parameters; None is the default.",
        flag=flag,
    )


class RunOptions(TypedDict, total=False):
    """The keywords of a run."""

    ground: Annotated[MethodChoice, method_option("--ground-method")]
    detect: Annotated[MethodChoice, method_option("--detect-method")]
    outline: Annotated[MethodChoice, method_option("--outline-method")]
    units: Annotated[MethodChoice, method_option("--units")]
    roof: Annotated[MethodChoice, method_option("--roof-method")]
    reconstruct: Annotated[MethodChoice, method_option("--reconstruct-method")]
    source: Annotated[
        str | None,
        Option(
            "Run a complete published system: chen_sun, xiao2014, ren_fcs, roof_attributes or "
            "maas_vosselman.",
            panel="methods",
        ),
    ]
    use_classes: Annotated[
        bool,
        Option(
            "Use the classes of the files: 2 is ground, 6 building, 7 and 18 noise.", False, panel="input"
        ),
    ]
    building_classes: Annotated[
        Sequence[int] | None,
        Option("With `use_classes`: the files' classes of buildings; by default 6 and 67."),
    ]
    ground_classes: Annotated[
        Sequence[int] | None, Option("With `use_classes`: the files' classes of the ground; by default 2.")
    ]
    classes: Annotated[
        Sequence[int] | None,
        Option(
            "Classes to write: by default 2, 3, 4, 5, 6, 9, 14, 15, 17; 2, 3, 4, 5, 6 without water, "
            "wires and bridges; 2, 6 also without vegetation."
        ),
    ]
    as_published: Annotated[
        bool, Option("Run methods given by name with the parameters of their papers.", False)
    ]
    lod: Annotated[
        str | None,
        Option(
            "Finest level of detail: 0, 1.2, 1.3, 2.0, 2.2 or 2.3; by default what the source "
            "delivers, or 2.2.",
            panel="methods",
        ),
    ]
    crs: Annotated[
        str | None,
        Option(
            "EPSG code, compound code (28992+5709), a file with WKT or PROJJSON, or metres, feet or us-feet "
            "of a local plane, where files say none.",
            again=True,
            panel="input",
        ),
    ]
    crs_force: Annotated[
        bool,
        Option(
            "Use `crs` even where a file states another system, or its numbers do not fit it.", False, True
        ),
    ]
    bounds: Annotated[
        Bounds | Sequence[float] | None,
        Option(
            "West, south, east, north in the unit of the files' reference system; points outside are not "
            "used.",
            again=True,
            metavar="W,S,E,N",
            panel="input",
        ),
    ]
    clip: Annotated[str | Path | None, Option("File of polygons; points outside are not used.", again=True)]
    dtm: Annotated[
        str | Path | None,
        Option(
            "Raster of the terrain under a DSM that is given in place of points; cells of the DSM within "
            "0.3 m of it are the ground.",
        ),
    ]
    allow_empty: Annotated[
        bool,
        Option(
            "Go on, and exit with status 0, where no point lies in the requested area, no polygon meets the "
            "points, or no point has a class that `use_classes` needs.",
            False,
            again=True,
        ),
    ]
    cache: Annotated[
        str | Path | None,
        Option("Cache folder for files read over the network; by default `remote` in the output folder."),
    ]
    footprints: Annotated[
        str | Path | None,
        Option(
            "File of polygons to use instead of detected outlines: shapefile, GeoPackage, GeoJSON, "
            "FlatGeobuf, GeoParquet.",
            again=True,
            panel="input",
        ),
    ]
    id_field: Annotated[
        str | None,
        Option(
            "Field of the footprints that holds their id; by default that of a known map, else they are "
            "numbered.",
            again=True,
            recorded=True,
        ),
    ]
    footprint_source: Annotated[
        str | None,
        Option(
            "Map that footprints or party walls are from, if its columns do not show it: bag, bgt, "
            "bdtopo, usa-structures, overture, osm, microsoft; `none` takes polygons as they are.",
            again=True,
        ),
    ]
    snap_footprints: Annotated[
        bool, Option("Move given footprints to the eaves in the points.", False, again=True, recorded=True)
    ]
    party_walls: Annotated[
        str | Path | None,
        Option("File of polygons of addresses; detected blocks are split along their borders.", again=True),
    ]
    formats: Annotated[
        Sequence[str],
        Option(
            "Additional formats: gpkg, citygml, citygml3, cityjson, obj, glb, 3dtiles, dxf, geojson, fgb, "
            "parquet, kml, ifc, copc.",
            (),
            again=True,
            panel="output",
        ),
    ]
    outputs: Annotated[
        Sequence[str],
        Option(
            "Outputs to write: footprints, models, mask, rasters, classified, report; by default all.",
            EVERYTHING,
            again=True,
            panel="output",
        ),
    ]
    steps: Annotated[
        bool,
        Option(
            "Write a raster of every intermediate step of the methods, and one picture of all, per "
            "block, to steps/.",
            False,
        ),
    ]
    jobs: Annotated[
        int, Option("Number of processes; 0: one per core, or one for small data.", 1, panel="run")
    ]
    scheduler: Annotated[str | None, Option("Address of an existing Dask scheduler: tcp://host:port.")]
    memory: Annotated[
        str | None, Option("Memory limit of all processes together: 4G, 1500M.", metavar="SIZE")
    ]
    resume: Annotated[bool, Option("Resume an earlier run of the same inputs.", False, panel="run")]
    keep: Annotated[
        bool,
        Option(
            "Keep the data that `eaves update` needs in the folder, about 100 bytes per point.",
            False,
            panel="run",
        ),
    ]
    overwrite: Annotated[
        bool,
        Option(
            "Write over results of other inputs in the output folder; move edits, changed and added files in "
            "the way to `before-1` in it.",
            False,
        ),
    ]
    per_tile: Annotated[
        bool,
        Option(
            "Compute tile by tile, as is done for over 2 billion points: the disk holds the points of a few "
            "tiles at a time, rasters lie in several files, without classified points and report.",
            False,
            again=True,
        ),
    ]
    classified: Annotated[
        Path | None,
        Option(
            "File for the classified points of the one input, without extra dimensions and without a "
            "run.json."
        ),
    ]


@dataclass(frozen=True)
class Declared:
    """A keyword as it is declared: its name, its type, and what follows from both."""

    name: str
    kind: Any
    option: Option

    @property
    def flag(self) -> str:
        """On the command line."""
        return self.option.flag or f"--{self.name.replace('_', '-')}"

    @property
    def words(self) -> str:
        """The type, as signatures and docs show it."""
        return re.sub(r"(\w+\.)+", "", inspect.formatannotation(self.kind))


DECLARED: dict[str, Declared] = {
    name: Declared(name, *get_args(hint))
    for name, hint in get_type_hints(RunOptions, include_extras=True).items()
}
"""All keywords of a run, in their order."""
DEFAULT_OPTIONS = cast(RunOptions, {name: one.option.default for name, one in DECLARED.items()})

P = ParamSpec("P")
T = TypeVar("T")


def list_options(function: Callable[P, T]) -> Callable[P, T]:
    """The function itself, with the keywords of `RunOptions` in the signature that `help` shows, and in its
    docstring for the line `{options}`."""
    plain = inspect.signature(function)
    parameters = [
        parameter
        for parameter in plain.parameters.values()
        if parameter.kind is not inspect.Parameter.VAR_KEYWORD
    ]
    keywords = [
        inspect.Parameter(
            declared.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=declared.option.default,
            annotation=declared.words,
        )
        for declared in DECLARED.values()
    ]
    signature = plain.replace(parameters=[*parameters, *keywords])
    function.__signature__ = signature  # type: ignore[attr-defined]
    lines = [
        f"{declared.name} : {declared.words.replace(' | ', ' or ')}\n        {declared.option.sentence}"
        for declared in DECLARED.values()
    ]
    function.__doc__ = (function.__doc__ or "").replace("{options}", "\n    ".join(lines))
    return function


def check_options(given: RunOptions) -> RunOptions:
    """All options, those not given with their defaults, when they can be used together.

    Raises
    ------
    TypeError, ValueError
        When one does not exist, has another type, or is out of range.
    InputError
        When bounds are numbers that no run can use, an output does not exist, or an option is about a map and
        none is given.
    """
    unknown = given.keys() - DECLARED.keys()
    if unknown:
        raise TypeError(f"unknown option '{min(unknown)}' of a run; choose among: {', '.join(DECLARED)}")
    options: RunOptions = {**DEFAULT_OPTIONS, **given}
    options["outputs"] = named(options["outputs"]) or EVERYTHING
    options["formats"] = named(options["formats"])
    if options["crs"] is not None:
        options["crs"] = crs_text(options["crs"])
    if isinstance(lod := options["lod"], int | float):
        options["lod"] = next((name for name in LODS if float(name) == lod), str(lod))
    check_outputs(options["outputs"])
    jobs, bounds = options["jobs"], options["bounds"]
    if not isinstance(jobs, int) or jobs < 0:
        raise ValueError(f"jobs must be a whole number, not {jobs!r}; 0 chooses for you")
    if bounds is not None:
        options["bounds"] = checked_bounds(bounds)
    if options["footprints"] is not None and options["party_walls"] is not None:
        raise InputError(
            f"{options['party_walls']}: party walls split blocks that are detected, and footprints are "
            "given; leave one of --footprints and --party-walls out"
        )
    for name in ("id_field", "footprint_source", "snap_footprints"):
        if options[name] and not (options["footprints"] or options["party_walls"]):
            raise InputError(f"{DECLARED[name].flag}: no map is given; add --footprints, or leave it out")
    return options


def named(given: str | Sequence[str] | None) -> tuple[str, ...]:
    """The names of outputs or formats: one, or several; a format may be named by its suffix."""
    names = (given,) if isinstance(given, str) else tuple(given or ())
    return tuple(name.lower().removeprefix(".") for name in names)


def checked_bounds(given: Bounds | Sequence[float]) -> Bounds:
    """Bounds from four numbers, when they hold an area.

    Raises
    ------
    ValueError, InputError
        When they do not.
    """
    numbers = list(given)
    if len(numbers) != len(fields(Bounds)):
        raise ValueError(f"bounds must be west, south, east, north, not {given!r}; give four numbers")
    west, south, east, north = numbers
    text = ",".join(f"{side:g}" for side in numbers)
    if not all(map(math.isfinite, numbers)):
        raise InputError(f"--bounds {text}: not four numbers; write west,south,east,north")
    if west >= east or south >= north:
        raise InputError(f"--bounds {text}: west must be below east, south below north")
    return Bounds(west, south, east, north)


def check_outputs(names: Sequence[str]) -> None:
    """Check the names of the outputs, and that what one is made of is among them.

    Raises
    ------
    InputError
        When one does not exist, or the report is asked for without the footprints.
    """
    for name in names:
        if name not in EVERYTHING:
            raise InputError(f"--outputs {name}: unknown output; choose among: {', '.join(EVERYTHING)}")
    if "report" in names and "footprints" not in names:
        raise InputError("--outputs report: the page is made of the other files; add footprints and models")


def kept_options(options: RunOptions) -> dict[str, Any]:
    """The options with which a kept run is opened again, as JSON."""
    options_again: dict[str, Any] = {
        name: options.get(name) for name, declared in DECLARED.items() if declared.option.again
    }
    if options["bounds"] is not None:
        options_again["bounds"] = list(options["bounds"])
    for name in POLYGONS:
        options_again[name] = (
            None if options_again[name] is None else str(Path(str(options_again[name])).resolve())
        )
    return options_again
