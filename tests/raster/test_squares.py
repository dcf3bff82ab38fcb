"""Masks grown, shrunk, opened and closed by squares, beside scipy's."""

import numpy as np
import pytest
from scipy import ndimage

from eaves.raster import blur as groups


@pytest.mark.parametrize("size", [1, 2, 3, 4, 5, 9])
@pytest.mark.parametrize("shape", [(1, 1), (2, 7), (30, 41)])
def test_squares_are_those_of_scipy(size, shape):
    square = np.ones((size, size))
    for share in (0.02, 0.5, 0.95, 1.0):
        mask = np.random.default_rng(7).random(shape) < share
        for mine, theirs in (
            (groups.grown_by_square, ndimage.binary_dilation),
            (groups.shrunk_by_square, ndimage.binary_erosion),
            (groups.opened_by_square, ndimage.binary_opening),
            (groups.closed_by_square, ndimage.binary_closing),
        ):
            assert np.array_equal(mine(mask, size), theirs(mask, square)), mine.__name__
