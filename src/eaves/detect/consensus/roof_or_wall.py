"""Which part of its building each point is: roof or wall."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.detect.consensus.evidence import Evidence
from eaves.model import Labels, Points
from eaves.model.scene import ROOF, WALL
from eaves.raster.squares import shrunk_by_square


def part_of_points(
    xyz: Points,
    number: Labels,
    evidence: Evidence,
    region: Labels,
    max_residual: float,
    below_plane: float,
) -> NDArray[np.uint8]:
    """Codes (N,) for the points (N, 3) of regions `number` (N,), 0 for the others.

    Walls show only at the rim of a region; whatever lies inside it (chimneys, machinery, the floor of a
    light well) counts as roof. There a point `below_plane` (m) under its cell's plane is on the wall, and in
    a cell without a plane one twice as far under the highest.
    """
    part = np.where(number > 0, ROOF, 0).astype(np.uint8)
    inner = shrunk_by_square(region > 0, 5)
    flat = evidence.residual < max_residual
    lowest = np.where(flat, evidence.level - below_plane, evidence.top - 2.0 * below_plane)
    lowest = np.where(inner, -np.inf, lowest).ravel()
    some = np.flatnonzero(number > 0)
    part[some[xyz[some, 2] < lowest[evidence.cells.cell[some]]]] = WALL
    return part
