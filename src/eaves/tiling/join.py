"""Between the passes: regions that share points across a seam become one building, with one home block."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from eaves.geometry.polygons import as_polygon
from eaves.model import Block, Footprint
from eaves.pipeline import BlockResult


@dataclass(frozen=True, eq=False)
class Seam:
    """What the join needs to know of one block: its regions, and the labelled points near its border."""

    block: Block
    count: int
    point_id: np.ndarray
    label: np.ndarray
    inside: np.ndarray
    """Which labels (count + 1,) have points inside the block."""

    @classmethod
    def of(cls, result: BlockResult) -> Seam:
        """What the block pass found near the seams of its block."""
        count = int(max(result.label.max(initial=0), result.seam_label.max(initial=0)))
        inside = np.zeros(count + 1, bool)
        inside[result.label] = True
        inside[0] = False
        return cls(result.block, count, result.seam_id, result.seam_label, inside)


@dataclass(frozen=True, eq=False)
class BuildingPlan:
    """The parts a building is joined from: regions (block, label), or blocks under a given footprint."""

    number: int
    regions: tuple[tuple[Block, int], ...]
    given: Footprint | None = None


@dataclass(frozen=True, eq=False)
class HomePlan:
    """The buildings at home in one block."""

    home: Block
    buildings: tuple[BuildingPlan, ...]


def join_regions(seams: Sequence[Seam]) -> list[HomePlan]:
    """Buildings from regions: two regions are one building when both blocks saw the same point in them.

    A building is at home in the first (by column, row) of the blocks that hold points of it, and is
    numbered there in the order of its first label.
    """
    seams = sorted(seams, key=lambda seam: seam.block)
    start = np.cumsum([0, *(seam.count for seam in seams)])
    total = int(start[-1])
    if total == 0:
        return []
    node = np.concatenate([seam.label + start[i] - 1 for i, seam in enumerate(seams)])
    point = np.concatenate([seam.point_id for seam in seams])
    order = np.lexsort((node, point))
    same = point[order][1:] == point[order][:-1]
    one, other = node[order][:-1][same], node[order][1:][same]
    graph = coo_array((np.ones(len(one), bool), (one, other)), shape=(total, total))
    _, component = connected_components(graph, directed=False)

    owner = np.repeat(np.arange(len(seams)), [seam.count for seam in seams])
    label = np.arange(total) - start[owner] + 1
    held = np.concatenate([seam.inside[1:] for seam in seams])
    members: dict[int, list[int]] = {}
    for index in np.flatnonzero(held):
        members.setdefault(int(component[index]), []).append(int(index))
    homes: dict[Block, list[tuple[tuple[Block, int], ...]]] = {}
    for parts in sorted(members.values()):
        regions = tuple((seams[owner[part]].block, int(label[part])) for part in parts)
        homes.setdefault(regions[0][0], []).append(regions)
    return [
        HomePlan(home, tuple(BuildingPlan(i, regions) for i, regions in enumerate(homes[home], 1)))
        for home in sorted(homes)
    ]


def assign_footprints(footprints: Sequence[Footprint], blocks: Sequence[Block]) -> list[HomePlan]:
    """Buildings from given footprints (polygons, world metres), at home where their representative point is.

    Footprints that meet no block with points are left out; the caller counts them.
    """
    side = blocks[0].side
    known = set(blocks)
    homes: dict[Block, list[tuple[tuple[Block, ...], Footprint]]] = {}
    for footprint in footprints:
        west, south, east, north = footprint.polygon.bounds
        first, last = Block.at(west, south, side), Block.at(east, north, side)
        under = tuple(
            Block(column, row, side)
            for column in range(first.column, last.column + 1)
            for row in range(first.row, last.row + 1)
            if Block(column, row, side) in known
        )
        if not under:
            continue
        point = footprint.polygon.representative_point()
        home = Block.at(point.x, point.y, side)
        moved = as_polygon(
            shapely.transform(footprint.polygon, lambda xy, home=home: xy - np.array(home.origin))
        )
        if moved is None:
            continue
        homes.setdefault(home, []).append(
            (under, footprint.with_(polygon=shapely.orient_polygons(moved), origin=home.origin))
        )
    return [
        HomePlan(
            home,
            tuple(
                BuildingPlan(i, tuple((block, 0) for block in under), footprint)
                for i, (under, footprint) in enumerate(homes[home], 1)
            ),
        )
        for home in sorted(homes)
    ]
