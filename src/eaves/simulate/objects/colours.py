"""The colours and the intensity of simulated points, by the kind of surface they lie on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from eaves.model import BUILDING, GROUND, HIGH_VEGETATION, LOW_VEGETATION
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
