"""From evidence to odds: the weights of the consensus, and what each of them is about."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from eaves.detect.consensus.evidence import (
    WINDOW,
    Evidence,
    Segments,
    Separation,
    groups_of,
    nothing,
    separate,
)
from eaves.detect.stage import HOUSE_M2, MIN_AREA_M2, OBJECT, ROOM_M, STOREY_M, TALL_SHARE
from eaves.detect.toolkit.surface_grid import mean_in, share_around
from eaves.kernels import kernel
from eaves.methods import Method, parameter
from eaves.model import Doubt, Integers, Labels, Mask, Values
from eaves.raster.blur import grown_by_square
from eaves.raster.interpolate import nearest_cells

EIGHT = ((0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1))
"""Steps to the eight neighbours of a cell."""
COLOUR_WEIGHT = 2.0
"""Weight of the log likelihood ratio of colours, and times that of echoes at most: chosen on drawn clouds of
images (`benchmarks.accuracy.image_towns`, the first seeds), where smoothed crowns are as even as roofs."""
UNTOLD = 4.0
"""Log odds, fifty to one, against a roof where colours do not tell one from the rest: in smoothed and rough
clouds relief has the shape of houses."""
Places = tuple[Integers, Integers]
"""Rows and columns (K,) of cells."""
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

    def of_colours(self) -> Weights:
        """The weights of a scan whose colours stand for echoes."""

        def weighed(weights: tuple[float, ...], names: tuple[str, ...]) -> tuple[float, ...]:
            table = dict(zip(names, weights, strict=True))
            table["constant"] -= UNTOLD
            table["constant x echoes"] += UNTOLD
            return tuple((table | {"echoes": COLOUR_WEIGHT}).values())

        return replace(
            self, surface=weighed(self.surface, SURFACE_TERMS), cell=weighed(self.cell, CELL_TERMS)
        )


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
                "fit them again"
            )
    return Weights(tuple(map(float, found["surface"])), tuple(map(float, found["cell"])), score)


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
    """Rules for weighing the evidence, beside the weights."""

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


@kernel
def enclosure_kernel(roofs: Mask, steps: int, rows: Integers, columns: Integers) -> Values:
    """Share (K,) of eight directions in which a cell of `roofs` (H, W) is within so many steps of each of
    some cells (K,)."""
    share = np.zeros(len(rows))
    for i in range(len(rows)):
        for down, right in EIGHT:
            for step in range(1, steps + 1):
                row, column = rows[i] + step * down, columns[i] + step * right
                if not (0 <= row < roofs.shape[0] and 0 <= column < roofs.shape[1]):
                    break
                if roofs[row, column]:
                    share[i] += 1.0 / len(EIGHT)
                    break
    return share


def surface_shape(segments: Segments, company: Values, enclosed: Values, max_residual: float) -> Values:
    """The terms of shape of each surface (K, 7), each term clipped, in the order of `SURFACE_SHAPE`; the
    means of `company` and `enclosed` (K,) are those of its cells."""
    return np.column_stack(
        [
            np.ones(segments.count),
            np.clip(np.log2(np.maximum(segments.area, 0.1) / MIN_AREA_M2), -2.0, 4.0),
            np.clip(np.log(np.maximum(segments.residual, 1e-4) / (ROUGH * max_residual)), 0.0, 1.0),
            np.clip(segments.width - ROOM_M, -2.0, 2.0),
            np.clip(segments.height - ROOM_M, -1.0, 1.5),
            company,
            enclosed,
        ]
    )


def beside_roofs(evidence: Evidence, roofs: Mask, reach: float, cells: Places) -> tuple[Values, Values]:
    """Distance (m) of cells, by rows and columns (K,), from the nearest of `roofs` (H, W), and how high (m)
    the highest point of each is over the plane of that cell, carried on; a height of 0 where no roof is
    within `reach` (m)."""
    if not roofs.any():
        return np.full(len(cells[0]), np.inf), np.zeros(len(cells[0]))
    side, (row, column) = evidence.cells.side, nearest_cells(roofs, *cells)
    distance = np.sqrt((row - cells[0]) ** 2.0 + (column - cells[1]) ** 2.0) * side
    level = evidence.level[row, column] + evidence.east[row, column] * (cells[1] - column) * side
    level -= evidence.north[row, column] * (cells[0] - row) * side
    near = evidence.candidate[cells] & (distance < reach)
    return distance, np.where(near, evidence.top[cells], level) - level


def cell_shape(
    evidence: Evidence,
    cells: Places,
    company: Values,
    enclosed: Values,
    roofs: Mask,
    reach: float,
    max_residual: float,
) -> Values:
    """The terms of shape (K, 7) of cells, by rows and columns (K,), in no surface, in the order of
    `CELL_SHAPE`: bushes are low, crowns rough, far from roofs and higher than these would go on."""
    distance, over = beside_roofs(evidence, roofs, reach, cells)
    return np.column_stack(
        [
            np.ones(len(company)),
            np.clip(np.log(np.clip(evidence.residual[cells], 1e-4, 10.0) / max_residual), -1.5, 2.0),
            np.clip(evidence.height[cells] - STOREY_M, -1.5, 0.0),
            company,
            enclosed,
            np.clip(distance - WINDOW / 2 * evidence.cells.side, 0.0, 3.0),
            np.clip(over, 0.0, 4.0),
        ]
    )


class Told(NamedTuple):
    """Log-likelihood ratios from returns and penetration at places."""

    several: Values
    """Share (...) of points of pulses with several returns."""
    through: Values
    """Share (...) of points that reach the ground."""
    echoes: Separation
    penetration: Separation
    """What either tells in this very scan."""
    most: float
    """The log likelihood ratio of either, at most."""

    @property
    def log_ratios(self) -> tuple[Values, Values]:
        """The log likelihood ratios (...) of both for a roof."""
        pairs = (self.echoes, self.several), (self.penetration, self.through)
        echoes, penetration = (measure.log_ratio(value, self.most) for measure, value in pairs)
        return echoes, penetration


def with_echoes(shape: Values, told: Told) -> Values:
    """Terms (..., 2 S + 2) of shape (..., S) and of what echoes and penetration say."""
    ratios = [ratio[..., None] for ratio in told.log_ratios]
    return np.concatenate([shape, told.echoes.power * shape, *ratios], axis=-1)


def cell_odds(shape: Values, told: Told, weights: Weights) -> Values:
    """Log odds (...) of cells in no surface: the terms of `with_echoes`, weighed without being drawn up."""
    *of_terms, of_echoes, of_penetration = weights.cell
    of_shape, with_power = np.reshape(of_terms, (2, -1))
    echoes, penetration = told.log_ratios
    odds = shape @ (of_shape + told.echoes.power * with_power)
    odds += of_echoes * echoes
    odds += of_penetration * penetration
    return np.asarray(odds, np.float64)


@dataclass(frozen=True, eq=False)
class Terms:
    """The terms of surfaces (S, T) and of cells, by rows and columns (K,): `shape` (K, 7) is that of
    `cell_shape`; `large` (H, W) marks the cells that their surface speaks for."""

    surface: Values
    cells: Places
    shape: Values
    told: Told
    large: Mask

    @property
    def cell(self) -> Values:
        """The terms (K, T) of the cells."""
        return with_echoes(self.shape, self.told)


def measured_terms(
    evidence: Evidence,
    segments: Segments,
    judged: Mask,
    max_residual: float,
    weights: Weights,
    limits: EvidenceRules,
    colours: Separation | None = None,
) -> Terms:
    """The terms of all surfaces and of `judged` cells (H, W), all candidates among them, with what echoes, or
    `colours` in their place, and penetration tell in this very scan.

    First the odds are those of shape alone; the cells that they call roofs and crowns give the measures'
    separation, which gives better odds, and so once more (expectation maximisation, [dempster1977]).
    """
    rows, columns = np.nonzero(judged)
    cells = rows, columns
    large = np.r_[False, segments.area >= limits.small_surface][segments.label]
    most, number = limits.most_log_ratio, segments.label[cells]
    most *= COLOUR_WEIGHT if colours else 1.0
    # roofs keep company, while in a crown a plane fits here and there by chance
    company = share_around(segments.label > 0, evidence.candidate, 2 * WINDOW + 1)[cells]
    roofs = np.r_[False, segments.area >= MIN_AREA_M2][segments.label]
    steps = round(limits.enclosed / evidence.cells.side)
    enclosed = enclosure_kernel(roofs, steps, rows, columns)
    of_surfaces = surface_shape(
        segments,
        mean_in(number, segments.count, company),
        mean_in(number, segments.count, enclosed),
        max_residual,
    )
    of_cells = cell_shape(evidence, cells, company, enclosed, roofs, limits.enclosed, max_residual)
    # colours object to no glass, and smoothed crowns are even
    even = (colours is None) & is_even(segments, max_residual, limits)
    several, through = evidence.multi_return_share[cells], evidence.penetration[cells]
    seen = np.flatnonzero(evidence.candidate[cells])
    inner = evidence.inner_share[cells], evidence.inner_penetration[cells]
    values = [measure[seen] for measure in (several, through, *inner)]
    of_seen, large_seen, number = of_cells[seen], large[cells][seen], number[seen]
    echoes = inner_echoes = colours or nothing()
    penetration = inner_penetration = nothing()
    for rounds_left in range(limits.rounds, -1, -1):
        told = Told(segments.multi_return_share, segments.penetration, inner_echoes, inner_penetration, most)
        surface = without_objections(with_echoes(of_surfaces, told), even, weights)
        if not rounds_left:
            break
        of_surface = np.r_[0.0, surface_odds(segments, surface, weights, most)][number]
        of_cell = cell_odds(of_seen, Told(values[0], values[1], echoes, penetration, most), weights)
        likely = 1.0 / (1.0 + np.exp(-np.where(large_seen, of_surface, of_cell)))
        if colours is None:
            echoes, inner_echoes = (separate(value, likely) for value in values[::2])
        penetration, inner_penetration = (separate(value, likely) for value in values[1::2])
    return Terms(surface, cells, of_cells, Told(several, through, echoes, penetration, most), large)


def is_even(segments: Segments, max_residual: float, limits: EvidenceRules) -> Mask:
    """The surfaces (K,) that are large and even, as no crown is."""
    even = segments.residual <= limits.even_residual * max_residual
    return np.asarray(even & (segments.area >= limits.even_area), np.bool_)


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


def score_regions(region: Labels, odds: Values, weight: ScoreWeights) -> Values:
    """Certainty, 0 to 1, of each region 1…K of (H, W), from its cells' mean odds (H, W)."""
    size = np.bincount(region.ravel())[1:]
    total = np.bincount(region.ravel(), weights=np.clip(odds, -8.0, 8.0).ravel())[1:]
    sure = weight.constant + weight.odds * total / np.maximum(size, 1)
    return np.asarray(1.0 / (1.0 + np.exp(-sure)), np.float64)


STAGE = "detect"


class DoubtRules(Method):
    """When a region is doubtful."""

    doubt_score: float = parameter(
        0.2, "A region with a score between this and one less this is doubtful.", ge=0.0, le=0.5
    )
    doubt_rim: float = parameter(
        0.1,
        "Share of a region's rim on the rim of the data above which it is doubtful: chance gaps touch less.",
        ge=0.0,
        le=1.0,
    )
    doubt_afloat: float = parameter(
        0.6,
        "Share of a region's rim along water or voids above which it is doubtful: a house by a canal has "
        "land on three sides.",
        ge=0.0,
        le=1.0,
    )
    doubt_uneven: float = parameter(
        2.2,
        "Unevenness, in multiples of that of the scan's roofs, from which a region is doubtful where "
        "echoes tell little.",
        ge=1.0,
    )


def region_doubts(
    evidence: Evidence,
    region: Labels,
    score: Values,
    attached: Values,
    water: Mask,
    most_attached: float,
    unevenness: Values,
    limits: DoubtRules,
) -> list[Doubt]:
    """Doubts about regions 1…K of cells (H, W).

    Parameters
    ----------
    evidence : of the cells.
    region : number of each cell's region, 0 for none.
    score : how sure each region is, (K,).
    attached : share of the rim that continues the terrain, (K + 1,).
    water : cells with a point of water, (H, W).
    most_attached : the largest share of a building; half of it is doubtful.
    unevenness : how many times as uneven as roofs each cell is, (H, W), NaN where it does not matter.
    limits : from where on there is doubt.

    Returns
    -------
    list of Doubt
        A region may give several. Places are local metres.
    """
    found: list[Doubt] = []
    empty, outside = evidence.empty, outside_of(*evidence.gaps)
    for number, around, cells in groups_of(region):
        if cells.sum() * evidence.cells.side**2 < MIN_AREA_M2:
            continue
        sure, share = score[number - 1], attached[number]
        rim = grown_by_square(cells, 3) & ~cells
        open_rim, wet = rim & outside[around], rim & water[around]
        known = unevenness[around][cells & np.isfinite(unevenness[around])]
        uneven = float(np.median(known)) if len(known) else 0.0
        said = {
            f"a roof or not: score {sure:.2f}": limits.doubt_score <= sure <= 1.0 - limits.doubt_score,
            f"a roof or a rock: {round(100 * share)} % of its rim continues the terrain": share
            > most_attached / 2,
            "a building or a ship: there is water all round": wet.any()
            and (wet | (rim & empty[around])).sum() > limits.doubt_afloat * rim.sum(),
            f"a roof or a crown: {uneven:.1f} times as uneven as the roofs of a scan that splits few "
            "pulses": uneven > limits.doubt_uneven,
        }
        found += [doubt_at(evidence, around, cells, cells, reason) for reason, holds in said.items() if holds]
        if open_rim.sum() > limits.doubt_rim * rim.sum():
            found.append(doubt_at(evidence, around, open_rim, cells, "a building on the rim of the data"))
    return found


def object_doubts(
    evidence: Evidence, taken: Mask, odds: Values, most: float, least_height: float
) -> list[Doubt]:
    """Doubts about what rises as a house does and was not taken for one, in a scan that splits no pulse.

    Parameters
    ----------
    evidence : of the cells.
    taken : cells of buildings, (H, W).
    odds : log odds of the cells for a roof, (H, W).
    most : the largest residual (m) of a roof.
    least_height : the least height (m) of a building.
    """
    risen = evidence.candidate & ~taken & (evidence.height >= least_height)
    found, _ = ndimage.label(risen, np.ones((3, 3)))
    doubts = list[Doubt]()
    for _, around, cells in groups_of(found):
        if not HOUSE_M2[0] <= cells.sum() * evidence.cells.side**2 <= HOUSE_M2[1]:
            continue
        rough = float(np.median(evidence.residual[around][cells]))
        against = float(np.median(odds[around][cells]))
        why = (
            f"its top misses planes by {rough:.2f} m, a roof may by {most:.2f} m"
            if most < rough < np.inf
            else f"height, shape and colours speak against a roof (log odds {against:.1f})"
        )
        doubts.append(doubt_at(evidence, around, cells, cells, f"{OBJECT}: {why}"))
    return doubts


def unevenness_of(evidence: Evidence, roofs: Mask) -> Values:
    """Unevenness (H, W) of each cell as a multiple of the median of `roofs` (H, W), NaN where no plane fits:
    where echoes tell nothing, an even crown passes for a roof."""
    residual = np.where(np.isfinite(evidence.residual), evidence.residual, np.nan)
    some = residual[roofs & np.isfinite(residual)]
    return residual / max(float(np.median(some)), 1e-4) if len(some) else np.full(roofs.shape, np.nan)


def void_doubts(evidence: Evidence, void: Mask) -> list[Doubt]:
    """Doubts about the holes (H, W) that were taken for roofs because their rims are level and raised."""
    found, _ = ndimage.label(void)
    reason = "a hole in the data, taken for a roof by its rim"
    return [doubt_at(evidence, around, hole, hole, reason) for _, around, hole in groups_of(found)]


def doubt_at(evidence: Evidence, around: tuple[slice, slice], mask: Mask, cells: Mask, reason: str) -> Doubt:
    """The doubt in the middle of a mask (h, w) about so many cells (h, w), both in a window of the grid."""
    rows, columns = np.nonzero(mask)
    side = evidence.cells.side
    x = evidence.cells.west + (around[1].start + float(columns.mean()) + 0.5) * side
    y = evidence.cells.north - (around[0].start + float(rows.mean()) + 0.5) * side
    return Doubt(round(x, 2), round(y, 2), round(float(cells.sum()) * side**2, 1), reason, STAGE)


def outside_of(found: Labels, count: int) -> Mask:
    """The cells (H, W) of groups (H, W) 1…`count` that reach the border of the grid."""
    border = np.zeros(count + 1, bool)
    for line in (found[0], found[-1], found[:, 0], found[:, -1]):
        border[line] = True
    border[0] = False
    return np.asarray(border[found], np.bool_)
