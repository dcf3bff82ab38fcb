"""Building detection against a reference, as in the ISPRS benchmark [rutzinger2009] [rottensteiner2014].

Both are label images on one grid. Cells that hold no point, where a cloud is the reference, are left out; so
are objects under 2.5 m². Compared are the areas, the objects, and the rims.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from eaves.evaluate.matching import (
    SMALLEST,
    Matching,
    match_objects,
    relation_of,
    rim_distances,
    rim_of,
)
from eaves.evaluate.scores import Agreement, root_mean_square
from eaves.model import Integers, Mask
from eaves.model.checks import check_positive, check_same_shape
from eaves.raster import UNKNOWN, agreement_codes

LARGE_AREAS = (10.0, 50.0)
"""Objects over these areas (m²) are counted apart."""

"""Values of the map of agreement; 0 is ground in both."""


@dataclass(frozen=True)
class ObjectRow:
    """One object: the set it is of, its area (m²), the share the other set covers, and its relation."""

    set: str
    label: int
    area_m2: float
    covered: float
    found: bool
    relation: str


@dataclass(frozen=True, eq=False)
class DetectionScore:
    """Scores of a label image of buildings.

    Parameters
    ----------
    area, objects : Agreement
        By area (m²) and by number of objects.
    objects_over : dict of float to Agreement
        Smallest area (10, 50 m²) → agreement of the objects from that size on.
    relations : dict of str to int
        Relation (`1:1`, `1:M`, `N:1`, `N:M`, `1:0`, `0:1`) → number of groups.
    rms_m : float
        Root mean square distance (m) of the outlines of correct objects from the reference outlines; NaN
        without any.
    map : ndarray (H, W) of uint8
        1 found, 2 missed, 3 false, 255 unknown, 0 no building.
    rows : tuple of ObjectRow
        One an object, those of the reference first.

    Examples
    --------
    >>> import numpy as np
    >>> from eaves.evaluate import evaluate_detection
    >>> label = np.kron([[1, 0], [0, 2]], np.ones((6, 6), int))
    >>> evaluate_detection(label, label, cell=0.5).relations["1:1"]
    2
    """

    area: Agreement
    objects: Agreement
    objects_over: dict[float, Agreement]
    relations: dict[str, int]
    rms_m: float
    map: NDArray[np.uint8]
    rows: tuple[ObjectRow, ...]


def label_objects(mask: Mask) -> Integers:
    """Labels of the pieces of a mask: cells that share a side belong together.

    Parameters
    ----------
    mask : ndarray (H, W) of bool
        True where buildings are.

    Returns
    -------
    ndarray (H, W) of int64
        1…K by piece, 0 outside.

    Raises
    ------
    ValueError
        When the mask has not two dimensions.

    Examples
    --------
    >>> import numpy as np
    >>> from eaves.evaluate import label_objects
    >>> label_objects(np.array([[1, 1, 0, 1]], bool)).tolist()
    [[1, 1, 0, 2]]
    """
    if np.ndim(mask) != 2:
        raise ValueError(f"mask must have the shape (H, W), not {np.shape(mask)}; give one raster of cells")
    labels, _ = ndimage.label(mask)
    return np.asarray(labels, np.int64)


def evaluate_detection(
    result: Integers,
    reference: Integers,
    cell: float,
    known: Mask | None = None,
    smallest: float = SMALLEST,
) -> DetectionScore:
    """Scores of a label image against a reference one.

    Parameters
    ----------
    result, reference : ndarray (H, W) of int
        Labels, 0 for no building; both of the same cells.
    cell : float
        Side of a cell (m, > 0).
    known : ndarray (H, W) of bool or None
        True where the truth is known: cells with points. By default everywhere.
    smallest : float
        Objects under this area (m², ≥ 0) are left out.

    Returns
    -------
    DetectionScore
        Agreement by area and by object, relations, outline distances, the map and the rows.

    Raises
    ------
    TypeError
        When `cell` is no number.
    ValueError
        When the images differ in shape, or `cell` is not above 0.

    Examples
    --------
    >>> import numpy as np
    >>> from eaves.evaluate import evaluate_detection, label_objects
    >>> true = np.zeros((20, 20), bool)
    >>> true[5:15, 5:15] = True
    >>> score = evaluate_detection(label_objects(np.roll(true, 1, axis=1)), label_objects(true), cell=0.5)
    >>> score.area.completeness, score.area.correctness, score.objects.completeness
    (0.9, 0.9, 1.0)
    """
    check_same_shape(result, reference, ("result", "reference"))
    if known is not None:
        check_same_shape(known, reference, ("known", "reference"))
    check_positive(cell, "cell")
    certain = np.ones(result.shape, bool) if known is None else known
    matching, result, reference = match_objects(
        np.where(certain, result, 0), np.where(certain, reference, 0), cell**2, smallest
    )
    shared = float(((result > 0) & (reference > 0)).sum()) * cell**2
    area = Agreement(shared, (reference > 0).sum() * cell**2, shared, (result > 0).sum() * cell**2)
    correct = matching.result.label[matching.result_covered >= 0.5]
    rims = rim_of(np.isin(result, correct), cell), rim_of(reference > 0, cell)
    agreement_map = agreement_codes(result > 0, reference > 0)
    agreement_map[~certain] = UNKNOWN
    return DetectionScore(
        area,
        matching.agreement(),
        {limit: matching.agreement(limit) for limit in LARGE_AREAS},
        matching.relations,
        root_mean_square(rim_distances(*rims, cell)),
        agreement_map,
        object_rows(matching),
    )


def object_rows(matching: Matching) -> tuple[ObjectRow, ...]:
    """One row an object, those of the reference first."""
    groups = matching.groups
    count = int(max(g.max(initial=-1) for g in groups)) + 1
    results, references = (np.bincount(g, minlength=count) for g in groups)
    rows = []
    for name, objects, covered, group in (
        ("reference", matching.reference, matching.reference_covered, groups[1]),
        ("result", matching.result, matching.result_covered, groups[0]),
    ):
        for label, area, share, g in zip(objects.label, objects.area, covered, group, strict=True):
            relation = relation_of(int(references[g]), int(results[g]))
            rows.append(ObjectRow(name, int(label), float(area), float(share), bool(share >= 0.5), relation))
    return tuple(rows)
