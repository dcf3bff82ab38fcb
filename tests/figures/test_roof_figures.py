"""What roofs of known shape say of themselves, and which faces their points do not support."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from eaves import reconstruct_building, segment_roof
from eaves.figures.attributes import (
    grade_faces,
    ridge_direction,
    roof_figures,
    roof_type,
    storey_figures,
    supported_share,
)
from eaves.figures.rows import judge
from eaves.geometry.face_table import FaceTable
from eaves.model import BuildingModel, Footprint
from eaves.simulate import nine_roofs_on_a_slope
from eaves.simulate.objects.exact import ExactBuilding
from eaves.simulate.objects.houses import (
    Masses,
    chimney,
    flat,
    gable,
    hip,
    make_building,
    mansard,
    pyramid,
    wing,
)


def face(plan: float, slope: float, azimuth: float | None, low: float = 5.0, high: float = 8.0) -> dict:
    area = plan / np.cos(np.radians(slope))
    return {
        "projected_m2": plan,
        "area_m2": float(area),
        "slope_deg": slope,
        "azimuth_deg": azimuth,
        "h_low": low,
        "h_high": high,
    }


@pytest.mark.parametrize(
    ("faces", "kind"),
    [
        ([face(100, 1, None)], "flat"),
        ([face(60, 12, 90.0)], "shed"),
        ([face(50, 40, 10.0), face(50, 40, 190.0)], "gable"),
        ([face(4, 40, 10.0 + k % 2 * 180) for k in range(30)], "gable"),
        ([face(30, 30, k * 90.0) for k in range(4)], "pyramid"),
        ([face(40, 30, 0.0), face(15, 30, 90.0), face(40, 30, 180.0), face(15, 30, 270.0)], "hip"),
        ([face(50, 1, None), face(25, 30, 0.0), face(25, 30, 180.0)], "complex"),
    ],
)
def test_the_type_is_judged_over_the_whole_plan(faces: list[dict], kind: str) -> None:
    assert roof_type(faces) == kind


def test_many_small_steep_faces_are_not_a_flat_roof() -> None:
    figures = roof_figures([face(4, 45, 10.0 + k % 2 * 180) for k in range(50)], 0.0)
    assert figures["roof_type"] == "gable" and figures["roof_share_pitched"] == 1.0


def test_figures_of_a_gable_beside_a_low_annex() -> None:
    faces = [face(50, 45, 0.0, 6.0, 11.0), face(50, 45, 180.0, 6.0, 11.0), face(14, 0, None, 3.0, 3.0)]
    figures = roof_figures(faces, 0.0)
    assert figures["h_eaves"] == 6.0 and figures["h_ridge"] == 11.0 and figures["measuredHeight"] == 11.0
    assert figures["roofType"] == "1030"
    assert figures["ridge_direction_deg"] == 90.0 and figures["roof_slope_deg"] == 45.0
    assert figures["roof_area_n_m2"] == pytest.approx(50 * np.sqrt(2))
    assert figures["roof_area_flat_m2"] == 14.0


@pytest.mark.parametrize(("low", "eaves"), [(442.0, 3.3), (200.0, 11.5)])
def test_area_decides_of_a_stepped_building(low: float, eaves: float) -> None:
    figures = roof_figures([face(low, 0, None, 3.3, 3.3), face(232, 0, None, 11.5, 11.5)], 0.0)
    assert figures["h_eaves"] == eaves
    assert figures["h_ridge"] == figures["h_max"] == 11.5


def box(
    east: float, depth: float, top: float, west: float = 0.0, bottom: float = 0.0
) -> list[list[np.ndarray]]:
    """The faces of a box whose south-west corner lies at x = `west`, y = 0."""
    base = np.array([[west, 0.0], [east, 0.0], [east, depth], [west, depth]])
    low, high = (np.column_stack([base, np.full(4, height)]) for height in (bottom, top))
    sides = [np.array([low[k], low[k - 3], high[k - 3], high[k]]) for k in range(4)]
    return [[low[::-1]], [high], *([side] for side in sides)]


def test_each_part_has_its_own_storeys() -> None:
    # a hall of 3.3 m with a block of 11.5 m beside it, 442 and 232 m²
    solids = FaceTable.of(box(44.2, 10, 3.3) + box(67.4, 10, 11.5, west=44.2))
    figures = storey_figures(solids, 0.0)
    assert (figures["storeysAboveGround"], figures["floor_area_m2"]) == (1, pytest.approx(442 + 4 * 232))


def test_no_floor_lies_in_a_passage() -> None:
    # a block of three storeys whose eastern half stands over a passage of 4 m
    solids = FaceTable.of(box(10, 10, 9.0) + box(20, 10, 9.0, west=10.0, bottom=4.0))
    figures = storey_figures(solids, 0.0)
    assert (figures["storeysAboveGround"], figures["floor_area_m2"]) == (3, pytest.approx(500.0))


def test_a_low_shed_has_a_floor() -> None:
    figures = storey_figures(FaceTable.of(box(4, 3, 1.2)), 0.0)
    assert (figures["storeysAboveGround"], figures["floor_area_m2"]) == (1, pytest.approx(12.0))


def test_of_an_attic_counts_where_a_person_can_stand() -> None:
    # eaves at 5 m, slope .8 over a depth of 9 m: at 7.3 m the plan is 2 (9 / 2 - 2.3 / .8) m deep
    told = modelled(gable(14, 9, 0.8))
    assert told["storeysAboveGround"] == 2
    assert told["floor_area_m2"] == pytest.approx(2 * 14 * 9 + 14 * 2 * (4.5 - 2.3 / 0.8), rel=0.02)


def test_the_ridge_direction_does_not_depend_on_which_side_is_named_first() -> None:
    assert ridge_direction([face(50, 45, 350.0), face(50, 45, 170.0)]) == 80.0


def test_a_crown_above_does_not_raise_the_roof() -> None:
    truth = nine_roofs_on_a_slope(density=10.0)
    building = truth.buildings[0]
    points = truth.cloud.xyz[truth.building == 1]
    crown = points[:40] + [0.0, 0.0, 9.0]
    both = np.vstack([points, crown])
    answer = reconstruct_building(both, Footprint(building.footprint), segment_roof(both, 0.3), building.base)
    assert isinstance(answer, BuildingModel)
    top = max(float(f.height_at(np.asarray(f.polygon.exterior.coords)).max()) for f in building.faces)
    assert answer.attributes["h_max"] == pytest.approx(top, abs=0.1)
    assert answer.attributes["h_ridge"] == pytest.approx(top, abs=0.1)


def test_a_face_far_from_its_points_is_named_weak() -> None:
    good = {**face(20, 1, None), "points": 50, "rmse_m": 0.03, "share_no_data": 0.0, "no_data": False}
    bad, strays = {**good, "rmse_m": 4.4}, {**good, "rmse_m": 1.9}
    error = np.concatenate([np.full(50, 0.03), np.full(50, 4.4), np.full(47, 0.03), np.full(3, 8.0)])
    records = [good, bad, strays]
    grade_faces(records, error, np.repeat([0, 1, 2], 50))
    assert records[0]["weak"] is None and records[0]["inlier_share"] == 1.0
    assert "0% of its points" in records[1]["weak"] and records[1]["coverage"] == 1.0
    assert records[2]["weak"] is None  # three points far off make an RMSE of metres and no face unsupported
    assert supported_share([good, bad]) == 0.5
    assert judge({"lod": "2.2", "score": 1.0, "supported_share": 0.3})[0] == "low"


def test_no_roof_rises_over_the_highest_of_its_points_across_gaps() -> None:
    truth = nine_roofs_on_a_slope(density=10.0)
    rng = np.random.default_rng(5)
    for number, building in enumerate(truth.buildings, 1):
        points = truth.cloud.xyz[truth.building == number]
        for _ in range(6):
            centre = points[rng.integers(len(points)), :2]
            away = np.hypot(*(points[:, :2] - centre).T)
            points = points[away > rng.uniform(0.5, 2.5)] if (away > 2.5).sum() > 100 else points
        planes = segment_roof(points, 0.35)
        answer = reconstruct_building(points, Footprint(building.footprint), planes, building.base)
        assert isinstance(answer, BuildingModel), building.kind
        highest = max(solid.vertices[:, 2].max() for solid in answer.solids[answer.lod])
        assert highest <= points[:, 2].max() + 0.3, building.kind


def modelled(masses: Masses) -> dict:
    """The attributes of a model of masses on walls of 5 m, from points at random, 10/m²."""
    rng = np.random.default_rng(3)
    building = make_building([mass.translated(0.3, 0.0, 0.0, 5.0) for mass in masses], 1, 1, "", 0.0, 0.0)
    west, south, east, north = building.footprint.bounds
    xy = rng.uniform((west, south), (east, north), (int(10 * (east - west) * (north - south)), 2))
    z = roof_heights(building, xy)
    points = np.column_stack([xy, z + rng.normal(0.0, 0.03, len(xy))])[np.isfinite(z)]
    answer = reconstruct_building(points, Footprint(building.footprint), segment_roof(points, 0.316), 0.0)
    assert isinstance(answer, BuildingModel)
    return dict(answer.attributes)


def roof_heights(building: ExactBuilding, xy: np.ndarray) -> np.ndarray:
    z = np.full(len(xy), np.nan)
    for part in building.faces:
        inside = shapely.contains_xy(part.polygon, xy)
        z[inside] = part.height_at(xy[inside])
    return z


@pytest.mark.parametrize(
    ("masses", "kind", "ridge"),
    [
        (flat(14, 10, 0.8), "flat", 5.0),
        (gable(14, 9, 0.8) + (chimney(2.0, 0.2, 4.6),), "gable", 8.6),
        (hip(14, 9, 0.8), "hip", 8.6),
        (pyramid(10, 0.7) + (chimney(0.4, 0.3, 4.4),), "pyramid", 8.5),
        (gable(14, 8, 0.8) + wing(10, 6, 0.8, 3.0, 1.0), "complex", 8.2),
        (mansard(11, 11, 1.7, 0.4, 1.2), "hip", None),
    ],
)
def test_type_and_heights_of_exact_roofs(masses: Masses, kind: str, ridge: float | None) -> None:
    told = modelled(masses)
    assert told["roof_type"] == kind
    assert told["h_eaves"] == pytest.approx(5.0, abs=0.1)
    assert ridge is None or told["h_ridge"] == pytest.approx(ridge, abs=0.1)
    assert told["storeysAboveGround"] == 2
