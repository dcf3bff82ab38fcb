"""Files whose systems are not true to length, or state their units where nobody looks or twice."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import laspy
import numpy as np
import pytest
from pyproj import CRS, Transformer
from pyproj.enums import WktVersion

import eaves
from eaves.formats import InputError, open_source
from eaves.formats.points.classified import write_classified
from eaves.formats.transformation import datum_remark, scale_at
from eaves.run.index import index_inputs
from eaves.simulate import nine_roofs_on_a_slope, write_simulation

US_FOOT = 1200 / 3937
PLACE = (582800.0, 4650200.0)
XYZ = np.random.default_rng(3).uniform(0, 60, (500, 3)) * (1, 1, 0.3)


def keys(**values: int) -> list[laspy.VLR]:
    entries = [(int(name[1:]), 0, 1, value) for name, value in sorted(values.items())]
    data = np.array([(1, 1, 0, len(entries)), *entries], "<u2").tobytes()
    return [laspy.VLR("LASF_Projection", 34735, "", data)]


def words(text: str | CRS) -> list[laspy.VLR]:
    text = text if isinstance(text, str) else text.to_wkt(WktVersion.WKT2_2019)
    return [laspy.VLR("LASF_Projection", 2112, "", text.encode() + b"\0")]


def esri(unit: str, length: float) -> list[laspy.VLR]:
    heights = f'VERTCS["NAVD88",VDATUM["NAVD88"],PARAMETER["Direction",1.0],UNIT["{unit}",{length!r}]]'
    return words(CRS.from_epsg(26918).to_wkt(WktVersion.WKT1_ESRI)[:-1] + f",{heights}]")


def las(path: Path, xyz: np.ndarray, records: Sequence[laspy.VLR], step: float = 0.001) -> Path:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.array([step, step, 0.001]), np.floor(xyz.min(axis=0))
    header.vlrs.extend(records)
    data = laspy.LasData(header)
    data.xyz = xyz
    data.write(path)
    return path


def in_system(code: str, place: tuple[float, float] = PLACE) -> np.ndarray:
    """The points, which lie about a place in EPSG:32618, in another system."""
    way = Transformer.from_crs(32618, code, always_xy=True)
    return np.column_stack([*way.transform(*(XYZ[:, :2] + place).T), XYZ[:, 2]])


@pytest.mark.parametrize("code", ["EPSG:3857", "EPSG:3395", "EPSG:4087", "EPSG:4326"])
def test_points_of_systems_not_true_to_length_come_in_their_utm_zone(code: str, tmp_path: Path) -> None:
    step = 1e-9 if code == "EPSG:4326" else 0.0001
    path = las(tmp_path / "tile.las", in_system(code), words(CRS(code)), step)
    cloud = eaves.read(path)
    assert cloud.system.code == "EPSG:32618"
    assert np.abs(cloud.xyz + [*cloud.origin, 0.0] - (XYZ + [*PLACE, 0.0])).max() < 0.002
    source = open_source(path)
    box = source.bounds.buffered(0.001)
    assert box.contains(cloud.xyz + [*cloud.origin, 0.0]).all()
    assert len(eaves.read(path, bounds=source.bounds).xyz) == len(XYZ)
    assert any("32618" in remark for remark in source.remarks)


@pytest.mark.parametrize("word", ["none", "EPSG:26918"])
def test_the_system_asked_for_is_taken(word: str, tmp_path: Path) -> None:
    path = las(tmp_path / "tile.las", in_system("EPSG:3857"), words(CRS("EPSG:3857")))
    assert eaves.read(path, to_crs=word).system.code == ("EPSG:3857" if word == "none" else word)


@pytest.mark.parametrize("word", ["EPSG:4326", "metres"])
def test_a_target_that_is_not_projected_is_refused(word: str, tmp_path: Path) -> None:
    path = las(tmp_path / "tile.las", in_system("EPSG:3857"), words(CRS("EPSG:3857")))
    with pytest.raises(InputError, match="--to-crs"):
        open_source(path, to_crs=word)


def test_a_true_system_stays_and_nothing_is_said(tmp_path: Path) -> None:
    source = open_source(las(tmp_path / "tile.las", XYZ + [*PLACE, 0.0], words(CRS("EPSG:32618"))))
    assert source.transformation is None and source.remarks == []


def test_a_scale_off_by_two_tenths_of_a_percent_is_said_with_its_number(tmp_path: Path) -> None:
    place = Transformer.from_crs(4326, 2154, always_xy=True).transform(8.7, 41.9)
    source = open_source(las(tmp_path / "tile.las", XYZ + [*place, 0.0], words(CRS("EPSG:2154"))))
    assert source.transformation is None
    [remark] = source.remarks
    assert "1.002" in remark and "Lambert-93" in remark
    assert scale_at(CRS("EPSG:2154"), *place) == pytest.approx(1.00215, abs=1e-4)


def test_classified_points_lie_in_the_new_system(tmp_path: Path) -> None:
    source = open_source(las(tmp_path / "tile.las", in_system("EPSG:3857"), words(CRS("EPSG:3857"))))
    write_classified(source, tmp_path / "out.laz", np.full(source.count, 2, np.uint8))
    again = open_source(tmp_path / "out.laz")
    assert again.transformation is None and again.system.code == "EPSG:32618"
    stored = laspy.read(tmp_path / "out.laz").xyz
    assert np.abs(np.asarray(stored) - (XYZ + [*PLACE, 0.0])).max() < 0.003


def test_two_systems_come_to_one_that_is_asked_for__and_are_refused_without(tmp_path: Path) -> None:
    paths = [
        las(tmp_path / "a.las", in_system("EPSG:32618"), words(CRS("EPSG:32618"))),
        las(tmp_path / "b.las", in_system("EPSG:5070"), words(CRS("EPSG:5070"))),
    ]
    with pytest.raises(InputError, match=r"EPSG:5070.*--to-crs"):
        index_inputs(paths, None, [])
    index = index_inputs(paths, None, [], to_crs="EPSG:32618")
    assert np.abs(index.entries["box"][0] - index.entries["box"][1]).max() < 20.0  # one is turned


FEET = {
    "VERTCS inside": esri("Foot_US", US_FOOT),
    "compound": words(CRS("EPSG:26918+6360")),
    "keys": keys(k1024=1, k3072=26918, k4099=9003),
    "keys, system of heights": keys(k1024=1, k3072=26918, k4096=6360),
    "keys beside WKT": [*words(CRS("EPSG:26918")), *keys(k1024=1, k3072=26918, k4099=9003)],
}


@pytest.mark.parametrize("crs", [None, "EPSG:26918"])
@pytest.mark.parametrize("name", FEET)
def test_feet_of_heights_are_known_wherever_they_are_stated(
    name: str, crs: str | None, tmp_path: Path
) -> None:
    source = open_source(las(tmp_path / "tile.las", XYZ + [*PLACE, 0.0], FEET[name]), crs)
    assert source.system.unit_m == pytest.approx((1.0, 1.0, US_FOOT), abs=1e-9)
    assert source.own.origins[1]


CONTRADICTIONS = {
    "unit of heights": [*words(CRS("EPSG:26918+5703")), *keys(k1024=1, k3072=26918, k4099=9003)],
    "unit of the plane": [*words(CRS("EPSG:26918")), *keys(k1024=1, k3072=26918, k3076=9003)],
    "zone": [*words(CRS("EPSG:26918")), *keys(k1024=1, k3072=26917)],
}


@pytest.mark.parametrize("name", CONTRADICTIONS)
def test_statements_that_contradict_are_refused__and_the_remedy_works(name: str, tmp_path: Path) -> None:
    path = las(tmp_path / "tile.las", XYZ + [*PLACE, 0.0], CONTRADICTIONS[name])
    with pytest.raises(InputError, match=r"WKT says .* keys say"):
        open_source(path)
    assert index_inputs([path], "EPSG:26918+5703", []).system.code == "EPSG:26918+5703"


@pytest.mark.parametrize("word", ["feet", "EPSG:26918+6360"])
def test_a_unit_given_against_the_file_is_refused(word: str, tmp_path: Path) -> None:
    path = las(tmp_path / "tile.las", XYZ + [*PLACE, 0.0], words(CRS("EPSG:26918+5703")))
    with pytest.raises(InputError, match=r"says it is in .*--crs says"):
        index_inputs([path], word, [])


def test_statements_of_one_mind_are_one(tmp_path: Path) -> None:
    records = [*words(CRS("EPSG:26918")), *keys(k1024=1, k3072=26918, k3076=9001, k4099=9001)]
    source = open_source(las(tmp_path / "tile.las", XYZ + [*PLACE, 0.0], records))
    assert source.system.unit_m == (1.0, 1.0, 1.0) and source.system.code == "EPSG:26918"


def test_a_missing_grid_is_said_with_metres__and_none_where_none_is_needed() -> None:
    wkt = [CRS.from_epsg(code).to_wkt() for code in (31468, 25832, 32632)]
    lost = datum_remark("map.gpkg", wkt[0], wkt[1])
    assert lost is None or ("PROJ lacks the grid" in lost and " m" in lost)
    assert datum_remark("map.gpkg", wkt[1], wkt[2]) is None


def two_tiles(folder: Path, code: str, height_unit: float, records: list[laspy.VLR]) -> list[Path]:
    """The nine roofs about `PLACE` in a system, and once more 600 m east."""
    truth = nine_roofs_on_a_slope(density=4.0)
    xyz = np.asarray(laspy.read(write_simulation(truth, folder / "nine")["points"]).xyz)
    xyz[:, :2] += PLACE - xyz[:, :2].min(axis=0)
    way, paths = Transformer.from_crs(32618, code, always_xy=True), []
    for name, shift in (("a", 0.0), ("b", 600.0)):
        x, y = way.transform(xyz[:, 0] + shift, xyz[:, 1])
        paths.append(las(folder / f"{name}.laz", np.column_stack([x, y, xyz[:, 2] / height_unit]), records))
    return paths


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["web mercator", "heights in feet"])
def test_an_update_is_a_build_of_both__of_a_system_or_a_unit_that_was_mended(
    kind: str, tmp_path: Path
) -> None:
    mercator = kind == "web mercator"
    records = words(CRS("EPSG:3857")) if mercator else esri("Foot_US", US_FOOT)
    code, unit = ("EPSG:3857", 1.0) if mercator else ("EPSG:26918", US_FOOT)
    first, second = two_tiles(tmp_path, code, unit, records)
    outputs = ("footprints", "models")
    whole = eaves.build([first, second], tmp_path / "whole", outputs=outputs)
    eaves.build(first, tmp_path / "one", outputs=outputs, keep=True)
    eaves.update(tmp_path / "one", second, tmp_path / "both", date="2026-01-01")
    both = eaves.build([first, second], tmp_path / "again", outputs=outputs, per_tile=True)
    assert whole.found == both.found > 0
    areas = [sorted(eaves_rows(tmp_path / name)) for name in ("whole", "both", "again")]
    assert areas[0] == areas[1] == areas[2]
    assert ("32618" in whole.run["crs"]) == mercator
    assert bool(whole.remarks) == mercator


def eaves_rows(folder: Path) -> list[tuple[float, float]]:
    from eaves.formats import read_polygons

    _, _, rows, _ = read_polygons(folder / "footprints.gpkg", layer="footprints")
    return [(row["area_m2"], row["volume_m3"]) for row in rows]
