"""Roof planes against a reference, as in the ISPRS benchmark [rottensteiner2014], section 4.2.

Planes are labels of cells (a cell is of its highest plane) or of points. Those of two sets belong together,
and are found, by the rules of buildings; the rims give the error in plan, the heights of cells or points that
planes share the error in height.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from eaves.evaluate.detection_scores import ObjectRow, object_rows
from eaves.evaluate.matching import (
    Agreement,
    Matching,
    match_objects,
    rim_distances,
    rim_of,
    root_mean_square,
)
from eaves.model import Integers, Values
from eaves.model.checks import check_positive, check_same_shape

SMALLEST_PLANE = 0.0
"""The benchmark counts roof planes of any size."""

LARGE_PLANE = 10.0
"""Planes over this area (m²) are counted apart."""


@dataclass(frozen=True, eq=False)
class PlaneScore:
    """Scores of roof planes.

    Parameters
    ----------
    planes, planes_over_10 : Agreement
        By number of planes, and of planes over 10 m².
    relations : dict of str to int
        Relation (`1:1`, `1:M`, …) → number of groups.
    rms_xy_m, rms_z_m : float
        Root mean square distance (m) of the outlines in plan, and of the heights; NaN where they are not
        given.
    rows : tuple of ObjectRow
        One a plane, those of the reference first.

    Examples
    --------
    >>> import numpy as np
    >>> from eaves.evaluate import evaluate_planes
    >>> label = np.kron([[1, 2]], np.ones((6, 6), int))
    >>> evaluate_planes(label, label, area=1.0).planes.completeness
    1.0
    """

    planes: Agreement
    planes_over_10: Agreement
    relations: dict[str, int]
    rms_xy_m: float
    rms_z_m: float
    rows: tuple[ObjectRow, ...]


def evaluate_planes(
    result: Integers,
    reference: Integers,
    area: float,
    result_height: Values | None = None,
    reference_height: Values | None = None,
) -> PlaneScore:
    """Scores of plane labels against reference labels.

    Parameters
    ----------
    result, reference : ndarray (H, W) or (N,) of int
        Labels of cells or points, 0 for none; both of the same elements.
    area : float
        Area of one element (m², > 0): that of a cell, or one over the density of points.
    result_height, reference_height : ndarray or None
        Heights (m) of the two sets of planes at the elements, same shapes; NaN where there is none.

    Returns
    -------
    PlaneScore
        Agreement, relations and distances.

    Raises
    ------
    TypeError
        When `area` is no number.
    ValueError
        When the arrays differ in shape, or `area` is not above 0.

    Examples
    --------
    >>> import numpy as np
    >>> from eaves.evaluate import evaluate_planes
    >>> true = np.repeat([[1, 1, 1, 2, 2, 2]], 6, axis=0)
    >>> evaluate_planes(np.ones_like(true), true, area=1.0).planes.correctness
    1.0
    """
    check_same_shape(result, reference, ("result", "reference"))
    check_positive(area, "area", "m²")
    matching, result, reference = match_objects(result, reference, area, SMALLEST_PLANE)
    rms_xy = _rms_in_plan(matching, result, reference, float(np.sqrt(area))) if result.ndim == 2 else np.nan
    rms_z = np.nan
    if result_height is not None and reference_height is not None:
        together = _labels_together(matching)
        keys = result.astype(np.int64) * (int(reference.max(initial=0)) + 1) + reference
        matched_keys = together[:, 0] * (int(reference.max(initial=0)) + 1) + together[:, 1]
        matched = np.isin(keys, matched_keys) & (result > 0) & (reference > 0)
        difference = (result_height - reference_height)[matched]
        rms_z = root_mean_square(difference[np.isfinite(difference)])
    return PlaneScore(
        matching.agreement(),
        matching.agreement(LARGE_PLANE),
        matching.relations,
        float(rms_xy),
        float(rms_z),
        object_rows(matching),
    )


def _labels_together(matching: Matching) -> Integers:
    """Pairs (P, 2) of labels of planes that belong together."""
    pair = matching.together
    return np.stack(
        [
            matching.result.label[matching.result_number[pair]],
            matching.reference.label[matching.reference_number[pair]],
        ],
        axis=1,
    )


def _rms_in_plan(matching: Matching, result: Integers, reference: Integers, cell: float) -> float:
    """RMS (m) of the rims of planes from the rims of the reference planes they belong to, group by group."""
    judged = _group_image(result, matching.result.label, matching.groups[0])
    true = _group_image(reference, matching.reference.label, matching.groups[1])
    distances = [np.zeros(0)]
    boxes = zip(ndimage.find_objects(judged), ndimage.find_objects(true), strict=False)
    for group, (judged_window, true_window) in enumerate(boxes, 1):
        if judged_window is None or true_window is None:
            continue
        window = tuple(
            slice(min(a.start, b.start), max(a.stop, b.stop))
            for a, b in zip(judged_window, true_window, strict=True)
        )
        rims = rim_of(judged[window] == group, cell), rim_of(true[window] == group, cell)
        distances.append(rim_distances(*rims, cell))
    return root_mean_square(np.concatenate(distances))


def _group_image(labels: Integers, label: Integers, group: Integers) -> Integers:
    """The group, from 1, of each cell's object; 0 for none."""
    place = np.searchsorted(label, labels)
    return np.where(labels > 0, np.append(group, -1)[place] + 1, 0)
