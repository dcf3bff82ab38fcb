"""The arrangement on exact roofs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import shapely

from eaves.model import BuildingModel, Failure, Footprint, RoofPlane
from eaves.reconstruct import arrangement, reconstruct_building
from eaves.reconstruct.arrangement import Arrangement
from eaves.reconstruct.toolkit.evidence import spacing_on_roof
from eaves.validate.models import validate_model

Height = Callable[[np.ndarray, np.ndarray], np.ndarray]

BOX = shapely.box(0, 0, 12, 8)


def scan(height: Height, density: float = 10.0, noise: float = 0.02) -> np.ndarray:
    """Points (N, 3) spread over the box, on the surface z = height(x, y)."""
    rng = np.random.default_rng(1)
    x, y = rng.uniform(0, 12, int(density * 96)), rng.uniform(0, 8, int(density * 96))
    return np.column_stack([x, y, height(x, y) + noise * rng.normal(size=len(x))])


def owned(points: np.ndarray, rows: list[tuple[float, float, float]]) -> list[RoofPlane]:
    """The planes with the points that are nearest to each."""
    rise = points[:, :2] @ np.array(rows)[:, :2].T + np.array(rows)[:, 2]
    nearest = np.abs(points[:, 2:] - rise).argmin(axis=1)
    return [RoofPlane(row, np.flatnonzero(nearest == number), 0.02) for number, row in enumerate(rows)]


def model_of(points: np.ndarray, rows: list[tuple[float, float, float]]) -> BuildingModel:
    answer = reconstruct_building(points, Footprint(BOX), owned(points, rows), 0.0, Arrangement())
    assert isinstance(answer, BuildingModel)
    assert not validate_model(answer)
    return answer


def test_gable_has_two_faces_and_its_volume() -> None:
    points = scan(lambda x, y: 7.0 - 0.5 * abs(y - 4.0))
    model = model_of(points, [(0.0, 0.5, 5.0), (0.0, -0.5, 9.0)])
    assert model.lod == "2.2" and set(model.solids) == {"1.2", "1.3", "2.0", "2.2"}
    assert len(model.planes) == 2
    assert model.attributes["roof_type"] == "gable"
    assert model.attributes["volume_m3"] == pytest.approx(12 * 8 * 6.0, rel=0.005)
    assert model.attributes["h_ridge"] == pytest.approx(7.0, abs=0.02)
    assert model.attributes["h_eaves"] == pytest.approx(5.0, abs=0.02)
    azimuths = sorted((face["azimuth_deg"] + 90.0) % 360.0 for face in model.attributes["roof_faces"])
    assert azimuths == pytest.approx([90.0, 270.0], abs=0.5)
    areas = [face["projected_m2"] for face in model.attributes["roof_faces"]]
    assert areas == pytest.approx([48.0, 48.0], abs=0.1)


def test_hip_has_four_faces_that_meet_in_shared_vertices() -> None:
    rows = [(0.0, 0.5, 4.0), (0.0, -0.5, 8.0), (0.5, 0.0, 4.0), (-0.5, 0.0, 10.0)]
    points = scan(lambda x, y: np.min([a * x + b * y + c for a, b, c in rows], axis=0))
    model = model_of(points, rows)
    assert len(model.planes) == 4 and model.attributes["roof_type"] == "hip"
    exact = 4.0 * 96 + 2.0 * (8 * 8 / 2 - 8 * 8 / 6) + 2.0 * 4 * 8 / 2
    assert model.attributes["volume_m3"] == pytest.approx(exact, rel=0.005)


def test_tower_beside_a_low_part_jumps_where_it_does() -> None:
    points = scan(lambda x, y: np.where(x < 5.0, 9.0, 4.0))
    model = model_of(points, [(0.0, 0.0, 9.0), (0.0, 0.0, 4.0)])
    assert model.attributes["volume_m3"] == pytest.approx(40 * 9 + 56 * 4, rel=0.01)
    faces = [face for solid in model.solids["1.3"] for face in solid.faces]
    assert sum(face.surface == "RoofSurface" for face in faces) == 2


def test_flat_dormer_stands_on_its_slope__and_the_simple_roof_has_none() -> None:
    inside = shapely.box(4, 1, 7, 3)

    def height(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.where(shapely.contains_xy(inside, x, y), 8.0, 4.0 + y)

    points = scan(height, density=15.0)
    model = model_of(points, [(0.0, 1.0, 4.0), (0.0, 0.0, 8.0)])
    dormer = min(model.attributes["roof_faces"], key=lambda face: face["area_m2"])
    assert dormer["slope_deg"] == pytest.approx(0.0, abs=0.2)
    assert dormer["projected_m2"] == pytest.approx(6.0, rel=0.25)
    roofs = {
        lod: sum(face.surface == "RoofSurface" for solid in solids for face in solid.faces)
        for lod, solids in model.solids.items()
    }
    assert roofs["2.2"] == 2 and roofs["2.0"] == 1
    (simple,) = model.solids["2.0"]
    assert simple.vertices[:, 2].max() == pytest.approx(12.0, abs=0.02)


def test_no_plane_runs_away_over_empty_ground() -> None:
    points = scan(lambda x, y: 4.0 + y)
    points = points[points[:, 0] < 6.0]
    points = points[points[:, 1] < 3.0]
    model = model_of(points, [(0.0, 1.0, 4.0)])
    assert model.attributes["h_max"] + 1.6 >= model.attributes["h_ridge"]
    assert model.attributes["share_no_data"] > 0.5


def test_a_plan_whose_moved_corners_rise_over_the_points_stays_as_labelled(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    points = scan(lambda x, y: np.where(x < 5.0, 9.0, np.where(y < 3.0, 6.5, 4.0)))
    rises = iter([1.0])
    monkeypatch.setattr(arrangement, "height_over_points", lambda *_: next(rises, 0.0))
    model = model_of(points, [(0.0, 0.0, 9.0), (0.0, 0.0, 6.5), (0.0, 0.0, 4.0)])
    assert model.lod == "2.2" and next(rises, None) is None
    assert len(model.planes) == 3


def test_the_result_does_not_depend_on_a_second_run() -> None:
    points = scan(lambda x, y: 7.0 - 0.5 * abs(y - 4.0))
    rows = [(0.0, 0.5, 5.0), (0.0, -0.5, 9.0)]
    first, second = model_of(points, rows), model_of(points, rows)
    for lod, solids in first.solids.items():
        assert all(
            np.array_equal(one.vertices, other.vertices) and one.faces == other.faces
            for one, other in zip(solids, second.solids[lod], strict=True)
        )


def test_without_planes_the_building_is_a_block_with_the_reason() -> None:
    points = scan(lambda x, y: np.full_like(x, 5.0))
    answer = reconstruct_building(points, Footprint(BOX), [], 0.0, Arrangement())
    assert isinstance(answer, BuildingModel)
    assert "2.2" not in answer.solids
    assert answer.attributes["fallback_code"] == "no_plane"


@pytest.mark.parametrize("count", [0, 1, 2])
def test_too_few_points_are_a_failure(count: int) -> None:
    points = np.tile([6.0, 4.0, 5.0], (count, 1)).reshape(-1, 3)
    answer = reconstruct_building(points, Footprint(BOX), [], 0.0, Arrangement())
    assert isinstance(answer, Failure) and answer.code == "too_few_points"


def test_points_on_a_line_give_a_result() -> None:
    points = np.column_stack([np.linspace(0.1, 11.9, 50), np.full(50, 4.0), np.full(50, 5.0)])
    planes = [
        RoofPlane((0.0, 0.0, 5.0), np.arange(25), 0.0),
        RoofPlane((0.0, 0.0, 5.0), np.arange(25, 50), 0.0),
    ]
    answer = reconstruct_building(points, Footprint(BOX), planes, 0.0, Arrangement())
    assert isinstance(answer, BuildingModel) and not validate_model(answer)


def test_roof_faces_without_points_are_marked() -> None:
    points = scan(lambda x, y: np.where(x < 6.0, 5.0, 8.0))
    model = model_of(points, [(0.0, 0.0, 5.0), (0.0, 0.0, 8.0)])
    assert [face["no_data"] for face in model.attributes["roof_faces"]] == [False, False]
    seen = points[(points[:, 0] > 6.0) | (points[:, 0] < 1.5)]
    model = model_of(seen, [(0.0, 0.0, 5.0), (0.0, 0.0, 8.0)])
    marked = {round(face["h_high"]): face["no_data"] for face in model.attributes["roof_faces"]}
    assert marked == {5: True, 8: False}


def test_spacing_on_a_roof_is_the_same_however_it_lies() -> None:
    outline = shapely.box(-6.0, -4.0, 6.0, 4.0)
    xy = np.random.default_rng(5).uniform([-6, -4], [6, 4], (700, 2))
    roof = np.column_stack([xy, np.zeros(700)])
    found = []
    for angle in np.radians([0.0, 20.0, 56.0, 90.0, 146.0, 270.0]):
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        turned = shapely.transform(outline, lambda places, turn=turn: places @ turn)
        found.append(spacing_on_roof(np.column_stack([xy @ turn, roof[:, 2]]), turned))
    assert np.ptp(found) < 1e-6


@pytest.mark.parametrize(("base", "code"), [(0.0, None), (5.2, "base_too_high"), (8.0, "base_too_high")])
def test_base_among_the_roof_points_is_said(base: float, code: str | None) -> None:
    points = scan(lambda x, y: 7.0 - 0.5 * abs(y - 4.0))
    planes = owned(points, [(0.0, 0.5, 5.0), (0.0, -0.5, 9.0)])
    answer = reconstruct_building(points, Footprint(BOX), planes, base, Arrangement())
    assert isinstance(answer, BuildingModel)
    assert answer.attributes.get("fallback_code") == code
