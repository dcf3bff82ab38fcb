"""The evidence of each cell for or against a roof: planes, echoes, ground seen through it, height."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from eaves.detect.toolkit.cells import Cells
from eaves.detect.toolkit.surface_grid import mean_in
from eaves.geometry.inside import unite_kernel
from eaves.geometry.planes import Sums, add_point_kernel
from eaves.kernels import inlined_kernel, kernel
from eaves.methods import Method, parameter
from eaves.model import Integers, Labels, Mask, PointCloud, Points, Scene, Values

WINDOW = 3
"""Cells a side of the widest window; what depends on how far cells share points follows from it."""


class WindowRules(Method):
    """Rules for windows that have a plane, and for comparing those of two sizes."""

    window_points: int = parameter(
        6,
        "Points of a window with a plane: three would always fit, six leave half for the residual.",
        ge=4,
    )
    window_width: float = parameter(
        0.25, "A window whose points are narrower than this share of a cell is a line.", ge=0.0
    )
    window_price: float = parameter(
        2.0, "Factor on the residual of a window two cells wide, as few points fit by chance.", gt=0.0
    )


def best_planes(
    sums: Sums, place: Integers, count: Values, cells: Cells, limits: WindowRules
) -> tuple[Values, Values, Values, Values]:
    """The best window's plane of each cell: slopes, height at the cell's middle, residual; (H, W) each.

    `sums` (K, 10) are those of the cells with points, `place` (H, W) each cell's row of them and `count`
    (H, W) its number of points. Every cell lies in nine windows of three by three cells and in four of two by
    two; near a ridge or an eaves at least one of them lies wholly on one face, and in a crown none of them is
    flat.
    """
    best = np.zeros((4, *cells.shape))
    best[3] = np.inf
    for size, price in ((WINDOW, 1.0), (2, limits.window_price)):
        rules = size, limits.window_points, limits.window_width * cells.side
        # planes of one size alone are in memory
        about = size, price, cells.west, cells.north, cells.side
        take_best_kernel(planes_kernel(sums, place, count, *rules), *about, best)
    return best[0], best[1], best[2], best[3]


@kernel
def planes_kernel(
    sums: Sums, place: Integers, count: Values, size: int, least_points: int, least_width: float
) -> NDArray[np.float64]:
    """Least squares planes z = ax + by + c (4, H, W) through the windows of `size` by `size` cells: a, b, c
    and the residual, which is the RMSE across the plane with three degrees of freedom taken off.

    Windows with fewer points, or whose points have a lesser standard deviation in plan, have no more than a
    residual of inf. `sums`, `place` and `count` are those of `best_planes`.
    """
    rows, columns = count.shape
    upright = np.empty((columns, 10))
    planes = np.zeros((4, rows, columns))
    planes[3] = np.inf
    for row in range(rows):
        upright[:] = 0.0  # the sums of the window's cells in each column
        for r in range(max(0, row - 1), min(rows, row + size - 1)):
            for column in range(columns):
                if count[r, column] > 0.0:
                    for k in range(10):
                        upright[column, k] += sums[place[r, column], k]
        for column in range(columns):
            left, right = max(0, column - 1), min(columns, column + size - 1)
            n = 0.0
            for c in range(left, right):
                n += upright[c, 0]
            if n < least_points:
                continue
            x = y = z = xx = xy = xz = yy = yz = zz = 0.0
            for c in range(left, right):
                line = upright[c]
                x, y, z = x + line[1], y + line[2], z + line[3]
                xx, xy, xz = xx + line[4], xy + line[5], xz + line[6]
                yy, yz, zz = yy + line[7], yz + line[8], zz + line[9]
            x, y, z = x / n, y / n, z / n
            xx, xy, xz = xx / n - x * x, xy / n - x * y, xz / n - x * z
            yy, yz, zz = yy / n - y * y, yz / n - y * z, zz / n - z * z
            least = (xx + yy) / 2 - np.sqrt(((xx - yy) / 2) ** 2 + xy * xy)
            if least < least_width * least_width or xx * yy <= xy * xy:
                continue
            determinant = xx * yy - xy * xy
            a = (xz * yy - yz * xy) / determinant
            b = (yz * xx - xz * xy) / determinant
            planes[0, row, column], planes[1, row, column] = a, b
            planes[2, row, column] = z - a * x - b * y
            rest = max(zz - a * xz - b * yz, 0.0) * n / max(n - 3, 1.0)
            planes[3, row, column] = np.sqrt(rest / (1 + a * a + b * b))
    return planes


@kernel
def take_best_kernel(
    planes: NDArray[np.float64],
    size: int,
    price: float,
    west: float,
    north: float,
    side: float,
    best: NDArray[np.float64],
) -> None:
    """Write into `best` (4, H, W) the plane of the window of `size` by `size` cells, of those (4, H, W) that
    hold a cell, with the least residual, where that times `price` is less than its own; heights are those at
    the middles of the cells, which lie about (`west`, `north`)."""
    residual = planes[3]
    rows, columns = residual.shape
    for row in range(rows):
        for column in range(columns):
            least, y, x = residual[row, column], row, column
            for r in range(max(0, row + 2 - size), min(rows, row + 2)):
                for c in range(max(0, column + 2 - size), min(columns, column + 2)):
                    if residual[r, c] < least:
                        least, y, x = residual[r, c], r, c
            if least * price < best[3, row, column]:
                a, b = planes[0, y, x], planes[1, y, x]
                east, up = west + (column + 0.5) * side, north - (row + 0.5) * side
                best[0, row, column], best[1, row, column] = a, b
                best[2, row, column] = planes[2, y, x] + a * east + b * up
                best[3, row, column] = least * price


def window_sum(values: Values) -> Values:
    """Sum (H, W) over the three by three cells around each, of whole numbers (H, W)."""
    for axis in (0, 1):
        line, total = np.moveaxis(values, axis, 0), values.copy()
        beside = np.moveaxis(total, axis, 0)
        beside[1:] += line[:-1]
        beside[:-1] += line[1:]
        values = total
    return values


Counts = NDArray[np.float64]

COLOURS = ("red", "green", "blue")
"""Fields of the colours that a camera sees."""
FULL_8, FULL_16 = 255.0, 65535.0
"""The largest value of a colour, of 8 and of 16 bits: some programs write the former for the latter."""
SHADE = 0.5
"""Weight of the light that is missing beside the excess green."""
EDGES = np.linspace(-0.6, 2.4, 151)
"""Of the classes in which signs are counted, as far as they can reach."""
MIDDLES = (EDGES[1:] + EDGES[:-1]) / 2.0
ROUNDS = 200
"""Of expectation maximisation."""
LEAST_SPREAD, MOST_SPREAD = 0.03, 0.1
"""Standard deviation of the signs of roofs: a camera's noise, and that of white, red and grey ones together;
where crowns are all that is smooth, a wider one would be theirs."""


def has_colours(cloud: PointCloud) -> bool:
    """True if colours speak for a scan that splits no pulse."""
    return not cloud.has_returns and set(COLOURS) <= cloud.fields.keys()


def signs_of_leaves(cloud: PointCloud) -> Values:
    """What each point (N,) shows of leaves: 1 where its pulse had several returns; of a scan that splits no
    pulse how green and dark it is, 0 without colours.

    Excess green is 2 g - r - b of the shares of the colours [woebbecke1995]; leaves shade each other, so that
    half the share of light that is missing is added: both spread as far on roofs.
    """
    if not has_colours(cloud):
        several = cloud.number_of_returns
        return np.zeros(len(cloud)) if several is None else (several > 1).astype(np.float64)
    red, green, blue = (cloud.fields[name] for name in COLOURS)
    light = red + green + blue
    white = 3.0 * (FULL_8 if light.max(initial=0.0) <= 3.0 * FULL_8 else FULL_16)
    return np.asarray((3.0 * green - light) / np.maximum(light, 1.0) + SHADE * (1.0 - light / white))


def count_signs(*signs: Values) -> Counts:
    """How many of each of some arrays of signs lie in each class (n, 150)."""
    return np.array([np.histogram(values, EDGES)[0] for values in signs], np.float64)


def learned(counts: Counts, alike: float) -> Separation:
    """What signs tell, of counts (3, 150) on the terrain, on rough places over it and on smooth ones.

    Smooth places are roofs, relief with the signs of the terrain, and crowns with those of rough places; how
    many of each, and the normal distribution of roofs, are those of the greatest likelihood (expectation
    maximisation, [dempster1977]). Of so many signs that are `alike` one is an observation.
    """
    smooth = counts[2]
    if min(counts[0].sum(), smooth.sum()) < alike:
        return nothing()
    known = (counts[:2] + 1e-6) / (counts[:2] + 1e-6).sum(axis=1, keepdims=True)
    middle = float(MIDDLES[np.searchsorted(np.cumsum(smooth), smooth.sum() / 10.0)])
    spread, shares, likely = MOST_SPREAD, np.full(3, 1.0 / 3.0), smooth
    for _ in range(ROUNDS):
        roofs = np.exp(-0.5 * ((MIDDLES - middle) / spread) ** 2)
        each = shares[:, None] * np.vstack([roofs / roofs.sum(), known])
        parts = smooth * each / np.maximum(each.sum(axis=0), 1e-300)
        shares, likely = parts.sum(axis=1) / smooth.sum(), parts[0]
        middle, variance, _ = moments(MIDDLES, likely)
        spread = min(max(variance**0.5, LEAST_SPREAD), MOST_SPREAD)
    mean, variance, _ = moments(MIDDLES, (shares[1:] + 1e-6) @ known)
    others = mean, variance, float(counts[:2].sum())  # as many show what the others look like
    return separation((middle, spread**2, float(likely.sum())), others, alike)


def moments(value: Values, weights: Values) -> tuple[float, float, float]:
    """Mean and variance of values (K,) with such weights (K,), and the sum of these."""
    weight = float(weights.sum())
    total = max(weight, 1e-300)
    mean = float((weights * value).sum()) / total
    return mean, float((weights * (value - mean) ** 2).sum()) / total, weight


@dataclass(frozen=True)
class Separation:
    """A measure's means on roofs and on crowns of a scan, and its spread about them.

    The log likelihood ratio of a value v is that of two normal distributions of one spread,
    (roof - crown) / spread² · (v - (roof + crown) / 2), times `trust`, the share of the squared distance of
    the means that chance does not explain [james_stein1961]. Where the measure is alike on both, the
    ratio is 0 everywhere.
    """

    roof: float
    crown: float
    spread: float
    trust: float

    @property
    def power(self) -> float:
        """Power of the measure to part roofs from crowns: 0 none, 1 without mistake."""
        distance = self.trust * ((self.roof - self.crown) / self.spread) ** 2
        return distance / (1.0 + distance)

    def log_ratio(self, value: Values, most: float) -> Values:
        """Log likelihood ratio for a roof, of values of any shape, no larger than `most` either way."""
        slope = self.trust * (self.roof - self.crown) / self.spread**2
        ratio = slope * (value - (self.roof + self.crown) / 2)
        return np.asarray(np.clip(ratio, -most, most), np.float64)


def nothing() -> Separation:
    """The measure tells nothing."""
    return Separation(0.0, 0.0, 1.0, 0.0)


def separation(
    roofs: tuple[float, float, float], crowns: tuple[float, float, float], alike: float
) -> Separation:
    """The separation of a measure by its mean, variance and number of values on either; so many
    values that are `alike` are one observation."""
    (on_roofs, variance_roof, weight_roof), (on_crowns, variance_crown, weight_crown) = roofs, crowns
    if min(weight_roof, weight_crown) < alike:
        return nothing()
    spread = max(1e-3, float(np.sqrt((variance_roof + variance_crown) / 2)))
    distance = on_crowns - on_roofs
    if distance <= 0.0:
        return nothing()
    chance = spread**2 * alike * (1.0 / weight_roof + 1.0 / weight_crown)
    trust = max(0.0, 1.0 - chance / distance**2)
    return Separation(on_roofs, on_crowns, spread, trust)


def separate(value: Values, roof: Values) -> Separation:
    """The separation of values (K,) of cells, of which `roof` (K,) is the probability of each to be a roof.

    Crowns split more pulses and let more of them through than roofs: a measure that is the other way round in
    a scan is no witness there. The cells of a window share its points and are one observation.
    """
    return separation(moments(value, roof), moments(value, 1.0 - roof), WINDOW**2)


@dataclass(frozen=True, eq=False)
class Evidence:
    """Rasters (H, W) over the cells; values mean nothing where `candidate` is False."""

    cells: Cells
    candidate: Mask
    """Cells with at least one point that could be a roof."""
    top: Values
    """Height (m above the terrain's local zero) of the highest candidate point; -inf where there is none."""
    low: Values
    """Height of the highest other point but noise (terrain, and what is low over it); -inf where none is."""
    residual: Values
    """RMSE (m) across the plane of the best of the windows that hold the cell; inf where none fits."""
    east: Values
    north: Values
    level: Values
    """The best window's plane: slopes and its height at the middle of the cell."""
    multi_return_share: Values
    """Share of the window's candidate points whose pulse had several returns; 0 without returns."""
    penetration: Values
    """Share of all points in the window that lie on or near the ground."""
    inner_share: Values
    inner_penetration: Values
    """The least of both in the candidate cells among the three by three about each: a surface is judged by
    its inside."""
    height: Values
    """Mean height (m) of the cell's candidate points over the terrain."""

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the cells."""
        return self.cells.shape

    @cached_property
    def empty(self) -> Mask:
        """The cells (H, W) without points."""
        return np.asarray((self.cells.count == 0).reshape(self.shape))

    @cached_property
    def gaps(self) -> tuple[Labels, int]:
        """Numbers (H, W) of the groups of empty cells that share sides, 0 elsewhere; how many there are."""
        label, count = ndimage.label(self.empty)
        return np.asarray(label), int(count)


def gather_evidence(scene: Scene, xyz: Points, candidate: Mask, side: float, limits: WindowRules) -> Evidence:
    """Evidence on cells of the given side (m).

    `candidate` (N,) marks the points that could be roofs; xyz (N, 3) counts heights from a level near them.
    """
    cells = Cells.of(xyz, side)
    shape, noise, several = cells.shape, scene.cloud.noise, signs_of_leaves(scene.cloud)
    place, sums, height, counts, tops = gather_kernel(
        xyz, cells.cell, candidate, noise, several, scene.height, cells.size
    )
    place, (count, many, under) = place.reshape(shape), counts.reshape(3, *shape)
    slope_east, slope_north, level, residual = best_planes(sums, place, count, cells, limits)
    around, below, seen = window_sum(count), window_sum(under), count > 0
    share, penetration = window_sum(many) / np.maximum(around, 1), below / np.maximum(below + around, 1)
    return Evidence(
        cells=cells,
        candidate=seen,
        top=tops[0].reshape(shape),
        low=tops[1].reshape(shape),
        residual=residual,
        east=slope_east,
        north=slope_north,
        level=level,
        multi_return_share=share,
        penetration=penetration,
        inner_share=least_around_kernel(share, seen),
        inner_penetration=least_around_kernel(penetration, seen),
        height=height.reshape(shape) / np.maximum(count, 1),
    )


@kernel
def gather_kernel(
    xyz: Points,
    cell: Integers,
    candidate: Mask,
    noise: Mask,
    several: Values,
    height: Values,
    size: int,
) -> tuple[Integers, Sums, Values, Values, Values]:
    """What the points (N,) of `size` cells say, each visited once.

    Returns
    -------
    place : ndarray (size,)
        Row of `sums` of each cell with a candidate, -1 of the others.
    sums : ndarray (K, 10)
        The ten sums of the candidates of those cells.
    height : ndarray (size,)
        Sum of their heights over the terrain.
    counts : ndarray (3, size)
        Number of candidates, of those among them whose pulse had several returns, and of other points but
        noise.
    tops : ndarray (2, size)
        The highest candidate and the highest other point but noise; -inf where there is none.
    """
    place, occupied = np.full(size, -1), 0
    total, counts, tops = np.zeros(size), np.zeros((3, size)), np.full((2, size), -np.inf)
    sums = np.empty((min(size, int(candidate.sum())), 10))
    for i in range(len(xyz)):
        here, z = cell[i], xyz[i, 2]
        if candidate[i]:
            if place[here] < 0:
                place[here], sums[occupied] = occupied, 0.0
                occupied += 1
            add_point_kernel(sums[place[here]], xyz[i, 0], xyz[i, 1], z, 1.0)
            total[here] += height[i]
            counts[0, here] += 1.0
            counts[1, here] += several[i]
            tops[0, here] = max(tops[0, here], z)
        elif not noise[i]:
            counts[2, here] += 1.0
            tops[1, here] = max(tops[1, here], z)
    return place, sums[:occupied], total, counts, tops


@kernel
def least_around_kernel(values: Values, mask: Mask) -> Values:
    """The least value of the cells of a mask (H, W) among the three by three around each of them; 0 beside
    the mask."""
    rows, columns = values.shape
    least = np.zeros((rows, columns))
    for row in range(rows):
        for column in range(columns):
            if mask[row, column]:
                least[row, column] = values[row, column]
                for r in range(max(0, row - 1), min(rows, row + 2)):
                    for c in range(max(0, column - 1), min(columns, column + 2)):
                        if mask[r, c] and values[r, c] < least[row, column]:
                            least[row, column] = values[r, c]
    return least


@inlined_kernel
def carried_on(
    level: Values, east: Values, north: Values, side: float, row: int, column: int, down: int, right: int
) -> Any:
    """Height of the plane of a cell, carried on to the middle of the cell so many steps down and right."""
    return level[row, column] + east[row, column] * right * side - north[row, column] * down * side


@inlined_kernel
def missed_by(top: Values, residual: Values, height: float, on_plane: float, row: int, column: int) -> Any:
    """Distance (m) by which a height in another cell misses the surface of a cell: its plane extended, if it
    has one, or its highest point."""
    miss = abs(top[row, column] - height)
    return min(miss, abs(on_plane - height)) if np.isfinite(residual[row, column]) else miss


def groups_of(label: Labels) -> Iterator[tuple[int, tuple[slice, slice], Mask]]:
    """Number, window with a cell more all round, and cells (h, w) in it, of each group 1…K of (H, W)."""
    for number, window in enumerate(ndimage.find_objects(label), 1):
        if window is not None:
            rows, columns = (slice(max(0, one.start - 1), one.stop + 1) for one in window)
            yield number, (rows, columns), label[rows, columns] == number


@dataclass(frozen=True, eq=False)
class Segments:
    """Surfaces 1…K: `label` (H, W), 0 for none; everything else is (K,)."""

    label: Labels
    area: Values
    """m²"""
    width: Values
    """Side (m) of about the largest square that fits inside."""
    residual: Values
    """Mean RMSE (m) of its cells' planes."""
    multi_return_share: Values
    penetration: Values
    """Means of the cells' evidence."""
    height: Values
    """Mean height over the terrain (m)."""
    tall: Values
    """Share of its cells that are at least `tall_height` over the terrain."""

    @property
    def count(self) -> int:
        """Number of segments."""
        return len(self.area)


def find_segments(evidence: Evidence, smooth: Mask, max_gap: float, tall_height: float) -> Segments:
    """Connected groups of `smooth` cells (H, W) whose planes differ by less than `max_gap` at both."""
    side = evidence.cells.side
    label, count = groups_kernel(smooth, evidence.level, evidence.east, evidence.north, side, max_gap)
    cells = np.flatnonzero(label)
    number = label.ravel()[cells]

    def mean(values: Values | Mask) -> Values:
        return mean_in(number, count, values.ravel()[cells])

    return Segments(
        label=label,
        area=np.asarray(np.bincount(number, minlength=count + 1)[1:] * (side * side), np.float64),
        width=inner_width(label, count) * side,
        residual=mean(evidence.residual),
        multi_return_share=mean(evidence.inner_share),
        penetration=mean(evidence.inner_penetration),
        height=mean(evidence.height),
        tall=mean(evidence.height >= tall_height),
    )


@kernel
def groups_kernel(
    smooth: Mask, level: Values, east: Values, north: Values, side: float, max_gap: float
) -> tuple[Labels, int]:
    """Numbers (H, W), 0 for none, of the groups of `find_segments` in the order of their first cells, and how
    many there are; the planes (H, W) are those of `Evidence`."""
    rows, columns = smooth.shape
    head, label, count = np.arange(rows * columns), np.zeros((rows, columns), np.int32), 0
    for row in range(rows):
        for column in range(columns):
            for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
                y, x = row + down, column + right
                if y < rows and 0 <= x < columns and smooth[row, column] and smooth[y, x]:
                    there = carried_on(level, east, north, side, row, column, down, right) - level[y, x]
                    back = carried_on(level, east, north, side, y, x, -down, -right) - level[row, column]
                    if max(abs(there), abs(back)) < max_gap:
                        unite_kernel(head, row * columns + column, y * columns + x)
    for cell in range(rows * columns):
        row, column = cell // columns, cell % columns
        if smooth[row, column] and head[cell] == cell:
            count += 1
            label[row, column] = count
        elif smooth[row, column]:  # the head of a cell comes before it, and bears its number already
            label[row, column] = label[head[cell] // columns, head[cell] % columns]
    return label, count


def inner_width(label: Labels, count: int) -> Values:
    """Side (cells), an odd number, of the largest square with a middle cell in each segment 1…`count`."""
    width = np.zeros(count + 1)
    if count:
        border = np.zeros(label.shape, bool)
        padded = np.pad(label, 1)
        for row, column in ((0, 1), (2, 1), (1, 0), (1, 2)):
            border |= padded[row : row + label.shape[0], column : column + label.shape[1]] != label
        inside = (label > 0) & ~border
        distance = ndimage.distance_transform_cdt(inside, metric="chessboard")
        some = np.flatnonzero(label)
        np.maximum.at(width, label.ravel()[some], 2.0 * distance.ravel()[some] + 1.0)
    return width[1:]
