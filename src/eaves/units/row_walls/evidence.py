"""The signs of a party wall along a line across a row, in the points on both sides of it.

Every sign is a continuous function of the points: they count for the nodes around them by their nearness, and
what they show passes from one side of a limit to the other; and it is the mean over four places of the steps
and lines. So neither where a row begins nor a millimetre decides.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from eaves.detect.toolkit.cells import Cells
from eaves.geometry.planes import CALM_QUANTILE, fit_planes, measure_noise, sums_of
from eaves.kernels import kernel
from eaves.model import Points, Values
from eaves.units.row_walls.rows import CELL_M, HouseRow

DEPTH_STEP_M = 0.5
"""Points are compared across a wall at each half metre of its length, in lines that overlap by as much."""

WINDOW_M = 2.0
"""Width of the ground on either side that is compared: half of a narrow house."""

FEWEST = 3
"""Fewer points on one side of a metre say nothing of it."""

WIDE = 3
"""Steps left out beside a wall where the points next to it lie on no plane: gutters, shadows; else one."""

CROSSING_M = 0.6
"""Planes that cross this near (m) to a place meet there in a fold and make no step."""

RISE_M = 0.25
"""What stands so much over both roofs is a fire wall or a chimney: more than tiles and noise."""

FEW = 0.03
"""A share of points that rise, of a line and of what is around it, that is small: a chimney on a wall."""

AROUND_M = 4.0
"""Ground (m) on either side of a line, half a wide house, whose mean a wall must stand out from: chimneys and
plant all over a roof, or tiles of many colours, are no wall."""

LEAST_WEIGHT = 1e-6
"""What weighs less than this says nothing of a wall."""

LEAST_REMAINDER = 0.001
"""Share of a side that further windows are not asked about."""

LEAST_SPREAD = 0.003
"""Variance (m²) of points along a direction, added to theirs: if they have no more they show no slope."""

PLACEMENTS = ((-0.375, 0.0), (0.375, 0.0), (-0.125, 0.5), (0.125, 0.5))
"""Parts of a step and of a line by which they are moved, along and across the row: signs are the mean over
all, for what a row shows depends neither on where it begins nor on the end that it is counted from.
"""

PATCH_M = 1.5
"""Side of the squares in which the noise of the roofs is measured: most of them lie on one plane."""

PATCH_POINTS = 6
"""Squares with fewer points do not measure it."""

USUAL_NOISE_M = 0.03
"""Noise of the scans that the weights were learned on. Roofs of tiles and gutters are no flatter: a scan of
less noise is judged as one of this, and so is one that no square has points enough to measure.
"""


@dataclass(frozen=True, eq=False)
class Roofs:
    """The roof points (N, 3) of a block, their noise (m), and where they are known the logarithms (N,) of
    their intensities."""

    points: Points
    noise: float
    reflectance: Values | None = None

    @classmethod
    def of(cls, points: Points, intensity: Values | None = None) -> Roofs:
        """The roofs of points (N, 3) with intensities (N,); of one value alone they say nothing."""
        if intensity is None or np.ptp(intensity) == 0.0:
            return cls(points, roof_noise(points))
        return cls(points, roof_noise(points), np.log(np.maximum(intensity, 1.0)))

    def wall_odds(self, row: HouseRow) -> tuple[Values, Values]:
        """Log-odds (S + 1,) of a party wall at each step along a row, and those by signs of shape alone."""
        traits = traits_of(wall_signs(row, self.points, self.noise, self.reflectance))
        weights = np.array(list(WEIGHTS.values()))
        return traits @ weights, traits[:, :SHAPE_SIGNS] @ weights[:SHAPE_SIGNS]


def roof_noise(points: Points) -> float:
    """Standard deviation (m) in height of points (N, 3) about their roofs, from planes in small squares; at
    least `USUAL_NOISE_M`.
    """
    cells = Cells.of(points, PATCH_M, margin=0)
    full = np.flatnonzero(cells.count >= PATCH_POINTS)
    if not len(full):
        return USUAL_NOISE_M
    local = points - np.floor(points.min(axis=0))
    _, normal, rmse = fit_planes(sums_of(local, cells.cell, cells.size)[full])
    upright = np.maximum(normal[:, 2], np.finfo(np.float64).tiny)  # a wall alone: far from calm
    measured = measure_noise((rmse / upright) ** 2, cells.count[full], CALM_QUANTILE)
    return max(measured, USUAL_NOISE_M)


def wall_signs(row: HouseRow, points: Points, noise: float, reflectance: Values | None = None) -> Values:
    """The signs (S + 1, 5) of a wall at each step along the row, from its roof points (N, 3): the share
    of its depth that steps, the mean folds (slopes) of valleys and of ridges, the share of points at the line
    that rise over both roofs, and how much the `reflectance` (N,; logarithms of intensity) of the two roofs
    differs, in multiples of its own noise, as a logarithm; means over `PLACEMENTS`.
    """
    s, t = row.coordinates(points[:, :2])
    filled = row.last > row.first
    nearest = float(row.first[filled].min()) - DEPTH_STEP_M
    signs = np.zeros((len(row.first) + 1, 6))
    seen = np.zeros(len(points)) if reflectance is None else reflectance
    for along, across in PLACEMENTS:
        low = nearest - across * DEPTH_STEP_M
        depths = int((row.last.max() - low) / DEPTH_STEP_M) + 2
        line = low + np.arange(depths) * DEPTH_STEP_M
        place = s - along * CELL_M
        moments = moments_kernel(place, t - low, points[:, 2], seen, depths, len(row.first))
        within = np.minimum(line[:, None] - row.first, row.last - line[:, None]) / DEPTH_STEP_M + 0.5
        found, planes = signs_kernel(moments, np.clip(within, 0.0, 1.0), round(WINDOW_M / CELL_M), noise)
        found[:, 3] = rise_kernel(place, t - low, points[:, 2], planes)
        signs += found
    signs /= len(PLACEMENTS)
    contrast = np.full(len(signs), EVEN)
    if reflectance is not None:
        contrast = np.log(np.maximum(signs[:, 4], np.exp(EVEN) * LEAST_WEIGHT))
        contrast -= np.log(np.maximum(signs[:, 5], LEAST_WEIGHT))
    return np.column_stack([signs[:, :4], np.where(signs[:, 5] > LEAST_WEIGHT, contrast, EVEN)])


EVEN = 1.3
"""Contrast of a place without two roofs to compare: usual lines of the towns of `benchmarks.accuracy.walls`
have between 0.9 and 1.8."""

WEIGHTS = {
    "one": -4.7,
    "share": 6.13,
    "ridge": -12.59,
    "full valley": 3.03,
    "rise": 2.5,
    "contrast": 1.4,
}
"""Of the traits in the log-odds of a wall; learned by `python -m benchmarks.accuracy.unit_weights` on drawn
towns, those of rise and contrast upon them by `python -m benchmarks.accuracy.walls` on two real ones."""

SHAPE_SIGNS = 4
"""The first weights: of the shape of two roofs, by which a block is judged as a whole (`odds_of_several`); a
palace has towers and plant that rise over its roofs, too."""


def traits_of(signs: Values) -> Values:
    """The columns (S + 1, K) that `WEIGHTS` weigh, from the signs (S + 1, 5) of a whole row: rises and
    contrast count by how much they are more than the mean around each step.
    """
    share, valley, ridge, rise, contrast = signs.T
    full = np.clip(2.0 * valley - 0.5, 0.0, 1.0)
    line = np.column_stack([rise + FEW, np.clip(contrast, 0.0, 4.0)])
    around = ndimage.uniform_filter1d(line, 2 * round(AROUND_M / CELL_M) + 1, axis=0, mode="nearest")
    return np.column_stack(
        [
            np.ones(len(signs)),
            share,
            np.minimum(ridge, 0.6),
            full,
            np.log(line[:, 0] / around[:, 0]),
            line[:, 1] - around[:, 1],
        ]
    )


@kernel
def moments_kernel(
    s: Values,
    t: Values,
    z: Values,
    reflectance: Values,
    depths: int,
    steps: int,
) -> Values:
    """Running sums (D, S + 1, 12) of 1, s, t, s², s t, t², z, s z, t z, z² and of the reflectance and its
    square along each of D lines of S steps.

    A point counts for the four nearest nodes by its nearness to each, so that it passes from one to the next
    as it moves; a line then takes half of those beside it. t counts from the first line.
    """
    cells = np.zeros((depths, steps + 1, 12))
    for k in range(len(s)):
        place, depth = s[k] / CELL_M - 0.5, t[k] / DEPTH_STEP_M
        left, under = int(np.floor(place)), int(np.floor(depth))
        for i in range(under, under + 2):
            for j in range(left, left + 2):
                if i < 0 or i >= depths or j < 0 or j >= steps:
                    continue
                weight = (1.0 - abs(depth - i)) * (1.0 - abs(place - j))
                node = cells[i, j + 1]
                node[0] += weight
                node[1] += weight * s[k]
                node[2] += weight * t[k]
                node[3] += weight * s[k] * s[k]
                node[4] += weight * s[k] * t[k]
                node[5] += weight * t[k] * t[k]
                node[6] += weight * z[k]
                node[7] += weight * s[k] * z[k]
                node[8] += weight * t[k] * z[k]
                node[9] += weight * z[k] * z[k]
                node[10] += weight * reflectance[k]
                node[11] += weight * reflectance[k] * reflectance[k]
    for j in range(steps):
        cells[:, j + 1] += cells[:, j]
    before = np.zeros_like(cells[0])
    for i in range(depths):  # in place: of a row of a kilometre they take megabytes
        here = cells[i].copy()
        cells[i] += 0.5 * before
        if i + 1 < depths:
            cells[i] += 0.5 * cells[i + 1]
        before = here
    return cells


@kernel
def side_kernel(
    sums: Values, at: int, way: int, room: int, s0: float, t0: float, noise: float
) -> tuple[float, float, float, float, float, float, float]:
    """Planarity (0 to 1) of the points beside step `at` of a line (`sums` (S + 1, 12)), on the side `way`;
    how many they are, the height of their plane at (s0, t0), its slopes along and across the row, the mean of
    their reflectance and its variance.

    Three windows, at most `room` steps wide, and the same farther away: each takes of what those before it
    left as much as its points lie on a plane.
    """
    remainder, count, height, slope, fall, shine, spread = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for attempt in range(6):
        if remainder < LEAST_REMAINDER:
            break
        width, gap = room >> (attempt % 3), 1 if attempt < 3 else WIDE
        low, high = (at - gap - width, at - gap) if way < 0 else (at + gap, at + gap + width)
        low, high = max(low, 0), min(high, len(sums) - 1)
        if low >= high:
            continue
        q = sums[high] - sums[low]
        n = q[0]
        enough = min(max((n - 0.5 * FEWEST) / FEWEST, 0.0), 1.0)
        if enough == 0.0:
            continue
        s, t, z = q[1] / n, q[2] / n, q[6] / n
        ss, st, tt = q[3] / n - s * s, q[4] / n - s * t, q[5] / n - t * t
        sz, tz, zz = q[7] / n - s * z, q[8] / n - t * z, q[9] / n - z * z
        ss, tt = ss + LEAST_SPREAD, tt + LEAST_SPREAD
        determinant = ss * tt - st * st
        east, north = (sz * tt - tz * st) / determinant, (tz * ss - sz * st) / determinant
        off = max(zz - east * sz - north * tz, 0.0) / (noise * noise)
        weight = remainder * enough / (1.0 + off**4)
        remainder -= weight
        count += weight * n
        height += weight * (z + east * (s0 - s) + north * (t0 - t))
        slope += weight * east
        fall += weight * north
        shine += weight * q[10] / n
        spread += weight * max(q[11] / n - (q[10] / n) ** 2, 0.0)
    flat = 1.0 - remainder
    if flat < 1e-6:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    return flat, count / flat, height / flat, slope / flat, fall / flat, shine / flat, spread / flat


@kernel
def signs_kernel(sums: Values, ground: Values, window: int, noise: float) -> tuple[Values, Values]:
    """The signs (S + 1, 6) at each of S + 1 steps, of reflectance the squares of the differences and what
    noise makes of them; and the planes (D, S + 1, 7) on the two sides of each node of the lines: weight, then
    height and slopes of each.
    """
    depths, steps = ground.shape
    signs, planes = np.zeros((steps + 1, 6)), np.zeros((depths, steps + 1, 7))
    straight = 2.0 * noise + 0.03
    for j in range(1, steps):
        place = j * CELL_M
        total = 0.0
        for i in range(depths):
            here = min(ground[i, j - 1], ground[i, j])
            if here == 0.0:
                continue
            depth = DEPTH_STEP_M * i
            good, n, before, rise, north, bright, bright_spread = side_kernel(
                sums[i], j, -1, window, place, depth, straight
            )
            if here * good < LEAST_WEIGHT:
                continue
            fine, m, after, fall, south, dark, dark_spread = side_kernel(
                sums[i], j, 1, window, place, depth, straight
            )
            weight = here * good * fine
            if weight < LEAST_WEIGHT:
                continue
            total += weight
            planes[i, j, 0] = weight
            planes[i, j, 1:4] = before, rise, north
            planes[i, j, 4:] = after, fall, south
            jump = abs(after - before)
            fold = min(max(fall - rise, -1.5), 1.5)
            crossing = (CROSSING_M * abs(fold)) ** 4
            jump *= jump**4 / (jump**4 + crossing + 1e-9)
            least = max(3.0 * noise * np.sqrt(4.0 / n + 4.0 / m), 0.08)
            signs[j, 0] += weight / (1.0 + (least / max(jump, 1e-3)) ** 8)
            signs[j, 4] += weight * (dark - bright) ** 2
            signs[j, 5] += weight * (bright_spread / n + dark_spread / m)
            weight /= 1.0 + (jump / 0.5) ** 8
            if fold > 0.0:
                signs[j, 1] += weight * fold
            else:
                signs[j, 2] -= weight * fold
        signs[j] /= total + 0.5
    return signs, planes


@kernel
def rise_kernel(s: Values, t: Values, z: Values, planes: Values) -> Values:
    """The share (S + 1,) of the points beside each step that rise over the planes (D, S + 1, 7) of both
    sides; a point counts for the steps and lines around it by its nearness.
    """
    depths, steps = planes.shape[:2]
    sums = np.zeros((steps, 2))
    for k in range(len(s)):
        place, depth = s[k] / CELL_M, t[k] / DEPTH_STEP_M
        for i in range(max(int(np.floor(depth)), 0), min(int(np.floor(depth)) + 2, depths)):
            for j in range(max(int(place) - 1, 1), min(int(place) + 3, steps)):
                near = (1.0 - 0.5 * abs(place - j)) * (1.0 - abs(depth - i)) * planes[i, j, 0]
                if near < LEAST_WEIGHT:
                    continue
                x, y, p = s[k] - j * CELL_M, t[k] - i * DEPTH_STEP_M, planes[i, j]
                over = z[k] - max(p[1] + p[2] * x + p[3] * y, p[4] + p[5] * x + p[6] * y)
                sums[j, 0] += near
                sums[j, 1] += near / (1.0 + (RISE_M / max(over, 1e-3)) ** 8)
    return sums[:, 1] / (sums[:, 0] + 0.5)
