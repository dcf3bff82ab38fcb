"""The contents of a run's folder, brought to one local frame and to a size a page can draw."""

from __future__ import annotations

import base64
import warnings
from array import array
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
import shapely
from numpy.typing import NDArray
from pyproj import Transformer
from pyproj.exceptions import ProjError
from rasterio.enums import ColorInterp, Resampling
from rasterio.errors import NotGeoreferencedWarning, RasterioError
from rasterio.io import MemoryFile
from rasterio.transform import Affine
from rasterio.vrt import WarpedVRT
from rasterio.warp import transform_bounds
from rasterio.windows import from_bounds
from shapely import MultiPolygon, Polygon

from eaves.formats import CityObject, InputError, iter_cityjson, read_polygons
from eaves.formats.crs import describe_system, horizontal_crs, parse_crs, system_of
from eaves.formats.models.meshes import SURFACES
from eaves.geometry.face_table import FaceTable, RoofFaces, fit_roof
from eaves.model import (
    LOCAL_METRES,
    LODS,
    NO_PLANE,
    Bounds,
    CoordinateSystem,
    Integers,
    Mask,
    Points,
    Raster,
    Values,
)
from eaves.model.scene import ROOF
from eaves.report.sample import PointSample, Sample, classified_files, sample_points
from eaves.run.manifest import read_facts

PIXELS = 2048
"""Longest side of the image: what graphics of any computer hold."""
BYTES = 1_200_000
"""The image is made coarser until it is no larger."""
QUALITY = 82
"""Of the JPEG: below 80 roofs get visible squares, above 90 it doubles in size."""
BEYOND = 190
"""Grey where the image shows nothing."""
WORLD_RADIUS = 6_378_137.0
"""Of the sphere of web mercator (m)."""
CUT = (2, 98)
"""Percentiles that become black and white in images of more than 8 bits."""


@dataclass(frozen=True)
class Basemap:
    """A JPEG of `width` by `height` pixels over a rectangle (world metres), and the name of its file."""

    jpeg: bytes
    width: int
    height: int
    bounds: Bounds
    name: str

    @property
    def address(self) -> str:
        """The image in an address, for a page that is one file."""
        return "data:image/jpeg;base64," + base64.b64encode(self.jpeg).decode("ascii")


def read_basemap(path: str | Path, system: CoordinateSystem, bounds: Bounds) -> Basemap:
    """The part of an image over `bounds` (world metres), warped to a run's system, within `BYTES`.

    Raises
    ------
    InputError
        When it is no image, it or the run has no reference system, or it shows nothing of the rectangle.
    """
    path, target = Path(path), horizontal_crs(system)
    if target is None:
        raise InputError.about(path, "the run has no reference system to lay it in", "build it with --crs")
    unit = system.horizontal_unit_m
    sides = tuple(side / unit for side in (bounds.west, bounds.south, bounds.east, bounds.north))
    wkt = target.to_wkt()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        try:
            with rasterio.open(path) as image:
                if not image.crs:
                    remedy = "give it one with gdal_edit.py -a_srs"
                    raise InputError.about(path, "has no reference system", remedy)
                covered = transform_bounds(image.crs, wkt, *image.bounds)
                refuse_elsewhere(path, covered, sides, system)
                cell = np.sqrt(
                    (covered[2] - covered[0]) * (covered[3] - covered[1]) / image.width / image.height
                )
                longest = max(sides[2] - sides[0], sides[3] - sides[1])
                pixels = min(PIXELS, max(1, round(longest / cell)))
                while True:
                    shape = image_shape(sides, pixels)
                    colours, valid = warped(image, wkt, sides, shape)
                    if not valid.any():
                        refuse_elsewhere(path, (0.0, 0.0, 0.0, 0.0), sides, system)
                    jpeg = as_jpeg(np.where(valid, colours, np.uint8(BEYOND)))
                    if len(jpeg) <= BYTES or pixels <= 64:
                        return Basemap(jpeg, shape[1], shape[0], bounds, path.name)
                    pixels = int(pixels * min(0.9, 0.97 * np.sqrt(BYTES / len(jpeg))))
        except RasterioError:
            raise InputError.about(path, "is not an image that can be read", "give a GeoTIFF") from None


def fit_web_mercator(
    system: CoordinateSystem, origin: tuple[float, float], reach: float
) -> list[list[float]] | None:
    """Polynomials that place a point on the square of web mercator (0 to 1 from the west, and from the
    north): the coefficients of 1, x, y, x², xy, y² of each, x and y being metres about `origin` up to
    `reach`. None where the reference system has no place on Earth."""
    crs = horizontal_crs(system)
    if crs is None:
        return None
    x, y = (side.ravel() for side in np.meshgrid(*[np.linspace(-1.0, 1.0, 9)] * 2))
    plane = (np.column_stack([x, y]) * reach + origin) / system.horizontal_unit_m
    try:
        move = Transformer.from_crs(crs, "EPSG:3857", always_xy=True)
    except ProjError:
        return None
    world = np.column_stack(move.transform(*plane.T)) / (2 * np.pi * WORLD_RADIUS)
    if not np.isfinite(world).all():
        return None
    terms = np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    solution = np.linalg.lstsq(terms, 0.5 + world * [1.0, -1.0], rcond=None)[0]
    return list((solution.T / reach ** np.array([0, 1, 1, 2, 2, 2])).tolist())


def image_shape(sides: tuple[float, ...], pixels: int) -> tuple[int, int]:
    """Rows and columns of square pixels over a rectangle, the longest side of so many."""
    west, south, east, north = sides
    cell = max(east - west, north - south) / pixels
    return max(1, round((north - south) / cell)), max(1, round((east - west) / cell))


def refuse_elsewhere(
    path: Path, covered: tuple[float, ...], sides: tuple[float, ...], system: CoordinateSystem
) -> None:
    """Raise when two rectangles of a run's system do not meet."""
    west, south, east, north = covered
    if west < sides[2] and sides[0] < east and south < sides[3] and sides[1] < north:
        return
    shown, extent = (",".join(f"{side:.0f}" for side in rectangle) for rectangle in (covered, sides))
    raise InputError.about(
        path,
        f"shows nothing of the run: {shown} in {describe_system(system)}, which lies in {extent}",
        "give an image of the place",
    )


def warped(
    image: Any, wkt: str, sides: tuple[float, ...], shape: tuple[int, int]
) -> tuple[NDArray[np.uint8], Mask]:
    """Colours (3, H, W) of an open image over a rectangle, and where it has any (H, W)."""
    paletted = image.colorinterp[0] == ColorInterp.palette
    way = Resampling.nearest if paletted else Resampling.average
    (west, south, east, north), (rows, columns) = sides, shape
    transform = Affine((east - west) / columns, 0.0, west, 0.0, (south - north) / rows, north)
    grid: dict[str, Any] = {"transform": transform, "width": columns, "height": rows}
    alpha = image.nodata is None and ColorInterp.alpha not in image.colorinterp
    with WarpedVRT(image, crs=wkt, resampling=way, add_alpha=alpha, **grid) as view:
        covered = np.asarray(view.dataset_mask() > 0)
        bands = view.read([1, 2, 3] if image.count >= 3 else [1])
    if paletted:
        table = np.full((256, 3), BEYOND, np.uint8)
        for number, colour in image.colormap(1).items():
            table[number] = colour[:3]
        bands = np.moveaxis(table[bands[0]], -1, 0)
    if bands.dtype != np.uint8:
        low, high = np.percentile(bands[:, covered], CUT) if covered.any() else (0.0, 1.0)
        share = (bands.astype(np.float64) - low) / max(float(high - low), 1e-9)
        bands = np.round(255 * np.clip(np.nan_to_num(share), 0.0, 1.0)).astype(np.uint8)
    return np.broadcast_to(bands, (3, *shape)), covered


def as_jpeg(colours: NDArray[np.uint8]) -> bytes:
    """Colours (3, H, W) as JPEG."""
    _, rows, columns = colours.shape
    profile = {"driver": "JPEG", "width": columns, "height": rows, "count": 3, "dtype": "uint8"}
    with MemoryFile() as memory:
        with memory.open(**profile, quality=QUALITY) as file:
            file.write(colours)
        return bytes(memory.read())


UNKNOWN_ERROR = 65535
"""RMSE (mm) of a face that no points are known of: the largest whole number of two bytes."""
PIECE_FACES = 4000
"""So many faces are cut into triangles at a time, which takes some 40 MB."""


@dataclass(frozen=True, eq=False)
class CityFace:
    """A face: its rings (M, 3), outer first, the building's number among those given, its level of detail and
    its kind as numbers in `LODS` and `SURFACES`, and the RMSE (mm) of its points, `UNKNOWN_ERROR` without.
    """

    rings: tuple[Points, ...]
    building: int
    lod: int
    kind: int
    error: int = UNKNOWN_ERROR


@dataclass(frozen=True, eq=False)
class CityFaces:
    """Many faces in a few arrays, a tenth of what they take as objects: a table of them, and of each
    `building`, `lod`, `kind` and `error` (F,) as in `CityFace`.
    """

    table: FaceTable
    building: Integers
    lod: Integers
    kind: Integers
    error: Integers

    @classmethod
    def of(cls, faces: Iterable[CityFace]) -> CityFaces:
        """The faces, taken one by one."""
        pile = _Pile()
        for face in faces:
            for ring in face.rings:
                pile.corners.frombytes(np.asarray(ring, np.float64).tobytes())
                pile.rings.append(len(ring))
            pile.counts.append(len(face.rings))
            pile.figures.extend((face.building, face.lod, face.kind, face.error))
        return pile.as_faces()

    def __len__(self) -> int:
        return len(self.building)

    def take(self, which: Mask) -> CityFaces:
        """The faces where the mask (F,) is true."""
        figures = (values[which] for values in (self.building, self.lod, self.kind, self.error))
        return CityFaces(self.table.take(which), *figures)


@dataclass(frozen=True, eq=False)
class _Pile:
    """Faces on the way into arrays: their corners, the sizes of their rings, how many rings each has, and its
    building, level of detail, kind and error."""

    corners: array[float] = field(default_factory=lambda: array("d"))
    rings: array[int] = field(default_factory=lambda: array("q"))
    counts: array[int] = field(default_factory=lambda: array("q"))
    figures: array[int] = field(default_factory=lambda: array("q"))

    def as_faces(self) -> CityFaces:
        """The faces gathered."""
        corners = np.array(self.corners, np.float64).reshape(-1, 3)
        figures = np.array(self.figures, np.int64).reshape(-1, 4).T.copy()
        return CityFaces(
            FaceTable(corners, np.array(self.rings, np.int64), np.array(self.counts, np.int64)), *figures
        )


def in_pieces(faces: CityFaces, size: int = PIECE_FACES) -> Iterator[CityFaces]:
    """The faces, so many at a time."""
    number = np.arange(len(faces))
    for first in range(0, len(faces), size):
        yield faces.take((number >= first) & (number < first + size))


def collect_city_faces(objects: Iterable[CityObject], numbers: dict[str, int]) -> CityFaces:
    """The faces of solids of the buildings whose ids `numbers` holds; a part's belong to its building."""
    pile = _Pile()
    for item in objects:
        building = numbers.get(item.parents[0] if item.parents else item.id)
        if building is None:
            continue
        for geometry in item.geometries:
            if geometry.lod not in LODS[1:]:
                continue
            errors = [whole_millimetres(about.get("rmse_m")) for about in geometry.surfaces]
            for shell in (shell for shells in geometry.solids for shell in shells):
                pile.corners.frombytes(item.vertices[shell.corners].tobytes())
                pile.rings.extend(shell.ring_sizes.tolist())
                pile.counts.extend(shell.ring_counts.tolist())
                for surface, plane in zip(shell.surfaces.tolist(), shell.planes.tolist(), strict=True):
                    kind = SURFACES.index(surface) if surface in SURFACES else 0
                    error = UNKNOWN_ERROR if plane == NO_PLANE else errors[plane]
                    pile.figures.extend((building, LODS.index(geometry.lod), kind, error))
    return pile.as_faces()


def whole_millimetres(error: float | None) -> int:
    """An RMSE (m) as `CityFace` has it."""
    return UNKNOWN_ERROR if error is None else min(round(1000.0 * error), UNKNOWN_ERROR - 1)


POINTS_SHOWN = 300_000
BUILDINGS_SHOWN = 4_000
"""More are thinned, and the page states it: what an office computer turns smoothly."""
FARTHEST = 2_000_000.0
"""Points farther (m) from the scene are left out: what whole millimetres in four bytes can hold."""
TERRAIN_CELLS = 250
"""The terrain is drawn with at most this many cells a side."""
MOST_CELLS = 1e9
"""Of a list of files around more cells, most of them empty, one cell is looked at for each that is drawn."""
ROOFS_AT_ONCE = 400
"""Number of roof faces that points are compared with at a time, which takes some 20 MB."""
EDGE = 0.01
"""Points on the rim of the terrain (m) belong to it, however they were rounded."""
MARGIN = 30.0
"""Surroundings (m) shown around the buildings where only some of them are."""


@dataclass(frozen=True, eq=False)
class Contents:
    """A run as it is drawn: everything in metres about `origin` (world metres), heights about `base`.

    `rows` and `polygons` are the buildings shown (B,), `faces` those of their models; `distance` (N,) is how
    far each roof point of the sample lies over the roof face at its place, NaN for other points;
    `terrain` has no cells where the run wrote none.
    """

    folder: Path
    origin: tuple[float, float]
    base: float
    system: CoordinateSystem
    buildings: int
    """Number of buildings that the run found, shown or not."""
    rows: list[dict[str, Any]] = field(default_factory=list)
    polygons: list[Polygon | MultiPolygon] = field(default_factory=list)
    faces: CityFaces = field(default_factory=lambda: CityFaces.of(()))
    points: Sample = field(default_factory=Sample.empty)
    distance: Values = field(default_factory=lambda: np.zeros(0))
    terrain: Raster = field(default_factory=lambda: Raster(np.zeros((0, 0), np.float32), 0.0, 0.0, 1.0))
    run: dict[str, Any] = field(default_factory=dict)
    others: list[dict[str, Any]] = field(default_factory=list)
    """Rows of the buildings not shown."""
    basemap: Basemap | None = None
    """An aerial image over the terrain."""

    def filled(
        self,
        rows: list[dict[str, Any]],
        polygons: list[Polygon | MultiPolygon],
        models: Path | None,
        sample: Sample,
        terrain: NDArray[np.float32],
        bounds: Bounds | None,
    ) -> Contents:
        """The same frame with buildings, the file of their models where there is one, points and terrain, all
        of them in world metres; the terrain lies in `bounds`."""
        shift = np.array([*self.origin, self.base])
        numbers = {str(row["id"]): number for number, row in enumerate(rows)}
        faces = collect_city_faces(iter_cityjson(models) if models else (), numbers)
        faces = replace(faces, table=faces.table.moved(-shift))
        sample = sample.with_(xyz=sample.xyz - shift)
        if not np.abs(sample.xyz).max(initial=0.0) < FARTHEST:
            sample = sample.take(np.asarray((np.abs(sample.xyz) < FARTHEST).all(axis=1)))
        west, north, cell = *self.origin, 1.0
        if bounds is not None:
            west, north, cell = bounds.west, bounds.north, bounds.width / terrain.shape[1]
        return replace(
            self,
            rows=rows,
            polygons=[shapely.transform(shape, lambda xy: xy - shift[:2]) for shape in polygons],
            faces=faces,
            points=sample,
            distance=distances_to_roofs(sample, faces),
            terrain=Raster(
                terrain - np.float32(self.base), west - self.origin[0], north - self.origin[1], cell
            ),
        )


def read_contents(
    folder: str | Path,
    points: int = POINTS_SHOWN,
    buildings: int = BUILDINGS_SHOWN,
    around: str | None = None,
    received: PointSample | None = None,
    basemap: str | Path | None = None,
    only: Collection[str] | None = None,
) -> Contents:
    """The contents of a run's folder; what a run did not write is empty.

    Of more than `buildings` those nearest to the building of the id `around` are shown, or nearest to the
    middle of all; where the ids `only` are given, these. `received` holds the sample of points, when the run
    has just written them; `basemap` is an aerial image to lay over the terrain.

    Raises
    ------
    InputError
        When the folder holds no footprints, or none of the id `around`, or a file of it is damaged, or the
        image cannot be laid over it.
    """
    folder = Path(folder)
    polygons, _, rows, system = read_polygons(folder / "footprints.gpkg", layer="footprints")
    system = system_of_folder(folder, named=False) or system
    count = len(rows)
    if only is None:
        middle = None if around is None else place_of(around, rows, folder)
        shown = nearest_buildings(polygons, buildings, middle)
    else:
        shown = np.array([place for place, row in enumerate(rows) if str(row["id"]) in only], np.int64)
    undrawn = [rows[k] for k in sorted(set(range(count)).difference(shown.tolist()))]
    polygons, rows = [polygons[k] for k in shown], [rows[k] for k in shown]
    window = drawn_window(polygons) if 0 < len(shown) < count else None
    terrain, bounds = read_terrain(terrain_file(folder), system, window)
    image = None if basemap is None else lay_image(folder, basemap, system, bounds)
    sample = sample_points(
        classified_files(folder), system, points, window, expected=points_of(rows), received=received
    )
    centre = middle_of(bounds, polygons, sample)
    base = base_of(terrain, sample)
    if bounds is not None:  # what lies outside of the run's --bounds is of no use
        sample = sample.take(np.asarray(bounds.buffered(EDGE).contains(sample.xyz)))
    models = folder / "buildings.city.jsonl"
    scene = Contents(
        folder=folder,
        origin=centre,
        base=base,
        system=system,
        buildings=count,
        others=undrawn,
        basemap=image,
        run=read_facts(folder),
    )
    return scene.filled(rows, polygons, models if models.exists() else None, sample, terrain, bounds)


def terrain_file(folder: Path) -> Path:
    """The terrain of a run, of one computed by tiles the list of theirs; it need not exist."""
    tiled = folder / "dtm.vrt"
    return tiled if tiled.exists() else folder / "dtm.tif"


def base_of(terrain: NDArray[np.float32], sample: Sample) -> float:
    """The height (whole m) about which a scene is drawn: a low one of the terrain, or of the points."""
    levels = terrain[np.isfinite(terrain)]
    heights = levels if len(levels) else sample.xyz[:, 2]
    return float(np.floor(np.percentile(heights, 1))) if len(heights) else 0.0


def lay_image(folder: Path, path: str | Path, system: CoordinateSystem, bounds: Bounds | None) -> Basemap:
    """An aerial image over the terrain of a run, which lies in `bounds`."""
    if bounds is None:
        raise InputError.about(folder, "has no terrain to lay an image on", "build it with its rasters")
    return read_basemap(path, system, bounds)


def points_of(rows: list[dict[str, Any]]) -> int:
    """Number of points that buildings have."""
    return sum(int(row.get("points") or 0) for row in rows)


def system_of_folder(folder: Path, named: bool = True) -> CoordinateSystem | None:
    """The reference system of a run, with its vertical unit, as its terrain has it; None without one. It
    has no code where it need not be `named` (`system_of`)."""
    path = terrain_file(folder)
    if not path.exists():
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        with rasterio.open(path) as image:
            if not image.crs:
                return LOCAL_METRES
            bounds = image.bounds
            centre = (bounds.left + bounds.right) / 2, (bounds.bottom + bounds.top) / 2
            return system_of(parse_crs(image.crs.to_wkt(), path), path, centre, named=named)


def place_of(building: str, rows: list[dict[str, Any]], folder: Path) -> int:
    """The place of a building's id in the rows."""
    for place, row in enumerate(rows):
        if str(row["id"]) == building:
            return place
    raise InputError.about(
        folder, f"holds no building '{building}'", "take an id of the table in report.html"
    )


def nearest_buildings(
    polygons: list[Polygon | MultiPolygon], limit: int, around: int | None = None
) -> Integers:
    """The numbers of at most `limit` polygons, in their order: those nearest to the one of number `around`,
    or to the median of all."""
    if len(polygons) <= limit:
        return np.arange(len(polygons))
    centres = shapely.get_coordinates(shapely.centroid(polygons))
    middle = np.median(centres, axis=0) if around is None else centres[around]
    away = np.hypot(*(centres - middle).T)
    return np.asarray(np.sort(np.argsort(away, kind="stable")[:limit]))


def drawn_window(polygons: list[Polygon | MultiPolygon]) -> Bounds:
    """World metres around polygons, with a margin."""
    west, south, east, north = (float(value) for value in shapely.total_bounds(polygons))
    return Bounds(west, south, east, north).buffered(MARGIN)


def read_terrain(
    path: Path, system: CoordinateSystem, window: Bounds | None
) -> tuple[NDArray[np.float32], Bounds | None]:
    """Heights (H, W) of the terrain at the page's resolution (its overviews are read) and where they lie."""
    nothing = np.zeros((0, 0), np.float32), None
    if not path.exists():
        return nothing
    unit = system.horizontal_unit_m
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        with rasterio.open(path) as image:
            part = Bounds(*(value * unit for value in image.bounds))
            if window is not None:
                part = Bounds(
                    max(part.west, window.west),
                    max(part.south, window.south),
                    min(part.east, window.east),
                    min(part.north, window.north),
                )
            if part.width <= 0 or part.height <= 0:
                return nothing
            cell = max(part.width, part.height) / TERRAIN_CELLS
            cell = max(cell, image.transform.a * unit)
            shape = max(1, round(part.height / cell)), max(1, round(part.width / cell))
            cells = part.width * part.height / (image.transform.a * unit) ** 2
            few = cells <= MOST_CELLS or bool(image.overviews(1))
            sides = (side / unit for side in (part.west, part.south, part.east, part.north))
            heights = image.read(
                1,
                window=from_bounds(*sides, transform=image.transform),
                out_shape=shape,
                masked=True,
                resampling=Resampling.average if few else Resampling.nearest,
            )
    values = heights.astype(np.float32).filled(np.nan) * np.float32(system.vertical_unit_m)
    return np.asarray(values, np.float32), part


def middle_of(
    bounds: Bounds | None, polygons: list[Polygon | MultiPolygon], sample: Sample
) -> tuple[float, float]:
    """The middle (whole world metres) of what is drawn."""
    if bounds is None and polygons:
        bounds = drawn_window(polygons)
    if bounds is None and len(sample):
        bounds = Bounds.of(sample.xyz)
    if bounds is None:
        return 0.0, 0.0
    return float(round((bounds.west + bounds.east) / 2)), float(round((bounds.south + bounds.north) / 2))


def distances_to_roofs(sample: Sample, faces: CityFaces) -> Values:
    """Distance (m) of each roof point (N,) over the finest model's roof face at its place, along the normal;
    NaN for points of no roof."""
    roofs = faces.take(finest_faces(faces) & (faces.kind == SURFACES.index("RoofSurface")))
    measured = np.flatnonzero((sample.building > 0) & ((sample.part == ROOF) | (sample.part == 0)))
    xyz = sample.xyz[measured]
    x, y, z = np.ascontiguousarray(xyz.T)
    distance, height = np.full(len(xyz), np.nan), np.full(len(xyz), -np.inf)
    for piece in in_pieces(roofs, ROOFS_AT_ONCE):
        (west, south), (east, north) = (side(piece.table.corners[:, :2], axis=0) for side in (np.min, np.max))
        candidates = np.flatnonzero((x >= west) & (x <= east) & (y >= south) & (y <= north))
        fit = fit_roof(xyz[candidates], RoofFaces.of(piece.table))
        height_at = z[candidates] - fit.vertical
        higher = height_at > height[candidates]  # false where the piece has no face
        height[candidates[higher]], distance[candidates[higher]] = height_at[higher], fit.distance[higher]
    distances = np.full(len(sample), np.nan)
    distances[measured] = distance
    return distances


def finest_faces(faces: CityFaces) -> Mask:
    """Mask (F,) of the faces of their building's finest solids."""
    finest = np.zeros(int(faces.building.max(initial=-1)) + 1, np.int64)
    np.maximum.at(finest, faces.building, faces.lod)
    return np.asarray((faces.lod > LODS.index("0")) & (faces.lod == finest[faces.building]))


def local_rings(shape: Polygon | MultiPolygon) -> list[Points]:
    """The rings (M, 2) of a polygon, without repeated last point."""
    return [
        np.asarray(shapely.get_coordinates(ring)[:-1])
        for part in shapely.get_parts(shape)
        for ring in (part.exterior, *part.interiors)
    ]
