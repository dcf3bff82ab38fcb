"""What several placements of the cells say together: the mean of their evidence on cells half as wide.

Where a cell begins is chance, and so is what a single placement measures: a window that just misses a face, a
surface that falls in two. Every half cell lies in one cell of each placement, and nothing is decided before
the mean over them is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eaves.detect.consensus.evidence import Evidence, Relief
from eaves.detect.consensus.segments import Segments
from eaves.detect.toolkit.cells import Cells
from eaves.model import Integers, Labels, Mask, Points, Values

STEPS = ((0, 0), (0, 1), (1, 0), (1, 1))
"""The placements: half cells east and north by which the points are moved under the grid."""
HALVES = 2
"""Half cells along the side of a cell."""


@dataclass(frozen=True, eq=False)
class Placement:
    """What is measured with the cells in one place."""

    xyz: Points
    """The points (N, 3), moved."""
    evidence: Evidence
    segments: Segments
    odds: Values
    """Log odds (H, W) of every cell."""
    of_surface: Values
    """Log odds (H, W) of the surface that a cell lies in, 0 in none."""
    void: Mask
    rims: Mask
    """Roofs without points, and what surrounds them, (H, W)."""
    echoes: float
    """How well echoes tell roofs from crowns, 0 to 1."""

    @property
    def roof(self) -> Mask:
        """The cells (H, W) of surfaces that are roofs."""
        return np.asarray(self.of_surface > 0.0, np.bool_)


@dataclass(frozen=True, eq=False)
class Together:
    """The mean of the placements on half cells (h, w)."""

    relief: Relief
    odds: Values
    roof: Mask
    void: Mask
    rims: Mask


def mean_of_placements(
    placements: Sequence[Placement], xyz: Points, candidate: Mask, other: Mask, most: float
) -> Together:
    """The evidence of all placements on half cells.

    `candidate` and `other` (N,) mark the points (N, 3) that could be roofs, and all others but noise. Log
    odds count up to `most` either way. A half cell that most placements have points around is part of what
    stands there, though it may be empty; it is as high as its highest point, or as those around on average,
    and its plane is that of the placement with the least residual.
    """
    cells = Cells.of(xyz, placements[0].evidence.cells.side / HALVES)
    shape = cells.shape
    share, odds, surface, top, void, rims = (np.zeros(shape) for _ in range(6))
    plane = np.zeros((4, *shape))
    plane[3] = np.inf
    for one, step in zip(placements, STEPS, strict=True):
        found = one.evidence
        row, column, east, north = seats(cells, found.cells, step)

        def here(values: NDArray[Any], row: Integers = row, column: Integers = column) -> NDArray[Any]:
            return values.take(row, axis=0).take(column, axis=1)

        seen, residual = here(found.candidate), here(found.residual)
        share += seen
        for total, values in (
            (odds, np.clip(one.odds, -most, most)),
            (surface, np.clip(one.of_surface, -most, most)),
            (top, found.top),
        ):
            np.add(total, here(values), out=total, where=seen)
        void += here(one.void)
        rims += here(one.rims)
        slopes = here(found.east), here(found.north)
        level = here(found.level) + slopes[0] * east + slopes[1] * north[:, None]
        better = seen & (residual < plane[3])
        for known, values in zip(plane, (*slopes, level, residual), strict=True):
            np.copyto(known, values, where=better)
    half, some = len(placements) / 2, np.maximum(share, 1.0)
    around = share > half
    highest = cells.extreme(np.where(candidate, xyz[:, 2], -np.inf)).reshape(shape)
    relief = Relief(
        cells=cells,
        candidate=around,
        top=np.where(around & ~np.isfinite(highest), top / some, highest),
        low=cells.extreme(np.where(other, xyz[:, 2], -np.inf)).reshape(shape),
        residual=plane[3],
        east=plane[0],
        north=plane[1],
        level=plane[2],
    )
    return Together(relief, odds / some, (surface > 0.0) | (void > half), void > half, rims > half)


def seats(half: Cells, cells: Cells, step: tuple[int, int]) -> tuple[Integers, Integers, Values, Values]:
    """The row (h,) and column (w,) in a placement of the cell that each half cell lies in, and how far (m) it
    is east (w,) and north (h,) of that cell's middle."""
    x = half.west + (np.arange(half.shape[1]) + 0.5 + step[0]) * half.side - cells.west
    y = cells.north - half.north + (np.arange(half.shape[0]) + 0.5 - step[1]) * half.side
    column, row = (np.floor(along / cells.side).astype(np.int64) for along in (x, y))
    return row, column, x - (column + 0.5) * cells.side, (row + 0.5) * cells.side - y


def on_cells(label: Labels, half: Cells, cells: Cells, step: tuple[int, int]) -> Labels:
    """Numbers (H, W) on the cells of a placement, of labels (h, w) on half cells; the largest where there are
    several."""
    found = np.zeros(cells.size, np.int32)
    some = np.flatnonzero(label)
    row, column, _, _ = seats(half, cells, step)
    y, x = np.divmod(some, half.shape[1])
    np.maximum.at(found, row[y] * cells.shape[1] + column[x], label.ravel()[some])
    return found.reshape(cells.shape)
