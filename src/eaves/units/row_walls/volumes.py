"""The main volume of a block, without the annexes of one storey that lean on it."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage
from shapely import Polygon

from eaves.geometry.rings import polygon_parts
from eaves.methods import Method, parameter
from eaves.model import Mask, Points
from eaves.units.row_walls.rows import CELL_M as FINE_M
from eaves.units.row_walls.rows import JOG_M

CELL_M = 2.0 * FINE_M
"""Side of the cells (m) in which heights are compared."""


class VolumeRules(Method):
    """The measures of an annex and of a main volume."""

    annex: float = parameter(4.2, "An annex is lower: one storey, with its roof.", unit="m", gt=0.0)
    house: float = parameter(
        5.5,
        "Only beside a volume this high is a low part an annex; where all is low, all is main volume.",
        unit="m",
        gt=0.0,
    )
    narrowest_annex: float = parameter(
        JOG_M,
        "Narrower low ground is an eave, a gap or a balcony, and stays with what stands beside it.",
        unit="m",
        ge=0.0,
    )
    smallest_volume: float = parameter(
        15.0,
        "A main volume is at least so large: less is a dormer, a chimney or a tree.",
        unit="m2",
        ge=0.0,
    )


def main_volumes(
    outline: Polygon, points: Points, height: NDArray[np.float64], limits: VolumeRules
) -> list[Polygon]:
    """The parts of a block's outline that stand higher than an annex, from its roof points (N, 3) and their
    heights over the terrain (N,).
    """
    if len(height) == 0 or np.percentile(height, 75.0) < limits.house:
        return [outline]
    west, south, east, north = outline.bounds
    columns, rows = int((east - west) / CELL_M) + 1, int((north - south) / CELL_M) + 1
    cell = np.clip(((points[:, 1] - south) / CELL_M).astype(np.int64), 0, rows - 1) * columns
    cell += np.clip(((points[:, 0] - west) / CELL_M).astype(np.int64), 0, columns - 1)
    order = np.lexsort((height, cell))
    first = np.searchsorted(cell[order], np.arange(rows * columns + 1))
    count = np.diff(first)
    middle = np.full(rows * columns, np.nan)
    there = count > 0
    middle[there] = height[order][(first[:-1] + count // 2)[there]]
    grid = middle.reshape(rows, columns)
    known = np.isfinite(grid)
    nearest = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    low = grid[tuple(nearest)] < limits.annex
    ground = low_ground(low, west, south)
    half = 0.5 * limits.narrowest_annex
    ground = shapely.buffer(shapely.buffer(ground, -half, join_style="mitre"), half, join_style="mitre")
    if shapely.is_empty(ground):
        return [outline]
    main = shapely.difference(outline, ground)
    main = shapely.buffer(shapely.buffer(main, -half, join_style="mitre"), half, join_style="mitre")
    parts = [part for part in polygon_parts(main) if part.area >= limits.smallest_volume]
    return sorted(parts, key=lambda part: -part.area) or [outline]


def low_ground(low: Mask, west: float, south: float) -> shapely.Geometry:
    """The cells of a mask (H, W) as one shape: each run along a line of cells is a box."""
    padded = np.pad(low, ((0, 0), (1, 1))).astype(np.int8)
    change = np.diff(padded, axis=1)
    row, start = np.nonzero(change == 1)
    _, end = np.nonzero(change == -1)
    boxes = shapely.box(
        west + start * CELL_M, south + row * CELL_M, west + end * CELL_M, south + (row + 1) * CELL_M
    )
    return shapely.union_all(boxes)
