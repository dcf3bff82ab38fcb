"""Recipes by source: each published system's chain, and what goes before it."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pyogrio
import pytest
import shapely
import shapely.affinity
from tests.conftest import but_first, write_laz

import eaves
from eaves.detect import detect_buildings
from eaves.ground import classify_ground
from eaves.methods import DEFAULTS, method_class
from eaves.raster.surfaces import make_scene
from eaves.recipe.recipe import make_recipe, sources
from eaves.simulate import nine_roofs_on_a_slope

BIBLIOGRAPHY = (Path(__file__).parents[2] / "references.bib").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", sources())
def test_a_source_names_its_methods_and_its_paper(name: str) -> None:
    source = sources()[name]
    recipe = make_recipe(source=name)
    assert recipe.lod == source.lod
    for stage in DEFAULTS:
        method = getattr(recipe, stage)
        if method is None:  # beyond what the source delivers
            assert stage not in source.methods
            continue
        assert method.name == source.methods.get(stage, DEFAULTS[stage])
    assert f"{{{source.paper}," in BIBLIOGRAPHY
    assert method_class("detect", source.methods["detect"]).paper == source.paper


@pytest.mark.parametrize("published", but_first([False, True]))
@pytest.mark.parametrize("name", sources())
def test_a_source_finds_the_same_far_from_the_origin_of_its_axes(name: str, published: bool) -> None:
    cloud = nine_roofs_on_a_slope(density=6.0).cloud
    recipe = make_recipe(source=name, published=published)
    found = []
    for shift in ([0.0, 0.0, 0.0], [4_217.5, 9_153.0, 861.5]):  # whole cells of no grid but the finest
        ground = classify_ground(cloud.with_(xyz=cloud.xyz + shift), recipe.ground)
        regions = detect_buildings(make_scene(ground, ground.bounds), recipe.detect)
        found.append((ground.ground, regions.label > 0))
    (here, roofs), (there, moved) = found
    assert np.array_equal(here, there)
    assert (roofs != moved).mean() < 0.01


def test_what_is_given_goes_before_the_source() -> None:
    recipe = make_recipe({"outline": "global_fit", "detect": {"curved": 0.05}}, source="xiao2014", lod="1.2")
    assert recipe.outline.name == "global_fit"
    assert recipe.detect is not None and recipe.detect.name == "normal_echo"
    assert recipe.detect.model_dump()["curved"] == 0.05
    assert recipe.ground.name == "smooth_region"
    assert recipe.lod == "1.2"


def test_an_unknown_source_is_refused_with_those_there_are() -> None:
    with pytest.raises(ValueError, match="unknown source 'xiao'; choose one of: chen_sun"):
        make_recipe(source="xiao")


def test_every_house_of_a_run_has_its_parameters__fitted_and_closed_at_its_place(tmp_path: Path) -> None:
    scene = nine_roofs_on_a_slope(density=6.0)
    write_laz(tmp_path / "a.laz", scene.cloud.xyz + [84_960.0 + 120.0, 447_120.0 + 100.0, 0.0])
    out = tmp_path / "out"
    eaves.build(tmp_path / "a.laz", out, source="maas_vosselman", outputs=("footprints", "models"))
    rows = pyogrio.read_dataframe(out / "footprints.gpkg", layer="primitives")
    with (out / "primitives.csv").open() as file:
        assert [row["building_id"] for row in csv.DictReader(file)] == list(rows.building_id)
    buildings = pyogrio.read_dataframe(out / "footprints.gpkg", layer="footprints")
    assert set(rows.building_id) == set(buildings.id[buildings.method == "maas_vosselman"])
    assert len(rows) == buildings.primitives.sum()
    assert (rows.made_by == "moments").sum() == buildings.primitives_by_moments.sum() > 5
    houses = rows[rows.made_by == "moments"]
    gable = next(one for one in scene.buildings if one.kind == "gable")
    place = np.array(gable.footprint.centroid.coords[0]) + [84_960.0 + 120.0, 447_120.0 + 100.0]
    far = np.hypot(houses.house_x_m - place[0], houses.house_y_m - place[1])
    house = houses.loc[far.idxmin()]
    assert far.min() < 0.3 and house.house_type == "gable" and house.house_axes == "points"
    sides = shapely.minimum_rotated_rectangle(gable.footprint)
    width, length = sorted(np.hypot(*np.diff(shapely.get_coordinates(sides)[:3], axis=0).T))
    assert [house.house_width_m, house.house_length_m] == pytest.approx([width, length], abs=0.6)
    for name in ("x", "y", "length", "width", "eaves", "ridge"):
        closed, error = house[f"house_{name}_closed_m"], house[f"house_{name}_sd_m"]
        assert closed == pytest.approx(house[f"house_{name}_m"], abs=0.6) and 0.0 < error < 0.3
    assert house.geometry.centroid.distance(shapely.Point(house.house_x_m, house.house_y_m)) < 1e-3
    plan = shapely.affinity.translate(gable.footprint, 84_960.0 + 120.0, 447_120.0 + 100.0)
    assert house.geometry.intersection(plan).area > 0.9 * plan.area
