"""Roofs over their points: no method is silent of one, on drawn houses that lack a part in the scan."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
import shapely
from benchmarks.accuracy.over_returns import rise
from benchmarks.accuracy.unshown_houses import GROUND, PARTS, ROOFS, draw_house

from eaves import RoofPlane, reconstruct_building, segment_roof
from eaves.figures.rows import judge
from eaves.geometry.face_table import FaceTable
from eaves.methods import methods_of
from eaves.model import ROOF_SURFACE, BuildingModel, Footprint, Points
from eaves.reconstruct import add_overhangs
from eaves.reconstruct.toolkit.ceiling import height_over_points
from tests.conftest import but_first

SURE = {"lod": "2.2", "score": 1.0, "area_m2": 100.0, "inlier_share": 1.0, "supported_share": 1.0}
AS_PUBLISHED = ("plane_intersection", "moments", "maas_vosselman")
"""Methods that keep a roof that rises over its points, and say so."""
NOISE = 0.03


def drawn(kind: str, part: str, seed: int) -> tuple[Points, Footprint]:
    """The points (N, 3) of a drawn house, less what it hides, and its plan."""
    rng = np.random.default_rng(seed)
    house = draw_house(kind, part, (20.0, 20.0), rng)
    west, south, east, north = house.plan.bounds
    at = rng.uniform((west, south), (east, north), (int(8 * (east - west) * (north - south)), 2))
    at = at[shapely.contains_xy(house.plan, *at.T) & ~house.hidden(house.own(at))]
    z = GROUND + house.eaves + house.roof.height(house.own(at)) + rng.normal(0.0, NOISE, len(at))
    return np.column_stack([at, z]), Footprint(shapely.orient_polygons(house.plan))


def models(method: str) -> list[tuple[BuildingModel, Points]]:
    """A method's models of drawn houses of each roof without each part, with their points."""
    found = []
    for seed, (kind, part) in enumerate(product(ROOFS, PARTS)):
        points, footprint = drawn(kind, part, seed)
        planes = segment_roof(points, rng=np.random.default_rng(0))
        model = reconstruct_building(points, footprint, planes, GROUND, method)
        assert isinstance(model, BuildingModel)
        found.append((model, points))
    return found


@pytest.mark.parametrize("method", but_first(methods_of("reconstruct"), 2))
def test_roof_over_its_points_is_never_silent(method: str) -> None:
    over = 0
    for model, points in models(method):
        roof = FaceTable.of_solids(model.solids[model.lod], ROOF_SURFACE)
        faces = [roof.rings_of(number) for number in range(len(roof))]
        if rise(faces, points, 1.0) > 0.0:
            over += 1
            assert model.attributes["over_points_m"] > 0.15
        if model.attributes["over_points_m"]:
            trust, _, reason = judge(SURE | {"over_points_m": model.attributes["over_points_m"]})
            assert trust != "high" and "over its highest point" in reason
        if method not in AS_PUBLISHED:
            assert not any(height_over_points(solids, points) for solids in model.solids.values())
        around = add_overhangs(model, points, points[:, 2] - GROUND)
        highest = [solid.vertices[:, 2].max() for solid in around.solids[around.lod]]
        assert max(highest) <= roof.corners[:, 2].max() + 1e-9
    assert not over or method in AS_PUBLISHED


def test_ridge_over_the_points_of_both_its_planes_may_rise_over_them() -> None:
    points, footprint = drawn("gable", "nothing", 0)
    whole = reconstruct_building(points, footprint, segment_roof(points), GROUND)
    assert isinstance(whole, BuildingModel)
    top = whole.attributes["h_max"]
    assert height_over_points(whole.solids["2.2"], points[points[:, 2] < top - 0.2]) == 0.0
    assert height_over_points(whole.solids["2.2"], points[points[:, 2] < top - 1.2]) > 1.0


def test_plane_without_points_where_it_rises_is_said_by_a_method_that_keeps_it() -> None:
    xy = np.random.default_rng(0).uniform((0, 0), (12, 4), (600, 2))
    points = np.column_stack([xy, 3.0 + xy[:, 1]])
    plane = RoofPlane((0.0, 1.0, 3.0), np.arange(len(points)), 0.0)
    footprint = Footprint(shapely.box(0, 0, 12, 8))
    model = reconstruct_building(points, footprint, [plane], 0.0, "plane_intersection")
    assert isinstance(model, BuildingModel)
    assert model.attributes["over_points_m"] == pytest.approx(4.0, abs=0.05)
