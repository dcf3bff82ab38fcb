"""Completeness, correctness, quality: the three figures every comparison of two sets ends in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eaves.model import Values


def ratio(part: float, total: float) -> float:
    """part / whole, NaN when there is no whole."""
    return float(part / total) if total else float("nan")


def root_mean_square(values: Values) -> float:
    """√mean(v²), NaN when there is none."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


@dataclass(frozen=True)
class Agreement:
    """Completeness and correctness of a result against a reference [heipke1997].

    By area `found` and `correct` are equal; by objects they need not be, for one object may stand for
    several. A measure with nothing to divide by is NaN.

    Parameters
    ----------
    found, reference : float
        Area (m²) or number of objects of the reference that was found, and all of it.
    correct, result : float
        Area (m²) or number of objects of the result that is right, and all of it.

    Examples
    --------
    >>> from eaves.evaluate import Agreement
    >>> score = Agreement(found=8, reference=10, correct=8, result=8)
    >>> score.completeness, score.correctness, score.quality
    (0.8, 1.0, 0.8)
    """

    found: float
    reference: float
    correct: float
    result: float

    @property
    def completeness(self) -> float:
        """TP / (TP + FN)."""
        return ratio(self.found, self.reference)

    @property
    def correctness(self) -> float:
        """TP / (TP + FP)."""
        return ratio(self.correct, self.result)

    @property
    def f1(self) -> float:
        """The harmonic mean of completeness and correctness."""
        return ratio(2.0 * self.completeness * self.correctness, self.completeness + self.correctness)

    @property
    def quality(self) -> float:
        """TP / (TP + FN + FP), written so that it holds for both counts of TP [rutzinger2009], eq. 3."""
        product = self.completeness * self.correctness
        total = self.completeness + self.correctness
        return ratio(product, total - product) if total else 0.0
