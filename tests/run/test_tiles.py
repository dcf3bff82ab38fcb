"""A run by tiles writes what a run in one piece writes, to the byte, also broken off and gone on with."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path

import laspy
import numpy as np
import pytest
import rasterio
import shapely
from benchmarks.scale.faults import contents as file_contents
from tests.conftest import build_in_blocks

from eaves import pipeline
from eaves.buildings.building_file import SavedBuildings
from eaves.flow.corrected import correct, outlines_in
from eaves.flow.edits import FLAT_ROOF, NO_BUILDING, Edit
from eaves.flow.region import Region
from eaves.formats.vectors.geopackage import Row, write_geopackage
from eaves.model import Block, CoordinateSystem
from eaves.model.summary import IncompleteRunError
from eaves.run.manifest import check_folder, read_facts
from eaves.simulate.objects.houses import ExactScene
from eaves.upkeep.update import update

SIDE = 60.0
build = partial(build_in_blocks, SIDE, outputs=("footprints", "models", "rasters", "mask"))
tiled = partial(build, per_tile=True)

PLACE = np.array([84960.0, 447120.0])


def contents(out: Path) -> dict[str, object]:
    """The hash of every file of a run but of what states times; of rasters, which may lie in several files,
    bounds and values."""
    found: dict[str, object] = {}
    for name in ("dtm", "dsm", "ndsm", "mask"):
        path = out / f"{name}.vrt"
        with rasterio.open(path if path.exists() else path.with_suffix(".tif")) as image:
            found[name] = image.bounds, image.crs, image.read(1).tobytes()
    tables = (".gpkg", ".jsonl", ".csv")
    found |= {name: digest for name, digest in file_contents(out).items() if name.endswith(tables)}
    return found


@pytest.fixture
def crossed(nine_roofs: ExactScene, nine_roofs_file: Path, tmp_path: Path) -> Path:
    """The nine roofs in two files, moved so that a border of tiles runs through the fifth."""
    las = laspy.read(nine_roofs_file)
    las.x = np.asarray(las.x) - nine_roofs.buildings[4].footprint.centroid.x
    east = np.asarray(las.x) >= PLACE[0]
    (tmp_path / "in").mkdir()
    for name, which in (("east", east), ("west", ~east)):
        part = laspy.LasData(las.header)
        part.points = las.points[which].copy()
        part.write(tmp_path / "in" / f"{name}.laz")
    return tmp_path / "in"


def test_files_are_those_of_one_piece__a_house_lies_across_two_tiles(crossed: Path, tmp_path: Path) -> None:
    assert build(crossed, tmp_path / "whole").found == 9
    assert tiled(crossed, tmp_path / "tiled").found == 9
    assert contents(tmp_path / "tiled") == contents(tmp_path / "whole")
    assert check_folder(tmp_path / "tiled") == []
    facts = [read_facts(tmp_path / name) for name in ("tiled", "whole")]
    assert facts[0]["tiles"] > 1 and "tiles" not in facts[1]
    for name in ("points", "points_used", "found", "by_lod", "trust", "failures", "fallbacks", "doubts"):
        assert facts[0][name] == facts[1][name]


@pytest.mark.slow
def test_given_footprints_are_modelled_once_each(
    nine_roofs: ExactScene, nine_roofs_file: Path, crossed: Path, tmp_path: Path
) -> None:
    polygons = [shapely.transform(one.footprint, lambda xy: xy + PLACE) for one in nine_roofs.buildings]
    rows = [Row(polygon, {"name": f"house {k}"}) for k, polygon in enumerate(polygons)]
    write_geopackage(tmp_path / "given.gpkg", rows, (), CoordinateSystem())
    options = {"footprints": tmp_path / "given.gpkg", "id_field": "name"}
    assert build(nine_roofs_file, tmp_path / "whole", **options).found == 9
    assert tiled(nine_roofs_file, tmp_path / "tiled", **options).found == 9
    assert contents(tmp_path / "tiled") == contents(tmp_path / "whole")


@pytest.mark.slow
def test_points_that_later_ones_take_the_place_of_are_the_same_by_tiles(
    crossed: Path, tmp_path: Path
) -> None:
    """A later scan of a part, a metre higher, whose rim crosses blocks and tiles; a file for each block."""
    side, inputs = 24.0, list[Path]()
    east, west = (laspy.read(crossed / f"{name}.laz") for name in ("east", "west"))
    for number, las in enumerate((east, west, east)):
        xy = np.column_stack([las.x, las.y])
        low, high = xy.min(axis=0), xy.max(axis=0)
        if number == 2:
            las.points["X"] += 37
            las.points["Z"] += round(1.0 / las.header.scales[2])
            low, high = low + 0.1 * (high - low), low + 0.8 * (high - low)
        place = np.floor(xy / side).astype(int)
        inside = ((xy >= low) & (xy <= high)).all(axis=1)
        for square in np.unique(place[inside], axis=0):
            part = laspy.LasData(las.header)
            part.points = las.points[inside & (place == square).all(axis=1)].copy()
            inputs.append(tmp_path / f"{number}-{square[0]}-{square[1]}.laz")
            part.write(inputs[-1])
    later = sum(not path.name.startswith("2-") for path in inputs)
    outputs = ("footprints", "models", "rasters", "mask")
    for way in ("whole", "tiled"):
        summary = build_in_blocks(
            side,
            inputs,
            tmp_path / way,
            outputs=outputs,
            per_tile=way == "tiled",
            generations=(later,),
        )
        assert summary.found > 3
    assert contents(tmp_path / "tiled") == contents(tmp_path / "whole")


class StoppedError(Exception):
    """The run ends here."""


def stop_after(count: int) -> Callable[[str, int, int], None]:
    """A `Progress` that ends a run after so many tiles."""

    def stop(step: str, done: int, total: int) -> None:
        if step == "tiles" and done == count:
            raise StoppedError

    return stop


@pytest.mark.slow
def test_a_run_that_was_broken_off_goes_on_with_the_tiles_left(crossed: Path, tmp_path: Path) -> None:
    build(crossed, tmp_path / "whole")
    with pytest.raises(StoppedError):
        tiled(crossed, tmp_path / "tiled", progress=stop_after(2))
    visited: list[int] = []
    tiled(crossed, tmp_path / "tiled", resume=True, progress=lambda step, done, total: visited.append(done))
    assert visited[0] == 3  # of the first two nothing is computed
    assert contents(tmp_path / "tiled") == contents(tmp_path / "whole")


@pytest.mark.slow
def test_a_tile_whose_file_is_broken_is_tried_again__and_no_other(crossed: Path, tmp_path: Path) -> None:
    build(crossed, tmp_path / "whole")
    good = (crossed / "east.laz").read_bytes()
    (crossed / "east.laz").write_bytes(good[: len(good) // 2])
    with pytest.raises(IncompleteRunError, match=r"east\.laz"):
        tiled(crossed, tmp_path / "tiled")
    (crossed / "east.laz").write_bytes(good)
    assert tiled(crossed, tmp_path / "tiled", resume=True).complete
    assert contents(tmp_path / "tiled") == contents(tmp_path / "whole")


@pytest.mark.slow
def test_what_no_tile_can_reach_any_more_is_let_go(crossed: Path, tmp_path: Path) -> None:
    """Four copies of the scene, far apart, take about the room of one."""
    rooms: list[int] = []
    sources, total = [], 0
    for copy in range(4):
        for path in crossed.glob("*.laz"):
            las = laspy.read(path)
            las.header.offsets[0] += 6000.0 * copy
            las.points.offsets[0] += 6000.0 * copy
            sources.append(tmp_path / f"{copy}-{path.name}")
            total += 31 * len(las.points)  # a place, its returns and class, and an intensity of eight bytes
            las.write(sources[-1])

    def look(step: str, done: int, total: int) -> None:
        if step == "tiles":
            points = (tmp_path / "tiled" / ".eaves-work" / "points").glob("*/*.bin")
            rooms.append(sum(path.stat().st_size for path in points))

    assert tiled(sources, tmp_path / "tiled", progress=look).found == 36
    assert rooms[-1] == 0
    assert max(rooms) < 0.3 * total


@pytest.mark.slow
def test_edits_are_carried_out_as_in_one_piece(crossed: Path, tmp_path: Path) -> None:
    def edited(region: Region, owners: list[Block]) -> list[Block]:
        outlines = list(outlines_in(SavedBuildings(region.store), SIDE).items())
        verdicts = zip(outlines, (FLAT_ROOF, NO_BUILDING, FLAT_ROOF), strict=False)
        found = correct(region, [Edit(verdict, outline, name) for (name, outline), verdict in verdicts])
        assert (len(found.modelled), len(found.removed)) == (2, 1)
        return SavedBuildings(region.store).owners(SIDE)

    assert build(crossed, tmp_path / "whole", correction=edited).found == 8
    assert tiled(crossed, tmp_path / "tiled", correction=edited).found == 8
    assert contents(tmp_path / "tiled") == contents(tmp_path / "whole")


@pytest.mark.slow
def test_a_run_by_tiles_is_opened_again_for_edits(crossed: Path, tmp_path: Path) -> None:
    pipeline.build(crossed, tmp_path, per_tile=True, outputs=("footprints", "models"))
    name = json.loads((tmp_path / "buildings.city.jsonl").read_text("utf-8").splitlines()[1])["id"]
    (tmp_path / "edits.csv").write_text(f"id,verdict\n{name},no building\n", encoding="utf-8")
    done = update(tmp_path, edits=tmp_path / "edits.csv")
    assert (done.found, done.corrected.removed) == (8, (name,))
    assert read_facts(tmp_path)["request"]["options"]["per_tile"]
