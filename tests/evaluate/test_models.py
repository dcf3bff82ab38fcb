"""Models against points and against reference models, on two sheds whose figures are known."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import shapely

from eaves.evaluate import evaluate_models
from eaves.evaluate.models import CityBuilding, lay_points, read_buildings
from eaves.formats import write_cityjson
from eaves.geometry.face_table import FaceTable
from eaves.simulate import nine_roofs_on_a_slope

SLOPE = 0.75  # 3:4:5: the cosine of the slope is 0.8
EAST = 500_000.0  # far from the origin, as real data are


def shed(name: str, west: float, lift: float = 0.0, roof: bool = True) -> CityBuilding:
    """Four metres wide, eight deep, the roof rising from 3 m to 6 m; `lift` raises the roof."""
    x0, x1 = EAST + west, EAST + west + 4
    low, high = 3 + lift, 6 + lift
    ring = np.array([[x0, 0, low], [x1, 0, high], [x1, 8, high], [x0, 8, low]])
    base = ring * [1, 1, 0]
    walls = tuple([np.array([base[k], base[(k + 1) % 4], ring[(k + 1) % 4], ring[k]])] for k in range(4))
    faces = ([ring], [base[::-1]], *walls)
    footprint = shapely.box(x0, 0, x1, 8)
    if not roof:
        return CityBuilding(name, "", ("0",), FaceTable.of([]), FaceTable.of([]), footprint)
    return CityBuilding(name, "2.2", ("0", "2.2"), FaceTable.of([[ring]]), FaceTable.of(faces), footprint)


def points_on(*sheds: CityBuilding) -> np.ndarray:
    return lay_points(sheds, 0.5)


PAIR = shed("a", 0), shed("b", 20)
PLACES = {item.id: item.footprint for item in PAIR}


def test_points_are_laid_on_the_roof() -> None:
    xyz = points_on(PAIR[0])
    assert len(xyz) == 128
    assert np.allclose(xyz[:, 2], 3 + SLOPE * (xyz[:, 0] - EAST))


def test_a_perfect_result_scores_perfectly() -> None:
    score = evaluate_models(PAIR, points_on(*PAIR), PLACES, reference=PAIR)
    assert (score.buildings, score.roof_points, score.missed) == (2, 256, 0)
    assert score.rmse_mean_m == pytest.approx(0, abs=1e-9) and score.within == {0.1: 1, 0.2: 1, 0.5: 1}
    assert (score.models, score.without_model, score.lods) == (2, 0, {"2.2": 2})
    assert score.faces_per_building == 6 and score.roof_faces == 2
    assert score.volume_error == 0 and score.height_error_m == 0 and score.findings == {}


def test_volume_and_height_of_a_shed() -> None:
    assert shed("a", 0).volume == pytest.approx(4 * 8 * 4.5)
    assert shed("a", 0).height == pytest.approx(6)


def test_a_lifted_roof_moves_distances_volume_and_height() -> None:
    models = shed("a", 0, lift=0.25), shed("b", 20)
    score = evaluate_models(models, points_on(*PAIR), PLACES, reference=PAIR)
    assert score.missed == 0
    assert [row.rmse_m for row in score.rows] == pytest.approx([0.2, 0], abs=1e-9)
    assert [row.rmse_vertical_m for row in score.rows] == pytest.approx([0.25, 0], abs=1e-9)
    assert score.rmse_mean_m == pytest.approx(0.1)
    assert score.within[0.1] == 0.5 and score.within[0.5] == 1
    assert score.volume_error == pytest.approx((4 * 8 * 0.25) / (4 * 8 * 4.5) / 2)
    assert score.height_error_m == pytest.approx(0.125)


def test_a_missing_model_misses_its_points_and_counts_as_a_metre() -> None:
    models = PAIR[0], shed("b", 20, roof=False)
    score = evaluate_models(models, points_on(*PAIR), PLACES, reference=PAIR)
    assert score.missed == 0.5 and score.rmse_mean_m == pytest.approx(0.5)
    assert score.within[0.5] == 0.5 and (score.models, score.without_model) == (1, 1)
    assert score.rows[1].missed == 1 and score.rows[1].rmse95_m is None


def test_few_bad_points_leave_the_trimmed_figure_alone() -> None:
    xyz = points_on(PAIR[0])
    xyz[:6, 2] += 0.5
    score = evaluate_models(PAIR[:1], xyz, {"a": PLACES["a"]})
    assert score.rmse95_mean_m == pytest.approx(0, abs=1e-9)
    assert score.rmse_mean_m == pytest.approx(0.4 * (6 / 128) ** 0.5)


def test_points_under_others_and_outside_do_not_count() -> None:
    top = points_on(PAIR[0])
    more = np.vstack([top, top - [0, 0, 2.0], top + [0, 100, 0]])
    assert evaluate_models(PAIR[:1], more, {"a": PLACES["a"]}).roof_points == 128


def test_the_highest_of_several_faces_counts() -> None:
    roofs = FaceTable.join([PAIR[0].roofs, shed("x", 0, -1).roofs])
    double = CityBuilding("a", "2.2", (), roofs, FaceTable.of([]), PLACES["a"])
    assert evaluate_models([double], points_on(PAIR[0]), {"a": PLACES["a"]}).rmse_mean_m < 1e-9


def test_nothing_gives_a_score() -> None:
    score = evaluate_models([], np.zeros((0, 3)), {})
    assert score.buildings == 0 and np.isnan(score.missed) and score.lods == {}


def test_damaged_faces_have_a_footprint_of_polygons(tmp_path: Path) -> None:
    scene = nine_roofs_on_a_slope(density=0.1)
    path = tmp_path / "a.city.json"
    write_cityjson(path, [building.model(scene.cloud.origin) for building in scene.buildings])
    document = json.loads(path.read_text())
    for item in document["CityObjects"].values():
        for geometry in item.get("geometry", ()):
            for shell in geometry["boundaries"] if geometry["type"] == "Solid" else ():
                for rings in shell[::2]:  # to and fro along one edge: a line, seen from above
                    rings[0] = [rings[0][0], rings[0][1], rings[0][0], rings[0][1]]
                shell += [[], [[0, 1]]]
            geometry.pop("semantics", None)
    path.write_text(json.dumps(document))
    kinds = {building.footprint.geom_type for building in read_buildings(path)}
    assert kinds <= {"Polygon", "MultiPolygon"}


def test_a_roof_as_wide_as_a_country_is_refused_and_not_laid_out() -> None:
    wide = np.array([[0, 0, 3], [1e7, 0, 3], [1e7, 1e7, 3], [0, 1e7, 3.0]])
    with pytest.raises(ValueError, match="more than any roof"):
        faces = FaceTable.of([[wide]])
        lay_points([CityBuilding("a", "2.2", ("2.2",), faces, faces, shapely.box(0, 0, 1e7, 1e7))])


def test_a_reference_without_volume_has_no_share_in_the_volume_error() -> None:
    faces = FaceTable.of([[ring_of(3.0)]])
    flat = CityBuilding("a", "2.2", ("2.2",), faces, faces, shapely.box(0, 0, 4, 8))
    score = evaluate_models([flat], lay_points([flat]), {"a": flat.footprint}, [], [flat])
    assert np.isnan(score.volume_error)


def ring_of(height: float) -> np.ndarray:
    """A level roof."""
    return np.array([[0, 0, height], [4, 0, height], [4, 8, height], [0, 8, height]])
