"""The maps of the steps of a published system, as `eaves build --steps` writes them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import rasterio
from tests.conftest import build_in_blocks, but_first, write_laz

import eaves
from eaves.flow.intermediates import StepMaps, lines_of, split_parts
from eaves.methods import resolve_method
from eaves.model import Bounds, Raster
from eaves.outline.alpha_shape import AlphaShape
from eaves.raster.contours import Contour
from eaves.raster.grid import empty_raster
from eaves.raster.surfaces import make_scene
from eaves.recipe.recipe import sources
from eaves.simulate.objects.houses import ExactScene

FIRST = {
    "chen_sun": "detect_DTM detect_patches",
    "xiao2014": "ground_regions roof_labels",
    "ren_fcs": "ground_surface detect_nDSM detect_Sobel_heights",
    "roof_attributes": "detect_cosine_of_slope",
    "maas_vosselman": "detect_texture",
}


@pytest.mark.parametrize("source", but_first(sorted(sources())))
def test_each_step_of_a_source_is_a_map(source: str, nine_roofs_file: Path, tmp_path: Path) -> None:
    summary = eaves.build(nine_roofs_file, tmp_path, source=source, steps=True, outputs=("footprints",))
    maps = sorted((tmp_path / "steps").glob("*/*.tif"))
    titles = [path.stem.split("_", 1)[1] for path in maps]
    assert {*FIRST[source].split(), "ground_classes", "detect_regions"} <= set(titles)
    assert {title.split("_")[0] for title in titles} <= set(sources()[source].methods)
    assert [path.stem for path in (tmp_path / "steps").glob("*.png")] == [maps[0].parent.name]
    for path in maps:
        with rasterio.open(path) as image:
            assert image.crs.to_epsg() == 28992
            assert np.isfinite(image.read(1)).any() or path.stem.endswith(("walls", "trees"))
    assert set(maps) <= set(summary.files)


@pytest.fixture(scope="module")
def far_roofs_file(nine_roofs: ExactScene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The nine roofs 120 m from the corner of their block, where a normal is no place."""
    path = tmp_path_factory.mktemp("far") / "far.laz"
    write_laz(path, nine_roofs.cloud.xyz + [84960.0 + 120.0, 447120.0 + 100.0, 0.0])
    return path


@pytest.mark.slow
def test_both_algorithms_of_a_source_are_seen__away_from_the_origin(
    far_roofs_file: Path, tmp_path: Path
) -> None:
    eaves.build(far_roofs_file, tmp_path, source="maas_vosselman", steps=True, outputs=("footprints",))
    shown = {}
    for path in sorted((tmp_path / "steps").glob("*/*.tif")):
        with rasterio.open(path) as image:
            shown[path.stem.split("_", 1)[1]] = image.read(1)
    houses = np.isfinite(shown["detect_regions"]) & (shown["detect_regions"] > 0)
    for step in ("roof_normals_of_triangles", "roof_faces_of_triangles"):
        assert np.isfinite(shown[step]).sum() > 0.7 * houses.sum(), step
    upright = shown["roof_normals_of_triangles"][np.isfinite(shown["roof_normals_of_triangles"])]
    assert upright.min() >= 0.0 and upright.max() <= 1.0
    assert np.unique(shown["roof_faces_of_triangles"][houses]).size > 3
    for step in ("primitives", "moments", "lines"):
        assert np.nansum(shown[f"reconstruct_{step}"]) > 50, step


def test_walls_are_the_points_themselves__not_the_highest_of_a_cell() -> None:
    roof, wall = np.array([[40.2, 50.2, 9.0], [40.3, 50.3, 9.1]]), np.array([[40.25, 50.25, 3.0]])
    maps = StepMaps(empty_raster(Bounds(0.0, 0.0, 100.0, 100.0), 0.5), {"ground"})
    maps.of("ground", np.concatenate([roof, wall]))("walls", wall)
    assert np.nanmax(maps.maps["ground walls"].values) == pytest.approx(3.0)


def test_an_open_contour_is_not_closed_by_its_picture() -> None:
    xy = np.array([[10.0, 10.0], [90.0, 10.0], [90.0, 90.0]])
    lengths = [sum(line.length for line in lines_of([Contour(3.0, xy, closed)])) for closed in (False, True)]
    assert lengths == pytest.approx([160.0, 160.0 + 80.0 * np.sqrt(2.0)])


@pytest.mark.parametrize("published", [False, True])
def test_a_run_names_its_source_its_paper_and_whether_it_is_as_published(
    published: bool, nine_roofs_file: Path, tmp_path: Path
) -> None:
    eaves.build(
        nine_roofs_file, tmp_path, source="ren_fcs", as_published=published, outputs=("footprints",), lod="0"
    )
    noted = json.loads((tmp_path / "run.json").read_text())
    assert noted["source"]["name"] == noted["source"]["paper"] == "ren_fcs"
    assert "Fc-S" in noted["source"]["title"]
    assert noted["as_published"] is published


@pytest.mark.slow
def test_the_maps_are_those_of_the_method(nine_roofs_file: Path, tmp_path: Path) -> None:
    eaves.build(nine_roofs_file, tmp_path, source="ren_fcs", steps=True, outputs=("classified",), lod="0")
    (cores,) = (tmp_path / "steps").glob("*/*_detect_cores.tif")
    cloud = eaves.read(next(tmp_path.glob("classified*.laz"))).in_canonical_order()
    found: dict[str, Raster] = {}
    resolve_method("detect", "contours").label(make_scene(cloud, cloud.bounds), found.__setitem__)
    with rasterio.open(cores) as image:
        assert np.array_equal(image.read(1), found["cores"].values)


@pytest.mark.slow
def test_steps_change_no_other_file(nine_roofs_file: Path, tmp_path: Path) -> None:
    for name, steps in (("with", True), ("without", False)):
        eaves.build(
            nine_roofs_file, tmp_path / name, source="roof_attributes", steps=steps, outputs=("models",)
        )
    one, two = ((tmp_path / name / "buildings.city.jsonl").read_bytes() for name in ("with", "without"))
    assert one == two
    assert not (tmp_path / "without" / "steps").exists()


@pytest.mark.parametrize(("slope", "without"), [(0.0, 1), (0.05, 0)])
def test_a_run_says_in_how_many_blocks_no_contour_lies_on_terrain(
    slope: float, without: int, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    rng = np.random.default_rng(3)
    xy = rng.uniform(0.0, 150.0, (60_000, 2))
    house = (np.abs(xy - 75.0) < [6.0, 4.0]).all(axis=1)
    z = 3.1 + slope * xy[:, 0] + np.where(house, 5.0, 0.0)
    write_laz(tmp_path / "a.laz", np.c_[xy, z] + [84_960.0, 447_120.0, 0.0])
    with caplog.at_level("INFO", logger="eaves"):
        eaves.build(tmp_path / "a.laz", tmp_path / "out", source="ren_fcs", outputs=("footprints",))
    starts = json.loads((tmp_path / "out" / "run.json").read_text())["ground_starts"]
    assert starts == {"blocks": 1, "without contours on terrain": without}
    said = [line for line in caplog.messages if "have no contours on terrain" in line]
    assert len(said) == without


@pytest.mark.slow
def test_blocks_without_contours_are_counted_over_all_tiles(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    west, south = 84_960.0, 447_120.0  # a corner of blocks
    xy = rng.uniform(0.0, [960.0, 240.0], (230_000, 2))
    rise = np.maximum(xy[:, 0] - 550.0, 0.0)  # farther from the second block than its points reach
    z = 3.1 + 0.06 * rise  # two blocks level, two on a slope
    write_laz(tmp_path / "a.laz", np.c_[xy, z] + [west, south, 0.0])
    starts = []
    for name, tile_blocks in (("at once", 0), ("tiles of one", 1), ("tiles of four", 2)):
        build_in_blocks(
            240.0,
            tmp_path / "a.laz",
            tmp_path / name,
            source="ren_fcs",
            lod="0",
            outputs=("footprints",),
            allow_empty=True,
            per_tile=tile_blocks > 0,
            tile_blocks=max(tile_blocks, 1),
        )
        starts.append(json.loads((tmp_path / name / "run.json").read_text())["ground_starts"])
    assert starts == [{"blocks": 4, "without contours on terrain": 2}] * 3


@pytest.mark.slow
def test_ground_regions_are_drawn_where_outliers_leave_first(
    nine_roofs: ExactScene, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    xyz = nine_roofs.cloud.xyz + [84960.0 + 120.0, 447120.0 + 100.0, 0.0]
    middle = xyz[:, :2].mean(axis=0)
    birds = np.array([[*middle, xyz[:, 2].max() + 80.0], [*(middle + 9.0), xyz[:, 2].min() - 60.0]])
    write_laz(tmp_path / "a.laz", np.vstack([xyz, birds]))
    with caplog.at_level("INFO", logger="eaves"):
        eaves.build(tmp_path / "a.laz", tmp_path / "out", source="xiao2014", steps=True, outputs=("models",))
    maps = {path.stem.split("_", 1)[1]: path for path in (tmp_path / "out" / "steps").glob("*/*.tif")}
    images = {}
    for title in ("ground_regions", "ground_classes", "roof_labels", "detect_regions"):
        with rasterio.open(maps[title]) as image:
            images[title] = image.read(1)
    regions, classes = images["ground_regions"], images["ground_classes"]
    number, count = np.unique(regions[classes == 2], return_counts=True)
    assert count.max() > 0.9 * count.sum() and number[count.argmax()] > 0  # the ground is one region
    assert {7.0, 18.0} & set(np.unique(classes[np.isfinite(classes)]))
    buildings = np.unique(images["detect_regions"][images["detect_regions"] > 0])
    planes = [set(np.unique(images["roof_labels"][images["detect_regions"] == one])) for one in buildings]
    shared = [a & b - {0.0} for k, a in enumerate(planes) for b in planes[:k]]
    assert not any({one for one in both if np.isfinite(one)} for both in shared)  # colours of their own


def test_a_step_that_is_no_map_is_noted() -> None:
    points = np.array([[40.2, 50.2, 9.0], [40.3, 50.3, 9.1]])
    maps = StepMaps(empty_raster(Bounds(0.0, 0.0, 100.0, 100.0), 0.5), {"detect"})
    keep = maps.of("detect", points)
    keep("of something else", np.arange(5))
    keep("nothing", np.zeros((0, 3)))
    keep("heights", np.array([1.0, 2.0]))
    maps.of("roof", points)("not asked for", np.arange(5))
    assert list(maps.maps) == ["detect heights"]
    assert list(maps.undrawn) == ["detect of something else", "detect nothing"]


def test_each_part_of_a_region_has_its_outline() -> None:
    rng = np.random.default_rng(4)
    places = [[85_010.0, 447_010.0], [85_040.0, 447_010.0]]
    xy = np.vstack([rng.uniform(0.0, 10.0, (800, 2)) + place for place in places])
    parts = split_parts(np.c_[xy, np.full(len(xy), 6.0)], 0.35, AlphaShape(share=0.5))
    assert sorted(len(part) for part in parts) == [800, 800]
    assert all(np.ptp(part[:, 0]) < 11.0 for part in parts)
