"""Obstacles before the sky: horizons in all directions from places on roofs, and how much sky is left."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.kernels import kernel
from eaves.model import Integers, Raster, Values

PATCH = 8
"""Cells a side of the patches whose highest cell is known, so that rays pass over low ground in strides."""


def horizons(
    dsm: Raster,
    face_at: NDArray[np.int32],
    xyz: Values,
    own: int,
    plane: Values,
    directions: int,
    reach: float,
    clearance: float,
) -> NDArray[np.float32]:
    """Tangent of the horizon's elevation (N, K) at every place in K directions, clockwise from grid north.

    A cell stands in the way at the distance of the middle of the ray's way through it. Cells of the places'
    own face do only where they rise more than `clearance` over its plane: the rest is the scan's noise.

    Parameters
    ----------
    dsm : Raster
        Surface (H, W) with all that stands, roofs and crowns; NaN is nothing.
    face_at : ndarray (H, W)
        Number of the roof face at each cell, 0 for none.
    xyz : ndarray (N, 3)
        Where to look from, in the raster's coordinates.
    own : int
        Number of the roof face on which the places are.
    plane : ndarray (3,)
        Its plane z = a·x + b·y + c.
    directions : int
        K.
    reach : float
        Distance (m) up to which is looked.
    clearance : float
        Height (m).
    """
    values = np.ascontiguousarray(dsm.values, np.float32)
    return np.asarray(
        horizons_kernel(
            values,
            highest_of_patches(values),
            np.ascontiguousarray(face_at, np.int32),
            dsm.west,
            dsm.north,
            dsm.cell,
            np.ascontiguousarray(xyz, np.float64),
            own,
            np.ascontiguousarray(plane, np.float64),
            directions,
            reach,
            clearance,
        )
    )


def highest_of_patches(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """The highest value in each patch of `PATCH` × `PATCH` cells; −inf where there is none."""
    rows, columns = values.shape
    padded = np.full((-(-rows // PATCH) * PATCH, -(-columns // PATCH) * PATCH), -np.inf, np.float32)
    padded[:rows, :columns] = np.where(np.isnan(values), -np.inf, values)
    shape = (padded.shape[0] // PATCH, PATCH, padded.shape[1] // PATCH, PATCH)
    return np.asarray(padded.reshape(shape).max(axis=(1, 3)))


@kernel
def way_out(x: float, y: float, dx: float, dy: float, west: float, south: float, side: float) -> float:
    """Distance from a place in a square to its rim along a direction."""
    along_x, along_y = np.inf, np.inf
    if dx > 0.0:
        along_x = (west + side - x) / dx
    elif dx < 0.0:
        along_x = (west - x) / dx
    if dy > 0.0:
        along_y = (south + side - y) / dy
    elif dy < 0.0:
        along_y = (south - y) / dy
    return max(min(along_x, along_y), 0.0)


@kernel
def horizons_kernel(
    values: NDArray[np.float32],
    highest: NDArray[np.float32],
    face_at: NDArray[np.int32],
    west: float,
    north: float,
    cell: float,
    xyz: Values,
    own: int,
    plane: Values,
    directions: int,
    reach: float,
    clearance: float,
) -> NDArray[np.float32]:
    """`horizons`, place by place."""
    rows, columns = values.shape
    a, b, c = plane[0], plane[1], plane[2]
    rise = clearance + 0.5 * cell * (abs(a) + abs(b))
    found = np.zeros((len(xyz), directions), np.float32)
    nudge = 1e-6 * cell
    for i in range(len(xyz)):
        x0, y0, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        for k in range(directions):
            turn = 2.0 * np.pi * k / directions
            dx, dy = np.sin(turn), np.cos(turn)
            best, far, first = 0.0, 0.0, True
            while far < reach:
                x, y = x0 + dx * (far + nudge), y0 + dy * (far + nudge)
                column, row = int(np.floor((x - west) / cell)), int(np.floor((north - y) / cell))
                if column < 0 or row < 0 or column >= columns or row >= rows:
                    break
                if not first:
                    low, left = row // PATCH, column // PATCH
                    if highest[low, left] - z <= best * far:
                        side = PATCH * cell
                        corner = north - (low + 1) * side
                        far += nudge + way_out(x, y, dx, dy, west + left * side, corner, side)
                        continue
                out = (
                    far + nudge + way_out(x, y, dx, dy, west + column * cell, north - (row + 1) * cell, cell)
                )
                h = values[row, column]
                if not first and not np.isnan(h):
                    counts = True
                    if face_at[row, column] == own:
                        middle_x, middle_y = west + (column + 0.5) * cell, north - (row + 0.5) * cell
                        counts = h > a * middle_x + b * middle_y + c + rise
                    slope = (h - z) / (0.5 * (far + out))
                    if counts and slope > best:
                        best = slope
                far, first = out, False
            found[i, k] = best
    return found


def sky_shares(horizon: NDArray[np.float32], normal: Values) -> Values:
    """Share (N,) of an even sky's light that reaches planes of one normal (3,), above horizons (N, K).

    The integral of the cosine of incidence over the sky that is seen, in closed form along each direction,
    over that of the whole sky; of a tilted plane in the open it is (1 + cos tilt) / 2.
    """
    count = horizon.shape[1]
    turn = 2.0 * np.pi * np.arange(count) / count
    across = normal[0] * np.sin(turn) + normal[1] * np.cos(turn)
    own = np.arctan2(-across, max(float(normal[2]), 1e-9))  # where the plane itself ends the sky
    low = np.maximum(np.arctan(horizon), np.maximum(own, 0.0))
    upper = 0.5 * normal[2] * np.cos(low) ** 2
    side = across * (0.5 * (0.5 * np.pi - low) - 0.25 * np.sin(2.0 * low))
    return np.asarray(2.0 * (upper + side).mean(axis=1))


def lit_light(
    horizon: NDArray[np.float32], azimuth: Values, elevation: Values, light: Values, month: Integers
) -> Values:
    """The sum (N, 12) by month of the light (H,) of those hours in which the sun stands above the horizon.

    `azimuth` (H,) is clockwise from grid north, as the horizon's directions are.
    """
    return np.asarray(
        lit_light_kernel(
            np.ascontiguousarray(horizon.T, np.float32),
            np.ascontiguousarray(azimuth % 360.0),
            np.tan(np.radians(np.minimum(elevation, 89.9))),
            np.ascontiguousarray(light),
            np.ascontiguousarray(month),
        ).T
    )


@kernel
def lit_light_kernel(
    horizon: NDArray[np.float32],
    azimuth: Values,
    tangent: Values,
    light: Values,
    month: Integers,
) -> Values:
    """`lit_light` of horizons (K, N); between two directions their tangent is linear."""
    directions, places = horizon.shape
    total = np.zeros((12, places))
    for j in range(len(light)):
        if light[j] <= 0.0:
            continue
        turn = azimuth[j] / 360.0 * directions
        one = int(turn) % directions
        share = turn - np.floor(turn)
        other = (one + 1) % directions
        for i in range(places):
            if tangent[j] > horizon[one, i] * (1.0 - share) + horizon[other, i] * share:
                total[month[j], i] += light[j]
    return total
