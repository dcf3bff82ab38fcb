"""From edges to a ring: corners by intersection, jogs between parallel edges, edges that vanish taken out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eaves.geometry.rings import signed_area
from eaves.outline.toolkit.edges import OutlineEdges, main_direction
from eaves.outline.toolkit.polyline import FREE

PARALLEL = np.radians(3.0)
"""Turn (radians) under which two neighbouring lines meet nowhere in particular: a tolerance."""


@dataclass(frozen=True)
class Drawing:
    """The details that a draughtsman would not draw: lengths in metres, prices in nats."""

    detail: float
    """The shortest edge and the smallest jog."""
    reach: float
    """Largest distance of a corner from the boundary."""
    sigma: float
    """Scatter of a boundary point about its edge."""
    price: float
    """The cost of an edge."""


def ends_of_edges(edges: OutlineEdges, drawing: Drawing) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Start and end of every edge, (K, 2) each.

    A corner, the end of one edge and the start of the next, is where the lines meet. Where that is farther
    than `reach` from the boundary point between the two edges, or the lines are parallel, it is the middle
    of the feet of that point on both lines; if these are `detail` apart, each edge ends at its foot: a jog.
    """
    normal, offset = edges.normal, edges.offset
    number = np.arange(len(edges))
    before, other = normal[number - 1], offset[number - 1]
    sine = before[:, 0] * normal[:, 1] - before[:, 1] * normal[:, 0]
    meets = np.abs(sine) > np.sin(PARALLEL)
    safe = np.where(meets, sine, 1.0)
    x = (other * normal[:, 1] - offset * before[:, 1]) / safe
    y = (before[:, 0] * offset - normal[:, 0] * other) / safe
    start = np.stack([x, y], axis=1)
    end = start.copy()
    far = ~meets | (((start - edges.corner) ** 2).sum(axis=1) > drawing.reach**2)
    for k in np.flatnonzero(far):
        point = edges.corner[k]
        foot = point - normal[k] * (normal[k] @ point - offset[k])
        foot_before = point - before[k] * (before[k] @ point - other[k])
        if np.hypot(*(foot - foot_before)) < drawing.detail:
            foot = foot_before = 0.5 * (foot + foot_before)
        start[k], end[k] = foot, foot_before
    return start, end[(number + 1) % len(edges)]


def edge_lengths(edges: OutlineEdges, drawing: Drawing) -> NDArray[np.float64]:
    """Lengths (K,) of the edges between their corners, negative for one that runs backwards."""
    start, end = ends_of_edges(edges, drawing)
    return np.asarray(((end - start) * edges.direction).sum(axis=1))


def joined_edges(edges: OutlineEdges, drawing: Drawing) -> OutlineEdges:
    """The edges without those shorter than `detail`, without jogs smaller than that, and without idle bends.

    What is too short, or runs backwards between the corners with its neighbours, is dropped. Parallel
    neighbours less than `detail` apart become one edge through the points of both, unless their turn is
    real: one line through the points of both would cost more than the `price` of an edge.
    """
    while len(edges) > 2:
        pair = idle_corner(edges, drawing)
        if pair is not None:
            edges = merged(edges, (pair - 1) % len(edges), pair)
            continue
        spare = spare_edge(edges, drawing)
        if spare is None:
            break
        edges = without(edges, spare)
    return edges


def spare_edge(edges: OutlineEdges, drawing: Drawing) -> int | None:
    """The edge to take out next: too short, or running backwards, and of those the one that matters least.

    What matters is the area between the rings with it and without it. For a short edge it must be under
    `detail` squared; an edge that runs backwards goes in any case, or one of its neighbours does in its
    place.
    """
    length = edge_lengths(edges, drawing)
    area = signed_area(ring_of_edges(edges, drawing))
    best: tuple[float, int] | None = None
    for k in np.flatnonzero(length < drawing.detail):
        limit = drawing.detail**2 if length[k] > 0.0 else np.inf
        for spare in (k,) if length[k] > 0.0 else (k - 1, k, k + 1):
            one = int(spare % len(edges))
            change = abs(signed_area(ring_of_edges(without(edges, one), drawing)) - area)
            if change < limit and (best is None or change < best[0]):
                best = (change, one)
    return None if best is None else best[1]


def without(edges: OutlineEdges, one: int) -> OutlineEdges:
    """The edges without number `one`."""
    return edges.take(np.delete(np.arange(len(edges)), one))


def idle_corner(edges: OutlineEdges, drawing: Drawing) -> int | None:
    """The edge that should be one with the edge before it: parallel, hardly off, and the cheapest to join."""
    change = np.abs(np.mod(edges.angle - edges.angle[np.arange(len(edges)) - 1] + np.pi, 2 * np.pi) - np.pi)
    best: tuple[float, int] | None = None
    for k in np.flatnonzero((change < PARALLEL) | (change > np.pi - PARALLEL)):
        point = edges.corner[k]
        gap = edges.normal[k] @ point - edges.offset[k]
        other = edges.normal[k - 1] @ point - edges.offset[k - 1]
        if abs(gap - (other if change[k] < PARALLEL else -other)) >= drawing.detail:
            continue
        cost = (
            residual(joined_moments(edges.moments[[k - 1, k]])) - residual(edges.moments[[k - 1, k]]).sum()
        ) / (2.0 * drawing.sigma**2)
        same = edges.axis[k] != FREE and edges.axis[k] == edges.axis[k - 1]
        if (same or cost < drawing.price) and (best is None or cost < best[0]):
            best = (cost, int(k))
    return None if best is None else best[1]


def residual(moments: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sum of squared distances (…,) of points with these moments (…, 6) to the line that fits them best."""
    xx, xy, yy = moments[..., 3], moments[..., 4], moments[..., 5]
    return np.asarray(0.5 * (xx + yy - np.hypot(xx - yy, 2.0 * xy)))


def joined_moments(pair: NDArray[np.float64]) -> NDArray[np.float64]:
    """The moments (6,) of two sets of points with moments `pair` (2, 6)."""
    weight, middle = pair[:, 0], pair[:, 1:3]
    mean = weight @ middle / weight.sum()
    dx, dy = (middle - mean).T
    between = weight @ np.stack([dx * dx, dx * dy, dy * dy], axis=1)
    return np.concatenate([[weight.sum()], mean, pair[:, 3:].sum(axis=0) + between])


def merged(edges: OutlineEdges, first: int, second: int) -> OutlineEdges:
    """The edges with two neighbours made one, through the points of both and in the longer one's direction.

    Where the longer one runs freely, the direction is fitted again too.
    """
    shorter, longer = sorted((first, second), key=lambda k: edges.moments[k, 0])
    angle, offset = edges.angle.copy(), edges.offset.copy()
    moments, corner = edges.moments.copy(), edges.corner.copy()
    moments[longer] = joined_moments(edges.moments[[longer, shorter]])
    if edges.axis[longer] == FREE:
        fitted = float(main_direction(moments[longer]))
        angle[longer] = fitted if np.cos(fitted - angle[longer]) > 0 else fitted + np.pi
    normal = np.array([-np.sin(angle[longer]), np.cos(angle[longer])])
    offset[longer] = float(moments[longer, 1:3] @ normal)
    corner[longer] = edges.corner[first]
    changed = edges.with_(angle=angle, offset=offset, moments=moments, corner=corner)
    return without(changed, shorter)


def ring_of_edges(edges: OutlineEdges, drawing: Drawing) -> NDArray[np.float64]:
    """The corners (C, 2) of the ring that the edges make, C ≥ K: a jog has two."""
    start, end = ends_of_edges(edges, drawing)
    corners = np.stack([start, end], axis=1).reshape(-1, 2)
    new = np.abs(corners - corners[np.arange(len(corners)) - 1]).max(axis=1) > 1e-9
    return np.asarray(corners[new])
