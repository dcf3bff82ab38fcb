"""Lines of x y z, finding input files, and what every way of telling a coordinate system means."""

from __future__ import annotations

import logging
import os
from pathlib import Path

import laspy
import numpy as np
import pyproj
import pytest

from eaves.formats import (
    InputError,
    common_system,
    find_inputs,
    iter_chunks,
    open_source,
    read,
    write_classified,
)
from eaves.formats.crs import code_of, parse_crs, system_of
from eaves.formats.points.las_header import DIRECTORY, crs_of_geokeys

FOOT, SURVEY_FOOT = 0.3048, 1200 / 3937
LINES = "85000.0 447000.0 1.5 2\n85010.25 447020.5 2.5 6\n85020.0 447030.0 3.5 6\n"


def saved(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def las_at(path: Path, xyz: np.ndarray, crs: str | None = None, scale: float = 0.01) -> Path:
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales, header.offsets = np.full(3, scale), np.floor(xyz.min(axis=0))
    if crs is not None:
        header.add_crs(pyproj.CRS.from_user_input(crs))
    las = laspy.LasData(header)
    las.x, las.y, las.z = xyz.T
    las.write(path)
    return path


@pytest.mark.parametrize(
    "text",
    [
        LINES,
        "# made by hand\n\n" + LINES,
        "x y z label\n" + LINES,
        "X,Y,Z,Classification\n" + LINES.replace(" ", ","),
        "label;x;y;z\n2;85000;447000;1.5\n6;85010.25;447020.5;2.5\n6;85020;447030;3.5\n",
        LINES.replace(" ", "\t"),
        "\ufeff" + LINES.replace("\n", "\r\n"),
        LINES.replace("2.5 6\n", "2.5 6\n# a comment among points\n\n"),
        LINES.rstrip("\n"),
    ],
    ids=["plain", "comments", "names", "csv", "label first", "tabs", "windows", "between", "no last newline"],
)
def test_lines_become_points(tmp_path: Path, text: str) -> None:
    source = open_source(saved(tmp_path / "points.txt", text))
    (chunk,) = iter_chunks(source)
    assert source.kind == "text" and source.count == 3 and source.fields == ("classification",)
    assert np.array_equal(chunk.xyz[1], [85010.25, 447020.5, 2.5])
    assert chunk.classification is not None and chunk.classification.tolist() == [2, 6, 6]


def test_three_columns_have_no_label_and_six_have_a_colour(tmp_path: Path) -> None:
    for columns in ("1 2 3\n4 5 6\n", "1 2 3 99 98 97\n4 5 6 99 98 97\n"):
        source = open_source(saved(tmp_path / "a.xyz", columns))
        assert source.fields == () and next(iter_chunks(source)).classification is None


def test_points_without_coordinates_are_left_out_and_reported(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = saved(tmp_path / "holes.txt", "1 2 3\nnan nan nan\n0 0 0\n4 5 6\n7 8 nan\n10 20 30\n")
    source = open_source(path)
    with caplog.at_level(logging.WARNING):
        chunks = list(iter_chunks(source, chunk_points=2))
    assert np.concatenate([chunk.position for chunk in chunks]).tolist() == [0, 3, 5]
    assert caplog.text.count("3 points without coordinates") == 1
    assert (source.bounds.west, source.heights) == (1.0, (3.0, 30.0))
    write_classified(source, tmp_path / "out.laz", np.full(6, 2, np.uint8))
    back = laspy.read(tmp_path / "out.laz")
    assert np.allclose(back.xyz[[0, 3, 5]], [[1, 2, 3], [4, 5, 6], [10, 20, 30]])
    assert [position for c in iter_chunks(open_source(tmp_path / "out.laz")) for position in c.position] == [
        0,
        3,
        5,
    ]


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("", "empty"),
        ("hello\nworld\n", "no line of three numbers"),
        ("1 2\n3 4\n", "no line of three numbers"),
        ("1 2 3\n4 five 6\n", "after line 0"),
        ("1 2 3 4\n5 6\n", "after line 0"),
        ("1 2 3 " + "9" * 5000, "more than 4096 characters"),
    ],
)
def test_bad_text_is_refused_in_one_line(tmp_path: Path, text: str, rule: str) -> None:
    path = saved(tmp_path / "bad.txt", text)
    with pytest.raises(InputError, match=rule) as caught:
        list(iter_chunks(open_source(path)))
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_only_nan_and_zeros_are_no_cloud(tmp_path: Path) -> None:
    path = saved(tmp_path / "none.txt", "nan nan nan\n0 0 0\n")
    with pytest.raises(InputError, match="none of its 2 points has coordinates"):
        read(path)


def test_inputs_are_found_once_and_sorted(tmp_path: Path) -> None:
    for name in ("b.laz", "a.LAS", ".hidden.laz", "c.txt", "notes.pdf"):
        saved(tmp_path / name, "1 2 3\n")
    names = [path.name for path in find_inputs([tmp_path, tmp_path / "b.laz", str(tmp_path / "*.laz")])]
    assert names == ["a.LAS", "b.laz"]
    texts = tmp_path / "texts"
    texts.mkdir()
    saved(texts / "c.txt", "1 2 3\n")
    assert [path.name for path in find_inputs(texts)] == ["c.txt"]
    assert [path.name for path in find_inputs(str(tmp_path / "**" / "c.txt"))] == ["c.txt", "c.txt"]


def test_a_link_is_the_file_it_names(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    saved(tmp_path / "real" / "a.laz", "1 2 3\n")
    (tmp_path / "b.laz").symlink_to(tmp_path / "real" / "a.laz")
    (tmp_path / "gone.laz").symlink_to(tmp_path / "nothing")
    (tmp_path / "folder").symlink_to(tmp_path / "real")
    found = find_inputs([tmp_path, tmp_path / "folder", tmp_path / "real"])
    assert [path.resolve() for path in found] == [tmp_path / "real" / "a.laz"]


def test_what_is_no_file_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.laz")
    with pytest.raises(InputError, match="is a pipe"):
        find_inputs(tmp_path / "pipe.laz")
    with pytest.raises(InputError, match="is empty"):
        find_inputs("")


@pytest.mark.parametrize("name", ["none.laz", "*.laz", "", "empty"])
def test_a_path_without_files_is_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=r"does not exist|has no point files|matches no file"):
        find_inputs(tmp_path / name)
    with pytest.raises(InputError, match="no input given"):
        find_inputs([])
    with pytest.raises(InputError, match="cannot be read"):
        open_source(tmp_path / "none.laz")


@pytest.mark.parametrize(
    ("said", "code", "horizontal", "vertical"),
    [
        ("EPSG:28992", "EPSG:28992", 1.0, 1.0),
        ("28992+5709", "EPSG:7415", 1.0, 1.0),
        ("EPSG:25832+5783", "EPSG:5555", 1.0, 1.0),
        ("2994", "EPSG:2994", FOOT, FOOT),
        ("2272", "EPSG:2272", SURVEY_FOOT, SURVEY_FOOT),
        ("2994+5703", "EPSG:2994+5703", FOOT, 1.0),
        ("2272+6360", "EPSG:8774", SURVEY_FOOT, SURVEY_FOOT),
        ("26910+6360", "EPSG:26910+6360", 1.0, SURVEY_FOOT),
    ],
)
def test_codes_give_units(said: str, code: str, horizontal: float, vertical: float) -> None:
    crs = parse_crs(said)
    system = system_of(crs, "test", (0.0, 0.0))
    assert (system.horizontal_unit_m, system.vertical_unit_m) == pytest.approx(
        (horizontal, vertical), rel=1e-9
    )
    assert code_of(crs) == code


def test_a_file_with_wkt_or_projjson_names_a_system(tmp_path: Path) -> None:
    crs = pyproj.CRS.from_epsg(2994)
    for text in (crs.to_wkt(), crs.to_json(pretty=True)):
        assert parse_crs(str(saved(tmp_path / "srs.txt", text))).to_epsg() == 2994
    for nonsense in ("EPSG:999999", "somewhere", str(tmp_path), "28992+", "[", ""):
        with pytest.raises(InputError, match="names no coordinate system"):
            parse_crs(nonsense)


@pytest.mark.parametrize(("said", "foot"), [("EPSG:2994", FOOT), ("EPSG:2272", SURVEY_FOOT)])
def test_feet_become_metres_once(tmp_path: Path, said: str, foot: float) -> None:
    feet = np.array([[2_000_000.0, 300_000.0, 100.0], [2_000_100.0, 300_200.0, 150.0]])
    source = open_source(las_at(tmp_path / "feet.laz", feet, said))
    (chunk,) = iter_chunks(source)
    assert np.allclose(chunk.xyz, feet * foot, rtol=1e-12, atol=1e-6)
    assert abs(chunk.xyz[0, 0] - 2_000_000 * foot) < 1e-6  # the other foot is 1.2 m away
    assert source.bounds.east == pytest.approx(2_000_100 * foot)


def test_heights_may_have_another_unit(tmp_path: Path) -> None:
    feet = np.array([[2_000_000.0, 300_000.0, 100.0], [2_000_100.0, 300_200.0, 150.0]])
    (chunk,) = iter_chunks(open_source(las_at(tmp_path / "mixed.laz", feet), crs="2994+5703"))
    assert np.allclose(chunk.xyz, feet * [FOOT, FOOT, 1.0])


def test_geokeys_name_system_and_height_unit() -> None:
    def keys(*entries: tuple[int, int]) -> dict[int, bytes]:
        rows = [(1, 1, 0, len(entries)), *((key, 0, 1, value) for key, value in entries)]
        return {DIRECTORY: np.array(rows, "<u2").tobytes()}

    crs, unit = crs_of_geokeys(keys((1024, 1), (3072, 26910), (4099, 9003)))
    assert crs is not None and crs.to_epsg() == 26910 and unit == pytest.approx(SURVEY_FOOT)
    assert system_of(crs, "test", (0, 0), unit).unit_m == pytest.approx((1, 1, SURVEY_FOOT))
    crs, unit = crs_of_geokeys(keys((1024, 1), (3072, 28992), (4096, 5709)))
    assert crs is not None and crs.to_epsg() == 7415 and unit is None
    assert crs_of_geokeys({}) == (None, None)
    assert crs_of_geokeys({DIRECTORY: b"abc"}) == (None, None)


def test_degrees_that_nobody_states_are_refused_with_the_utm_code(tmp_path: Path) -> None:
    degrees = np.array([[4.45, 51.90, 1.0], [4.46, 51.91, 40.0]])
    path = las_at(tmp_path / "degrees.las", degrees, None, 1e-7)
    with pytest.raises(InputError, match=r"degrees.*EPSG:32631"):
        open_source(path)
    southern = saved(tmp_path / "south.txt", "151.20 -33.86 5\n151.21 -33.87 90\n")
    with pytest.raises(InputError, match=r"degrees.*EPSG:32756"):
        open_source(southern)


def test_a_small_local_scene_is_not_taken_for_degrees(tmp_path: Path) -> None:
    open_source(las_at(tmp_path / "a.las", np.array([[0.0, 0, 0], [60.0, 40.0, 12.0]])))
    open_source(saved(tmp_path / "b.txt", "0 0 0.1\n60 40 12\n"))


def test_no_system_is_one_warning(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    for name in ("a.txt", "b.txt", "c.txt"):
        saved(tmp_path / name, LINES)
    with caplog.at_level(logging.WARNING):
        assert read(tmp_path).system.wkt is None
    assert len(caplog.records) == 1 and "no coordinate system" in caplog.text
    caplog.clear()
    with caplog.at_level(logging.WARNING):
        assert read(tmp_path, crs="28992").system.code == "EPSG:28992"
    assert not caplog.records


@pytest.mark.parametrize("other", ["EPSG:2994", "EPSG:25832", None, "EPSG:28992+6360"])
def test_files_that_differ_are_refused(tmp_path: Path, other: str | None) -> None:
    xyz = np.array([[85000.0, 447000.0, 1.0], [85100.0, 447100.0, 9.0]])
    las_at(tmp_path / "a.laz", xyz, "EPSG:28992")
    las_at(tmp_path / "b.laz", xyz, other)
    with pytest.raises(InputError, match=r"[ab]\.laz: its (units|system)"):
        read(tmp_path)


def test_the_same_system_with_and_without_heights_agrees(tmp_path: Path) -> None:
    xyz = np.array([[85000.0, 447000.0, 1.0], [85100.0, 447100.0, 9.0]])
    sources = [
        open_source(las_at(tmp_path / "a.laz", xyz, "EPSG:28992")),
        open_source(las_at(tmp_path / "b.laz", xyz, "EPSG:7415")),
    ]
    assert common_system(sources).code == common_system(sources[::-1]).code == "EPSG:7415"
