"""The maps of the steps of a published system, as `eaves build --steps` writes them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import rasterio

import eaves
from eaves.methods import make_method
from eaves.model import Raster
from eaves.raster.surfaces import make_scene
from eaves.recipe.sources import SOURCES

FIRST = {
    "chen_sun": "detect_patches",
    "xiao2014": "ground_walls",
    "ren_fcs": "ground_surface",
    "roof_attributes": "detect_cosine_of_slope",
    "maas_vosselman": "detect_texture",
}


@pytest.mark.parametrize("source", sorted(SOURCES))
def test_each_step_of_a_source_is_a_map(source: str, nine_roofs_file: Path, tmp_path: Path) -> None:
    summary = eaves.build(nine_roofs_file, tmp_path, source=source, steps=True, outputs=("footprints",))
    maps = sorted((tmp_path / "steps").glob("*/*.tif"))
    titles = [path.stem.split("_", 1)[1] for path in maps]
    assert FIRST[source] in titles
    assert "detect_regions" in titles
    assert {title.split("_")[0] for title in titles} <= set(SOURCES[source].methods)
    assert [path.stem for path in (tmp_path / "steps").glob("*.png")] == [maps[0].parent.name]
    for path in maps:
        with rasterio.open(path) as image:
            assert image.crs.to_epsg() == 28992
            assert np.isfinite(image.read(1)).any() or path.stem.endswith(("walls", "trees"))
    assert set(maps) <= set(summary.files)


def test_the_maps_are_those_of_the_method(nine_roofs_file: Path, tmp_path: Path) -> None:
    eaves.build(nine_roofs_file, tmp_path, source="ren_fcs", steps=True, outputs=("classified",), lod="0")
    (cores,) = (tmp_path / "steps").glob("*/*_detect_cores.tif")
    cloud = eaves.read(next(tmp_path.glob("classified*.laz"))).in_canonical_order()
    found: dict[str, Raster] = {}
    make_method("detect", "contours").label(make_scene(cloud, cloud.bounds), found.__setitem__)
    with rasterio.open(cores) as image:
        assert np.array_equal(image.read(1), found["cores"].values)


def test_steps_change_no_other_file(nine_roofs_file: Path, tmp_path: Path) -> None:
    for name, steps in (("with", True), ("without", False)):
        eaves.build(
            nine_roofs_file, tmp_path / name, source="roof_attributes", steps=steps, outputs=("models",)
        )
    one, two = ((tmp_path / name / "buildings.city.jsonl").read_bytes() for name in ("with", "without"))
    assert one == two
    assert not (tmp_path / "without" / "steps").exists()
