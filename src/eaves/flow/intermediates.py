"""The maps of the steps of ground, detection, outlines and roofs, block by block."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rasterio.features import rasterize
from rasterio.transform import Affine
from shapely import LineString, Polygon

from eaves.blocks.block import BlockView, see_block
from eaves.detect import detect_buildings
from eaves.detect.consensus.method import CELL_SPACINGS, LEAST_CELL_M
from eaves.detect.toolkit.cells import side_near
from eaves.flow.run import Run
from eaves.flow.step import Step
from eaves.flow.steps import GROUND, REGIONS
from eaves.formats.rasters.geotiff import write_raster
from eaves.ground import classify_ground
from eaves.ground.toolkit.wide_objects import WideObjects
from eaves.methods import REGISTRY, Emit
from eaves.model import Block, Bounds, Failure, Points, Raster
from eaves.outline import regularise_outlines, trace_outline
from eaves.raster.grid import empty_raster, heights_of, highest_points, whole_cells
from eaves.recipe.sources import find_source
from eaves.roof import segment_roof

COLUMNS, PANEL_INCHES, DOTS_AN_INCH = 4, 2.6, 110


class StepMaps:
    """Rasters of what the methods of a block emit: their own, or on the cells of `grid`; of the `stages`
    alone that are asked for."""

    def __init__(self, grid: Raster, stages: Collection[str]) -> None:
        self.grid, self.stages = grid, stages
        self.maps: dict[str, Raster] = {}

    def of(self, stage: str, points: Points) -> Emit:
        """Takes the steps of a stage that sees some points (N, 3); several buildings share a map."""

        def keep(name: str, value: Any) -> None:
            drawn = self.drawn(value, points) if stage in self.stages else None
            if drawn is None:
                return
            title = f"{stage} {name}"
            before = self.maps.get(title)
            if before is not None and before.shape == drawn.shape:
                drawn = drawn.with_(values=np.where(np.isnan(drawn.values), before.values, drawn.values))
            self.maps[title] = drawn

        return keep

    def drawn(self, value: Any, points: Points) -> Raster | None:
        """A raster of a step; None for what is no map, such as an array of something that is no point."""
        if isinstance(value, Raster):
            return value.with_(values=value.values.astype(np.float32))
        values = np.asarray(value) if isinstance(value, np.ndarray) else None
        if values is not None and values.ndim == 1 and len(values) == len(points):
            return self.at_highest(points, values)
        if values is not None and values.shape[-1:] == (3,) and values.dtype.kind == "f":
            if values.ndim == 2 and len(values) == len(points):  # a vector of each point: how it rises
                return self.at_highest(points, values[:, 2])
            corners = values.reshape(-1, 3)
            return self.at_highest(corners, corners[:, 2])
        lines = lines_of(value if values is None else values)
        return self.burned(lines) if lines else None

    def at_highest(self, points: Points, values: Any) -> Raster:
        """The value of the highest point of each cell, NaN where there is none."""
        number = highest_points(points, self.grid.bounds, self.grid.cell)
        return self.grid.with_(values=heights_of(number, np.asarray(values, np.float64)))

    def burned(self, lines: Sequence[LineString]) -> Raster:
        """1 in the cells that lines cross, NaN elsewhere."""
        cell = self.grid.cell
        place = Affine(cell, 0.0, self.grid.west, 0.0, -cell, self.grid.north)
        cells = rasterize(
            lines, self.grid.shape, np.nan, transform=place, all_touched=True, default_value=1.0
        )
        return self.grid.with_(values=cells.astype(np.float32))


def lines_of(value: Any) -> list[LineString]:
    """The lines of polygons, rings, contours, segments (K, 4) and lists of them; none of anything else."""
    if isinstance(value, Polygon):
        return [LineString(ring.coords) for ring in (value.exterior, *value.interiors)]
    if isinstance(value, np.ndarray) and value.ndim == 2 and value.shape[1] == 4:
        return [LineString(ends) for ends in value.reshape(-1, 2, 2)]
    if isinstance(value, np.ndarray) and value.ndim == 2 and value.shape[1] in (2, 3) and len(value) > 1:
        return [LineString(np.vstack([value, value[:1]])[:, :2])]
    if isinstance(value, list | tuple):
        return [line for one in value for line in lines_of(one)]
    return lines_of(getattr(value, "polygon", getattr(value, "xy", None))) if value is not None else []


def block_steps(run: Run, view: BlockView, wide: WideObjects | None) -> dict[str, Raster]:
    """The map of each step of one block, by stage and name, about the origin of the block; of all that
    decides its regions, and the large objects near it."""
    recipe, block = run.recipe, view.block
    scene, seen, _ = see_block(view.cloud, block, recipe, view.beneath, view.decks)
    xyz, side = scene.cloud.xyz, side_near(max(LEAST_CELL_M, CELL_SPACINGS * scene.spacing))
    source = run.options["source"]
    stages = REGISTRY if source is None else find_source(source).methods
    maps = StepMaps(empty_raster(whole_cells(Bounds.of(xyz), side), side), stages)
    if not recipe.use_classes:
        raw = scene.cloud.with_(classification=None, part=None).in_canonical_order()
        classify_ground(raw, recipe.ground, wide=wide, debug=maps.of("ground", raw.xyz))
    if recipe.detect is None:
        return maps.maps
    regions = detect_buildings(seen, recipe.detect, debug=maps.of("detect", xyz))
    maps.of("detect", xyz)("regions", regions.label)
    order = np.argsort(regions.label, kind="stable")
    for points in np.split(order, np.flatnonzero(np.diff(regions.label[order])) + 1):
        if regions.label[points[0]] == 0:
            continue
        house = xyz[points]
        boundary = trace_outline(house, scene.spacing, recipe.outline, debug=maps.of("outline", house))
        if not isinstance(boundary, Failure):
            drawn = regularise_outlines([boundary], recipe.outline, debug=maps.of("outline", house))
            maps.of("outline", house)("outlines", [one for one in drawn if not isinstance(one, Failure)])
        segment_roof(house, scene.spacing, recipe.roof, debug=maps.of("roof", house))
    return maps.maps


def write_steps(run: Run, blocks: Sequence[Block], see: Callable[[Step, Block], Any]) -> list[Path]:
    """Write the maps of each block to `steps/BLOCK/` as GeoTIFF, in the order of the steps, and one picture
    of them all to `steps/BLOCK.png`; the files. Values are as the methods have them: metres and numbers.
    `see` gives all that a step follows from in a block."""
    files: list[Path] = []
    for block in blocks:
        folder = run.folder / "steps" / block.name
        folder.mkdir(parents=True, exist_ok=True)
        maps = block_steps(run, see(REGIONS, block), see(GROUND, block).large)
        for number, (title, raster) in enumerate(maps.items(), 1):
            files.append(folder / f"{number:02d}_{title.replace(' ', '_')}.tif")
            write_raster(files[-1], raster, run.index.system, block.origin, heights=False)
        files.append(folder.with_suffix(".png"))
        draw_steps(files[-1], maps)
    return files


def draw_steps(path: Path, maps: dict[str, Raster]) -> None:
    """All maps in one picture, as a paper's figure shows them; few whole numbers get colours far apart."""
    from matplotlib.figure import Figure

    rows = -(-len(maps) // COLUMNS)
    figure = Figure((PANEL_INCHES * COLUMNS, PANEL_INCHES * 1.1 * rows), layout="constrained")
    for number, (title, raster) in enumerate(maps.items(), 1):
        panel, values = figure.add_subplot(rows, COLUMNS, number), raster.values
        known = values[np.isfinite(values)]
        labels = len(known) > 0 and bool((known == np.round(known)).all()) and known.min() >= 0
        shown = np.where(values > 0, values * 7 % 20, np.nan) if labels else values
        low, high = np.percentile(known, [2, 98]) if len(known) and not labels else (0, 20)
        panel.imshow(shown, "tab20" if labels else "viridis", vmin=low, vmax=high, interpolation="nearest")
        panel.set_title(f"{number}. {title}" + ("" if labels else f" ({low:.2g} to {high:.2g})"), fontsize=7)
        panel.set(xticks=[], yticks=[])
    figure.savefig(path, dpi=DOTS_AN_INCH, metadata={"Software": None})
