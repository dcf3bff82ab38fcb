"""Sunlight on the roofs of a run's folder, square by square: `solar.gpkg` and `irradiation.tif`."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from eaves.formats import (
    InputError,
    MosaicWriter,
    RasterWindow,
    Row,
    horizontal_crs,
    read_polygons,
    read_upright,
    write_layers,
)
from eaves.model import Bounds, CoordinateSystem, Raster
from eaves.solar.roofs import FaceLight, SolarRules, best_in_the_open, light_on_faces
from eaves.solar.sun import ClearSky, Weather

SQUARE = 480.0
"""Side (m) of the squares, fixed to the world, whose roofs are computed together."""
NAME, IRRADIATION = "solar.gpkg", "irradiation.tif"


@dataclass(frozen=True)
class SolarSummary:
    """The result: numbers of roof faces and buildings, and sums over all of them."""

    path: Path
    faces: int
    buildings: int
    roof_m2: float
    light_mwh: float
    usable_m2: float
    current_mwh: float | None
    """None under a sky that is not the place's."""
    sky: str

    def as_text(self) -> str:
        """The summary in lines."""
        electricity = "no yield of electricity without --weather or --annual"
        if self.current_mwh is not None:
            electricity = f"{self.current_mwh:,.0f} MWh of electricity a year"
        return (
            f"{self.faces:,} roof faces of {self.buildings:,} buildings, {self.roof_m2:,.0f} m²: "
            f"{self.light_mwh:,.0f} MWh of sunlight a year ({self.sky})\n"
            f"usable for panels: {self.usable_m2:,.0f} m², {electricity}\n"
            f"  layers roofs and buildings: {self.path}\n"
            f"  kWh/m² a year on the roofs, cell by cell: {self.path.with_name(IRRADIATION)}"
        )


def measure_solar(
    folder: str | Path,
    rules: SolarRules | None = None,
    sky: Weather | ClearSky | None = None,
    place: tuple[float, float] | None = None,
    progress: Callable[[str, int, int], None] = lambda step, done, total: None,
) -> SolarSummary:
    """The sunlight on every roof face of a run, written to `solar.gpkg` and `irradiation.tif` in its folder.

    Layer `roofs`: the faces with kWh/m² by month and year, the share that shadows take, the sky that is seen,
    and what of the face panels can use. Layer `buildings`: the sums by building. The raster has kWh/m² a year
    along the slope on the cells of the surface that lie on a roof. The name of the sky is in the layers,
    their styles and the raster; the yield `pv_kwh` is empty under a sky that is clear all year.

    Parameters
    ----------
    folder : str or Path
        What a run wrote, with `footprints.gpkg` and `dsm.tif`.
    rules : SolarRules or None
        Constants; None for the defaults.
    sky : Weather, ClearSky or None
        Measured or typical light, or a clear sky with the yearly sum of the place; None is a clear sky all
        year, an upper bound.
    place : (float, float) or None
        Latitude and longitude (degrees), for data whose reference system is unknown.
    progress : callable
        Called with the step, how much of it is done, and how much there is.

    Returns
    -------
    SolarSummary
        Sums over all roofs.

    Raises
    ------
    InputError
        When the folder has no roofs or no surface, or the place is unknown, or its sky cannot give
        the yearly sum.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope, write_simulation
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> files = write_simulation(truth, "nine")
    >>> results = eaves.build(files["points"], "out", jobs=1)
    >>> from eaves.solar.folder import measure_solar
    >>> summary = measure_solar("out", place=(52.0, 4.4))
    >>> summary.faces > 9, summary.light_mwh > 0.0
    (True, True)
    """
    folder, rules, sky = Path(folder), rules or SolarRules(), sky or ClearSky()
    surface = next((folder / name for name in ("dsm.tif", "dsm.vrt") if (folder / name).exists()), None)
    if surface is None:
        raise InputError.about(folder, "has no dsm.tif", "build it with `eaves build`, which writes one")
    with RasterWindow(surface) as window:
        system = window.system
        roofs = read_upright(folder / "footprints.gpkg", "roof_planes", system)
        if not roofs:
            raise InputError.about(folder, "has no roof faces", "build with a level of detail above 0")
        boxes = shapely.bounds([row.geometry for row in roofs]).reshape(-1, 4)
        squares: dict[tuple[int, int], list[int]] = defaultdict(list)
        for number, (west, south, east, north) in enumerate(boxes):
            square = math.floor((west + east) / 2 / SQUARE), math.floor((south + north) / 2 / SQUARE)
            squares[square].append(number)
        rows: list[dict[str, Any]] = [{} for _ in roofs]
        tags = {"irradiation": "kWh/m² a year along the slope of the roofs", "sky": sky.name}
        extent, cell = window.bounds, window.cell
        with MosaicWriter(folder / IRRADIATION, extent, cell, system, tags=tags, heights=False) as raster:
            for done, square in enumerate(sorted(squares)):
                progress("solar", done, len(squares))
                piece, corner, lights = square_light(roofs, boxes, squares[square], window, rules, sky, place)
                raster.overlay(piece, corner)
                for number, light in zip(squares[square], lights, strict=True):
                    rows[number] = roof_row(roofs[number].attributes, light, rules, sky)
        progress("solar", len(squares), len(squares))
    written = [Row(roof.geometry, row) for roof, row in zip(roofs, rows, strict=True)]
    shapes, _, outlines, _ = read_polygons(folder / "footprints.gpkg", "footprints", target=system)
    buildings = building_rows(shapes, outlines, rows, sky)
    write_layers(folder / NAME, {"roofs": written, "buildings": buildings}, system, note=sky.name)
    return SolarSummary(
        folder / NAME,
        len(rows),
        len(buildings),
        sum(row["area_m2"] for row in rows),
        sum(row["light_kwh"] for row in rows) / 1000.0,
        sum(row["usable_m2"] for row in rows),
        sum(row["pv_kwh"] for row in rows) / 1000.0 if sky.measured else None,
        sky.name,
    )


def square_light(
    roofs: Sequence[Row],
    boxes: np.ndarray[Any, Any],
    own_faces: Sequence[int],
    window: RasterWindow,
    rules: SolarRules,
    sky: Weather | ClearSky,
    place: tuple[float, float] | None,
) -> tuple[Raster, tuple[int, int], list[FaceLight]]:
    """The light on the faces `own_faces` of one square, with all that stands within reach; before it the
    light (kWh/m² a year) on their cells about a corner, and that corner."""
    west, south = boxes[own_faces, :2].min(axis=0)
    east, north = boxes[own_faces, 2:].max(axis=0)
    square_bounds = Bounds(west, south, east, north)
    view = square_bounds.buffered(rules.reach)
    corner = (math.floor(west), math.floor(south))
    dsm = window.read(view, corner)
    meets = (boxes[:, 0] < view.east) & (boxes[:, 2] > view.west)
    meets &= (boxes[:, 1] < view.north) & (boxes[:, 3] > view.south)
    candidates = np.flatnonzero(meets)
    faces = [
        shapely.transform(roofs[number].geometry, lambda xyz: xyz - [*corner, 0.0], include_z=True)
        for number in candidates.tolist()
    ]
    latitude, longitude, convergence = site_of(window.system, ((west + east) / 2, (south + north) / 2), place)
    height = float(np.nanmean([face.exterior.coords[0][2] for face in faces]))
    hours = sky.hours(latitude, longitude, height)
    best = best_in_the_open(hours, rules)
    chosen = np.searchsorted(candidates, own_faces).tolist()
    lights = light_on_faces(faces, dsm, hours, convergence, rules, best, chosen)
    values = np.full(dsm.shape, np.nan, np.float32)
    for light in lights:
        values[light.cells] = light.year
    return replace(dsm, values=values), corner, lights


def site_of(
    system: CoordinateSystem, xy: tuple[float, float], place: tuple[float, float] | None
) -> tuple[float, float, float]:
    """Latitude and longitude of world metres `xy`, and the convergence of the meridians there (degrees).

    Raises
    ------
    InputError
        When the system has no place on Earth and none is given.
    """
    crs = horizontal_crs(system)
    if place is None:
        if crs is None:
            raise InputError(
                "the data have no reference system, so the sun's way is unknown; give --latitude"
            )
        from pyproj import Transformer

        unit = system.horizontal_unit_m
        to_degrees = Transformer.from_crs(crs, "OGC:CRS84", always_xy=True)
        longitude, latitude = to_degrees.transform(xy[0] / unit, xy[1] / unit)
        if not (math.isfinite(latitude) and math.isfinite(longitude)):
            raise InputError("the roofs lie outside their reference system; check --crs, or give --latitude")
        place = latitude, longitude
    return *place, 0.0 if crs is None else convergence_of(crs, *place)


NORTHWARDS = 100.0
"""Units of the system by which one goes along its northing to see where true north lies."""


def convergence_of(crs: Any, latitude: float, longitude: float) -> float:
    """Degrees by which grid north of a plane system lies clockwise of true north at a place."""
    from pyproj import Geod, Transformer

    to_grid = Transformer.from_crs("OGC:CRS84", crs, always_xy=True)
    x, y = to_grid.transform(longitude, latitude)
    east, north = to_grid.transform(x, y + NORTHWARDS, direction="INVERSE")
    turn, _, _ = Geod(ellps="WGS84").inv(longitude, latitude, east, north)
    return float(turn) if math.isfinite(turn) else 0.0


def roof_row(
    row: Mapping[str, Any], light: FaceLight, rules: SolarRules, sky: Weather | ClearSky
) -> dict[str, Any]:
    """The attributes of a face in the layer `roofs`."""
    columns = ("building_id", "lod", "slope_deg", "azimuth_deg", "area_m2")
    year, in_the_open = float(light.month.sum()), float(light.open_month.sum())
    area = float(row.get("area_m2") or 0.0)
    return {
        **{name: row.get(name) for name in columns},
        "light_kwh_m2": round(year, 1),
        "light_kwh": round(year * area),
        "shade_share": round(max(0.0, 1.0 - year / in_the_open), 3) if in_the_open > 0.0 else None,
        "sky_share": round(light.sky, 3),
        "covered_share": round(light.covered, 3),
        "usable_m2": round(light.usable_m2, 1),
        "usable_kwh_m2": round(light.usable, 1) if light.usable_m2 > 0.0 else None,
        "pv_kwh": round(light.usable_m2 * light.usable * rules.efficiency * rules.performance)
        if sky.measured
        else None,
        "sky": sky.name,
        **{f"light_{k:02d}_kwh_m2": round(float(energy), 2) for k, energy in enumerate(light.month, 1)},
    }


SUMS = ("light_kwh", "usable_m2", "pv_kwh")
"""Columns of the faces that a building has the sums of; the last one has none under a clear sky."""


def building_rows(
    shapes: Sequence[Polygon | MultiPolygon],
    outlines: Sequence[dict[str, Any]],
    roofs: Sequence[dict[str, Any]],
    sky: Weather | ClearSky,
) -> list[Row]:
    """The buildings that have roof faces, with the sums over these."""
    sums: dict[str, dict[str, float]] = {}
    for row in roofs:
        names = SUMS if sky.measured else SUMS[:-1]
        total = sums.setdefault(str(row["building_id"]), dict.fromkeys(("roof_area_m2", *names), 0.0))
        total["roof_area_m2"] += row["area_m2"] or 0.0
        for name in names:
            total[name] += row[name]
    rows = []
    for shape, outline in zip(shapes, outlines, strict=True):
        name = str(outline["id"])
        if name in sums:
            rounded = {key: round(value, 1) for key, value in sums[name].items()}
            rows.append(Row(shape, {"id": name, "pv_kwh": None, **rounded, "sky": sky.name}))
    return rows
