"""Blocks that hold nothing but points far from all others: damage, birds, wrong scales."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np

from eaves.model import Block
from eaves.model.cloud import GRID_STEP
from eaves.run.store import Store

TOO_FEW = 10
"""So few points in a block and its eight neighbours hold no terrain."""
FEW = 100
"""So few are looked at: they are no survey when they are sparser than `SPARSEST`."""
SPARSEST = 0.01
"""Points a square metre, a fifteenth of the sparsest survey that is worth a terrain."""


def find_isolated_blocks(store: Store, blocks: Sequence[Block]) -> dict[Block, int]:
    """The blocks not worth a computation, with how many points they hold.

    A damaged file strews its points over a continent: a block each would cost days, a raster over all of them
    more than there is. The answer depends on the points of a block and its neighbours only.
    """
    counts = {block: store.count_points(block) for block in blocks}
    isolated = {}
    for block in blocks:
        near = [
            Block(block.column + right, block.row + up, block.side)
            for right, up in product((-1, 0, 1), repeat=2)
        ]
        count = sum(counts.get(one, 0) for one in near)
        if count < TOO_FEW or (count < FEW and density(store, near) < SPARSEST):
            isolated[block] = counts[block]
    return isolated


def density(store: Store, blocks: Sequence[Block]) -> float:
    """Points per square metre of the rectangle around the points of some blocks."""
    xy = np.concatenate(
        [store.read_points(block)["xyz"][:, :2] * GRID_STEP + np.array(block.origin) for block in blocks]
    )
    area = float(np.prod(np.ptp(xy, axis=0)))
    return len(xy) / max(area, 1.0)
