"""Lines of one height over a raster."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eaves.kernels import kernel
from eaves.model import Raster, Values


@dataclass(frozen=True, eq=False)
class Contour:
    """A line of one height: `xy` (M, 2) in order, local metres; the first point is not repeated."""

    level: float
    xy: NDArray[np.float64]
    closed: bool

    @property
    def length(self) -> float:
        """m, along the line, and back to its start when closed."""
        ring = np.vstack([self.xy, self.xy[:1]]) if self.closed else self.xy
        return float(np.hypot(*np.diff(ring, axis=0).T).sum())

    @property
    def end_distance(self) -> float:
        """Distance (m) between the two ends; 0 when closed."""
        return 0.0 if self.closed else float(np.hypot(*(self.xy[-1] - self.xy[0])))


def trace_contours(raster: Raster, levels: Values) -> list[Contour]:
    """The contour lines of a raster at each of the levels (m), by marching squares between cell centres.

    A line is open where it meets the rim or an empty cell. A saddle is cut by the mean of its four cells.
    """
    contours = []
    values = raster.values.astype(np.float64)
    for level in levels:
        places, starts, closed = contour_kernel(values, float(level))
        xy = np.c_[
            raster.west + (places[:, 1] + 0.5) * raster.cell,
            raster.north - (places[:, 0] + 0.5) * raster.cell,
        ]
        for k, ring in enumerate(closed):
            contours.append(Contour(float(level), xy[starts[k] : starts[k + 1]], bool(ring)))
    return contours


@kernel
def contour_kernel(
    values: NDArray[np.float64], level: float
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.bool_]]:
    """Rows and columns (M, 2) along all lines of one level, where each begins (L + 1,), which are closed
    (L,).

    An edge between two cells is a node: 2 · cell towards the east, 2 · cell + 1 towards the south. A node
    has a segment on either side at most, so segments make chains.
    """
    rows, columns = values.shape
    links = np.full((2 * rows * columns, 2), -1, np.int64)
    crossed = np.empty(4, np.int64)
    for row in range(rows - 1):
        for column in range(columns - 1):
            a, b = values[row, column], values[row, column + 1]
            c, d = values[row + 1, column + 1], values[row + 1, column]
            mean = (a + b + c + d) / 4.0
            if np.isnan(mean):
                continue
            up_a, up_b, up_c, up_d = a >= level, b >= level, c >= level, d >= level
            count = 0
            here = row * columns + column
            if up_a != up_b:
                crossed[count] = 2 * here
                count += 1
            if up_b != up_c:
                crossed[count] = 2 * (here + 1) + 1
                count += 1
            if up_c != up_d:
                crossed[count] = 2 * (here + columns)
                count += 1
            if up_d != up_a:
                crossed[count] = 2 * here + 1
                count += 1
            if count == 4 and (mean >= level) == up_a:  # a and c are joined: cut off b and d
                pairs = ((crossed[0], crossed[1]), (crossed[2], crossed[3]))
            elif count == 4:
                pairs = ((crossed[3], crossed[0]), (crossed[1], crossed[2]))
            elif count == 2:
                pairs = ((crossed[0], crossed[1]), (np.int64(-1), np.int64(-1)))
            else:
                continue
            for first, second in pairs:
                if first < 0:
                    continue
                links[first, 0 if links[first, 0] < 0 else 1] = second
                links[second, 0 if links[second, 0] < 0 else 1] = first
    total = 0
    for node in range(len(links)):
        if links[node, 0] >= 0:
            total += 1
    places = np.empty((total, 2))
    starts = np.empty(total + 1, np.int64)
    closed = np.empty(total, np.bool_)
    visited = np.zeros(len(links), np.bool_)
    lines, corners = 0, 0
    for sweep in range(2):  # open lines from their ends first, then the rings
        for node in range(len(links)):
            if visited[node] or links[node, 0] < 0 or (sweep == 0 and links[node, 1] >= 0):
                continue
            starts[lines], closed[lines] = corners, sweep == 1
            lines += 1
            at = node
            while at >= 0 and not visited[at]:
                visited[at] = True
                row, column = (at // 2) // columns, (at // 2) % columns
                low = values[row, column]
                high = values[row, column + 1] if at % 2 == 0 else values[row + 1, column]
                share = (level - low) / (high - low)
                places[corners, 0] = row + (0.0 if at % 2 == 0 else share)
                places[corners, 1] = column + (share if at % 2 == 0 else 0.0)
                corners += 1
                following = links[at, 0]
                if following < 0 or visited[following]:
                    following = links[at, 1]
                at = following
    starts[lines] = corners
    return places, starts[: lines + 1], closed[:lines]


def slopes_at(surface: Raster, xy: NDArray[np.float64]) -> Values:
    """Rise per metre (N,) of a surface at places (N, 2), over two cells."""
    rises = [surface.at(xy + step) - surface.at(xy - step) for step in surface.cell * np.eye(2)]
    return np.asarray(np.hypot(*rises) / (2.0 * surface.cell))
