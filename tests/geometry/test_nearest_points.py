"""The nearest points, held against a tree."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from eaves.geometry.neighbours import nearest


@pytest.mark.parametrize("count", [1, 8, 40])
@pytest.mark.parametrize("form", ["plane", "wall", "line", "far apart", "one place"])
def test_nearest_are_those_of_a_tree(form: str, count: int) -> None:
    rng = np.random.default_rng(3)
    points = rng.uniform(0.0, 20.0, (900, 3)) * {"plane": (1.0, 1.0, 0.1), "wall": (1.0, 0.0, 1.0)}.get(
        form, 1.0
    )
    if form == "line":
        points[:, 1:] = 0.0
    elif form == "far apart":
        points[::7] *= 1000.0
    elif form == "one place":
        points[:] = 1.0
    queries = np.vstack([points[:50], points[50:100] + 0.3, [[-30.0, 5.0, 0.0], [25.0, 1e4, 3.0]]])
    found, distances = nearest(queries, points, count)
    expected, _ = cKDTree(points).query(queries, [*range(1, count + 1)])
    np.testing.assert_allclose(distances, expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(points[found] - queries[:, None], axis=2), distances, atol=1e-9)
    assert all(len(set(row)) == count for row in found.tolist())


def test_fewer_points_than_asked_for_are_all_found() -> None:
    points = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [1.0, 0.0, 5.0]])
    found, distances = nearest(points[:1], points, 8)
    assert found.tolist() == [[0, 1, 2]] and distances[0, 1] == 3.0
