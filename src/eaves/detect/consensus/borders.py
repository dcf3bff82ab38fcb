"""The global step: which cells are building, by the least cut between evidence and neighbourhood."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, maximum_flow

from eaves.detect.consensus.evidence import Evidence, missed_by
from eaves.model import Mask, Values
from eaves.raster.groups import neighbour_pairs

UNIT = 100.0
"""Capacities are whole numbers: hundredths of a unit of log odds (a definition, not a threshold)."""


def cut_cells(evidence: Evidence, odds: Values, sure: float, smoothness: float, max_jump: float) -> Mask:
    """The building cells (H, W): the labelling of least energy.

    The energy is the sum of `odds` (log odds for a building, (H, W)) over the cells called otherwise, and of
    a price for each pair of neighbours called differently: `smoothness` where their surfaces continue each
    other, little where the height jumps by more than `max_jump` (m). Cells whose odds exceed `sure` either
    way are settled beforehand.
    """
    building = evidence.candidate & (odds >= sure)
    unsettled = evidence.candidate & (np.abs(odds) < sure)
    nodes = np.flatnonzero(unsettled)
    if not len(nodes):
        return building
    number = np.full(unsettled.size, -1, np.int32)
    number[nodes] = np.arange(len(nodes))
    one, two = neighbour_pairs(evidence.candidate, unsettled)
    price = smoothness * np.exp(-((continuity(evidence, one, two) / max_jump) ** 2))
    columns = evidence.shape[1]
    beside = (one // columns == two // columns) | (one % columns == two % columns)
    price = np.where(beside, price, np.sqrt(0.5) * price)

    gain = np.maximum(odds.ravel()[nodes], 0.0)
    loss = np.maximum(-odds.ravel()[nodes], 0.0)
    for inner, outer in ((one, two), (two, one)):
        rim = unsettled.ravel()[inner] & ~unsettled.ravel()[outer]
        yes, no = rim & building.ravel()[outer], rim & ~building.ravel()[outer]
        gain += np.bincount(number[inner[yes]], weights=price[yes], minlength=len(nodes))
        loss += np.bincount(number[inner[no]], weights=price[no], minlength=len(nodes))
    both = unsettled.ravel()[one] & unsettled.ravel()[two]
    pairs = (number[one[both]], number[two[both]], price[both])
    del one, two, price, beside, both  # of a wide scene they would be alive at the peak of memory
    building.ravel()[nodes[source_side(gain, loss, pairs)]] = True
    return building


def source_side(
    gain: Values, loss: Values, pairs: tuple[NDArray[np.int32], NDArray[np.int32], Values]
) -> Mask:
    """Mask (N,) of the nodes that the least cut leaves with the source.

    `gain` and `loss` (N,) are the prices of cutting a node off the source and off the sink; `pairs` holds two
    nodes and the price of parting them, (P,) each.
    """
    count = len(gain)
    source, sink = count, count + 1
    one, two, price = pairs
    every = np.arange(count, dtype=np.int32)
    rows = np.concatenate([one, two, np.full_like(every, source), every])
    columns = np.concatenate([two, one, every, np.full_like(every, sink)])
    capacity = np.concatenate(
        [np.rint(UNIT * values).astype(np.int32) for values in (price, price, gain, loss)]
    )
    graph = coo_array((capacity, (rows, columns)), (count + 2, count + 2)).tocsr()
    del rows, columns, capacity
    rest = graph - maximum_flow(graph, source, sink).flow
    rest.data = (rest.data > 0).astype(np.int8)
    rest.eliminate_zeros()
    side = np.zeros(count + 2, bool)
    side[breadth_first_order(rest, source, return_predecessors=False)] = True
    return side[:count]


def continuity(evidence: Evidence, one: NDArray[np.int64], two: NDArray[np.int64]) -> Values:
    """Distance (m) by which the highest points of neighbouring cells (K,) miss each other's surface: the
    least of both ways."""
    top = evidence.top.ravel()
    return np.minimum(missed_by(evidence, one, two, top[two]), missed_by(evidence, two, one, top[one]))
