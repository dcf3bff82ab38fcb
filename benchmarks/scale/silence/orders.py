"""CityGML in systems of either order of axes: GDAL, which follows the authority, shows the true place."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

import numpy as np
import pyogrio
from pyproj import CRS, Transformer
from pyproj.enums import WktVersion

from benchmarks.scale.silence import Drawn, Variant
from benchmarks.scale.silence.houses import Scene, World, draw_houses, write_points

NEAR = 1.5
"""Metres by which the sides of all buildings together may be off."""
SYSTEMS: dict[str, tuple[str, ...]] = {
    "northing first": ("2180", "3879", "31468", "2193", "6677", "3006", "31256"),
    "easting first": ("28992", "5514", "25832", "2056", "27700", "2263"),
    "compound": ("7415", "25832+7837", "3879+3900", "2193+7839"),
}
WITHOUT_AXES = ("2180", "31468", "6677")
"""Written as WKT 1, as many files are, which says nothing of axes."""
VERSION_3 = ("2180", "28992", "31468", "2193", "25832", "3879+3900")


def box_by_gdal(path: Path) -> tuple[World, str]:
    """The corners (2, 2) of all buildings as GDAL reads them, easting first, and the system's name."""
    pyogrio.read_bounds(path, layer="Building")  # GDAL notes beside the file which geometry it takes
    _, (west, south, east, north) = pyogrio.read_bounds(path, layer="Building")
    return np.array([[west.min(), south.min()], [east.max(), north.max()]]), name_in(path)


def box_by_authority(path: Path) -> tuple[World, str]:
    """The same of version 3, whose shells GDAL does not read: coordinates in the order of the authority."""
    text = path.read_text(encoding="utf-8")
    numbers = [
        np.array(found.split(), float).reshape(-1, 3)[:, :2]
        for found in re.findall(r"<gml:posList[^>]*>([^<]*)<", text)
    ]
    stored, name = np.concatenate(numbers), name_in(path)
    system = CRS.from_user_input(name).to_2d()
    if system.axis_info[0].direction not in ("east", "west"):
        stored = stored[:, ::-1]
    return np.array([stored.min(axis=0), stored.max(axis=0)]), name


def name_in(path: Path) -> str:
    """The system that the file names."""
    found = re.findall(r'srsName="([^"]*)"', path.read_text(encoding="utf-8"))
    return str(found[0]) if found else "none"


def draw_in(code: str, kind: str, version: str, folder: Path, rng: np.random.Generator) -> Drawn:
    """The scene in the middle of a system's area, and CityGML asked for."""
    scene, system = draw_houses(rng), CRS.from_user_input(f"EPSG:{code}")
    plane = system.sub_crs_list[0] if system.is_compound else system
    area, unit = plane.area_of_use, plane.axis_info[0].unit_conversion_factor
    assert area is not None
    way = Transformer.from_crs(4326, plane, always_xy=True)
    corner = np.round(way.transform((area.west + area.east) / 2, (area.south + area.north) / 2)) * unit
    world = (scene.xyz + (*corner, 0.0)) / (unit, unit, unit)
    written = CRS(_without_axes(system)) if kind == "WKT 1" else system
    points = write_points(folder / "points.laz", world, written)
    words = ["build", str(points), "-o", "OUT", "--jobs", "1", "--outputs", "footprints,models"]
    judge = partial(misplaced, scene, corner, unit, plane, version)
    return Drawn([*words, "--formats", version], judge, r"there is nothing to say here \d")


def _without_axes(system: CRS) -> str:
    return re.sub(r',AXIS\["[^"]*",\w+\]', "", system.to_wkt(WktVersion.WKT1_GDAL))


def misplaced(scene: Scene, corner: World, unit: float, plane: CRS, version: str, out: Path) -> str:
    """What is wrong with the place of the buildings."""
    path = out / ("buildings.gml" if version == "citygml" else "buildings3.gml")
    box, name = (box_by_gdal if version == "citygml" else box_by_authority)(path)
    if name == "none":
        return "the file names no system"
    stated = CRS.from_user_input(name)
    stated = stated.sub_crs_list[0] if stated.is_compound else stated
    if not stated.equals(plane, ignore_axis_order=True):
        return f"the file says {name}, {stated.name}"
    true = np.array([house.plan.bounds for house in scene.houses])
    true = np.array([true[:, :2].min(axis=0), true[:, 2:].max(axis=0)]) + corner
    off = float(np.abs(box * unit - true).max())
    return f"{off:,.0f} m off" if off > NEAR else ""


def variants() -> list[Variant]:
    """The variants of this kind."""
    both = [(code, kind, "citygml") for kind, codes in SYSTEMS.items() for code in codes]
    both += [(code, "WKT 1", "citygml") for code in WITHOUT_AXES]
    both += [(code, "version 3", "citygml3") for code in VERSION_3]
    return [
        Variant("orders", f"{kind}, {code}", partial(draw_in, code, kind, version))
        for code, kind, version in both
    ]
