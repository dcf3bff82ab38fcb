"""The default reconstructor: a plan of lines, labelled at least cost, raised to solids."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from eaves.figures.attributes import (
    NEAR_M,
    Surface,
    describe_roof,
    surface_heights,
)
from eaves.methods import Emit, ignore, parameter
from eaves.model import BuildingModel, Failure, Footprint, Labels, Points, RoofPlane, Solid, Values
from eaves.reconstruct.toolkit.cell_labels import LARGEST, PlaneReach, cell_costs, label_cells, plane_reach
from eaves.reconstruct.toolkit.corner_prices import settle_corners
from eaves.reconstruct.toolkit.evidence import (
    faces_as_planes,
    planes_of_regions,
    seen_roof,
    spacing_on_roof,
    support_of,
)
from eaves.reconstruct.toolkit.levels import coarse_solids
from eaves.reconstruct.toolkit.plan_lines import candidate_lines, extend
from eaves.reconstruct.toolkit.superstructures import ObjectLimits, find_leaf_towers, find_superstructures
from eaves.solids.coverage import Coverage
from eaves.solids.cutting import arrange
from eaves.solids.extrude import LOWEST_ROOF, extrude_plan, without_numbers
from eaves.solids.half_edges import MOST_ROUNDS, Integers


class Arrangement(ObjectLimits):
    """The solids at LoD 1.2, 1.3, 2.0 and 2.2 from one plan.

    Lines cut the footprint into cells: where two roof planes meet, where heights jump between the points
    of two planes, the sides of the rectangle around each plane, and the footprint itself; each is lengthened
    to the next, so that it cuts. All is rounded to a 1 mm grid by snap rounding, which keeps the plan a plan.
    Every cell gets the plane that fits its points, at a cost for each metre of border, most where heights
    jump, and for each face. Then each face's plane is fitted to the points in it, and lines, cells and labels
    are made once more of these planes. Cells with one plane are merged, slivers and short edges go, and the
    plan is raised with vertices that all faces share. The coarser levels merge the same cells further:
    LoD 2.0 gives small faces to their neighbours, 1.3 and 1.2 level them.

    Formula
    -------
    min Σ_cells Σ_points a² [min((d/τ)², 1) + min(d/g, 1)] + β Σ_borders length · s(jump) + 2γ · faces,

    d the distance of a roof point from the cell's plane, a the spacing, τ, g the limits, β, γ the prices; s
    grows with the height of the jump from 0.2 where the planes meet to 1 where they are half a metre apart. γ
    counts in points: what a part must show to be worth its description is a number of points, not an area; a
    face is a plane and where it lies. Cells choose in the order of what it matters to them, then cells and
    faces move to what is cheaper for them. A corner then stays where it is only
    when its moving into the next one, or onto the line between its neighbours, would cost the points more
    than `plane_points` for each corner that saves.

    Fidelity
    --------
    Own method, on ideas of the 3DBAG's [peters2022]: lines, arrangement, labels of least
    cost, extrusion; its 3 m jump for LoD 1.3 and its 70th percentile are kept. Regularisation, the support
    rule, rectangles, levels for clutter, and the shared columns are ours.

    Fails where
    -----------
    Curved roofs become facets: on exact vaults, domes, cones and stands 95 % of the roof lies within
    0.12 m of them (`benchmarks/accuracy/curved`). A roof part smaller than a few points, or narrower than
    half a spacing, is not seen. An object on the roof needs `superstructure_points` points that rise by
    `residual_limit`: at ρ points/m² that is 8/ρ m², which chance leaves to one in two; nine of ten
    are found over about 15/ρ m² (1.5 m² at 10/m², 0.5 m² at 30/m², 0.25 m² at 60/m²). Overhangs and passages
    are filled to the ground. Codes: `too_few_points`, `no_area`, `not_closed`; `no_plane`, `poor_fit` and
    `not_closed` as the reason of a fallback; `base_too_high` where the base leaves no room for the roof.

    Complexity
    ----------
    O(N log N) in points; lines are at most six a plane, so cells are bounded; each round of moves is linear
    in cells times planes.

    References
    ----------
    [peters2022].
    """

    name: ClassVar[str] = "arrangement"
    idea: ClassVar[str] = (
        "Lines cut the footprint into cells; each gets the plane that costs least; the plan is raised."
    )
    paper: ClassVar[str] = "peters2022"

    farthest: float = parameter(
        5.0,
        "Largest distance from the rectangle around a plane's points of a cell that can get that plane.",
        unit="m",
        ge=0.0,
    )
    simple_smallest: float = parameter(
        10.0,
        "Area of the smallest roof face at LoD 2.0.",
        unit="m2",
        ge=0.0,
    )
    simple_share: float = parameter(
        0.125,
        "The same is at most this share of the footprint, so that a shed keeps both its slopes.",
        ge=0.0,
        le=1.0,
    )
    worse_by: float = parameter(
        0.05,
        "A finer level is given up when a coarser one has a share of the roof points near it that is greater "
        "by more than this; where as large a share lies under the lowest roof a base allows, the model says "
        "so.",
        ge=0.0,
        le=1.0,
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
        seen = seen_roof(points, footprint)
        if isinstance(seen, Failure):
            return seen
        inside, top = seen
        roof = points[top]
        spacing = spacing_on_roof(roof, footprint.polygon)
        labels, coefficients = support_of(points, top, planes, spacing, ground, self)
        cells = self.cells(footprint, roof, labels, coefficients, spacing, ground, ignore)
        if cells is None:
            return Failure("no_area", "the footprint encloses no area wider than 3 cm", self.stage, footprint)
        plan, reach, located, data = cells
        chosen = label_cells(plan, reach, self, data)
        region, first = plan.regions(chosen)
        of_regions = np.vstack([coefficients[chosen[first]], coefficients[-1:]])
        fitted = planes_of_regions(roof, located, region, of_regions, 0.5 * self.residual_limit)
        cells = self.cells(footprint, roof, *fitted, spacing, ground, emit)
        if cells is not None:
            (plan, reach, located, data), coefficients = cells, fitted[1]
        for _ in range(MOST_ROUNDS):
            chosen = label_cells(plan, reach, self, data)
            merged, names = plan.merged(chosen)
            towers = find_leaf_towers(merged, names, coefficients, points[inside], spacing, self)
            leafy = np.flatnonzero(towers[plan.regions(chosen)[0]])
            if len(leafy) == 0:
                break
            data[leafy, chosen[leafy]] = LARGEST
        located = plan.cells_merged(chosen, located)
        chosen = names
        plan, chosen = settle_corners(
            merged,
            chosen,
            roof,
            coefficients,
            self,
            self.plane_points,
            self.residual_limit,
        )
        if plan is not merged:
            located = plan.cells_of(roof)
        if emit is not ignore:
            emit("plan", plan.polygons())
        emit("plane of each cell", chosen)
        known = (plan, chosen, coefficients, ground)
        fine = extrude_plan(*known, self.smallest)
        solids = coarse_solids(plan, roof, ground, self.level_jump, self.smallest, located)
        near: dict[str, float] = {}
        for lod, parts in solids.items():
            alike = lod != "1.2" and parts is solids.get("1.2")
            near[lod] = near["1.2"] if alike else share_near(parts, roof)
        if planes and plan.count > 1:
            smallest = min(self.simple_smallest, self.simple_share * float(plan.area.sum()))
            simple = without_numbers(extrude_plan(*known, smallest).solids)
            share = share_near(simple, roof)
            if simple and not self.compare("2.0", share, near):
                solids["2.0"], near["2.0"] = simple, share
        fallback: dict[str, Any] = {}
        surface: Surface | None = None
        if not planes:
            fallback = fallen_back("no_plane", "no roof plane was found among the points")
        elif not fine.solids:
            fallback = fallen_back("not_closed", f"LoD 2.2 has {fine.defect}")
        else:
            surface = surface_heights(fine.solids, roof[:, :2])
            fallback = self.compare("2.2", share_near(fine.solids, roof, surface), near)
        if not fallback:
            solids["2.2"] = fine.solids
            solids.setdefault("2.0", without_numbers(fine.solids))
        else:
            surface = None
        if not solids:
            return Failure(
                "not_closed", f"no level gave a closed solid: {fine.defect}", self.stage, footprint
            )
        kept = coefficients[fine.labels] if "2.2" in solids else np.zeros((0, 3))
        model = BuildingModel(footprint, solids)
        model = model.with_(planes=faces_as_planes(model, kept, points, top, surface))
        facts = describe_roof(model, points[inside], roof, ground, surface)
        if "2.2" in solids:
            facts["surfaces"] = facts["roof_faces"]
            objects = find_superstructures(
                solids["2.2"],
                roof,
                surface,
                footprint.polygon,
                spacing,
                self,
            )
            facts["installation_count"] = len(objects)
            model = model.with_(installations=objects)
        return model.with_(attributes={**facts, **(self.flattened(roof, ground) or fallback)})

    def cells(
        self,
        footprint: Footprint,
        roof: Points,
        labels: Labels,
        planes: Values,
        spacing: float,
        ground: float,
        emit: Emit,
    ) -> tuple[Coverage, PlaneReach, tuple[Integers, Integers], Values] | None:
        """The plan of the lines of planes (P, 3) with `labels` (N,) of the roof points (N, 3), where the
        planes may be, the points with the cells they lie in, and what each plane costs each cell (C, P); None
        for a footprint without an area."""
        plan = self.cut(footprint, roof, labels, planes, spacing, emit)
        if plan is None:
            return None
        reach = plane_reach(roof, labels, planes, spacing, ground, self.farthest)
        located = plan.cells_of(roof)
        return plan, reach, located, cell_costs(plan, reach, self, located)

    def cut(
        self,
        footprint: Footprint,
        roof: Points,
        labels: Labels,
        planes: NDArray[np.float64],
        spacing: float,
        emit: Emit,
    ) -> Coverage | None:
        """The cells the candidate lines cut the footprint into; the footprint alone when they cannot be
        rounded.
        """
        lines = candidate_lines(roof, labels, planes, footprint.polygon, spacing, self)
        segments = extend(lines, footprint.polygon, self.extension)
        emit("lines", segments)
        plan = arrange(footprint.polygon, segments)
        return plan if plan is not None else arrange(footprint.polygon, np.zeros((0, 4)))

    def flattened(self, roof: Points, ground: float) -> dict[str, Any]:
        """Why a base (m) so near to the roof points (N, 3) leaves no room for the roof; empty if it does."""
        under = float(np.mean(roof[:, 2] < ground + LOWEST_ROOF))
        if under <= self.worse_by:
            return {}
        return fallen_back("base_too_high", f"{under:.0%} of the roof lie under the base or on it")

    def compare(self, lod: str, share: float, coarser: dict[str, float]) -> dict[str, Any]:
        """Why a level with a share of the points near it is given up for one of those `coarser`, as
        attributes; empty if not.
        """
        for other, its in sorted(coarser.items(), reverse=True):
            if share < its - self.worse_by:
                found = f"{share:.0%} of the points within {NEAR_M} m at LoD {lod}, {its:.0%} at LoD {other}"
                return fallen_back("poor_fit", found)
        return {}


def share_near(solids: tuple[Solid, ...], roof: Points, surface: Surface | None = None) -> float:
    """Share of the roof points (N, 3) that lie near the roof; `surface` is that over them where known."""
    height, cosine, _ = surface or surface_heights(solids, roof[:, :2])
    return float(np.mean(~(np.abs(roof[:, 2] - height) * cosine > NEAR_M)))


def fallen_back(code: str, reason: str) -> dict[str, Any]:
    """The attributes of a building that does not reach LoD 2.2."""
    return {"fallback_code": code, "fallback_reason": reason}
