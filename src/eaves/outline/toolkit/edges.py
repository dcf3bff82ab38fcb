"""Edges of an outline: lines through stretches of boundary points, their common directions, their place."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eaves.kernels import kernel
from eaves.outline.toolkit.polyline import travel_angles

RIGHT_ANGLE = np.pi / 2
WALL_ABOVE, WALL_STEEP = 0.6, 1.7
"""A point of a wall is one with another this much above it (m), and steeper than 60°; for fitted
outlines and given footprints alike."""


@dataclass(frozen=True, eq=False)
class OutlineEdges:
    """Directed edges around a ring, the building on their left; K edges.

    `angle` (K,) is the direction of travel (radians), `offset` (K,) the signed distance of the line from
    the origin along its left normal (m), `axis` (K,) the number of the common axis or `FREE`. `moments` (K,
    6) are count, mean x, mean y and the central second moments xx, xy, yy of the boundary points it is
    fitted to. `corner` (K, 2) is the boundary point where the edge starts.
    """

    angle: NDArray[np.float64]
    offset: NDArray[np.float64]
    axis: NDArray[np.int64]
    moments: NDArray[np.float64]
    corner: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.angle)

    @property
    def normal(self) -> NDArray[np.float64]:
        """Unit normals (K, 2), pointing into the building."""
        return np.stack([-np.sin(self.angle), np.cos(self.angle)], axis=1)

    @property
    def direction(self) -> NDArray[np.float64]:
        """Unit vectors (K, 2) of travel."""
        return np.stack([np.cos(self.angle), np.sin(self.angle)], axis=1)

    def with_(self, **changes: Any) -> OutlineEdges:
        """A copy with some fields replaced."""
        return replace(self, **changes)

    def take(self, which: NDArray[np.int64]) -> OutlineEdges:
        """The edges number `which`, in that order."""
        return OutlineEdges(
            self.angle[which], self.offset[which], self.axis[which], self.moments[which], self.corner[which]
        )


def stretch_moments(
    ring: NDArray[np.float64], first: NDArray[np.int64], last: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Count, mean and central second moments (K, 6) of the ring points (M, 2) of every stretch.

    A stretch runs from its `first` point to its `last` one, both included, which may be number M and more;
    where it has five points or more its ends, which lie in rounded corners, are left out.
    """
    trim = (last - first >= 4).astype(np.int64)
    first, last = first + trim, last - trim
    x, y = np.concatenate([ring, ring]).T
    sums = np.zeros((len(x) + 1, 5))
    np.cumsum(np.stack([x, y, x * x, x * y, y * y], axis=1), axis=0, out=sums[1:])
    total = sums[last + 1] - sums[first]
    n = (last - first + 1).astype(np.float64)
    mean = total[:, :2] / n[:, None]
    mx, my = mean.T
    second = total[:, 2:] - n[:, None] * np.stack([mx * mx, mx * my, my * my], axis=1)
    return np.concatenate([n[:, None], mean, second], axis=1)


def main_direction(moments: NDArray[np.float64]) -> NDArray[np.float64]:
    """Direction (…,) in radians, up to a half turn, of the line through points with these moments (…, 6)."""
    xx, xy, yy = moments[..., 3], moments[..., 4], moments[..., 5]
    return np.asarray(0.5 * np.arctan2(2.0 * xy, xx - yy))


def fit_edges(ring: NDArray[np.float64], sides: NDArray[np.int64], axes: NDArray[np.float64]) -> OutlineEdges:
    """Edges along `ring` (M, 2) through the points of `sides` (K, 3), which `cheapest_polyline` answers."""
    first, last, direction = sides.T
    angle = travel_angles(axes)[direction]
    moments = stretch_moments(ring, first, last)
    offset = -np.sin(angle) * moments[:, 1] + np.cos(angle) * moments[:, 2]
    before = np.roll(last, 1)
    corner = ring[(before + np.mod(first - before, len(ring)) // 2) % len(ring)]
    return OutlineEdges(angle, offset, direction // 2, moments, corner)


def turned_freely(edges: OutlineEdges) -> OutlineEdges:
    """The edges, each in the direction that fits its points best."""
    angle = main_direction(edges.moments)
    return edges.with_(angle=np.where(np.cos(angle - edges.angle) < 0.0, angle + np.pi, angle))


def common_axes(
    edges: OutlineEdges, sigma: float, tolerance: float, frames: int, fewest: int
) -> NDArray[np.float64]:
    """Directions (2 F,) of at most `frames` right-angled frames that edges agree on: φ, φ + 90°, ….

    The longest edges lead. An edge belongs to a frame when it deviates by less than three standard
    deviations of its own direction (`sigma` (m) is the scatter of a boundary point about its line), at most
    by `tolerance` (radians). A frame needs `fewest` edges; its direction is the one that fits the points of
    all its edges best.
    """
    xx, xy, yy = edges.moments[:, 3], edges.moments[:, 4], edges.moments[:, 5]
    spread = np.sqrt(np.maximum(0.5 * (xx + yy + np.hypot(xx - yy, 2 * xy)), 1e-9))
    length = np.sqrt(12.0) * spread / np.sqrt(edges.moments[:, 0])
    deviation = np.minimum(3.0 * sigma / spread, tolerance)
    angle = np.mod(edges.angle, RIGHT_ANGLE)
    left = np.ones(len(edges), np.bool_)
    axes: list[float] = []
    for _ in range(frames):
        if left.sum() < fewest:
            break
        apart = np.mod(angle[:, None] - angle[None, :] + RIGHT_ANGLE / 2, RIGHT_ANGLE) - RIGHT_ANGLE / 2
        reach = np.minimum(np.hypot(deviation[:, None], deviation[None, :]), tolerance)
        agree = np.maximum(1.0 - (apart / reach) ** 2, 0.0) * left[None, :] * length[None, :] * left[:, None]
        lead = int(np.argmax(np.round(agree.sum(axis=1), 9)))
        along_it = np.flatnonzero(agree[lead] > 0)
        if len(along_it) < fewest:
            break
        turns = np.round((edges.angle[along_it] - edges.angle[lead]) / RIGHT_ANGLE).astype(np.int64)
        axes += frame_axes(edges.moments[along_it], turns)
        left[along_it] = False
    return np.array(axes)


def frame_axes(moments: NDArray[np.float64], turns: NDArray[np.int64]) -> list[float]:
    """Best direction φ of edges with `moments` (K, 6) that lie `turns` right angles off it; and φ + 90°."""
    odd = turns % 2 == 1
    xx, xy, yy = moments[:, 3], moments[:, 4], moments[:, 5]
    sxx, sxy, syy = np.where(odd, yy, xx).sum(), np.where(odd, -xy, xy).sum(), np.where(odd, xx, yy).sum()
    phi = float(0.5 * np.arctan2(2.0 * sxy, sxx - syy))
    return [phi, phi + RIGHT_ANGLE]


@kernel
def edge_shift_kernel(
    xyz: NDArray[np.float64],
    normal: NDArray[np.float64],
    offset: NDArray[np.float64],
    start: NDArray[np.float64],
    length: NDArray[np.float64],
    outside: float,
    inside: float,
    margin: float,
    blur: float,
    beside: float,
    least: int,
) -> NDArray[np.float64]:
    """Shift (K,) of every edge along its normal to where the points end; NaN where too few tell.

    `xyz` (N, 3) are the points; an edge runs from `start` (K, 2) over `length` (K,) with `normal` (K, 2).
    The points from `outside` before it to `inside` behind it and `margin` away from its ends are sorted
    by depth. The edge lies before the k-th of them by what lies, on average, between a place chosen at
    random among them and the k-th point after it. That holds for random points (1/density) and for scan
    lines along the edge (half their distance) alike. k is larger than 1 where `blur` (m) has thrown
    points over the edge. Points of the wall below, which would make the edge look crowded, are passed
    over: within `beside` (m) in plan another one stands `WALL_ABOVE` (m), and more, above them.
    """
    shift = np.full(len(normal), np.nan)
    depth, along = np.empty(len(xyz)), np.empty(len(xyz))
    member = np.empty(len(xyz), np.int64)
    wall = np.empty(len(xyz), np.bool_)
    kept = np.empty(len(xyz))
    for k in range(len(normal)):
        nx, ny = normal[k]
        room = min(margin, 0.25 * length[k])
        count, highest = 0, -np.inf
        for i in range(len(xyz)):
            d = nx * xyz[i, 0] + ny * xyz[i, 1] - offset[k]
            if d < -outside or d > inside:
                continue
            way = ny * (xyz[i, 0] - start[k, 0]) - nx * (xyz[i, 1] - start[k, 1])
            if room < way < length[k] - room:
                depth[count], along[count] = d, way
                member[count] = i
                highest = max(highest, xyz[i, 2])
                count += 1
        if count < least:
            continue
        turn = np.argsort(along[:count])
        for a in range(count):
            own = turn[a]
            i = member[own]
            wall[own] = False
            if highest - xyz[i, 2] <= WALL_ABOVE:
                continue
            for step in (1, -1):
                b = a + step
                while not wall[own] and 0 <= b < count and abs(along[turn[b]] - along[own]) < beside:
                    j = member[turn[b]]
                    b += step
                    rise = xyz[j, 2] - xyz[i, 2]
                    if rise > WALL_ABOVE:
                        dx, dy = xyz[j, 0] - xyz[i, 0], xyz[j, 1] - xyz[i, 1]
                        apart = np.sqrt(dx * dx + dy * dy)
                        wall[own] = apart < beside and rise > WALL_ABOVE + WALL_STEEP * apart
        roof = 0
        for one in np.argsort(depth[:count]):
            if not wall[one]:
                kept[roof] = depth[one]
                roof += 1
        if roof < least:
            continue
        x, count = kept[:roof], roof
        total = x[count - 1] - x[0]
        if total <= 0.0:
            continue
        rank = min(int(blur * count / total), count // 4)
        span = x[count - 1 - rank] - x[0]
        if span <= 0.0:
            continue
        ahead = 0.0
        for j in range(count - 1 - rank):
            gap = x[j + 1] - x[j]
            ahead += gap * (0.5 * gap + x[j + 1 + rank] - x[j + 1])
        shift[k] = x[rank] - ahead / span
    return shift
