"""The loop of the researcher's guide gives the buildings of a run on a scan of one block."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from pyproj import CRS
from tests.conftest import but_first
from tests.test_documentation import DOCS

import eaves
from eaves.buildings.one_block import records_of
from eaves.formats import write_cityjson_seq
from eaves.model import Block, PointCloud
from eaves.simulate import nine_roofs_on_a_slope, write_simulation

GUIDE = DOCS / "guides" / "researcher.md"


def loop_of_the_guide(tile: Path, recipe: str = "eaves.make_recipe()", times: bool = True) -> dict[str, Any]:
    """All names of the loop after it ran on a tile, with a recipe, of a file with times."""
    text = GUIDE.read_text(encoding="utf-8").split("as `build` does it\n")[1]
    lines = text.split("```python\n")[1].split("```")[0].replace("tile.laz", tile.as_posix())
    lines = lines.replace("eaves.make_recipe()", recipe)
    names: dict[str, Any] = {}
    exec(lines if times else lines.replace(', fields=("gps_time", "intensity")', ""), names)
    return names


def check_same(tile: Path, folder: Path, names: dict[str, Any], **options: Any) -> None:
    """The buildings of the loop are those of a run, to the last bit: files, outlines and trust."""
    run = eaves.build(tile, folder / "run", outputs=("footprints", "models"), **options)
    _, system, provenance = eaves.model_buildings(tile, **options)
    write_cityjson_seq(folder / "loop.jsonl", names["models"], system, provenance=provenance)
    assert (folder / "loop.jsonl").read_bytes() == (folder / "run" / "buildings.city.jsonl").read_bytes()
    outlines = [model.footprint.world for model in names["models"]]
    unit_m = names["cloud"].system.horizontal_unit_m
    assert len(outlines) == len(run.footprints) == run.found > 0
    if unit_m == 1.0:
        assert [one.wkb for one in outlines] == [one.wkb for one in run.footprints.geometry]
    for column in ("id", "trust", "trust_score"):
        assert [row[column] for row in names["rows"]] == run.footprints[column].tolist()


@pytest.mark.slow
def test_the_loop_gives_the_buildings_of_a_survey(data: Path, tmp_path: Path) -> None:
    tile = data / "misc" / "delft_small.laz"
    check_same(tile, tmp_path, loop_of_the_guide(tile))


@pytest.mark.slow
def test_the_loop_divides_rows_of_houses_as_a_run_does(data: Path, tmp_path: Path) -> None:
    las = laspy.read(data / "rows" / "points.laz")
    las.points = las.points[(np.floor(las.x / 240.0) == 503) & (np.floor(las.y / 240.0) == 2026)]
    las.write(tmp_path / "row.laz")
    names = loop_of_the_guide(tmp_path / "row.laz")
    check_same(tmp_path / "row.laz", tmp_path, names)
    assert sum(building.block is not None for building in names["buildings"]) > 100


@pytest.mark.parametrize(("density", "lod"), but_first([(4.0, "2.3"), (60.0, "2.2")]))
def test_the_loop_gives_the_buildings_of_drawn_houses(density: float, lod: str, tmp_path: Path) -> None:
    truth = nine_roofs_on_a_slope(density=density, noise=0.02, seed=1)
    tile = write_simulation(truth, tmp_path / "nine")["points"]
    names = loop_of_the_guide(tile, f"eaves.make_recipe(lod={lod!r})", times=False)
    check_same(tile, tmp_path, names, lod=lod)


@pytest.mark.slow
def test_a_scan_in_feet_keeps_the_limits_of_its_unit(tmp_path: Path) -> None:
    truth = nine_roofs_on_a_slope(density=4.0, noise=0.02, seed=1)
    las = laspy.read(write_simulation(truth, tmp_path / "nine")["points"])
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, 0.001), np.array([636000.0, 849000.0, 0.0])
    header.add_crs(CRS.from_epsg(2994))
    feet = laspy.LasData(header)
    corner = np.ceil(header.offsets * 0.3048 / 240.0) * 240.0
    feet.xyz = (las.xyz - las.xyz.min(axis=0) + corner + 1.0) / 0.3048
    feet.write(tmp_path / "feet.laz")
    check_same(tmp_path / "feet.laz", tmp_path, loop_of_the_guide(tmp_path / "feet.laz"))


def test_points_of_several_blocks_are_refused() -> None:
    cloud = PointCloud.from_world(np.array([[1.0, 1.0, 0.0], [500.0, 1.0, 0.0]]))
    with pytest.raises(ValueError, match=r"2 blocks of 240 m; give those of one, or use eaves\.find"):
        eaves.prepare_points(cloud)
    with pytest.raises(ValueError, match="no points with coordinates"):
        eaves.prepare_points(PointCloud(np.full((3, 3), np.nan)))


def test_points_are_counted_from_their_block_whatever_their_origin() -> None:
    xyz = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [np.nan, 0.0, 0.0]])
    cloud = eaves.prepare_points(PointCloud(xyz, origin=(1000.0, 2000.0)))
    assert cloud.origin == Block.at(1001.0, 2002.0).origin and len(cloud) == 2
    assert np.allclose(cloud.world, xyz[:2] + [1000.0, 2000.0, 0.0])


def test_points_at_one_place_are_copies_unless_their_times_differ() -> None:
    xyz, times = np.ones((2, 3)), np.array([1.0, 2.0])
    assert len(eaves.prepare_points(PointCloud(xyz))) == 1
    assert len(eaves.prepare_points(PointCloud(xyz, fields={"gps_time": times}))) == 2


def test_records_of_a_cloud_are_those_that_a_run_reads() -> None:
    cloud = PointCloud(np.array([[1.2345, 2.0, -3.0]]), classification=np.array([2], np.uint8))
    record = records_of(cloud)[0]
    assert record["xyz"].tolist() == [12345, 20000, -30000]
    assert (record["classification"], record["return_number"], record["moment"]) == (2, 1, 0)
