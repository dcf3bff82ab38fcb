"""Smooth surfaces: connected cells whose planes agree, and what each surface tells as a whole."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from eaves.detect.consensus.evidence import Evidence, level_at
from eaves.detect.toolkit.surface_grid import mean_in
from eaves.model import Labels, Mask, Values
from eaves.raster.groups import group_cells, neighbour_pairs


@dataclass(frozen=True, eq=False)
class Segments:
    """Surfaces 1…K: `label` (H, W), 0 for none; everything else is (K,)."""

    label: Labels
    area: Values
    """m²"""
    width: Values
    """Side (m) of about the largest square that fits inside."""
    residual: Values
    """Mean RMSE (m) of its cells' planes."""
    multi_return_share: Values
    penetration: Values
    """Means of the cells' evidence."""
    height: Values
    """Mean height over the terrain (m)."""
    tall: Values
    """Share of its cells that are at least `tall_height` over the terrain."""

    @property
    def count(self) -> int:
        """Number of segments."""
        return len(self.area)


def find_segments(evidence: Evidence, smooth: Mask, max_gap: float, tall_height: float) -> Segments:
    """Connected groups of `smooth` cells (H, W) whose planes differ by less than `max_gap` at both."""
    one, two = neighbour_pairs(smooth)
    level = evidence.level.ravel()
    gap = np.maximum(
        np.abs(level_at(evidence, one, two) - level[two]), np.abs(level_at(evidence, two, one) - level[one])
    )
    joined = gap < max_gap
    label, count = group_cells(smooth, one[joined], two[joined])
    side, seen = evidence.cells.side, evidence.candidate
    return Segments(
        label=label,
        area=np.asarray(np.bincount(label[smooth], minlength=count + 1)[1:] * (side * side), np.float64),
        width=inner_width(label, count) * side,
        residual=mean_in(label, count, np.where(smooth, evidence.residual, 0.0)),
        multi_return_share=mean_in(label, count, least_around(evidence.multi_return_share, seen)),
        penetration=mean_in(label, count, least_around(evidence.penetration, seen)),
        height=mean_in(label, count, evidence.height),
        tall=mean_in(label, count, evidence.height >= tall_height),
    )


def least_around(values: Values, mask: Mask) -> Values:
    """The least value (H, W) of the cells of `mask` among the three by three around each cell."""
    return np.asarray(ndimage.minimum_filter(np.where(mask, values, np.inf), 3), np.float64)


def inner_width(label: Labels, count: int) -> Values:
    """Side (cells), an odd number, of the largest square with a middle cell in each segment 1…`count`."""
    width = np.zeros(count + 1)
    if count:
        border = np.zeros(label.shape, bool)
        padded = np.pad(label, 1)
        for row, column in ((0, 1), (2, 1), (1, 0), (1, 2)):
            border |= padded[row : row + label.shape[0], column : column + label.shape[1]] != label
        inside = (label > 0) & ~border
        distance = ndimage.distance_transform_cdt(inside, metric="chessboard")
        some = np.flatnonzero(label)
        np.maximum.at(width, label.ravel()[some], 2.0 * distance.ravel()[some] + 1.0)
    return width[1:]
