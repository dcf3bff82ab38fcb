"""What a measure tells of roofs and crowns: echoes, penetration, and colours in their place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eaves.detect.consensus.windows import WINDOW
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
        middle, variance, _ = moments(MIDDLES, likely)
        spread = min(max(variance**0.5, LEAST_SPREAD), MOST_SPREAD)
    mean, variance, _ = moments(MIDDLES, (shares[1:] + 1e-6) @ known)
    others = mean, variance, float(counts[:2].sum())  # as many show what the others look like
    return separation((middle, spread**2, float(likely.sum())), others, alike)


def moments(value: Values, weights: Values) -> tuple[float, float, float]:
    """Mean and variance of values (K,) with such weights (K,), and the sum of these."""
    weight = float(weights.sum())
    total = max(weight, 1e-300)
    mean = float((weights * value).sum()) / total
    return mean, float((weights * (value - mean) ** 2).sum()) / total, weight


@dataclass(frozen=True)
class Separation:
    """A measure's means on roofs and on crowns of a scan, and its spread about them.

    The log likelihood ratio of a value v is that of two normal distributions of one spread,
    (roof - crown) / spread² · (v - (roof + crown) / 2), times `trust`, the share of the squared distance of
    the means that chance does not explain [james_stein1961]. Where the measure is alike on both, the
    ratio is 0 everywhere.
    """

    roof: float
    crown: float
    spread: float
    trust: float

    @property
    def power(self) -> float:
        """Power of the measure to part roofs from crowns: 0 none, 1 without mistake."""
        distance = self.trust * ((self.roof - self.crown) / self.spread) ** 2
        return distance / (1.0 + distance)

    def log_ratio(self, value: Values, most: float) -> Values:
        """Log likelihood ratio for a roof, of values of any shape, no larger than `most` either way."""
        slope = self.trust * (self.roof - self.crown) / self.spread**2
        ratio = slope * (value - (self.roof + self.crown) / 2)
        return np.asarray(np.clip(ratio, -most, most), np.float64)


def nothing() -> Separation:
    """The measure tells nothing."""
    return Separation(0.0, 0.0, 1.0, 0.0)


def separation(
    roofs: tuple[float, float, float], crowns: tuple[float, float, float], alike: float
) -> Separation:
    """The separation of a measure by its mean, variance and number of values on either; so many
    values that are `alike` are one observation."""
    (on_roofs, variance_roof, weight_roof), (on_crowns, variance_crown, weight_crown) = roofs, crowns
    if min(weight_roof, weight_crown) < alike:
        return nothing()
    spread = max(1e-3, float(np.sqrt((variance_roof + variance_crown) / 2)))
    distance = on_crowns - on_roofs
    if distance <= 0.0:
        return nothing()
    chance = spread**2 * alike * (1.0 / weight_roof + 1.0 / weight_crown)
    trust = max(0.0, 1.0 - chance / distance**2)
    return Separation(on_roofs, on_crowns, spread, trust)


def separate(value: Values, roof: Values) -> Separation:
    """The separation of values (K,) of cells, of which `roof` (K,) is the probability of each to be a roof.

    Crowns split more pulses and let more of them through than roofs: a measure that is the other way round in
    a scan is no witness there. The cells of a window share its points and are one observation.
    """
    return separation(moments(value, roof), moments(value, 1.0 - roof), WINDOW**2)
