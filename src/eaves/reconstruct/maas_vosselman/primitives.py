"""A ground plan cut into primitives: pieces that nearly fill their least rectangles."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import LineString, Polygon
from shapely.geometry.polygon import orient
from shapely.ops import split

from eaves.geometry.tolerance import COORDINATE_STEP
from eaves.solids.coverage import OVERSHOOT

JOG = 0.25
"""A corner that a line simplified by this (m) leaves out starts no cut."""
GAIN = 0.01
"""A cut must fill the rectangles better by this share of the area."""
MOST_PIECES = 12
"""A plan of more pieces is no set of standard houses."""


def cut_plan(plan: Polygon, least_fill: float, smallest: float) -> tuple[list[Polygon], NDArray[np.float64]]:
    """The primitives of a plan, and the cuts (S, 4) between them.

    While a piece fills less than `least_fill` of its least rectangle it is cut from a reflex corner along
    one of the corner's two sides, where both halves together fill their boxes best. Pieces under `smallest`
    (m²) are not cut off. The answer does not depend on where the ring starts."""
    open_: list[Polygon] = [plan]
    done: list[Polygon] = []
    cuts: list[tuple[float, float, float, float]] = []
    while open_:
        piece = open_.pop()
        room = len(open_) + len(done) + 2 <= MOST_PIECES
        best = best_cut(piece, smallest) if room and fill_of(piece) < least_fill else None
        if best is None:
            done.append(piece)
            continue
        cuts.append(best[0])
        open_ += best[1]
    order = np.lexsort(np.array([[piece.centroid.y, piece.centroid.x] for piece in done]).T)
    return [done[k] for k in order], np.array(cuts, np.float64).reshape(-1, 4)


def fill_of(piece: Polygon) -> float:
    """Share of its least rectangle that a piece fills."""
    return float(piece.area / max(shapely.minimum_rotated_rectangle(piece).area, 1e-9))


def best_cut(
    piece: Polygon, smallest: float
) -> tuple[tuple[float, float, float, float], list[Polygon]] | None:
    """The cut after which both halves fill their rectangles best, and the halves; None when none gains."""
    best, answer = fill_of(piece) + GAIN, None
    for line in cuts_of(piece):
        halves = [part for part in split(piece, line).geoms if part.geom_type == "Polygon"]
        if len(halves) != 2 or min(half.area for half in halves) < smallest:
            continue
        fill = sum(half.area * fill_of(half) for half in halves) / piece.area
        if fill > best + 1e-9:
            (x1, y1), (x2, y2) = line.coords
            best, answer = fill, ((x1, y1, x2, y2), halves)
    return answer


def cuts_of(piece: Polygon) -> list[LineString]:
    """From each reflex corner the lines along its two sides to the first border they meet."""
    ring = shapely.get_coordinates(orient(shapely.simplify(piece, JOG)).exterior)[:-1]
    corners = {tuple(place) for place in shapely.get_coordinates(piece.exterior)}
    before, after = ring - np.roll(ring, 1, 0), np.roll(ring, -1, 0) - ring
    reflex = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0] < -1e-6
    border, lines = piece.boundary, []
    far = float(np.hypot(*np.ptp(ring, axis=0)))
    for corner, one, two in zip(ring[reflex], before[reflex], -after[reflex], strict=True):
        if tuple(corner) not in corners:
            continue
        for way in (one, two):
            step = way / max(float(np.hypot(*way)), 1e-9)
            ray = LineString([corner + COORDINATE_STEP * step, corner + far * step])
            meets = shapely.get_coordinates(shapely.intersection(ray, border))
            near = np.abs((ring - corner) @ [-step[1], step[0]]) < OVERSHOOT
            near &= (ring - corner) @ step > OVERSHOOT
            meets = np.vstack([meets, ring[near]])
            if len(meets) and piece.contains(shapely.Point(corner + 2.0 * COORDINATE_STEP * step)):
                away = float(np.min((meets - corner) @ step))
                lines.append(
                    LineString([corner - COORDINATE_STEP * step, corner + (away + COORDINATE_STEP) * step])
                )
    return lines
