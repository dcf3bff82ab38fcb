"""The door: what is asked for is checked, and computed as one region or tile by tile."""

from __future__ import annotations

import hashlib
import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from eaves.formats import InputError
from eaves.formats.disk import report_full_disk
from eaves.formats.inputs import list_inputs
from eaves.model import Bounds
from eaves.pipeline import Recipe, make_recipe
from eaves.tiling.exports import check_formats
from eaves.tiling.index import Index, index_inputs
from eaves.tiling.outputs import EVERYTHING, Summary
from eaves.tiling.point_labels import Listener
from eaves.tiling.region import Job, Tell, everywhere
from eaves.tiling.runners import Workers
from eaves.tiling.scatter import Window
from eaves.tiling.tiles import TILES_ABOVE, by_tiles
from eaves.tiling.vectors import area_of, in_metres, read_area, read_footprints

log = logging.getLogger("eaves")


@dataclass(frozen=True)
class Options:
    """What a run is asked for besides its inputs and methods."""

    crs: str | None = None
    bounds: Bounds | None = None
    """In the units of the files' reference system; turned to metres at the door."""
    clip: Path | None = None
    footprints: Path | None = None
    id_field: str | None = None
    snap_footprints: bool = False
    party_walls: Path | None = None
    """Polygons of addresses; the blocks that are detected are split along their borders."""
    formats: tuple[str, ...] = ()
    """Names of further formats (tiling.exports)."""
    jobs: int = 1
    scheduler: str | None = None
    resume: bool = False
    block: float = 240.0
    outputs: tuple[str, ...] = ()
    """Names of the outputs to write (tiling.outputs.EVERYTHING); all for none."""
    per_tile: bool = False
    """Compute and write by tiles, each on its own, also where there are few points (tiling.tiles)."""
    classified: Path | None = None
    """Where the classified points of the one input go, without extra dimensions and without a run.json."""


def build(
    inputs: str | Path | Sequence[str | Path],
    out: str | Path,
    recipe: Recipe | None = None,
    options: Options | None = None,
    tell: Tell = lambda stage, done, total: None,
    listener: Listener | None = None,
) -> Summary:
    """Footprints, models, rasters and classified points of all inputs, written to the folder `out`.

    Parameters
    ----------
    inputs
        LAS, LAZ, COPC or text files, folders or globs.
    out
        Folder; made when missing.
    recipe
        The methods; `make_recipe()` for none.
    options
        The rest; see `Options`.
    tell
        Hears progress.
    listener
        Hears the classified points as they are written; not in a run by tiles.

    Raises
    ------
    InputError
        When an input cannot be used; nothing is written then.
    DiskFullError
        When the disk is; what is done stays for a run with `resume`.
    """
    started = time.time()
    recipe, options = recipe or make_recipe(), options or Options()
    check_formats(options.formats)
    if options.footprints is not None and options.party_walls is not None:
        raise InputError(
            f"{options.party_walls}: party walls split blocks that are detected, and footprints are given; "
            "leave one of --footprints and --party-walls out"
        )
    folder = Path(out)
    paths = list_inputs(inputs)
    failed: list[str] = []
    index = index_inputs(paths, options.crs, failed, lambda done, total: tell("index", done, total))
    bounds = in_metres(options.bounds, index.system)
    clip = None if options.clip is None else read_area(options.clip, index.system)
    given, addresses = None, []
    known = options.footprints or options.party_walls
    if known is not None:
        area = area_of(index.entries["box"][index.entries["count"] > 0], bounds, clip)
        addresses = read_footprints(known, options.id_field, index.system, area)
    if options.footprints is not None:
        given, addresses = addresses, []
    if options.classified is not None and len(index) > 1:
        raise InputError(
            f"{options.classified}: one file cannot hold {len(index)} inputs; give a folder with -o"
        )
    claim(folder)
    job = Job(
        index=index,
        recipe=recipe,
        side=options.block,
        window=Window(bounds, clip),
        plan=describe(index, recipe, options),
        given=given,
        snap=options.snap_footprints,
        addresses=addresses,
        resume=options.resume,
        formats=options.formats,
        outputs=options.outputs or EVERYTHING,
        classified=options.classified,
        failed=tuple(failed),
        started=started,
    )
    tiled = options.classified is None and (options.per_tile or index.points > TILES_ABOVE)
    with report_full_disk(folder), Workers(options.jobs, options.scheduler) as workers:
        if tiled:
            return by_tiles(job, folder, workers, tell)
        return everywhere(job, folder, workers, tell, listener)


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


def describe(index: Index, recipe: Recipe, options: Options) -> dict[str, Any]:
    """What decides the result, as JSON: inputs with their hashes, methods with parameters, block, version."""
    stages = ("ground", "detect", "outline", "units", "roof", "reconstruct")
    chosen = {stage: getattr(recipe, stage) for stage in stages}
    methods = {
        stage: method and {"method": method.name, **method.model_dump(mode="json")}
        for stage, method in chosen.items()
    }
    return {
        "version": version("eaves"),
        **index.describe(),
        "methods": methods,
        "use_classes": recipe.use_classes,
        "lod": recipe.lod,
        "block": options.block,
        "reach": recipe.reach,
        "bounds": None if options.bounds is None else list(vars(options.bounds).values()),
        "clip": None if options.clip is None else hash_of(options.clip),
        "footprints": None if options.footprints is None else hash_of(options.footprints),
        "snap_footprints": options.snap_footprints,
        "party_walls": None if options.party_walls is None else hash_of(options.party_walls),
    }


def hash_of(path: Path) -> str:
    """SHA-256 of a file."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
