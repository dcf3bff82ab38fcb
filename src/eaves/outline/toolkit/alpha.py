"""Alpha shapes in the plane: the rings of the area that no empty disc of a given radius can enter."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from eaves.geometry.rings import signed_area, split_loops
from eaves.geometry.tin import Tin, areas_and_radii
from eaves.kernels import kernel
from eaves.model import Failure, Labels, Points

SHARE = 0.95
"""The least share of the points that lie inside."""
WIDEN = 1.5
"""Factor from one try to the next when the radius is too small to hold the points together: the step of a
search for the radius that `share` asks for, in every method that has an alpha shape."""
WIDEN_TRIES = 6
"""Tries (count) of that search."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """Delaunay triangles of points: corners, neighbours across the opposite sides, radii and areas.

    `xy` (N, 2), `triangles` (T, 3), `neighbours` (T, 3; -1 for none), `radius` (T,) m, `area` (T,) m².
    """

    xy: NDArray[np.float64]
    triangles: NDArray[np.int64]
    neighbours: NDArray[np.int64]
    radius: NDArray[np.float64]
    area: NDArray[np.float64]


def triangulate_points(xy: NDArray[np.float64]) -> Mesh | None:
    """The Delaunay triangles of points (N, 2), None when they lie on one line; those of the last points are
    at hand, for a building that is divided into parts is mostly one part, and traced next."""
    return mesh_of(xy.tobytes())


@lru_cache(maxsize=1)
def mesh_of(places: bytes) -> Mesh | None:
    """The mesh of points given as their bytes, row by row."""
    xy = np.frombuffer(places).reshape(-1, 2).copy()
    if len(xy) < 3:
        return None
    tin = Tin(xy)
    real = (tin.vertices >= 0).all(axis=1)
    if not real.any():
        return None
    number = np.where(real, np.cumsum(real) - 1, -1)
    triangles, neighbours = tin.vertices[real].astype(np.int64), number[tin.neighbours[real]]
    area, radius = areas_and_radii(xy, triangles)
    return Mesh(xy, triangles, neighbours, radius, area)


def wide_radius(mesh: Mesh, most: float, share: float) -> float | None:
    """Radius (m) of the empty discs over `share` of the meshed area, leaving out those over `most`."""
    inside = mesh.radius <= most
    if not inside.any():
        return None
    radius = mesh.radius[inside]
    order = np.argsort(radius, kind="stable")
    covered = np.cumsum(mesh.area[inside][order])
    return float(radius[order][np.searchsorted(covered, share * covered[-1])])


def traced_rings(
    points: Points,
    mesh: Mesh | None,
    radius: float,
    *,
    share: float,
    min_hole: float = 0.0,
    sparse: float = 1.0,
    sparse_points: int = 1,
) -> list[NDArray[np.float64]] | Failure:
    """Rings (M, 2) around points (N, 3): the outer counter-clockwise, then holes of at least `min_hole` (m²)
    clockwise; a Failure where they enclose no area.

    The area is the union of the Delaunay triangles whose circumscribed disc, which is empty, has at most
    `radius` (m), reduced to its largest part connected over edges [edelsbrunner1983]. The radius is
    widened, by steps of `WIDEN`, while that part holds less than `share` of the points. Points left outside
    that hang together with it at `sparse` times the radius are taken in, in groups of `sparse_points` and
    more: there something stood between the roof and the scanner.
    """
    kept, radius = (np.zeros(0, np.bool_), radius) if mesh is None else widen(mesh, radius, share)
    if mesh is None or not kept.any():
        return Failure("no_area", f"{len(points)} points enclose no area", "outline")
    if sparse > 1.0:
        kept = with_sparse_parts(mesh, kept, sparse * radius, sparse_points)
    starts, ring = boundary_kernel(mesh.triangles, mesh.neighbours, kept)
    loops = [loop for a, b in pairwise(starts.tolist()) for loop in split_loops(ring[a:b]) if len(loop) > 2]
    areas = np.array([signed_area(mesh.xy[loop]) for loop in loops])
    holes = [k for k in np.argsort(areas, kind="stable") if areas[k] < 0 and -areas[k] >= min_hole]
    return [points[loops[k], :2] for k in (int(np.argmax(areas)), *holes)]


def widen(mesh: Mesh, radius: float, share: float) -> tuple[NDArray[np.bool_], float]:
    """The largest part (T,) that holds `share` of the points, and the radius (m) widened for it."""
    for tries in range(WIDEN_TRIES):
        radius *= WIDEN if tries else 1.0
        kept = largest_part(mesh, mesh.radius <= radius)
        corner = np.zeros(len(mesh.xy), np.bool_)
        corner[mesh.triangles[kept]] = True
        if corner.sum() >= share * len(mesh.xy):
            break
    return kept, radius


def alpha_parts(mesh: Mesh, radius: float, least: float, neck: float = 0.0) -> Labels:
    """The part 0, 1, … (N,) of the alpha shape of a radius (m) that each point is a corner of, or nearest to.

    Smaller parts than the `least` (m²) are none. A part that a `neck` (m) or less joins with another is one
    by itself: what is left of both is as large when all that lies within half the neck of a rim is taken off.
    Gaps smaller than the least have no rim.
    """
    kept = mesh.radius <= radius
    number = nearest_part(mesh, kept, least, np.zeros(len(mesh.xy), np.int32))
    return nearest_part(mesh, cores(mesh, kept, 0.5 * neck, least), least, number) if neck > 0.0 else number


def nearest_part(mesh: Mesh, kept: NDArray[np.bool_], least: float, within: Labels) -> Labels:
    """Number 0, 1, … (N,) of the nearest connected part of the kept triangles (T,) of at least so many m², of
    the same group `within` (N,); a group without such a part is left whole."""
    part, count = part_kernel(mesh.neighbours, kept)
    area = np.bincount(part, weights=mesh.area, minlength=count + 1)
    seed = np.zeros(len(mesh.xy), np.int64)
    for k in np.argsort(area[1:], kind="stable") + 1:
        if area[k] >= least:
            seed[mesh.triangles[part == k]] = k
    whole = ~np.isin(within, within[seed > 0])
    seed[whole] = count + 1 + within[whole]
    inside = np.flatnonzero(seed)
    if np.ptp(seed[inside]) == 0:
        return np.zeros(len(seed), np.int32)
    place = np.column_stack([mesh.xy, 2.0 * np.ptp(mesh.xy) * within])
    nearest = inside[cKDTree(place[inside]).query(place)[1]]
    return np.unique(seed[nearest], return_inverse=True)[1].astype(np.int32)


def cores(mesh: Mesh, kept: NDArray[np.bool_], depth: float, gap: float) -> NDArray[np.bool_]:
    """The triangles (T,) with all corners deeper (m) than that behind the rim of those kept, gaps up to an
    area (m²) filled."""
    hole, count = part_kernel(mesh.neighbours, ~kept)
    area = np.bincount(hole, weights=mesh.area, minlength=count + 1)
    area[hole[(mesh.neighbours < 0).any(axis=1)]] = np.inf
    filled = kept | (area < gap)[hole]
    beside = (mesh.neighbours >= 0) & filled[mesh.neighbours]
    rim = np.zeros(len(mesh.xy), np.bool_)
    for k in range(3):
        side = mesh.triangles[filled & ~beside[:, k]]
        rim[side[:, (k + 1) % 3]] = rim[side[:, (k + 2) % 3]] = True
    near = cKDTree(mesh.xy[rim]).query(mesh.xy, distance_upper_bound=np.nextafter(depth, np.inf))[0]
    deep = near > depth
    return np.asarray(filled & deep[mesh.triangles].all(axis=1))


def largest_part(mesh: Mesh, kept: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The kept triangles (T,) of the part with the largest area; parts hang together over common sides."""
    part, count = part_kernel(mesh.neighbours, kept)
    area = np.bincount(part, weights=mesh.area, minlength=count + 1)
    area[0] = 0.0
    return np.asarray(kept & (part == int(np.argmax(area))))


def with_sparse_parts(mesh: Mesh, kept: NDArray[np.bool_], radius: float, least: int) -> NDArray[np.bool_]:
    """The kept triangles (T,) and those up to `radius` (m) around groups of `least` points outside."""
    outside = np.ones(len(mesh.xy), np.bool_)
    outside[mesh.triangles[kept]] = False
    around = ~kept & (mesh.radius <= radius) & outside[mesh.triangles].any(axis=1)
    part, count = part_kernel(mesh.neighbours, around)
    corners = mesh.triangles[around]
    pairs = np.unique(np.repeat(part[around], 3) * len(outside) + corners.ravel())
    group, corner = np.divmod(pairs, len(outside))
    points_outside = np.bincount(group[outside[corner]], minlength=count + 1)
    return largest_part(mesh, kept | (around & (points_outside[part] >= least)))


@kernel
def part_kernel(neighbours: NDArray[np.int64], kept: NDArray[np.bool_]) -> tuple[NDArray[np.int64], int]:
    """Connected part (T,) of each triangle kept, 1, 2, …, and 0 for the others; how many parts there are."""
    part = np.zeros(len(kept), np.int64)
    stack = np.empty(len(kept), np.int64)
    count = 0
    for first in range(len(kept)):
        if not kept[first] or part[first] > 0:
            continue
        count += 1
        part[first] = count
        stack[0] = first
        height = 1
        while height > 0:
            height -= 1
            t = stack[height]
            for k in range(3):
                n = neighbours[t, k]
                if n >= 0 and kept[n] and part[n] == 0:
                    part[n] = count
                    stack[height] = n
                    height += 1
    return part, count


@kernel
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
