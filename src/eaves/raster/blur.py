"""Surfaces that were smoothed as they were made, as by image matching: how far, and what was there."""

from __future__ import annotations

import math

import numpy as np
import scipy
from numpy.typing import NDArray

from eaves.geometry.inside import connected_groups_kernel
from eaves.geometry.planes import scatter, sums_of
from eaves.model import Integers, Labels, Mask, Points, Values

Step = tuple[int, int]
BESIDE: tuple[Step, ...] = ((0, 1), (1, 0))
"""Steps down and right to two of the four cells that share a side with a cell: the others step back to it."""
ONWARD: tuple[Step, ...] = (*BESIDE, (1, 1), (1, -1))
"""The same to four of the eight neighbours."""
SORTED_FROM = 4
"""So many times as many values as there are lie between the least and the greatest: they are sorted."""


def steps_within(reach: int) -> tuple[Step, ...]:
    """Steps to half of the cells at most `reach` rows and columns away."""
    return tuple(
        (down, right)
        for down in range(reach + 1)
        for right in range(-reach, reach + 1)
        if down > 0 or right > 0
    )


def neighbour_pairs(mask: Mask, steps: tuple[Step, ...] = ONWARD) -> tuple[Integers, Integers]:
    """Flat numbers of all pairs of cells a step apart that are both set in `mask` (H, W)."""
    pairs = []
    for step in steps:
        a, b = shifted(mask.shape, step)
        pairs.append(numbers_in(mask[a] & mask[b], step, mask.shape))
    first, second = zip(*pairs, strict=True)
    return np.concatenate(first), np.concatenate(second)


def shifted(shape: tuple[int, ...], step: Step) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """The cells (H, W) from which a step down and right leads to another, and those it leads to."""
    (rows, columns), (down, right) = shape, step
    return (
        (slice(0, max(0, rows - down)), slice(max(0, -right), max(0, columns - max(0, right)))),
        (slice(down, rows), slice(max(0, right), max(0, columns - max(0, -right)))),
    )


def numbers_in(linked: Mask, step: Step, shape: tuple[int, ...]) -> tuple[Integers, Integers]:
    """Flat numbers in a raster of a shape (H, W) of the cells set among those of `shifted`, and of those that
    the step leads to."""
    row, column = np.nonzero(linked)
    here = row * shape[1] + column + max(0, -step[1])
    return here, here + step[0] * shape[1] + step[1]


def group_cells(mask: Mask, first: Integers, second: Integers) -> tuple[Labels, int]:
    """Numbers (H, W) of the groups of cells of a mask that pairs (K,) of them join, 0 elsewhere, in the order
    of their first cells; how many there are."""
    cells = np.flatnonzero(mask)
    place = np.zeros(mask.size, np.int64)
    place[cells] = np.arange(len(cells))
    group = connected_groups_kernel(place[first], place[second], len(cells))
    label = np.zeros(mask.shape, np.int32)
    label.ravel()[cells] = group + 1
    return label, int(group.max(initial=-1)) + 1


def grown_by_square(mask: Mask, size: int) -> Mask:
    """The cells (H, W) that a square of `size` cells about one of a mask (H, W) covers."""
    return any_near(mask, size // 2 - size + 1, size // 2)


def shrunk_by_square(mask: Mask, size: int) -> Mask:
    """The cells (H, W) about which a square of `size` cells lies in a mask (H, W), and in the raster."""
    inside = ~any_near(~mask, -(size // 2), size - 1 - size // 2)
    for axis in (0, 1):
        line = np.moveaxis(inside, axis, 0)
        line[: size // 2] = False
        line[max(0, len(line) - (size - 1 - size // 2)) :] = False
    return inside


def opened_by_square(mask: Mask, size: int) -> Mask:
    """The cells (H, W) of a mask that squares of `size` cells within it cover."""
    return grown_by_square(shrunk_by_square(mask, size), size)


def closed_by_square(mask: Mask, size: int) -> Mask:
    """The cells (H, W) that a mask grown by squares of `size` cells keeps when it is shrunk by them."""
    return shrunk_by_square(grown_by_square(mask, size), size)


def any_near(mask: Mask, first: int, last: int) -> Mask:
    """Mask (H, W) of the cells that have a set cell of a mask `first` to `last` rows, and columns, away."""
    for axis in (0, 1):
        grown = np.zeros(mask.shape, bool)
        line, source = np.moveaxis(grown, axis, 0), np.moveaxis(mask, axis, 0)
        for step in range(max(first, -len(line)), min(last, len(line)) + 1):
            line[max(0, -step) : len(line) - max(0, step)] |= source[max(0, step) : len(line) + min(0, step)]
        mask = grown
    return mask


def number_squares(xy: Values, side: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The number (N,), from west to east and in each column from south to north, of the square of a side (m)
    that each place (N, 2) lies in, among those that hold one; and how many places each holds (K,)."""
    column, row = (np.floor(values / side).astype(np.int64) for values in xy.T)
    row -= row.min()
    column -= column.min()
    return number_values(column * (row.max() + 1) + row)[1:]


def number_values(values: Integers) -> tuple[Integers, Integers, Integers]:
    """The values (K,) that occur among some (N,), rising; the number (N,) of each among these, and how often
    each occurs (K,). Values that lie close are counted, others sorted."""
    low = values.min(initial=0)
    if values.max(initial=0) - low > SORTED_FROM * len(values):
        unique, number, count = np.unique(values, return_inverse=True, return_counts=True)
        return unique, number.ravel(), count
    count = np.bincount(values - low)
    unique = np.flatnonzero(count)
    number = np.cumsum(count > 0) - 1
    return unique + low, number[values - low], count[unique]


Surface = NDArray[np.float64]

STEP_M = 2.0
"""Least rise (m) of the edges that are measured: a low storey."""
LEVEL = 0.15
"""An edge ends where its slope falls under this share of its steepest."""
FARTHEST_M = 10.0
"""An edge is followed so far (m) to either side; what goes on is a slope."""
SHARPEST = 10.0
"""Percentile of the widths of the edges that is one of sharp walls, where there are any."""
FEWEST = 1000
"""Edges, in cells, that a blur is measured on, at least: the walls of a dozen houses."""
WIDTH = (2.0 * np.pi) ** 0.5
"""Rise over steepest slope of a wall smoothed by a normal distribution, in standard deviations."""
ROUNDS, SHOCKS = 80, 8
"""Rounds of the minimisation, and of the shock filter: after them walls are a cell wide."""
SHOCK_STEP = 0.4
"""Share of a cell by which the shock filter carries a surface on in a round; stable under a half."""
TREND_M = 10.0
"""The surface smoothed by a normal distribution of so much (m), wider than houses, is left out: slopes would
become stairs. A third of what is known around a block."""
NARROW_M = 4.0
"""Width (m) of a narrow house."""
RIPPLE = 0.06
"""Weight of the total variation (m): ripples of about that height that no wall explains go."""
SQUARE_M, SQUARES = 120.0, 24
"""Side (m) of the squares in which the blur is measured, and how many, those with the most points."""
LEAST_CELL_M = 0.5
"""Side (m) of the cells of a dense cloud: smaller blurs say nothing of a house."""
BOUND = 2.0
"""So many cells are what a sharp wall takes between two points."""
SHOWN = 0.8
"""Share of a blur over two of a sharp wall's that counts as shown by the median edge. Edges of drawn towns
show .6 to .75, as roofs are too narrow to rise to their full height; a surface that is sharpened by all of it
rings: of .675, .8 and .95 on sixteen drawn towns .8 has the fewest false outlines, and as many roofs."""
FLATTEST = 5.0
"""Percentile of the squares that are flat in any scan of roofs, roads or fields."""
COVER_M = 4.0
"""Side (m) of the squares that are covered where they hold a point."""


def cell_of(xyz: Points) -> float:
    """Side (m) of the cells in which points (N, 3) are a surface: one spacing of the area that they cover."""
    _, count = number_squares(xyz[:, :2], COVER_M)
    return float(max(LEAST_CELL_M, (COVER_M**2 * len(count) / len(xyz)) ** 0.5))


def height_kept(blur: float) -> float:
    """Share of its height that a narrow house keeps where walls are smoothed by `blur` (m)."""
    return 1.0 if blur == 0.0 else math.erf(NARROW_M / (8.0**0.5 * blur))


def edge_widths(surface: Surface, known: Mask, cell: float) -> Values:
    """Widths (m) of the edges of a surface: rise over steepest slope.

    Parameters
    ----------
    surface : ndarray (H, W)
        Heights (m), without NaN.
    known : ndarray (H, W) of bool
        Cells that hold a point, or lie among such.
    cell : float
        Side of a cell (m).
    """
    south, east = (np.asarray(np.gradient(surface, cell, axis=axis)) for axis in (0, 1))
    steep = np.hypot(south, east)
    row, column = np.nonzero(known & (steep > STEP_M / FARTHEST_M))
    slope = steep[row, column]
    way = np.stack([south[row, column], east[row, column]]) / slope

    def along(values: Surface, distance: float) -> Values:
        at = np.stack([row, column]) + way * (distance / cell)
        return np.asarray(scipy.ndimage.map_coordinates(values, at, order=1, mode="nearest"))

    peak = (slope >= along(steep, cell)) & (slope > along(steep, -cell))
    row, column, slope, way = row[peak], column[peak], slope[peak], way[:, peak]
    middle = surface[row, column]
    rise, ends = np.zeros(len(row)), np.ones(len(row), bool)
    for side in (-1.0, 1.0):
        before, goes_on = middle, np.ones(len(row), bool)
        for step in range(1, round(FARTHEST_M / cell) + 1):
            height = along(surface, side * step * cell)
            goes_on &= (height - before) * side > LEVEL * slope * cell
            rise += np.where(goes_on, (height - before) * side, 0.0)
            before = height
        ends &= ~goes_on
    chosen = ends & (rise > STEP_M)
    return np.asarray(rise[chosen] / slope[chosen])


def gridded(
    xyz: Points, cell: float, shape: tuple[int, int], origin: tuple[float, float]
) -> tuple[Surface, Mask]:
    """Mean heights (H, W) of points (N, 3) in cells from an origin (m), rows to the north, of the nearest
    cell where there is none; and the cells that hold a point, or lie in a gap of a few cells."""
    place = np.floor((xyz[:, :2] - origin) / cell).astype(np.int64)
    inside = ((place >= 0) & (place < shape[::-1])).all(axis=1)
    number = place[inside, 1] * shape[1] + place[inside, 0]
    size = shape[0] * shape[1]
    count = np.bincount(number, minlength=size).reshape(shape)
    total = np.bincount(number, xyz[inside, 2], size).reshape(shape)
    empty = count == 0
    nearest = scipy.ndimage.distance_transform_edt(empty, return_distances=False, return_indices=True)
    mean = total / np.maximum(count, 1)
    return mean[tuple(nearest)], np.asarray(scipy.ndimage.binary_closing(~empty, iterations=2) | ~empty)


def measure_blur(xyz: Points) -> float:
    """Standard deviation (m) by which the steps of points (N, 3) are smoothed; 0 where no house loses by it;
    NaN where walls are as sharp as the spacing shows, or too few edges are seen.

    It follows from the median width of all edges of 2 m and more in squares of 120 m. A sharp wall takes two
    cells, widths add up as squares, and as much again is no loss to a house: only what goes beyond is blur.
    Where a tenth of the edges is up to two cells wide there are sharp walls.
    """
    square, count = number_squares(xyz[:, :2], SQUARE_M)
    widths, cells = list[Values](), list[float]()
    order = np.argsort(square, kind="stable")
    groups = np.split(order, np.cumsum(count)[:-1])
    for number in np.argsort(-count, kind="stable")[:SQUARES]:
        points = xyz[groups[number]]
        cell = cell_of(points)
        side = int(np.ceil(SQUARE_M / cell))
        corner = np.floor(points[0, :2] / SQUARE_M) * SQUARE_M
        surface, known = gridded(points, cell, (side, side), (float(corner[0]), float(corner[1])))
        widths.append(edge_widths(surface, known, cell))
        cells.append(cell)
    found = np.concatenate(widths) if widths else np.zeros(0)
    if len(found) < FEWEST:
        return math.nan
    sharp, width = (float(np.percentile(found, share)) for share in (SHARPEST, 50.0))
    wall = BOUND * float(np.median(cells))
    return max(0.0, width**2 - 2.0 * wall**2) ** 0.5 / (SHOWN * WIDTH) if sharp > wall else math.nan


def without_blur(surface: Surface, blur: float, cell: float) -> Surface:
    """A surface (H, W) as it was before it was smoothed.

    Minimises ½ |g * u - z|² + λ Σ |∇u|, g the normal distribution of `blur` (m), z the surface in cells of
    side `cell` (m), by the primal-dual method [chambolle2011]; a shock filter [osher1990] then makes a wall
    of what is left of each ramp. Both see the surface over its trend.
    """
    sigma, trend = blur / cell, scipy.ndimage.gaussian_filter(surface, TREND_M / cell)
    surface = surface - trend
    rows, columns = surface.shape
    margin = int(3.0 * sigma) + 4
    tall, wide = (scipy.fft.next_fast_len(size + 2 * margin, real=True) for size in surface.shape)
    z = np.pad(
        surface,
        ((margin, tall - rows - margin), (margin, wide - columns - margin)),
        mode="symmetric",
    )
    middle = z.mean()
    z -= middle
    across, along = np.fft.fftfreq(tall)[:, None], np.fft.rfftfreq(wide)[None]
    kernel = np.exp(-2.0 * (np.pi * sigma) ** 2 * (across**2 + along**2))
    tau = 2.0**0.5
    step = 1.0 / (8.0 * tau)
    data, shrink = tau * kernel * scipy.fft.rfft2(z), 1.0 / (1.0 + tau * kernel**2)
    u, ahead = z.copy(), z.copy()
    east, south = np.zeros_like(z), np.zeros_like(z)
    for _ in range(ROUNDS):
        east[:, :-1] += step * np.diff(ahead, axis=1)
        south[:-1] += step * np.diff(ahead, axis=0)
        size = np.maximum(1.0, np.hypot(east, south) / RIPPLE)
        east /= size
        south /= size
        flow = east + south
        flow[:, 1:] -= east[:, :-1]
        flow[1:] -= south[:-1]
        new = scipy.fft.irfft2((scipy.fft.rfft2(u + tau * flow) + data) * shrink, s=z.shape)
        ahead, u = 2.0 * new - u, new
    detail = u[margin : margin + rows, margin : margin + columns] + middle
    return np.asarray(trend + shocked(detail))


def shocked(surface: Surface) -> Surface:
    """A surface (H, W) whose ramps are walls: lowered where it bends up along its slope, raised where it
    bends down, by the slope itself."""
    for _ in range(SHOCKS):
        smooth = scipy.ndimage.gaussian_filter(surface, 1.0)
        south, east = np.gradient(smooth)
        (southern, turning), eastern = np.gradient(south), np.gradient(east, axis=1)
        square = south**2 + east**2
        bend = (east**2 * eastern + 2.0 * east * south * turning + south**2 * southern) / (square + 1e-6)
        ahead = [np.diff(surface, axis=axis, append=np.take(surface, [-1], axis)) for axis in (0, 1)]
        behind = [np.diff(surface, axis=axis, prepend=np.take(surface, [0], axis)) for axis in (0, 1)]
        up = np.hypot(*(np.maximum(np.maximum(a, -b), 0.0) for a, b in zip(ahead, behind, strict=True)))
        down = np.hypot(*(np.maximum(np.maximum(-a, b), 0.0) for a, b in zip(ahead, behind, strict=True)))
        share = -bend / (np.abs(bend) + 0.01)
        surface = surface + SHOCK_STEP * share * np.where(share > 0.0, up, down)
    return surface


def measure_roughness(xyz: Points, side: float = 3.0, fewest: int = 6) -> float:
    """Fifth percentile of the RMSE (m) of points (N, 3) across the planes of squares of a side (m) with
    `fewest` points or more; NaN where no square has as many."""
    local = xyz - xyz[:1]
    square, count = number_squares(local[:, :2], side)
    local[:, :2] -= side * np.floor(local[:, :2] / side)
    _, spread = scatter(sums_of(local, square, len(count))[count >= fewest])
    count = count[count >= fewest]
    plan, rise = spread[:, :2, :2], spread[:, :2, 2]
    area = np.maximum(np.linalg.det(plan), 1e-9)
    explained = rise[:, 0] ** 2 * plan[:, 1, 1] + rise[:, 1] ** 2 * plan[:, 0, 0]
    explained -= 2.0 * rise[:, 0] * rise[:, 1] * plan[:, 0, 1]
    left = np.maximum(spread[:, 2, 2] - explained / area, 0.0) * count / (count - 3.0)
    return float(np.percentile(np.sqrt(left), FLATTEST)) if len(left) else float("nan")
