"""CityGML in systems of either order of axes, read by GDAL, which follows the authority of the system."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pyogrio
import pytest
from pyproj import CRS, Transformer
from pyproj.enums import WktVersion

from eaves.exports import write_citygml
from eaves.exports.citygml import write_citygml3
from eaves.formats.crs import parse_crs, system_of
from eaves.model import CoordinateSystem
from eaves.simulate import nine_roofs_on_a_slope

CODES = ("28992", "2180", "3879", "31468", "2193", "5514", "25832", "2056", "6677", "2263", "3879+3900")
NORTH_FIRST = ("2180", "3879", "31468", "2193", "6677", "3879+3900")


def written(path: Path, system: CoordinateSystem, version: str) -> np.ndarray:
    """The middle of a system's area (its units, easting first), around which buildings are written."""
    crs = CRS.from_wkt(system.wkt or "")
    plane = crs.sub_crs_list[0] if crs.is_compound else crs
    area = CRS.from_user_input((system.code or "").split("+")[0]).area_of_use
    assert area is not None
    way = Transformer.from_crs(4326, plane, always_xy=True)
    middle = np.round(way.transform((area.west + area.east) / 2, (area.south + area.north) / 2))
    truth = nine_roofs_on_a_slope(density=2.0)
    models = [building.model(tuple(middle * system.horizontal_unit_m)) for building in truth.buildings[:1]]
    (write_citygml if version == "2" else write_citygml3)(path, models, system)
    return middle


def box_of(path: Path) -> np.ndarray:
    """West, south, east and north as GDAL reads them: on the second look it knows which geometry it takes."""
    pyogrio.read_bounds(path, layer="Building")
    _, box = pyogrio.read_bounds(path, layer="Building")
    return np.asarray(box[:, 0])


@pytest.mark.parametrize("code", CODES)
def test_gdal_shows_the_true_place(code: str, tmp_path: Path) -> None:
    system = system_of(parse_crs(code), "", (0.0, 0.0))
    middle = written(tmp_path / "one.gml", system, "2")
    assert np.abs(box_of(tmp_path / "one.gml") - np.tile(middle, 2)).max() < 400.0


@pytest.mark.parametrize("code", CODES)
@pytest.mark.parametrize("version", ["2", "3"])
def test_coordinates_stand_in_the_order_of_the_authority(code: str, version: str, tmp_path: Path) -> None:
    system = system_of(parse_crs(code), "", (0.0, 0.0))
    middle = written(tmp_path / "one.gml", system, version)
    text = (tmp_path / "one.gml").read_text(encoding="utf-8")
    place = np.array(re.findall(r"<gml:posList[^>]*>([^<]*)<", text)[0].split()[:2], float)
    expected = middle[::-1] if code in NORTH_FIRST else middle
    assert np.abs(place - expected).max() < 400.0
    corner = re.findall(r"<gml:lowerCorner>([^<]*)<", text)[0].split()[:2]
    assert np.abs(np.array(corner, float) - expected).max() < 400.0


@pytest.mark.parametrize("code", ["2180", "31468", "6677", "28992", "5678"])
def test_order_is_the_authoritys_where_wkt_1_says_nothing_of_axes(tmp_path: Path, code: str) -> None:
    text = re.sub(r',AXIS\["[^"]*",\w+\]', "", CRS.from_epsg(int(code)).to_wkt(WktVersion.WKT1_GDAL))
    system = system_of(parse_crs(text), "", (0.0, 0.0))
    assert system.code == f"EPSG:{code}"
    middle = written(tmp_path / "one.gml", system, "2")
    assert np.abs(box_of(tmp_path / "one.gml") - np.tile(middle, 2)).max() < 400.0
