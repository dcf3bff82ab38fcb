"""Points that are evidence of the roof, and the height from which the roof is seen."""

from __future__ import annotations

import numpy as np
import shapely
from scipy.spatial import cKDTree
from shapely import Polygon

from eaves.figures.attributes import FEWEST_POINTS, Surface, surface_heights
from eaves.geometry.face_table import FaceTable, roof_point_mask
from eaves.geometry.inside import connected_groups_kernel
from eaves.geometry.neighbours import measure_spacing
from eaves.geometry.planes import LINE_RATIO, add_point_kernel, plane_of_sums_kernel, quantile
from eaves.kernels import kernel
from eaves.model import (
    NO_PLANE,
    BuildingModel,
    Failure,
    Footprint,
    Integers,
    Labels,
    Mask,
    Points,
    RoofPlane,
    Values,
)
from eaves.reconstruct.toolkit.plan_lines import LineReconstructor, main_directions, turn_by
from eaves.solids.extrude import LOWEST_ROOF

PRISM_PERCENTILE = 70.0
"""Height of a flat-topped model: percentile of the roof points, as the 3DBAG publishes it."""

FIT_ROUNDS, FEWEST_FITTED = 3, 6
"""Rounds in which planes are fitted to what lies near them, and the fewest points that make one."""

STEEPEST = 0.1
"""Least upward share of the normal of a fitted plane, 84°: a wall is no roof."""

MOST_PLANES = 1500
"""Planes that take part, those with most points; a table of cells and planes bounds the rest."""


ASLANT = np.pi / 8.0
"""Angle between the cells in which a roof's points are counted and its walls: halfway between those at which
cells fill a roof best and worst.
"""


def points_inside(points: Points, polygon: Polygon) -> Integers:
    """Numbers of the finite points (N, 3) inside a polygon."""
    shapely.prepare(polygon)
    inside = shapely.contains_xy(polygon, points[:, 0], points[:, 1])
    return np.flatnonzero(inside & np.isfinite(points).all(axis=1))


def seen_roof(points: Points, footprint: Footprint) -> tuple[Integers, Integers] | Failure:
    """Numbers of the points (N, 3) inside a footprint, and of those on the roof; a Failure of too few."""
    inside = points_inside(points, footprint.polygon)
    top = inside[roof_point_mask(points[inside])]
    if len(top) < FEWEST_POINTS:
        reason = f"{len(top)} roof points inside the footprint"
        return Failure("too_few_points", reason, "reconstruct", footprint)
    return inside, top


def spacing_on_roof(roof: Points, polygon: Polygon) -> float:
    """Mean spacing (m) of roof points (N, 3) in plan, however the building lies.

    `measure_spacing` counts cells along the axes: on one roof its answers differ by 10 % (median) to 30 %
    from turn to turn. Here the cells lie aslant to the outline's main direction and start at each of four
    corners in turn; the largest answer counts.
    """
    main = main_directions(polygon)
    turned = roof[:, :2] @ turn_by(ASLANT + (float(main[0]) if len(main) else 0.0))
    corners = [(east, north) for east in (1.0, -1.0) for north in (1.0, -1.0)]
    return float(np.max([measure_spacing(turned * np.array(corner)) for corner in corners]))


def level_unexplained(
    points: Points, labels: Labels, count: int, spacing: float, limits: LineReconstructor
) -> tuple[Labels, list[float]]:
    """Labels (N,) with clusters of the points that have none numbered from `count` on, and their heights (m).

    What no plane explains but stands together, a cluttered roof or a dome, is better a level than nothing.
    """
    levelled = labels.copy()
    loose = np.flatnonzero(labels < 0)
    heights: list[float] = []
    fewest = max(limits.clutter_points, int(np.ceil(limits.smallest / spacing**2)))
    if len(loose) < fewest:
        return levelled, heights
    scaled = points[loose] * np.array([1.0, 1.0, limits.clutter_reach * spacing / limits.clutter_step])
    pairs = cKDTree(scaled).query_pairs(limits.clutter_reach * spacing, output_type="ndarray")
    cluster = connected_groups_kernel(pairs[:, 0], pairs[:, 1], len(loose))
    sizes = np.bincount(cluster)
    most = max(MOST_PLANES - count, 0)
    largest = np.argsort(-sizes, kind="stable")[:most]
    for number in np.sort(largest[sizes[largest] >= fewest]).tolist():
        members = loose[cluster == number]
        levelled[members] = count + len(heights)
        heights.append(float(np.median(points[members, 2])))
    return levelled, heights


def support_of(
    points: Points,
    top: Integers,
    planes: list[RoofPlane],
    spacing: float,
    ground: float,
    limits: LineReconstructor,
) -> tuple[Labels, Values]:
    """The plane of each roof point, -1 for none (T,), and the coefficients of the planes (P, 3).

    `top` (T,) are the numbers of the roof points among `points` (N, 3). To the given planes come levels
    for clutter; the last is the level for where nothing is known.
    """
    owner = np.full(len(points), -1, np.int32)
    for number, plane in enumerate(planes):
        owner[plane.members] = number
    owner = largest_only(owner, top)
    owners, number_of = np.unique(owner[top], return_inverse=True)
    labels: Labels = (number_of.ravel() - int(owners[0] == -1)).astype(np.int32)
    coefficients = [planes[number].coefficients for number in owners[owners >= 0]]
    labels, levels = level_unexplained(points[top], labels, len(coefficients), spacing, limits)
    height = max(quantile(points[top, 2], PRISM_PERCENTILE / 100.0), ground + LOWEST_ROOF)
    rows = [*coefficients, *((0.0, 0.0, level) for level in levels), (0.0, 0.0, height)]
    return labels, np.array(rows, np.float64)


def planes_of_regions(
    roof: Points, located: tuple[Integers, Integers], region: Integers, planes: Values, reach: float
) -> tuple[Labels, Values]:
    """The region of each roof point (N, 3) that lies on its plane, -1 for others, (N,), and the planes of the
    regions (R, 3), of least squared distances from the points that lie within `reach` (m) of them.

    `located` are points and the cells they lie in, `region` (C,) those of the cells, `planes` (R, 3) what
    they have. A region of few points, or of points on a line, keeps its plane.
    """
    owner = np.full(len(roof), -1, np.int32)
    owner[located[0]] = region[located[1]]
    fitted = planes.copy()
    fits = fit_kernel(roof, owner, fitted, reach)
    return np.where(fits, owner, -1).astype(np.int32), fitted


@kernel
def fit_kernel(points: Points, owner: Labels, planes: Values, reach: float) -> Mask:
    """Fits the `planes` (P, 3: a, b, c) to the points (N, 3) of their `owner` (N,), -1 for none, within a
    reach (m) of them, again and again; which points are within it (N,)."""
    fits, plane = np.zeros(len(points), np.bool_), np.zeros(4)
    covariance, vectors, values = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3)
    middle = points[0].copy()
    for _ in range(FIT_ROUNDS):
        sums = np.zeros((len(planes), 10))
        for point in range(len(points)):
            number = owner[point]
            fits[point] = False
            if number >= 0:
                a, b, c = planes[number]
                x, y, z = points[point]
                fits[point] = abs(z - a * x - b * y - c) <= reach * np.sqrt(1.0 + a * a + b * b)
                if fits[point]:
                    x, y, z = points[point] - middle
                    add_point_kernel(sums[number], x, y, z, 1.0)
        for number in range(len(planes)):
            if sums[number, 0] < FEWEST_FITTED:
                continue
            plane_of_sums_kernel(sums[number], covariance, vectors, values, plane)
            x, y, z, d = plane
            if values[1] >= LINE_RATIO**2 * values[2] and z > STEEPEST:
                planes[number, 0], planes[number, 1] = -x / z, -y / z
                planes[number, 2] = (d + x * middle[0] + y * middle[1] + z * middle[2]) / z
    return fits


def largest_only(owner: Labels, top: Integers) -> Labels:
    """The planes (N,) of points, -1 for none, with those alone that have most roof points `top` (T,), at most
    `MOST_PLANES` of them.
    """
    sizes = np.bincount(owner[top] + 1)[1:]
    if np.count_nonzero(sizes) <= MOST_PLANES:
        return owner
    largest = np.zeros(len(sizes) + 1, bool)
    largest[np.argsort(-sizes, kind="stable")[:MOST_PLANES]] = True
    return np.where(largest[np.minimum(owner, len(sizes))], owner, -1).astype(np.int32)


def faces_as_planes(
    model: BuildingModel,
    coefficients: Values,
    points: Points,
    top: Integers,
    surface: Surface | None = None,
) -> tuple[RoofPlane, ...]:
    """The roof faces of LoD 2.2 as planes (F, 3: a, b, c), with the roof points (numbers `top`) under each.

    `surface` is the model over those points where it is known.
    """
    if len(coefficients) == 0:
        return ()
    solids = model.solids["2.2"]
    height, cosine, number = surface or surface_heights(solids, points[top, :2])
    error = (points[top, 2] - height) * cosine
    numbered = np.concatenate([solid.planes for solid in solids]) != NO_PLANE
    shapes = FaceTable.of_solids(solids).take(numbered).polygons()
    roof_planes = []
    for face, (row, shape) in enumerate(zip(coefficients.tolist(), shapes, strict=True)):
        on_face = number == face
        rmse = float(np.sqrt(np.mean(error[on_face] ** 2))) if on_face.any() else 0.0
        roof_planes.append(RoofPlane((row[0], row[1], row[2]), top[on_face], rmse, shape))
    return tuple(roof_planes)
