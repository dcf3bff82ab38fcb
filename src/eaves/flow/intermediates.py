"""The maps of the steps of all stages, block by block, and the models in three dimensions."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from rasterio.features import rasterize
from rasterio.transform import Affine
from shapely import LineString, Polygon

from eaves.blocks.block import BlockView, make_scenes
from eaves.detect import detect_buildings
from eaves.detect.consensus.method import CELL_SPACINGS, LEAST_CELL_M
from eaves.detect.toolkit.cells import side_near
from eaves.flow.run import Run
from eaves.flow.step import GROUND, REGIONS, Step
from eaves.formats.rasters.geotiff import write_raster
from eaves.ground import classify_ground
from eaves.ground.toolkit.wide_objects import WideObjects
from eaves.methods import REGISTRY, Emit
from eaves.model import Block, Bounds, BuildingModel, Failure, Points, Raster
from eaves.outline import OutlineMethod, regularise_outlines, trace_outline
from eaves.raster.grid import empty_raster, heights_of, highest_points, whole_cells
from eaves.recipe.recipe import find_source
from eaves.reconstruct import reconstruct_building
from eaves.roof import segment_roof

log = logging.getLogger("eaves")

COLUMNS, PANEL_INCHES, TITLE_INCHES, DOTS_AN_INCH = 4, 2.6, 0.3, 110


class StepMaps:
    """Rasters of what the methods of a block emit: their own, or on the cells of `grid`; of the `stages`
    alone that are asked for."""

    def __init__(self, grid: Raster, stages: Collection[str]) -> None:
        self.grid, self.stages = grid, stages
        self.maps: dict[str, Raster] = {}
        self.undrawn: dict[str, None] = {}
        """Steps that are no map, or empty."""
        self.models: list[BuildingModel] = []
        self.triangles = np.zeros((0, 3, 3))

    def of(self, stage: str, points: Points) -> Emit:
        """Takes the steps of a stage that sees some points (N, 3); several buildings share a map."""
        self.triangles = np.zeros((0, 3, 3))

        def keep(name: str, value: Any) -> None:
            title = f"{stage} {name}"
            drawn = self.drawn(value, points) if stage in self.stages else None
            if drawn is None:
                if stage in self.stages and not is_corners(value):
                    self.undrawn[title] = None
                return
            before = self.maps.get(title)
            if before is not None and before.shape == drawn.shape:
                values = drawn.values
                if (
                    isinstance(value, np.ndarray) and value.dtype.kind == "i"
                ):  # they begin anew in each building
                    highest = np.nanmax(np.append(before.values, 0.0))
                    values = np.where(values > 0, values + highest, values)
                drawn = drawn.with_(values=np.where(np.isnan(values), before.values, values))
            self.maps[title] = drawn

        return keep

    def drawn(self, value: Any, points: Points) -> Raster | None:
        """A raster of a step; None for what is no map, such as an array of something that is no point."""
        if isinstance(value, Raster):
            return value.with_(values=value.values.astype(np.float32))
        values = np.asarray(value) if isinstance(value, np.ndarray) else np.zeros((0, 0, 0))
        if is_corners(values):
            self.triangles = points[values]
            return None
        if isinstance(value, np.ndarray) and value.size == 0:
            return None
        if values.ndim < 3 and len(values) in (len(points), len(self.triangles)):
            rising = values if values.ndim == 1 else values[:, 2]  # of a vector: how it rises
            of_points = len(values) == len(points)
            return self.at_highest(points, rising) if of_points else self.over_triangles(rising)
        if values.shape[-1:] == (3,) and values.dtype.kind == "f":
            corners = values.reshape(-1, 3)
            return self.at_highest(corners, corners[:, 2])
        lines = lines_of(value)
        return self.burned([(line, 1.0) for line in lines], touched=True) if lines else None

    def over_triangles(self, values: Any) -> Raster:
        """The value of the triangle over the middle of each cell, NaN outside all of them."""
        areas = shapely.polygons(self.triangles[:, :, :2])
        return self.burned(list(zip(areas, np.asarray(values, np.float64), strict=True)), touched=False)

    def at_highest(self, points: Points, values: Any) -> Raster:
        """The value of the highest point of each cell, NaN where there is none."""
        number = highest_points(points, self.grid.bounds, self.grid.cell)
        return self.grid.with_(values=heights_of(number, np.asarray(values, np.float64)))

    def burned(self, shapes: Sequence[tuple[Any, float]], *, touched: bool) -> Raster:
        """The values of shapes in the cells that they touch, or whose middle they cover; NaN elsewhere."""
        cell = self.grid.cell
        place = Affine(cell, 0.0, self.grid.west, 0.0, -cell, self.grid.north)
        cells = rasterize(shapes, self.grid.shape, np.nan, transform=place, all_touched=touched)
        return self.grid.with_(values=cells.astype(np.float32))


def is_corners(value: Any) -> bool:
    """True for the triangles (T, 3) of a mesh by the numbers of their points: what follows is drawn on it."""
    return isinstance(value, np.ndarray) and value.shape[1:] == (3,) and value.dtype.kind == "i"


def lines_of(value: Any) -> list[LineString]:
    """The lines of polygons, rings, contours, segments (K, 4) and lists of them; none of anything else."""
    if isinstance(value, Polygon):
        return [LineString(ring.coords) for ring in (value.exterior, *value.interiors)]
    if isinstance(value, np.ndarray) and value.ndim == 2 and value.shape[1] == 4:
        return [LineString(ends) for ends in value.reshape(-1, 2, 2)]
    if isinstance(value, np.ndarray) and value.ndim == 2 and value.shape[1] in (2, 3) and len(value) > 1:
        return [LineString(np.vstack([value, value[:1]])[:, :2])]
    if isinstance(value, list | tuple) or getattr(value, "dtype", None) == np.object_:
        return [line for part in value for line in lines_of(part)]
    if getattr(value, "closed", True) is False:
        return [LineString(value.xy)]
    return lines_of(getattr(value, "polygon", getattr(value, "xy", None))) if value is not None else []


def block_steps(run: Run, view: BlockView, wide: WideObjects | None) -> StepMaps:
    """The map of each step of one block, by stage and name, and its models, about the origin of the block; of
    all that decides its regions, and the large objects near it."""
    recipe = run.recipe
    _, scene, on_decks, _ = make_scenes(view.cloud, view.around, recipe)
    xyz, side = scene.cloud.xyz, side_near(max(LEAST_CELL_M, CELL_SPACINGS * scene.spacing))
    source = run.options["source"]
    stages = REGISTRY if source is None else find_source(source).methods
    maps = StepMaps(empty_raster(whole_cells(Bounds.of(xyz), side), side), stages)
    if not recipe.use_classes:
        raw = scene.cloud.with_(classification=None, part=None).in_canonical_order()
        keep = maps.of("ground", raw.xyz)
        keep("classes", classify_ground(raw, recipe.ground, wide=wide, debug=keep).classification)
    if recipe.detect is None:
        return maps
    area, height = recipe.smallest
    keep = maps.of("detect", xyz)
    regions = detect_buildings(on_decks, recipe.detect, min_area=area, min_height=height, debug=keep)
    maps.of("detect", xyz)("regions", regions.label)
    order, houses = np.argsort(regions.label, kind="stable"), list[Points]()
    for points in np.split(order, np.flatnonzero(np.diff(regions.label[order])) + 1):
        if regions.label[points[0]] == 0:
            continue
        houses += split_parts(xyz[points], scene.spacing, recipe.outline)
    for house in houses:
        boundary = trace_outline(house, scene.spacing, recipe.outline, debug=maps.of("outline", house))
        if isinstance(boundary, Failure):
            continue
        (drawn,) = regularise_outlines([boundary], recipe.outline, debug=maps.of("outline", house))
        if isinstance(drawn, Failure):
            continue
        maps.of("outline", house)("outlines", [drawn])
        if "roof" in stages:
            planes = segment_roof(house, scene.spacing, recipe.roof, debug=maps.of("roof", house))
            base, keep = float(np.nanmin(scene.dtm.at(house))), maps.of("reconstruct", house)
            model = reconstruct_building(house, drawn, planes, base, recipe.reconstruct, debug=keep)
            maps.models += [model] if isinstance(model, BuildingModel) else []
    return maps


def split_parts(points: Points, spacing: float, outline: OutlineMethod) -> list[Points]:
    """The points (N, 3) of each part of a region that has an outline of its own."""
    number = outline.parts(points, spacing)
    return [points[number == part] for part in range(int(number.max()) + 1)]


def write_steps(run: Run, blocks: Sequence[Block], inputs_of: Callable[[Step, Block], Any]) -> list[Path]:
    """Write the maps of each block to `steps/BLOCK/` as GeoTIFF, in the order of the steps, and one picture
    of them all to `steps/BLOCK.png`; the files. Values are as the methods have them: metres and numbers.
    `inputs_of` gives all that a step follows from in a block."""
    files: list[Path] = []
    for block in blocks:
        folder = run.folder / "steps" / block.name
        folder.mkdir(parents=True, exist_ok=True)
        steps = block_steps(run, inputs_of(REGIONS, block), inputs_of(GROUND, block).large)
        for number, (title, raster) in enumerate(steps.maps.items(), 1):
            files.append(folder / f"{number:02d}_{title.replace(' ', '_')}.tif")
            write_raster(files[-1], raster, run.index.system, block.origin, heights=False)
        if missing := [title for title in steps.undrawn if title not in steps.maps]:
            log.info("steps of block %s that are empty or no map: %s", block.name, ", ".join(missing))
        files.append(folder.with_suffix(".png"))
        draw_steps(files[-1], steps)
    return files


def draw_steps(path: Path, steps: StepMaps) -> None:
    """All maps in one picture, as a paper's figure shows them, cut to the data, each with its legend; few
    whole numbers get colours far apart, and models are drawn from the south."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    count = len(steps.maps) + bool(steps.models)
    rows = -(-count // COLUMNS)
    finite = {title: np.isfinite(raster.values) for title, raster in steps.maps.items()}
    west, south, east, north = steps.grid.bounds
    height = 0.8 * PANEL_INCHES * float(np.clip((north - south) / (east - west), 0.5, 2.0)) + TITLE_INCHES
    figure = Figure((PANEL_INCHES * COLUMNS, height * rows), layout="constrained")
    for number, (title, raster) in enumerate(steps.maps.items(), 1):
        panel, values = figure.add_subplot(rows, COLUMNS, number), raster.values
        finite_values = values[finite[title]]
        labels = (
            len(finite_values) > 0
            and bool((finite_values == np.round(finite_values)).all())
            and finite_values.min() >= 0
        )
        shown = np.where(values > 0, values * 7 % 20, np.nan) if labels else values
        low, high = np.percentile(finite_values, [2, 98]) if len(finite_values) and not labels else (0, 20)
        image = panel.imshow(
            shown,
            "tab20" if labels else "viridis",
            vmin=low,
            vmax=high,
            interpolation="nearest",
            extent=(raster.west, raster.bounds.east, raster.bounds.south, raster.north),
        )
        numbers = len(np.unique(finite_values[finite_values > 0]))
        if labels:
            legend = f"{numbers} numbers, a colour each" if numbers > 1 else "marked" if numbers else "none"
            panel.legend(handles=[Patch(color=image.cmap(7), label=legend)], fontsize=5, loc="lower right")
        else:
            figure.colorbar(image, ax=panel, shrink=0.7).ax.tick_params(labelsize=5)
        panel.set_title(f"{number}. {title}", fontsize=7)
        panel.set(xticks=[], yticks=[], xlim=(west, east), ylim=(south, north))
    if steps.models:
        draw_models(figure.add_subplot(rows, COLUMNS, count, projection="3d"), steps.models, count)
    figure.savefig(path, dpi=DOTS_AN_INCH, metadata={"Software": None})


def draw_models(panel: Any, models: Sequence[BuildingModel], number: int) -> None:
    """The roofs and walls of models, seen from the south and above."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    solids = [solid for model in models for solid in model.solids[model.lod]]
    faces = [(solid, face) for solid in solids for face in solid.faces if face.surface != "GroundSurface"]
    rings = [solid.vertices[list(face.rings[0])] for solid, face in faces]
    colours = ["indianred" if face.surface == "RoofSurface" else "lightgrey" for _, face in faces]
    shapes = Poly3DCollection(rings, facecolors=colours, edgecolor="0.3", linewidths=0.2)
    panel.add_collection(shapes, autolim=False)  # its own limits are read off padded, unset vertices
    ends = np.concatenate([solid.vertices for solid in solids])
    low, high = ends.min(axis=0), ends.max(axis=0)
    panel.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    panel.set_box_aspect(np.maximum(high - low, 1.0))
    panel.view_init(elev=40.0, azim=-80.0)
    panel.set_axis_off()
    panel.set_title(f"{number}. models", fontsize=7)
