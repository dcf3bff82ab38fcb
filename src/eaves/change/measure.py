"""The properties of two epochs that are to be compared: spacing, noise, and how far the new one lies off the
old."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eaves.change.epoch import Epoch
from eaves.change.shift import TRIM, Shift, fit_shift
from eaves.change.surface import nearest_distances, point_planes
from eaves.flow import FEWEST, STRIP_CELL, Progress
from eaves.geometry import measure_spacing
from eaves.model import BUILDING, GROUND, Block, PointCloud
from eaves.upkeep import SAME_SURFACE_M

REACH = 6.0
"""Width of the surroundings of a block that its points are faced with (m): more than any radius."""

FARTHEST = 1.0
"""Largest shift in plan between epochs, and of pairs from planes (m): half a storey is more."""

BLOCKS_FOR_SHIFT = 60
"""Maximum number of blocks that the shift is derived from, spread evenly."""

SMOOTHEST = 0.08
"""Noise of tiles and gravel (m) under which no roof lies."""


@dataclass(frozen=True)
class Measured:
    """Of two epochs: mean spacings (m), the new one's shift, how rough roofs are (m, one standard deviation),
    how near a surface must lie to be the same (m), and the radius that faces a point with the other epoch."""

    spacings: tuple[float, float]
    shift: Shift
    rough: float
    tolerance: float
    radius: float


def measure_epochs(old: Epoch, new: Epoch, blocks: Sequence[Block], progress: Progress) -> Measured:
    """Spacings, noise and shift, from blocks spread evenly over the given ones, which both epochs cover."""
    evenly = np.unique(np.linspace(0, len(blocks) - 1, BLOCKS_FOR_SHIFT).astype(int))
    some = [blocks[k] for k in evenly] if blocks else []  # none where nothing is in both
    spacings: list[list[float]] = [[], []]
    coarse: list[NDArray[np.float64]] = [np.zeros(0)]
    for block in some:
        clouds = [epoch.points(block, 0.0) for epoch in (old, new)]
        for kept, cloud in zip(spacings, clouds, strict=True):
            if len(cloud) > FEWEST:
                kept.append(measure_spacing(cloud.xyz))
        coarse.append(ground_differences(*clouds))
    one, other = (float(np.median(kept)) if kept else 1.0 for kept in spacings)
    radius = max(0.75, 1.5 * max(one, other))
    differences = np.concatenate(coarse)
    enough = len(differences) >= FEWEST
    first = Shift(0.0, 0.0, float(np.median(differences)) if enough else 0.0, 0.0, len(differences) * enough)
    slopes, distances, roughness = [np.zeros((0, 2))], [np.zeros(0)], [np.zeros(0)]
    for done, block in enumerate(some, 1):
        before, after = old.points(block, 0.0), new.points(block, REACH)
        roof = before.xyz[classes_of(before) == BUILDING]
        if len(roof) < FEWEST or not len(after):
            continue
        slope, rms = point_planes(roof)
        flat = rms <= 2 * SMOOTHEST
        others = after.xyz - first.vector
        slopes.append(slope[flat])
        distances.append(nearest_distances(roof[flat], slope[flat], others, radius, FARTHEST))
        roughness.append(rms[flat])
        progress("align", done, len(some))
    fitted = fit_shift(np.concatenate(slopes), np.concatenate(distances))
    up = first.up + (fitted.up if fitted.pairs >= FEWEST else 0.0)
    shift = replace(fitted, up=up, pairs=fitted.pairs or first.pairs)
    rough = np.concatenate(roughness)
    typical = float(np.median(rough)) if len(rough) else SMOOTHEST / TRIM
    return Measured((one, other), shift, typical, max(SAME_SURFACE_M, 4.0 * shift.noise), radius)


def ground_differences(old: PointCloud, new: PointCloud) -> NDArray[np.float64]:
    """Rise (K,) of the median heights of ground from the old to the new epoch, in the cells that both
    show."""
    keys, heights = [], []
    for cloud in (old, new):
        ground = cloud.xyz[classes_of(cloud) == GROUND]
        place = np.floor(ground[:, :2] / STRIP_CELL).astype(np.int64)
        key = place[:, 0] * 2**32 + place[:, 1]
        order = np.lexsort((ground[:, 2], key))
        key, z = key[order], ground[order, 2]
        known, first, count = np.unique(key, return_index=True, return_counts=True)
        keys.append(known)
        heights.append(z[first + count // 2])
    _, one, other = np.intersect1d(keys[0], keys[1], assume_unique=True, return_indices=True)
    return np.asarray(heights[1][other] - heights[0][one])


def classes_of(cloud: PointCloud) -> NDArray[np.uint8]:
    """The classes (N,)."""
    assert cloud.classification is not None
    return cloud.classification
