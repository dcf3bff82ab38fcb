"""Exact roof shapes about their own centre, ridge along x, eaves height 0; and nine of them on a slope."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from shapely import Polygon

from eaves.model import BUILDING, GROUND, UNCLASSIFIED, PointCloud, Values
from eaves.model.checks import check_positive
from eaves.simulate.objects.exact import ExactBuilding, ExactFace, ExactScene, Mass, Plane, roof_partition

Masses = tuple[Mass, ...]


def plan_rectangle(length: float, width: float, x: float = 0.0, y: float = 0.0) -> Polygon:
    """A rectangle about (x, y), `length` along x."""
    return shapely.box(x - length / 2, y - width / 2, x + length / 2, y + width / 2)


def flat(length: float, width: float, parapet: float = 0.0, thickness: float = 0.3) -> Masses:
    """A flat roof, with a parapet of that height when it is above 0."""
    outline = plan_rectangle(length, width)
    roof = Mass(outline, ((0.0, 0.0, 0.0),))
    if parapet <= 0.0:
        return (roof,)
    inner = plan_rectangle(length - 2 * thickness, width - 2 * thickness)
    rim = Polygon(outline.exterior, [inner.exterior])
    return roof, Mass(rim, ((0.0, 0.0, parapet),), "parapet")


def shed(length: float, width: float, slope: float) -> Masses:
    """One plane that rises towards +y from the eaves at y = −width/2; `slope` is its tangent."""
    return (Mass(plan_rectangle(length, width), ((0.0, slope, slope * width / 2),)),)


def gable(length: float, width: float, slope: float, ridge_at: float = 0.5) -> Masses:
    """Two planes meeting in a ridge at the share `ridge_at` of the width; slopes differ unless it is 1/2."""
    rise, front = slope * width / 2, ridge_at * width
    back = width - front
    a, b = rise / front, rise / back
    return (Mass(plan_rectangle(length, width), ((0.0, a, a * width / 2), (0.0, -b, b * width / 2))),)


def hip(
    length: float, width: float, slope: float, end_slope: float | None = None, start: float = 0.0
) -> Masses:
    """Four planes; the ends begin at the share `start` of the ridge's height: 0 a hip, else a half-hip."""
    end = slope if end_slope is None else end_slope
    low = end * length / 2 + start * slope * width / 2
    sides = gable(length, width, slope)[0]
    return (Mass(sides.polygon, (*sides.planes, (end, 0.0, low), (-end, 0.0, low))),)


def pyramid(side: float, slope: float) -> Masses:
    """Four planes that meet in one point."""
    return hip(side, side, slope)


def gambrel(length: float, width: float, slope: float, upper_slope: float, knee: float) -> Masses:
    """A gable whose slope changes at `knee` metres from the eaves, steep below."""
    return (Mass(plan_rectangle(length, width), _broken(width, slope, upper_slope, knee, along_x=False)),)


def mansard(length: float, width: float, slope: float, upper_slope: float, knee: float) -> Masses:
    """Steep planes on four sides up to `knee` metres from the eaves, a shallow hip above."""
    sides = _broken(width, slope, upper_slope, knee, along_x=False)
    ends = _broken(length, slope, upper_slope, knee, along_x=True)
    return (Mass(plan_rectangle(length, width), sides + ends),)


def _broken(span: float, slope: float, upper: float, knee: float, along_x: bool) -> tuple[Plane, ...]:
    """Steep and shallow planes from both edges of a span."""
    planes: list[Plane] = []
    for tangent, height in ((slope, 0.0), (upper, (slope - upper) * knee)):
        for sign in (1.0, -1.0):
            gradient = (sign * tangent, 0.0) if along_x else (0.0, sign * tangent)
            planes.append((*gradient, height + tangent * span / 2))
    return tuple(planes)


def shifted_masses(masses: Masses, x: float, y: float, z: float = 0.0, angle: float = 0.0) -> Masses:
    """Masses turned by `angle` (radians) and moved."""
    return tuple(mass.translated(angle, x, y, z) for mass in masses)


def wing(length: float, width: float, slope: float, x: float, side: float) -> Masses:
    """A gable at a right angle to the main ridge, from the ridge out to `length` (m) on that side (±1)."""
    return shifted_masses(gable(length, width, slope), x, side * length / 2, angle=np.pi / 2)


def chimney(x: float, y: float, top: float, side: float = 0.8) -> Mass:
    """A square block up to the height `top`."""
    return Mass(plan_rectangle(side, side, x, y), ((0.0, 0.0, top),), "chimney")


def gable_dormer(x: float, front: float, back: float, width: float, eaves: float, slope: float) -> Mass:
    """A small gable across the main slope, its front at y = `front`, its roof running back to y = `back`."""
    low, high = min(front, back), max(front, back)
    plan = shapely.box(x - width / 2, low, x + width / 2, high)
    rise = eaves + slope * width / 2
    return Mass(plan, ((slope, 0.0, rise - slope * x), (-slope, 0.0, rise + slope * x)), "dormer")


def flat_dormer(x: float, front: float, back: float, width: float, top: float) -> Mass:
    """A box dormer with a flat roof at the height `top`."""
    plan = shapely.box(x - width / 2, min(front, back), x + width / 2, max(front, back))
    return Mass(plan, ((0.0, 0.0, top),), "dormer")


def make_building(
    masses: Sequence[Mass], number: int, first_face: int, kind: str, base: float, overhang: float
) -> ExactBuilding:
    """The building of some masses, already where they belong; its faces are numbered from `first_face`."""
    partition = roof_partition(tuple(masses))
    footprint = shapely.coverage_union_all([polygon for polygon, _ in partition])
    if footprint.geom_type != "Polygon":
        raise ValueError("the masses do not make one connected building")
    walls = shapely.buffer(footprint, -overhang, join_style="mitre") if overhang > 0 else footprint
    faces = tuple(
        ExactFace(polygon, plane, first_face + order) for order, (polygon, plane) in enumerate(partition)
    )
    return ExactBuilding(number, kind, shapely.orient_polygons(footprint), walls, faces, base)


def nine_shapes() -> list[tuple[str, Masses]]:
    """Nine roofs of common sizes (m) and slopes, one of each kind."""
    house = (*gable(14, 9, 0.9), chimney(3.0, 0.4, 4.6))
    return [
        ("flat", flat(18, 12)),
        ("flat with parapet", flat(16, 11, parapet=0.8)),
        ("shed", shed(12, 8, 0.25)),
        ("gable", house),
        ("asymmetric gable", gable(15, 10, 0.7, ridge_at=0.35)),
        ("hip", hip(15, 10, 0.7)),
        ("half-hip", hip(14, 9, 1.0, end_slope=1.2, start=0.55)),
        ("pyramid", pyramid(11, 0.65)),
        ("L-shape", gable(16, 9, 0.8) + wing(14, 7, 0.8, 4.5, 1.0)),
    ]


ORIGIN = (2400.0, 4800.0)
"""World metres of local (0, 0) of the nine roofs: a corner of blocks."""
PITCH = 34.0
SLOPE: Plane = (0.06, 0.03, 12.0)
"""Distance between the nine houses (m), and the plane of their ground: 7 % of slope."""


def nine_roofs_on_a_slope(density: float = 10.0, noise: float = 0.02, seed: int = 0) -> ExactScene:
    """Nine buildings on sloping ground, sampled evenly at random from above, with the truth of every point.

    Nothing is hidden, there are no walls, and a pulse has one return.

    Parameters
    ----------
    density : float
        Points per square metre (> 0).
    noise : float
        Standard deviation of the heights (m, ≥ 0).
    seed : int
        The same seed gives the same points.

    Returns
    -------
    ExactScene
        The points with their truth.

    Raises
    ------
    TypeError
        When `density` is no number.
    ValueError
        When `density` is not above 0.

    Examples
    --------
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> len(truth.buildings), [building.kind for building in truth.buildings][:3]
    (9, ['flat', 'flat with parapet', 'shed'])
    """
    check_positive(density, "density", "points per m²")
    buildings, face = [], 1
    turns = np.random.default_rng([seed, 1]).uniform(0.0, np.pi, 9)
    for order, (kind, masses) in enumerate(nine_shapes()):
        x, y = PITCH * (order % 3 + 0.5), PITCH * (order // 3 + 0.5)
        placed = shifted_masses(masses, x, y, angle=turns[order])
        outline = shapely.union_all([mass.polygon for mass in placed])
        ground = _ground_at(shapely.get_coordinates(outline))
        eaves = float(ground.max()) + 3.0 + 0.5 * order
        placed = shifted_masses(placed, 0.0, 0.0, eaves)
        building = make_building(placed, order + 1, face, kind, float(ground.min()), overhang=0.0)
        buildings.append(building)
        face += len(building.faces)
    return sample_from_above(tuple(buildings), 3 * PITCH, density, noise, seed)


def _ground_at(xy: Values) -> Values:
    return np.asarray(SLOPE[0] * xy[:, 0] + SLOPE[1] * xy[:, 1] + SLOPE[2])


def sample_from_above(
    buildings: tuple[ExactBuilding, ...], side: float, density: float, noise: float, seed: int
) -> ExactScene:
    """Points at random on the buildings and on the slope, over a square from (0, 0) to (`side`, `side`)."""
    rng = np.random.default_rng([seed, 2])
    count = round(density * side * side)
    xy = rng.uniform(0.0, side, (count, 2))
    z = _ground_at(xy)
    truth_class = np.full(count, GROUND, np.uint8)
    number, plane = np.zeros(count, np.int32), np.zeros(count, np.int32)
    for building in buildings:
        west, south, east, north = building.footprint.bounds
        boxed = (xy[:, 0] >= west) & (xy[:, 0] <= east) & (xy[:, 1] >= south) & (xy[:, 1] <= north)
        candidates = np.flatnonzero(boxed)
        for face in building.faces:
            on = candidates[shapely.contains_xy(face.polygon, xy[candidates, 0], xy[candidates, 1])]
            z[on], plane[on] = face.height_at(xy[on]), face.number
            truth_class[on], number[on] = BUILDING, building.number
    z += rng.normal(0.0, noise, count)
    single = np.ones(count, np.uint8)
    world = np.column_stack([xy[:, 0] + ORIGIN[0], xy[:, 1] + ORIGIN[1], z])
    cloud = PointCloud.from_world(
        world,
        ORIGIN,
        return_number=single,
        number_of_returns=single,
        classification=np.full(count, UNCLASSIFIED, np.uint8),
        point_id=np.arange(count),
    )
    return ExactScene(cloud, truth_class, number, plane, buildings)
