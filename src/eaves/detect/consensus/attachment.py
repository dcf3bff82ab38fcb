"""How far the rim of a region goes on in the terrain: a roof ends at a step, a rock does not."""

from __future__ import annotations

import numpy as np

from eaves.detect.consensus.evidence import Evidence, rim_pairs
from eaves.detect.consensus.segments import level_at
from eaves.model import Labels, Values


def attached_share(evidence: Evidence, region: Labels, count: int, continues: float) -> Values:
    """Share (count + 1,) of the rim of each region 0…`count` of cells (H, W) where terrain continues it.

    Parameters
    ----------
    evidence : planes, highest candidate and highest low point of the cells.
    region : number of each cell's region, 0 for none.
    count : the largest number.
    continues : terrain that misses the carried-on surface by less (m) goes on from it.

    Returns
    -------
    Values
        Of all pairs of a region's cell and an eight-neighbour outside, the share in which the highest point
        of the outer cell that is no candidate lies on the inner cell's plane, or at the height of its top.
    """
    number = region.ravel()
    inner, outer = rim_pairs(region, (evidence.cells.count > 0).reshape(evidence.shape))
    low = evidence.low.ravel()[outer]
    known = np.isfinite(low)
    planar = np.isfinite(evidence.residual.ravel()[inner])
    low = np.where(known, low, 0.0)
    miss = np.where(planar, np.abs(level_at(evidence, inner, outer, 1.0) - low), np.inf)
    miss = np.minimum(miss, np.abs(evidence.top.ravel()[inner] - low))
    hits = np.bincount(number[inner], weights=known & (miss < continues), minlength=count + 1)
    return np.asarray(hits / np.maximum(np.bincount(number[inner], minlength=count + 1), 1), np.float64)
