"""A footprint is the same wherever it is sent."""

from __future__ import annotations

import pickle

import numpy as np
import shapely
from shapely import Polygon

from eaves.model import Footprint


def test_a_footprint_overlays_the_same_in_another_process() -> None:
    rounded = shapely.set_precision(Polygon([(0, 0), (10, 0.3), (9, 7), (0, 6)]), 0.001)
    here = Footprint(rounded)
    there: Footprint = pickle.loads(pickle.dumps(here))
    tilted = Polygon([(-1, 2.1234567), (12, 3.7654321), (5, 9)])
    one, two = (shapely.get_coordinates(f.polygon.intersection(tilted)) for f in (here, there))
    assert np.array_equal(one, two)
    assert np.array_equal(shapely.get_coordinates(here.polygon), shapely.get_coordinates(rounded))
    assert not np.array_equal(one, shapely.get_coordinates(rounded.intersection(tilted)))  # the grid rounds
