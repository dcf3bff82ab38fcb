"""Objects that no reference model has, on buildings and in streets.

Vents, skylights, solar panels, plant and balconies are building points that lie on no roof face; without them
a simulated roof is too clean. Cars, fences, power lines and bridges stand in streets.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage

from eaves.model import (
    BRIDGE_DECK,
    BUILDING,
    GROUND,
    HIGH_VEGETATION,
    LOW_VEGETATION,
    UNCLASSIFIED,
    WATER,
    WIRE,
    WIRE_TOWER,
    Labels,
    Mask,
    Values,
)
from eaves.simulate.objects.exact import ExactBuilding, ExactFace, ExactScene
from eaves.simulate.objects.surfaces import (
    UP,
    Corridor,
    ScannedSurfaces,
    Terrain,
    closed,
    curtain,
    curtains,
    fan,
    upright_box,
)

BANDS = ("red", "green", "blue", "nir")
LEAF, GRASS, PAVING = (0.04, 0.08, 0.03, 0.45), (0.07, 0.11, 0.05, 0.38), (0.16, 0.15, 0.14, 0.18)
ROOFS = np.array([(0.27, 0.13, 0.09, 0.31), (0.09, 0.10, 0.11, 0.11), (0.22, 0.21, 0.20, 0.24), GRASS])
"""Reflectance of leaves, grass and paving, and of roofs of tiles, slate, gravel and plants, in four bands;
round numbers, of the order that spectral libraries have."""
SHARES = (0.45, 0.30, 0.22, 0.03)
"""Of the roofs."""
MEADOW, FULL, SPREAD = 12.0, 50_000.0, 0.15
"""Side (m) of the squares of ground that are all grass or all paving; the value of a white surface; the
relative spread of a surface."""


def coloured(scene: ExactScene, seed: int = 0) -> ExactScene:
    """A scene whose points have red, green, blue and near infrared, as an image of the flight gives them, and
    the intensity of a laser in the near infrared.

    Leaves and grass are bright in the near infrared alone; three of a hundred roofs are planted. Nothing is
    in the shade, and no colour is that of what lies above.

    Parameters
    ----------
    scene : ExactScene
        The points with their truth.
    seed : int
        The same seed gives the same colours.

    Returns
    -------
    ExactScene
        The same with the fields in its cloud.

    Raises
    ------
    ValueError
        When the seed is negative.

    Examples
    --------
    >>> from eaves.simulate import coloured, nine_roofs_on_a_slope
    >>> sorted(coloured(nine_roofs_on_a_slope(density=1.0)).cloud.fields)
    ['blue', 'green', 'intensity', 'nir', 'red']
    """
    rng = np.random.default_rng([seed, 7])
    truth, cells = scene.truth_class, np.floor(scene.cloud.xyz[:, :2] / MEADOW).astype(np.int64)
    _, square = np.unique(cells, axis=0, return_inverse=True)
    is_grass = rng.random(len(truth) + 1)[square.ravel()] < 0.5
    light = np.where(is_grass[:, None], GRASS, PAVING)
    light[(truth >= LOW_VEGETATION) & (truth <= HIGH_VEGETATION)] = LEAF
    roof = ROOFS[rng.choice(len(ROOFS), int(scene.building.max(initial=0)) + 1, p=SHARES)]
    light = np.where((truth == BUILDING)[:, None], roof[scene.building], light)
    paved = ~np.isin(truth, (GROUND, BUILDING, *range(LOW_VEGETATION, HIGH_VEGETATION + 1)))
    light[paved] = PAVING
    values = np.round(FULL * light * np.exp(rng.normal(0.0, SPREAD, light.shape)))
    fields = dict(zip(BANDS, values.T.copy(), strict=True))
    fields["intensity"] = np.round(0.5 * fields["nir"])
    return replace(scene, cloud=scene.cloud.with_(fields=fields))


SEEN_ROOFS = np.array(
    [
        (0.75, 0.76, 0.76, 0.04),
        (0.24, 0.36, 0.56, 0.05),
        (0.56, 0.27, 0.19, 0.08),
        (0.38, 0.27, 0.20, 0.08),
        (0.48, 0.47, 0.45, 0.08),
        (0.29, 0.37, 0.18, 0.12),
    ]
)
"""Red, green and blue (shares of full brightness) of roofs in pictures, and their relative spread: white and
blue sheets, red and brown tiles, gravel, plants. Round numbers, as those of `SEEN_GROUND`."""
SEEN_SHARES = (0.22, 0.12, 0.26, 0.18, 0.20, 0.02)
"""Of the roofs."""
SEEN_GROUND = np.array(
    [
        (0.30, 0.30, 0.31, 0.06),
        (0.53, 0.42, 0.31, 0.09),
        (0.30, 0.38, 0.19, 0.12),
        (0.36, 0.41, 0.20, 0.20),
    ]
)
"""Of asphalt, bare soil, grass and crops."""
COVERED = (0.25, 0.45, 0.80)
"""Shares of the ground up to which it is asphalt, soil and grass; the rest is crops."""
DRY, CROWN, POND, WALL = (
    np.array(values)
    for values in (
        (0.52, 0.48, 0.32),
        (0.15, 0.23, 0.11, 0.25),
        (0.13, 0.18, 0.18, 0.05),
        (0.64, 0.59, 0.52, 0.06),
    )
)
"""Of grass without rain, which a town's grass and crops resemble more or less; of leaves, water and walls."""
PAINTS = np.array(
    [(0.85, 0.85, 0.85), (0.10, 0.10, 0.11), (0.55, 0.56, 0.58), (0.60, 0.12, 0.10), (0.15, 0.25, 0.50)]
)
"""Of vehicles, which differ from one square of `PARKING` metres to the next."""
PARKING = 6.0
DIFFUSE, LONGEST_SHADOW, BALANCE = 0.4, 25.0, 0.06
"""Share of the light that comes from the whole sky; the longest shadow (m); the relative spread of a
camera's white balance."""


def sunlight(heights: Values, cell: float, rng: np.random.Generator) -> Values:
    """Light (I, J), 1 on level ground, on heights (m) of squares of side `cell`, the sun 35 to 65° high."""
    turn, climb = rng.uniform(0.0, 2 * np.pi), np.tan(np.radians(rng.uniform(35.0, 65.0)))
    sun = np.array([np.cos(turn), np.sin(turn)])
    along, across = np.gradient(heights, cell)
    lit = (climb - along * sun[0] - across * sun[1]) / (climb * np.sqrt(1.0 + along**2 + across**2))
    for far in np.arange(1.0, LONGEST_SHADOW):
        over = ndimage.shift(heights, -np.round(far * sun / cell), order=0, mode="nearest")
        lit[over - far * climb > heights] = 0.0
    return np.asarray(DIFFUSE + (1.0 - DIFFUSE) * np.clip(lit, 0.0, 1.5))


def photographed(
    label: Labels,
    xy: Values,
    cover: Values,
    on_wall: Mask,
    filled: Mask,
    light: Values,
    rng: np.random.Generator,
) -> Values:
    """Red, green and blue (N, 3), whole numbers up to 65535 as eight bits give them, of points in pictures.

    `label` (N, 3) is class, building and plane, `cover` (N,) how the ground is ordered by what covers it;
    points `on_wall` show a wall, `filled` ones leaves.
    """
    truth, ground = label[:, 0], SEEN_GROUND.copy()
    ground[2:, :3] += rng.uniform() * (DRY - ground[2:, :3])
    shown = ground[np.searchsorted(np.quantile(cover, COVERED), cover)]
    vehicle = truth == UNCLASSIFIED
    square = np.unique(np.floor(xy[vehicle] / PARKING), axis=0, return_inverse=True)[1].ravel()
    shown[vehicle, :3] = PAINTS[rng.integers(len(PAINTS), size=len(square) + 1)][square]
    shown[filled | ((truth >= LOW_VEGETATION) & (truth <= HIGH_VEGETATION))] = CROWN
    shown[truth == WATER] = POND
    roof = SEEN_ROOFS[rng.choice(len(SEEN_ROOFS), int(label[:, 1].max(initial=0)) + 1, p=SEEN_SHARES)]
    shown = np.where((truth == BUILDING)[:, None], roof[label[:, 1]], shown)
    shown[on_wall] = WALL
    bright = light * np.exp(shown[:, 3] * rng.normal(size=len(light)))
    colours = shown[:, :3] * bright[:, None] * np.exp(rng.normal(0.0, BALANCE, 3))
    return np.asarray(np.round(255.0 * np.clip(colours, 0.0, 1.0)) * 257.0)


FROM_EDGE = 0.6
"""The least distance of objects from the edge of a face (m)."""

FLAT = 0.09
"""Tangent of the slope (5°) below which a face carries plant instead of skylights."""

AREA_PER_PIECE = 30.0
"""Mean roof area (m²) of one piece."""

PANELS_SHARE = 0.15
"""Share of the pitched faces with room for them that carry solar panels."""

BALCONY_KINDS = ("town house", "slab", "tower", "courtyard", "U-shape")
"""The beginnings of the kinds of buildings with balconies."""

BALCONY_SHARE = 0.35
"""Share of the places for a balcony that have one."""

PLACE_STEP, STOREY_STEP = 5.5, 2.8
"""Places for balconies along a wall and up it (m)."""

Patch = NDArray[np.float64]


def install(
    building: ExactBuilding, free: Callable[[NDArray[np.float64]], bool], rng: np.random.Generator
) -> ScannedSurfaces:
    """The clutter of one building; `free` returns whether nothing is built at a place (x, y)."""
    pieces: list[Patch] = []
    for face in building.faces:
        inner = shapely.buffer(face.polygon, -FROM_EDGE, join_style="mitre")
        if inner.is_empty:
            continue
        gradient = np.array(face.coefficients[:2])
        for _ in range(int(rng.poisson(face.polygon.area / AREA_PER_PIECE))):
            place = _somewhere(inner, rng)
            if place is not None:
                pieces += _piece(face, place, gradient, rng)
        if np.hypot(*gradient) > FLAT and rng.random() < PANELS_SHARE:
            pieces += _panels(face, inner, gradient, rng)
    if building.kind.startswith(BALCONY_KINDS):
        pieces += _balconies(building, free, rng)
    return ScannedSurfaces.of(pieces, BUILDING, building.number)


def _somewhere(inner: shapely.Polygon, rng: np.random.Generator) -> NDArray[np.float64] | None:
    """A place inside; None when four tries miss."""
    west, south, east, north = inner.bounds
    for x, y in rng.uniform((west, south), (east, north), (4, 2)):
        if shapely.contains_xy(inner, x, y):
            return np.array([x, y])
    return None


def _piece(
    face: ExactFace, place: NDArray[np.float64], gradient: NDArray[np.float64], rng: np.random.Generator
) -> list[Patch]:
    """Plant on a flat roof; a vent or a skylight on a pitched one."""
    foot = float(face.height_at(place[None, :])[0])
    angle = float(np.arctan2(gradient[1], gradient[0]))
    if np.hypot(*gradient) < FLAT:
        size = rng.uniform(0.3, 2.0), rng.uniform(0.3, 1.6), rng.uniform(0.3, 1.5)
        return upright_box(place[0], place[1], foot - 0.1, size, rng.uniform(0.0, np.pi))
    if rng.random() < 0.5:
        wide = rng.uniform(0.15, 0.35)
        return upright_box(place[0], place[1], foot - 0.3, (wide, wide, rng.uniform(0.6, 1.0)), angle)
    return _raised(face, place, angle, (1.0, 0.8), 0.12)


def _raised(
    face: ExactFace, place: NDArray[np.float64], angle: float, size: tuple[float, float], lift: float
) -> list[Patch]:
    """A rectangle over a pitched face and parallel to it, `lift` metres above, with its rim."""
    along = np.array([np.cos(angle), np.sin(angle)])
    across = np.array([-along[1], along[0]])
    signs = ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))
    plan = np.stack([place + a * size[0] * along + b * size[1] * across for a, b in signs])
    low = np.column_stack([plan, face.height_at(plan)])
    high = low + lift * UP
    return [fan(high), *curtains(closed(low), closed(high))]


def _panels(
    face: ExactFace, inner: shapely.Polygon, gradient: NDArray[np.float64], rng: np.random.Generator
) -> list[Patch]:
    """A field of solar panels, 12 cm above the roof, where it fits."""
    angle = float(np.arctan2(gradient[1], gradient[0]))
    place = _somewhere(inner, rng)
    if place is None:
        return []
    field = _raised(face, place, angle, (rng.uniform(1.6, 3.3), rng.uniform(2.0, 6.0)), 0.12)
    outline = shapely.convex_hull(shapely.MultiPoint(field[0].reshape(-1, 3)[:, :2]))
    return field if inner.contains(outline) else []


def _balconies(
    building: ExactBuilding, free: Callable[[NDArray[np.float64]], bool], rng: np.random.Generator
) -> list[Patch]:
    """Balconies in front of the walls, from the second storey to below the eaves."""
    eaves = min(float(face.height_at(shapely.get_coordinates(face.polygon)).min()) for face in building.faces)
    levels = np.arange(building.base + STOREY_STEP, eaves - 1.5, STOREY_STEP)
    ring = shapely.get_coordinates(shapely.orient_polygons(building.walls).exterior)
    pieces: list[Patch] = []
    for start, end in pairwise(ring):
        length = float(np.hypot(*(end - start)))
        along = (end - start) / max(length, 1e-9)
        outward = np.array([along[1], -along[0]])
        for at in np.arange(PLACE_STEP / 2, length - PLACE_STEP / 2, PLACE_STEP):
            deep = rng.uniform(1.0, 1.6)
            middle = start + at * along + deep / 2 * outward
            if rng.random() < BALCONY_SHARE and free(middle + deep * outward):
                angle = float(np.arctan2(along[1], along[0]))
                for level in levels:
                    pieces += _balcony(middle, float(level), deep, angle)
    return pieces


def _balcony(middle: NDArray[np.float64], level: float, deep: float, angle: float) -> list[Patch]:
    """A slab 3 m wide with a parapet of 1 m around it."""
    return [
        *upright_box(middle[0], middle[1], level - 0.2, (3.0, deep, 0.2), angle),
        *upright_box(middle[0], middle[1], level, (3.0, deep, 1.0), angle, with_top=False),
    ]


def park_car(x: float, y: float, ground: float, angle: float, rng: np.random.Generator) -> ScannedSurfaces:
    """A car, or one time in eight a van: a body and a cabin."""
    if rng.random() < 0.125:
        return ScannedSurfaces.of(upright_box(x, y, ground + 0.3, (5.5, 2.0, 2.1), angle), UNCLASSIFIED)
    length, height = rng.uniform(3.8, 4.9), rng.uniform(1.4, 1.65)
    body = upright_box(x, y, ground + 0.2, (length, 1.8, 0.65), angle)
    cabin = upright_box(x, y, ground + 0.8, (0.55 * length, 1.6, height - 0.8), angle)
    return ScannedSurfaces.of([*body, *cabin], UNCLASSIFIED)


def park_lorry(x: float, y: float, ground: float, angle: float, rng: np.random.Generator) -> ScannedSurfaces:
    """A bus, a lorry or one container or two: a box 6 to 13 m long."""
    size = rng.uniform(6.0, 13.0), rng.uniform(2.4, 2.6), rng.choice([2.6, 3.2, 4.0, 5.2])
    return ScannedSurfaces.of(upright_box(x, y, ground, size, angle), UNCLASSIFIED)


def put_fence(
    start: NDArray[np.float64], end: NDArray[np.float64], terrain: Terrain, rng: np.random.Generator
) -> ScannedSurfaces:
    """A thin fence or garden wall of 0.9 to 2 m along a segment; it follows the ground in steps of 2 m."""
    length = float(np.hypot(*(end - start)))
    plan = start + np.linspace(0.0, 1.0, max(2, int(length / 2.0) + 1))[:, None] * (end - start)
    low = np.column_stack([plan, terrain.at(plan) - 0.2])
    high = low + (0.2 + rng.uniform(0.9, 2.0)) * UP
    return ScannedSurfaces.of(curtains(low, high), UNCLASSIFIED)


def hang_power_line(
    start: NDArray[np.float64], end: NDArray[np.float64], terrain: Terrain, rng: np.random.Generator
) -> ScannedSurfaces:
    """Masts every 60 m or so, 16 to 26 m high, and three wires between them that sag by 2 %."""
    length = float(np.hypot(*(end - start)))
    spans = max(1, round(length / 60.0))
    feet = start + np.linspace(0.0, 1.0, spans + 1)[:, None] * (end - start)
    ground, height = terrain.at(feet), rng.uniform(16.0, 26.0)
    along = (end - start) / length
    left = np.array([-along[1], along[0]])
    angle = float(np.arctan2(along[1], along[0]))
    masts = []
    for foot, level in zip(feet, ground, strict=True):
        masts += upright_box(foot[0], foot[1], level - 0.5, (0.5, 0.5, height + 0.5), angle)
        masts += upright_box(foot[0], foot[1], level + height - 0.3, (0.3, 5.0, 0.3), angle)
    wires = []
    share = np.linspace(0.0, 1.0, 13)
    for aside in (-2.4, 0.0, 2.4):
        for k in range(spans):
            ends = np.column_stack([feet[k : k + 2] + aside * left, ground[k : k + 2] + height])
            line = ends[0] + share[:, None] * (ends[1] - ends[0])
            line[:, 2] -= 0.02 * (length / spans) * 4 * share * (1 - share)
            wires += [_ribbon(line[m], line[m + 1], left, 0.04) for m in range(len(share) - 1)]
    return ScannedSurfaces.join([ScannedSurfaces.of(masts, WIRE_TOWER), ScannedSurfaces.of(wires, WIRE)])


def _ribbon(
    p: NDArray[np.float64], q: NDArray[np.float64], left: NDArray[np.float64], half: float
) -> NDArray[np.float64]:
    """A level strip about a segment: as much of a beam as a wire throws back, without its upright side."""
    side = np.array([*left, 0.0]) * half
    return fan(np.stack([p - side, q - side, q + side, p + side]))


def span_bridge(x: float, y: float, corridor: Corridor, terrain: Terrain) -> ScannedSurfaces:
    """A bridge 8 m wide across a canal, its axis through (x, y), its deck joining the ground of the banks."""
    across = np.array([-np.sin(corridor.angle), np.cos(corridor.angle)])
    along = np.array([across[1], -across[0]])
    offset = float((np.array([x, y]) - [corridor.x, corridor.y]) @ across)
    middle = np.array([x, y]) - offset * across
    plan = [middle + (corridor.reach + 1.0) * side * across for side in (-1.0, 1.0)]
    level = terrain.at(np.stack(plan)) + 0.15
    crown = float(level.max()) + 0.4
    stations = [
        (plan[0], level[0]),
        (middle - 3 * across, crown),
        (middle + 3 * across, crown),
        (plan[1], level[1]),
    ]
    pieces = []
    for (p, low), (q, high) in pairwise(stations):
        corners = ((p, low, -4), (q, high, -4), (q, high, 4), (p, low, 4))
        deck = np.stack([[*(end + aside * along), level_there] for end, level_there, aside in corners])
        pieces.append(fan(deck))
        for a, b in ((0, 1), (3, 2)):
            rail = deck[[a, b]]
            pieces.append(curtain(rail, rail + UP))
    return ScannedSurfaces.of(pieces, BRIDGE_DECK)
