"""Gross outliers: points far below or above everything near them (multipath, birds, clouds)."""

from __future__ import annotations

import numpy as np

from eaves.model import Mask, PointCloud


def find_outliers(cloud: PointCloud) -> tuple[Mask, Mask]:
    """Masks (N,) of low and of high outliers."""
    return np.zeros(len(cloud), bool), np.zeros(len(cloud), bool)
