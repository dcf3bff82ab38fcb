"""Evidence of several placements of the cells together: its mean on cells half as wide.

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

from eaves.detect.consensus.classifier import Separation
from eaves.detect.consensus.evidence import Evidence, Relief
from eaves.detect.consensus.half_cells import HalfCells
from eaves.detect.consensus.segments import Segments
from eaves.detect.toolkit.cells import Cells
from eaves.model import Mask, Values


@dataclass(frozen=True, eq=False)
class Placement:
    """Measurements of the cells in one placement."""

    evidence: Evidence
    segments: Segments
    odds: Values
    """Log odds (H, W) of every cell."""
    of_surface: Values
    """Log odds (H, W) of the surface that a cell lies in, 0 in none."""
    void: Mask
    rims: Mask
    """Roofs without points, and what surrounds them, (H, W)."""
    measures: tuple[Separation, ...]
    """What echoes and penetration tell in the scan."""

    @property
    def roof(self) -> Mask:
        """The cells (H, W) of surfaces that are roofs."""
        return np.asarray(self.of_surface > 0.0, np.bool_)


@dataclass(frozen=True, eq=False)
class HalfRelief(Relief):
    """The relief of half cells."""

    cells: Cells


@dataclass(frozen=True, eq=False)
class Together:
    """The mean of the placements on half cells (h, w)."""

    relief: HalfRelief
    odds: Values
    roof: Mask
    void: Mask
    rims: Mask


def mean_of_placements(placements: Sequence[Placement], halves: HalfCells, most: float) -> Together:
    """The evidence of all placements on half cells.

    Log odds count up to `most` either way. A half cell that most placements have points around is part of
    what stands there, though it may be empty; it is as high as its highest point, or as those around on
    average, and its plane is that of the placement with the least residual.
    """
    half = halves.cells
    share, void, rims = np.zeros((3, *half.shape), np.int8)
    for one in placements:
        of_half = one.evidence.cells.of_half
        for votes, mask in ((share, one.evidence.candidate), (void, one.void), (rims, one.rims)):
            if mask.any():
                votes += mask.ravel()[of_half]
    most_of = len(placements) / 2
    around, hole = share > most_of, void > most_of
    some = np.flatnonzero(around)
    y, x = np.divmod(some, half.shape[1])
    odds, surface, top = np.zeros((3, len(some)))
    plane = np.zeros((4, len(some)))
    plane[3] = np.inf
    for one in placements:
        found, (east, north) = one.evidence, one.evidence.cells.off_middle
        seen, cell = found.candidate, found.cells.of_half.ravel()[some]
        for total, raster in (
            (odds, np.clip(one.odds, -most, most)),
            (surface, np.clip(one.of_surface, -most, most)),
            (top, np.where(seen, found.top, 0.0)),
        ):
            total += raster.ravel()[cell]
        residual = np.where(seen, found.residual, np.inf).ravel()[cell]
        better = np.flatnonzero(residual < plane[3])
        cell = cell[better]
        slopes = found.east.ravel()[cell], found.north.ravel()[cell]
        level = found.level.ravel()[cell] + slopes[0] * east[x[better]] + slopes[1] * north[y[better]]
        plane[:, better] = *slopes, level, residual[better]

    def on_half(values: Values | Mask, outside: float) -> NDArray[Any]:
        raster = np.full(half.shape, outside, values.dtype)
        raster.ravel()[some] = values
        return raster

    times = share.ravel()[some]
    relief = HalfRelief(
        cells=half,
        candidate=around,
        top=np.where(np.isfinite(halves.top), halves.top, on_half(top / times, -np.inf)),
        low=halves.low,
        residual=on_half(plane[3], np.inf),
        east=on_half(plane[0], 0.0),
        north=on_half(plane[1], 0.0),
        level=on_half(plane[2], 0.0),
    )
    roof = on_half(surface > 0.0, 0.0) | hole
    return Together(relief, on_half(odds / times, 0.0), roof, hole, rims > most_of)
