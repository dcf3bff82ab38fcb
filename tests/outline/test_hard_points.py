"""Whatever the points, every outliner answers a valid polygon on the millimetre grid, or a reason."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from eaves.methods import methods_of, resolve_method
from eaves.model import Failure
from eaves.outline import OutlineMethod, regularise_outlines, trace_outline


def hard_points(kind: str, rng: np.random.Generator) -> NDArray[np.float64]:
    count = int(rng.integers(4, 150))
    if kind == "uniform":
        xy = rng.uniform(0, rng.uniform(0.5, 30), (count, 2))
    elif kind == "rounded":
        xy = np.round(rng.uniform(0, 10, (count, 2)))
    elif kind == "thin":
        xy = np.column_stack(
            [rng.uniform(0, 30, count), rng.normal(0, rng.choice([1e-9, 1e-4, 0.01]), count)]
        )
    elif kind == "clusters":
        xy = np.concatenate([rng.normal(centre, 0.8, (12, 2)) for centre in rng.uniform(0, 25, (4, 2))])
    elif kind == "ring":
        turn = rng.uniform(0, 2 * np.pi, count)
        xy = np.column_stack([np.cos(turn), np.sin(turn)]) * rng.uniform(1, 20)
    else:
        xy = rng.standard_cauchy((count, 2))
    return np.column_stack([xy, rng.uniform(0, 9, len(xy))])


@pytest.mark.parametrize("name", sorted(methods_of("outline")))
@pytest.mark.parametrize("kind", ["uniform", "rounded", "thin", "clusters", "ring", "outliers"])
def test_result_is_a_valid_polygon_or_a_failure(name: str, kind: str) -> None:
    method = resolve_method("outline", name)
    assert isinstance(method, OutlineMethod)
    rng = np.random.default_rng(7)
    for spacing in (0.1, 0.3, 0.5, 1.0, 2.0) * 3:
        points = hard_points(kind, rng)
        given = points.copy()
        boundary = trace_outline(points, spacing, method)
        assert np.array_equal(points, given)
        if isinstance(boundary, Failure):
            continue
        footprint = regularise_outlines([boundary], method)[0]
        if isinstance(footprint, Failure):
            continue
        polygon = footprint.polygon
        assert polygon.is_valid and polygon.exterior.is_ccw and polygon.area > 0.0
        whole = shapely.get_coordinates(polygon) * 1000.0
        assert np.abs(whole - np.round(whole)).max() < 1e-3
