"""The files of a run, made from the parts of its blocks and buildings."""

from __future__ import annotations

import logging
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial, reduce
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
import shapely
from shapely import Polygon

from eaves.blocks.block_file import BlockFile, BlockMetadata, block_extent
from eaves.buildings.building_file import ANSWERS, SavedBuildings, read_numbers
from eaves.extensions import OUTPUTS, imported, installed
from eaves.figures.party_walls import PARTY_GAP, Walls, walls_between, walls_of, with_decimals, with_walls
from eaves.figures.rows import judge, primitive_rows
from eaves.flow.advice import feet_remark
from eaves.flow.formats import TILES, export_content, export_footprints, export_points, noted_failure
from eaves.flow.region import Region
from eaves.flow.results import (
    HOUSES,
    LAYER,
    REVIEW,
    describe_doubts,
    distinct_doubts,
    doubt_row,
    face_doubts,
    objects_remark,
    review_rows,
    write_review,
    write_table,
)
from eaves.flow.run import Run, stated_request
from eaves.flow.step import GROUND, REGIONS, SHOWN, Step
from eaves.flow.tiles import tile_of
from eaves.footprints.read import as_box
from eaves.formats import InputError, MosaicWriter, write_cityjson_seq
from eaves.formats.columns import LAYERS
from eaves.formats.qgis.project import write_project
from eaves.formats.rasters.geotiff import write_world_file
from eaves.formats.rasters.vrt import write_vrt
from eaves.formats.vectors.geopackage import Row, write_geopackage
from eaves.model import Block, Bounds, BuildingModel, CoordinateSystem, Failure
from eaves.model.block import within
from eaves.model.summary import Summary
from eaves.raster.grid import rasterize
from eaves.raster.surfaces import CELL, is_large
from eaves.run.manifest import MANIFEST, begin_manifest, set_aside, work_of_persons
from eaves.run.memory import Clock
from eaves.run.options import EVERYTHING
from eaves.run.points import Window
from eaves.run.store import SECONDS, STARTS
from eaves.run.workers import peak_memory_mb

if TYPE_CHECKING:
    from eaves.flow.classified import PointSink

log = logging.getLogger("eaves")


@dataclass(frozen=True)
class RasterPiece:
    """A file of a raster: its folder, the blocks it shows, and its extent (world metres)."""

    folder: Path
    blocks: Sequence[Block]
    extent: Bounds


def raster_pieces(run: Run, blocks: Sequence[Block], extent: Bounds) -> list[RasterPiece]:
    """The files of a raster of some blocks: one, or those of tiles, of which none is empty."""
    if not (run.by_tiles or is_large(extent)):
        return [RasterPiece(run.folder, blocks, extent)]
    tiles: dict[Block, list[Block]] = {}
    for block in blocks:
        tiles.setdefault(tile_of(block, run.tile_side), []).append(block)
    return [
        RasterPiece(
            run.folder / TILES / tile.name,
            tiles[tile],
            within(reduce(Bounds.union, (block.bounds for block in tiles[tile])), extent),
        )
        for tile in sorted(tiles)
    ]


def with_lists(run: Run, names: Sequence[str], pieces: Sequence[RasterPiece]) -> list[Path]:
    """The files of rasters of some names, and behind those that lie in several a virtual raster over them."""
    written = [piece.folder / f"{name}.tif" for piece in pieces for name in names]
    if not pieces or pieces[0].folder == run.folder:
        return written
    lists = [run.folder / f"{name}.vrt" for name in names]
    for path in lists:
        write_vrt(path, [piece.folder / f"{path.stem}.tif" for piece in pieces], run.provenance.tags)
    return written + lists


def write_surfaces(run: Run, regions: Mapping[Block, BlockFile], extent: Bounds) -> list[Path]:
    """dtm.tif, dsm.tif and their difference ndsm.tif over `extent`, each block read once for all."""
    names, pieces = ("dtm", "dsm", "ndsm"), raster_pieces(run, list(regions), extent)
    system, tags = run.index.system, run.provenance.tags
    for piece in pieces:
        with ExitStack() as stack:
            paths = [piece.folder / f"{name}.tif" for name in names]
            writers = [
                stack.enter_context(MosaicWriter(path, piece.extent, CELL, system, tags=tags))
                for path in paths
            ]
            for block in piece.blocks:
                file = regions[block]
                dtm, dsm = file.raster("dtm"), file.raster("dsm")
                over = replace(dsm, values=dsm.values - dtm.values)
                for writer, raster in zip(writers, (dtm, dsm, over), strict=True):
                    writer.write(raster, block.bounds, block.origin)
    return with_lists(run, names, pieces)


def write_run_mask(
    run: Run, blocks: Sequence[Block], polygons: Sequence[Polygon], extent: Bounds
) -> list[Path]:
    """mask.tif: the footprints (world metres) burnt into the raster cells whose centre they hold; of a
    published system with its world file."""
    tree, pieces = shapely.STRtree(polygons), raster_pieces(run, blocks, extent)
    system, tags = run.index.system, run.provenance.tags
    beside = []
    for piece in pieces:
        path = piece.folder / "mask.tif"
        with MosaicWriter(path, piece.extent, CELL, system, mask=True, tags=tags) as mosaic:
            for block in piece.blocks:
                outlines = [polygons[i] for i in np.sort(tree.query(as_box(block.bounds)))]
                part = within(block.bounds, piece.extent)  # a block may be far wider than its points
                mosaic.write(rasterize(outlines, part, CELL), block.bounds)
        if run.options["source"] is not None:  # the Vaihingen entry delivers one
            beside.append(path.with_suffix(".tfw"))
            write_world_file(beside[-1], mosaic.transform)
    return with_lists(run, ["mask"], pieces) + beside


COUNTED = ("by_lod", "trust", "failures", "fallbacks")
"""What is counted of buildings, as the summary and run.json name it."""

LONGEST_FIRST = ("steps", "classified", "models", "footprints", "rasters", "mask")


@dataclass(frozen=True, eq=False)
class BuildingRows:
    """The rows of all buildings, or of all roof faces, read anew from the store each time."""

    kept: SavedBuildings
    owners: Sequence[Block]
    shared: Sequence[dict[str, float] | None] = ()
    """The walls of the buildings (`wall_figures`), where known."""
    faces: bool = False

    def __iter__(self) -> Iterator[Row]:
        areas, numbers = iter(self.shared), read_numbers(self.kept)
        for number, row in enumerate(self.kept.rows(self.owners), 1):
            if numbers is not None:
                number = numbers.of[str(row.values["id"])][0]
            if self.faces:
                yield from (Row(shape, with_decimals(values)) for shape, values in row.faces)
            else:
                polygon = None if row.polygon.is_empty else row.polygon
                yield Row(polygon, with_decimals(row.numbered(number, next(areas, None))))


@dataclass(frozen=True, eq=False)
class RunResults:
    """The results of a run; picklable, for each output may be written by another process.

    `regions` and `owners` are those the files show, without blocks that failed.
    """

    run: Run
    kept: SavedBuildings
    regions: Mapping[Block, BlockFile]
    """The results of the blocks that the files show."""
    owners: Sequence[Block]
    extent: Bounds
    shared: Sequence[dict[str, float] | None]
    """The walls of the buildings (`wall_figures`), where known."""
    doubts: Sequence[Row]
    inputs_of: Callable[[Step, Block], Any]
    """Gives all that a step follows from in a block."""
    copies: Mapping[str, Path] = field(default_factory=dict)
    """Classified points that an earlier run wrote, by the keys of what they follow from."""

    def answers(self) -> Iterator[BuildingModel | Failure]:
        """All models and failures, owner block by owner block, the models with their party walls."""
        return finished_models(self.kept, self.owners, self.shared)


def finished_models(
    buildings: SavedBuildings,
    owners: Sequence[Block],
    shared: Sequence[dict[str, float] | None] | None = None,
) -> Iterator[BuildingModel | Failure]:
    """The models and failures of the `owners`, the models with their party walls, `shared` where known."""
    walls = iter(party_walls(buildings, owners) if shared is None else shared)
    for outcome in buildings.answers(owners):
        yield with_walls(outcome, next(walls, None))


class Written(NamedTuple):
    """What came of an output: its files, the sink with what it received, and the formats that failed."""

    files: list[Path]
    sink: PointSink | None = None
    failed: Sequence[str] = ()


class LateOutput(Protocol):
    """An output that a package brings (`eaves.outputs`), written of the other files of a run."""

    sink: PointSink
    """Receives the classified points as they are written."""

    def write(self, summary: Summary) -> Path:
        """Write it; its path."""


def page_of(run: Run) -> LateOutput | None:
    """The page of a run; None where it writes none.

    Raises
    ------
    InputError
        When no installed package brings it.
    """
    if "report" not in run.outputs or run.by_tiles:
        return None
    place = installed(OUTPUTS).get("report")
    if place is None:
        raise InputError("--outputs report: no installed package brings it; install eaves again")
    page: LateOutput = imported(place)()
    return page


def write_output(step: str, results: RunResults, sink: PointSink | None) -> Written:
    """Write what one name of `EVERYTHING` stands for. A format that fails costs no other file."""
    # imports are late where libraries come with them that other outputs do without
    run, buildings, owners = results.run, results.kept, results.owners
    folder, system, made_from = run.folder, run.index.system, run.provenance
    formats, failed = run.options["formats"], list[str]()
    if step == "footprints":
        files, rows = [folder / "footprints.gpkg"], BuildingRows(buildings, owners, results.shared)
        roofs, review = BuildingRows(buildings, owners, faces=True), review_rows(buildings.rows(owners))
        houses = [Row(box, with_decimals(facts)) for box, facts in primitive_rows(buildings.rows(owners))]
        write_geopackage(files[0], rows, roofs, system, review, results.doubts, made_from, houses)
        files.append(write_review(folder / REVIEW, review, system))
        if houses:
            files.append(
                write_table(folder / HOUSES, [one.attributes for one in houses], LAYERS["primitives"])
            )
        files += export_footprints(folder, rows, roofs, system, formats, made_from, failed)
        return Written(files, None, failed)
    if step == "models":
        files = [folder / "buildings.city.jsonl"]
        outcomes = results.answers()
        write_cityjson_seq(files[0], outcomes, system, provenance=made_from, translate=run.translate)
        files += export_content(folder, "models", results.answers, system, formats, made_from, failed)
        return Written(files, None, failed)
    if step == "mask":
        polygons = [row.polygon for row in buildings.rows(owners)]
        return Written(write_run_mask(run, list(results.regions), polygons, results.extent))
    if step == "rasters":
        return Written(write_surfaces(run, results.regions, results.extent))
    if step == "steps":
        from eaves.flow.intermediates import write_steps

        return Written(write_steps(run, list(results.regions), results.inputs_of))
    from eaves.flow.classified import write_points

    files = write_points(run, buildings, results.regions, owners, sink, results.copies)
    return Written(files + export_points(files, system, formats, failed), sink, failed)


def write_outputs(
    region: Region,
    owners: Sequence[Block],
    sink: PointSink | None = None,
    copies: Mapping[str, Path] | None = None,
) -> Summary:
    """Write what is wanted of a region, each file whole or not at all; what came out.

    Shown are the blocks but for those that failed, and the buildings of its `owners`. Of `copies`
    (key → file) are the classified points that an earlier run wrote just so.
    """
    run, kept = region.run, region.buildings
    steps = [name for name in (*EVERYTHING, "steps") if name in run.outputs and name != "report"]
    clock = Clock()
    shared = party_walls(kept, owners) if {"footprints", "models"} & set(steps) else []
    clock.lap("party walls")
    metadata = read_metadata(region)
    places = (doubt for block in metadata for doubt in block.doubts)
    doubts = distinct_doubts(chain(places, face_doubts(kept.rows(owners))), run.side)
    blocks = [block.block for block in metadata]
    results = RunResults(
        run,
        kept,
        region.results(step_shown(region), blocks),
        owners,
        block_extent(metadata),
        shared,
        list(map(doubt_row, doubts)),
        region.inputs_of(),
        copies or {},
    )
    if sink is not None:
        sizes = [int(row.values.get("points") or 0) for row in kept.rows(owners)]
        points = run.index.points if run.window == Window() else points_used(region)
        sink.start(points, len(sizes), sum(sizes))
    if run.classified is None:
        begin_writing(run)
    clock.lap("summary")
    written = write_each(region, steps, results, sink, clock)
    files = [path for step in steps for path in written.get(step, ())]
    if "footprints" in written:
        files.append(write_map(run.folder, files, region.system))
    clock.lap("summary")
    for name, spent in clock.laps.items():
        region.budget.add(name, spent)
    region.budget.step("write")
    told = run.index.own.upright is not None or run.plan.get("scan", {}).get("height_ratio") is not None
    if not told and (remark := feet_remark(kept.rows(owners))) is not None:
        region.remark(remark)
    where = LAYER if "footprints" in steps else MANIFEST if run.classified is None else ""
    summary = summarise(region, metadata, owners, files, where)
    description = describe_doubts(doubts, region.system.horizontal_unit_m, where)
    summary = replace(summary, run={**summary.run, "doubts": description})
    if run.classified is None:
        write_run(summary)
        summary = replace(summary, files=(*summary.files, run.folder / MANIFEST))
    return summary


def write_each(
    region: Region, steps: Sequence[str], results: RunResults, sink: PointSink | None, clock: Clock
) -> dict[str, list[Path]]:
    """Write some outputs, by all workers at once where there are several; output → its files."""
    workers, written = region.workers, dict[str, list[Path]]()
    region.progress("write", 0, len(steps))
    order = sorted(steps, key=LONGEST_FIRST.index)

    def finish(step: str, answer: Written) -> None:
        written[step] = answer.files
        region.failed += answer.failed
        note(region.run, answer.files)
        region.progress("write", len(written), len(steps))

    work = partial(write_output, results=results, sink=sink)
    for outcome in workers.run(work, order) if workers.started else ():
        region.peak = max(region.peak, outcome.peak_mb)
        region.budget.add(f"write {order[outcome.index]}", outcome.cpu)
        if outcome.answer is not None:
            if sink is not None and outcome.answer.sink is not None:
                sink.take_from(outcome.answer.sink)
            finish(order[outcome.index], outcome.answer)
    clock.skip()
    for step in steps:
        if step not in written:  # what failed in another process is tried here, where its error can be raised
            with noted_failure(step, region.failed):
                finish(step, write_output(step, results, sink))
            clock.lap(f"write {step}")
    return written


def write_map(folder: Path, files: Sequence[Path], system: CoordinateSystem) -> Path:
    """Write the QGIS project that shows footprints.gpkg over the terrain among `files`; its path."""
    write_project(folder / "buildings.qgz", folder / "footprints.gpkg", files, system)
    return folder / "buildings.qgz"


def begin_writing(run: Run) -> None:
    """Move aside what a person changed or added since the run began, and note what it is about to write."""
    set_aside(run.folder, [path for path, _ in work_of_persons(run.folder, run.planned)])
    begin_manifest(run.folder, planned=run.planned)


def note(run: Run, files: Sequence[Path]) -> None:
    """Note files of the run in its folder's manifest."""
    if run.classified is None:
        begin_manifest(run.folder, files=files)


def write_run(summary: Summary) -> None:
    """Write run.json into the run's folder."""
    report = {
        **summary.run,
        "points": summary.points,
        "points_used": summary.points_used,
        "found": summary.found,
        "modelled": summary.modelled,
        "failed": summary.found - summary.modelled,
        "by_lod": summary.by_lod,
        "trust": summary.trust,
        "failures": summary.failures,
        "fallbacks": summary.fallbacks,
        "stage_cpu_seconds": summary.seconds,
        "step_wall_seconds": summary.wall,
        "elapsed_seconds": round(summary.elapsed, 2),
        "incomplete": list(summary.failed),
    }
    begin_manifest(summary.folder, report)


def points_used(region: Region) -> int:
    """Number of points in the blocks that the files show."""
    return sum(visit.points for visit in region.visits.values())


def step_shown(region: Region) -> Step:
    """The step whose results the files show of each block."""
    return SHOWN if region.run.by_tiles else REGIONS


def read_metadata(region: Region) -> list[BlockMetadata]:
    """The metadata of all blocks that were computed."""
    metadata = []
    for block, result in region.results(step_shown(region), region.shown).items():
        metadata.append(result.metadata())
        if not region.run.by_tiles:
            metadata[-1].seconds["ground"] = float(region.array(GROUND, block, SECONDS))
    return metadata


def ground_starts(region: Region) -> dict[str, int]:
    """Number of blocks, and of those in which the ground filter has nothing to begin with, which is said."""
    kept, start = SHOWN if region.run.by_tiles else GROUND, region.run.recipe.ground.start
    counts = [int(region.array(kept, block, STARTS)) for block in region.shown]
    if empty := counts.count(0):
        log.info("%d of %d blocks have no %s: see the ground filter", empty, len(counts), start)
    return {"blocks": len(counts), f"without {start}": empty}


def summarise(
    region: Region,
    metadata: Sequence[BlockMetadata],
    owners: Sequence[Block],
    files: Sequence[Path],
    where: str,
) -> Summary:
    """Counts over all buildings, seconds over all blocks; `where` names what to open for doubts."""
    counts = {name: Counter[str]() for name in COUNTED}
    seconds: Counter[str] = Counter()
    count = 0
    for row in region.buildings.rows(owners):
        count += 1
        counts["trust"][judge(row.values)[0]] += 1
        seconds.update(row.seconds)
        if row.modelled:
            counts["by_lod"][row.values["lod"]] += 1
        if row.code:
            counts["fallbacks" if row.modelled else "failures"][row.code] += 1
    for block in metadata:
        seconds.update(block.seconds)
    places = (doubt for block in metadata for doubt in block.doubts)
    remark = objects_remark(places, count, region.system.horizontal_unit_m, where)
    if remark is not None:
        region.remark(remark)
    run = region.run
    tiles = {"tiles": len(region.visits)} if run.by_tiles else {}
    peak = round(max(region.peak, peak_memory_mb()))
    facts = {**stated_request(run), "crs": run.index.system.code, "peak_memory_mb": peak, **tiles}
    facts["remarks"] = list(run.remarks)
    if run.recipe.ground.start and not run.recipe.use_classes:
        facts["ground_starts"] = ground_starts(region)
    remote = {"remote": run.remote} if run.remote else {}
    return Summary(
        folder=run.folder,
        points=region.points,
        modelled=sum(counts["by_lod"].values()),
        **{name: dict(sorted(counts[name].items(), reverse=name == "by_lod")) for name in COUNTED},
        seconds=region.budget.with_stages(seconds),
        elapsed=time.time() - run.started,
        run={**run.plan, **remote, **facts},
        points_used=points_used(region),
        found=count,
        wall=region.budget.wall,
        files=tuple(files),
        failed=tuple(dict.fromkeys(region.failed)),
    )


HOMES_IN_MEMORY = 16
"""Home blocks whose buildings are kept while those around them are looked at."""


def party_walls(buildings: SavedBuildings, owners: Sequence[Block]) -> list[dict[str, float] | None]:
    """The walls each building shares with others, and its free ones, in the order of the store's results;
    None for a building without solids."""

    @lru_cache(maxsize=HOMES_IN_MEMORY)
    def load(owner: int) -> Callable[[int], Walls | None]:
        """The walls of each of an owner block's buildings: measured once, for one has several neighbours."""
        outcomes = buildings.section(owners[owner], ANSWERS)
        return lru_cache(maxsize=None)(lambda number: walls_of(outcomes[number]))

    boxes = np.array([extent_of(buildings, owner) for owner in owners], object)
    first, second = shapely.STRtree(boxes).query(boxes, predicate="dwithin", distance=PARTY_GAP)
    neighbours = {number: {number} for number in range(len(owners))}
    for owner, neighbour in zip(first.tolist(), second.tolist(), strict=True):
        neighbours[owner].add(neighbour)
    walls: list[dict[str, float] | None] = []
    for owner in neighbours:
        walls += walls_in(buildings, owners, owner, sorted(neighbours[owner]), load)
    return walls


def extent_of(buildings: SavedBuildings, owner: Block) -> Polygon:
    """The rectangle (world metres) around the buildings that a block owns."""
    outlines = [row.polygon for row in buildings.rows([owner])]
    return shapely.envelope(shapely.geometrycollections(outlines))


def walls_in(
    buildings: SavedBuildings,
    owners: Sequence[Block],
    owner: int,
    near: Sequence[int],
    load: Callable[[int], Callable[[int], Walls | None]],
) -> list[dict[str, float] | None]:
    """The walls of the buildings of one owner block, beside those of the owner blocks near it, by number."""
    places = [
        (number, place, row.polygon)
        for number in near
        for place, row in enumerate(buildings.rows([owners[number]]))
    ]
    subjects = [k for k, (number, *_) in enumerate(places) if number == owner]
    shapes = np.array([polygon for *_, polygon in places], object)
    return walls_between(shapes, subjects, lambda k: load(places[k][0])(places[k][1]))
