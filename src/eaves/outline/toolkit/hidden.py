"""Corners hidden under crowns: edges beside them go on to where they meet, unless something else is seen."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from eaves.geometry.rings import signed_area
from eaves.methods import Method, parameter

CELL = 0.5
"""Points are counted by cells at least this wide (m): what is seen of the ground is known by cells."""


class HiddenCornerRules(Method):
    """When a part of a roof is hidden."""

    hidden_cover: float = parameter(
        0.5,
        "crowns lie over at least this share of the area that edges beside a hidden corner add",
        ge=0,
        le=1,
    )
    hidden_seen: float = parameter(
        0.25, "in which ground or another building is seen in at most this share", ge=0, le=1
    )
    hidden_turn: float = parameter(
        10.0, "these edges meet at right angles or go on straight but for this", unit="°", ge=0.0, lt=45.0
    )
    hidden_edges: int = parameter(4, "most edges between them, that crowns made ragged", ge=1)
    hidden_length: float = parameter(
        2.0, "an edge grows by at most this many times its length into what is hidden", ge=0
    )


def fill_hidden(
    ring: NDArray[np.float64],
    crowns: NDArray[np.float64],
    elsewhere: NDArray[np.float64],
    spacing: float,
    limits: HiddenCornerRules,
) -> NDArray[np.float64]:
    """The ring (C, 2), counter-clockwise, with what crowns hide of it.

    Two edges with a few between them go on to where they meet at a right angle, or become one where they are
    in line, if points of `crowns` (K, 2) lie over the area that this adds and hardly any of `elsewhere`
    (G, 2), which are the ground's or another building's. Corners only go.
    """
    side = max(spacing, CELL)
    crowns, elsewhere = hidden_cells(crowns, side), hidden_cells(elsewhere, side)
    if not len(crowns):
        return ring
    while len(ring) > 4:
        for fuller, added in fuller_rings(ring, spacing, limits):
            cells = added.area / side**2
            over, other = (
                np.count_nonzero(shapely.contains_xy(added, *places.T)) for places in (crowns, elsewhere)
            )
            if over >= max(limits.hidden_cover * cells, 1.0) and other <= limits.hidden_seen * cells:
                ring = fuller
                break
        else:
            break
    return ring


def hidden_cells(places: NDArray[np.float64], side: float) -> NDArray[np.float64]:
    """The centres (C, 2) of the cells that hold some of the places (K, 2)."""
    return np.asarray((np.unique(np.floor(places / side), axis=0) + 0.5) * side)


def fuller_rings(
    ring: NDArray[np.float64], spacing: float, limits: HiddenCornerRules
) -> Iterator[tuple[NDArray[np.float64], Polygon]]:
    """Rings with fewer corners and more area, with the area added; first those that lose most corners."""
    count = len(ring)
    travel = np.roll(ring, -1, axis=0) - ring
    length = np.hypot(*travel.T)
    way = travel / np.maximum(length, 1e-9)[:, None]
    turn = float(np.radians(limits.hidden_turn))
    for between in range(min(limits.hidden_edges, count - 4), 0, -1):
        for one in range(count):
            other = (one + between + 1) % count
            if min(length[one], length[other]) < 2.0 * spacing:
                continue
            lost = np.arange(one + 1, one + between + 2) % count
            rest = np.arange(other + 1, other + count - between) % count
            cross = float(way[one, 0] * way[other, 1] - way[one, 1] * way[other, 0])
            gap = ring[other] - ring[lost[0]]
            aside = gap[0] * way[one, 1] - gap[1] * way[one, 0]
            grown = limits.hidden_length * length
            corner = np.zeros((0, 2))
            if cross > np.cos(turn):
                ahead = (gap[0] * way[other, 1] - gap[1] * way[other, 0]) / cross
                if not (0.0 <= ahead <= grown[one] and -grown[other] <= aside / cross <= 0.0):
                    continue
                corner = (ring[lost[0]] + ahead * way[one])[None]
            elif abs(cross) < np.sin(turn) and way[one] @ way[other] > 0.0:
                if abs(aside) > 0.5 * spacing or not 0.0 < gap @ way[one] <= grown[one] + grown[other]:
                    continue
            else:
                continue
            fuller = np.concatenate([corner, ring[rest]])
            if signed_area(fuller) <= signed_area(ring) or not Polygon(fuller).is_valid:
                continue
            yield fuller, Polygon(fuller).difference(Polygon(ring))
