"""From edges to a ring: corners by intersection, jogs between parallel edges, edges that vanish taken out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.outline.edges import Edges

PARALLEL = np.radians(3.0)
"""Turn (radians) under which two neighbouring lines meet nowhere in particular."""


def ends_of_edges(edges: Edges, reach: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where every edge starts and ends, (K, 2) each.

    A corner, the end of one edge and the start of the next, is where the lines meet. Where that is farther
    than `reach` (m) from the boundary point between the two edges, or the lines are parallel, each edge ends
    at the foot of that point: the two feet are a jog.
    """
    normal, offset = edges.normal, edges.offset
    before, other = np.roll(normal, 1, axis=0), np.roll(offset, 1)
    sine = before[:, 0] * normal[:, 1] - before[:, 1] * normal[:, 0]
    meets = np.abs(sine) > np.sin(PARALLEL)
    safe = np.where(meets, sine, 1.0)
    x = (other * normal[:, 1] - offset * before[:, 1]) / safe
    y = (before[:, 0] * offset - normal[:, 0] * other) / safe
    start = np.stack([x, y], axis=1)
    end = start.copy()
    far = ~meets | (((start - edges.corner) ** 2).sum(axis=1) > reach * reach)
    for k in np.flatnonzero(far):
        point = edges.corner[k]
        start[k] = point - normal[k] * (normal[k] @ point - offset[k])
        end[k] = point - before[k] * (before[k] @ point - other[k])
    return start, np.roll(end, -1, axis=0)


def joined_edges(edges: Edges, detail: float, reach: float) -> Edges:
    """The edges without those shorter than `detail` (m), and without jogs smaller than that.

    What is too short, or runs backwards between the corners with its neighbours, is dropped, the shortest
    first. Parallel neighbours less than `detail` apart become one edge through the points of both.
    """
    while len(edges) > 2:
        jog = smallest_jog(edges)
        if jog is not None and jog[1] < detail:
            edges = merged(edges, (jog[0] - 1) % len(edges), jog[0])
            continue
        start, end = ends_of_edges(edges, reach)
        length = ((end - start) * edges.direction).sum(axis=1)
        shortest = int(np.argmin(length))
        if length[shortest] >= detail:
            break
        edges = edges.take(np.delete(np.arange(len(edges)), shortest))
    return edges


def smallest_jog(edges: Edges) -> tuple[int, float] | None:
    """The edge whose line is parallel and nearest to that of the edge before, and their distance (m)."""
    change = np.abs(np.mod(edges.angle - np.roll(edges.angle, 1) + np.pi, 2 * np.pi) - np.pi)
    same = np.flatnonzero((change < PARALLEL) | (change > np.pi - PARALLEL))
    if len(same) == 0:
        return None
    points = edges.corner[same]
    here = (edges.normal[same] * points).sum(axis=1) - edges.offset[same]
    there = (edges.normal[same - 1] * points).sum(axis=1) - edges.offset[same - 1]
    gap = np.abs(here - np.where(change[same] < PARALLEL, there, -there))
    least = int(np.argmin(gap))
    return int(same[least]), float(gap[least])


def merged(edges: Edges, first: int, second: int) -> Edges:
    """The edges with two neighbours made one: the longer one's direction, through the points of both."""
    shorter, longer = sorted((first, second), key=lambda k: edges.moments[k, 0])
    pair = edges.moments[[longer, shorter]]
    weight, middle = pair[:, 0], pair[:, 1:3]
    mean = weight @ middle / weight.sum()
    dx, dy = (middle - mean).T
    between = weight @ np.stack([dx * dx, dx * dy, dy * dy], axis=1)
    moments, offset, corner = edges.moments.copy(), edges.offset.copy(), edges.corner.copy()
    moments[longer] = np.concatenate([[weight.sum()], mean, pair[:, 3:].sum(axis=0) + between])
    offset[longer] = float(mean @ edges.normal[longer])
    corner[longer] = edges.corner[first]
    changed = edges.with_(offset=offset, moments=moments, corner=corner)
    return changed.take(np.delete(np.arange(len(edges)), shorter))


def ring_of_edges(edges: Edges, reach: float) -> NDArray[np.float64]:
    """The corners (C, 2) of the ring that the edges make, C ≥ K: a jog has two."""
    start, end = ends_of_edges(edges, reach)
    corners = np.stack([start, end], axis=1).reshape(-1, 2)
    new = np.abs(corners - np.roll(corners, 1, axis=0)).max(axis=1) > 1e-9
    return np.asarray(corners[new])
