"""The default reconstructor: a plan of lines, labelled by a graph cut, raised to solids."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import shapely
from numpy.typing import NDArray

from eaves.geometry.arrangement import arrange
from eaves.geometry.coverage import OUTSIDE, Coverage, Integers
from eaves.geometry.labelling import label_nodes
from eaves.geometry.neighbours import measure_spacing
from eaves.geometry.simplification import (
    SHORTEST_EDGE,
    absorb_slivers,
    drop_straight_nodes,
    merge_short_edges,
)
from eaves.methods import Emit, ignore, parameter
from eaves.model import BuildingModel, Failure, Footprint, Points, RoofPlane, Solid
from eaves.reconstruct.attributes import describe
from eaves.reconstruct.base import Reconstructor
from eaves.reconstruct.evidence import (
    FEWEST_POINTS,
    LOWEST_ROOF,
    PRISM_PERCENTILE,
    is_roof_point,
    level_unexplained,
    points_inside,
)
from eaves.reconstruct.extrusion import extrude
from eaves.reconstruct.lines import candidate_lines, extend
from eaves.reconstruct.soundness import find_defect

SMALLEST_FACE = 0.3
"""Roof faces smaller than this (m²) go to their neighbour."""

NARROWEST = 0.1
"""Roof faces narrower than this (m), or than half a spacing, go to their neighbour."""

FIRMNESS = (1.0, 2.5, 6.0)
"""Multiples of the shortest edge and the narrowest face, tried in turn until the solid is sound."""

RUNAWAY = 1e3
"""Cost (m²) of a metre beyond the heights a plane's points support: more than any misfit."""


class Arrangement(Reconstructor):
    """to be written"""

    name: ClassVar[str] = "arrangement"
    idea: ClassVar[str] = (
        "Lines cut the footprint into cells; a graph cut gives each its plane; cells are raised."
    )
    paper: ClassVar[str] = "peters2022"

    misfit_limit: float = parameter(
        0.4, "Distance from a plane at which a point's misfit stops growing.", unit="m", gt=0.0
    )
    gross_limit: float = parameter(
        2.0,
        "Distance from a plane at which a point's gross misfit, added to the other, stops growing.",
        unit="m",
        gt=0.0,
    )
    border_price: float = parameter(0.2, "Price of a metre of border, in m2 of misfit.", unit="m", ge=0.0)
    plane_price: float = parameter(0.8, "Price of a plane in use, in m2 of misfit.", unit="m2", ge=0.0)
    extension: float = parameter(1.0, "How far a line reaches beyond its evidence.", unit="m", ge=0.0)
    overshoot: float = parameter(
        0.5, "How far a plane may rise above or fall below its own points.", unit="m", ge=0.0
    )
    reach_beyond: float = parameter(
        1.0, "How far in plan a sloped plane may run beyond its own points.", unit="m", ge=0.0
    )
    narrowest: float = parameter(0.5, "Width of the narrowest roof face, in spacings.", ge=0.0)
    smallest: float = parameter(0.5, "Area of the smallest roof face.", unit="m2", ge=0.0)
    level_jump: float = parameter(
        3.0, "Height difference that makes two levels at LoD 1.3.", unit="m", published=3.0, gt=0.0
    )

    def model(
        self,
        points: Points,
        footprint: Footprint,
        planes: list[RoofPlane],
        ground: float,
        emit: Emit = ignore,
    ) -> BuildingModel | Failure:
        """The model of one building from its points (N, 3) and roof planes."""
        inside = points_inside(points, footprint.polygon)
        top = inside[is_roof_point(points[inside])]
        roof = points[top]
        if len(roof) < FEWEST_POINTS:
            return Failure(
                "too_few_points", f"{len(roof)} roof points inside the footprint", "reconstruct", footprint
            )
        spacing = measure_spacing(roof)
        owner = np.full(len(points), -1, np.int32)
        for number, plane in enumerate(planes):
            owner[plane.members] = number
        labels = owner[top]
        used = np.unique(labels[labels >= 0])
        planes = [planes[number] for number in used]
        labels = np.where(labels >= 0, np.searchsorted(used, labels), -1).astype(np.int32)
        height = max(float(np.percentile(roof[:, 2], PRISM_PERCENTILE)), ground + LOWEST_ROOF)
        labels, levels = level_unexplained(roof, labels, len(planes), spacing)
        coefficients = np.array(
            [
                *(plane.coefficients for plane in planes),
                *((0.0, 0.0, level) for level in levels),
                (0.0, 0.0, height),
            ]
        )
        lines = candidate_lines(roof, labels, coefficients, footprint.polygon, spacing)
        segments = extend(lines, footprint.polygon, self.extension)
        emit("lines", segments)
        coverage = arrange(footprint.polygon, segments)
        if coverage is None:
            return Failure("no_area", "the footprint encloses no area", "reconstruct", footprint)
        cells = self.label_cells(coverage, roof, labels, coefficients, spacing, ground)
        solids: dict[str, tuple[Solid, ...]] = {}
        for firmness in FIRMNESS:
            plan, chosen = tidy(
                *coverage.merged(cells), self.smallest, max(NARROWEST, self.narrowest * spacing), firmness
            )
            found = sound_solids(plan, coefficients[chosen], ground)
            if found:
                solids["2.2"] = found
                break
        emit("plan", plan.polygons())
        for lod, (level_plan, heights) in self.levels(plan, coefficients[chosen], roof, ground).items():
            flat = np.column_stack([np.zeros((len(heights), 2)), heights])
            found = sound_solids(level_plan, flat, ground)
            if found:
                solids[lod] = found
        if not solids:
            return Failure("not_closed", "no level of detail gave a closed solid", "reconstruct", footprint)
        faces = tuple(
            RoofPlane(tuple(coefficients[label]), np.zeros(0, np.int64), 0.0, polygon)
            for label, polygon in zip(chosen, plan.polygons(), strict=True)
        )
        model = BuildingModel(footprint, solids, faces)
        return model.with_(attributes=describe(model, points[inside], roof, ground))

    def label_cells(
        self,
        coverage: Coverage,
        roof: Points,
        labels: NDArray[np.int32],
        planes: NDArray[np.float64],
        spacing: float,
        ground: float,
    ) -> Integers:
        """The plane (C,) of every cell."""
        polygons = coverage.polygons()
        point, cell = shapely.STRtree(polygons).query(shapely.points(roof[:, :2]), predicate="intersects")
        rise = roof[:, :2] @ planes[:, :2].T + planes[:, 2]
        misfit = np.abs(roof[:, 2:] - rise) / np.sqrt(1.0 + (planes[:, :2] ** 2).sum(axis=1))
        cost = np.minimum(misfit / self.misfit_limit, 1.0) + np.minimum(misfit / self.gross_limit, 1.0)
        cost *= spacing**2
        data = np.zeros((coverage.count, len(planes)))
        np.add.at(data, cell, cost[point])
        data += RUNAWAY * self.beyond_support(coverage, roof, labels, planes, ground)
        data[:, -1] += 0.3 * coverage.area + 1e-6
        halves = np.flatnonzero((coverage.cell >= 0) & (coverage.cell[coverage.twin] > coverage.cell))
        edges = np.column_stack([coverage.cell[halves], coverage.cell[coverage.twin[halves]]])
        return label_nodes(
            data, edges, self.border_price * coverage.length[halves], np.full(len(planes), self.plane_price)
        )

    def beyond_support(
        self,
        coverage: Coverage,
        roof: Points,
        labels: NDArray[np.int32],
        planes: NDArray[np.float64],
        ground: float,
    ) -> NDArray[np.float64]:
        """How far (C, P; m) each plane leaves the heights of its own points over each cell."""
        low, high = np.full(len(planes), -np.inf), np.full(len(planes), np.inf)
        steepness = np.hypot(planes[:, 0], planes[:, 1])
        for number in range(len(planes) - 1):
            z = roof[labels == number, 2]
            low[number], high[number] = np.percentile(z, [1.0, 99.0])
        margin = self.overshoot + self.reach_beyond * steepness
        inner = coverage.cell != OUTSIDE
        z = coverage.nodes[coverage.start[inner]] @ planes[:, :2].T + planes[:, 2]
        floor = np.maximum(low - margin, ground + LOWEST_ROOF)
        beyond = np.maximum(np.maximum(floor - z, z - high - margin), 0.0)
        worst = np.zeros((coverage.count, len(planes)))
        np.maximum.at(worst, coverage.cell[inner], beyond)
        return worst

    def levels(
        self, plan: Coverage, planes: NDArray[np.float64], roof: Points, ground: float
    ) -> dict[str, tuple[Coverage, NDArray[np.float64]]]:
        """The plans of LoD 1.3 and 1.2, with the height of each cell."""
        polygons = plan.polygons()
        point, cell = shapely.STRtree(polygons).query(shapely.points(roof[:, :2]), predicate="intersects")
        whole = float(np.percentile(roof[:, 2], PRISM_PERCENTILE))
        middle = np.array(
            [
                whole
                if not (cell == c).any()
                else float(np.percentile(roof[point[cell == c], 2], PRISM_PERCENTILE))
                for c in range(plan.count)
            ]
        )
        group = np.arange(plan.count)
        halves = np.flatnonzero((plan.cell >= 0) & (plan.cell[plan.twin] > plan.cell))
        for half in halves.tolist():
            a, b = int(plan.cell[half]), int(plan.cell[plan.twin[half]])
            if abs(middle[a] - middle[b]) < self.level_jump:
                group[group == group[b]] = group[a]
        answer = {}
        for lod, label in (("1.3", group), ("1.2", np.zeros(plan.count, np.int64))):
            merged, names = plan.merged(np.unique(label, return_inverse=True)[1].astype(np.int64))
            number = np.unique(label, return_inverse=True)[1]
            heights = []
            for name in names:
                mine = np.isin(cell, np.flatnonzero(number == name))
                heights.append(
                    float(np.percentile(roof[point[mine], 2], PRISM_PERCENTILE)) if mine.any() else whole
                )
            answer[lod] = (merged, np.maximum(heights, ground + LOWEST_ROOF))
        return answer


def sound_solids(plan: Coverage, planes: NDArray[np.float64], ground: float) -> tuple[Solid, ...]:
    """The solids over a plan, or none when one has a defect."""
    solids = extrude(plan, planes, ground)
    if solids is None or any(find_defect(solid) for solid in solids):
        return ()
    return tuple(solids)


def tidy(
    plan: Coverage, chosen: Integers, smallest: float, narrowest: float, firmness: float = 1.0
) -> tuple[Coverage, Integers]:
    """The plan without slivers, short edges and needless nodes, and the plane (C,) of each of its cells."""
    narrowest = firmness * narrowest
    plan, chosen = absorb_slivers(plan, chosen, smallest, narrowest)
    plan, chosen = drop_straight_nodes(plan, chosen)
    plan, chosen = merge_short_edges(plan, chosen, firmness * SHORTEST_EDGE)
    plan, chosen = plan.merged(chosen)
    plan, chosen = absorb_slivers(plan, chosen, smallest, narrowest)
    return drop_straight_nodes(plan, chosen)
