"""The parametric roof: its height anywhere, and its robust least-squares fit to points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from eaves.model import Points, Values

ANGLE, ALONG, ACROSS, TOP, LEFT_SLOPE, RIGHT_SLOPE, END_SLOPE, HALF_RIDGE = range(8)
"""Parameters: the ridge's angle (radians), middle along, across, height (m), slopes, half its length."""

PLANE, GABLE, HIP = range(3)
"""Forms: one plane (of END_SLOPE along and LEFT_SLOPE across), two planes, four planes."""

FREE: dict[int, tuple[tuple[int, ...], ...]] = {
    PLANE: ((TOP,), (LEFT_SLOPE,), (END_SLOPE,)),
    GABLE: ((ANGLE,), (ACROSS,), (TOP,), (LEFT_SLOPE,), (RIGHT_SLOPE,)),
    HIP: ((ANGLE,), (ALONG,), (ACROSS,), (TOP,), (LEFT_SLOPE, RIGHT_SLOPE), (END_SLOPE,), (HALF_RIDGE,)),
}
"""The free parameters of each form; those in one bracket move together."""


def matrix_of(groups: tuple[tuple[int, ...], ...]) -> NDArray[np.float64]:
    """Matrix (8, k) of what each free number adds to the parameters."""
    return np.stack([np.isin(np.arange(8), group) for group in groups], axis=1).astype(np.float64)


GROUPS = {form: matrix_of(groups) for form, groups in FREE.items()}
"""The same as matrices (8, k)."""

CUT = 3.0
"""Distance, in standard deviations, at which a point's weight has fallen to a quarter."""

ROUNDS = 25
"""Gauss–Newton steps at most; ten are usual."""

SETTLED = 0.01
"""Share of the residuals' scale that a last step moves no height by."""


def roof_heights(
    form: int, p: NDArray[np.float64], xy: NDArray[np.float64]
) -> tuple[Values, NDArray[np.float64]]:
    """Heights (N,) of the roof of parameters (8,) at (N, 2 or 3), and their derivatives (N, 8)."""
    cosine, sine = np.cos(p[ANGLE]), np.sin(p[ANGLE])
    u, v = cosine * xy[:, 0] + sine * xy[:, 1], cosine * xy[:, 1] - sine * xy[:, 0]
    slopes = np.zeros((len(xy), 8))
    slopes[:, TOP] = 1.0
    if form == PLANE:
        slopes[:, LEFT_SLOPE], slopes[:, END_SLOPE] = -v, u
        slopes[:, ANGLE] = p[END_SLOPE] * v + p[LEFT_SLOPE] * u
        return p[TOP] + p[END_SLOPE] * u - p[LEFT_SLOPE] * v, slopes
    across = v - p[ACROSS]
    left = across >= 0.0
    fall = np.where(left, p[LEFT_SLOPE], -p[RIGHT_SLOPE])
    drop = fall * across
    slopes[:, LEFT_SLOPE], slopes[:, RIGHT_SLOPE] = -across * left, across * ~left
    slopes[:, ACROSS], slopes[:, ANGLE] = fall, fall * u
    if form == HIP:
        along, way = u - p[ALONG], np.where(u >= p[ALONG], p[END_SLOPE], -p[END_SLOPE])
        beyond = np.abs(along) - p[HALF_RIDGE]
        at_end = p[END_SLOPE] * beyond > drop
        drop = np.where(at_end, p[END_SLOPE] * beyond, drop)
        slopes[at_end] = 0.0
        slopes[at_end, TOP], slopes[at_end, HALF_RIDGE] = 1.0, p[END_SLOPE]
        slopes[at_end, END_SLOPE], slopes[at_end, ALONG] = -beyond[at_end], way[at_end]
        slopes[at_end, ANGLE] = -(way * v)[at_end]
    return p[TOP] - drop, slopes


@dataclass(frozen=True, eq=False)
class ParametricFit:
    """A form, its parameters (8,) about `centre` (2,), residuals (N,) and the fit's covariance (8, 8)."""

    form: int
    centre: NDArray[np.float64]
    parameters: NDArray[np.float64]
    residuals: Values
    covariance: NDArray[np.float64]
    scale: float

    def height_at(self, xy: NDArray[np.float64]) -> Values:
        """Heights (M,) of the roof at (M, 2 or 3)."""
        return roof_heights(self.form, self.parameters, xy[:, :2] - self.centre)[0]

    def axes(self, xy: NDArray[np.float64]) -> tuple[Values, Values]:
        """Coordinates (M,) of (M, 2 or 3) along and across the ridge, about the centre."""
        cosine, sine = np.cos(self.parameters[ANGLE]), np.sin(self.parameters[ANGLE])
        x, y = xy[:, 0] - self.centre[0], xy[:, 1] - self.centre[1]
        return np.asarray(cosine * x + sine * y), np.asarray(cosine * y - sine * x)


def fit_parametric_roof(
    form: int,
    points: Points,
    centre: NDArray[np.float64],
    start: NDArray[np.float64],
    floor: float,
    rounds: int = ROUNDS,
    turns: bool = True,
) -> ParametricFit:
    """The robust least-squares fit of a form to points (N, 3), from `start` (8,), by Gauss–Newton.

    Weights are 1 / (1 + (r / cut·scale)²)², the scale is 1.48 times the median residual, never below `floor`
    (m). Without `turns` the orientation stays as it starts.
    """
    xy, z = points[:, :2] - centre, points[:, 2]
    moves = GROUPS[form] if turns else GROUPS[form][:, GROUPS[form][ANGLE] == 0.0]
    best = start.astype(np.float64)
    normal: NDArray[np.float64] = np.eye(moves.shape[1])
    for _ in range(rounds):
        height, slopes = roof_heights(form, best, xy)
        scale = scale_of(z - height, floor)
        free, weight = slopes @ moves, (1.0 + ((z - height) / (CUT * scale)) ** 2) ** -2
        normal = free.T @ (free * weight[:, None])
        damped = normal + np.diag(1e-4 * np.diag(normal) + 1e-9)
        step = np.asarray(np.linalg.solve(damped, free.T @ (weight * (z - height))), np.float64)
        best = best + moves @ step
        if np.abs(free @ step).max() < SETTLED * scale:
            break
    residuals = z - roof_heights(form, best, xy)[0]
    scale = scale_of(residuals, floor)
    covariance = covariance_of(moves, normal, residuals[np.abs(residuals) < CUT * scale])
    return ParametricFit(form, centre, best, residuals, covariance, scale)


def scale_of(residuals: Values, floor: float) -> float:
    """The standard deviation (m) of residuals (N,) without outliers, at least `floor` (m)."""
    return max(1.4826 * float(np.median(np.abs(residuals))), floor)


def covariance_of(
    moves: NDArray[np.float64], normal: NDArray[np.float64], residuals: Values
) -> NDArray[np.float64]:
    """Covariance (8, 8) of the parameters from the normal matrix (k, k) and the explained residuals (M,)."""
    variance = float(residuals @ residuals) / max(len(residuals) - len(normal), 1)
    level = np.sqrt(np.maximum(np.diag(normal), 1e-12))
    scaled = normal / np.outer(level, level) + 1e-9 * np.eye(len(level))
    return np.asarray(moves @ (np.linalg.inv(scaled) / np.outer(level, level)) @ moves.T * variance)


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


def surface_moments(xyz: Points, triangles: NDArray[np.int32], sums: bool = False) -> SurfaceMoments:
    """The moments of the surface of triangles (T, 3) over points (N, 3), or `sums` over these points.

    Integrals over triangles, unlike sums over points, do not follow the density of the points.
    """
    corners = xyz[triangles]
    (ux, uy), (vx, vy) = ((corners[:, k, :2] - corners[:, 0, :2]).T for k in (1, 2))
    area = 0.5 * np.abs(ux * vy - vx * uy)
    total = float(area.sum())
    if total <= 0.0:
        return SurfaceMoments(*np.zeros(14).tolist())
    places, weight, mean = xyz, np.full(len(xyz), 1.0 / len(xyz)), xyz.mean(axis=0)
    if not sums:
        mean = (area[:, None] * corners.mean(axis=1)).sum(axis=0) / total
        places, weight = np.einsum("qk,tkd->tqd", RULE, corners), area[:, None] * WEIGHTS / total
    x, y, h = np.moveaxis(places - mean, -1, 0)
    xx, xy, yy = x * x, x * y, y * y
    fourth = (xx * xx - 6.0 * xx * yy + yy * yy, 4.0 * xy * (xx - yy))
    integrals = (xx, xy, yy, h * x, h * y, h * xx, h * xy, h * yy, *fourth)
    return SurfaceMoments(
        total, *mean.tolist(), *(float((weight * integral).sum()) for integral in integrals)
    )


@dataclass(frozen=True)
class Rectangle:
    """A ground plan: its middle (m), the direction of its length (radians), length and width (m)."""

    x: float
    y: float
    orientation: float
    length: float
    width: float


@dataclass(frozen=True)
class ClosedForm(Rectangle):
    """A house straight from moments: roof type, place, ridge orientation (radians), sizes and heights (m).

    `length` runs along the ridge, `width` across. `rise` is Δ, ridge above eaves; for a shed its sign is
    that of the fall across. `ridge_offset` is how far the ridge of a gable lies beside the middle.
    """

    roof: str
    eaves: float
    rise: float
    ridge_offset: float

    @property
    def ridge(self) -> float:
        """Height (m) of the ridge."""
        return self.eaves + abs(self.rise)

    @property
    def slope(self) -> float:
        """Radians from the horizontal."""
        run = self.width if self.roof in ("flat", "shed") else 0.5 * self.width
        return float(np.arctan2(abs(self.rise), run))


def closed_forms(
    moments: SurfaceMoments, level: float, growth: float = 1.0, plan: Rectangle | None = None
) -> list[ClosedForm]:
    """The closed solution for every roof type with its ridge along either axis; rises under `level` (m) are
    none.

    `growth` is the ratio of the house's length and width to those of the area of its points: rises grow
    with it, and the middle of the roof stays. With a `plan` place, axes and sizes are the plan's.
    """
    axis = axis_angle(moments, level) if plan is None else plan.orientation
    forms = []
    for turn in (0.0, np.pi / 2.0):
        angle = axis + turn
        cosine, sine = np.cos(angle), np.sin(angle)
        along, across = turned(angle, moments.xx, moments.xy, moments.yy)
        high_along, high_across = turned(angle, moments.hxx, moments.hxy, moments.hyy)
        length, width = float(np.sqrt(12.0 * max(along, 1e-12))), float(np.sqrt(12.0 * max(across, 1e-12)))
        box = Rectangle(moments.x, moments.y, float(angle), length * growth, width * growth)
        if plan is not None:
            sides = (plan.width, plan.length) if turn else (plan.length, plan.width)
            box = Rectangle(plan.x, plan.y, float(angle), *sides)
        rise_along, rise_across = -48.0 * high_along / length**2, -48.0 * high_across / width**2
        tilt, wider = 12.0 * (cosine * moments.hy - sine * moments.hx) / width, box.width / width
        share = min(width / length, 1.0)
        hip_along = share * (20.0 - 15.0 * share + 3.0 * share**2) / 15.0
        hip_rise = (rise_along + rise_across) / (1.0 - 7.0 / 15.0 * share + hip_along)
        ridge = ridge_place(tilt, rise_across)
        hip = "pyramid" if length < SQUARISH * width else "hip"
        off = 0.5 * width * ridge + cosine * (moments.y - box.y) - sine * (moments.x - box.x)
        for roof, rise, above, beside, offered in (
            ("flat", 0.0, 0.0, 0.0, length >= width),
            ("shed", tilt, 0.5 * wider, 0.0, abs(tilt) > level),
            ("gable", rise_across / (1.0 - ridge**2) ** 2, 0.5 * (1.0 + ridge**2), off, rise_across > level),
            (hip, hip_rise, 0.5 + share / 6.0, 0.0, hip_rise > level and SQUARISH * length >= width),
        ):
            if offered:
                eaves = moments.height + (above - wider) * abs(rise)
                heights = {"eaves": float(eaves), "rise": float(rise * wider), "ridge_offset": float(beside)}
                forms.append(ClosedForm(**vars(box), roof=roof, **heights))
    return forms


def ridge_place(tilt: float, rise: float) -> float:
    """Distance of a gable's ridge from the middle, in half widths, from the tilt and Δv of its two sides of
    one slope: t (1 − q²)² = q (3 − q²), t = tilt / Δv; a shed is q = ±1, the standard house q = 0."""
    if rise <= 0.0:
        return 0.0
    return float(brentq(lambda q: tilt * (1.0 - q * q) ** 2 - rise * q * (3.0 - q * q), -1.0, 1.0))


def border_growth(count: int) -> float:
    """Ratio of a rectangle's sides to those of the hull of `count` points spread over it at random.

    The hull of n points in a polygon of r corners loses the share 2r/3 · ln n / n of its area
    [renyi_sulanke1963].
    """
    lost = 8.0 / 3.0 * float(np.log(max(count, 2))) / max(count, 2)
    return float(np.sqrt(1.0 / max(1.0 - lost, 0.25)))


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
