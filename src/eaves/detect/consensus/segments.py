"""Smooth surfaces: connected cells whose planes agree, and what each surface tells as a whole."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from eaves.detect.consensus.evidence import Evidence, carried_on
from eaves.detect.toolkit.surface_grid import mean_in
from eaves.geometry.components import unite_kernel
from eaves.kernels import kernel
from eaves.model import Labels, Mask, Values


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
    side = evidence.cells.side
    label, count = groups_kernel(smooth, evidence.level, evidence.east, evidence.north, side, max_gap)
    cells = np.flatnonzero(label)
    number = label.ravel()[cells]

    def mean(values: Values | Mask) -> Values:
        return mean_in(number, count, values.ravel()[cells])

    return Segments(
        label=label,
        area=np.asarray(np.bincount(number, minlength=count + 1)[1:] * (side * side), np.float64),
        width=inner_width(label, count) * side,
        residual=mean(evidence.residual),
        multi_return_share=mean(evidence.inner_share),
        penetration=mean(evidence.inner_penetration),
        height=mean(evidence.height),
        tall=mean(evidence.height >= tall_height),
    )


@kernel
def groups_kernel(
    smooth: Mask, level: Values, east: Values, north: Values, side: float, max_gap: float
) -> tuple[Labels, int]:
    """Numbers (H, W), 0 for none, of the groups of `find_segments` in the order of their first cells, and how
    many there are; the planes (H, W) are those of `Evidence`."""
    rows, columns = smooth.shape
    head, label, count = np.arange(rows * columns), np.zeros((rows, columns), np.int32), 0
    for row in range(rows):
        for column in range(columns):
            for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
                y, x = row + down, column + right
                if y < rows and 0 <= x < columns and smooth[row, column] and smooth[y, x]:
                    there = carried_on(level, east, north, side, row, column, down, right) - level[y, x]
                    back = carried_on(level, east, north, side, y, x, -down, -right) - level[row, column]
                    if max(abs(there), abs(back)) < max_gap:
                        unite_kernel(head, row * columns + column, y * columns + x)
    for cell in range(rows * columns):
        row, column = cell // columns, cell % columns
        if smooth[row, column] and head[cell] == cell:
            count += 1
            label[row, column] = count
        elif smooth[row, column]:  # the head of a cell comes before it, and bears its number already
            label[row, column] = label[head[cell] // columns, head[cell] % columns]
    return label, count


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
