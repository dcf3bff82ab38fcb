"""How well a measure tells roofs from crowns in this very scan, and what it says of a place there."""

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
        """How well the measure tells roofs from crowns: 0 not at all, 1 without mistake."""
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


def separate(value: Values, roof: Values) -> Separation:
    """The separation of values (K,) of cells, of which `roof` (K,) is the probability of each to be a roof.

    Crowns split more pulses and let more of them through than roofs: a measure that is the other way round in
    a scan is no witness there. The cells of a window share its points and are one observation.
    """
    crown = 1.0 - roof
    weight_roof, weight_crown = float(roof.sum()), float(crown.sum())
    if min(weight_roof, weight_crown) < WINDOW**2:
        return nothing()
    on_roofs = float((roof * value).sum()) / weight_roof
    on_crowns = float((crown * value).sum()) / weight_crown
    scatter = float((roof * (value - on_roofs) ** 2).sum()) / weight_roof
    scatter += float((crown * (value - on_crowns) ** 2).sum()) / weight_crown
    spread = max(1e-3, float(np.sqrt(scatter / 2)))
    distance = on_crowns - on_roofs
    if distance <= 0.0:
        return nothing()
    chance = spread**2 * WINDOW**2 * (1.0 / weight_roof + 1.0 / weight_crown)
    trust = max(0.0, 1.0 - chance / distance**2)
    return Separation(on_roofs, on_crowns, spread, trust)
