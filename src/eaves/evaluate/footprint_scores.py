"""Footprints against reference polygons: overlap, distances of outlines, corners.

Each reference polygon is compared with the result polygon that shares most area with it, and a result polygon
with one reference only: the pair with the larger overlap goes first. Maps divide a row of houses by address
where the air shows one building; so the polygons that stand for each other (see `matching`) are also united
and compared as groups.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from eaves.evaluate.matching import Agreement, Matching, Objects, ratio, root_mean_square
from eaves.geometry import COORDINATE_STEP, pair_off

STEP = 0.25
"""Spacing (m) of the points along an outline whose distances are measured."""


@dataclass(frozen=True)
class FootprintRow:
    """One reference building, and the footprint found for it; distances (m) are None where none was found."""

    reference: str
    result: str | None
    area_m2: float
    area_error_m2: float | None = None
    iou: float = 0.0
    rms_m: float | None = None
    hausdorff_m: float | None = None
    polis_m: float | None = None
    vertices: int | None = None
    vertices_reference: int = 0


@dataclass(frozen=True, eq=False)
class FootprintScore:
    """Scores of footprints: of all areas, of pairs, and of groups of footprints united.

    Parameters
    ----------
    area : Agreement
        By area (m²).
    pairs, references, results : int
        Numbers of pairs and of polygons on both sides.
    mean_iou : float
        Mean intersection over union of the pairs, 0 to 1.
    rms_m : float
        Root mean square distance (m) of the outlines of the pairs.
    median_hausdorff_m, mean_polis_m : float
        Median Hausdorff and mean PoLiS [avbelj2015] distance (m) of the pairs.
    vertex_ratio : float
        Corners for each corner of the reference.
    rows : tuple of FootprintRow
        One a reference building.
    relations : dict of str to int
        Relation (`1:1`, `1:M`, …) → number of groups.
    mean_iou_united, rms_united_m : float
        As above, of groups of polygons united on both sides.

    Examples
    --------
    >>> import shapely
    >>> from eaves.evaluate import evaluate_footprints
    >>> evaluate_footprints([shapely.box(0, 0, 4, 4)], [shapely.box(0, 0, 4, 4)]).vertex_ratio
    1.0
    """

    area: Agreement
    pairs: int
    references: int
    results: int
    mean_iou: float
    rms_m: float
    median_hausdorff_m: float
    mean_polis_m: float
    vertex_ratio: float
    rows: tuple[FootprintRow, ...]
    relations: dict[str, int] = field(default_factory=dict)
    mean_iou_united: float = float("nan")
    rms_united_m: float = float("nan")


Shapes = Sequence[Polygon | MultiPolygon]


def evaluate_footprints(
    result: Shapes,
    reference: Shapes,
    result_ids: Sequence[str] | None = None,
    reference_ids: Sequence[str] | None = None,
) -> FootprintScore:
    """Scores of footprints against reference polygons.

    Parameters
    ----------
    result, reference : sequence of Polygon or MultiPolygon
        The polygons, in metres of one system; either may be empty.
    result_ids, reference_ids : sequence of str or None
        One id a polygon; by default they are numbered from 1.

    Returns
    -------
    FootprintScore
        Measures that need a pair are NaN where there is none.

    Raises
    ------
    ValueError
        When there is not one id for each polygon.

    Examples
    --------
    >>> import shapely
    >>> from eaves.evaluate import evaluate_footprints
    >>> score = evaluate_footprints([shapely.box(0, 0, 10, 9)], [shapely.box(0, 0, 10, 10)])
    >>> score.pairs, round(score.mean_iou, 2)
    (1, 0.9)
    """
    results, references = (
        shapely.make_valid(np.array(list(shapes), object)) for shapes in (result, reference)
    )
    names, wanted_names = (
        [str(k + 1) for k in range(len(shapes))] if ids is None else list(ids)
        for shapes, ids in ((results, result_ids), (references, reference_ids))
    )
    for side, shapes, ids in (("result", results, names), ("reference", references, wanted_names)):
        if len(ids) != len(shapes):
            raise ValueError(
                f"{side}_ids must be one id for each of {len(shapes)} polygons, not {len(ids)} ids"
            )
    pairs = pair_by_overlap(results, references)
    rows, offsets = [], []
    for number, shape in enumerate(references):
        partner = pairs.get(number)
        row = FootprintRow(
            wanted_names[number], None, float(shape.area), vertices_reference=count_vertices(shape)
        )
        if partner is not None:
            distance = outline_distances(results[partner], shape)
            offsets.append(distance)
            row = _compared(row, names[partner], results[partner], shape, distance)
        rows.append(row)
    paired = [row for row in rows if row.result is not None]
    unions = shapely.union_all(results), shapely.union_all(references)
    shared = float(shapely.intersection(*unions).area)
    return FootprintScore(
        Agreement(shared, float(unions[1].area), shared, float(unions[0].area)),
        len(paired),
        len(references),
        len(results),
        mean_of([row.iou for row in paired]),
        root_mean_square(np.concatenate(offsets) if offsets else np.zeros(0)),
        float(np.median([row.hausdorff_m for row in paired])) if paired else float("nan"),
        mean_of([row.polis_m for row in paired if row.polis_m is not None]),
        ratio(sum(row.vertices or 0 for row in paired), sum(row.vertices_reference for row in paired)),
        tuple(rows),
        *_united(results, references),
    )


def _united(
    results: NDArray[np.object_], references: NDArray[np.object_]
) -> tuple[dict[str, int], float, float]:
    """Number of groups of each relation; mean IoU of their unions, RMS (m) of their outlines."""
    reference_number, result_number = _meeting(results, references)
    shared = shapely.area(shapely.intersection(results[result_number], references[reference_number]))
    judged, true = (Objects(np.arange(len(shapes)), shapely.area(shapes)) for shapes in (results, references))
    matching = Matching(judged, true, result_number, reference_number, shared)
    overlaps, offsets = [], [np.zeros(0)]
    for group in np.intersect1d(*matching.groups):
        union, true_union = (
            shapely.union_all(shapes[groups == group], grid_size=COORDINATE_STEP)
            for shapes, groups in zip((results, references), matching.groups, strict=True)
        )
        common = float(union.intersection(true_union).area)
        overlaps.append(ratio(common, union.area + true_union.area - common))
        offsets.append(outline_distances(union, true_union))
    return matching.relations, mean_of(overlaps), root_mean_square(np.concatenate(offsets))


def _meeting(results: NDArray[np.object_], references: NDArray[np.object_]) -> NDArray[np.int64]:
    """The numbers (2, P) of the wanted and found shapes that meet."""
    if len(results) == 0 or len(references) == 0:
        return np.zeros((2, 0), np.int64)
    return np.asarray(shapely.STRtree(results).query(references, predicate="intersects"))


def pair_by_overlap(results: NDArray[np.object_], references: NDArray[np.object_]) -> dict[int, int]:
    """Reference → result of the pairs that share most area, each polygon in one pair at most."""
    reference_number, result_number = _meeting(results, references)
    shared = shapely.area(shapely.intersection(results[result_number], references[reference_number]))
    order = np.lexsort((result_number, reference_number, -shared))
    return pair_off((int(reference_number[k]), int(result_number[k])) for k in order if shared[k] > 0)


def outline_distances(
    result: Polygon | MultiPolygon, reference: Polygon | MultiPolygon
) -> NDArray[np.float64]:
    """Distances (m) of points every 0.25 m along an outline from the reference outline."""
    along = shapely.get_coordinates(shapely.segmentize(result.boundary, STEP))
    return np.asarray(shapely.distance(shapely.points(along), reference.boundary))


def polis(first: Polygon | MultiPolygon, second: Polygon | MultiPolygon) -> float:
    """PoLiS distance (m) [avbelj2015], eq. 4: mean distance of the vertices of each from the other's rim."""
    means = [
        shapely.distance(shapely.points(vertices_of(here)), target.boundary).mean()
        for here, target in ((first, second), (second, first))
    ]
    return float(sum(means) / 2)


def vertices_of(shape: Polygon | MultiPolygon) -> NDArray[np.float64]:
    """The vertices (N, 2) of all rings, each once."""
    rings = [ring for part in shapely.get_parts(shape) for ring in (part.exterior, *part.interiors)]
    return np.concatenate([shapely.get_coordinates(ring)[:-1] for ring in rings])


def count_vertices(shape: Polygon | MultiPolygon) -> int:
    """Number of corners: vertices whose sides lie on one line within a centimetre do not count."""
    return len(vertices_of(shapely.simplify(shape, 0.01)))


def _compared(
    row: FootprintRow,
    name: str,
    result: Polygon | MultiPolygon,
    reference: Polygon | MultiPolygon,
    distance: NDArray[np.float64],
) -> FootprintRow:
    """A row with the footprint that was found, its outline so far (N,) from the reference's."""
    shared = float(result.intersection(reference).area)
    return replace(
        row,
        result=name,
        area_error_m2=float(result.area - reference.area),
        iou=ratio(shared, result.area + reference.area - shared),
        rms_m=root_mean_square(distance),
        hausdorff_m=max(float(distance.max()), float(outline_distances(reference, result).max())),
        polis_m=polis(result, reference),
        vertices=count_vertices(result),
    )


def mean_of(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else float("nan")
