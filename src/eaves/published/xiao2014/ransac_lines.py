"""Outlines from long straight segments, turned into the building's main directions."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from eaves.geometry.rings import COORDINATE_STEP
from eaves.kernels import kernel
from eaves.methods import Emit, parameter
from eaves.model import Boundary
from eaves.outline.toolkit.alpha_outline import AlphaOutline
from eaves.outline.toolkit.corners import Drawing, joined_edges, ring_of_edges
from eaves.outline.toolkit.edges import RIGHT_ANGLE, OutlineEdges, common_axes, main_direction
from eaves.outline.toolkit.polyline import FREE


class RansacLines(AlphaOutline):
    """The outline made of long straight segments of the boundary, adjusted to the building's main directions.

    The boundary points come in order from an alpha shape. Lines through pairs of them are tried; the points
    near a line that follow each other along the boundary are its connected component, and the longest one
    of all lines is a segment. Its points are set aside and the search goes on until no segment is long
    enough. Segments that nearly follow the main direction, which most of the length agrees on, or its
    perpendicular, are turned into it about their middle; the others stay as they are. Corners are the
    intersections of consecutive segments.

    Formula
    -------
    segment of a line (n, c): consecutive boundary points with |n·p − c| ≤ `near` · spacing

    Fidelity
    --------
    The steps are those of [xiao2014], section 4, the adjustment that of [zhang2006]; no number is
    printed in the former. Random sampling is replaced by all pairs of boundary points that are 1, 2, 4, 8, …
    points apart: the same lines are found, and found again in the next run. A stretch between two segments
    that is itself longer than `shortest` becomes a segment through its points; what is shorter is a corner.
    Lines that meet farther than `corner_reach` from the boundary make no corner. A stretch of the boundary
    that the adjusted segments leave farther outside than a corner comes back as traced; where they make no
    ring, all of it.

    Fails where
    -----------
    the building is round, or its walls shorter than `shortest`; and at edges: the outline
    lies about half a spacing inside the eaves, as in the source.

    Complexity
    ----------
    O(N log N) for the triangulation, O(S M log M L) for S segments of L of the M boundary
    points.

    References
    ----------
    [xiao2014], [zhang2006].
    """

    name: ClassVar[str] = "ransac_lines"
    idea: ClassVar[str] = "Long segments of the boundary by RANSAC, turned into the main directions."
    paper: ClassVar[str] = "xiao2014"

    alpha: float = parameter(2.0, "radius of the largest empty disc, in spacings", gt=0)
    near: float = parameter(0.5, "largest distance of a segment's points from its line, in spacings", gt=0)
    skip: int = parameter(2, "most boundary points in a row that a segment passes by", unit="points", ge=0)
    shortest: float = parameter(3.0, "shortest segment, in spacings", gt=0)
    tolerance: float = parameter(15.0, "largest turn into a main direction", unit="°", ge=0)
    corner_reach: float = parameter(
        5.0, "a corner farther than this from the boundary is cut off, in spacings", gt=0
    )

    def radius(self, spacing: float) -> float:
        return self.alpha * spacing

    def draw(self, boundary: Boundary, emit: Emit) -> Polygon:
        """The adjusted segments, with each stretch of the boundary as traced that they leave farther outside
        than a corner; where they make no ring, the boundary itself."""
        outer, *inner = (self.adjusted_ring(ring, boundary.spacing, emit) for ring in boundary.rings)
        traced = Polygon(boundary.rings[0], boundary.rings[1:]).simplify(boundary.spacing)
        drawn = traced if outer is None else Polygon(outer, [ring for ring in inner if ring is not None])
        if not (drawn.is_valid and traced.is_valid):
            return traced
        limit, border = self.shortest * boundary.spacing, shapely.points(boundary.rings[0])
        outside = border[shapely.distance(border, drawn) > limit]
        missed = shapely.get_parts(shapely.difference(traced, drawn))
        back = [one for one in missed if (shapely.distance(outside, one) <= boundary.spacing).any()]
        whole = shapely.union_all([drawn, *back], grid_size=COORDINATE_STEP) if back else drawn
        return whole if whole.geom_type == "Polygon" else traced

    def adjusted_ring(
        self, ring: NDArray[np.float64], spacing: float, emit: Emit
    ) -> NDArray[np.float64] | None:
        """The corners (C, 2) of one ring (M, 2); None when fewer than three segments are found."""
        origin = ring[0].copy()
        local = ring - origin
        runs = long_runs(local, self.near * spacing, self.skip, self.shortest * spacing)
        ends = np.array(runs, np.int64).reshape(-1, 2) % len(ring)
        emit("segments", ring[ends].reshape(-1, 4))
        if len(runs) < 3:
            return None
        sigma = 0.5 * self.near * spacing
        edges = turned_edges(segment_edges(local, runs), sigma, np.radians(self.tolerance))
        drawing = Drawing(self.near * spacing, self.corner_reach * spacing, sigma, 0.0)
        edges = joined_edges(edges, drawing)
        return None if len(edges) < 3 else ring_of_edges(edges, drawing) + origin


def long_runs(ring: NDArray[np.float64], near: float, skip: int, shortest: float) -> list[tuple[int, int]]:
    """First and last point number of the straight runs along `ring` (M, 2), in order; last < first + M.

    The last may pass the end of the ring: point number m is point m modulo M.
    """
    free = np.ones(len(ring), np.bool_)
    runs: list[tuple[int, int]] = []
    while True:
        first, last, _ = longest_run_kernel(ring, free, near, skip)
        if last <= first or np.hypot(*(ring[last % len(ring)] - ring[first])) < shortest:
            break
        free[np.arange(first, last + 1) % len(ring)] = False
        runs.append((int(first), int(last)))
    runs.sort()
    return runs


@kernel
def longest_run_kernel(
    ring: NDArray[np.float64], free: NDArray[np.bool_], near: float, skip: int
) -> tuple[int, int, int]:
    """The longest run of free ring points near one line through two of them: first, last, count.

    Near is within `near` (m); at most `skip` points in a row may lie farther off. Lines go through points
    1, 2, 4, … apart.
    """
    size = len(ring)
    best_first, best_last, best_count = 0, -1, 0
    for i in range(size):
        if not free[i]:
            continue
        apart = 1
        while apart < size // 2:
            j = (i + apart) % size
            dx, dy = ring[j, 0] - ring[i, 0], ring[j, 1] - ring[i, 1]
            length = np.sqrt(dx * dx + dy * dy)
            apart *= 2
            if not free[j] or length <= 0.0:
                continue
            ends = np.array([i, i])
            count = 1
            for way in range(2):
                step = 1 - 2 * way
                missed, place = 0, i
                while missed <= skip and ends[0] - ends[1] < size - 1:
                    place += step
                    m = place % size
                    if not free[m] or abs(place - i) >= size - 1:
                        break
                    off = abs((ring[m, 0] - ring[i, 0]) * dy - (ring[m, 1] - ring[i, 1]) * dx) / length
                    if off <= near:
                        count += 1
                        missed = 0
                        ends[way] = place
                    else:
                        missed += 1
            if count > best_count:
                best_first = ends[1] % size
                best_last = best_first + ends[0] - ends[1]
                best_count = count
    return best_first, best_last, best_count


def segment_edges(ring: NDArray[np.float64], runs: list[tuple[int, int]]) -> OutlineEdges:
    """Edges through the points of the runs of `ring` (M, 2); each starts half way from the run before."""
    size = len(ring)
    moments: list[NDArray[np.float64]] = []
    angle: list[float] = []
    corner: list[NDArray[np.float64]] = []
    for k, (first, last) in enumerate(runs):
        xy = ring[np.arange(first, last + 1) % size]
        mean = xy.mean(axis=0)
        dx, dy = (xy - mean).T
        one = np.array([len(xy), *mean, dx @ dx, dx @ dy, dy @ dy])
        direction = float(main_direction(one))
        run = xy[-1] - xy[0]
        if np.cos(direction) * run[0] + np.sin(direction) * run[1] < 0.0:
            direction += np.pi
        before = runs[k - 1][1] - (size if k == 0 else 0)
        moments.append(one)
        angle.append(direction)
        corner.append(ring[((before + first) // 2) % size])
    stacked, angles = np.array(moments), np.array(angle)
    offset = -np.sin(angles) * stacked[:, 1] + np.cos(angles) * stacked[:, 2]
    return OutlineEdges(angles, offset, np.full(len(runs), FREE), stacked, np.array(corner))


def turned_edges(edges: OutlineEdges, sigma: float, tolerance: float) -> OutlineEdges:
    """The edges, those within `tolerance` (radians) of the main direction or across turned into it."""
    axes = common_axes(edges, sigma, tolerance, frames=1, fewest=2)
    if len(axes) == 0:
        return edges
    turns = np.round((edges.angle - axes[0]) / RIGHT_ANGLE)
    along = axes[0] + turns * RIGHT_ANGLE
    close = np.abs(edges.angle - along) <= tolerance
    angle = np.where(close, along, edges.angle)
    offset = -np.sin(angle) * edges.moments[:, 1] + np.cos(angle) * edges.moments[:, 2]
    axis = np.where(close, np.mod(turns, 2), FREE).astype(np.int64)
    return edges.with_(angle=angle, offset=offset, axis=axis)
