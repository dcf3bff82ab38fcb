"""Colours in place of echoes: what a scan that splits no pulse shows of leaves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.detect.consensus.separation import Separation, nothing, separation
from eaves.model import PointCloud, Values

Counts = NDArray[np.float64]

COLOURS = ("red", "green", "blue")
"""Fields of the colours that a camera sees."""
FULL_8, FULL_16 = 255.0, 65535.0
"""The largest value of a colour, of 8 and of 16 bits: some programs write the former for the latter."""
SHADE = 0.5
"""Weight of the light that is missing beside the excess green."""
EDGES = np.linspace(-0.6, 2.4, 151)
"""Of the classes in which signs are counted, as far as they can reach."""
MIDDLES = (EDGES[1:] + EDGES[:-1]) / 2.0
ROUNDS = 200
"""Of expectation maximisation."""
LEAST_SPREAD, MOST_SPREAD = 0.03, 0.1
"""Standard deviation of the signs of roofs: a camera's noise, and that of white, red and grey ones together;
where crowns are all that is smooth, a wider one would be theirs."""


def has_colours(cloud: PointCloud) -> bool:
    """True if colours speak for a scan that splits no pulse."""
    return not cloud.has_returns and set(COLOURS) <= cloud.fields.keys()


def signs_of_leaves(cloud: PointCloud) -> Values:
    """What each point (N,) shows of leaves: 1 where its pulse had several returns; of a scan that splits no
    pulse how green and dark it is, 0 without colours.

    Excess green is 2 g - r - b of the shares of the colours [woebbecke1995]; leaves shade each other, so that
    half the share of light that is missing is added: both spread as far on roofs.
    """
    if not has_colours(cloud):
        several = cloud.number_of_returns
        return np.zeros(len(cloud)) if several is None else (several > 1).astype(np.float64)
    red, green, blue = (cloud.fields[name] for name in COLOURS)
    light = red + green + blue
    white = 3.0 * (FULL_8 if light.max(initial=0.0) <= 3.0 * FULL_8 else FULL_16)
    return np.asarray((3.0 * green - light) / np.maximum(light, 1.0) + SHADE * (1.0 - light / white))


def count_signs(*signs: Values) -> Counts:
    """How many of each of some arrays of signs lie in each class (n, 150)."""
    return np.array([np.histogram(values, EDGES)[0] for values in signs], np.float64)


def learned(counts: Counts, alike: float) -> Separation:
    """What signs tell, of counts (3, 150) on the terrain, on rough places over it and on smooth ones.

    Smooth places are roofs, relief with the signs of the terrain, and crowns with those of rough places; how
    many of each, and the normal distribution of roofs, are those of the greatest likelihood (expectation
    maximisation, [dempster1977]). Of so many signs that are `alike` one is an observation.
    """
    smooth = counts[2]
    if min(counts[0].sum(), smooth.sum()) < alike:
        return nothing()
    known = (counts[:2] + 1e-6) / (counts[:2] + 1e-6).sum(axis=1, keepdims=True)
    middle = float(MIDDLES[np.searchsorted(np.cumsum(smooth), smooth.sum() / 10.0)])
    spread, shares, likely = MOST_SPREAD, np.full(3, 1.0 / 3.0), smooth
    for _ in range(ROUNDS):
        roofs = np.exp(-0.5 * ((MIDDLES - middle) / spread) ** 2)
        each = shares[:, None] * np.vstack([roofs / roofs.sum(), known])
        parts = smooth * each / np.maximum(each.sum(axis=0), 1e-300)
        shares, likely = parts.sum(axis=1) / smooth.sum(), parts[0]
        middle, variance = _moments(likely)
        spread = min(max(variance**0.5, LEAST_SPREAD), MOST_SPREAD)
    others = shares[1:] @ known
    rest = (*_moments(others), float(smooth.sum() * shares[1:].sum()))
    return separation((middle, spread**2, float(likely.sum())), rest, alike)


def _moments(weights: Values) -> tuple[float, float]:
    """Mean and variance of signs with such weights (150,) of their classes."""
    total = max(float(weights.sum()), 1e-12)
    mean = float(weights @ MIDDLES) / total
    return mean, float(weights @ (MIDDLES - mean) ** 2) / total
