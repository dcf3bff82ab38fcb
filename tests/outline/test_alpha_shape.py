"""The alpha shape encloses exact shapes, keeps courtyards and survives hard points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from eaves.buildings.owned import divide_parts
from eaves.model import Block, Boundary, Failure, Footprint, Raster
from eaves.model.results import BuildingPoints
from eaves.outline import regularise_outlines, trace_outline
from eaves.outline.alpha_shape import AlphaShape


def sampled(density: float, seed: int = 0, courtyard: bool = False) -> NDArray[np.float64]:
    """Random points on a 20 m × 30 m rectangle, with a hole of 8 m × 10 m on request."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform([0, 0], [20, 30], (int(600 * density), 2))
    if courtyard:
        inside = (xy[:, 0] > 6) & (xy[:, 0] < 14) & (xy[:, 1] > 10) & (xy[:, 1] < 20)
        xy = xy[~inside]
    return np.column_stack([xy, np.full(len(xy), 5.0)])


def outlined(points: NDArray[np.float64], spacing: float, method: AlphaShape) -> Footprint | Failure:
    boundary = trace_outline(points, spacing, method)
    assert isinstance(boundary, Boundary)
    return regularise_outlines([boundary], method)[0]


def test_published_alpha_is_2_4_m_and_the_derived_one_meets_it_at_4_points_per_m2() -> None:
    points = sampled(4.0)
    ours = trace_outline(points, 0.5, AlphaShape())
    published = trace_outline(points, 0.5, AlphaShape.as_published())
    assert AlphaShape.as_published().alpha == 2.4
    assert isinstance(ours, Boundary) and isinstance(published, Boundary)
    assert np.array_equal(ours.rings[0], published.rings[0])


@pytest.mark.parametrize("density", [1.0, 4.0, 16.0])
def test_rectangle_is_enclosed_to_within_a_spacing(density: float) -> None:
    spacing = density**-0.5
    footprint = outlined(sampled(density), spacing, AlphaShape())
    assert isinstance(footprint, Footprint)
    assert footprint.polygon.is_valid and footprint.polygon.exterior.is_ccw
    assert (20 - 2 * spacing) * (30 - 2 * spacing) < footprint.polygon.area <= 600
    assert len(footprint.polygon.exterior.coords) < 25


def test_courtyard_over_50_m2_is_kept_and_below_is_dropped() -> None:
    points = sampled(6.0, courtyard=True)
    kept = outlined(points, 6.0**-0.5, AlphaShape())
    dropped = outlined(points, 6.0**-0.5, AlphaShape(min_hole=100.0))
    assert isinstance(kept, Footprint) and isinstance(dropped, Footprint)
    assert len(kept.polygon.interiors) == 1 and len(dropped.polygon.interiors) == 0
    assert kept.polygon.interiors[0].is_ccw is False


def test_a_gap_wider_than_alpha_is_bridged_where_points_would_be_lost() -> None:
    points = sampled(4.0)
    split = points[(points[:, 1] < 12) | (points[:, 1] > 15)]
    footprint = outlined(split, 0.5, AlphaShape(alpha=1.2))
    assert isinstance(footprint, Footprint)
    assert footprint.polygon.area > 520


def test_each_part_of_a_region_is_a_building_as_published_and_none_is_lost() -> None:
    near = sampled(4.0)
    far, strays = near + [32.0, 0.0, 0.0], np.array([[26.0, 5.0, 3.0], [26.2, 5.0, 3.0], [26.0, 5.2, 3.0]])
    points = np.concatenate([near, far, strays])
    every = np.zeros(len(points))
    block, terrain = Block(0, 0), Raster(np.zeros((80, 120), np.float32), 0.0, 40.0, 0.5)
    whole = BuildingPoints(block, points, np.arange(len(points)), every.astype(np.uint8), terrain, 0.5, 1.0)
    parts = divide_parts(whole, AlphaShape.as_published())
    assert sorted(np.concatenate([part.point_id for part in parts])) == list(range(len(points)))
    drawn = [outlined(part.xyz, 0.5, AlphaShape.as_published()) for part in parts]
    assert len(drawn) == 2
    for footprint in drawn:
        assert isinstance(footprint, Footprint) and footprint.polygon.area > 500
    one = replace(whole, given=Footprint(drawn[0].polygon))  # type: ignore[union-attr]
    assert divide_parts(one, AlphaShape.as_published()) == [one]


@pytest.mark.parametrize(
    "points",
    [
        np.zeros((0, 3)),
        np.zeros((1, 3)),
        np.zeros((9, 3)),
        np.c_[np.arange(9.0), np.arange(9.0), np.zeros(9)],
        np.full((9, 3), np.nan),
    ],
    ids=["none", "one", "equal", "collinear", "nan"],
)
def test_hard_points_give_a_reason(points: NDArray[np.float64]) -> None:
    answer = trace_outline(points, 0.5, AlphaShape())
    assert isinstance(answer, Failure) and answer.stage == "outline"
