"""Moments of a triangulated surface, and the closed solutions for the house under it [maas_vosselman1999]."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eaves.model import Points

SQUARISH = 1.2
"""Length over width under which the axes of inertia are too vague to give the orientation."""

DIRECTED = 0.3
"""Difference of the height tensor's eigenvalues, as a share of their sum, from which it has a direction."""


def triangle_rule() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Shares (9, 3) of a triangle's corners and weights (9,): Gauss and Legendre's rule of three points each
    way, the square folded onto the triangle, is exact for polynomials of degree 4."""
    place, weight = np.polynomial.legendre.leggauss(3)
    u, v = np.meshgrid(0.5 + 0.5 * place, 0.5 + 0.5 * place, indexing="ij")
    shares = np.stack([1.0 - u, u - u * v, u * v], axis=-1)
    return shares.reshape(-1, 3), 0.5 * (u * np.outer(weight, weight)).ravel()


RULE, WEIGHTS = triangle_rule()


@dataclass(frozen=True)
class SurfaceMoments:
    """Central moments of order 0 to 2 of an area, plain and weighted with height, each divided by the area.

    `xx, xy, yy` are the second moments (m²), `hx, hy` and `hxx, hxy, hyy` those weighted with the height
    above the mean height (m², m³); `real` and `imaginary` are the fourth moment of x + iy, which turns with
    four times the angle and tells the axes of a square.
    """

    area: float
    x: float
    y: float
    height: float
    xx: float
    xy: float
    yy: float
    hx: float
    hy: float
    hxx: float
    hxy: float
    hyy: float
    real: float
    imaginary: float


def surface_moments(xyz: Points, triangles: NDArray[np.int32]) -> SurfaceMoments:
    """The moments of the surface of triangles (T, 3) over points (N, 3).

    Integrals over triangles, unlike sums over points, do not follow the density of the points.
    """
    corners = xyz[triangles]
    (ux, uy), (vx, vy) = ((corners[:, k, :2] - corners[:, 0, :2]).T for k in (1, 2))
    area = 0.5 * np.abs(ux * vy - vx * uy)
    whole = float(area.sum())
    if whole <= 0.0:
        return SurfaceMoments(*np.zeros(14).tolist())
    mean = (area[:, None] * corners.mean(axis=1)).sum(axis=0) / whole
    x, y, h = np.moveaxis(np.einsum("qk,tkd->tqd", RULE, corners) - mean, -1, 0)
    weight = area[:, None] * WEIGHTS / whole
    xx, xy, yy = x * x, x * y, y * y
    fourth = (xx * xx - 6.0 * xx * yy + yy * yy, 4.0 * xy * (xx - yy))
    integrals = (xx, xy, yy, h * x, h * y, h * xx, h * xy, h * yy, *fourth)
    return SurfaceMoments(whole, *mean.tolist(), *(float((weight * one).sum()) for one in integrals))


@dataclass(frozen=True)
class ClosedForm:
    """A house straight from moments: roof type, place, ridge orientation (radians), sizes and heights (m).

    `length` runs along the ridge, `width` across. `rise` is Δ, ridge above eaves; for a shed its sign is
    that of the fall across. `rise_along` and `rise_across` are Δu and Δv of the formulas, `tilt` the shed's
    Δ.
    """

    roof: str
    x: float
    y: float
    orientation: float
    length: float
    width: float
    eaves: float
    rise: float
    rise_along: float
    rise_across: float
    tilt: float

    @property
    def ridge(self) -> float:
        """Height (m) of the ridge."""
        return self.eaves + abs(self.rise)

    @property
    def slope(self) -> float:
        """Radians from the horizontal."""
        run = self.width if self.roof in ("flat", "shed") else 0.5 * self.width
        return float(np.arctan2(abs(self.rise), run))


def closed_form(moments: SurfaceMoments, level: float, growth: float = 1.0) -> ClosedForm:
    """The closed solution for a flat, shed, gable, hip or pyramid roof; rises under `level` (m) are flat.

    `growth` is the ratio of the house's length and width to those of the area of its points: rises grow
    with it, and the middle of the roof stays.
    """
    angle = axis_angle(moments, level)
    along, across = turned(angle, moments.xx, moments.xy, moments.yy)
    high_along, high_across = turned(angle, moments.hxx, moments.hxy, moments.hyy)
    length, width = float(np.sqrt(12.0 * max(along, 1e-12))), float(np.sqrt(12.0 * max(across, 1e-12)))
    rise_along, rise_across = -48.0 * high_along / length**2, -48.0 * high_across / width**2
    cosine, sine = np.cos(angle), np.sin(angle)
    tilt_along = 12.0 * (cosine * moments.hx + sine * moments.hy) / length
    tilt_across = 12.0 * (cosine * moments.hy - sine * moments.hx) / width
    tilted = max(abs(tilt_along), abs(tilt_across)) > max(abs(rise_along), abs(rise_across))
    if (abs(tilt_along) > abs(tilt_across)) if tilted else (rise_along > rise_across):
        angle += np.pi / 2.0
        length, width = width, length
        rise_along, rise_across = rise_across, rise_along
        tilt_along, tilt_across = tilt_across, -tilt_along
    mean = moments.height
    if tilted and abs(tilt_across) > level:
        roof, rise, eaves = "shed", tilt_across, mean - abs(tilt_across) / 2.0
    elif rise_across <= level:
        roof, rise, eaves = "flat", 0.0, mean
    else:
        roof, rise, eaves = closed_ridge(length, width, rise_along, rise_across, mean)
    top = eaves + abs(rise)
    if roof == "shed":
        eaves -= 0.5 * (growth - 1.0) * abs(rise)
    else:
        eaves = top - growth * abs(rise)
    return ClosedForm(
        roof,
        moments.x,
        moments.y,
        float(np.mod(angle, np.pi)),
        length * growth,
        width * growth,
        float(eaves),
        float(rise * growth),
        float(rise_along),
        float(rise_across),
        float(tilt_across),
    )


def border_growth(count: int) -> float:
    """Ratio of a rectangle's sides to those of the hull of `count` points spread over it at random.

    The hull of n points in a polygon of r corners loses the share 2r/3 · ln n / n of its area
    [renyi_sulanke1963].
    """
    lost = 8.0 / 3.0 * float(np.log(max(count, 2))) / max(count, 2)
    return float(np.sqrt(1.0 / max(1.0 - lost, 0.25)))


def closed_ridge(
    length: float, width: float, rise_along: float, rise_across: float, mean: float
) -> tuple[str, float, float]:
    """Roof type, Δ and eaves of a gable, hip or pyramid from Δu, Δv and the mean height h̄ (m).

    A hip of equal slopes has Δu between none (gable) and that of its length and width; half-way between
    decides.
    """
    share = min(width / length, 1.0)
    hip_across = 1.0 - 7.0 / 15.0 * share
    hip_along = share * (20.0 - 15.0 * share + 3.0 * share**2) / 15.0
    if length < width / SQUARISH or rise_along < 0.5 * rise_across * hip_along / hip_across:
        return "gable", rise_across, mean - rise_across / 2.0
    rise = (rise_along + rise_across) / (hip_along + hip_across)
    roof = "pyramid" if length < SQUARISH * width else "hip"
    return roof, rise, mean - rise * (0.5 - share / 6.0)


def axis_angle(moments: SurfaceMoments, level: float) -> float:
    """Direction (radians) of the rectangle's axes: by inertia, or for squarish ones by the heights.

    The axes of the height tensor are a ridge's, the tilt falls across a shed, and where the heights say
    nothing (rises under `level`, m) or are the same all around, the fourth moment has the symmetry of a
    square.
    """
    angle, large, small = principal_axis(moments.xx, moments.xy, moments.yy)
    if large >= SQUARISH**2 * small:
        return angle
    size = float(np.sqrt(12.0 * large))
    if 12.0 * np.hypot(moments.hx, moments.hy) > level * size:
        return float(np.arctan2(moments.hy, moments.hx))
    tall, first, second = principal_axis(moments.hxx, moments.hxy, moments.hyy)
    sizes = abs(first), abs(second)
    if 48.0 * max(sizes) > level * size**2 and abs(first - second) > DIRECTED * sum(sizes):
        return tall
    # ∫(x + iy)⁴ of a square along the axes is real and negative
    return float(np.arctan2(-moments.imaginary, -moments.real)) / 4.0


def principal_axis(xx: float, xy: float, yy: float) -> tuple[float, float, float]:
    """Angle (radians) of the axis of the larger eigenvalue of a symmetric tensor, and both eigenvalues."""
    half, middle = float(np.hypot(0.5 * (xx - yy), xy)), 0.5 * (xx + yy)
    return 0.5 * float(np.arctan2(2.0 * xy, xx - yy)), middle + half, middle - half


def turned(angle: float, xx: float, xy: float, yy: float) -> tuple[float, float]:
    """The tensor's values along the direction `angle` (radians) and across it."""
    cosine, sine = np.cos(angle), np.sin(angle)
    along = cosine * cosine * xx + 2.0 * cosine * sine * xy + sine * sine * yy
    return float(along), float(xx + yy - along)
