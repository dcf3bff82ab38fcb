"""The contents of a run's folder, brought to one local frame and to a size a page can draw."""

from __future__ import annotations

import warnings
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
import shapely
from numpy.typing import NDArray
from rasterio.enums import Resampling
from rasterio.errors import NotGeoreferencedWarning
from rasterio.windows import from_bounds
from shapely import MultiPolygon, Polygon

from eaves.formats import InputError, iter_cityjson, read_polygons
from eaves.formats.crs import parse_crs, system_of
from eaves.formats.models.meshes import SURFACES
from eaves.geometry.roof_fit import RoofFaces, fit_roof
from eaves.model import LOCAL_METRES, LODS, Bounds, CoordinateSystem, Integers, Mask, Points, Raster, Values
from eaves.model.scene import ROOF
from eaves.report.basemap import Basemap, read_basemap
from eaves.report.sample import PointSample, Sample, classified_files, sample_points
from eaves.report.surfaces import CityFaces, collect_city_faces, in_pieces
from eaves.run.manifest import read_facts

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
