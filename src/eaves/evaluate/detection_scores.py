"""Building detection against a reference, as in the ISPRS benchmark [rutzinger2009] [rottensteiner2014].

Both are label images on one grid. Cells that hold no point, where a cloud is the reference, are left out; so
are objects under 2.5 m². Compared are the areas, the objects, and the rims.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray
from rasterio import Affine
from rasterio.features import rasterize
from scipy import ndimage
from shapely import MultiPolygon, Polygon

from eaves.evaluate.matching import (
    SMALLEST,
    Agreement,
    Matching,
    match_objects,
    relation_of,
    rim_distances,
    rim_of,
    root_mean_square,
)
from eaves.evaluate.models import read_buildings
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
from eaves.model.checks import check_positive, check_same_shape
from eaves.raster import UNKNOWN, agreement_codes, cell_centres, empty_raster, highest_points, whole_cells

LARGE_AREAS = (10.0, 50.0)
"""Objects over these areas (m²) are counted apart."""

"""Values of the map of agreement; 0 is ground in both."""


@dataclass(frozen=True)
class ObjectRow:
    """One object: the set it is of, its area (m²), the share the other set covers, and its relation."""

    set: str
    label: int
    area_m2: float
    covered: float
    found: bool
    relation: str


@dataclass(frozen=True, eq=False)
class DetectionScore:
    """Scores of a label image of buildings.

    Parameters
    ----------
    area, objects : Agreement
        By area (m²) and by number of objects.
    objects_over : dict of float to Agreement
        Smallest area (10, 50 m²) → agreement of the objects from that size on.
    relations : dict of str to int
        Relation (`1:1`, `1:M`, `N:1`, `N:M`, `1:0`, `0:1`) → number of groups.
    rms_m : float
        Root mean square distance (m) of the outlines of correct objects from the reference outlines; NaN
        without any.
    map : ndarray (H, W) of uint8
        1 found, 2 missed, 3 false, 255 unknown, 0 no building.
    rows : tuple of ObjectRow
        One an object, those of the reference first.

    Examples
    --------
    >>> import numpy as np
    >>> from eaves.evaluate import evaluate_detection
    >>> label = np.kron([[1, 0], [0, 2]], np.ones((6, 6), int))
    >>> evaluate_detection(label, label, cell=0.5).relations["1:1"]
    2
    """

    area: Agreement
    objects: Agreement
    objects_over: dict[float, Agreement]
    relations: dict[str, int]
    rms_m: float
    map: NDArray[np.uint8]
    rows: tuple[ObjectRow, ...]


def label_objects(mask: Mask) -> Integers:
    """Labels of the pieces of a mask: cells that share a side belong together.

    Parameters
    ----------
    mask : ndarray (H, W) of bool
        True where buildings are.

    Returns
    -------
    ndarray (H, W) of int64
        1…K by piece, 0 outside.

    Raises
    ------
    ValueError
        When the mask has not two dimensions.

    Examples
    --------
    >>> import numpy as np
    >>> from eaves.evaluate import label_objects
    >>> label_objects(np.array([[1, 1, 0, 1]], bool)).tolist()
    [[1, 1, 0, 2]]
    """
    if np.ndim(mask) != 2:
        raise ValueError(f"mask must have the shape (H, W), not {np.shape(mask)}; give one raster of cells")
    labels, _ = ndimage.label(mask)
    return np.asarray(labels, np.int64)


def evaluate_detection(
    result: Integers,
    reference: Integers,
    cell: float,
    known: Mask | None = None,
    smallest: float = SMALLEST,
) -> DetectionScore:
    """Scores of a label image against a reference one.

    Parameters
    ----------
    result, reference : ndarray (H, W) of int
        Labels, 0 for no building; both of the same cells.
    cell : float
        Side of a cell (m, > 0).
    known : ndarray (H, W) of bool or None
        True where the truth is known: cells with points. By default everywhere.
    smallest : float
        Objects under this area (m², ≥ 0) are left out.

    Returns
    -------
    DetectionScore
        Agreement by area and by object, relations, outline distances, the map and the rows.

    Raises
    ------
    TypeError
        When `cell` is no number.
    ValueError
        When the images differ in shape, or `cell` is not above 0.

    Examples
    --------
    >>> import numpy as np
    >>> from eaves.evaluate import evaluate_detection, label_objects
    >>> true = np.zeros((20, 20), bool)
    >>> true[5:15, 5:15] = True
    >>> score = evaluate_detection(label_objects(np.roll(true, 1, axis=1)), label_objects(true), cell=0.5)
    >>> score.area.completeness, score.area.correctness, score.objects.completeness
    (0.9, 0.9, 1.0)
    """
    check_same_shape(result, reference, ("result", "reference"))
    if known is not None:
        check_same_shape(known, reference, ("known", "reference"))
    check_positive(cell, "cell")
    certain = np.ones(result.shape, bool) if known is None else known
    matching, result, reference = match_objects(
        np.where(certain, result, 0), np.where(certain, reference, 0), cell**2, smallest
    )
    shared = float(((result > 0) & (reference > 0)).sum()) * cell**2
    area = Agreement(shared, (reference > 0).sum() * cell**2, shared, (result > 0).sum() * cell**2)
    correct = matching.result.label[matching.result_covered >= 0.5]
    rims = rim_of(np.isin(result, correct), cell), rim_of(reference > 0, cell)
    agreement_map = agreement_codes(result > 0, reference > 0)
    agreement_map[~certain] = UNKNOWN
    return DetectionScore(
        area,
        matching.agreement(),
        {limit: matching.agreement(limit) for limit in LARGE_AREAS},
        matching.relations,
        root_mean_square(rim_distances(*rims, cell)),
        agreement_map,
        object_rows(matching),
    )


def object_rows(matching: Matching) -> tuple[ObjectRow, ...]:
    """One row an object, those of the reference first."""
    groups = matching.groups
    count = int(max(g.max(initial=-1) for g in groups)) + 1
    results, references = (np.bincount(g, minlength=count) for g in groups)
    rows = []
    for name, objects, covered, group in (
        ("reference", matching.reference, matching.reference_covered, groups[1]),
        ("result", matching.result, matching.result_covered, groups[0]),
    ):
        for label, area, share, g in zip(objects.label, objects.area, covered, group, strict=True):
            relation = relation_of(int(references[g]), int(results[g]))
            rows.append(ObjectRow(name, int(label), float(area), float(share), bool(share >= 0.5), relation))
    return tuple(rows)


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
