"""Chimneys too small for a roof face come out as objects; what is part of the roof does not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from eaves.evaluate.models import read_buildings
from eaves.figures.attributes import surface_heights
from eaves.formats import write_cityjson
from eaves.model import BuildingModel, Footprint, Installation, Solid
from eaves.reconstruct import reconstruct_building
from eaves.reconstruct.arrangement import Arrangement
from eaves.reconstruct.toolkit.superstructures import join_overlapping, stand_bodies
from eaves.roof import segment_roof
from eaves.simulate.objects.houses import Masses, chimney, gable, make_building
from eaves.validate import validate_file, validate_model
from tests.formats.cityjson_schema import schema_defects

GABLE = gable(14, 9, 0.8)


def modelled(masses: Masses, density: float, seed: int = 3, least: float = 0.0) -> BuildingModel:
    building = make_building(masses, 1, 1, "", -5.0, 0.0)
    xy = np.random.default_rng(seed).uniform([-7, -4.5], [7, 4.5], (int(126 * density), 2))
    z = np.zeros(len(xy))
    for face in building.faces:
        over = shapely.contains_xy(face.polygon, xy[:, 0], xy[:, 1])
        z[over] = face.height_at(xy[over])
    points = np.column_stack([xy, z + np.random.default_rng(1).normal(0.0, 0.02, len(xy))])
    planes = segment_roof(points, density**-0.5)
    footprint = Footprint(shapely.orient_polygons(building.footprint), id="house")
    method = Arrangement(superstructure_least=least)
    model = reconstruct_building(points, footprint, planes, -5.0, method)
    assert isinstance(model, BuildingModel)
    return model


@pytest.mark.parametrize("density", [30.0, 60.0])
def test_chimney_of_0_36_m2_is_an_object_in_its_place(density: float) -> None:
    model = modelled((*GABLE, chimney(3.0, 1.5, 3.6, side=0.6)), density)
    assert [one.kind for one in model.installations] == ["chimney"]
    one = model.installations[0]
    assert one.polygon.centroid.distance(shapely.Point(3.0, 1.5)) < 0.15
    assert one.polygon.area == pytest.approx(0.36, abs=0.25)
    assert one.top == pytest.approx(3.6, abs=0.06)
    assert model.attributes["installation_count"] == 1


def test_objects_smaller_than_asked_for_are_left_out() -> None:
    roof = (*GABLE, chimney(3.0, 1.5, 3.6, side=0.6))
    small, wanted = modelled(roof, 60.0, least=0.0), modelled(roof, 60.0, least=1.0)
    assert len(small.installations) == 1 and wanted.installations == ()
    assert wanted.attributes["installation_count"] == 0


def test_pieces_of_one_top_whose_boxes_meet_are_one_object__a_lower_one_is_another() -> None:
    block = np.array([[x, y, 5.0] for x in np.arange(0.0, 1.0, 0.1) for y in np.arange(0.0, 0.6, 0.1)])
    beside = block + np.array([1.2, 0.0, 0.0])
    lower = block + np.array([0.0, 0.8, -1.0])
    points = np.vstack([block, beside, lower])
    groups = [np.arange(60), np.arange(60, 120), np.arange(120, 180)]
    joined = join_overlapping(groups, points, 0.2, 0.35)
    assert [len(one) for one in joined] == [120, 60]


def test_bare_roof_has_no_object() -> None:
    assert modelled(GABLE, 30.0).installations == ()


def test_large_dormer_is_in_the_solid__not_an_object() -> None:
    assert modelled((*GABLE, chimney(0.0, 2.2, 3.4, side=2.0)), 30.0).installations == ()


@pytest.mark.parametrize("y", [0.0, 0.2, 1.5])
def test_body_of_an_object_stands_on_the_roof__across_the_ridge_too(y: float) -> None:
    model = modelled(GABLE, 30.0)
    (body,) = stand_bodies(model.solids["2.2"], [shapely.box(2.6, y - 0.4, 3.4, y + 0.4)], [4.5])
    assert body is not None
    lowest = body.vertices[body.vertices[:, 2] < 4.49]
    assert np.ptp(lowest[:, 2]) > 0.1 and body.vertices[:, 2].max() == pytest.approx(4.5)
    above = lowest[:, 2] - surface_heights(model.solids["2.2"], lowest[:, :2])[0]
    assert above.min() > 0.0 and above.max() < 0.02
    one = Installation("chimney", shapely.box(2.6, y - 0.4, 3.4, y + 0.4), 4.5, 1.0, 9, body)
    assert validate_model(model.with_(installations=(one,))) == []
    sunk = replace(one, solid=Solid.of(body.vertices - [0.0, 0.0, 0.1], body.faces))
    assert [found.code for found in validate_model(model.with_(installations=(sunk,)))] == [601]


def test_objects_side_by_side_share_no_volume() -> None:
    roof = modelled(GABLE, 10.0).solids["2.2"]
    outlines = [shapely.box(1.0, -1.0, 2.0, 1.0), shapely.box(1.5, -0.5, 3.0, 0.5)]
    one, other = (body for body in stand_bodies(roof, outlines, [4.6, 4.8]) if body is not None)
    assert one.vertices[:, 0].max() == pytest.approx(2.0)
    assert other.vertices[:, 0].min() == pytest.approx(2.0)


def test_objects_are_children_of_their_building_in_cityjson(tmp_path: Path) -> None:
    model = modelled((*GABLE, chimney(3.0, 1.5, 3.6, side=0.6)), 60.0)
    path = tmp_path / "one.city.json"
    write_cityjson(path, [model])
    text = path.read_text(encoding="utf-8")
    assert '"type":"BuildingInstallation"' in text and '"function":"chimney"' in text
    assert validate_file(path) == []
    assert schema_defects(path) == []
    assert [building.id for building in read_buildings(path)] == ["house"]
