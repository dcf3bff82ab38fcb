"""Corners hidden under crowns: edges beside them go on to where they meet, unless something else is seen."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from eaves.geometry.rings import signed_area

CELL = 0.5
"""Points are counted by cells at least this wide (m): what is seen of the ground is known by cells."""


@dataclass(frozen=True)
class Hiding:
    """When a part of a roof is hidden."""

    covered: float
    """Crowns lie over at least this share of its cells."""
    seen: float
    """The ground, or another building, is seen in no more than this share of them."""
    turn: float
    """Edges meet there at right angles, or go on straight, but for this (radians)."""
    most: int
    """Most edges that may lie between the two."""
    longer: float
    """An edge grows by no more than this many times its length."""


def fill_hidden(
    ring: NDArray[np.float64],
    crowns: NDArray[np.float64],
    elsewhere: NDArray[np.float64],
    spacing: float,
    limits: Hiding,
) -> NDArray[np.float64]:
    """The ring (C, 2), counter-clockwise, with what crowns hide of it.

    Two edges with a few between them go on to where they meet at a right angle, or become one where they are
    in line, if points of `crowns` (K, 2) lie over the area that this adds and hardly any of `elsewhere`
    (G, 2), which are the ground's or another building's. Corners only go.
    """
    side = max(spacing, CELL)
    crowns, elsewhere = cells_of(crowns, side), cells_of(elsewhere, side)
    if not len(crowns):
        return ring
    while len(ring) > 4:
        for fuller, added in fuller_rings(ring, spacing, limits):
            cells = added.area / side**2
            over, other = (
                np.count_nonzero(shapely.contains_xy(added, *places.T)) for places in (crowns, elsewhere)
            )
            if over >= max(limits.covered * cells, 1.0) and other <= limits.seen * cells:
                ring = fuller
                break
        else:
            break
    return ring


def cells_of(places: NDArray[np.float64], side: float) -> NDArray[np.float64]:
    """The centres (C, 2) of the cells that hold some of the places (K, 2)."""
    return np.asarray((np.unique(np.floor(places / side), axis=0) + 0.5) * side)


def fuller_rings(
    ring: NDArray[np.float64], spacing: float, limits: Hiding
) -> Iterator[tuple[NDArray[np.float64], Polygon]]:
    """Rings with fewer corners and more area, with the area added; first those that lose most corners."""
    count = len(ring)
    travel = np.roll(ring, -1, axis=0) - ring
    length = np.hypot(*travel.T)
    way = travel / np.maximum(length, 1e-9)[:, None]
    for between in range(min(limits.most, count - 4), 0, -1):
        for one in range(count):
            other = (one + between + 1) % count
            if min(length[one], length[other]) < 2.0 * spacing:
                continue
            lost = np.arange(one + 1, one + between + 2) % count
            rest = np.arange(other + 1, other + count - between) % count
            cross = float(way[one, 0] * way[other, 1] - way[one, 1] * way[other, 0])
            gap = ring[other] - ring[lost[0]]
            aside = gap[0] * way[one, 1] - gap[1] * way[one, 0]
            grown = limits.longer * length
            corner = np.zeros((0, 2))
            if cross > np.cos(limits.turn):
                ahead = (gap[0] * way[other, 1] - gap[1] * way[other, 0]) / cross
                if not (0.0 <= ahead <= grown[one] and -grown[other] <= aside / cross <= 0.0):
                    continue
                corner = (ring[lost[0]] + ahead * way[one])[None]
            elif abs(cross) < np.sin(limits.turn) and way[one] @ way[other] > 0.0:
                if abs(aside) > 0.5 * spacing or not 0.0 < gap @ way[one] <= grown[one] + grown[other]:
                    continue
            else:
                continue
            fuller = np.concatenate([corner, ring[rest]])
            if signed_area(fuller) <= signed_area(ring) or not Polygon(fuller).is_valid:
                continue
            yield fuller, Polygon(fuller).difference(Polygon(ring))
