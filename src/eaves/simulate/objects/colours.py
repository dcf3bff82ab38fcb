"""The colours and the intensity of simulated points, by the kind of surface they lie on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import ndimage

from eaves.model import (
    BUILDING,
    GROUND,
    HIGH_VEGETATION,
    LOW_VEGETATION,
    UNCLASSIFIED,
    WATER,
    Labels,
    Mask,
    Values,
)
from eaves.simulate.objects.exact import ExactScene

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
