"""From evidence to odds: the weights of the consensus, and what each of them is about."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import ndimage

from eaves.detect.consensus.evidence import Evidence
from eaves.detect.consensus.segments import Segments, least_around, level_at
from eaves.detect.consensus.separation import Separation, nothing, separate
from eaves.detect.consensus.windows import WINDOW
from eaves.detect.stage import MIN_AREA_M2, ROOM_M, STOREY_M, TALL_SHARE
from eaves.methods import Method, parameter
from eaves.model import Labels, Mask, Values

SURFACE_SHAPE = ("constant", "area", "rough", "width", "height", "company", "enclosed")
CELL_SHAPE = ("constant", "rough", "low", "company", "enclosed", "far", "above")
"""The terms of surfaces, and of cells in none, without echoes and penetration."""


def terms_from(shape: tuple[str, ...]) -> tuple[str, ...]:
    """Terms of the odds: shape, shape once more in so far as echoes tell, echoes, penetration."""
    return (*shape, *(f"{name} x echoes" for name in shape), "echoes", "penetration")


SURFACE_TERMS, CELL_TERMS = terms_from(SURFACE_SHAPE), terms_from(CELL_SHAPE)


@dataclass(frozen=True)
class ScoreWeights:
    """Log odds that a region is a building, and for each unit of the mean log odds of its cells.

    Logistic regression over 642 regions, 13 of them false, of simulated towns (seeds 7300 and on, 1.5 to 30
    points/m², a quarter without returns). `benchmarks.accuracy.detection_scores` judges the score on others.
    """

    constant: float = 0.7
    odds: float = 1.58


@dataclass(frozen=True)
class Weights:
    """Log odds for each unit of the terms of surfaces and of cells in no surface; those of the score."""

    surface: tuple[float, ...]
    cell: tuple[float, ...]
    score: ScoreWeights = ScoreWeights()


def read_weights(given: str) -> Weights:
    """The weights in a JSON file, or in the JSON itself: an object with lists `surface` and `cell`, and where
    the score is weighed otherwise, too, a list `score` of the fields of `ScoreWeights`."""
    text = given if given.lstrip().startswith("{") else Path(given).read_text(encoding="utf-8")
    found = json.loads(text)
    score = ScoreWeights(*map(float, found["score"])) if "score" in found else ScoreWeights()
    for kind, terms in (("surface", SURFACE_TERMS), ("cell", CELL_TERMS)):
        if len(found[kind]) != len(terms):
            raise ValueError(
                f"weights: {kind} has {len(found[kind])} numbers, this version weighs {len(terms)} terms; "
                "calibrate again"
            )
    return Weights(tuple(map(float, found["surface"])), tuple(map(float, found["cell"])), score)


def write_weights(weights: Weights) -> str:
    """Weights as JSON that `read_weights` takes."""
    return json.dumps(
        {"surface": weights.surface, "cell": weights.cell, "score": list(vars(weights.score).values())}
    )


# fmt: off
FITTED = Weights(
    surface=(
        -3.39, 0.22, -2.22, 0.16, 1.56, 1.66, 3.31,
        2.88, -0.24, 0.31, -0.09, 0.07, -2.06, -1.76,
        0.4, 0.41,
    ),
    cell=(
        -1.77, 0.57, 1.73, 3.2, 3.18, -1.0, -0.63,
        0.96, 0.13, 0.27, -1.17, -0.55, 0.42, 0.15,
        0.68, 0.27,
    ),
)
# fmt: on
"""Shape; shape once more in so far as echoes tell; echoes and penetration. Logistic regression over 24
simulated towns (0.3 to 30 points/m², all, few or no echoes) and the labelled surveys with thinned variants:
`benchmarks.accuracy.detection_fit`, which also keeps what each survey left out gives. The weights of surfaces
stand as they were fitted before cells knew how far they lie from roofs."""


ROUGH = 0.4
"""A share of the largest residual: with the least area of a building, the width and height of a room and the
height of a storey, above which height says nothing of a cell, where the terms are zero, as the weights were
fitted."""


class EvidenceRules(Method):
    """How the evidence is weighed, beside the weights."""

    enclosed: float = parameter(
        6.0,
        "What stands on a roof has roof on all sides within so much, a tree beside one has not; and so far a "
        "plane is carried on below a crown.",
        unit="m",
        gt=0.0,
    )
    small_surface: float = parameter(
        2.0, "Smaller surfaces say no more than their cells do.", unit="m²", ge=0.0
    )
    rounds: int = parameter(
        3,
        "Rounds of measuring echoes and penetration; after three they change by less than a hundredth.",
        ge=0,
    )
    most_log_ratio: float = parameter(
        4.0, "Log likelihood ratio, at most, of echoes or penetration: fifty to one.", gt=0.0
    )
    even_area: float = parameter(
        20.0,
        "No crown has a surface as large and even: there echoes tell nothing against glass or slats.",
        unit="m²",
        ge=0.0,
    )
    even_residual: float = parameter(
        0.25, "The residual of such a surface is at most so many times `max_residual`.", ge=0.0
    )


def smooth_share(candidate: Mask, smooth: Mask) -> Values:
    """Share (H, W) of the candidate cells in a square around each that are smooth, two windows and the cell
    between wide: roofs keep company, while in a crown a plane fits here and there by chance."""
    size = 2 * WINDOW + 1
    around = ndimage.uniform_filter(candidate.astype(np.float64), size, mode="constant")
    alike = ndimage.uniform_filter((smooth & candidate).astype(np.float64), size, mode="constant")
    return np.asarray(alike / np.maximum(around, 0.5 / size**2), np.float64)


def enclosure(roofs: Mask, steps: int) -> Values:
    """Share (H, W) of eight directions in which a cell of `roofs` (H, W) is within so many steps of each."""
    rows, columns = roofs.shape
    found = np.zeros(roofs.shape)
    for down, right in ((0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1)):
        met = np.zeros(roofs.shape, bool)
        for step in range(1, min(steps, rows - 1, columns - 1) + 1):
            y, x = down * step, right * step
            here = (slice(max(0, -y), rows - max(0, y)), slice(max(0, -x), columns - max(0, x)))
            met[here] |= roofs[max(0, y) : rows - max(0, -y), max(0, x) : columns - max(0, -x)]
        found += met
    return found / 8.0


def weighted_mean(label: Labels, count: int, values: Values) -> Values:
    """Mean of values (H, W) over each segment 1…`count` of labels (H, W)."""
    size = np.bincount(label.ravel(), minlength=count + 1)[1:]
    total = np.bincount(label.ravel(), weights=values.ravel(), minlength=count + 1)[1:]
    return np.asarray(total / np.maximum(size, 1), np.float64)


def surface_shape(segments: Segments, company: Values, enclosed: Values, max_residual: float) -> Values:
    """The terms of shape of each surface (K, 7), each term clipped, in the order of `SURFACE_SHAPE`."""
    return np.column_stack(
        [
            np.ones(segments.count),
            np.clip(np.log2(np.maximum(segments.area, 0.1) / MIN_AREA_M2), -2.0, 4.0),
            np.clip(np.log(np.maximum(segments.residual, 1e-4) / (ROUGH * max_residual)), 0.0, 1.0),
            np.clip(segments.width - ROOM_M, -2.0, 2.0),
            np.clip(segments.height - ROOM_M, -1.0, 1.5),
            weighted_mean(segments.label, segments.count, company),
            weighted_mean(segments.label, segments.count, enclosed),
        ]
    )


def beside_roofs(evidence: Evidence, roofs: Mask, reach: float) -> tuple[Values, Values]:
    """How far (m) each cell (H, W) lies from the nearest of `roofs` (H, W), and how high (m) its highest
    point is over the plane of that cell, carried on; a height of 0 where no roof is within `reach` (m)."""
    if not roofs.any():
        return np.full(evidence.shape, np.inf), np.zeros(evidence.shape)
    steps, nearest = ndimage.distance_transform_edt(~roofs, return_indices=True)
    distance = steps * evidence.cells.side
    cells = np.ravel_multi_index(tuple(nearest), evidence.shape).ravel()
    level = level_at(evidence, cells, np.arange(cells.size), 1.0).reshape(evidence.shape)
    near = evidence.candidate & (distance < reach)
    return distance, np.where(near, evidence.top, level) - level


def cell_shape(
    evidence: Evidence, company: Values, enclosed: Values, roofs: Mask, reach: float, max_residual: float
) -> Values:
    """The terms of shape of cells (H, W, 7) in no surface, in the order of `CELL_SHAPE`: bushes are low,
    crowns rough, far from roofs and higher than these would go on."""
    distance, over = beside_roofs(evidence, roofs, reach)
    return np.stack(
        [
            np.ones(evidence.shape),
            np.clip(np.log(np.clip(evidence.residual, 1e-4, 10.0) / max_residual), -1.5, 2.0),
            np.clip(evidence.height - STOREY_M, -1.5, 0.0),
            company,
            enclosed,
            np.clip(distance - WINDOW / 2 * evidence.cells.side, 0.0, 3.0),
            np.clip(over, 0.0, 4.0),
        ],
        axis=-1,
    )


def with_echoes(
    shape: Values, several: Values, through: Values, echoes: Separation, penetration: Separation, most: float
) -> Values:
    """Terms (..., 2 S + 2) of shape (..., S), the share of several returns and that of points that reach the
    ground (...); the log likelihood ratio of either is at most `most`."""
    said = [echoes.log_ratio(several, most)[..., None], penetration.log_ratio(through, most)[..., None]]
    return np.concatenate([shape, echoes.power * shape, *said], axis=-1)


@dataclass(frozen=True, eq=False)
class Terms:
    """The terms of surfaces (K, T) and of cells; `large` (H, W) marks the cells that their
    surface speaks for, `shape` (H, W, S) is that of `cell_shape`."""

    surface: Values
    shape: Values
    evidence: Evidence
    most_log_ratio: float
    large: Mask
    echoes: Separation
    penetration: Separation

    @property
    def cell(self) -> Values:
        """The terms (H, W, T) of the cells."""
        return with_echoes(self.shape, *self._echoes, self.most_log_ratio)

    def cell_odds(self, weights: Weights) -> Values:
        """Log odds (H, W) of cells in no surface."""
        return cell_odds(self.shape, *self._echoes, self.most_log_ratio, weights)

    @property
    def _echoes(self) -> tuple[Values, Values, Separation, Separation]:
        evidence = self.evidence
        return evidence.multi_return_share, evidence.penetration, self.echoes, self.penetration


def measured_terms(
    evidence: Evidence, segments: Segments, max_residual: float, weights: Weights, limits: EvidenceRules
) -> Terms:
    """The terms of all surfaces and cells, with what echoes and penetration tell in this very scan.

    First the odds are those of shape alone; the cells that they call roofs and crowns give the measures'
    separation, which gives better odds, and so once more (expectation maximisation, [dempster1977]).
    """
    large = np.r_[False, segments.area >= limits.small_surface][segments.label]
    seen = evidence.candidate
    company = smooth_share(seen, segments.label > 0)
    roofs = np.r_[False, segments.area >= MIN_AREA_M2][segments.label]
    enclosed = enclosure(roofs, round(limits.enclosed / evidence.cells.side))
    of_surfaces = surface_shape(segments, company, enclosed, max_residual)
    of_cells = cell_shape(evidence, company, enclosed, roofs, limits.enclosed, max_residual)
    inner_multi_return_share = least_around(evidence.multi_return_share, seen)
    inner_penetration_share = least_around(evidence.penetration, seen)
    even = (segments.area >= limits.even_area) & (segments.residual <= limits.even_residual * max_residual)
    echoes = penetration = inner_echoes = inner_penetration = nothing()
    of_seen, several, through = of_cells[seen], evidence.multi_return_share[seen], evidence.penetration[seen]
    for rounds_left in range(limits.rounds, -1, -1):
        surface = with_echoes(
            of_surfaces,
            segments.multi_return_share,
            segments.penetration,
            inner_echoes,
            inner_penetration,
            limits.most_log_ratio,
        )
        surface = without_objections(surface, even, weights)
        if not rounds_left:
            break
        of_surface = surface_odds(segments, surface, weights, limits.most_log_ratio)
        of_surface = np.r_[0.0, of_surface][segments.label[seen]]
        of_cell = cell_odds(of_seen, several, through, echoes, penetration, limits.most_log_ratio, weights)
        odds = np.where(large[seen], of_surface, of_cell)
        likely = 1.0 / (1.0 + np.exp(-odds))
        echoes = separate(several, likely)
        penetration = separate(through, likely)
        inner_echoes = separate(inner_multi_return_share[seen], likely)
        inner_penetration = separate(inner_penetration_share[seen], likely)
    return Terms(surface, of_cells, evidence, limits.most_log_ratio, large, echoes, penetration)


def without_objections(terms: Values, even: Mask, weights: Weights) -> Values:
    """Terms (K, T) of surfaces, by shape alone for those of `even` (K,) that echoes speak against: roofs of
    glass, slats and grids split pulses and let them through as crowns do, but no crown is large and even."""
    shape = len(SURFACE_SHAPE)
    against = even & (terms[:, shape:] @ np.array(weights.surface[shape:]) < 0.0)
    answer = terms.copy()
    answer[against, shape:] = 0.0
    return answer


def surface_odds(segments: Segments, terms: Values, weights: Weights, sure: float) -> Values:
    """Log odds (K,) that each surface is a roof, of its terms (K, T); one nowhere as high as a building (a
    wall, a hedge, a terrace) is none, which is as `sure` as one measure can be."""
    odds = terms @ np.array(weights.surface)
    return np.asarray(np.where(segments.tall <= TALL_SHARE, np.minimum(odds, -sure), odds), np.float64)


def cell_odds(
    shape: Values,
    several: Values,
    through: Values,
    echoes: Separation,
    penetration: Separation,
    most: float,
    weights: Weights,
) -> Values:
    """Log odds (...) of cells in no surface: the terms of `with_echoes`, weighed without being drawn up."""
    *of_terms, of_echoes, of_penetration = weights.cell
    of_shape, with_power = np.reshape(of_terms, (2, -1))
    odds = shape @ (of_shape + echoes.power * with_power)
    odds += of_echoes * echoes.log_ratio(several, most)
    odds += of_penetration * penetration.log_ratio(through, most)
    return np.asarray(odds, np.float64)


def score_regions(region: Labels, odds: Values, weight: ScoreWeights) -> Values:
    """How sure each region 1…K of (H, W) is, 0 to 1, from its cells' mean odds (H, W)."""
    size = np.bincount(region.ravel())[1:]
    total = np.bincount(region.ravel(), weights=np.clip(odds, -8.0, 8.0).ravel())[1:]
    sure = weight.constant + weight.odds * total / np.maximum(size, 1)
    return np.asarray(1.0 / (1.0 + np.exp(-sure)), np.float64)
