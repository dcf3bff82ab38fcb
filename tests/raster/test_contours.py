"""Contour lines of a raster: closed around a cone, open on a ramp."""

from __future__ import annotations

import numpy as np
import pytest

from eaves.model import Raster
from eaves.raster.contours import trace_contours


def raster(height: np.ndarray, cell: float = 0.5) -> Raster:
    return Raster(height.astype(np.float32), 10.0, 10.0 + len(height) * cell, cell)


def test_contour_of_a_cone_is_a_closed_circle() -> None:
    x, y = np.meshgrid(np.arange(81) - 40.0, np.arange(81) - 40.0)
    (ring,) = trace_contours(raster(30.0 - np.hypot(x, y)), np.array([10.0]))
    assert ring.closed
    assert ring.end_distance == 0.0
    assert ring.length == pytest.approx(2 * np.pi * 10.0, rel=0.01)
    centre = np.array([10.0 + 40.5 * 0.5, 10.0 + 40.5 * 0.5])
    assert np.hypot(*(ring.xy - centre).T) == pytest.approx(np.full(len(ring.xy), 10.0), abs=0.02)


def test_contour_of_a_ramp_runs_from_rim_to_rim() -> None:
    ramp = np.repeat(np.arange(40.0)[None, :], 30, axis=0)
    (line,) = trace_contours(raster(ramp), np.array([12.5]))
    assert not line.closed
    assert line.end_distance == pytest.approx(line.length) == pytest.approx(29 * 0.5)


def test_a_saddle_gives_two_lines() -> None:
    lines = trace_contours(raster(np.array([[1.0, 0.0], [0.0, 1.0]])), np.array([0.6]))
    assert [line.closed for line in lines] == [False, False]


def test_empty_cells_cut_a_line() -> None:
    ramp = np.repeat(np.arange(40.0)[None, :], 30, axis=0)
    ramp[15, 12] = np.nan
    assert len(trace_contours(raster(ramp), np.array([12.5]))) == 2


def test_a_level_nothing_crosses_gives_nothing() -> None:
    assert trace_contours(raster(np.zeros((5, 5))), np.array([1.0, -1.0])) == []
