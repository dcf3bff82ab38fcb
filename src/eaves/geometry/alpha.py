"""Alpha shapes in the plane: the rings of the area that no empty disc of a given radius can enter."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay, QhullError

from eaves.geometry.rings import signed_area, split_loops

WIDEN = 1.5
"""Factor from one try to the next when the radius is too small to hold the points together."""
WIDEN_TRIES = 6


def alpha_rings(
    xy: NDArray[np.float64], radius: float, *, share: float = 0.0
) -> tuple[NDArray[np.int64], ...]:
    """Rings of indices into `xy` (N, 2): outer one counter-clockwise, then holes clockwise; () for no area.

    The area is the union of the Delaunay triangles whose circumscribed disc, which is empty, has at most
    `radius` (m), reduced to its largest part connected over edges [edelsbrunner1983]. The radius is
    widened, by steps of `WIDEN`, while that part holds less than `share` of the points.
    """
    if len(xy) < 3:
        return ()
    try:
        mesh = Delaunay(xy - np.floor(xy.min(axis=0)))
    except QhullError:  # all points on one line
        return ()
    triangles = mesh.simplices.astype(np.int64)
    neighbours = mesh.neighbors.astype(np.int64)
    radii = circumradius(xy, triangles)
    for _ in range(WIDEN_TRIES):
        kept = largest_part(xy, triangles, neighbours, radii <= radius)
        inside = np.zeros(len(xy), np.bool_)
        inside[triangles[kept]] = True
        if inside.sum() >= share * len(xy):
            break
        radius *= WIDEN
    if not kept.any():
        return ()
    starts, ring = boundary_kernel(triangles, neighbours, kept)
    loops = [loop for a, b in pairwise(starts.tolist()) for loop in split_loops(ring[a:b]) if len(loop) > 2]
    areas = np.array([signed_area(xy[loop]) for loop in loops])
    outer = int(np.argmax(areas))
    holes = [k for k in np.argsort(areas, kind="stable") if areas[k] < 0]
    return (loops[outer], *(loops[k] for k in holes))


def circumradius(xy: NDArray[np.float64], triangles: NDArray[np.int64]) -> NDArray[np.float64]:
    """Radii (T,) of the circles through the corners of `triangles` (T, 3); infinite when on one line."""
    a, b, c = xy[triangles[:, 0]], xy[triangles[:, 1]], xy[triangles[:, 2]]
    sides = np.hypot(*(b - a).T) * np.hypot(*(c - b).T) * np.hypot(*(a - c).T)
    twice = np.abs((b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0]))
    return np.where(twice > 1e-12, sides / np.maximum(2.0 * twice, 1e-12), np.inf)


def largest_part(
    xy: NDArray[np.float64],
    triangles: NDArray[np.int64],
    neighbours: NDArray[np.int64],
    kept: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """The kept triangles (T,) of the part with the largest area; parts hang together over common edges."""
    rows, sides = np.nonzero(kept[:, None] & (neighbours >= 0) & kept[neighbours])
    size = len(triangles)
    graph = coo_matrix((np.ones(len(rows), np.int8), (rows, neighbours[rows, sides])), shape=(size, size))
    _, part = connected_components(graph, directed=False)
    a, b, c = xy[triangles[:, 0]], xy[triangles[:, 1]], xy[triangles[:, 2]]
    twice = np.abs((b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0]))
    area = np.bincount(part, weights=np.where(kept, twice, 0.0))
    return np.asarray(kept & (part == int(np.argmax(area))))


@njit(cache=True)  # type: ignore[untyped-decorator]
def boundary_kernel(
    triangles: NDArray[np.int64], neighbours: NDArray[np.int64], kept: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Closed walks around the kept triangles, area on the left: start of each (R + 1,), vertices (M,).

    Side k of a triangle lies opposite its corner k and runs from corner k + 1 to corner k + 2.
    """
    count = 0
    for t in range(len(triangles)):
        if kept[t]:
            for k in range(3):
                n = neighbours[t, k]
                if n < 0 or not kept[n]:
                    count += 1
    ring = np.empty(count, np.int64)
    starts = np.empty(count + 1, np.int64)
    done = np.zeros((len(triangles), 3), np.bool_)
    filled, rings = 0, 0
    starts[0] = 0
    for first in range(len(triangles)):
        if not kept[first]:
            continue
        for side in range(3):
            n = neighbours[first, side]
            if done[first, side] or (n >= 0 and kept[n]):
                continue
            t, k = first, side
            while not done[t, k]:
                done[t, k] = True
                ring[filled] = triangles[t, (k + 1) % 3]
                filled += 1
                end = triangles[t, (k + 2) % 3]
                k = (k + 1) % 3  # the next side of this triangle starts at `end`
                while neighbours[t, k] >= 0 and kept[neighbours[t, k]]:
                    t = neighbours[t, k]
                    for corner in range(3):
                        if triangles[t, corner] == end:
                            k = (corner + 2) % 3
            rings += 1
            starts[rings] = filled
    return starts[: rings + 1], ring
