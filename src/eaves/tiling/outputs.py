"""The files of a run, made from the parts of its blocks and buildings."""

from __future__ import annotations

import json
import logging
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any, Literal

import numpy as np
import shapely

from eaves.formats import (
    InputError,
    MosaicWriter,
    Source,
    write_cityjson_seq,
    write_classified,
)
from eaves.formats.atomic import atomic
from eaves.formats.classified import UNCHANGED
from eaves.formats.geopackage import Row, write_geopackage
from eaves.model import Block, Bounds, BuildingModel, Failure
from eaves.pipeline import CELL, building_classes
from eaves.raster.burn import burn
from eaves.tiling.exports import export_footprints, export_models
from eaves.tiling.rows import building_row, roof_rows, world_polygon
from eaves.tiling.store import Store

log = logging.getLogger("eaves")
EVERYTHING = ("footprints", "models", "mask", "rasters", "classified")


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
        return not self.failed

    def as_text(self) -> str:
        """A few lines for the screen."""
        levels = ", ".join(
            f"LoD {lod}: {count} ({100 * count / max(self.found, 1):.1f} %)"
            for lod, count in self.by_lod.items()
        )
        lines = [
            f"{self.points:,} points, {self.found:,} buildings found = {self.modelled:,} modelled "
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


def write_outputs(
    store: Store,
    sources: Sequence[Source],
    blocks: Sequence[Block],
    homes: Sequence[Block],
    folder: Path,
    *,
    wanted: Sequence[str] = EVERYTHING,
    formats: Sequence[str] = (),
    classified: Path | None = None,
    run: dict[str, Any],
    failed: Sequence[str],
    started: float,
    tell: Callable[[str, int, int], None],
) -> Summary:
    """Write what is wanted into `folder`, each file whole or not at all, and say what came out."""
    files: list[Path] = []
    system = store.system
    steps = [name for name in EVERYTHING if name in wanted]
    rows = footprint_rows(store, homes)
    extent = extent_of(store, blocks if {"mask", "rasters"} & set(steps) else [])
    for done, step in enumerate(steps):
        tell("write", done, len(steps))
        if step == "footprints":
            files.append(folder / "footprints.gpkg")
            write_geopackage(files[-1], rows, face_rows(store, homes), system)
            files += export_footprints(folder, rows, system, formats)
        elif step == "models":
            files.append(folder / "buildings.city.jsonl")
            write_cityjson_seq(files[-1], answers(store, homes), system)
            files += export_models(folder, lambda: answers(store, homes), system, formats)
        elif step == "mask":
            files += write_mask(store, blocks, rows, extent, folder / "mask.tif")
        elif step == "rasters":
            files += write_surfaces(store, blocks, extent, folder)
        elif step == "classified":
            files += write_points(store, sources, blocks, homes, folder, classified)
    tell("write", len(steps), len(steps))

    summary = summarise(store, sources, blocks, homes, folder, files, run, failed, started)
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
    if classified is None:
        with atomic(folder / "run.json") as temporary:
            temporary.write_text(json.dumps(report, indent=2, allow_nan=False), encoding="utf-8")
    return summary


def summarise(
    store: Store,
    sources: Sequence[Source],
    blocks: Sequence[Block],
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
    for result in store.results(list(homes)):
        found += 1
        seconds.update(result.seconds)
        if isinstance(result.answer, BuildingModel):
            by_lod[result.answer.lod] += 1
            code = result.answer.attributes.get("fallback_code")
            if code:
                fallbacks[code] += 1
        else:
            failures[result.answer.code] += 1
    for block in blocks:
        if store.has("blocks", block):
            seconds.update(store.load_block(block).seconds)
    return Summary(
        folder=folder,
        points=sum(source.count for source in sources),
        found=found,
        modelled=sum(by_lod.values()),
        by_lod=dict(sorted(by_lod.items(), reverse=True)),
        failures=dict(sorted(failures.items())),
        fallbacks=dict(sorted(fallbacks.items())),
        seconds={name: round(value, 3) for name, value in seconds.items()},
        elapsed=time.time() - started,
        files=tuple(files),
        failed=tuple(failed),
        run=dict(run),
    )


def answers(store: Store, homes: Sequence[Block]) -> Iterator[BuildingModel | Failure]:
    """All models and failures, home block by home block."""
    for result in store.results(list(homes)):
        yield result.answer


def footprint_rows(store: Store, homes: Sequence[Block]) -> list[Row]:
    """Polygon (world metres) and attributes of every building."""
    rows = []
    for number, answer in enumerate(answers(store, homes), 1):
        assert answer.footprint is not None
        rows.append(Row(world_polygon(answer.footprint), building_row(number, answer)))
    return rows


def face_rows(store: Store, homes: Sequence[Block]) -> list[Row]:
    """Polygon (world metres) and attributes of every roof face."""
    return [Row(*row) for answer in answers(store, homes) for row in roof_rows(answer)]


def extent_of(store: Store, blocks: Sequence[Block]) -> Bounds:
    """World metres of all points used, widened to whole cells."""
    used = [store.load_block(block).extent for block in blocks if store.has("blocks", block)]
    if not used:
        return Bounds(0.0, 0.0, CELL, CELL)
    whole = used[0]
    for extent in used[1:]:
        whole = whole.union(extent)
    west, south = np.floor(whole.west / CELL) * CELL, np.floor(whole.south / CELL) * CELL
    east, north = (np.floor(whole.east / CELL) + 1) * CELL, (np.floor(whole.north / CELL) + 1) * CELL
    return Bounds(float(west), float(south), float(east), float(north))


def write_surfaces(store: Store, blocks: Sequence[Block], extent: Bounds, folder: Path) -> list[Path]:
    """dtm.tif and dsm.tif over `extent`, each block read once for both."""
    written = [folder / "dtm.tif", folder / "dsm.tif"]
    with ExitStack() as stack:
        dtm, dsm = (stack.enter_context(MosaicWriter(path, extent, CELL, store.system)) for path in written)
        for block in blocks:
            if store.has("blocks", block):
                result = store.load_block(block)
                dtm.write(result.dtm, block.bounds, block.origin)
                dsm.write(result.dsm, block.bounds, block.origin)
    return written


def write_mask(
    store: Store, blocks: Sequence[Block], rows: Sequence[Row], extent: Bounds, path: Path
) -> list[Path]:
    """mask.tif with its world file: the footprints burnt into the raster cells whose centre they hold."""
    polygons = [row.geometry for row in rows]
    tree = shapely.STRtree(polygons)
    with MosaicWriter(path, extent, CELL, store.system, mask=True) as mosaic:
        for block in blocks:
            near = [polygons[i] for i in np.sort(tree.query(shapely.box(*vars(block.bounds).values())))]
            mosaic.write(burn(near, block.bounds, CELL), block.bounds)
    return [path, path.with_suffix(".tfw")]


def write_points(
    store: Store,
    sources: Sequence[Source],
    blocks: Sequence[Block],
    homes: Sequence[Block],
    folder: Path,
    single: Path | None,
) -> list[Path]:
    """The classified points of every source.

    What is known of each point is gathered in files, which are opened anew for every block, so that
    memory does not grow with the input.
    """
    total = max(sum(source.count for source in sources), 1)
    types = {"classes": np.uint8, "part": np.uint8, "building_id": np.int32, "plane_id": np.int32}

    def opened(mode: Literal["w+", "r+", "r"]) -> dict[str, np.memmap[Any, Any]]:
        return {
            name: np.memmap(store.folder / f"{name}.bin", dtype, mode, shape=(total,))
            for name, dtype in types.items()
        }

    opened("w+")["classes"][:] = UNCHANGED
    number, first_plane = 0, 0
    for home in homes:
        known = opened("r+")
        for result in store.results([home]):
            number += 1
            known["building_id"][result.point_id] = number
            known["plane_id"][result.point_id] = np.where(result.plane > 0, result.plane + first_plane, 0)
            first_plane += int(result.plane.max(initial=0))
    for block in blocks:
        if store.has("blocks", block):
            known, found = opened("r+"), store.load_block(block)
            building = known["building_id"][found.point_id]
            known["classes"][found.point_id] = building_classes(found, building)
            known["part"][found.point_id] = found.part
    written: list[Path] = []
    start = 0
    for source in sources:
        path = single or folder / classified_name(source, len(sources) == 1, written)
        known = opened("r")
        mine = {key: values[start : start + source.count] for key, values in known.items()}
        classes = mine.pop("classes")
        try:
            write_classified(source, path, classes, {} if single else mine)
            written.append(path)
        except InputError as error:  # a damaged file; scattering it has said so
            log.debug("%s", error)
        start += source.count
    return written


def classified_name(source: Source, alone: bool, taken: Sequence[Path]) -> str:
    """Name of the classified copy of a source; files of one name from two folders get a number behind."""
    stem = "classified" if alone else f"classified_{Path(source.path).stem}"
    names, number = {path.stem for path in taken}, 1
    while (stem if number == 1 else f"{stem}-{number}") in names:
        number += 1
    return f"{stem}.laz" if number == 1 else f"{stem}-{number}.laz"
