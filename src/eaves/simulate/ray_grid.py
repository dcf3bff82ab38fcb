"""Triangles and bodies of leaves over each square of the terrain: where rays are traced.

Airborne pulses are steep: between the highest roof and the ground one crosses some ten squares of a metre.
So a plain grid in plan, whose squares hold the greatest height in them, beats a tree of boxes: a step costs
one comparison, a square holds a handful of triangles, and the terrain needs no triangles at all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eaves.kernels import kernel
from eaves.model import GROUND, WATER
from eaves.simulate.objects.surfaces import Foliage, ScannedSurfaces, Terrain

TERRAIN_LABEL, WATER_LABEL = 0, 1
"""First rows of the table of labels."""

TOUCH = 1e-6
"""Triangles this near a square (m) are listed in it."""


@dataclass(frozen=True, eq=False)
class RayGrid:
    """A town, indexed by the squares (I, J) of its terrain.

    `triangles` (T, 9) are corner, edge and edge; those over square s = i·J + j are `members[starts[s] :
    starts[s+1]]`, and `leaf_members` lists bodies of leaves alike. `tops` (I, J) is the highest thing over a
    square. `label` (T,) and `leaf_label` (V,) are rows of the table `labels` (L, 3): class, building, plane.
    """

    terrain: Terrain
    triangles: NDArray[np.float64]
    label: NDArray[np.int32]
    starts: NDArray[np.int64]
    members: NDArray[np.int32]
    foliage: Foliage
    leaf_label: NDArray[np.int32]
    leaf_starts: NDArray[np.int64]
    leaf_members: NDArray[np.int32]
    tops: NDArray[np.float64]
    labels: NDArray[np.int32]

    @property
    def lowest(self) -> float:
        """The lowest ground (m)."""
        return float(self.terrain.heights.min())

    @property
    def highest(self) -> float:
        """The highest thing (m)."""
        return float(self.tops.max())


def index_town(terrain: Terrain, surfaces: ScannedSurfaces, foliage: Foliage) -> RayGrid:
    """The index of everything a pulse can meet."""
    columns, rows = terrain.water.shape
    plan = (surfaces.corners[:, :, :2] - [terrain.west, terrain.south]) / terrain.cell
    starts, members = _squares_under(plan, columns, rows)
    leaf_plan = _boxes_of(foliage)
    leaf_plan = (leaf_plan - [terrain.west, terrain.south]) / terrain.cell
    leaf_starts, leaf_members = _squares_under(leaf_plan, columns, rows)
    tops = np.maximum.reduce(
        [
            terrain.heights[:-1, :-1],
            terrain.heights[1:, :-1],
            terrain.heights[:-1, 1:],
            terrain.heights[1:, 1:],
        ]
    )
    tops = tops.copy()
    flat = tops.reshape(-1)
    square = np.repeat(np.arange(columns * rows), np.diff(starts))
    np.maximum.at(flat, square, surfaces.corners[:, :, 2].max(axis=1, initial=-np.inf)[members])
    square = np.repeat(np.arange(columns * rows), np.diff(leaf_starts))
    np.maximum.at(flat, square, (foliage.bodies[:, 2] + foliage.bodies[:, 5])[leaf_members])
    corners = surfaces.corners
    triangles = np.concatenate(
        [corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=1
    )
    ground = np.array([[GROUND, 0, 0], [WATER, 0, 0]], np.int32)
    solid = np.column_stack([surfaces.truth_class, surfaces.building, surfaces.plane]).astype(np.int32)
    leaves = np.zeros((len(foliage.shape), 3), np.int32)
    leaves[:, 0] = foliage.truth_class
    things, row = np.unique(np.concatenate([solid, leaves]).reshape(-1, 3), axis=0, return_inverse=True)
    of_label = (row.reshape(-1) + len(ground)).astype(np.int32)
    return RayGrid(
        terrain,
        np.ascontiguousarray(triangles),
        of_label[: len(solid)],
        starts,
        members,
        foliage,
        of_label[len(solid) :],
        leaf_starts,
        leaf_members,
        tops,
        np.concatenate([ground, things.astype(np.int32)]),
    )


def _boxes_of(foliage: Foliage) -> NDArray[np.float64]:
    """A rectangle in plan, as its two triangles' shared diagonal cannot miss: four corners per body (V, 4,
    2).
    """
    x, y, half_x, half_y, cos, sin = (foliage.bodies[:, k] for k in (0, 1, 3, 4, 6, 7))
    reach_x, reach_y = (
        half_x * np.abs(cos) + half_y * np.abs(sin),
        half_x * np.abs(sin) + half_y * np.abs(cos),
    )
    signs = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    corners = np.stack([reach_x, reach_y], axis=1)[:, None, :] * signs
    return np.asarray(np.stack([x, y], axis=1)[:, None, :] + corners)


def _squares_under(
    plan: NDArray[np.float64], columns: int, rows: int
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """For convex polygons in plan (T, K, 2), in units of squares: starts (columns·rows + 1,) and members."""
    counts = np.zeros(columns * rows + 1, np.int64)
    none = np.zeros(0, np.int32)
    list_squares_kernel(plan, columns, rows, TOUCH, counts, none, False)
    starts = np.concatenate([[0], np.cumsum(counts[:-1])])
    members = np.zeros(int(starts[-1]), np.int32)
    list_squares_kernel(plan, columns, rows, TOUCH, starts[:-1].copy(), members, True)
    return starts, members


@kernel
def list_squares_kernel(
    plan: NDArray[np.float64], columns: int, rows: int, touch: float, cursor: NDArray[np.int64],
    members: NDArray[np.int32], fill: bool,
) -> None:  # fmt: skip
    """Count in `cursor`, or list in `members`, the polygons that meet each unit square (separating axes)."""
    count, corners = plan.shape[0], plan.shape[1]
    for t in range(count):
        low_x = high_x = plan[t, 0, 0]
        low_y = high_y = plan[t, 0, 1]
        for k in range(1, corners):
            low_x, high_x = min(low_x, plan[t, k, 0]), max(high_x, plan[t, k, 0])
            low_y, high_y = min(low_y, plan[t, k, 1]), max(high_y, plan[t, k, 1])
        first_i, last_i = (
            max(0, int(np.floor(low_x - touch))),
            min(columns - 1, int(np.floor(high_x + touch))),
        )
        first_j, last_j = max(0, int(np.floor(low_y - touch))), min(rows - 1, int(np.floor(high_y + touch)))
        for i in range(first_i, last_i + 1):
            for j in range(first_j, last_j + 1):
                apart = False
                for k in range(corners):
                    ax, ay = plan[t, k, 0], plan[t, k, 1]
                    bx, by = plan[t, (k + 1) % corners, 0], plan[t, (k + 1) % corners, 1]
                    nx, ny = by - ay, ax - bx
                    low = high = 0.0
                    for m in range(corners):
                        d = nx * (plan[t, m, 0] - ax) + ny * (plan[t, m, 1] - ay)
                        low, high = min(low, d), max(high, d)
                    middle = nx * (i + 0.5 - ax) + ny * (j + 0.5 - ay)
                    reach = 0.5 * (abs(nx) + abs(ny)) + touch * (abs(nx) + abs(ny) + 1.0)
                    if middle + reach < low or middle - reach > high:
                        apart = True
                        break
                if not apart:
                    square = i * rows + j
                    if fill:
                        members[cursor[square]] = t
                    cursor[square] += 1
