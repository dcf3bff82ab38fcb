"""Houses from moments: the formulas on exact integrals, the fit on exact roofs, what is no house."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from benchmarks.accuracy.moments import SCANS, Truth, uneven_scan

from eaves.geometry.tin import Tin
from eaves.model import BuildingModel, Failure, Footprint
from eaves.published.maas_vosselman.moments import Moments
from eaves.published.maas_vosselman.moments.building import ParametricBuilding, extent_of, fit_building
from eaves.published.maas_vosselman.moments.parametric_roof import (
    ClosedForm,
    SurfaceMoments,
    border_growth,
    closed_forms,
    surface_moments,
)
from eaves.recipe.recipe import make_recipe
from eaves.solids.soundness import find_defect

LENGTH, WIDTH, EAVES, RISE = 12.0, 8.0, 5.0, 3.0


def height(
    roof: str, u: np.ndarray, v: np.ndarray, length: float = LENGTH, width: float = WIDTH
) -> np.ndarray:
    """Exact height of a roof over (u, v)."""
    side = 1.0 - 2.0 * abs(v) / width
    end = (length - 2.0 * abs(u)) / width
    shapes = {
        "flat": np.zeros_like(u),
        "shed": v / width + 0.5,
        "gable": side,
        "hip": np.minimum(side, end),
        "pyramid": np.minimum(side, 1.0 - 2.0 * abs(u) / length),
    }
    return EAVES + RISE * shapes[roof]


def exact_moments(roof: str, angle: float, length: float = LENGTH, width: float = WIDTH) -> SurfaceMoments:
    """The moments of a roof, by Gauss's rule over cells so small and so placed that no crease crosses one."""
    nodes, weights = np.polynomial.legendre.leggauss(4)
    cells = 240
    edges_u, edges_v = (
        np.linspace(-length / 2, length / 2, cells + 1),
        np.linspace(-width / 2, width / 2, cells + 1),
    )
    u = (edges_u[:-1, None] + (nodes + 1) / 2 * length / cells).ravel()
    v = (edges_v[:-1, None] + (nodes + 1) / 2 * width / cells).ravel()
    wu = np.tile(weights / 2 * length / cells, cells)
    wv = np.tile(weights / 2 * width / cells, cells)
    uu, vv = np.meshgrid(u, v)
    w = wv[:, None] * wu[None, :]
    area = w.sum()
    h = height(roof, uu, vv, length, width)
    x, y = np.cos(angle) * uu - np.sin(angle) * vv, np.sin(angle) * uu + np.cos(angle) * vv
    mean = float((w * h).sum() / area)
    up = w * (h - mean) / area
    w = w / area
    z = (x + 1j * y) ** 4
    terms = [w * x * x, w * x * y, w * y * y, up * x, up * y, up * x * x, up * x * y, up * y * y]
    numbers = [float(term.sum()) for term in terms]
    return SurfaceMoments(
        float(area), 0.0, 0.0, mean, *numbers, float((w * z.real).sum()), float((w * z.imag).sum())
    )


def closed_of(roof: str, moments: SurfaceMoments, growth: float = 1.0) -> ClosedForm:
    """The first closed solution of a roof type."""
    return next(form for form in closed_forms(moments, 0.1, growth) if form.roof == roof)


@pytest.mark.parametrize("roof", ["flat", "shed", "gable", "hip"])
@pytest.mark.parametrize("angle", [0.0, 0.5, 2.0])
def test_closed_solution_is_exact_on_exact_integrals(roof: str, angle: float) -> None:
    house = closed_of(roof, exact_moments(roof, angle))
    assert np.allclose((house.length, house.width), (LENGTH, WIDTH), atol=1e-3)
    assert np.isclose(np.cos(2 * (house.orientation - angle)), 1.0, atol=1e-6)
    if roof == "flat":
        assert np.isclose(house.eaves, EAVES)
    else:
        assert np.allclose((house.eaves, house.ridge), (EAVES, EAVES + RISE), atol=2e-3)


@pytest.mark.parametrize("angle", [0.0, 0.3, 0.7])
def test_closed_pyramid_is_exact_and_takes_its_axes_from_the_fourth_moment(angle: float) -> None:
    house = closed_of("pyramid", exact_moments("pyramid", angle, WIDTH, WIDTH))
    assert np.isclose(np.cos(4 * (house.orientation - angle)), 1.0, atol=1e-6)
    assert np.allclose((house.eaves, house.ridge), (EAVES, EAVES + RISE), atol=2e-3)


def test_squarish_gable_takes_its_axis_from_the_heights() -> None:
    house = closed_of("gable", exact_moments("gable", 0.4, 8.4, 8.0))
    assert np.isclose(np.cos(2 * (house.orientation - 0.4)), 1.0, atol=1e-6)
    assert np.isclose(house.rise, RISE, atol=1e-3)


def test_ridge_across_the_long_side_is_found() -> None:
    house = closed_of("gable", exact_moments("gable", 0.4, 6.0, 9.0))
    assert np.allclose((house.length, house.width), (6.0, 9.0), atol=1e-3)


def test_moments_of_triangles_equal_the_exact_integrals() -> None:
    x, y = np.meshgrid(np.linspace(-6, 6, 25), np.linspace(-4, 4, 17))
    points = np.c_[x.ravel(), y.ravel(), height("gable", x.ravel(), y.ravel())]
    found, exact = surface_moments(points, Tin(points[:, :2]).triangles), exact_moments("gable", 0.0)
    for name in ("area", "height", "xx", "yy", "hxx", "hyy", "real", "imaginary"):
        assert np.isclose(getattr(found, name), getattr(exact, name), rtol=1e-9, atol=1e-9), name


def test_uneven_density_does_not_move_the_house() -> None:
    rng = np.random.default_rng(0)
    u, v = rng.uniform(-6, 6, 3000), rng.uniform(-4, 4, 3000)
    kept = (u < 0) | (rng.random(3000) < 0.25)
    points = np.c_[u, v, height("gable", u, v)][kept]
    moments = surface_moments(points, Tin(points[:, :2]).triangles)
    house = closed_of("gable", moments, border_growth(len(points)))
    assert abs(house.x) < 0.1
    assert np.allclose((house.length, house.width, house.rise), (LENGTH, WIDTH, RISE), atol=0.12)


def test_edge_lies_half_a_gap_beyond_the_last_point() -> None:
    low, high, deviation = extent_of(np.linspace(0.25, 9.75, 20))
    assert np.allclose((low, high), (0.0, 10.0))
    assert deviation < 0.5
    strays = np.r_[np.random.default_rng(1).uniform(0, 10, 500), -2.0, 13.0]
    assert np.allclose(extent_of(strays)[:2], (0.0, 10.0), atol=0.1)


def roof_points(roof: str, density: float, noise: float, seed: int, scan: bool = False) -> np.ndarray:
    """Points (N, 3) on a roof turned by 0.4 radians, far from the origin of its axes."""
    rng = np.random.default_rng(seed)
    length = WIDTH if roof == "pyramid" else LENGTH
    if scan:
        u, v = np.meshgrid(
            np.arange(-6 + rng.uniform(0, 0.4), 6, 0.4), np.arange(-4 + rng.uniform(0, 0.2), 4, 2.5 / density)
        )
        u, v = u.ravel() + rng.normal(0, 0.03, u.size), v.ravel() + rng.normal(0, 0.03, u.size)
        inside = (abs(u) < length / 2) & (abs(v) < WIDTH / 2)
        u, v = u[inside], v[inside]
    else:
        count = int(density * length * WIDTH)
        u, v = rng.uniform(-length / 2, length / 2, count), rng.uniform(-WIDTH / 2, WIDTH / 2, count)
    z = height(roof, u, v, length) + rng.normal(0, noise, len(u))
    return np.c_[100 + np.cos(0.4) * u - np.sin(0.4) * v, 50 + np.sin(0.4) * u + np.cos(0.4) * v, z]


@pytest.mark.parametrize("roof", ["flat", "shed", "gable", "hip", "pyramid"])
@pytest.mark.parametrize("scan", [False, True])
def test_fit_is_within_its_target__noise_3cm(roof: str, scan: bool) -> None:
    house = fit_building(roof_points(roof, 5.0, 0.03, 3, scan))
    assert isinstance(house, ParametricBuilding)
    assert house.roof == roof
    assert abs(house.width - WIDTH) < (0.25 if scan else 0.15)  # half a gap between lines is not known
    assert abs(house.eaves - EAVES) < (0.15 if scan else 0.08)
    if roof != "flat":
        assert abs(house.ridge - EAVES - RISE) < (0.15 if scan else 0.08)
        turn = 4 if roof == "pyramid" else 2
        assert abs(np.angle(np.exp(1j * turn * (house.orientation - 0.4)))) / turn < np.radians(1.0)


def test_deviations_tell_the_errors() -> None:
    scores = []
    for seed in range(40):
        house = fit_building(roof_points("hip", 5.0, 0.03, seed))
        assert isinstance(house, ParametricBuilding)
        scores.append(
            [
                (house.length - LENGTH) / house.deviations["length"],
                (house.width - WIDTH) / house.deviations["width"],
                (house.ridge - EAVES - RISE) / house.deviations["ridge"],
                (house.slope - np.arctan(0.75)) / house.deviations["slope"],
                (house.orientation - 0.4) / house.deviations["orientation"],
            ]
        )
    assert np.all(np.std(scores, axis=0) < 2.0)
    assert np.all(np.std(scores, axis=0) > 0.5)


def model_of(points: np.ndarray, **parameters: object) -> BuildingModel | Failure:
    footprint = Footprint(shapely.oriented_envelope(shapely.MultiPoint(points[:, :2])))
    return Moments(**parameters).model(points, footprint, [], 0.0)


@pytest.mark.parametrize("roof", ["flat", "shed", "gable", "hip", "pyramid"])
def test_model_is_sound(roof: str) -> None:
    model = model_of(roof_points(roof, 6.0, 0.03, 1))
    assert isinstance(model, BuildingModel), model
    assert all(find_defect(solid) == "" for solid in model.solids["2.2"])
    faces = {"flat": 1, "shed": 1, "gable": 2, "hip": 4, "pyramid": 4}[roof]
    assert len(model.planes) == faces
    assert model.attributes["house_type"] == roof


def test_dormer_becomes_a_part() -> None:
    points = roof_points("gable", 8.0, 0.03, 2)
    local = points[:, :2] - (100.0, 50.0)
    u, v = local @ (np.cos(0.4), np.sin(0.4)), local @ (-np.sin(0.4), np.cos(0.4))
    dormer = (abs(u - 2) < 1.2) & (v > 1.0) & (v < 3.0)
    points[dormer, 2] = EAVES + 2.4
    model = model_of(points)
    assert isinstance(model, BuildingModel), model
    assert model.attributes["house_parts"] == 1
    assert len(model.planes) == 3
    assert model.attributes["rmse_m"] < 0.12


def test_ground_plan_is_taken_as_it_is() -> None:
    points = roof_points("gable", 3.0, 0.03, 4)
    plan = shapely.affinity.translate(
        shapely.affinity.rotate(shapely.box(-6.1, -4.1, 6.1, 4.1), np.degrees(0.4), origin=(0, 0)), 100, 50
    )
    model = Moments(ground_plan=True).model(points, Footprint(plan), [], 0.0)
    assert isinstance(model, BuildingModel)
    assert np.isclose(model.attributes["house_length_m"], 12.2, atol=1e-6)
    assert np.isclose(model.attributes["house_width_m"], 8.2, atol=1e-6)
    unknown = ("length_sd_m", "width_sd_m", "orientation_sd_deg")
    assert [model.attributes[f"house_{name}"] for name in unknown] == [None, None, None]
    assert model.attributes["house_ridge_sd_m"] > 0.0


@pytest.mark.parametrize("roof", ["flat", "shed", "gable", "hip", "pyramid"])
def test_the_closed_solution_alone_makes_a_house_without_deviations(roof: str) -> None:
    model = model_of(roof_points(roof, 8.0, 0.03, 4), closed_only=True)
    assert isinstance(model, BuildingModel), model
    facts = model.attributes
    assert facts["house_type"] == roof
    for name in ("length", "width", "eaves", "ridge"):
        assert facts[f"house_{name}_m"] == pytest.approx(facts[f"house_{name}_closed_m"], abs=0.02)
        assert facts[f"house_{name}_sd_m"] is None
    assert facts["rmse_m"] < 0.25


def test_the_closed_solution_takes_a_plan_as_it_is() -> None:
    points = roof_points("gable", 8.0, 0.03, 4)
    plan = shapely.affinity.translate(
        shapely.affinity.rotate(shapely.box(-6.1, -4.1, 6.1, 4.1), np.degrees(0.4), origin=(0, 0)), 100, 50
    )
    house = fit_building(points, plan, closed_only=True)
    assert isinstance(house, ParametricBuilding)
    assert np.allclose((house.length, house.width, house.orientation), (12.2, 8.2, 0.4))
    assert np.allclose((house.eaves, house.ridge), (EAVES - 0.075, EAVES + RISE), atol=0.05)
    free = fit_building(points, closed_only=True)
    assert isinstance(free, ParametricBuilding) and not np.isclose(free.length, house.length, atol=1e-6)


@pytest.mark.parametrize("across", [False, True])
def test_a_dormer_does_not_turn_the_closed_solution_or_lift_its_eaves(across: bool) -> None:
    points = roof_points("gable", 8.0, 0.03, 2)
    local = points[:, :2] - (100.0, 50.0)
    u, v = local @ (np.cos(0.4), np.sin(0.4)), local @ (-np.sin(0.4), np.cos(0.4))
    wide = 1.2 if across else 2.5
    points[(abs(u) < wide) & (v > 1.0) & (v < 3.6), 2] = EAVES + 2.9
    closed = fit_building(points, closed_only=True)
    assert isinstance(closed, ParametricBuilding) and closed.roof == "gable"
    assert abs(np.angle(np.exp(2j * (closed.orientation - 0.4)))) / 2 < np.radians(2.0)
    assert abs(closed.eaves - EAVES) < 0.15 and abs(closed.ridge - EAVES - RISE) < 0.15


def test_a_long_flat_roof_lies_along_its_plan_in_closed_form() -> None:
    points = roof_points("flat", 5.0, 0.05, 7)
    closed = fit_building(points, closed_only=True)
    assert isinstance(closed, ParametricBuilding) and closed.roof == "flat"
    assert abs(np.angle(np.exp(2j * (closed.orientation - 0.4)))) / 2 < np.radians(2.0)


def test_an_l_shape_is_not_a_house() -> None:
    rng = np.random.default_rng(5)
    xy = rng.uniform(0, 14, (1200, 2))
    xy = xy[(xy[:, 0] < 7) | (xy[:, 1] < 7)]
    answer = model_of(np.c_[xy, 5 + rng.normal(0, 0.03, len(xy))])
    assert isinstance(answer, Failure)
    assert answer.code == "not_a_house"


def test_a_tree_is_not_a_house() -> None:
    rng = np.random.default_rng(6)
    xy = rng.uniform(0, 8, (400, 2))
    answer = model_of(np.c_[xy, rng.uniform(4, 9, 400)])
    assert isinstance(answer, Failure)


def test_order_of_points_does_not_matter() -> None:
    points = roof_points("hip", 6.0, 0.03, 8)
    shuffled = points[np.random.default_rng(9).permutation(len(points))]
    first, second = model_of(points), model_of(shuffled)
    assert isinstance(first, BuildingModel)
    assert isinstance(second, BuildingModel)
    assert np.array_equal(first.solids["2.2"][0].vertices, second.solids["2.2"][0].vertices)


def test_an_uneven_half_hip_is_named_and_sound() -> None:
    rng = np.random.default_rng(10)
    u, v = rng.uniform(-7, 7, 1000), rng.uniform(-4, 4, 1000)
    z = 5 + np.minimum(3 - 0.75 * abs(v), 1.5 + 1.0 * (7 - abs(u))) + rng.normal(0, 0.03, 1000)
    model = model_of(np.c_[u, v, z])
    assert isinstance(model, BuildingModel), model
    assert model.attributes["house_type"] == "half_hip"
    assert len(model.planes) == 4
    assert all(find_defect(solid) == "" for solid in model.solids["2.2"])


def test_a_roof_reaches_on_under_a_wide_dormer() -> None:
    rng = np.random.default_rng(5)
    xy = rng.uniform([-3, -5], [3, 5], (600, 2))
    points = np.c_[xy, 5.0 - 0.7 * abs(xy[:, 1]) + rng.normal(0, 0.02, 600)]
    points[(abs(xy[:, 0]) < 2.8) & (xy[:, 1] > 1.5) & (xy[:, 1] < 4.5), 2] = 4.2
    house = fit_building(points)
    assert isinstance(house, ParametricBuilding)
    assert abs(house.width - 10.0) < 0.25


@pytest.mark.parametrize("name", list(SCANS)[:4])
def test_sums_over_points_beat_triangles_on_scan_lines__not_at_random(name: str) -> None:
    off: dict[bool, list[float]] = {True: [], False: []}
    for number in range(20):
        for sums, found in off.items():
            rng = np.random.default_rng([29, number])
            truth = Truth("gable", 12.0, 8.0, 0.7, rng.uniform(0.0, np.pi))
            house = fit_building(uneven_scan(truth, name, rng), closed_only=True, sums=sums)
            assert isinstance(house, ParametricBuilding)
            found.append(house.closed.length - 12.0)
    of_sums, of_triangles = (float(np.sqrt(np.mean(np.square(off[sums])))) for sums in (True, False))
    assert (of_sums < of_triangles) == ("lines" in name)


def test_sums_are_on_as_published_and_off_by_default() -> None:
    assert (Moments().sums, Moments.as_published().sums) == (False, True)
    chain = make_recipe(source="maas_vosselman", published=True).reconstruct
    assert chain.model_dump()["houses"]["sums"]
