"""Label images of what is to be compared, all on one grid: from rasters, clouds, polygons and city models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from pathlib import Path

import numpy as np
import shapely
from rasterio import Affine
from rasterio.features import rasterize
from shapely import MultiPolygon, Polygon

from eaves.evaluate.city import read_buildings
from eaves.evaluate.detection_scores import label_objects
from eaves.formats import InputError, read, read_polygons, read_raster
from eaves.geometry import RoofFaces
from eaves.model import (
    BUILDING,
    LOCAL_METRES,
    Bounds,
    CoordinateSystem,
    Integers,
    Mask,
    PointCloud,
    Raster,
    Values,
)
from eaves.raster import cell_centres, empty_raster, highest_points, whole_cells

CELL = 0.5
"""Side (m) of the cells, unless a raster has its own."""

RASTERS = (".tif", ".tiff", ".vrt", ".img")
CLOUDS = (".las", ".laz", ".xyz", ".txt", ".asc", ".csv")
CITY = (".city.json", ".city.jsonl", ".jsonl")

HEAD = 1 << 16
"""Bytes of a file named .json in which CityJSON names itself."""


def kind_of(path: Path) -> str:
    """`raster`, `cloud`, `city` or `polygons`, by the file's name."""
    name = path.name.lower()
    for kind, endings in (("raster", RASTERS), ("cloud", CLOUDS), ("city", CITY)):
        if name.endswith(endings):
            return kind
    if name.endswith(".json") and path.is_file():
        with path.open("rb") as file:
            return "city" if b'"CityJSON"' in file.read(HEAD) else "polygons"
    return "polygons"


@dataclass(frozen=True, eq=False)
class BuildingSource:
    """The buildings of a file: one of a raster, a cloud or polygons, in world metres."""

    system: CoordinateSystem
    raster: Raster | None = None
    cloud: PointCloud | None = None
    polygons: tuple[Polygon | MultiPolygon, ...] = ()
    ids: tuple[str, ...] = ()

    @property
    def bounds(self) -> Bounds | None:
        """World bounds; None when there is nothing."""
        if self.raster is not None:
            return self.raster.bounds
        if self.cloud is not None:
            return self.cloud.bounds.translated(*self.cloud.origin) if len(self.cloud) else None
        return Bounds(*map(float, shapely.total_bounds(self.polygons))) if self.polygons else None

    def label_image(self, grid: Raster) -> tuple[Integers, Mask]:
        """Labels of buildings (H, W) on the cells of a grid, and where they are known."""
        if self.raster is not None:
            return _from_raster(self.raster, grid)
        if self.cloud is not None:
            return _from_cloud(self.cloud, grid)
        burnt = burn_labels(self.polygons, grid)
        return label_objects(burnt > 0), np.ones(grid.shape, bool)


def open_buildings(path: Path, target: CoordinateSystem | None = None) -> BuildingSource:
    """The buildings of a label raster, a classified cloud, polygons or a city model."""
    kind = kind_of(path)
    if kind == "raster":
        raster, system = read_raster(path)
        return BuildingSource(system, raster=raster)
    if kind == "cloud":
        cloud = read(path)
        if cloud.classification is None:
            raise InputError.about(path, "has no classes", "give a cloud with class 6 for buildings")
        return BuildingSource(cloud.system, cloud=cloud)
    if kind == "city":
        buildings = [item for item in read_buildings(path) if not item.footprint.is_empty]
        shapes = tuple(item.footprint for item in buildings)
        system = buildings[0].system if buildings else LOCAL_METRES
        return BuildingSource(system, polygons=shapes, ids=tuple(item.id for item in buildings))
    outlines, ids, attributes, system = read_polygons(path, target=target)
    if all("id" in row for row in attributes):
        ids = [str(row["id"]) for row in attributes]
    return BuildingSource(system, polygons=tuple(outlines), ids=tuple(ids))


def common_grid(result: BuildingSource, reference: BuildingSource, cell: float = CELL) -> Raster:
    """An empty grid over the reference; of a raster if there is one, else of whole cells over both."""
    for source in (reference, result):
        if source.raster is not None:
            return source.raster.with_(values=np.zeros(source.raster.shape, np.float32))
    boxes = [source.bounds for source in (reference, result) if source.bounds is not None]
    if reference.cloud is not None:
        boxes = boxes[:1]
    if not boxes:
        return Raster(np.zeros((1, 1), np.float32), 0.0, cell, cell)
    return empty_raster(whole_cells(reduce(Bounds.union, boxes), cell), cell, 0.0)


def burn_labels(polygons: Sequence[Polygon | MultiPolygon], grid: Raster) -> Integers:
    """Cells (H, W) whose centre lies in polygon k get k + 1; of several polygons the last."""
    shapes = [(shape, number) for number, shape in enumerate(polygons, 1) if not shape.is_empty]
    if not shapes:
        return np.zeros(grid.shape, np.int64)
    transform = Affine(grid.cell, 0.0, grid.west, 0.0, -grid.cell, grid.north)
    return np.asarray(rasterize(shapes, grid.shape, transform=transform, dtype="int32"), np.int64)


def plane_image(faces: RoofFaces, grid: Raster) -> tuple[Integers, Values]:
    """The number, from 1, of the highest roof face at each cell centre (H, W), and its height; else 0, NaN.

    The faces' origin is the grid's.
    """
    burnt_labels = np.zeros(grid.shape, np.int64)
    heights = np.full(grid.shape, np.nan)
    for number, (shape, (a, b, c)) in enumerate(zip(faces.polygons, faces.coefficients, strict=True), 1):
        west, south, east, north = shape.bounds
        rows, columns = grid.cell_of(np.array([[west, north], [east, south]]))
        top, bottom = np.clip(rows + [0, 1], 0, grid.shape[0])
        left, right = np.clip(columns + [0, 1], 0, grid.shape[1])
        x = grid.west + (np.arange(left, right) + 0.5) * grid.cell
        y = grid.north - (np.arange(top, bottom) + 0.5) * grid.cell
        xx, yy = np.meshgrid(x, y)
        height = a * xx + b * yy + c
        window = np.s_[top:bottom, left:right]
        higher = shapely.contains_xy(shape, xx, yy) & ~(height <= heights[window])
        burnt_labels[window][higher], heights[window][higher] = number, height[higher]
    return burnt_labels, heights


def _from_raster(raster: Raster, grid: Raster) -> tuple[Integers, Mask]:
    """Nearest cells; several values are labels, one value is a mask whose pieces are the objects."""
    row, column = raster.cell_of(cell_centres(grid))
    inside = (row >= 0) & (row < raster.shape[0]) & (column >= 0) & (column < raster.shape[1])
    values = np.full(len(row), np.nan, np.float32)
    values[inside] = raster.values[row[inside], column[inside]]
    covered = np.isfinite(values).reshape(grid.shape)
    labels = np.nan_to_num(values).astype(np.int64).reshape(grid.shape)
    if len(np.unique(labels[labels > 0])) < 2:
        labels = label_objects(labels > 0)
    return labels, covered


def _from_cloud(cloud: PointCloud, grid: Raster) -> tuple[Integers, Mask]:
    """A cell is of the class of its highest point; cells without points are not known."""
    use = cloud.take(~cloud.noise)
    top = highest_points(use.xyz, grid.bounds.translated(-cloud.origin[0], -cloud.origin[1]), grid.cell)
    assert use.classification is not None
    covered = np.asarray(top >= 0)
    if len(use) == 0:
        return np.zeros(grid.shape, np.int64), covered
    building: Mask = covered & (use.classification[np.maximum(top, 0)] == BUILDING)
    return label_objects(building), covered
