"""The ground stage: contract of a filter, and the verb that classifies a cloud with one."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import numpy as np
from numba import njit

from eaves.ground.toolkit.outliers import find_outliers
from eaves.methods import Emit, Method, MethodChoice, emitter, ignore, resolve_method
from eaves.model import Mask, PointCloud, Points
from eaves.model.cloud import GROUND, HIGH_NOISE, LOW_NOISE, NOISE_CLASSES, UNCLASSIFIED


class GroundMethod(Method):
    """Tells ground from everything else.

    `ground_mask` sees a cloud without noise, in canonical order, about the origin of its block, with or
    without returns, and answers a mask (N,). It may be given 0, 1, 2, collinear or duplicate points.
    """

    stage: ClassVar[str] = "ground"

    def ground_mask(self, cloud: PointCloud, emit: Emit = ignore) -> Mask:
        """Whether each point is ground; see the class."""
        raise NotImplementedError


def classify_ground(
    cloud: PointCloud,
    method: MethodChoice = None,
    *,
    use_classes: bool = False,
    debug: str | Path | Emit | None = None,
) -> PointCloud:
    """The cloud with classes 2 (ground), 7 and 18 (low and high noise) and 1 (the rest).

    Parameters
    ----------
    cloud
        N points in any order; those with NaN coordinates become class 7.
    method
        The filter; the default is `AdaptiveTin()`.
    use_classes
        Believe the file's classes 2, 7 and 18 instead of filtering, and keep its other classes; without
        any class 2 the method runs all the same.
    debug
        A folder or a callback that receives every named intermediate.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> cloud = eaves.classify_ground(truth.cloud)
    >>> wrong = (cloud.classification == 2) != (truth.truth_class == 2)
    >>> bool(wrong.mean() < 0.05)
    True
    """
    given = cloud.classification
    finite = finite_kernel(cloud.xyz)
    classes = np.full(len(cloud), UNCLASSIFIED, np.uint8)
    classes[~finite] = LOW_NOISE
    believed = use_classes and given is not None and bool((given == GROUND).any())
    if believed and given is not None:
        classes[finite] = given[finite]
        return cloud.with_(classification=classes)

    left = np.flatnonzero(finite)
    if given is not None:  # noise is noise whoever says so
        said = np.isin(given[left], NOISE_CLASSES)
        classes[left[said]] = given[left[said]]
        left = left[~said]
    taken = cloud.take(left)
    low, high = find_outliers(taken)
    classes[left[low]], classes[left[high]] = LOW_NOISE, HIGH_NOISE
    good = np.flatnonzero(~(low | high))
    taken, good = taken.take(good), left[good]
    order = taken.canonical_order()
    filter_ = resolve_method("ground", method)
    assert isinstance(filter_, GroundMethod)
    mask = filter_.ground_mask(taken.take(order), emitter(debug))
    classes[good[order[mask]]] = GROUND
    return cloud.with_(classification=classes)


@njit(cache=True)
def finite_kernel(xyz: Points) -> Mask:
    """Which points (N, 3) have coordinates."""
    finite = np.empty(len(xyz), np.bool_)
    for i in range(len(xyz)):
        finite[i] = np.isfinite(xyz[i, 0]) and np.isfinite(xyz[i, 1]) and np.isfinite(xyz[i, 2])
    return finite
