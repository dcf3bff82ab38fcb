"""What the caller says of coordinates, what a file says, and what its numbers can be must agree."""

from __future__ import annotations

import logging
from pathlib import Path

import laspy
import laspy.vlrs.known
import numpy as np
import pytest
from tests.conftest import build_files, but_first, write_laz

from eaves.formats import InputError
from eaves.formats.crs import parse_crs, system_of
from eaves.formats.crs_check import vertical_datum
from eaves.run.index import index_inputs
from eaves.run.manifest import read_facts

DELFT = np.array([84900.0, 447500.0, 1.0])
KENTUCKY = np.array([5_300_000.0, 3_900_000.0, 800.0])
"""In US survey feet, EPSG:3089."""
PATCH = np.random.default_rng(0).random((500, 3)) * [40, 40, 3]


def index(path: Path, crs: str | None = None, force: bool = False) -> str | None:
    return index_inputs([path], crs, [], crs_force=force).system.code


@pytest.mark.parametrize(
    ("place", "own", "said", "what"),
    [
        (DELFT, 28992, "EPSG:32631", "--crs says"),
        (DELFT, 7415, "EPSG:28992+5711", "--crs says"),
        (DELFT, None, "EPSG:32631", None),
        (DELFT, 28992, "EPSG:28992+5709", None),
        (DELFT, 28992, "7415", None),
        (DELFT[[1, 0, 2]], 28992, None, "x and y exchanged"),
        (DELFT / 0.3048, 28992, None, "feet, not metres"),
        (KENTUCKY * 0.3048, 3089, None, "metres, not feet"),
        (KENTUCKY, 3089, None, None),
        (np.array([4.35, 52.01, 0.0]), None, "EPSG:28992", "are degrees"),
    ],
)
def test_a_conflict_is_refused_unless_forced(
    place: np.ndarray, own: int | None, said: str | None, what: str | None, tmp_path: Path
) -> None:
    xyz = place + PATCH * (1e-5 if place[0] < 10 else 1)
    write_laz(tmp_path / "a.laz", xyz, own)
    if what is None:
        assert index(tmp_path / "a.laz", said)
    else:
        with pytest.raises(InputError, match=what):
            index(tmp_path / "a.laz", said)
    assert index(tmp_path / "a.laz", said, force=True)


def write_with_system(path: Path, wkt: str) -> None:
    """The patch in a plane, whose file states a system by these words."""
    write_laz(path, PATCH + [500_000, 5_000_000, 0], None)
    las = laspy.read(path)
    las.header.vlrs.append(laspy.vlrs.known.WktCoordinateSystemVlr(wkt))
    las.header.global_encoding.wkt = True
    las.write(path)


def test_a_system_of_no_place_gives_way_to_the_one_that_is_given(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "a.laz"
    site = 'LOCAL_CS["site grid",LOCAL_DATUM["site",0],UNIT["metre",1],AXIS["E",EAST],AXIS["N",NORTH]]'
    write_with_system(path, site)
    with caplog.at_level(logging.WARNING, "eaves"):
        assert index(path, "EPSG:32631") == "EPSG:32631"
    assert "site grid; --crs is taken" in caplog.text


def flown(path: Path, speed: float, heading: float, unit: float, gps: bool, blind: float = 0.7) -> Path:
    """A strip of a scan without a system: 4 s at a speed (m/s), two returns a pulse at least `blind` (m)
    apart, in a unit (m)."""
    rng = np.random.default_rng(3)
    time = np.sort(rng.uniform(0.0, 4.0, 2000))
    along, across = speed * time, 200.0 * np.sin(700.0 * time)
    east, north = np.sin(np.radians(heading)), np.cos(np.radians(heading))
    first = np.column_stack(
        [along * east + across * north, along * north - across * east, rng.uniform(0.0, 9.0, 2000)]
    )
    last = first - np.column_stack([np.zeros((2000, 2)), blind + rng.exponential(3.0, 2000)])
    las = laspy.LasData(laspy.LasHeader(version="1.4", point_format=6 if gps else 0))
    las.header.scales = np.full(3, 0.001)
    las.x, las.y, las.z = np.stack([first, last], 1).reshape(-1, 3).T / unit + 5000.0
    las.return_number, las.number_of_returns = np.tile([1, 2], 2000), np.full(4000, 2)
    if gps:
        las.gps_time = np.repeat(time, 2) + 3e8
    las.write(path)
    return path


@pytest.mark.parametrize("heading", but_first([30.0, 0.0, 75.0]))
@pytest.mark.parametrize("speed", but_first([60.0, 45.0, 85.0]))
def test_feet_without_a_system_are_refused__by_the_speed_of_the_flight(
    tmp_path: Path, speed: float, heading: float
) -> None:
    assert index(flown(tmp_path / "m.laz", speed, heading, 1.0, gps=True)) is None
    feet = flown(tmp_path / "feet.laz", speed, heading, 0.3048, gps=True)
    with pytest.raises(InputError, match=r"units a second.*they are in feet; .*--crs feet or us-feet"):
        index(feet)
    assert index_inputs([feet], "feet", []).system.unit_m == (0.3048, 0.3048, 0.3048)
    assert index_inputs([feet], "metres", []).system.unit_m == (1.0, 1.0, 1.0)


def test_feet_without_a_system_are_refused__by_the_blind_range_of_the_scanner(tmp_path: Path) -> None:
    for blind in (0.5, 2.5, 4.0):
        assert index(flown(tmp_path / "m.laz", 60.0, 10.0, 1.0, gps=False, blind=blind)) is None
    with pytest.raises(InputError, match="returns of one pulse no nearer than"):
        index(flown(tmp_path / "feet.laz", 60.0, 10.0, 0.3048, gps=False, blind=2.5))


@pytest.mark.parametrize("unit", ["0", "-1"])
def test_a_system_with_a_unit_of_no_length_is_one_line(tmp_path: Path, unit: str) -> None:
    path = tmp_path / "a.laz"
    wkt = parse_crs("EPSG:32631").to_wkt("WKT1_GDAL")
    write_with_system(path, wkt.replace('UNIT["metre",1', f'UNIT["metre",{unit}'))
    with pytest.raises(InputError, match=r"a\.laz: .* has units of .* --crs"):
        index(path)


def test_a_place_nothing_explains_is_a_warning(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    write_laz(tmp_path / "a.laz", PATCH + [2_000_000, 2_000_000, 0], 28992)
    with caplog.at_level(logging.WARNING, "eaves"):
        index(tmp_path / "a.laz")
    assert "outside the area EPSG:28992 is made for" in caplog.text


def test_the_vertical_datum_is_written(nine_roofs_file: Path, tmp_path: Path) -> None:
    assert vertical_datum(system_of(parse_crs("EPSG:7415"), "", (85000, 447000)))["name"] == "NAP height"
    build_files(nine_roofs_file, tmp_path, lod="0", outputs=("footprints",))
    assert read_facts(tmp_path)["vertical_datum"] == {"status": "unknown", "name": None}
