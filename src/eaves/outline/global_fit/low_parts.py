"""Points that hang below the roof's edge: walls, balconies, canopies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.geometry.inside import unite_kernel
from eaves.kernels import kernel
from eaves.methods import Method, parameter
from eaves.model import Mask, Values
from eaves.outline.toolkit.alpha import Mesh


class LowPartRules(Method):
    """Rules for surfaces that are walls and balconies; lengths in metres."""

    balcony: float = parameter(
        5.0, "surfaces smaller than this below a larger one do not count", unit="m²", ge=0
    )
    deep: float = parameter(1.7, "unless they are deeper than this", unit="m", ge=0)
    low_step: float = parameter(
        0.5,
        "neighbours are of one surface when they differ in height by no more than this, and points of a wall "
        "lie in a strip this narrow",
        unit="m",
        ge=0,
    )
    low_steep: float = parameter(1.2, "and this times their distance in plan: 50°", unit="m/m", ge=0)
    low_drop: float = parameter(
        1.5, "a small part this much under the roof beside it is no part of it", unit="m", ge=0
    )


def low_parts(mesh: Mesh, height: Values, reach: float, least: float, limits: LowPartRules) -> Mask:
    """Mask (N,) of the points on small surfaces below a larger one beside them.

    Surfaces are points of `height` (N,) m that hang together over sides of the mesh up to `reach` (m)
    without a step. A surface of fewer than `least` points within the `limits` is small; it is low
    when the large surface that it is next to, itself or over other small ones, is `low_drop` higher
    there than its mean.
    """
    by = limits.deep, limits.low_step, limits.low_steep, limits.low_drop
    return np.asarray(low_parts_kernel(mesh.xy, mesh.triangles, height, reach, least, *by))


@kernel
def low_parts_kernel(
    xy: NDArray[np.float64],
    triangles: NDArray[np.int64],
    height: NDArray[np.float64],
    reach: float,
    least: float,
    deep: float,
    step: float,
    steep: float,
    drop: float,
) -> NDArray[np.bool_]:
    """Surfaces by union over sides of triangles (T, 3); then the height beside goes from one to the next."""
    size = len(xy)
    root = np.arange(size)
    for t in range(len(triangles)):
        for k in range(3):
            i, j = triangles[t, k], triangles[t, (k + 1) % 3]
            length = np.sqrt((xy[i, 0] - xy[j, 0]) ** 2 + (xy[i, 1] - xy[j, 1]) ** 2)
            if length > reach or abs(height[i] - height[j]) > step + steep * length:
                continue
            unite_kernel(root, i, j)
    count = np.zeros(size)
    mean = np.zeros(size)
    first = np.zeros((size, 2))
    second = np.zeros((size, 3))
    for i in range(size):
        r = i
        while root[r] != r:
            r = root[r]
        root[i] = r
        count[r] += 1.0
        mean[r] += height[i]
        dx, dy = xy[i, 0] - xy[r, 0], xy[i, 1] - xy[r, 1]
        first[r, 0] += dx
        first[r, 1] += dy
        second[r, 0] += dx * dx
        second[r, 1] += dx * dy
        second[r, 2] += dy * dy
    small = np.zeros(size, np.bool_)
    for r in range(size):
        if root[r] != r:
            continue
        n = count[r]
        mx, my = first[r, 0] / n, first[r, 1] / n
        xx, xy_, yy = second[r, 0] / n - mx * mx, second[r, 1] / n - mx * my, second[r, 2] / n - my * my
        middle, half = 0.5 * (xx + yy), 0.5 * np.sqrt((xx - yy) ** 2 + 4.0 * xy_ * xy_)
        width = np.sqrt(12.0 * max(middle - half, 0.0))
        small[r] = width < step or (n < least and width < deep)
    beside = np.full(size, -np.inf)
    changed = True
    while changed:
        changed = False
        for t in range(len(triangles)):
            for k in range(3):
                i, j = triangles[t, k], triangles[t, (k + 1) % 3]
                a, b = root[i], root[j]
                if a == b or np.sqrt((xy[i, 0] - xy[j, 0]) ** 2 + (xy[i, 1] - xy[j, 1]) ** 2) > reach:
                    continue
                for _ in range(2):
                    if small[a]:
                        seen = beside[b] if small[b] else height[j]
                        if seen > beside[a]:
                            beside[a] = seen
                            changed = True
                    i, j, a, b = j, i, b, a
    low = np.zeros(size, np.bool_)
    for i in range(size):
        r = root[i]
        low[i] = small[r] and beside[r] - mean[r] / count[r] > drop
    return low
