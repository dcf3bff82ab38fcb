"""The options of a run, each declared once with what it takes: signatures, docs, the command line, checks
and run.json follow. They are a typed dictionary, which type checkers know as keywords; pydantic checks it."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, ParamSpec, Protocol, TypeVar, cast, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, PlainValidator, TypeAdapter, ValidationError, ValidationInfo
from typing_extensions import TypedDict

from eaves.formats import InputError
from eaves.formats.crs import crs_text
from eaves.methods import MethodChoice
from eaves.model import LODS, Bounds

EVERYTHING = ("footprints", "models", "mask", "rasters", "classified", "report")
"""The outputs there are; see `eaves.flow.outputs`, and `eaves.report` for the last."""
BROUGHT = ", and those of installed packages"
"""Of a sentence, in place of names that the command line lists."""
METHOD_OPTIONS = ("ground", "detect", "outline", "units", "roof", "reconstruct")
POLYGONS: tuple[Literal["clip", "footprints", "party_walls"], ...] = ("clip", "footprints", "party_walls")
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


class Shapes(Protocol):
    """A GeoDataFrame, a GeoSeries, a shapely geometry: what gives its shapes to others."""

    @property
    def __geo_interface__(self) -> Any: ...


def by_commas(given: Any) -> Any:
    """The parts of a text between commas, as a command line has them; others as they are."""
    return tuple(filter(None, map(str.strip, given.split(",")))) if isinstance(given, str) else given


def lower_names(given: Any) -> Any:
    """The names of outputs or formats: one, or several; a format may be named by its suffix."""
    return tuple(name.lower().removeprefix(".") for name in by_commas(given) or ())


def whole_numbers(given: Any, info: ValidationInfo) -> tuple[int, ...] | None:
    """Numbers of classes; InputError where they are none."""
    try:
        return None if given is None else tuple(map(int, by_commas(given))) or None
    except (TypeError, ValueError):
        raise InputError(
            f"{DECLARED[str(info.field_name)].flag} {given}: not whole numbers; write them as in 2,6"
        ) from None


def lod_name(given: Any) -> Any:
    """A level of detail, which may be a number, by its name."""
    if isinstance(given, str | None):
        return given
    return next((name for name in LODS if float(name) == given), str(given))


def checked_bounds(given: Any) -> Bounds | None:
    """Bounds from four numbers, when they hold an area.

    Raises
    ------
    InputError
        When they do not.
    """
    if given is None:
        return None
    shown = given if isinstance(given, str) else repr(given)
    try:
        bounds = Bounds(*map(float, by_commas(given)))
        shown = ",".join(f"{side:g}" for side in bounds)
    except (TypeError, ValueError):
        bounds = Bounds(math.nan, math.nan, math.nan, math.nan)
    if not all(map(math.isfinite, bounds)):
        raise InputError(f"--bounds {shown}: not four numbers; write west,south,east,north")
    if bounds.west >= bounds.east or bounds.south >= bounds.north:
        raise InputError(f"--bounds {shown}: west must be below east, south below north")
    return bounds


AS_GIVEN = PlainValidator(lambda given: given)
Choice = Annotated[MethodChoice, AS_GIVEN]
Classes = Annotated[Sequence[int] | None, PlainValidator(whole_numbers)]
Names = Annotated[Sequence[str], BeforeValidator(lower_names)]
Polygons = Annotated[str | Path | Shapes | None, AS_GIVEN]
System = Annotated[str | int | Any | None, PlainValidator(lambda crs: crs if crs is None else crs_text(crs))]


class RunOptions(TypedDict, total=False):
    """The keywords of a run."""

    ground: Annotated[Choice, method_option("--ground-method")]
    detect: Annotated[Choice, method_option("--detect-method")]
    outline: Annotated[Choice, method_option("--outline-method")]
    units: Annotated[Choice, method_option("--units")]
    roof: Annotated[Choice, method_option("--roof-method")]
    reconstruct: Annotated[Choice, method_option("--reconstruct-method")]
    source: Annotated[
        str | None,
        Option(
            "Run a complete published system; `eaves methods --sources` lists them.",
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
        Classes,
        Option("With `use_classes`: the files' classes of buildings; by default 6 and 67."),
    ]
    ground_classes: Annotated[
        Classes, Option("With `use_classes`: the files' classes of the ground; by default 2.")
    ]
    classes: Annotated[
        Classes,
        Option(
            "Classes to write: by default 2, 3, 4, 5, 6, 9, 14, 15, 17; 2, 3, 4, 5, 6 without water, "
            "wires and bridges; 2, 6 also without vegetation."
        ),
    ]
    as_published: Annotated[
        bool, Option("Run methods given by name with the parameters of their papers.", False)
    ]
    lod: Annotated[
        str | float | None,
        BeforeValidator(lod_name),
        Option(
            "Finest level of detail: 0, 1.2, 1.3, 2.0, 2.2 or 2.3; by default what the source "
            "delivers, or 2.2.",
            panel="methods",
        ),
    ]
    crs: Annotated[
        System,
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
    to_crs: Annotated[
        System,
        Option(
            "System to which points, and all results, are transformed: a projected EPSG code or a file with "
            "WKT; `none` keeps that of the files. By default the UTM zone of the first file if its system is "
            "in degrees or its scale is off by over 1 %, else its own.",
            again=True,
        ),
    ]
    bounds: Annotated[
        Bounds | Sequence[float] | NDArray[np.float64] | str | None,
        PlainValidator(checked_bounds),
        Option(
            "West, south, east, north in the unit of the files' reference system; points outside are not "
            "used.",
            again=True,
            metavar="W,S,E,N",
            panel="input",
        ),
    ]
    clip: Annotated[Polygons, Option("File of polygons; points outside are not used.", again=True)]
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
        Polygons,
        Option(
            "File of polygons to use instead of detected outlines: shapefile, GeoPackage, GeoJSON, "
            "FlatGeobuf, GeoParquet.",
            again=True,
            panel="input",
        ),
    ]
    layer: Annotated[
        str | None,
        Option(
            "Layer of the footprints or party walls in a file of several; by default the only one of "
            "polygons, or the one whose name or columns are those of buildings.",
            again=True,
            recorded=True,
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
        Polygons,
        Option("File of polygons of addresses; detected blocks are split along their borders.", again=True),
    ]
    formats: Annotated[
        Names,
        Option(
            f"Additional formats: cityjson, geojson, fgb, parquet{BROUGHT}.",
            (),
            again=True,
            panel="output",
        ),
    ]
    outputs: Annotated[
        Names,
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
    name: Declared(name, get_args(hint)[0], next(one for one in get_args(hint) if isinstance(one, Option)))
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
    for name in sorted(given.keys() - DECLARED.keys()):
        near = get_close_matches(name, DECLARED, 1)
        remedy = f"use '{near[0]}'" if near else "help(eaves.build) lists them"
        raise TypeError(f"unknown option '{name}' of a run; {remedy}")
    try:
        options: RunOptions = {**DEFAULT_OPTIONS, **adapter().validate_python(given)}
    except ValidationError as error:
        raise refusal(error) from None
    options["outputs"] = options["outputs"] or EVERYTHING
    check_outputs(options["outputs"])
    if (jobs := options["jobs"]) < 0:
        raise ValueError(f"--jobs {jobs}: must be 0 or more; 0 chooses for you")
    if options["footprints"] is not None and options["party_walls"] is not None:
        raise InputError(
            f"{options['party_walls']}: party walls split blocks that are detected, and footprints are "
            "given; leave one of --footprints and --party-walls out"
        )
    about_maps: tuple[Literal["layer", "id_field", "footprint_source", "snap_footprints"], ...]
    about_maps = ("layer", "id_field", "footprint_source", "snap_footprints")
    for name in about_maps:
        if options[name] and not (options["footprints"] or options["party_walls"]):
            raise InputError(f"{DECLARED[name].flag}: no map is given; add --footprints, or leave it out")
    return options


@cache
def adapter() -> TypeAdapter[RunOptions]:
    """What checks the options, made when it is first used."""
    return TypeAdapter(RunOptions)


def refusal(error: ValidationError) -> Exception:
    """The first thing that is wrong with options, in a sentence."""
    first = error.errors()[0]
    cause = first.get("ctx", {}).get("error")
    if isinstance(cause, Exception):
        return cause
    rule = first["msg"][0].lower() + first["msg"][1:]
    flag = DECLARED[str(first["loc"][0])].flag
    return ValueError(f"{flag} {first['input']!r}: {rule}; help(eaves.build) says what it takes")


def in_python(text: str) -> str:
    """A message that names options as the command line does, as one who calls a function names them."""
    names = {one.flag: f"{name}=True" if one.kind is bool else f"{name}=" for name, one in DECLARED.items()}

    def named(found: re.Match[str]) -> str:
        name = names.get(found[1], f"{found[1][2:].replace('-', '_')}=")
        return name if found[2] is None or name[-1] == "=" else f"{name} "

    said = re.sub(r"(--[a-z][a-z-]*)( (?=\S*[\d:./]))?", named, text)
    return re.sub(r"(?<!\S)-o\b", "out", re.sub(r"\b(\w+=) or \1", r"\1", said))


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
