"""Trees, shrubs and hedges: bodies of leaves that let part of a pulse through."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eaves.model.cloud import HIGH_VEGETATION, LOW_VEGETATION, MEDIUM_VEGETATION
from eaves.simulate.objects.surfaces import ScannedSurfaces, upright_box

ELLIPSOID, CONE, BLOCK = 0, 1, 2
"""Shapes of a body of leaves: a broad crown or shrub, a conifer, a clipped hedge."""

MEDIUM_FROM, HIGH_FROM = 0.5, 2.0
"""Tops above ground (m) from which vegetation is called medium and high; national rules differ a little."""


@dataclass(frozen=True, eq=False)
class Foliage:
    """V bodies of leaves.

    `bodies` (V, 9): x, y, z of the centre, half sizes along its own x, y and up, cosine and sine of its
    direction, and the mean loss of a pulse's energy per metre (1/m). `shape` and `truth_class` are (V,).
    """

    bodies: NDArray[np.float64]
    shape: NDArray[np.int32]
    truth_class: NDArray[np.uint8]

    @classmethod
    def none(cls) -> Foliage:
        """No leaves at all."""
        return cls(np.zeros((0, 9)), np.zeros(0, np.int32), np.zeros(0, np.uint8))

    @classmethod
    def join(cls, parts: list[Foliage]) -> Foliage:
        """All the bodies of the parts, in order."""
        every = [vars(part).values() for part in (cls.none(), *parts)]
        return cls(*map(np.concatenate, zip(*every, strict=True)))


def _one(
    shape: int,
    centre: tuple[float, float, float],
    half: tuple[float, float, float],
    angle: float,
    loss: float,
    top: float,
) -> Foliage:
    kind = LOW_VEGETATION if top < MEDIUM_FROM else MEDIUM_VEGETATION if top < HIGH_FROM else HIGH_VEGETATION
    body = np.array([[*centre, *half, np.cos(angle), np.sin(angle), loss]])
    return Foliage(body, np.array([shape], np.int32), np.array([kind], np.uint8))


def grow_tree(
    x: float, y: float, ground: float, rng: np.random.Generator, leaf_loss: float = 2.5
) -> tuple[Foliage, ScannedSurfaces]:
    """A tree's leaves and its trunk.

    Three in four are broadleaved: height 5 to 20 m (mean 10), crown as wide as 0.45 to 0.75 of it, of one to
    four lobes. The others are conifers. `leaf_loss` (1/m) is the loss of energy per metre of crown.
    """
    height = float(np.clip(rng.gamma(6.0, 1.75), 4.0, 22.0))
    parts = []
    if rng.random() < 0.75:
        radius = height * rng.uniform(0.22, 0.38)
        clear = height * rng.uniform(0.15, 0.35)
        for _ in range(int(rng.integers(1, 5))):
            share = rng.uniform(0.6, 1.0)
            shift = radius * (1 - share) * np.array([rng.uniform(-1.2, 1.2), rng.uniform(-1.2, 1.2)])
            deep = (height - clear) / 2 * rng.uniform(0.7, 1.0)
            centre = (x + shift[0], y + shift[1], ground + height - deep - rng.uniform(0, 0.15) * height)
            half = (radius * share, radius * share, deep)
            parts.append(_one(ELLIPSOID, centre, half, 0.0, leaf_loss * rng.uniform(0.6, 1.5), height))
    else:
        clear, radius = height * rng.uniform(0.05, 0.2), height * rng.uniform(0.13, 0.22)
        half = (radius, radius, (height - clear) / 2)
        centre = (x, y, ground + (height + clear) / 2)
        parts.append(_one(CONE, centre, half, 0.0, 1.6 * leaf_loss, height))
    thick = 0.02 * height + 0.08
    trunk = upright_box(x, y, ground - 0.5, (thick, thick, 0.5 * height), 0.0)
    return Foliage.join(parts), ScannedSurfaces.of(trunk, HIGH_VEGETATION)


def grow_shrub(x: float, y: float, ground: float, rng: np.random.Generator) -> Foliage:
    """A shrub of 0.3 to 2.5 m."""
    height, radius = rng.uniform(0.3, 2.5), rng.uniform(0.4, 1.2)
    half = (radius, radius * rng.uniform(0.7, 1.0), 0.55 * height)
    return _one(ELLIPSOID, (x, y, ground + 0.45 * height), half, rng.uniform(0, np.pi), 3.0, height)


def grow_hedge(
    start: NDArray[np.float64],
    end: NDArray[np.float64],
    ground: NDArray[np.float64],
    rng: np.random.Generator,
) -> Foliage:
    """A clipped hedge of 0.8 to 2.2 m along a segment, in pieces that follow the `ground` (K,) under it."""
    height, thick = rng.uniform(0.8, 2.2), rng.uniform(0.5, 0.9)
    steps = np.linspace(0.0, 1.0, len(ground) + 1)
    corners = start + steps[:, None] * (end - start)
    length = float(np.hypot(*(end - start))) / len(ground)
    angle = float(np.arctan2(*(end - start)[::-1]))
    pieces = []
    for middle, level in zip((corners[1:] + corners[:-1]) / 2, ground, strict=True):
        half = (length / 2, thick / 2, height / 2)
        pieces.append(_one(BLOCK, (*middle, level + height / 2), half, angle, 4.0, height))
    return Foliage.join(pieces)
