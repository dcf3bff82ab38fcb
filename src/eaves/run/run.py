"""One description of a run: what is asked for, checked, with the inputs indexed."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypedDict, Unpack

from eaves.footprints.read import area_of, in_metres, read_area, read_footprints
from eaves.formats import InputError
from eaves.formats.inputs import list_inputs
from eaves.methods import MethodChoice
from eaves.model import Bounds, Footprint
from eaves.run.exports import check_formats
from eaves.run.index import Index, index_inputs
from eaves.run.partition import Window
from eaves.run.recipe import Recipe, make_recipe

EVERYTHING = ("footprints", "models", "mask", "rasters", "classified")
"""The outputs there are; see `eaves.run.outputs`."""
TILES_ABOVE = 2_000_000_000
"""More points than this are computed by tiles: their temporary files would take 46 GB and more."""

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
    use_classes: bool
    """Use the classes of the files: 2 is ground, 6 building, 7 and 18 noise."""
    as_published: bool
    lod: str
    """The finest level of detail: 0, 1.2, 1.3, 2.0 or 2.2."""
    crs: str | None
    bounds: Bounds | Sequence[float] | None
    """West, south, east, north in the unit of the files' reference system."""
    clip: str | Path | None
    """Polygons; points outside are not used."""
    footprints: str | Path | None
    id_field: str | None
    snap_footprints: bool
    party_walls: str | Path | None
    """Polygons of addresses; the blocks that are detected are split along their borders."""
    formats: Sequence[str]
    """Names of further formats (`eaves.run.exports`)."""
    outputs: Sequence[str]
    """Names of the outputs to write (`EVERYTHING`); all for none."""
    block: float
    """Side of a block (m)."""
    jobs: int
    """Processes."""
    scheduler: str | None
    """Address of a Dask scheduler."""
    resume: bool
    """Keep the parts of an earlier run that are done and match."""
    per_tile: bool
    """Compute and write by tiles, each on its own, also where there are few points (`eaves.run.tiles`)."""
    classified: Path | None
    """Where the classified points of the one input go, without extra dimensions and without a run.json."""


@dataclass(frozen=True, eq=False)
class Run:
    """What is to be computed: picklable, so that a worker can compute a tile on its own."""

    folder: Path
    recipe: Recipe
    index: Index
    window: Window
    plan: dict[str, Any]
    """What decides the result (`describe`)."""
    side: float = 240.0
    """Side of a block (m)."""
    given: Sequence[Footprint] | None = None
    snap_footprints: bool = False
    addresses: Sequence[Footprint] = ()
    """What lies between known party walls; detected blocks are split into them."""
    formats: tuple[str, ...] = ()
    outputs: tuple[str, ...] = EVERYTHING
    classified: Path | None = None
    jobs: int = 1
    scheduler: str | None = None
    resume: bool = False
    by_tiles: bool = False
    failed: tuple[str, ...] = ()
    """Inputs that could not be opened, with the reason."""
    started: float = 0.0


def open_run(
    inputs: str | Path | Sequence[str | Path],
    out: str | Path,
    recipe: Recipe | None = None,
    progress: Progress = no_progress,
    **options: Unpack[RunOptions],
) -> Run:
    """The run that is asked for: every word checked, headers read, footprints read, the folder made.

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
        See `RunOptions`.

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
    if recipe is None:
        recipe = make_recipe(
            {stage: options.get(stage) for stage in METHOD_OPTIONS},  # type: ignore[misc]
            published=options.get("as_published", False),
            use_classes=options.get("use_classes", False),
            lod=options.get("lod", "2.2"),
        )
    formats = tuple(options.get("formats") or ())
    check_formats(formats)
    footprints, party_walls = options.get("footprints"), options.get("party_walls")
    if footprints is not None and party_walls is not None:
        raise InputError(
            f"{party_walls}: party walls split blocks that are detected, and footprints are given; "
            "leave one of --footprints and --party-walls out"
        )
    folder, paths = Path(out), list_inputs(inputs)
    failed: list[str] = []
    index = index_inputs(
        paths, options.get("crs"), failed, lambda done, total: progress("index", done, total)
    )
    bounds = in_metres(as_bounds(options.get("bounds")), index.system)
    clip = options.get("clip")
    window = Window(bounds, None if clip is None else read_area(Path(clip), index.system))
    known_polygons: list[Footprint] = []
    if (path := footprints or party_walls) is not None:
        area = area_of(index.entries["box"][index.entries["count"] > 0], window.bounds, window.clip)
        known_polygons = read_footprints(Path(path), options.get("id_field"), index.system, area)
    classified = options.get("classified")
    if classified is not None and len(index) > 1:
        raise InputError(f"{classified}: one file cannot hold {len(index)} inputs; give a folder with -o")
    claim(folder)
    return Run(
        folder=folder,
        recipe=recipe,
        index=index,
        window=window,
        plan=describe(index, recipe, options),
        side=options.get("block", 240.0),
        given=None if footprints is None else known_polygons,
        snap_footprints=options.get("snap_footprints", False),
        addresses=() if party_walls is None else known_polygons,
        formats=formats,
        outputs=tuple(options.get("outputs") or EVERYTHING),
        classified=classified,
        jobs=options.get("jobs", 1),
        scheduler=options.get("scheduler"),
        resume=options.get("resume", False),
        by_tiles=classified is None and (options.get("per_tile", False) or index.points > TILES_ABOVE),
        failed=tuple(failed),
        started=started,
    )


METHOD_OPTIONS = ("ground", "detect", "outline", "units", "roof", "reconstruct")


def as_bounds(bounds: Bounds | Sequence[float] | None) -> Bounds | None:
    """Bounds from four numbers."""
    if bounds is None or isinstance(bounds, Bounds):
        return bounds
    west, south, east, north = bounds
    return Bounds(west, south, east, north)


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


def describe(index: Index, recipe: Recipe, options: RunOptions) -> dict[str, Any]:
    """What decides the result, as JSON: inputs with their hashes, methods with parameters, block, version."""
    methods = {
        stage: method and {"method": method.name, **method.model_dump(mode="json")}
        for stage in METHOD_OPTIONS
        for method in [getattr(recipe, stage)]
    }
    bounds = as_bounds(options.get("bounds"))
    return {
        "version": version("eaves"),
        **index.describe(),
        "methods": methods,
        "use_classes": recipe.use_classes,
        "lod": recipe.lod,
        "block": options.get("block", 240.0),
        "buffer": recipe.buffer,
        "bounds": None if bounds is None else list(vars(bounds).values()),
        "clip": hash_of(options.get("clip")),
        "footprints": hash_of(options.get("footprints")),
        "snap_footprints": options.get("snap_footprints", False),
        "party_walls": hash_of(options.get("party_walls")),
    }


def hash_of(path: str | Path | None) -> str | None:
    """SHA-256 of a file."""
    if path is None:
        return None
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
