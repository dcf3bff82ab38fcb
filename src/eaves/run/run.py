"""One description of a run: what is asked for, checked, with the inputs indexed."""

from __future__ import annotations

import hashlib
import inspect
import logging
import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from glob import escape
from importlib.metadata import version
from pathlib import Path
from typing import Any, ParamSpec, TypedDict, TypeVar, Unpack

from eaves.footprints.read import Map, area_of, in_metres, read_area, read_footprints, recognise_map
from eaves.formats import InputError
from eaves.formats.crs_check import vertical_datum
from eaves.formats.inputs import list_inputs
from eaves.methods import MethodChoice
from eaves.model import BLOCK_SIDE, Bounds, CoordinateSystem, Failure, Footprint
from eaves.model.checks import check_positive
from eaves.model.provenance import Provenance
from eaves.reconstruct.overhangs import LOD as OVERHANGS
from eaves.run.collisions import refuse_collisions
from eaves.run.exports import check_formats
from eaves.run.index import Index, index_inputs
from eaves.run.lock import LOCK
from eaves.run.memory import parse_memory
from eaves.run.partition import Window
from eaves.run.recipe import Recipe, make_recipe

log = logging.getLogger("eaves")

EVERYTHING = ("footprints", "models", "mask", "rasters", "classified", "report")
"""The outputs there are; see `eaves.run.outputs`, and `eaves.report` for the last."""
BOUNDS_LENGTH = 4
"""West, south, east, north."""
TILES_ABOVE = 2_000_000_000
"""More points than this are computed by tiles: their temporary files would take 46 GB and more."""

NAMED_SOURCES = 100
"""So many point files are named in each output; of more the first are, and how many there are."""
PROCESSES_ABOVE = 1_000_000
"""Fewer points are computed in less time than processes take to start: two to three seconds each."""

Progress = Callable[[str, int, int], None]
"""Called with the step, how much of it is done, and how much there is."""


def no_progress(step: str, done: int, total: int) -> None:
    """The `Progress` that shows nothing."""


class RunOptions(TypedDict, total=False):
    """The keywords of a run; each has the default of the command line."""

    ground: MethodChoice
    detect: MethodChoice
    outline: MethodChoice
    units: MethodChoice
    roof: MethodChoice
    reconstruct: MethodChoice
    source: str | None
    """One of the published systems, whole (`eaves.run.sources`)."""
    use_classes: bool
    """Use the classes of the files: 2 is ground, 6 building, 7 and 18 noise."""
    building_classes: Sequence[int] | None
    """Classes of the files that mean building, with `use_classes`; None for 6 and 67."""
    ground_classes: Sequence[int] | None
    """Classes of the files that mean ground, with `use_classes`; None for 2."""
    classes: Sequence[int] | None
    """Classes to write: `2, 3, 4, 5, 6, 9, 14, 15, 17`, or without the last four, or `2, 6` alone."""
    as_published: bool
    lod: str | None
    """The finest level: 0, 1.2, 1.3, 2.0, 2.2 or 2.3; by default what the source delivers, or 2.2."""
    crs: str | None
    crs_force: bool
    """Take `crs` for the system even where a file says another one, or its numbers do not fit it."""
    salvage: bool
    """Of files that are cut off, use what is whole."""
    bounds: Bounds | Sequence[float] | None
    """West, south, east, north in the unit of the files' reference system."""
    clip: str | Path | None
    """Polygons; points outside are not used."""
    footprints: str | Path | None
    id_field: str | None
    footprint_source: str | None
    """The map that footprints or party walls are from (`eaves.footprints.layouts`), told by its columns for
    None; `none` takes polygons as they are."""
    snap_footprints: bool
    party_walls: str | Path | None
    """Polygons of addresses; the blocks that are detected are split along their borders."""
    formats: Sequence[str]
    """Names of further formats (`eaves.run.exports`)."""
    outputs: Sequence[str]
    """Names of the outputs to write (`EVERYTHING`); all for none. What only others need is not computed."""
    block: float
    """Side (m) of the area whose points are loaded at once to find its ground; the result is the same."""
    jobs: int
    """Processes; 0 is one a core where there are more than `PROCESSES_ABOVE` points, and else one."""
    scheduler: str | None
    """Address of a Dask scheduler."""
    memory: str | None
    """Bound of the processes' memory together: `4G`, `1500M`."""
    resume: bool
    """Keep the parts of an earlier run that are done and match."""
    keep: bool
    """Keep the parts of the run, from which it can be updated and corrected (`eaves update`, `rebuild`)."""
    per_tile: bool
    """Compute and write by tiles, each on its own, also where there are few points (`eaves.run.tiles`)."""
    classified: Path | None
    """Where the classified points of the one input go, without extra dimensions and without a run.json."""


DEFAULT_OPTIONS: RunOptions = {
    "use_classes": False,
    "as_published": False,
    "crs_force": False,
    "salvage": False,
    "snap_footprints": False,
    "formats": (),
    "outputs": EVERYTHING,
    "block": BLOCK_SIDE,
    "jobs": 1,
    "resume": False,
    "keep": False,
    "per_tile": False,
}
"""What an option is when it is not given; None for those not named here."""

P = ParamSpec("P")
T = TypeVar("T")


def list_options(function: Callable[P, T]) -> Callable[P, T]:
    """The function itself, with the keywords of `RunOptions` in the signature that `help` shows."""
    own = [
        one
        for one in inspect.signature(function).parameters.values()
        if one.kind is not inspect.Parameter.VAR_KEYWORD
    ]
    keywords = [
        inspect.Parameter(
            name,
            inspect.Parameter.KEYWORD_ONLY,
            default=DEFAULT_OPTIONS.get(name),
            annotation=kind.__forward_arg__,
        )
        for name, kind in RunOptions.__annotations__.items()
    ]
    returned = inspect.signature(function).return_annotation
    signature = inspect.Signature([*own, *keywords], return_annotation=returned)
    function.__signature__ = signature  # type: ignore[attr-defined]
    return function


@dataclass(frozen=True, eq=False)
class Run:
    """What is to be computed: picklable, so that a worker can compute a tile on its own."""

    folder: Path
    recipe: Recipe
    index: Index
    window: Window
    plan: dict[str, Any]
    """What decides the result (`describe`)."""
    side: float = BLOCK_SIDE
    """Side of a block (m): what is measured in a block and its surroundings must not follow from a choice."""
    loaded_side: float = BLOCK_SIDE
    """Side (m) of the area whose points are loaded at once to find its ground."""
    given: Sequence[Footprint] | None = None
    lost: tuple[Failure, ...] = ()
    """Given polygons that cannot be modelled, with the reason: each has its row all the same."""
    snap_footprints: bool = False
    addresses: Sequence[Footprint] = ()
    """What lies between known party walls; detected blocks are split into them."""
    formats: tuple[str, ...] = ()
    outputs: tuple[str, ...] = EVERYTHING
    classified: Path | None = None
    jobs: int = 1
    scheduler: str | None = None
    memory: int | None = None
    """Bytes, for all processes together."""
    resume: bool = False
    keep: bool = False
    request: dict[str, Any] = field(default_factory=dict)
    """What `keep` writes beside the parts: the inputs and options to open the run with again."""
    by_tiles: bool = False
    failed: tuple[str, ...] = ()
    """Inputs that could not be opened, with the reason."""
    translate: tuple[float, ...] | None = None
    """What the coordinates of the models count from, where an earlier run's lines are to stay."""
    started: float = 0.0

    @property
    def provenance(self) -> Provenance:
        """What every output says of where it comes from."""
        names = tuple(self.index.path(number).name for number in range(min(len(self.index), NAMED_SOURCES)))
        datum = self.plan["vertical_datum"]
        return Provenance(names, len(self.index), datum["name"], datum["status"])

    @property
    def lock(self) -> str:
        """Name of the file that holds the folder for this run; several may each write one file into it."""
        return LOCK if self.classified is None else f"{LOCK}-{self.classified.stem}"

    @property
    def work_folder(self) -> Path:
        """Where the parts of the run are kept until it is complete."""
        return self.folder / (WORK if self.classified is None else f"{WORK}-{self.classified.stem}")


WORK = ".eaves-work"


def open_run(
    inputs: str | Path | Sequence[str | Path],
    out: str | Path,
    recipe: Recipe | None = None,
    progress: Progress = no_progress,
    **options: Unpack[RunOptions],
) -> Run:
    """The run that is asked for: every option checked, headers read, footprints read, the folder made.

    Parameters
    ----------
    inputs
        LAS, LAZ, COPC or text files, folders or globs.
    out
        Folder; made when missing.
    recipe
        The methods, instead of the options that name them.
    progress
        Called while headers are read.
    options
        The keywords of `RunOptions`, documented at `eaves.build`.

    Raises
    ------
    TypeError
        When an option does not exist.
    InputError
        When an input cannot be used; nothing is written then.
    """
    started = time.time()
    unknown = options.keys() - RunOptions.__annotations__.keys()
    if unknown:
        known = ", ".join(RunOptions.__annotations__)
        raise TypeError(f"unknown option '{min(unknown)}' of a run; choose among: {known}")
    options = {**DEFAULT_OPTIONS, **options}
    if recipe is None:
        recipe = make_recipe(
            {stage: options.get(stage) for stage in METHOD_OPTIONS},  # type: ignore[misc]
            source=options.get("source"),
            published=options["as_published"],
            use_classes=options["use_classes"],
            lod=options.get("lod"),
            building_classes=options.get("building_classes"),
            ground_classes=options.get("ground_classes"),
            classes=options.get("classes"),
        )
    memory = parse_memory(options.get("memory"))
    check_options(options)
    formats, outputs = tuple(options.get("formats") or ()), tuple(options.get("outputs") or EVERYTHING)
    check_formats(formats, outputs)
    footprints, party_walls = options.get("footprints"), options.get("party_walls")
    if footprints is not None and party_walls is not None:
        raise InputError(
            f"{party_walls}: party walls split blocks that are detected, and footprints are given; "
            "leave one of --footprints and --party-walls out"
        )
    folder, paths = Path(out), list_inputs(inputs)
    polygons = [Path(one) for one in (footprints, party_walls, options.get("clip")) if one is not None]
    refuse_collisions(folder, options.get("classified"), paths, polygons)
    failed: list[str] = []
    index = index_inputs(
        paths,
        options.get("crs"),
        failed,
        lambda done, total: progress("index", done, total),
        options["crs_force"],
        options["salvage"],
    )
    bounds = in_metres(as_bounds(options.get("bounds")), index.system)
    hashes = {name: hash_of(options.get(name)) for name in POLYGONS}  # type: ignore[arg-type]
    clip = options.get("clip")
    window = Window(bounds, None if clip is None else read_area(Path(clip), index.system))
    known_polygons: list[Footprint] = []
    lost: list[Failure] = []
    map_: Map | None = None
    if (path := footprints or party_walls) is not None:
        map_ = recognise_map(Path(path), options.get("footprint_source"))
        area = area_of(index.entries["box"][index.entries["count"] > 0], window.bounds, window.clip)
        known_polygons, lost = read_footprints(Path(path), options.get("id_field"), index.system, area, map_)
    for name in POLYGONS:
        if hash_of(options.get(name)) != hashes[name]:  # type: ignore[arg-type]
            changed = str(options.get(name))
            raise InputError.about(changed, "changed while the run was reading it", "run again")
    classified = options.get("classified")
    if classified is not None and len(index) > 1:
        raise InputError(f"{classified}: one file cannot hold {len(index)} inputs; give a folder with -o")
    if options["keep"] and (options["per_tile"] or index.points > TILES_ABOVE or classified is not None):
        raise InputError("--keep: a run by tiles keeps no parts; build a part of it with --bounds")
    warn_of_heights(index.system, formats)
    claim(folder)
    return Run(
        folder=folder,
        recipe=recipe,
        index=index,
        window=window,
        plan=describe(index, recipe, options, map_, hashes),
        side=BLOCK_SIDE,
        loaded_side=options["block"],
        given=None if footprints is None else known_polygons,
        lost=() if footprints is None else tuple(lost),
        snap_footprints=options["snap_footprints"],
        addresses=() if party_walls is None else known_polygons,
        formats=formats,
        outputs=outputs,
        classified=classified,
        jobs=options["jobs"] or (os.cpu_count() or 1 if index.points > PROCESSES_ABOVE else 1),
        scheduler=options.get("scheduler"),
        memory=memory,
        resume=options["resume"],
        keep=options["keep"],
        request=request_of(paths, options),
        by_tiles=classified is None and (options["per_tile"] or index.points > TILES_ABOVE),
        failed=tuple(failed),
        started=started,
    )


REPEATED = (
    *("crs", "crs_force", "salvage", "bounds", "id_field", "footprint_source", "snap_footprints"),
    *("formats", "outputs", "block"),
)
"""The options, beside the files of polygons, with which a kept run is opened again."""


def request_of(paths: Sequence[str], options: RunOptions) -> dict[str, Any]:
    """Inputs and options as JSON, with paths that hold from any folder."""
    given: dict[str, Any] = {name: options.get(name) for name in REPEATED}
    bounds = as_bounds(options.get("bounds"))
    given["bounds"] = None if bounds is None else list(vars(bounds).values())
    for name in POLYGONS:
        path = options.get(name)
        given[name] = None if path is None else str(Path(str(path)).resolve())
    return {"inputs": [os.path.realpath(path) for path in paths], "options": given}


NARROWEST, WIDEST = 6.0, 100_000.0
"""Sides of a block (m): the cells of all methods fit into the one, the steps of int32 across the other."""


def check_options(options: RunOptions) -> None:
    """Check the numbers among the options.

    Raises
    ------
    TypeError, ValueError
        When one has another type, or is out of range.
    InputError
        When a block or bounds are numbers that no run can use.
    """
    check_positive(options["block"], "block")
    check_outputs(options.get("outputs") or EVERYTHING)
    jobs = options["jobs"]
    if not isinstance(jobs, int) or jobs < 0:
        raise ValueError(f"jobs must be a whole number, not {jobs!r}; 0 chooses for you")
    given = options.get("bounds")
    if not (given is None or isinstance(given, Bounds) or len(given) == BOUNDS_LENGTH):
        raise ValueError(f"bounds must be west, south, east, north, not {given!r}; give four numbers")
    side = options["block"]
    if not NARROWEST <= side <= WIDEST:
        raise InputError(f"--block {side}: the side of a block lies between {NARROWEST:g} and {WIDEST:g} m")
    bounds = as_bounds(options.get("bounds"))
    if bounds is None:
        return
    west, south, east, north = vars(bounds).values()
    told = ",".join(f"{side:g}" for side in (west, south, east, north))
    if not all(map(math.isfinite, (west, south, east, north))):
        raise InputError(f"--bounds {told}: not four numbers; write west,south,east,north")
    if west >= east or south >= north:
        raise InputError(f"--bounds {told}: west must be below east, south below north")


POLYGONS = ("clip", "footprints", "party_walls")
"""The options that name a file of polygons."""
METHOD_OPTIONS = ("ground", "detect", "outline", "units", "roof", "reconstruct")


def as_bounds(bounds: Bounds | Sequence[float] | None) -> Bounds | None:
    """Bounds from four numbers."""
    if bounds is None or isinstance(bounds, Bounds):
        return bounds
    west, south, east, north = bounds
    return Bounds(west, south, east, north)


def warn_of_heights(system: CoordinateSystem, formats: Sequence[str]) -> None:
    """Say once what heights are measured from, and when heights above the ellipsoid are wanted and cannot be
    had."""
    datum = vertical_datum(system)
    if system.wkt is None:
        return
    told = datum["status"] if datum["name"] is None else f"{datum['name']}, {datum['status']}"
    log.info("heights: vertical datum %s", told)
    if "3dtiles" in formats and datum["status"] != "known":
        log.warning(
            "3dtiles: the vertical datum of the files is %s, so their heights are taken as above the "
            "ellipsoid; install PROJ's geoid grid (pyproj sync), pass a compound --crs, or raise the tileset "
            "in the viewer",
            told,
        )


def claim(folder: Path) -> None:
    """Make the output folder and see that it can be written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / ".eaves-probe"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise InputError(
            f"{folder}: the output folder cannot be written ({error.strerror}); choose another with -o"
        ) from None


def describe(
    index: Index,
    recipe: Recipe,
    options: RunOptions,
    known: Map | None,
    hashes: Mapping[str, str | None],
) -> dict[str, Any]:
    """What decides the result, as JSON: inputs with their hashes, methods with parameters, version."""
    methods = {
        stage: method and {"method": method.name, **method.model_dump(mode="json")}
        for stage in METHOD_OPTIONS
        for method in [getattr(recipe, stage)]
    }
    bounds = as_bounds(options.get("bounds"))
    return {
        "version": version("eaves"),
        **index.describe(),
        "vertical_datum": vertical_datum(index.system),
        "methods": methods,
        "use_classes": recipe.use_classes,
        "ground_classes": list(recipe.ground_classes) if recipe.use_classes else None,
        "vegetation": asdict(recipe.vegetation)
        if recipe.marks_vegetation and recipe.vegetation is not None
        else None,
        "others": recipe.others,
        "lod": recipe.lod,
        "overhangs": asdict(recipe.overhangs) if recipe.lod == OVERHANGS else None,
        "buffer": recipe.buffer,
        "wide_buffer": recipe.ground.wide_buffer if recipe.sees_wide else 0.0,
        "bounds": None if bounds is None else list(vars(bounds).values()),
        "clip": hashes["clip"],
        "footprints": hashes["footprints"],
        "id_field": options.get("id_field"),
        "footprint_source": None if known is None else known.describe(),
        "snap_footprints": options["snap_footprints"],
        "party_walls": hashes["party_walls"],
    }


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


def hash_of(path: str | Path | None) -> str | None:
    """SHA-256 of a file and of those beside it that belong to it: a shapefile is several; None for none."""
    if path is None or not Path(path).is_file():
        return None
    whole, path = hashlib.sha256(), Path(path)
    beside = [one for one in path.parent.glob(f"{escape(path.stem)}.*") if one.suffix.lower() in SIDECARS]
    beside += path.parent.glob(f"{escape(path.name)}-wal")
    for one in [path, *sorted(set(beside) - {path})]:
        with one.open("rb") as file:
            whole.update(hashlib.file_digest(file, "sha256").digest())
    return whole.hexdigest()


SIDECARS = (".shp", ".shx", ".dbf", ".prj", ".cpg")
"""Files whose contents are part of a shapefile's."""
