"""Plans cut into primitives, and buildings of several standard houses with exact truth."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from shapely import Polygon

from eaves.figures.attributes import surface_heights
from eaves.model import BuildingModel, Footprint, Points
from eaves.published.maas_vosselman.moments import Moments
from eaves.published.maas_vosselman.reconstruction import MaasVosselman, cut_plan, fill_of
from eaves.published.maas_vosselman.tin_faces import TinFaces
from eaves.reconstruct import reconstruct_building
from eaves.roof import segment_roof
from eaves.validate import validate_model

L_SHAPE = Polygon([(0, 0), (20, 0), (20, 8), (8, 8), (8, 20), (0, 20)])
T_SHAPE = Polygon([(0, 0), (24, 0), (24, 8), (16, 8), (16, 18), (8, 18), (8, 8), (0, 8)])


@pytest.mark.parametrize("angle", [0.0, 27.0])
@pytest.mark.parametrize(("plan", "count"), [(L_SHAPE, 2), (T_SHAPE, 2)])
def test_a_plan_is_cut_into_its_rectangles(plan: Polygon, count: int, angle: float) -> None:
    turned = shapely.affinity.rotate(plan, angle, origin=(0, 0))
    pieces, cuts = cut_plan(turned, 0.9, 6.0)
    assert len(pieces) == count and len(cuts) == count - 1
    assert sum(piece.area for piece in pieces) == pytest.approx(plan.area)
    assert min(map(fill_of, pieces)) > 0.99


def test_the_cut_does_not_depend_on_where_the_ring_starts() -> None:
    ring = shapely.get_coordinates(L_SHAPE.exterior)[:-1]
    first = [piece.area for piece in cut_plan(L_SHAPE, 0.9, 6.0)[0]]
    for turn in range(1, len(ring)):
        assert [p.area for p in cut_plan(Polygon(np.roll(ring, turn, 0)), 0.9, 6.0)[0]] == pytest.approx(
            first
        )


def test_a_rectangle_is_one_primitive_and_a_jog_starts_no_cut() -> None:
    jog = Polygon([(0, 0), (10, 0), (10, 4), (10.2, 4), (10.2, 8), (0, 8)])
    assert len(cut_plan(jog, 0.9, 6.0)[0]) == 1


def two_heights(xy: Points) -> Points:
    """A gable of 8 m × 20 m along x with its ridge at 9, and a flat wing of 5 m north of it."""
    gable = 9.0 - 0.7 * np.abs(xy[:, 1] - 4.0)
    return np.asarray(np.where(xy[:, 1] <= 8.0, gable, 5.0))


def test_a_gable_with_a_flat_wing_is_two_houses_in_one_solid() -> None:
    rng = np.random.default_rng(4)
    xy = rng.uniform(0, 20, (6000, 2))
    xy = xy[shapely.contains_xy(L_SHAPE, xy)]
    points = np.c_[xy, two_heights(xy) + 0.02 * rng.standard_normal(len(xy))]
    planes = segment_roof(points, 0.25, TinFaces())
    model = reconstruct_building(points, Footprint(L_SHAPE), planes, 0.0, MaasVosselman())
    assert isinstance(model, BuildingModel)
    assert model.attributes["method"] == "maas_vosselman"
    assert model.attributes["primitives"] == model.attributes["primitives_by_moments"] == 2
    assert not validate_model(model)
    inner = xy[(np.abs(xy[:, 1] - 8.0) > 0.3)]
    height, _, _ = surface_heights(model.solids["2.2"], inner)
    assert np.median(np.abs(height - two_heights(inner))) < 0.01
    assert np.quantile(np.abs(height - two_heights(inner)), 0.99) < 0.05


def drawn_gable() -> tuple[Points, Polygon]:
    """Points on a gable house of 14 m by 8 m, turned and far from the origin, and its plan."""
    rng = np.random.default_rng(6)
    u, v = rng.uniform([[-7.0], [-4.0]], [[7.0], [4.0]], (2, 600))
    z = 9.0 - 0.7 * np.abs(v) + 0.03 * rng.standard_normal(600)
    x, y = 310 + np.cos(0.5) * u - np.sin(0.5) * v, 170 + np.sin(0.5) * u + np.cos(0.5) * v
    plan = shapely.affinity.rotate(shapely.box(-7, -4, 7, 4), 0.5, origin=(0, 0), use_radians=True)
    return np.c_[x, y, z], shapely.affinity.translate(plan, 310, 170)


@pytest.mark.parametrize("ground_plan", [True, False])
def test_the_closed_solution_runs_in_its_own_chain(ground_plan: bool) -> None:
    points, plan = drawn_gable()
    facts = []
    for closed_only in (False, True):
        houses = Moments(ground_plan=ground_plan, closed_only=closed_only)
        model = reconstruct_building(points, Footprint(plan), [], 0.0, MaasVosselman(houses=houses))
        assert isinstance(model, BuildingModel)
        assert model.attributes["primitives_by_moments"] == 1
        facts.append(model.attributes)
        inner = points[shapely.contains_xy(plan.buffer(-0.3), points[:, :2])]
        height, _, _ = surface_heights(model.solids["2.2"], inner[:, :2])
        assert np.quantile(np.abs(height - inner[:, 2]), 0.95) < 0.15
    fitted, closed = facts
    assert fitted["house_eaves_m"] != closed["house_eaves_m"] == pytest.approx(closed["house_eaves_closed_m"])
    assert fitted["house_eaves_sd_m"] > 0.0 and closed["house_eaves_sd_m"] is None
    assert (fitted["house_length_m"] == pytest.approx(14.0, abs=1e-6)) == ground_plan
    assert abs(closed["house_orientation_deg"] - np.degrees(0.5)) < 2.0
    assert fitted["house_axes"] == ("plan" if ground_plan else "points")
    assert (fitted["house_length_closed_m"] is None) == ground_plan


def test_an_outline_drawn_from_the_points_is_no_ground_plan() -> None:
    points, plan = drawn_gable()
    wider = shapely.affinity.rotate(plan.buffer(0.05, join_style="mitre"), 1.0)
    for agreement, axes, turn in ((None, "plan", 1.0), (0.9, "points", 0.0)):
        outline = Footprint(wider, agreement=agreement)
        model = reconstruct_building(points, outline, [], 0.0, MaasVosselman())
        assert isinstance(model, BuildingModel)
        facts = model.attributes
        assert facts["house_axes"] == axes
        assert facts["house_orientation_deg"] == pytest.approx(np.degrees(0.5) + turn, abs=0.3)
        assert facts["house_length_m"] == pytest.approx(
            14.1 if agreement is None else 14.0, abs=1e-6 if agreement is None else 0.09
        )
        assert (facts["house_length_closed_m"] is None) == (agreement is None)
        assert facts["house_ridge_closed_m"] == pytest.approx(9.0, abs=0.25)


def test_a_roof_that_is_no_standard_house_is_made_of_its_faces() -> None:
    rng = np.random.default_rng(5)
    xy = rng.uniform([0, 0], [12, 8], (4000, 2))
    two_ridges = 8.0 - np.abs(xy[:, 1] % 4.0 - 2.0)
    points = np.c_[xy, two_ridges + 0.01 * rng.standard_normal(len(xy))]
    plan = shapely.box(0, 0, 12, 8)
    planes = segment_roof(points, 0.16, TinFaces())
    model = reconstruct_building(points, Footprint(plan), planes, 0.0, MaasVosselman())
    assert isinstance(model, BuildingModel)
    assert model.attributes["method"] == "maas_vosselman"
    assert model.attributes["primitives_by_moments"] == 0
    assert model.lod == "2.2"
