"""What holds for points in any window, its sides round and with points on all of them: every point has a
cell, every stage answers, no run loses a block."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from benchmarks.scale.windows import KINDS, MULTIPLES, STEPS, Cloud, on_the_sides, write_points
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

import eaves
from eaves.detect import detect_buildings
from eaves.detect.consensus import Consensus
from eaves.detect.consensus.classifier import measured_terms
from eaves.ground import classify_ground
from eaves.methods import methods_of, resolve_method
from eaves.model import Bounds, PointCloud, Raster
from eaves.model.cloud import GRID_STEP
from eaves.raster.grid import grid_shape, whole_cells
from eaves.raster.surfaces import CELL, scene_of

law = settings(derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow])
quanta = st.integers(-10_000_000, 10_000_000)


def drawn_window(seed: int, kind: str, multiple: int, step: float) -> Cloud:
    """A house of 9 × 12 m beside a tree, in a window with a corner on multiples (m), points on all of its
    sides, and all rounded to a step (m)."""
    rng = np.random.default_rng(seed)
    columns, rows = rng.integers(20, 45, 2)
    west, south = multiple * rng.integers(-3, 3, 2) - [columns, rows] * rng.integers(0, 2, 2)
    xy = rng.uniform([0.0, 0.0], [columns, rows], (900, 2))
    house = (np.abs(xy - [columns / 2, rows / 2]) < [6.0, 4.5]).all(axis=1)
    tree = np.hypot(*(xy - [3.0, 3.0]).T) < 2.5
    z = 0.02 * xy[:, 0] + 5.0 * house + tree * rng.uniform(1.0, 6.0, len(xy)) + rng.normal(0.0, 0.02, len(xy))
    fields = np.column_stack([np.ones(len(xy)), 1 + (tree & (z > 3.0)), np.ones(len(xy))]).astype(np.uint8)
    bounds = Bounds(float(west), float(south), float(west + columns), float(south + rows))
    cloud = on_the_sides(Cloud(np.c_[xy + [west, south], z], fields), bounds)
    made = KINDS[kind](cloud, rng)
    return Cloud(np.round(made.xyz / step) * step, made.fields)


windows = st.builds(
    drawn_window,
    st.integers(0, 1000),
    st.sampled_from(sorted(KINDS)),
    st.sampled_from(MULTIPLES),
    st.sampled_from(STEPS),
).filter(lambda window: len(window.xyz) > 0)


def points_of(window: Cloud) -> PointCloud:
    """The window as it is read, without classes."""
    returns, of, _ = window.fields.T
    return PointCloud.from_world(window.xyz, return_number=returns, number_of_returns=of)


@law
@given(
    st.lists(st.tuples(quanta, quanta), min_size=1, max_size=20),
    st.integers(1, 40_000).map(lambda k: k / 997) | st.sampled_from([0.1, 0.35, 0.5, 0.7, 1.4, 40.0]),
    st.booleans(),
)
def test_every_point_has_a_cell__and_no_side_is_a_cell_too_far(
    places: list[tuple[int, int]], cell: float, on_sides: bool
) -> None:
    xy = np.array(places) * GRID_STEP
    xy = np.round(np.round(xy / cell) * cell, 4) if on_sides else xy
    bounds = whole_cells(Bounds.of(xy), cell)
    row, column = Raster(np.zeros((0, 0), np.float32), bounds.west, bounds.north, cell).cell_of(xy)
    assert (row.min(), column.min()) == (0, 0)
    assert (row.max() + 1, column.max() + 1) == grid_shape(bounds, cell)


@pytest.mark.parametrize("name", methods_of("ground"))
@settings(law, max_examples=10)
@given(window=windows)
def test_every_filter_says_of_every_point_whether_it_is_ground(name: str, window: Cloud) -> None:
    cloud = points_of(window)
    assert len(classify_ground(cloud, resolve_method("ground", name)).ground) == len(cloud)


@pytest.mark.parametrize("name", sorted(set(methods_of("detect")) - {"given_classes"}))
@settings(law, max_examples=8)
@given(window=windows)
def test_every_detector_answers(name: str, window: Cloud) -> None:
    cloud = classify_ground(points_of(window))
    scene = scene_of(cloud, whole_cells(cloud.bounds, CELL))
    assert len(detect_buildings(scene, resolve_method("detect", name)).label) == len(cloud)


@settings(law, max_examples=20)
@given(windows, st.integers(0, 3))
def test_evidence_is_finite__of_however_few_that_could_be_roofs(window: Cloud, fewer: int) -> None:
    cloud = classify_ground(points_of(window))
    scene, method = scene_of(cloud, whole_cells(cloud.bounds, CELL)), Consensus()
    some = np.flatnonzero(method.candidates(scene))[:fewer]
    candidate = np.isin(np.arange(len(cloud)), some)
    xyz, evidence, segments = method.find_surfaces(scene, candidate)
    most, judged = method.tolerance(scene.spacing), evidence.candidate
    terms = measured_terms(evidence, segments, judged, most, method.judged_by, method)
    assert np.isfinite(xyz).all()
    assert int(evidence.candidate.sum()) <= fewer
    assert segments.count == 0
    assert np.isfinite(terms.cell).all()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning:eaves.units")  # a cell on a wall: 0 / 0
@settings(law, max_examples=4, phases=[Phase.generate])
@given(windows, st.sampled_from(STEPS))
def test_a_run_loses_no_block(window: Cloud, step: float) -> None:
    with tempfile.TemporaryDirectory() as folder:
        points = Path(folder, "window.laz")
        write_points(window, points, step)
        summary = eaves.build(points, Path(folder, "out"), crs="metres", outputs=("footprints",))
        assert summary.failed == ()


@pytest.mark.parametrize("multiple", MULTIPLES)
def test_a_house_is_found__whatever_its_window_is_a_multiple_of(multiple: int) -> None:
    cloud = classify_ground(points_of(drawn_window(7, "plain", multiple, 0.01)))
    found = detect_buildings(scene_of(cloud, whole_cells(cloud.bounds, CELL)))
    assert found.count == 1
