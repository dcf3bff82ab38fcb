"""Where a plan shows no point: how high planes may rise there, and the planes that complete a roof."""

from __future__ import annotations

import numpy as np
import shapely
from scipy.spatial import cKDTree
from shapely import Polygon

from eaves.model import Labels, Mask, Points, Values
from eaves.reconstruct.toolkit.ceiling import LEAST_RISE, reach_of
from eaves.reconstruct.toolkit.plan_lines import FLAT, Line


def unseen_places(polygon: Polygon, roof: Points, spacing: float) -> Values:
    """Places (K, 2) inside a plan, in a grid of half the reach, that no roof point (N, 3) shows."""
    side = 0.5 * reach_of(spacing)
    west, south, east, north = polygon.bounds
    x, y = np.meshgrid(np.arange(west + 0.5 * side, east, side), np.arange(south + 0.5 * side, north, side))
    places = np.column_stack([x.ravel(), y.ravel()])
    places = places[shapely.contains_xy(polygon, places)]
    away, _ = cKDTree(roof[:, :2]).query(places, distance_upper_bound=reach_of(spacing))
    return np.asarray(places[np.isinf(away)])


def mirrored_planes(unseen: Values, roof: Points, labels: Labels, planes: Values, highest: Values) -> Values:
    """The planes (M, 3) that fall from the top of a slope to its other side, where it would rise over the
    roof at `unseen` places (K, 2) nearest to it: a gable of which one side was seen has the other."""
    if not len(unseen):
        return np.zeros((0, 3))
    known = np.flatnonzero(labels >= 0)
    if not len(known):
        return np.zeros((0, 3))
    owner = labels[known[cKDTree(roof[known, :2]).query(unseen)[1]]]
    a, b, c = planes[owner].T
    is_open = a * unseen[:, 0] + b * unseen[:, 1] + c > highest[owner]
    mirrored = []
    for number in np.unique(owner[is_open & (np.hypot(a, b) > FLAT)]).tolist():
        points = roof[labels == number]
        top = float((points[:, :2] @ planes[number, :2]).max()) + planes[number, 2]
        plane = np.array([*(-planes[number, :2]), 2.0 * top - planes[number, 2]])
        places = unseen[is_open & (owner == number)]
        off = (planes[:-1] - plane) @ np.column_stack([places, np.ones(len(places))]).T
        if np.abs(off).max(axis=1).min() > LEAST_RISE:  # else the other side was seen in part
            mirrored.append(plane)
    return np.array(mirrored, np.float64).reshape(-1, 3)


def without_points(labels: Labels, planes: Values) -> Mask:
    """Mask (P,) of the planes that no point supports, but for the last, which stands for none."""
    empty: Mask = np.bincount(labels[labels >= 0], minlength=len(planes)) == 0
    empty[-1] = False
    return empty


def unseen_lines(unseen: Values, labels: Labels, planes: Values, spacing: float) -> list[Line]:
    """The lines along which planes without points meet others, as far as they run by `unseen` places."""
    lines = []
    for plane in np.flatnonzero(without_points(labels, planes)).tolist() if len(unseen) else ():
        for other in range(len(planes) - 1):
            a, b, c = planes[plane] - planes[other]
            steep = float(np.hypot(a, b))
            if other == plane or steep < FLAT:
                continue
            close = np.abs(unseen @ [a, b] + c) <= 2.0 * reach_of(spacing) * steep
            along = unseen[close] @ [-b / steep, a / steep]
            if len(along):
                low, high = float(along.min()), float(along.max())
                lines.append(Line(a / steep, b / steep, -c / steep, low, high, float(len(along))))
    return lines
