"""Ground filtering against a reference, point by point [sithole_vosselman2004]."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eaves.evaluate.scores import ratio
from eaves.model import Mask


@dataclass(frozen=True)
class GroundScore:
    """Counts of points, and the errors of Sithole and Vosselman 2004, section 4.2, as shares of one.

    Parameters
    ----------
    ground_kept, ground_rejected : int
        Ground points of the reference that the result has as ground, and as objects.
    object_accepted, object_rejected : int
        Object points of the reference that the result has as ground, and as objects.

    Examples
    --------
    >>> from eaves.evaluate import GroundScore
    >>> GroundScore(90, 10, 5, 95).type_1
    0.1
    """

    ground_kept: int
    ground_rejected: int
    object_accepted: int
    object_rejected: int

    @property
    def points(self) -> int:
        """Number of points that were judged."""
        return self.ground_kept + self.ground_rejected + self.object_accepted + self.object_rejected

    @property
    def type_1(self) -> float:
        """Ground points called object, of all ground points."""
        return ratio(self.ground_rejected, self.ground_kept + self.ground_rejected)

    @property
    def type_2(self) -> float:
        """Object points called ground, of all object points."""
        return ratio(self.object_accepted, self.object_accepted + self.object_rejected)

    @property
    def total_error(self) -> float:
        """Points of the wrong class, of all points."""
        return ratio(self.ground_rejected + self.object_accepted, self.points)

    @property
    def kappa(self) -> float:
        """Agreement beyond chance [cohen1960]; NaN when both name one class only."""
        reference = ratio(self.ground_kept + self.ground_rejected, self.points)
        result = ratio(self.ground_kept + self.object_accepted, self.points)
        chance = reference * result + (1 - reference) * (1 - result)
        return ratio(1 - self.total_error - chance, 1 - chance)

    @property
    def f1(self) -> float:
        """Harmonic mean of precision and recall of ground."""
        return ratio(2 * self.ground_kept, 2 * self.ground_kept + self.ground_rejected + self.object_accepted)


def evaluate_ground(result: Mask, reference: Mask) -> GroundScore:
    """Scores of two ground masks of the same points.

    Parameters
    ----------
    result, reference : ndarray (N,) of bool
        Masks of the ground points.

    Returns
    -------
    GroundScore
        A share with nothing to divide by is NaN.

    Raises
    ------
    ValueError
        When the masks differ in shape.

    Examples
    --------
    >>> import numpy as np
    >>> from eaves.evaluate import evaluate_ground
    >>> score = evaluate_ground(np.array([True, True, False, False]), np.array([True, False, False, False]))
    >>> score.total_error
    0.25
    """
    if result.shape != reference.shape:
        raise ValueError(f"masks of {result.shape} and {reference.shape} points cannot be compared")
    return GroundScore(
        int(np.sum(reference & result)),
        int(np.sum(reference & ~result)),
        int(np.sum(~reference & result)),
        int(np.sum(~reference & ~result)),
    )
