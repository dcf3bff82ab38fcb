"""Faces among the triangles: on an exact gable, with walls, and on input that is hardly a roof."""

from __future__ import annotations

import numpy as np
import pytest

from eaves.published.maas_vosselman.tin_faces import TinFaces, peak_of
from eaves.roof import segment_roof


def test_peak_is_the_mean_of_the_fullest_cells() -> None:
    rng = np.random.default_rng(0)
    places = np.r_[rng.uniform(-1, 1, (200, 2)), rng.normal((0.5, -0.2), 0.01, (300, 2))]
    assert np.allclose(peak_of(places, np.ones(500), 0.05), (0.5, -0.2), atol=0.02)


@pytest.mark.parametrize("density", [4, 10])
@pytest.mark.parametrize("noise", [0.0, 0.03])
def test_hip_has_four_faces(density: int, noise: float) -> None:
    rng = np.random.default_rng(1)
    xy = rng.uniform([-7, -4], [7, 4], (112 * density, 2))
    z = 3.0 - np.maximum(0.75 * abs(xy[:, 1]), 0.75 * (abs(xy[:, 0]) - 3.0))
    points = np.c_[xy, z + rng.normal(0, noise, len(xy))]
    planes = segment_roof(points, density**-0.5, TinFaces())
    assert len(planes) == 4
    assert np.allclose([plane.slope for plane in planes], np.arctan(0.75), atol=np.radians(2.0))
    assert sum(len(plane.members) for plane in planes) > 0.95 * len(points)
