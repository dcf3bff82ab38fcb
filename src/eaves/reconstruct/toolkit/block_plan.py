"""The plan of a roof, whole or cut into the houses of a block by the walls between them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import shapely
from shapely import Polygon

from eaves.geometry.inside import edges_of
from eaves.geometry.rings import polygon_parts
from eaves.model import Bounds, Integers, Points, Values
from eaves.reconstruct.toolkit.ceiling import highest_of
from eaves.reconstruct.toolkit.cell_labels import Borders, LabelCosts, PlaneReach, cell_costs, label_nodes
from eaves.solids.coverage import OUTSIDE, SMALLEST_PART, Coverage
from eaves.solids.cutting import cut
from eaves.solids.extrude import TURNS, inner_halves, tidy

Draft = tuple[Coverage, Integers]
"""Cells and the label (C,) of each."""


@dataclass(frozen=True, eq=False)
class BlockPlan:
    """The cells of a block, each with a label that stands for one of the `planes` (L, 3) and for a `part`
    (L,) of the block; with corners settled, and as they were found. `shown` are the roof points (K, 3) around
    each part.

    The whole block is tidied at once, so neighbours have the corners of their walls in common.
    """

    drafts: tuple[Draft, Draft]
    shown: Sequence[Points]
    planes: Values
    part: Integers
    spacing: float
    smallest: float
    tidied: dict[tuple[int, int], Draft] = field(default_factory=dict)
    """What was tidied, by the draft and how firmly."""

    def of_part(self, number: int) -> Iterator[tuple[Draft, Iterator[Draft]]]:
        """The drafts of one part, and each as it is in the block once that is tidied, more firmly from turn
        to turn."""
        for draft, whole in enumerate(self.drafts):
            yield self.taken(whole, number), (self.taken(self.tidy(draft, turn), number) for turn in TURNS)

    def tidy(self, draft: int, turn: int) -> Draft:
        """The block tidied."""
        if (draft, turn) not in self.tidied:
            self.tidied[draft, turn] = tidy(*self.drafts[draft], self.smallest, turn, self.part)
        return self.tidied[draft, turn]

    def taken(self, draft: Draft, number: int) -> Draft:
        """The cells of one part."""
        plan, labels = draft
        part, cells = plan.merged(np.where(self.part[labels] == number, np.arange(plan.count), OUTSIDE))
        return part, labels[cells]


def points_near(points: Points, outline: Polygon, reach: float) -> Integers:
    """The numbers of the points (N, 3) within `reach` (m) of an outline."""
    shapely.prepare(outline)
    near = shapely.contains_xy(outline, points[:, 0], points[:, 1])
    beside = np.flatnonzero(~near & Bounds(*outline.bounds).buffered(reach).contains(points))
    near[beside] = shapely.dwithin(outline, shapely.points(points[beside, :2]), reach)
    return np.flatnonzero(near)


def outline_around(parts: Sequence[Polygon]) -> Polygon:
    """The outline of the parts of a block, its largest piece where it has several, without the holes that
    walls leave open."""
    whole = max(polygon_parts(shapely.union_all(parts)), key=lambda piece: piece.area)
    return Polygon(whole.exterior, [ring for ring in whole.interiors if Polygon(ring).area > SMALLEST_PART])


def divide_plan(
    plan: Coverage,
    chosen: Integers,
    reach: PlaneReach,
    costs: LabelCosts,
    parts: Sequence[Polygon],
    near: Sequence[Integers],
) -> tuple[Draft, Values, Integers, Values]:
    """A plan with the plane (C,) of each cell cut by the outlines of parts: labels of its cells, and of each
    label the plane (L, 3), the part (L,), and how high it may be there (L,). The roof points `near` each part
    show what lies in it."""
    first, last, _ = edges_of(shapely.force_2d(parts))
    pieces = cut(plan, np.hstack([first, last])) if len(parts) > 1 else None
    if pieces is None:
        return (plan, chosen), reach.planes, np.zeros(len(reach.planes), np.int64), reach.highest
    places, count = shapely.point_on_surface(pieces.polygons()), len(reach.planes)
    point, cell = plan.cells_of(shapely.get_coordinates(places))
    part, plane = shapely.STRtree(parts).nearest(places), np.full(pieces.count, OUTSIDE)
    plane[point] = chosen[cell]
    pieces, labels = pieces.merged(np.where(plane == OUTSIDE, OUTSIDE, part * count + plane))
    part, plane = np.divmod(labels, count)
    highest = np.tile(reach.highest, (len(parts), 1))
    for number, points in enumerate(near):
        inside = np.flatnonzero(part == number)
        if len(inside) and len(points):
            own = replace(reach, roof=reach.roof[points], labels=reach.labels[points])
            highest[number] = highest_of(own.roof, own.labels, reach.planes, costs.residual_limit)
            own = replace(own, highest=highest[number])
            plane[inside] = worthwhile_planes(pieces, inside, plane[inside], own, costs)
    names, labels = np.unique(part * count + plane, return_inverse=True)
    part, plane = np.divmod(names, count)
    return pieces.merged(labels.ravel()), reach.planes[plane], part, highest[part, plane]


def worthwhile_planes(
    pieces: Coverage, inside: Integers, plane: Integers, reach: PlaneReach, costs: LabelCosts
) -> Integers:
    """The plane (K,) of the cells `inside` (K,) one part, which have one of the block, by the points near the
    part.

    A piece keeps its plane where that is not too high, and where it saves its points what it costs to say
    where a face lies; that planes border on each other there is paid for in the block.
    """
    taken = np.full(pieces.count, OUTSIDE)
    taken[inside] = np.arange(len(inside))
    cells, _ = pieces.merged(taken)
    known = np.unique([*plane, *reach.labels[reach.labels >= 0], len(reach.planes) - 1])
    labels = np.where(reach.labels >= 0, np.searchsorted(known, reach.labels), -1)
    of_part = replace(reach, labels=labels, planes=reach.planes[known], highest=reach.highest[known])
    data = cell_costs(cells, of_part, costs, cells.cells_of(reach.roof))
    halves = inner_halves(cells)
    edges = np.column_stack([cells.cell[halves], cells.cell[cells.twin[halves]]])
    free = Borders(edges, np.zeros(len(edges)), np.zeros((len(edges), 1, 2)), of_part.planes, 0.0, 1.0)
    price = costs.plane_points * reach.spacing**2
    return known[label_nodes(data, free, price, np.searchsorted(known, plane))]
