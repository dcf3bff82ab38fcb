"""LoD 2.3: walls that stand back from the edge of the roof, undersides, roofs without walls."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import shapely

from eaves import build, validate_model
from eaves.figures.attributes import measure_volume
from eaves.formats import write_cityjson
from eaves.geometry.face_table import FaceTable
from eaves.model import BuildingModel, Footprint, Solid
from eaves.model.building import GROUND_SURFACE, OUTER_CEILING_SURFACE, ROOF_SURFACE
from eaves.reconstruct import add_overhangs
from eaves.reconstruct.overhangs import edges_inward
from eaves.simulate import scan_town, simulate_town, write_simulation
from eaves.simulate.objects.houses import Masses, flat, gable, hip, make_building, shifted_masses, wing
from eaves.solids.undersides import RoofPlan, build_overhanging, walls_inside

THICK = 0.25


def roof_of(masses: Masses, height: float = 4.0) -> BuildingModel:
    """The exact building of masses whose eaves lie so high over a base of 0 m."""
    return make_building(shifted_masses(masses, 0.0, 0.0, height, 0.3), 1, 1, "", 0.0, 0.0).model()


def area_of(solid: Solid, surface: str) -> float:
    """Area in plan (m²) of the faces of one kind."""
    vectors = FaceTable.of_solids([solid]).vectors
    return float(sum(abs(v[2]) for f, v in zip(solid.faces, vectors, strict=True) if f.surface == surface))


def built(model: BuildingModel, over: float | list[float]) -> BuildingModel:
    """The model with walls that stand back by so much under each edge, or by these."""
    roof = RoofPlan.of(model.solids["2.2"][0])
    count = len(edges_inward(roof.outline)[0])
    walls = walls_inside(roof.outline, over if isinstance(over, list) else [over] * count)
    solids, touching = build_overhanging(roof, walls, THICK)
    assert len(touching) == 0
    return model.with_(solids={"2.3": solids})


@pytest.mark.parametrize(
    "masses",
    [
        flat(12.0, 8.0),
        gable(12.0, 8.0, 0.8),
        hip(14.0, 9.0, 0.6),
        gable(16.0, 9.0, 0.8) + wing(14.0, 7.0, 0.8, 4.5, 1.0),
        gable(12.0, 8.0, 0.8) + shifted_masses(flat(6.0, 6.0), 8.5, 0.0, -1.0),
    ],
    ids=["flat", "gable", "hip", "L-shape", "step"],
)
def test_solid_with_overhangs_is_valid_and_as_large_as_it_must_be(masses: Masses) -> None:
    model = roof_of(masses)
    whole = model.solids["2.2"][0]
    result = built(model, 0.5)
    assert validate_model(result) == []
    (solid,) = result.solids["2.3"]
    plan = model.footprint.polygon
    walls = shapely.buffer(plan, -0.5, join_style="mitre")
    assert area_of(solid, GROUND_SURFACE) == pytest.approx(walls.area, rel=2e-3)
    assert area_of(solid, OUTER_CEILING_SURFACE) == pytest.approx(plan.area - walls.area, rel=2e-2)
    assert area_of(solid, ROOF_SURFACE) == pytest.approx(plan.area, rel=1e-4)
    roof = [face for face in solid.faces if face.surface == ROOF_SURFACE]
    assert [face.plane for face in roof] == [f.plane for f in whole.faces if f.surface == ROOF_SURFACE]
    below = measure_volume(whole) - measure_volume(solid)
    assert 0.0 < below < (plan.area - walls.area) * (whole.vertices[:, 2].max() - THICK)


def test_parapet_that_would_hang_in_the_air_stands_on_the_ground() -> None:
    result = built(roof_of(flat(12.0, 8.0, parapet=0.8)), 0.5)
    assert validate_model(result) == []
    assert len(result.solids["2.3"]) == 1


def test_volume_under_a_flat_overhang_is_exact() -> None:
    (solid,) = built(roof_of(flat(12.0, 8.0)), 0.5).solids["2.3"]
    assert measure_volume(solid) == pytest.approx(11.0 * 7.0 * 4.0 + (96.0 - 77.0) * THICK, rel=1e-3)


def test_each_edge_has_its_own_overhang_and_a_party_wall_none() -> None:
    result = built(roof_of(gable(12.0, 8.0, 0.8)), [0.6, 0.0, 0.3, 0.9])
    assert validate_model(result) == []
    (solid,) = result.solids["2.3"]
    ground = area_of(solid, GROUND_SURFACE)  # opposite edges: 0.6 and 0.3, 0.0 and 0.9
    assert ground == pytest.approx(11.1 * 7.1, rel=1e-3)


def test_roof_without_walls_is_a_slab() -> None:
    model = roof_of(gable(8.0, 5.0, 0.4), 2.6)
    solids, touching = build_overhanging(RoofPlan.of(model.solids["2.2"][0]), shapely.Polygon(), THICK)
    assert len(touching) == 0
    assert validate_model(model.with_(solids={"2.3": solids})) == []
    (solid,) = solids
    assert measure_volume(solid) == pytest.approx(40.0 * THICK, rel=1e-3)
    assert area_of(solid, GROUND_SURFACE) == 0.0


def scanned(
    over: dict[int, float], rng: np.random.Generator, ground_below: bool = False
) -> tuple[BuildingModel, np.ndarray, np.ndarray]:
    """A flat roof of 12 by 8 m at 4 m whose edges have these overhangs, a point per m² of wall; all
    points and their heights over the ground.
    """
    model = make_building(shifted_masses(flat(12.0, 8.0), 0.0, 0.0, 4.0), 1, 1, "", 0.0, 0.0).model()
    start, end = edges_inward(model.footprint.polygon)
    parts = [np.column_stack([rng.uniform((-6, -4), (6, 4), (900, 2)), np.full(900, 4.0)])]
    for edge, width in over.items():
        step = end[edge] - start[edge]
        length = float(np.hypot(*step))
        inward = np.array([-step[1], step[0]]) / length
        along = rng.uniform(0.08, 0.92, (round(3 * length), 1))
        wall = start[edge] + along * step + width * inward
        parts.append(np.column_stack([wall, rng.uniform(0.5, 3.5, len(wall))]))
    if ground_below:
        parts.append(np.column_stack([rng.uniform((-6, -4), (6, 4), (200, 2)), np.zeros(200)]))
    points = np.concatenate(parts) + rng.normal(0.0, 0.02, (sum(map(len, parts)), 3))
    return model, points, points[:, 2]


def test_overhangs_are_measured_where_walls_are_seen_and_unknown_elsewhere() -> None:
    true = {0: 0.4, 2: 0.75, 3: 0.0}
    model, points, over_ground = scanned(true, np.random.default_rng(3))
    result = add_overhangs(model, points, over_ground)
    assert result.lod == "2.3"
    assert validate_model(result) == []
    told = result.attributes["overhangs"]
    assert [one["wall"] for one in told] == ["seen", "unknown", "seen", "seen"]
    for edge, width in true.items():
        assert told[edge]["overhang_m"] == pytest.approx(width, abs=0.05)
    assert told[1]["overhang_m"] is None


def test_shrub_under_the_eaves_is_no_wall() -> None:
    rng = np.random.default_rng(5)
    model, points, _ = scanned({}, rng)
    shrub = rng.uniform((-1.5, -4.6, 0.5), (1.5, -3.2, 1.8), (40, 3))
    points = np.concatenate([points, shrub])
    assert add_overhangs(model, points, points[:, 2]).attributes["fallback_code"] == "walls_unseen"


def test_canopy_is_found_by_the_ground_under_it() -> None:
    model, points, over_ground = scanned({}, np.random.default_rng(6), ground_below=True)
    result = add_overhangs(model, points, over_ground)
    assert result.attributes["stands_free"] is True
    assert validate_model(result) == []
    assert measure_volume(result.solids["2.3"][0]) == pytest.approx(96.0 * THICK, rel=1e-3)


@pytest.mark.parametrize(("walls", "free"), [({}, True), ({3: 0.0}, False)])
def test_ground_seen_by_few_points_at_each_edge_counts_together__unless_a_wall_is_seen(
    walls: dict[int, float], free: bool
) -> None:
    model, points, _ = scanned(walls, np.random.default_rng(9))
    ground = np.array(
        [[-3.0, -2.5, 0.0], [2.0, -2.4, 0.0], [4.2, 0.5, 0.0], [1.0, 2.6, 0.0], [-2.0, 2.5, 0.0]]
    )
    points = np.concatenate([points, ground])
    result = add_overhangs(model, points, points[:, 2])
    assert result.attributes["stands_free"] is free


def test_sure_wall_is_measured_beside_a_strip_of_more_points_that_is_not_sure() -> None:
    rng = np.random.default_rng(15)
    model, points, _ = scanned({3: 0.3}, rng)
    strewn = rng.uniform((-5.5, -4.4, 0.5), (5.5, -2.8, 3.5), (250, 3))  # a hedge under another edge
    points = np.concatenate([points, strewn])
    told = add_overhangs(model, points, points[:, 2]).attributes["overhangs"]
    assert [one["wall"] for one in told] == ["unknown", "unknown", "unknown", "seen"]


@pytest.mark.parametrize(("upright", "free"), [(0, True), (3, False)])
def test_two_points_of_ground_under_a_roof_show_it_open__unless_as_many_stand_there(
    upright: int, free: bool
) -> None:
    model, points, _ = scanned({}, np.random.default_rng(9))
    ground = np.array([[-3.0, -2.5, 0.0], [2.0, -2.4, 0.0]])
    standing = np.array([[-4.0, -3.5, 0.9], [0.0, -3.0, 1.2], [4.0, -2.6, 1.5]])[:upright]
    points = np.concatenate([points, ground, standing])
    assert add_overhangs(model, points, points[:, 2]).attributes["stands_free"] is free


def test_ground_in_a_hole_of_the_roof_makes_no_canopy() -> None:
    rng = np.random.default_rng(7)
    model, points, _ = scanned({}, rng)
    court = (np.abs(points[:, 0]) < 3.0) & (points[:, 1] < -1.0)
    points = points[~court]
    ground = np.column_stack([rng.uniform((-2.8, -4.0), (2.8, -1.2), (60, 2)), np.zeros(60)])
    points = np.concatenate([points, ground])
    assert add_overhangs(model, points, points[:, 2]).attributes["fallback_code"] == "walls_unseen"


def test_order_of_points_does_not_matter() -> None:
    model, points, over_ground = scanned({0: 0.4, 2: 0.6}, np.random.default_rng(8))
    order = np.random.default_rng(9).permutation(len(points))
    one = add_overhangs(model, points, over_ground)
    other = add_overhangs(model, points[order], over_ground[order])
    assert one.attributes["overhangs"] == other.attributes["overhangs"]
    assert np.array_equal(one.solids["2.3"][0].vertices, other.solids["2.3"][0].vertices)


def test_walls_in_cityjson_say_what_is_known_of_them(tmp_path: Path) -> None:
    model, points, over_ground = scanned({0: 0.4, 2: 0.6}, np.random.default_rng(4))
    write_cityjson(tmp_path / "one.city.json", [add_overhangs(model, points, over_ground)])
    city = json.loads((tmp_path / "one.city.json").read_text())
    (building,) = city["CityObjects"].values()
    assert "overhangs" not in building["attributes"]
    geometry = next(one for one in building["geometry"] if one["lod"] == "2.3")
    walls = [one for one in geometry["semantics"]["surfaces"] if one["type"] == "WallSurface"]
    assert {one.get("wall") for one in walls} >= {"seen", "unknown"}
    assert "OuterCeilingSurface" in {one["type"] for one in geometry["semantics"]["surfaces"]}


def test_model_without_detail_stays_as_it_is() -> None:
    model = BuildingModel(Footprint(shapely.box(0, 0, 4, 4)), {})
    assert add_overhangs(model, np.zeros((0, 3)), np.zeros(0)) is model


@pytest.mark.slow
def test_run_delivers_lod_2_3(tmp_path: Path) -> None:
    town = simulate_town(0.01, style="suburb", trees=0.3, seed=4)
    write_simulation(scan_town(town, density=12.0, seed=4), tmp_path / "town")
    cloud, outputs = tmp_path / "town" / "points.laz", ("models", "footprints")
    summary = build(cloud, tmp_path / "out", lod="2.3", outputs=outputs)
    assert summary.by_lod["2.3"] > 0
