"""A measure's means on roofs and on crowns, and what a value of it tells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eaves.detect.consensus.windows import WINDOW
from eaves.model import Values


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
    parts = list[tuple[float, float, float]]()
    for weights in (roof, 1.0 - roof):
        total = max(float(weights.sum()), 1e-300)
        mean = float((weights * value).sum()) / total
        parts.append((mean, float((weights * (value - mean) ** 2).sum()) / total, float(weights.sum())))
    return separation(parts[0], parts[1], WINDOW**2)
