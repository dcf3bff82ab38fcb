"""Boundaries of many solids laid flat in arrays, on the integer grid their coordinates were written on."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import chain

import numpy as np
from scipy.spatial import cKDTree

from eaves.geometry.components import connected_groups_kernel
from eaves.geometry.face_table import FaceTable
from eaves.geometry.tolerance import SNAP
from eaves.model import Integers, Values

LARGEST_EXTENT = 1 << 28
"""Extent (steps) up to which the exact predicates cannot overflow; 268 km at a millimetre."""

FINEST_STEP = 1e-5
"""Coordinates written finer than this (m) are rounded to it: a hundredth of the snap tolerance."""

Ring = list[int]
Face = list[Ring]
Shell = list[Face]


@dataclass(frozen=True, eq=False)
class Boundaries:
    """Shells of faces of rings of points.

    `points` (P,) are rows of `vertices` (V, 3), which are integers in units of `step` metres; vertices nearer
    than the snap tolerance have become one. `faces` are those of all shells, about the origin of the
    vertices; shell s has the faces `shells[s]:shells[s + 1]`.
    """

    vertices: Integers
    step: float
    points: Integers
    faces: FaceTable
    shells: Integers

    @property
    def shell_count(self) -> int:
        """Shells, also those without faces."""
        return len(self.shells) - 1

    @property
    def face_of_point(self) -> Integers:
        """The face (P,) of each point."""
        return self.faces.face_of_corner

    @cached_property
    def shell_of_face(self) -> Integers:
        """The shell (F,) of each face."""
        return np.repeat(np.arange(self.shell_count), np.diff(self.shells))

    @cached_property
    def local(self) -> Integers:
        """Coordinates (P, 3) of the points in steps from the lowest corner of their shell: small numbers."""
        xyz = self.vertices[self.points]
        shell = self.shell_of_face[self.face_of_point]
        corner = np.zeros((self.shell_count, 3), np.int64)
        filled, first = np.unique(shell, return_index=True)
        if len(filled):
            corner[filled] = np.minimum.reduceat(xyz, first, axis=0)
        return xyz - corner[shell]


def lay_flat(shells: list[Shell], vertices: Integers, step: float, snap: float = SNAP) -> Boundaries:
    """Boundaries of nested lists of vertex numbers, with vertices of a shell nearer than `snap` (m) merged.

    Vertices exactly `snap` apart are merged too: whether val3dity does so depends on rounding.
    """
    faces = list(chain.from_iterable(shells))
    rings = list(chain.from_iterable(faces))
    numbers = np.fromiter(chain.from_iterable(rings), np.int64)
    sizes, counts = (np.array([len(part) for part in parts], np.int64) for parts in (rings, faces))
    table = FaceTable(vertices[numbers].astype(np.float64), sizes, counts)
    shell_sizes = np.array([len(shell) for shell in shells], np.int64)
    owner = np.repeat(np.arange(len(shells)), shell_sizes)[table.face_of_corner]
    rows = np.column_stack([owner, vertices[numbers]])
    order = np.lexsort(rows.T[::-1])
    new = np.ones(len(rows), bool)
    new[1:] = (rows[order][1:] != rows[order][:-1]).any(axis=1)
    same = np.empty(len(rows), np.int64)
    same[order] = np.cumsum(new) - 1
    places = rows[order[new]]
    merged = _merge_near(places, snap / step)
    return Boundaries(places[:, 1:], step, merged[same], table, np.append(0, np.cumsum(shell_sizes)))


def to_grid(coordinates: Values, step: float) -> Integers:
    """Coordinates (N, 3) as whole numbers of steps."""
    return np.rint(coordinates / step).astype(np.int64)


def _merge_near(places: Integers, tolerance_steps: float) -> Integers:
    """For each place (N, 4: shell, x, y, z) the first of its shell that is one with it by the tolerance."""
    if tolerance_steps < 1.0 - 1e-9 or len(places) < 2:
        return np.arange(len(places))
    local = (places - places.min(axis=0)).astype(np.float64)
    local[:, 0] *= 2.0 * tolerance_steps  # shells are apart, and stay so
    pairs = cKDTree(local).query_pairs(tolerance_steps * (1 + 1e-9), output_type="ndarray")
    node, partner = np.ascontiguousarray(pairs.T, np.int64)
    group = connected_groups_kernel(node, partner, len(places))
    first = np.full(group.max() + 1, len(places))
    np.minimum.at(first, group, np.arange(len(places)))
    return np.asarray(first[group])
