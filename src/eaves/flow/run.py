"""One description of a run: what is asked for, checked, with the inputs indexed."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, Self, Unpack

import shapely
from shapely.geometry.base import BaseGeometry

import eaves
from eaves.flow.advice import LOOKED_AT, ScanFacts, scan_facts
from eaves.flow.formats import TILES, check_formats, classified_name, copies_of_points, planned_names
from eaves.flow.refusals import (
    EDITS,
    has_rasters,
    hash_of,
    refuse_changed,
    refuse_collisions,
    refuse_full_disk,
    refuse_no_classes,
    refuse_no_fields,
    refuse_no_points,
    refuse_overwrite,
    refuse_small_memory,
    refuse_unknown_code,
    warn_of_memory,
)
from eaves.footprints.read import (
    Map,
    area_of,
    in_metres,
    read_area,
    read_footprints,
    recognise_map,
    shift_of,
    without_doubled,
)
from eaves.formats import InputError
from eaves.formats.crs import name_units
from eaves.formats.crs_check import vertical_datum
from eaves.formats.errors import require_plots
from eaves.formats.inputs import list_inputs
from eaves.formats.points.converted import remarks_on
from eaves.formats.points.las_header import LasHeader
from eaves.formats.points.remote import localise
from eaves.formats.points.source import fields_of
from eaves.methods import DEFAULTS, MethodChoice
from eaves.model import BLOCK_SIDE, OVERHANGS, Block, Bounds, CoordinateSystem, Failure, Footprint, Provenance
from eaves.model.block import within
from eaves.raster.surfaces import is_large
from eaves.recipe.recipe import Recipe, find_source, is_named, make_recipe
from eaves.run.index import LISTED_INPUTS, Index, index_inputs
from eaves.run.manifest import LOCK
from eaves.run.memory import parse_memory
from eaves.run.options import (
    DECLARED,
    DEFAULT_OPTIONS,
    METHOD_OPTIONS,
    POLYGONS,
    RunOptions,
    check_options,
    kept_options,
)
from eaves.run.points import Window
from eaves.run.store import WORK

log = logging.getLogger("eaves")

TILES_ABOVE = 2_000_000_000
"""More points than this are computed by tiles: their temporary files would take 46 GB and more."""

TILE_SIDE = 16 * BLOCK_SIDE
"""Side of a tile (m): a whole multiple of those of all squares."""
NOT_BY_TILES = ("classified", "report", "steps")
"""Outputs of all points, which a run by tiles lets go of."""
NAMED_SOURCES = 100
"""Maximum number of point files named in each output; of more the first are, and their number."""
PROCESSES_ABOVE = 1_000_000
"""Fewer points are computed in less time than processes take to start: two to three seconds each."""
REMOTE = "remote"

Progress = Callable[[str, int, int], None]
"""Called with the step, how much of it is done, and how much there is."""


def no_progress(step: str, done: int, total: int) -> None:
    """The `Progress` that shows nothing."""


@dataclass(frozen=True, eq=False)
class Run:
    """A run as it is asked for; picklable."""

    folder: Path
    recipe: Recipe
    index: Index
    window: Window
    facts: ScanFacts
    """Facts of the scan, by a sample of its points."""
    plan: dict[str, Any]
    """All that decides the result (`describe_plan`), and the facts of the scan (`look_at_scan`)."""
    options: RunOptions = field(default_factory=lambda: DEFAULT_OPTIONS)
    """All of them."""
    inputs: tuple[str, ...] = ()
    """True paths of the files asked for, also of those that could not be opened."""
    side: float = BLOCK_SIDE
    """Side of a block (m): what is measured in a block and its surroundings must not follow from a choice."""
    tile_side: float = TILE_SIDE
    """Side of a tile (m), in a run by tiles."""
    given: Sequence[Footprint] | None = None
    lost: tuple[Failure, ...] = ()
    """Given polygons that cannot be modelled, with the reason: each has its row all the same."""
    addresses: Sequence[Footprint] = ()
    """Areas between known party walls; detected blocks are split into them."""
    generations: tuple[int, ...] = ()
    """Numbers of the first inputs of each later scan, whose points take the place of earlier ones."""
    updates: tuple[Mapping[str, Any], ...] = ()
    """The counts of each update."""
    failed: tuple[str, ...] = ()
    """Inputs that could not be opened, with the reason."""
    remarks: tuple[str, ...] = ()
    """What the user must know of these inputs, a line each with cause and number (`with_remarks`)."""
    translate: tuple[float, ...] | None = None
    """The origin of the models' coordinates, where an earlier run's lines are to stay."""
    carries_edits: bool = False
    """True if the edits that the folder holds are carried out again."""
    started: float = 0.0
    remote: Mapping[str, Any] = field(default_factory=dict)
    """Traffic over the network (`formats.points.remote.Traffic`)."""

    def with_options(self, **options: Unpack[RunOptions]) -> Self:
        """The run with some options in place of its own."""
        return replace(self, options={**self.options, **options})

    def with_remarks(self, *remarks: str) -> Self:
        """The run with more remarks, of which the log, run.json and the summary each say every one once."""
        fresh = [remark for remark in dict.fromkeys(remarks) if remark not in self.remarks]
        for remark in fresh:
            log.warning("%s", remark)
        return replace(self, remarks=(*self.remarks, *fresh))

    @property
    def outputs(self) -> Sequence[str]:
        """Names of the outputs, of a run by tiles those that follow from what it keeps."""
        names = (*self.options["outputs"], *["steps"] * self.options["steps"])
        return [name for name in names if name not in NOT_BY_TILES] if self.by_tiles else names

    @property
    def classified(self) -> Path | None:
        """Path of the classified points of the one input, in a run that writes nothing else."""
        return self.options["classified"]

    @property
    def by_tiles(self) -> bool:
        """True if the run is computed by tiles."""
        return self.classified is None and goes_by_tiles(self.index, self.options)

    @cached_property
    def first_block(self) -> Block:
        """The block of the inputs' south-west corner, which owns what has no place."""
        return Block.at(self.index.extent.west, self.index.extent.south, self.side)

    @property
    def jobs(self) -> int:
        """Processes that it is worth."""
        few = self.index.points <= PROCESSES_ABOVE
        return self.options["jobs"] or (1 if few else os.cpu_count() or 1)

    @property
    def memory(self) -> int | None:
        """Bytes, for all processes together."""
        return parse_memory(self.options["memory"])

    @property
    def provenance(self) -> Provenance:
        """The provenance that every output states."""
        names = tuple(self.index.path(number).name for number in range(min(len(self.index), NAMED_SOURCES)))
        datum = self.plan["vertical_datum"]
        return Provenance(names, len(self.index), datum["name"], datum["status"])

    @property
    def blur(self) -> float:
        """Standard deviation (m) of the smoothing that is undone; 0 where walls are sharp, or no colours tell
        roofs from relief."""
        return (self.facts.blur or 0.0) if self.coloured else 0.0

    @property
    def sharpened(self) -> bool:
        """True if walls that are not sharp are sharpened, or surfaces that are rough, too, smoothed, before
        anything is decided."""
        soft = self.coloured and self.facts.blur is not None
        return soft and (self.blur > 0.0 or self.facts.rough > 0.0)

    @property
    def signs_buffer(self) -> float:
        """Width (m) of the surroundings of a block in which colours are counted; 0 for none."""
        return self.recipe.detect.signs_buffer if self.coloured and self.recipe.detect else 0.0

    @cached_property
    def coloured(self) -> bool:
        """True if it is of images, and every file has the colours that the detector takes."""
        wants = set(self.recipe.wants_of_images)
        known = bool(wants) and self.facts.of_images and self.facts.colours
        sources = (self.index.source(number) for number in range(len(self.index)))
        return known and all(wants <= {*fields_of(source)} for source in sources)

    @cached_property
    def fields(self) -> tuple[str, ...]:
        """The fields of points that are read beside coordinates, returns and classes: those that methods
        need, and those that they want, where no input is a text and buildings are asked for."""
        files = all(isinstance(source.layout, LasHeader) for source in self.index.kept.values())
        wanted = self.recipe.wants if files and not self.classes_only else ()
        return tuple(sorted({*self.recipe.ground.needs, *wanted, *self.seen_fields}))

    @property
    def seen_fields(self) -> tuple[str, ...]:
        """Those that the detector is given: what it needs, and colours of a scan without pulses alone."""
        seen = self.recipe.wants_of_images if self.coloured else ()
        return tuple(sorted({*(self.recipe.detect.needs if self.recipe.detect else ()), *seen}))

    @property
    def classes_only(self) -> bool:
        """True if no buildings are looked for or given, and nothing but the classified points is written."""
        nothing = self.recipe.detect is None and self.given is None
        return nothing and tuple(self.outputs) == ("classified",)

    @property
    def planned(self) -> set[str]:
        """Names in the folder of the files, and folders of files, that it writes."""
        return planned_files(self.index, self.options)

    @property
    def lock(self) -> str:
        """Name of the file that holds the folder for this run; several may each write one file into it."""
        return LOCK if self.classified is None else f"{LOCK}-{self.classified.stem}"

    @property
    def work_folder(self) -> Path:
        """Folder of the parts of the run until it is complete."""
        return self.folder / (WORK if self.classified is None else f"{WORK}-{self.classified.stem}")


def open_run(
    inputs: str | Path | Sequence[str | Path],
    out: str | Path,
    recipe: Recipe | None = None,
    progress: Progress = no_progress,
    **options: Unpack[RunOptions],
) -> Run:
    """The run that is asked for (`plan_run`), with its folder, which can be written."""
    run = plan_run(inputs, out, recipe, progress, **options)
    claim(run.folder)
    return run


def plan_run(
    inputs: str | Path | Sequence[str | Path],
    out: str | Path,
    recipe: Recipe | None = None,
    progress: Progress = no_progress,
    **options: Unpack[RunOptions],
) -> Run:
    """The run that is asked for: every option checked, headers and polygons read, nothing written.

    Parameters
    ----------
    inputs
        LAS, LAZ, COPC or text files, folders or globs.
    out
        Folder.
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
        When an input cannot be used, inputs, area and polygons do not meet, the disk is too small, or the
        folder holds what it would write over.
    """
    started, options = time.time(), check_options(options)
    recipe = recipe or recipe_of(options)
    parse_memory(options["memory"])
    check_formats(options["formats"], options["outputs"])
    if options["steps"]:
        require_plots()
    folder = Path(out)
    polygons: dict[str, Path] = {
        name: Path(str(path)) for name in POLYGONS if (path := options[name]) is not None
    }
    asked: Any = options["bounds"]
    sides = None if asked is None else (asked.west, asked.south, asked.east, asked.north)
    dtm = None if options["dtm"] is None else Path(options["dtm"])
    rasters = has_rasters(inputs, dtm)
    recipe = replace(recipe, from_raster=recipe.from_raster or rasters)
    cache = Path(options["cache"] or folder / REMOTE)
    local, traffic = localise(inputs, cache, sides, polygons.get("clip"), dtm)
    paths = list_inputs(local)
    refuse_collisions(folder, options["classified"], paths, list(polygons.values()))
    failed: list[str] = []
    remarks = [remark for path in paths for remark in remarks_on(path)] if rasters else []
    index = index_inputs(
        paths,
        options["crs"],  # type: ignore[arg-type] # checked
        failed,
        lambda done, total: progress("index", done, total),
        options["crs_force"],
        options["to_crs"],  # type: ignore[arg-type] # checked
        remarks,
    )
    options["to_crs"] = index.to_crs  # an update, whose first file may be another one, keeps to it
    check_whole(index, options)
    hashes: dict[str, str | None] = {name: hash_of(polygons.get(name)) for name in POLYGONS}
    window = window_of(
        index, options, read_area(polygons["clip"], index.system) if "clip" in polygons else None
    )
    remarks += filter(None, (shift_of(path, index.system) for path in polygons.values()))
    refuse_no_points(index, window, options)
    mapped = read_map(polygons, index, window, options)
    refuse_changed(polygons, hashes)
    carries_edits = options["classified"] is None and (folder / EDITS).exists()
    plan = describe_plan(index, recipe, options, mapped.known, hashes)
    if options["classified"] is None and not options["overwrite"]:
        refuse_overwrite(folder, plan, planned_files(index, options), carries_edits)
    warn_of_heights(index.system, options["formats"])
    given = "footprints" in polygons
    if index.points <= LOOKED_AT:  # all are looked at
        index = index.with_records()
    run = Run(
        folder=folder,
        recipe=recipe,
        index=index,
        window=window,
        facts=scan_facts(index),
        plan=plan,
        remote=traffic.as_json() if traffic.addresses else {},
        options=options,
        inputs=tuple(os.path.realpath(path) for path in paths),
        side=BLOCK_SIDE,
        given=mapped.polygons if given else None,
        lost=(*mapped.lost, *mapped.doubled) if given else (),
        addresses=() if given else mapped.polygons,
        failed=tuple(failed),
        carries_edits=carries_edits and not options["overwrite"],
        started=started,
    ).with_remarks(*remarks)
    run = replace(run, recipe=recipe.for_scan(run.blur, run.facts.rough if run.coloured else 0.0))
    refuse_run(run)
    return run.with_remarks(*mapped.remarks)


def refuse_run(run: Run) -> None:
    """Check that the run's code, fields, classes, disk and memory are there.

    Raises
    ------
    InputError
        When one is not.
    """
    options = run.options
    refuse_unknown_code(run)
    refuse_no_fields(run)
    if not (options["resume"] or run.by_tiles):
        refuse_full_disk(run)
    refuse_small_memory(run)
    if run.recipe.use_classes and not options["allow_empty"]:
        refuse_no_classes(run)


@dataclass(frozen=True, eq=False)
class MapPolygons:
    """The polygons of the map that a run is given, those that cannot be modelled, and those that another one
    holds; `known` is the map, if it is one that is known."""

    polygons: Sequence[Footprint] = ()
    lost: Sequence[Failure] = ()
    doubled: Sequence[Failure] = ()
    known: Map | None = None
    remarks: tuple[str, ...] = ()
    """What is to be said of them."""


def read_map(files: Mapping[str, Path], index: Index, window: Window, options: RunOptions) -> MapPolygons:
    """The polygons of the footprints or party walls among some files."""
    path = files.get("footprints") or files.get("party_walls")
    if path is None:
        return MapPolygons()
    known = recognise_map(path, options["footprint_source"], options["layer"])
    area = area_of(index.entries["box"][index.entries["count"] > 0], window.bounds, window.clip)
    wanted = (options["id_field"], index.system, area, known, options["allow_empty"], options["layer"])
    polygons, lost = read_footprints(path, *wanted)
    if "footprints" not in files:
        return MapPolygons(polygons, lost, (), known)
    single, doubled = without_doubled(polygons)
    remarks: tuple[str, ...] = ()
    if doubled and (first := doubled[0]).footprint is not None:
        remarks = (
            f"{path.name}: {len(doubled):,} footprints lie by half or more in others and are not modelled, "
            f"the first: '{first.footprint.id}', {first.reason}",
        )
    return MapPolygons(single, lost, doubled, known, remarks)


def look_at_scan(run: Run) -> Run:
    """The run with the facts of its scan in its plan, and its remarks in the log."""
    facts, source = run.facts, run.options["source"]
    if run.options["as_published"] and source:
        log.info("as published: %s", find_source(source).printed)
    for remark in facts.remarks():
        if remark == facts.likely_feet:
            run = run.with_remarks(remark)
        else:
            log.info("scan: %s", remark)
    warn_of_memory(run)
    return replace(run, plan={**run.plan, "scan": facts.as_json()})


def recipe_of(options: RunOptions) -> Recipe:
    """The recipe that the options name. With a terrain the cells of a DSM come with the class of the ground;
    buildings are detected all the same."""
    methods: dict[str, MethodChoice] = {stage: options.get(stage) for stage in METHOD_OPTIONS}  # type: ignore[misc]
    detector = methods["detect"]
    if options["dtm"] is not None and not is_named(detector):
        table = detector if isinstance(detector, Mapping) else {}
        methods["detect"] = {"method": DEFAULTS["detect"], **table}
    return make_recipe(
        methods,
        source=options["source"],
        published=options["as_published"],
        use_classes=options["use_classes"] or options["dtm"] is not None,
        lod=options["lod"],  # type: ignore[arg-type] # checked
        building_classes=options["building_classes"],
        ground_classes=options["ground_classes"],
        classes=options["classes"],
    )


def check_whole(index: Index, options: RunOptions) -> None:
    """Check the options that ask something of all inputs together.

    Raises
    ------
    InputError
        When one file is to hold several inputs, or a run by tiles is to be kept.
    """
    single = options["classified"]
    if single is not None and len(index) > 1:
        raise InputError(f"{single}: one file cannot hold {len(index)} inputs; give a folder with -o")
    if options["keep"] and (goes_by_tiles(index, options) or single is not None):
        raise InputError("--keep: a run by tiles keeps no parts; build a part of it with --bounds")


def request_of(run: Run) -> dict[str, Any]:
    """The request by which a run is opened again with its plan, as JSON, with paths that hold from any
    folder."""
    request = {"inputs": list(run.inputs), "options": kept_options(run.options)}
    return {**request, "generations": list(run.generations), "updates": list(run.updates)}


def stated_request(run: Run) -> dict[str, Any]:
    """The request as run.json states it; nothing of a run of very many inputs."""
    return {"request": request_of(run)} if len(run.index) <= LISTED_INPUTS else {}


def warn_of_heights(system: CoordinateSystem, formats: Sequence[str]) -> None:
    """Say once what heights are measured from, and when heights above the ellipsoid are wanted and cannot be
    had."""
    datum = vertical_datum(system)
    if system.wkt is None:
        return
    datum_text = datum["status"] if datum["name"] is None else f"{datum['name']}, {datum['status']}"
    log.info("heights: vertical datum %s", datum_text)
    if "3dtiles" in formats and datum["status"] != "known":
        log.warning(
            "3dtiles: the vertical datum of the files is %s, so their heights are taken as above the "
            "ellipsoid; install PROJ's geoid grid (pyproj sync), pass a compound --crs, or raise the tileset "
            "in the viewer",
            datum_text,
        )


def claim(folder: Path) -> None:
    """Make the output folder and see that it can be written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        TemporaryFile(dir=folder).close()  # its name is that of no other run
    except OSError as error:
        raise InputError(
            f"{folder}: the output folder cannot be written ({error.strerror}); choose another with -o"
        ) from None


def window_of(index: Index, options: RunOptions, clip: BaseGeometry | None = None) -> Window:
    """The points that are used. Of inputs that are transformed `bounds` are in their own system, where they
    meet the points so, and else in that of the results."""
    asked: Any = options["bounds"]
    area = None if asked is None else index.area_of_stored(asked)
    if area is None:
        return Window(in_metres(asked, index.system), clip)
    both = area if clip is None else shapely.intersection(area, clip)
    shapely.prepare(both)
    return Window(Bounds(*area.bounds), both)


def goes_by_tiles(index: Index, options: RunOptions) -> bool:
    """True if a run that writes a folder is computed by tiles."""
    return options["per_tile"] or index.points > TILES_ABOVE


def planned_files(index: Index, options: RunOptions) -> set[str]:
    """Names in the output folder of the files, and folders of files, that a run will write."""
    planned, names = planned_names(options["outputs"], options["formats"]), set[str]()
    by_tiles = goes_by_tiles(index, options)
    extent = within(index.extent, window_of(index, options).bounds)
    if (by_tiles or is_large(extent)) and {"rasters", "mask"} & set(options["outputs"]):
        planned.add(TILES)
    if options["steps"] and not by_tiles:
        planned.add("steps")
    classified = "classified" in options["outputs"] and not by_tiles
    for number in range(len(index)) if classified else ():
        name = classified_name(index.path(number), len(index) == 1, names)
        planned |= {name, *map(str, copies_of_points(Path(name), options["formats"]))}
    return planned


def describe_plan(
    index: Index,
    recipe: Recipe,
    options: RunOptions,
    known: Map | None,
    hashes: Mapping[str, str | None],
) -> dict[str, Any]:
    """All that decides the result, as JSON: inputs with their hashes, methods with parameters, version."""
    methods = {
        stage: method and {"method": method.address, **method.model_dump(mode="json")}
        for stage in METHOD_OPTIONS
        for method in [getattr(recipe, stage)]
    }
    bounds = options["bounds"]
    vegetation = recipe.vegetation if recipe.marks_vegetation else None
    return {
        "version": eaves.__version__,
        **index.describe(),
        "vertical_datum": vertical_datum(index.system),
        "units": name_units(index.system),
        "reference": index.reference,
        "source": options["source"] and find_source(options["source"]).cited,
        "as_published": options["as_published"],
        "methods": methods,
        "use_classes": recipe.use_classes,
        "from_raster": recipe.from_raster,
        "ground_classes": list(recipe.ground_classes) if recipe.use_classes else None,
        "vegetation": None if vegetation is None else vegetation.model_dump(),
        "others": recipe.others,
        "smallest": recipe.smallest,
        "lod": recipe.lod,
        "overhangs": asdict(recipe.overhangs) if recipe.lod == OVERHANGS else None,
        "buffer": recipe.buffer,
        "wide_buffer": recipe.wide_buffer,
        "bounds": None if bounds is None else list(bounds),
        **hashes,
        "footprint_source": None if known is None else known.describe(),
        **{name: options.get(name) for name, declared in DECLARED.items() if declared.option.recorded},
    }
