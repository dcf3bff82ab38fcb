"""From points to tables and meshes in Python: one way in, one value out, whoever asks."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import geopandas
import laspy
import numpy as np
import pandas
import pytest
import shapely

import eaves
from eaves.formats import InputError, read_cityjson
from tests.conftest import but_first, write_laz

FIGURES = ["id", "area_m2", "volume_m3", "h_max", "trust"]
SYSTEM = 28992


@pytest.fixture(scope="module")
def tile(nine_roofs_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three of the nine roofs."""
    las = laspy.read(nine_roofs_file)
    path = tmp_path_factory.mktemp("results") / "tile.laz"
    write_laz(path, las.xyz[las.y < las.y.min() + 33.0])
    return path


@pytest.fixture(scope="module")
def run(tile: Path) -> eaves.Results:
    """What the command gives of them."""
    return eaves.build(tile, tile.parent / "out", crs=SYSTEM)


def same(table: pandas.DataFrame, other: pandas.DataFrame) -> bool:
    """True if two tables have the same buildings."""
    one, two = (one.sort_values("id", ignore_index=True) for one in (table, other))
    return bool(one[FIGURES].equals(two[FIGURES]) and one.geometry.equals(two.geometry))


@pytest.mark.parametrize("kind", but_first(["cloud", "path", "laspy", "array", "fortran"]))
def test_points_in_memory_give_the_buildings_of_their_file(run: eaves.Results, tile: Path, kind: str) -> None:
    las = laspy.read(tile)
    points = {
        "path": tile,
        "laspy": las,
        "array": las.xyz,
        "fortran": np.asfortranarray(las.xyz),
        "cloud": eaves.read(tile, crs=SYSTEM),
    }[kind]
    found = eaves.find_buildings(points, crs=SYSTEM)
    folder = found.folder
    assert same(found.footprints, run.footprints)
    assert len(found.planes) == len(run.planes) and len(found) == len(run) == 3
    del found
    assert not folder.exists()


def test_one_who_comes_from_numpy_and_laspy_gets_heights_volumes_and_a_cloud(tile: Path) -> None:
    las = laspy.read(tile)
    cloud = eaves.PointCloud.from_laspy(las, crs=SYSTEM)
    assert np.abs(np.sort(cloud.world, axis=0) - np.sort(las.xyz, axis=0)).max() < 1e-3
    found = eaves.find_buildings(cloud)
    heights = (found.footprints.h_max - found.footprints.h_ground).to_numpy()
    assert ((heights > 2) & (heights < 20)).all()
    volumes = np.array([mesh.volume for mesh in found.models.values()])
    assert np.isclose(np.sort(volumes), np.sort(found.footprints.volume_m3), rtol=1e-3).all()
    ground = eaves.classify_ground(cloud)
    regions = eaves.detect_buildings(ground)
    part = ground[regions.label == 1]
    footprint = eaves.regularise_outlines(eaves.trace_outline(part))
    planes = eaves.segment_roof(part)
    model = eaves.reconstruct_building(part, footprint, planes, eaves.make_dtm(ground))
    assert eaves.validate_model(model) == []
    nearest = found.footprints.distance(footprint.world.centroid).argmin()
    assert model.attributes["volume_m3"] == pytest.approx(found.footprints.volume_m3[nearest], rel=0.05)
    assert found.footprints.geometry[nearest].contains(footprint.world.centroid)


@pytest.mark.slow
def test_one_who_comes_from_geopandas_gets_tables_that_join(run: eaves.Results, tile: Path) -> None:
    parcels = geopandas.GeoDataFrame(
        {"owner": ["a", "b", "c"]}, geometry=run.footprints.buffer(0.5), crs=run.footprints.crs
    )
    found = eaves.find_buildings(tile, crs=SYSTEM, bounds=parcels.total_bounds + [-20, -20, 20, 20])
    joined = found.footprints.sjoin(parcels)
    assert sorted(joined.owner) == ["a", "b", "c"] and found.footprints.crs.to_epsg() == SYSTEM
    given = eaves.find_buildings(tile, crs=SYSTEM, footprints=parcels.to_crs(4326), lod=1.2)
    assert set(given.footprints.lod) == {"1.2"} and len(given.footprints) == 3
    score = eaves.evaluate.footprints(found.footprints.to_crs(4326), parcels)
    assert score.pairs == 3 and score.mean_iou > 0.8
    assert eaves.evaluate.detection(found.footprints, parcels).area.correctness > 0.95
    only = eaves.find_buildings(tile, crs=SYSTEM, clip=parcels.geometry[0].buffer(5))
    assert len(only.footprints) == 1


def test_a_finished_run_is_opened_as_it_was_returned(run: eaves.Results) -> None:
    again = eaves.open_results(str(run.folder))
    assert (again.found, again.trust, again.by_lod, again.complete) == (3, run.trust, run.by_lod, True)
    assert same(again.footprints, run.footprints) and again.cityjson["type"] == "CityJSON"
    assert "3 buildings" in repr(again) and "<path d=" in again._repr_html_()
    assert len(again.doubts) == again.run["doubts"]["count"]
    table = eaves.to_geopandas(read_cityjson(run.folder / "buildings.city.jsonl"))
    assert set(table.id) == set(run.footprints.id)
    assert shapely.area(table.geometry.values).sum() == pytest.approx(run.footprints.area.sum(), rel=1e-3)


@pytest.fixture
def noted(run: eaves.Results) -> Iterator[Path]:
    path = run.folder / "run.json"
    text = path.read_text(encoding="utf-8")
    yield path
    path.write_text(text, encoding="utf-8")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"complete": False}, "has not ended"),
        ({"trust": ...}, "noted no 'trust'"),
        ({"complete": False, "incomplete": ["block 1_2: memory"]}, None),
    ],
)
def test_a_folder_that_holds_no_whole_run_is_one_sentence(
    noted: Path, change: dict[str, object], words: str | None
) -> None:
    facts = json.loads(noted.read_text(encoding="utf-8")) | change
    noted.write_text(json.dumps({k: v for k, v in facts.items() if v is not ...}), encoding="utf-8")
    if words is None:
        with pytest.raises(eaves.IncompleteRunError, match="block 1_2"):
            eaves.open_results(noted.parent)
        assert eaves.open_results(noted.parent, allow_failures=True).failed == ("block 1_2: memory",)
        return
    with pytest.raises(InputError, match=words):
        eaves.open_results(noted.parent)


@pytest.mark.parametrize(
    ("points", "crs", "words"),
    [
        (np.zeros((5, 3)), None, "pass crs="),
        (np.zeros((5, 2)), SYSTEM, r"shape \(N, 3\)"),
        (np.zeros((0, 3)), SYSTEM, "none of 0 has coordinates"),
        ([["a", "b", "c"]], SYSTEM, "must be numbers"),
        (np.full((4, 3), np.nan), SYSTEM, "none of 0 has coordinates"),
    ],
)
def test_points_that_are_none_are_one_sentence(points: object, crs: int | None, words: str) -> None:
    with pytest.raises((TypeError, ValueError), match=words):
        eaves.find_buildings(points, crs=crs)


def test_a_folder_without_a_run_and_polygons_that_are_none_are_refused(tmp_path: Path, tile: Path) -> None:
    with pytest.raises(InputError, match="give the folder of a run"):
        eaves.open_results(tmp_path)
    with pytest.raises(TypeError, match="footprints must be a path, a GeoDataFrame or polygons"):
        eaves.find_buildings(tile, footprints=[1, 2])


@pytest.mark.slow
def test_progress_is_bars_or_a_function(tile: Path, capsys: pytest.CaptureFixture[str]) -> None:
    steps: list[str] = []
    eaves.find_buildings(tile, crs=SYSTEM, progress=lambda step, done, total: steps.append(step))
    assert {"points", "regions", "buildings", "write"} <= set(steps)
    eaves.find_buildings(tile, crs=SYSTEM, progress=True)
    assert "buildings" in capsys.readouterr().err


@pytest.mark.slow
def test_a_kept_run_of_values_in_memory_goes_on_from_its_folder(
    run: eaves.Results, tile: Path, tmp_path: Path
) -> None:
    table, las = run.footprints[["id", "geometry"]], laspy.read(tile)
    wanted = {"crs": SYSTEM, "footprints": table, "outputs": ("footprints", "models"), "keep": True}
    out = tmp_path / "out"
    kept = eaves.build(eaves.read(tile, crs=SYSTEM), out, **wanted)
    given = sorted(path.name for path in (out / "given").iterdir())
    assert [name.split("-")[0] for name in given] == ["footprints", "points"]
    again = eaves.build(eaves.read(tile, crs=SYSTEM), out, resume=True, **wanted)
    assert same(again.footprints, kept.footprints)
    assert sorted(path.name for path in (out / "given").iterdir()) == given
    write_laz(tmp_path / "later.laz", las.xyz[las.x < np.median(las.x)] + [0.0, 0.0, 0.002], epsg=SYSTEM)
    updated = eaves.update(out, tmp_path / "later.laz", tmp_path / "new")
    assert set(updated.footprints.id) == set(table.id)


def test_what_is_refused_leaves_no_copy_of_values_in_memory(run: eaves.Results, tmp_path: Path) -> None:
    cloud = eaves.PointCloud(np.zeros((4, 3)))
    with pytest.raises(ValueError, match="unknown level of detail"):
        eaves.build(cloud, tmp_path / "out", footprints=run.footprints, lod="9", keep=True)
    assert not (tmp_path / "out").exists()
