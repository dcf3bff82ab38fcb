"""From evidence to odds: the weights of the consensus, and what each of them is about."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eaves.detect.consensus.evidence import Evidence
from eaves.detect.consensus.segments import Segments
from eaves.detect.stage import TALL_SHARE
from eaves.model import Labels, Values

SHARPNESS = 1.5
"""The regression was shrunk towards even odds; this undoes it."""


@dataclass(frozen=True)
class Weights:
    """Log odds of a surface for each unit of the terms of `judge_segments`."""

    constant: float
    area: float
    rough: float
    width: float
    height: float
    through: float
    several: float


WITH_ECHOES = Weights(2.1, area=0.8, rough=-3.6, width=0.46, height=1.9, through=-3.1, several=-4.75)
WITHOUT_ECHOES = Weights(2.0, area=0.86, rough=-3.6, width=0.58, height=1.1, through=-5.3, several=0.0)


@dataclass(frozen=True)
class ScoreWeights:
    """Log odds that a region is a building for each unit of the terms of `score_regions`."""

    constant: float
    odds: float
    height: float
    width: float


SCORE = ScoreWeights(1.4, odds=0.3, height=4.8, width=6.2)
"""Logistic regression over 3950 regions, 85 of them false, of 86 simulated towns (seeds 7300 to 7386, 1.5 to
18 points/m², a third of them wooded, a quarter without returns). The weight of the odds was given, not
fitted: nearly all that is false there is a van, and elsewhere it is not. The benchmark
`benchmarks.accuracy.detection_scores` judges the score on other towns."""
VAN_WIDTH_M, VAN_HEIGHT_M, NEAR_M = 2.5, 2.5, 0.5
"""About the width and height of vans, and how far from them a region's own say more."""

SHED_M2, DOOR_M, SHED_HEIGHT_M, ROUGH_M = 6.0, 2.5, 2.5, 0.05
"""Where the terms are zero: the smallest shed, its width and height, a residual no roof's noise explains."""
STOREY_M = 3.0
"""Bushes and hedges stay below a storey; above it height tells nothing of a cell."""
LOW_CELL = 1.2
"""Log odds that a rough cell loses for each metre under a storey."""
LOW_SURFACE = -3.0
"""Log odds, at most, of a surface that is nowhere as high as a building: a wall, a hedge, a terrace."""


def judge_segments(segments: Segments, echoes: bool) -> Values:
    """Log odds (K,) that each surface is a roof."""
    weight = WITH_ECHOES if echoes else WITHOUT_ECHOES
    odds = (
        weight.constant
        + weight.area * np.clip(np.log2(np.maximum(segments.area, 0.1) / SHED_M2), -2.0, 4.0)
        + weight.rough * np.clip(np.log(np.maximum(segments.residual, 1e-4) / ROUGH_M), 0.0, 1.0)
        + weight.width * np.clip(segments.width - DOOR_M, -2.0, 2.0)
        + weight.height * np.clip(segments.height - SHED_HEIGHT_M, -1.0, 1.5)
        + weight.through * segments.through
        + weight.several * segments.several
    )
    low = segments.tall <= TALL_SHARE
    return np.asarray(np.where(low, np.minimum(SHARPNESS * odds, LOW_SURFACE), SHARPNESS * odds), np.float64)


def judge_cells(evidence: Evidence, max_residual: float, echoes: bool) -> Values:
    """Log odds (H, W) of cells in no surface: chimneys and eaves split few pulses, crowns many; bushes are
    low."""
    if echoes:
        low = np.clip(evidence.height - STOREY_M, -1.5, 0.0)
        return np.asarray(2.0 - 5.0 * evidence.several - evidence.through + LOW_CELL * low, np.float64)
    rough = np.clip(np.log(np.minimum(evidence.residual, 10.0) / max_residual), -1.5, 2.0)
    return np.asarray(-0.8 - 0.3 * rough - evidence.through, np.float64)


def score_regions(region: Labels, odds: Values, width: Values, height: Values) -> Values:
    """How sure each region 1…K of (H, W) is, 0 to 1, from its cells' mean odds and its top.

    `width` and `height` (m, (K,)) are those of the top, inf where it is larger than any vehicle. Of the
    regions with a score of 0.9, nine in ten are buildings.
    """
    count = len(width)
    size = np.bincount(region.ravel(), minlength=count + 1)[1:]
    total = np.bincount(region.ravel(), weights=np.clip(odds, -8.0, 8.0).ravel(), minlength=count + 1)[1:]
    weight = SCORE
    sure = (
        weight.constant
        + weight.odds * total / np.maximum(size, 1)
        + weight.height * np.clip(height - VAN_HEIGHT_M, -NEAR_M, NEAR_M)
        + weight.width * np.clip(width - VAN_WIDTH_M, -NEAR_M, NEAR_M)
    )
    return np.asarray(1.0 / (1.0 + np.exp(-sure)), np.float64)
