"""Ridges that run into each other make one node, however the roof lies."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from shapely import affinity

from eaves.model import BuildingModel, Footprint, RoofPlane
from eaves.reconstruct import reconstruct_building
from eaves.simulate.objects.houses import gable, make_building, wing
from eaves.solids.coverage import NARROWEST_NECK
from eaves.solids.cutting import arrange
from eaves.validate.models import validate_model


@pytest.mark.parametrize("turn", [0.0, 11.0, 56.0, 90.0, 146.0])
@pytest.mark.parametrize("drop", [0.0, 0.001, 0.004, 0.008, 0.015])
def test_t_gable_keeps_five_faces__planes_meet_up_to_15_mm_apart(turn: float, drop: float) -> None:
    building = make_building(gable(16, 9, 0.8) + wing(12, 9, 0.8, 0.0, 1.0), 1, 1, "T", -5.0, 0.0)
    rng = np.random.default_rng(5)
    xy = rng.uniform([-8, -4.5], [8, 12], (4000, 2))
    angle = np.radians(turn)
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    points, planes, start = [], [], 0
    for face in building.faces:
        own = xy[shapely.contains_xy(face.polygon, xy[:, 0], xy[:, 1])]
        a, b, c = face.coefficients
        lower = drop if abs(a) > abs(b) else 0.0
        points.append(np.column_stack([own @ rotation.T, face.height_at(own) - lower]))
        gradient = rotation @ np.array([a, b])
        members = np.arange(start, start + len(own))
        planes.append(RoofPlane((float(gradient[0]), float(gradient[1]), c - lower), members, 0.0))
        start += len(own)
    outline = shapely.set_precision(affinity.rotate(building.footprint, turn, origin=(0, 0)), 0.001)
    model = reconstruct_building(
        np.concatenate(points), Footprint(shapely.orient_polygons(outline)), planes, -5.0
    )
    assert isinstance(model, BuildingModel)
    assert model.lod == "2.2"
    # the northern faces, of one plane, may hang together by a strip 5 cm wide along the ridge
    assert model.attributes["roof_face_count"] in (4, 5)
    assert not validate_model(model)


def test_lines_that_nearly_meet_meet_in_one_place() -> None:
    waist = 0.004
    lines = [
        (-1, 2 - waist, 3, 2),
        (3 + waist, 2, 7, 2 + waist),
        (3, 5, 3 - waist, 2),
        (3, 2 + waist, 3.1, -1),
    ]
    plan = arrange(
        shapely.box(0, 0, 6, 4), np.array(lines, np.float64) + np.tile([0.0, 0.0, 0.01, 0.0], (4, 1))
    )
    assert plan is not None and plan.count == 4
    assert shapely.minimum_clearance(plan.polygons()).min() > NARROWEST_NECK
