"""Corners that crowns hide: filled where crowns lie over them and nothing else is seen, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from eaves.outline import regularise_outlines, trace_outline
from eaves.outline.toolkit.hidden import HiddenCornerRules, fill_hidden

LIMITS = HiddenCornerRules()
NONE = np.zeros((0, 2))
WHOLE = np.array([[0.0, 0.0], [12.0, 0.0], [12.0, 8.0], [0.0, 8.0]])
CUT = np.array([[0.0, 0.0], [12.0, 0.0], [12.0, 5.0], [10.0, 5.4], [9.0, 8.0], [0.0, 8.0]])
DENT = np.array([[0.0, 0.0], [12.0, 0.0], [12.0, 8.0], [8.0, 8.0], [7.0, 6.0], [5.0, 8.0], [0.0, 8.0]])


def grid(west: float, south: float, east: float, north: float) -> NDArray[np.float64]:
    x, y = np.meshgrid(np.arange(west, east, 0.4), np.arange(south, north, 0.4))
    return np.column_stack([x.ravel(), y.ravel()]) + 0.1


@pytest.mark.parametrize("ring", [CUT, DENT])
def test_corner_and_dent_under_a_crown_are_filled(ring: NDArray[np.float64]) -> None:
    found = fill_hidden(ring, grid(4.0, 4.0, 14.0, 10.0), NONE, 0.5, LIMITS)
    assert shapely.Polygon(found).symmetric_difference(shapely.Polygon(WHOLE)).area < 0.01
    assert len(found) <= 6


@pytest.mark.parametrize("ring", [CUT, DENT])
def test_where_ground_is_seen_nothing_is_filled(ring: NDArray[np.float64]) -> None:
    around = grid(4.0, 4.0, 14.0, 10.0)
    assert fill_hidden(ring, around, around[::2], 0.5, LIMITS) is ring


def test_without_a_crown_nothing_is_filled() -> None:
    assert fill_hidden(CUT, NONE, NONE, 0.5, LIMITS) is CUT
    assert fill_hidden(CUT, grid(-6.0, -6.0, -1.0, -1.0), NONE, 0.5, LIMITS) is CUT


def test_jog_seen_beside_a_crown_stays__ground_in_the_corner() -> None:
    ell = np.array([[0.0, 0.0], [12.0, 0.0], [12.0, 4.0], [8.0, 4.0], [8.0, 8.0], [0.0, 8.0]])
    found = fill_hidden(ell, grid(10.0, 4.0, 14.0, 8.0), grid(8.0, 4.0, 10.0, 8.0), 0.5, LIMITS)
    assert found is ell


def test_roof_under_a_crown_is_drawn_whole() -> None:
    points = grid(0.0, 0.0, 12.0, 8.0)
    hidden = np.hypot(*(points - [12.0, 8.0]).T) < 3.5
    roof = np.column_stack([points[~hidden], np.full((~hidden).sum(), 5.0)])
    truth = shapely.Polygon(WHOLE)
    areas = []
    for crowns in (None, points[hidden]):
        boundary = trace_outline(roof, 0.4, crowns=crowns, elsewhere=NONE)
        areas.append(regularise_outlines([boundary])[0].polygon.symmetric_difference(truth).area)
    assert areas[0] > 4.0
    assert areas[1] < 0.6 * areas[0]
