"""The files of a run, made from the parts of its blocks and buildings."""

from __future__ import annotations

import json
import shutil
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from glob import escape
from importlib import import_module
from pathlib import Path
from typing import Any

from eaves.formats import write_cityjson_seq
from eaves.formats.atomic import atomic
from eaves.formats.geopackage import Row, write_geopackage
from eaves.model import Block, Bounds, BuildingModel, Failure
from eaves.tiling.block_file import Notes
from eaves.tiling.exports import export_footprints, export_models
from eaves.tiling.index import Index
from eaves.tiling.neighbours import party_walls
from eaves.tiling.point_labels import Listener, write_points
from eaves.tiling.rows import PARTY_WALLS
from eaves.tiling.runners import Workers, peak_memory_mb
from eaves.tiling.store import Store
from eaves.tiling.surfaces import extent_of, write_mask, write_surfaces

EVERYTHING = ("footprints", "models", "mask", "rasters", "classified")
LONGEST_FIRST = ("classified", "models", "footprints", "rasters", "mask")


@dataclass(frozen=True)
class Summary:
    """What a run found and wrote. `found` is always `modelled` + `failures`."""

    folder: Path
    points: int
    found: int
    modelled: int
    by_lod: dict[str, int]
    failures: dict[str, int]
    """Buildings without a model, by code."""
    fallbacks: dict[str, int]
    """Buildings with a coarser model than asked for, by code."""
    seconds: dict[str, float]
    elapsed: float
    files: tuple[Path, ...]
    failed: tuple[str, ...] = ()
    """Blocks that could not be computed, with the reason."""
    run: dict[str, Any] = field(default_factory=dict)

    @property
    def complete(self) -> bool:
        """Whether every block was computed and every file written."""
        return not self.failed

    def as_text(self) -> str:
        """A few lines for the screen."""
        levels = ", ".join(
            f"LoD {lod}: {count} ({100 * count / max(self.found, 1):.1f} %)"
            for lod, count in self.by_lod.items()
        )
        files = self.run.get("files", 1)
        lines = [
            f"{files:,} file{'s' * (files != 1)}, {self.points:,} points, "
            f"{self.found:,} buildings found = {self.modelled:,} modelled "
            f"+ {self.found - self.modelled:,} failed; {levels or 'no models'}"
        ]
        for title, counts in (("failed", self.failures), ("coarser than asked for", self.fallbacks)):
            if counts:
                lines.append(f"{title}: " + ", ".join(f"{code} {n}" for code, n in sorted(counts.items())))
        lines.append(
            f"{self.elapsed:.1f} s, peak {self.run.get('peak_memory_mb', 0)} MB; results in {self.folder}"
        )
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        return str(self._notebook().summary_html(self))

    def footprints(self) -> Any:
        """The footprints as a geopandas.GeoDataFrame (`pip install eaves[notebook]`)."""
        return self._notebook().footprint_frame(self.folder)

    def roof_planes(self) -> Any:
        """The roof faces as a geopandas.GeoDataFrame (`pip install eaves[notebook]`)."""
        return self._notebook().footprint_frame(self.folder, "roof_planes")

    def point_arrays(self, building: int | None = None) -> Any:
        """The classified points as arrays (`eaves.viewer.sample.Sample`), of one building by its number or
        all."""
        return self._notebook().point_arrays(self.folder, building)

    def meshes(self) -> dict[str, Any]:
        """A trimesh.Trimesh of every building's finest model, by id (`pip install eaves[notebook]`)."""
        return dict(self._notebook().building_meshes(self.folder))

    @staticmethod
    def _notebook() -> Any:
        # by name, when asked: a summary does not know the viewer, a notebook that shows one needs it
        return import_module("eaves.viewer.notebook")


@dataclass(frozen=True, eq=False)
class BuildingRows:
    """The rows of all buildings, or of all roof faces, read anew from the store each time."""

    store: Store
    homes: Sequence[Block]
    shared: Sequence[float | None] = ()
    """The party walls (m²) of the buildings, where known."""
    faces: bool = False

    def __iter__(self) -> Iterator[Row]:
        areas = iter(self.shared)
        for number, digest in enumerate(self.store.digests(self.homes), 1):
            if self.faces:
                yield from (Row(*face) for face in digest.faces)
            else:
                yield Row(digest.polygon, digest.numbered(number, next(areas, None)))


@dataclass(frozen=True, eq=False)
class OutputPlan:
    """What the files are made of; picklable, for each may be written by another process.

    `blocks` and `homes` are those the files show, without blocks that failed.
    """

    store: Store
    index: Index
    blocks: Sequence[Block]
    homes: Sequence[Block]
    extent: Bounds
    folder: Path
    formats: Sequence[str]
    shared: Sequence[float | None]
    """The party walls (m²) of the buildings, where known."""
    classified: Path | None
    listener: Listener | None

    def answers(self) -> Iterator[BuildingModel | Failure]:
        """All models and failures, home block by home block, the models with their party walls."""
        areas = iter(self.shared)
        for answer in self.store.answers(self.homes):
            area = next(areas, None)
            if isinstance(answer, BuildingModel) and area is not None:
                answer = answer.with_(attributes={**answer.attributes, PARTY_WALLS: area})
            yield answer


def write_output(step: str, plan: OutputPlan) -> tuple[list[Path], Listener | None]:
    """Write what one name of `EVERYTHING` stands for: the files, and the listener with what it heard."""
    store, homes, folder, system = plan.store, plan.homes, plan.folder, plan.store.system
    if step == "footprints":
        files, rows = [folder / "footprints.gpkg"], BuildingRows(store, homes, plan.shared)
        write_geopackage(files[0], rows, BuildingRows(store, homes, faces=True), system)
        return files + export_footprints(folder, rows, system, plan.formats), None
    if step == "models":
        files = [folder / "buildings.city.jsonl"]
        write_cityjson_seq(files[0], plan.answers(), system)
        return files + export_models(folder, plan.answers, system, plan.formats), None
    if step == "mask":
        polygons = [digest.polygon for digest in store.digests(homes)]
        return write_mask(system, plan.blocks, polygons, plan.extent, folder / "mask.tif"), None
    if step == "rasters":
        return write_surfaces(store, plan.blocks, plan.extent, folder), None
    files = write_points(store, plan.index, plan.blocks, homes, folder, plan.classified, plan.listener)
    return files, plan.listener


def write_outputs(
    store: Store,
    index: Index,
    blocks: Sequence[Block],
    homes: Sequence[Block],
    folder: Path,
    *,
    workers: Workers,
    wanted: Sequence[str] = EVERYTHING,
    formats: Sequence[str] = (),
    classified: Path | None = None,
    run: dict[str, Any],
    failed: Sequence[str],
    started: float,
    tell: Callable[[str, int, int], None],
    listener: Listener | None = None,
) -> Summary:
    """Write what is wanted into `folder`, each file whole or not at all, and say what came out.

    `blocks` and `homes` are those the files are to show; blocks that failed are left out.
    """
    steps = [name for name in EVERYTHING if name in wanted]
    shared = party_walls(store, homes) if {"footprints", "models"} & set(steps) else []
    notes = read_notes(store, blocks)
    computed, extent = [note.block for note in notes], extent_of(notes)
    plan = OutputPlan(store, index, computed, homes, extent, folder, formats, shared, classified, listener)
    if listener is not None:
        sizes = [int(digest.row.get("points") or 0) for digest in store.digests(homes)]
        listener.start(index.points, len(sizes), sum(sizes))
    written: dict[str, list[Path]] = {}
    tell("write", 0, len(steps))
    order = sorted(steps, key=LONGEST_FIRST.index)
    for outcome in workers.run(partial(write_output, plan=plan), order) if workers.started else ():
        run = {**run, "peak_memory_mb": max(run["peak_memory_mb"], round(outcome.peak_mb))}
        if outcome.answer is not None:
            written[order[outcome.index]], heard = outcome.answer
            if listener is not None and heard is not None:
                listener.take_over(heard)
            tell("write", len(written), len(steps))
    for step in steps:
        if step not in written:  # what failed in another process is tried here, where its error can be raised
            written[step] = write_output(step, plan)[0]
            tell("write", len(written), len(steps))

    files = [path for step in steps for path in written[step]]
    clear_leftovers(files)
    summary = summarise(store, index, notes, homes, folder, files, run, failed, started)
    if classified is None:
        write_run(summary)
    return summary


def clear_leftovers(files: Sequence[Path]) -> None:
    """Remove what processes that were killed have left of these files in the making."""
    for path in files:
        for place in path.parent.glob(f".{escape(path.name)}.*"):
            shutil.rmtree(place, ignore_errors=True)


def write_run(summary: Summary) -> None:
    """Write run.json into the run's folder."""
    report = {
        **summary.run,
        "points": summary.points,
        "found": summary.found,
        "modelled": summary.modelled,
        "failed": summary.found - summary.modelled,
        "by_lod": summary.by_lod,
        "failures": summary.failures,
        "fallbacks": summary.fallbacks,
        "stage_cpu_seconds": summary.seconds,
        "elapsed_seconds": round(summary.elapsed, 2),
        "incomplete": list(summary.failed),
    }
    with atomic(summary.folder / "run.json") as temporary:
        temporary.write_text(json.dumps(report, indent=2, allow_nan=False), encoding="utf-8")


def read_notes(store: Store, blocks: Sequence[Block]) -> list[Notes]:
    """The notes of all blocks that were computed."""
    notes = []
    for block in blocks:
        if store.has("blocks", block):
            with store.open_block(block) as file:
                notes.append(file.notes())
    return notes


def summarise(
    store: Store,
    index: Index,
    notes: Sequence[Notes],
    homes: Sequence[Block],
    folder: Path,
    files: Sequence[Path],
    run: dict[str, Any],
    failed: Sequence[str],
    started: float,
) -> Summary:
    """Counts over all buildings, seconds over all blocks."""
    by_lod: Counter[str] = Counter()
    failures: Counter[str] = Counter()
    fallbacks: Counter[str] = Counter()
    seconds: Counter[str] = Counter()
    found = 0
    for digest in store.digests(homes):
        found += 1
        seconds.update(digest.seconds)
        if digest.modelled:
            by_lod[digest.row["lod"]] += 1
        if digest.code:
            (fallbacks if digest.modelled else failures)[digest.code] += 1
    for note in notes:
        seconds.update(note.seconds)
    return Summary(
        folder=folder,
        points=index.points,
        found=found,
        modelled=sum(by_lod.values()),
        by_lod=dict(sorted(by_lod.items(), reverse=True)),
        failures=dict(sorted(failures.items())),
        fallbacks=dict(sorted(fallbacks.items())),
        seconds={name: round(value, 3) for name, value in seconds.items()},
        elapsed=time.time() - started,
        files=tuple(files),
        failed=tuple(failed),
        run={**run, "peak_memory_mb": max(run["peak_memory_mb"], round(peak_memory_mb()))},
    )
