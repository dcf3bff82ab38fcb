"""Matching of the objects of a result and of a reference: overlaps, and the relations they form.

Objects are the labels of two arrays of one shape: cells of label images, or points. An object is found when
at least half of it is covered by objects of the other set; covered by how many does not matter, so that
splitting and merging are no errors of detection but are reported as relations 1:M, N:1 and N:M, as after the
topological clarification of [rutzinger2009], section 2.3.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from eaves.model import Integers, Mask, Values


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


SMALLEST = 2.5
"""Objects under this area (m²) are left out [isprs_evaluation]."""

HALF = 0.5
"""Part of an object that must be covered for it to be found [rutzinger2009].

Two objects belong together when they share this part of either: less is a rim that is off, not a second
partner.
"""

RELATIONS = ("1:1", "1:M", "N:1", "N:M", "1:0", "0:1")
"""So many of the reference stand for so many of the result; 1:0 was missed, 0:1 is false."""


@dataclass(frozen=True, eq=False)
class Objects:
    """Objects of one set: their `label` and `area` (m²), both (K,)."""

    label: Integers
    area: Values

    def __len__(self) -> int:
        return len(self.label)


@dataclass(frozen=True, eq=False)
class Matching:
    """Overlaps of the objects of a result and a reference.

    `result_number` and `reference_number` (P,) are positions in the two sets, `shared` (P,) the area (m²)
    they share.
    """

    result: Objects
    reference: Objects
    result_number: Integers
    reference_number: Integers
    shared: Values

    @cached_property
    def result_covered(self) -> Values:
        """Share (K,) of each result object that the reference covers."""
        covered = np.bincount(self.result_number, self.shared, len(self.result))
        return np.asarray(covered / self.result.area)

    @cached_property
    def reference_covered(self) -> Values:
        """Share (M,) of each reference object that the result covers."""
        covered = np.bincount(self.reference_number, self.shared, len(self.reference))
        return np.asarray(covered / self.reference.area)

    @cached_property
    def together(self) -> Mask:
        """Mask (P,) of the overlaps that make partners: those of half of either object or more."""
        return np.asarray(
            (self.shared >= HALF * self.result.area[self.result_number])
            | (self.shared >= HALF * self.reference.area[self.reference_number])
        )

    @cached_property
    def groups(self) -> tuple[Integers, Integers]:
        """The group each result (K,) and each reference object (M,) belongs to: those linked by overlaps."""
        count, result_node = len(self.result) + len(self.reference), self.result_number[self.together]
        reference_node = self.reference_number[self.together] + len(self.result)
        links = coo_array((np.ones(len(result_node)), (result_node, reference_node)), shape=(count, count))
        _, group = connected_components(links, directed=False)
        return group[: len(self.result)].astype(np.int64), group[len(self.result) :].astype(np.int64)

    @property
    def relations(self) -> dict[str, int]:
        """Number of groups that are 1:1, 1:M (one reference, several results), N:1, N:M, 1:0 and 0:1."""
        result, reference = self.groups
        count = int(max(result.max(initial=-1), reference.max(initial=-1))) + 1
        sizes = zip(
            np.bincount(reference, minlength=count), np.bincount(result, minlength=count), strict=True
        )
        counts = Counter(relation_of(int(n), int(m)) for n, m in sizes)
        return {name: counts[name] for name in RELATIONS}

    def agreement(self, larger_than: float = 0.0) -> Agreement:
        """Objects found and correct, of those over an area (m²); each set is judged by its own areas."""
        large_references, large_results = self.reference.area > larger_than, self.result.area > larger_than
        return Agreement(
            int((self.reference_covered[large_references] >= HALF).sum()),
            int(large_references.sum()),
            int((self.result_covered[large_results] >= HALF).sum()),
            int(large_results.sum()),
        )


def relation_of(reference: int, result: int) -> str:
    """The name of a group of so many reference and result objects."""
    return f"{'N' if reference > 1 else reference}:{'M' if result > 1 else result}"


def match_objects(
    result: Integers, reference: Integers, area: float, smallest: float = SMALLEST
) -> tuple[Matching, Integers, Integers]:
    """The matching of two label arrays of one shape, 0 for none, and the arrays without the small objects.

    `area` (m²) is what one element stands for: that of a cell, or one over the density of points.
    """
    if result.shape != reference.shape:
        raise ValueError(f"label arrays of {result.shape} and {reference.shape} cannot be compared")
    result, judged = _without_small(result, area, smallest)
    reference, true = _without_small(reference, area, smallest)
    shared = (result > 0) & (reference > 0)
    pairs, counts = np.unique(np.stack([result[shared], reference[shared]]), axis=1, return_counts=True)
    result_number = np.searchsorted(judged.label, pairs[0])
    reference_number = np.searchsorted(true.label, pairs[1])
    shared_m2 = (counts * area).astype(np.float64)
    return Matching(judged, true, result_number, reference_number, shared_m2), result, reference


def _without_small(labels: Integers, area: float, smallest: float) -> tuple[Integers, Objects]:
    """The labels with objects under `smallest` (m²) set to 0, and the objects that remain."""
    label, count = np.unique(labels[labels > 0], return_counts=True)
    large = count * area >= smallest
    large_labels = np.where(np.isin(labels, label[large]), labels, 0)
    return large_labels, Objects(label[large].astype(np.int64), (count[large] * area).astype(np.float64))


FARTHEST = 3.0
"""Rim points farther than this (m) from the reference's rim are not the same rim [isprs_evaluation]."""

CANDIDATES = 8
"""Sides whose middles are nearest to a point; the nearest side is among them, as all are of one length."""

Sides = tuple[Values, Mask]
"""Middles (N, 2) of cell sides, m from the upper left corner (x right, y down); which are upright (N,)."""


def rim_of(inside: Mask, cell: float) -> Sides:
    """The cell sides between inside and outside of a mask (H, W); the raster's frame is outside."""
    framed = np.pad(inside, 1)
    row, column = np.nonzero(framed[1:-1, 1:] != framed[1:-1, :-1])
    upright = np.stack([column, row + 0.5], axis=1)
    row, column = np.nonzero(framed[1:, 1:-1] != framed[:-1, 1:-1])
    level = np.stack([column + 0.5, row], axis=1)
    middles = np.concatenate([upright, level]) * cell
    return middles, np.repeat([True, False], [len(upright), len(level)])


def rim_distances(result: Sides, reference: Sides, cell: float) -> Values:
    """Distances (m) of the middles of a result's sides from the reference's rim, those over 3 m left out."""
    middles, (targets, upright) = result[0], reference
    if len(middles) == 0 or len(targets) == 0:
        return np.zeros(0)
    count = min(CANDIDATES, len(targets))
    _, which = cKDTree(targets).query(middles, k=count)
    which = np.asarray(which).reshape(len(middles), count)
    away = np.abs(middles[:, None] - targets[which])
    beside = np.where(upright[which], away[..., 0], away[..., 1])
    beyond = np.maximum(np.where(upright[which], away[..., 1], away[..., 0]) - cell / 2, 0.0)
    distance = np.hypot(beside, beyond).min(axis=1)
    return np.asarray(distance[distance <= FARTHEST])


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
