"""The buildings of a town: the shapes, sizes and slopes they are drawn from, and the drawing of one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

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


STOREY = 2.8
"""Height of a storey (m)."""

DETACHED_SHARES = {
    "gable": 0.26,
    "hip": 0.14,
    "half-hip": 0.08,
    "pyramid": 0.06,
    "asymmetric gable": 0.06,
    "gambrel": 0.05,
    "mansard": 0.05,
    "flat": 0.05,
    "flat with parapet": 0.05,
    "shed": 0.04,
    "L-shape": 0.09,
    "T-shape": 0.07,
}
"""Share of each roof among detached houses."""

SLOPES_DEG = {
    "gable": (25.0, 55.0),
    "hip": (22.0, 45.0),
    "half-hip": (35.0, 52.0),
    "pyramid": (18.0, 40.0),
    "asymmetric gable": (25.0, 45.0),
    "gambrel": (55.0, 68.0),
    "mansard": (60.0, 75.0),
    "shed": (4.0, 18.0),
    "L-shape": (28.0, 48.0),
    "T-shape": (28.0, 48.0),
}
"""Range of the (lower) slope of each roof; slopes spread evenly over it. Upper slopes: 12 to 30 degrees."""


@dataclass(frozen=True, eq=False)
class Design:
    """A building about its own centre: masses whose heights count from the street, and the overhang (m)."""

    kind: str
    masses: Masses
    overhang: float = 0.0

    @property
    def outline(self) -> Polygon:
        """The plan of all masses."""
        return shapely.union_all([mass.polygon for mass in self.masses])


def lifted(masses: Masses, height: float) -> Masses:
    """Masses lifted by `height` (m)."""
    return shifted_masses(masses, 0.0, 0.0, height)


def _slope(rng: np.random.Generator, least: float, most: float) -> float:
    """The tangent of a slope between two angles (degrees)."""
    return float(np.tan(np.radians(rng.uniform(least, most))))


UPPER_DEG = 12.0, 30.0
"""Slopes of the upper parts of gambrels and mansards."""


def draw_detached(rng: np.random.Generator) -> Design:
    """A house: 8 to 14.5 m by 6.5 to 10.5 m, one or two storeys, a third with dormers, half a chimney."""
    kind = str(rng.choice(list(DETACHED_SHARES), p=list(DETACHED_SHARES.values())))
    length, width = rng.uniform(8.0, 14.5), rng.uniform(6.5, 10.5)
    length = max(length, 1.1 * width)
    eaves = STOREY * rng.integers(1, 3) + rng.uniform(0.0, 0.7)
    slope = _slope(rng, *SLOPES_DEG[kind]) if kind in SLOPES_DEG else 0.0
    shapes: dict[str, Callable[[], Masses]] = {
        "flat": lambda: flat(length, width),
        "flat with parapet": lambda: flat(length, width, rng.uniform(0.3, 1.0)),
        "shed": lambda: shed(length, width, slope),
        "gable": lambda: gable(length, width, slope),
        "asymmetric gable": lambda: gable(length, width, slope, rng.uniform(0.3, 0.42)),
        "hip": lambda: hip(length, width, slope, slope * rng.uniform(0.8, 1.3)),
        "half-hip": lambda: hip(length, width, slope, 1.1 * slope, rng.uniform(0.4, 0.7)),
        "pyramid": lambda: pyramid(width + 1.0, slope),
        "gambrel": lambda: gambrel(length, width, slope, _slope(rng, *UPPER_DEG), rng.uniform(0.9, 1.5)),
        "mansard": lambda: mansard(length, width, slope, _slope(rng, *UPPER_DEG), rng.uniform(0.7, 1.2)),
        "L-shape": lambda: _with_wing(length, width, slope, rng, at_end=True),
        "T-shape": lambda: _with_wing(length, width, slope, rng, at_end=False),
    }
    masses = shapes[kind]()
    if kind in ("gable", "half-hip", "L-shape", "asymmetric gable") and rng.random() < 0.35:
        masses += _dormers(length, width, masses[0], rng)
    if kind not in ("flat", "flat with parapet", "shed") and rng.random() < 0.5:
        masses += (_chimney_on(masses, length, width, rng),)
    overhang = 0.0 if "flat" in kind else rng.uniform(0.1, 0.8)
    return Design(kind, lifted(masses, eaves), overhang)


def _with_wing(length: float, width: float, slope: float, rng: np.random.Generator, at_end: bool) -> Masses:
    """A gable with a wing at its end (L) or its middle (T), as wide as the main part or less."""
    span = width * rng.uniform(0.65, 0.95)
    place = (length - span) / 2 if at_end else rng.uniform(-0.2, 0.2) * length
    return gable(length, width, slope) + wing(width / 2 + rng.uniform(3.5, 7.0), span, slope, place, 1.0)


def _dormers(length: float, width: float, main: Mass, rng: np.random.Generator) -> Masses:
    """One to three dormers in a row on the front slope; none where the roof is too low to hold them."""
    slope = main.planes[0][1]
    setback = rng.uniform(0.5, 1.2)
    front = -width / 2 + setback
    span = rng.uniform(1.6, 3.2)
    eaves = slope * setback + rng.uniform(1.0, 1.5)
    ridge = _height_on(main, 0.0, 0.0)
    tilt = _slope(rng, 20.0, 40.0)
    pointed = rng.random() < 0.6
    top = eaves + (tilt * span / 2 if pointed else 0.0)
    if top > 0.85 * ridge:
        return ()
    back = min(top / slope - width / 2 + 0.2, 0.0)
    room = length - 3.0
    count = min(int(rng.integers(1, 4)), int(room // (span + 1.0)))
    places = (np.arange(count) - (count - 1) / 2) * (room / max(count, 1))
    if pointed:
        return tuple(gable_dormer(float(x), front, back, span, eaves, tilt) for x in places)
    return tuple(flat_dormer(float(x), front, back, span, eaves) for x in places)


def _chimney_on(masses: Masses, length: float, width: float, rng: np.random.Generator) -> Mass:
    """A chimney near the ridge, 0.6 to 1.2 m above the roof at its foot."""
    x, y = rng.uniform(-0.35, 0.35) * length, rng.uniform(-0.12, 0.12) * width
    top = max(_height_on(mass, x, y) for mass in masses) + rng.uniform(0.6, 1.2)
    return chimney(x, y, top, rng.uniform(0.5, 1.1))


def _height_on(mass: Mass, x: float, y: float) -> float:
    return float(mass.height_at(np.array([[x, y]]))[0])


def draw_garden_shed(rng: np.random.Generator) -> Design:
    """A shed or garage: 2.5 to 6 m by 2.2 to 3.5 m, flat or a low gable."""
    length, width = rng.uniform(2.5, 6.0), rng.uniform(2.2, 3.5)
    masses = flat(length, width) if rng.random() < 0.6 else gable(length, width, rng.uniform(0.2, 0.5))
    return Design("garden shed", lifted(masses, rng.uniform(2.1, 2.7)))


def draw_row(frontage: float, rng: np.random.Generator) -> Design:
    """Row houses that fill a frontage (m): one building, party walls, steps of 0.3 to 1.5 m now and then."""
    house = rng.uniform(5.0, 7.0)
    count = min(int(rng.integers(4, 10)), int(frontage // house))
    depth, eaves = rng.uniform(8.0, 10.5), STOREY * 2 + rng.uniform(0.0, 0.8)
    slope = _slope(rng, 30.0, 48.0)
    every = int(rng.integers(2, 5))
    masses: Masses = ()
    lift, push = 0.0, 0.0
    for number in range(count):
        if number and number % every == 0:
            lift, push = rng.uniform(0.3, 1.5), rng.uniform(-1.0, 1.0)
        x = (number - (count - 1) / 2) * house
        part = gable(house, depth, slope)
        if rng.random() < 0.3:
            part += _dormers(house + 1.0, depth, part[0], rng)
        if rng.random() < 0.5:
            part += (chimney(0.0, 0.3, slope * depth / 2 + 0.8, 0.7),)
        masses += shifted_masses(part, x, push, eaves + lift)
    return Design("row houses", masses, rng.uniform(0.0, 0.4))


def draw_town_house(frontage: float, depth: float, rng: np.random.Generator) -> Design:
    """A house between party walls, as wide as its `frontage` (m), two to five storeys, often an annex."""
    eaves = STOREY * rng.integers(2, 6) + rng.uniform(0.0, 1.0)
    pick = rng.random()
    if pick < 0.35:
        masses = gable(frontage, depth, _slope(rng, 30.0, 50.0))
    elif pick < 0.6:
        masses = gambrel(frontage, depth, _slope(rng, 60.0, 72.0), _slope(rng, *UPPER_DEG), 1.2)
    elif pick < 0.75:
        masses = shifted_masses(gable(depth, frontage, _slope(rng, 30.0, 45.0)), 0, 0, 0, np.pi / 2)
    else:
        masses = flat(frontage, depth, rng.uniform(0.3, 1.1))
    if rng.random() < 0.5:
        masses += (
            chimney(rng.uniform(-0.3, 0.3) * frontage, 0.5, _height_on(masses[0], 0.0, 0.5) + 1.2, 0.9),
        )
    masses = lifted(masses, eaves)
    if rng.random() < 0.6:
        long = rng.uniform(2.5, 6.0)
        plan = plan_rectangle(frontage * rng.uniform(0.4, 1.0), long + 1.0, 0.0, depth / 2 + long / 2 - 0.5)
        masses += (Mass(plan, ((0.0, 0.0, STOREY * rng.integers(1, 3) + 0.4),), "annex"),)
    return Design("town house", masses)


def draw_perimeter(length: float, width: float, rng: np.random.Generator) -> Design:
    """A block around a courtyard, or an L or U of it: mitred pitched wings, or flat ones with parapets."""
    deep = rng.uniform(9.0, 12.5)
    eaves = STOREY * rng.integers(3, 6) + rng.uniform(0.0, 1.0)
    sides = str(rng.choice(["SEWN", "SEW", "SE"], p=[0.5, 0.3, 0.2]))
    if rng.random() < 0.65:
        slope = _slope(rng, 25.0, 45.0)
        masses = tuple(_mitred_wing(length, width, deep, slope, side, sides) for side in sides)
        return Design(f"{_LETTER[sides]} pitched", lifted(masses, eaves), rng.uniform(0.1, 0.5))
    wings = [_mitred_wing(length, width, deep, 0.0, side, sides).polygon for side in sides]
    outline = shapely.union_all(wings, grid_size=0.001)
    inner = shapely.buffer(outline, -0.3, join_style="mitre")
    parapet = rng.uniform(0.4, 1.1)
    ring = (
        Mass(outline, ((0.0, 0.0, 0.0),)),
        Mass(shapely.difference(outline, inner), ((0.0, 0.0, parapet),), "parapet"),
    )
    return Design(f"{_LETTER[sides]} flat", lifted(ring, eaves))


_LETTER = {"SEWN": "courtyard", "SEW": "U-shape", "SE": "L-shape"}


def _mitred_wing(length: float, width: float, deep: float, slope: float, side: str, sides: str) -> Mass:
    """One wing of a block, cut at 45° where the next wing is there, straight where it is not."""
    along, across = (length, width) if side in "SN" else (width, length)
    first, last = {"S": ("W", "E"), "N": ("E", "W"), "E": ("S", "N"), "W": ("N", "S")}[side]
    cut_first, cut_last = deep * (first in sides), deep * (last in sides)
    start, end, low = -along / 2, along / 2, -across / 2
    plan = Polygon([(start, low), (end, low), (end - cut_last, low + deep), (start + cut_first, low + deep)])
    planes = ((0.0, slope, -slope * low), (0.0, -slope, slope * (low + deep)))
    turn = {"S": 0.0, "E": np.pi / 2, "N": np.pi, "W": -np.pi / 2}[side]
    return Mass(plan, planes if slope > 0 else planes[:1]).translated(turn, 0.0, 0.0, 0.0)


def draw_slab(length: float, rng: np.random.Generator) -> Design:
    """A slab of flats, 4 to 12 storeys, parapet, lift houses, sometimes set-back upper storeys (terraces)."""
    length, width = min(length, rng.uniform(28.0, 60.0)), rng.uniform(11.0, 14.0)
    height = STOREY * rng.integers(4, 13)
    masses = lifted(flat(length, width, rng.uniform(0.4, 1.1)), height)
    for step in range(int(rng.integers(0, 3))):
        inset = 2.5 * (step + 1)
        masses += lifted(flat(length - 2 * inset, width - 0.8 * inset), height + STOREY * (step + 1))
    top = max(mass.planes[0][2] for mass in masses)
    for x in rng.uniform(-0.3, 0.3, int(rng.integers(1, 3))) * length:
        masses += shifted_masses(flat(rng.uniform(3.0, 6.0), rng.uniform(3.0, 5.0)), float(x), 0.0, top + 2.6)
    return Design("slab", masses)


def draw_tower(rng: np.random.Generator) -> Design:
    """A tower block, 12 to 22 storeys, with a plant room."""
    side, height = rng.uniform(16.0, 24.0), STOREY * rng.integers(12, 23)
    masses = lifted(flat(side, side * rng.uniform(0.8, 1.0), 1.1), height)
    return Design("tower", masses + lifted(flat(0.4 * side, 0.3 * side), height + 3.5))


def draw_hall(length: float, width: float, rng: np.random.Generator) -> Design:
    """An industrial hall: flat with parapet and skylights, a low gable, or saw teeth."""
    eaves = rng.uniform(5.5, 11.0)
    pick = rng.random()
    if pick < 0.45:
        masses = flat(length, width, rng.uniform(0.2, 0.8))
        for x in np.linspace(-0.35, 0.35, 4) * length:
            masses += shifted_masses(gable(2.0, 0.6 * width, 0.6), float(x), 0.0, 0.3)
        return Design("hall", lifted(masses, eaves))
    if pick < 0.75:
        masses = gable(length, width, _slope(rng, 4.0, 12.0))
        return Design("hall", lifted(masses, eaves), 0.3)
    count = int(length // 9.0)
    tooth = length / count
    teeth = shifted_masses(shed(width, tooth, rng.uniform(0.3, 0.6)), 0.0, 0.0, 0.0, np.pi / 2)
    masses = tuple(m for k in range(count) for m in shifted_masses(teeth, (k - (count - 1) / 2) * tooth, 0.0))
    return Design("saw teeth", lifted(masses, eaves))


def draw_angled_hall(length: float, width: float, rng: np.random.Generator) -> Design:
    """A flat hall with two wings in an L, one storey of 4 to 8 m."""
    deep = rng.uniform(0.35, 0.5) * width
    wings = shifted_masses(flat(length, deep), 0.0, (deep - width) / 2)
    wings += shifted_masses(flat(deep, width), (deep - length) / 2, 0.0)
    return Design("angled hall", lifted(wings, rng.uniform(4.0, 8.0)))


def draw_church(rng: np.random.Generator) -> Design:
    """A church: steep nave, transept, a tower with a spire."""
    length, width, eaves = rng.uniform(24.0, 36.0), rng.uniform(10.0, 14.0), rng.uniform(8.0, 12.0)
    slope = _slope(rng, 45.0, 56.0)
    masses = lifted(gable(length, width, slope), eaves)
    masses += lifted(
        shifted_masses(gable(width + 10.0, 0.8 * width, slope), 0.2 * length, 0.0, 0.0, np.pi / 2), eaves
    )
    side = rng.uniform(5.0, 7.0)
    spire = lifted(pyramid(side, rng.uniform(2.0, 3.0)), eaves + slope * width / 2 + rng.uniform(4.0, 9.0))
    return Design("church", masses + shifted_masses(spire, -length / 2 - side / 2 + 0.5, 0.0))
