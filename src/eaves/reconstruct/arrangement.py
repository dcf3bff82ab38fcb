"""The default reconstructor: a plan of lines, labelled at least cost, raised to solids."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

from eaves.figures.attributes import (
    NEAR_M,
    Surface,
    describe_roof,
    surface_heights,
)
from eaves.geometry.inside import members_kernel, points_in_polygons
from eaves.kernels import kernel
from eaves.methods import Emit, ignore, parameter
from eaves.model import (
    BuildingModel,
    Failure,
    Footprint,
    Integers,
    Labels,
    Points,
    RoofPlane,
    Solid,
    Values,
)
from eaves.reconstruct.stage import BlockPart
from eaves.reconstruct.toolkit.block_plan import BlockPlan, divide_plan, outline_around, points_near
from eaves.reconstruct.toolkit.ceiling import height_over_points, highest_of, reach_of
from eaves.reconstruct.toolkit.cell_labels import (
    LabelCosts,
    PlaneReach,
    cell_costs,
    label_cells,
    plane_reach,
)
from eaves.reconstruct.toolkit.evidence import (
    faces_as_planes,
    planes_of_regions,
    seen_roof,
    spacing_on_roof,
    support_of,
)
from eaves.reconstruct.toolkit.levels import coarse_solids
from eaves.reconstruct.toolkit.plan_lines import candidate_lines, extend
from eaves.reconstruct.toolkit.superstructures import ObjectLimits, find_superstructures
from eaves.reconstruct.toolkit.unseen import mirrored_planes, unseen_lines, unseen_places
from eaves.solids.coverage import OUTSIDE, Coverage, corner_rank_kernel
from eaves.solids.cutting import arrange
from eaves.solids.extrude import (
    LOWEST_ROOF,
    extrude_first,
    extrude_plan,
    is_sound,
    make_moves,
    part_rims_kernel,
    without_numbers,
)
from eaves.solids.soundness import LOWEST_WALL

PASSES = 8
"""Passes over the plan, in each of which moves that do not touch one another are made together; more of them
wear sound corners away."""

CLEARLY = 1e-6
"""Rise (m) that is more than rounding."""

MOST_HEIGHTS = 64
"""Half-edges of two neighbouring nodes, at most, for one of them to move into the other."""


def settle_corners(
    coverage: Coverage,
    labels: Integers,
    roof: Points,
    planes: Values,
    costs: LabelCosts,
    price: float,
    reach: float,
    part: Integers,
    highest: Values | None = None,
) -> tuple[Coverage, Integers]:
    """The coverage without the corners that explain less than `price` points each, and its labels (C,).

    A node moves into a neighbour nearer than `reach` (m), or goes where its two edges are within it of one
    line, when that costs the points (N, 3) that get another of the `planes` (P, 3) less than the corners it
    saves:

        Σ_points [c(d of the new plane) − c(d of the old)] < price · corners,  c(d) = min((d/τ)², 1) + d/τ,

    d the distance, τ the limit of residuals, as for the labels. A step of
    metres is never given up for a few corners, as the distance counts in full. Corners are those of the
    solids: one for each height over a node. Corners of the outline, and of walls between labels of one `part`
    (L,) and another, stay, other nodes on them move along them. No
    plane is carried over the `highest` (P,) that it may be, nor over what meets there already.
    """
    highest = np.full(len(planes), np.inf) if highest is None else highest
    for careful in (False, True):
        refused: set[tuple[float, ...]] = set()
        plan, plan_labels = coverage, labels
        for _ in range(PASSES):
            of_part = part[plan_labels]
            pairs = worthwhile_moves(plan, plan_labels, of_part, roof, planes, costs, price, reach, highest)
            moved = make_moves(plan, plan_labels, pairs, refused, careful) if len(pairs) else None
            if moved is None:
                break
            plan, plan_labels = moved
        if plan is coverage or careful or is_sound(plan):
            return plan, plan_labels
    return coverage, labels


def worthwhile_moves(
    coverage: Coverage,
    labels: Integers,
    part: Integers,
    roof: Points,
    planes: Values,
    costs: LabelCosts,
    price: float,
    reach: float,
    highest: Values,
) -> Integers:
    """Pairs (K, 2) of a node and the neighbour it should move into, the best first; of cells of one `part`
    (C,) and another the walls stay."""
    half_edges = (coverage.nodes, coverage.start, coverage.end, coverage.cell, *coverage.neighbours)
    node, into, saved, triangles, move, gets, has = moves_kernel(
        *half_edges, labels, planes, part, reach, highest
    )
    gain = price * saved
    if len(triangles):
        ends = triangles[:, [1, 2, 0]].reshape(-1, 2)
        owner = np.repeat(np.arange(len(triangles)), 3)
        point, swept = points_in_polygons(roof, triangles.reshape(-1, 2), ends, owner, len(triangles))
        gain -= changes_kernel(roof, point, swept, planes, gets, has, move, len(node), costs.residual_limit)
    order = np.argsort(-gain, kind="stable")
    return np.asarray(np.column_stack([node, into])[order[gain[order] > 0.0]])


@kernel
def changes_kernel(
    points: Points,
    point: Integers,
    swept: Integers,
    planes: Values,
    gets: Integers,
    has: Integers,
    move: Integers,
    count: int,
    residual_limit: float,
) -> Values:
    """The cost of each of `count` moves to the points (N, 3) that it sweeps: pairs of `point` (K,) and
    triangle `swept` (K,), with the plane that its points get, the one they have, and the move it belongs to
    (T,)."""
    total = np.zeros(count)
    for pair in range(len(point)):
        x, y, z = points[point[pair]]
        change = 0.0
        for side in range(2):
            a, b, c = planes[gets[swept[pair]] if side == 0 else has[swept[pair]]]
            away = abs(z - a * x - b * y - c) / np.sqrt(1.0 + a * a + b * b)
            share = away / residual_limit
            cost = min(share * share, 1.0) + share
            change = cost if side == 0 else change - cost
        total[move[swept[pair]]] += change
    return total


@kernel
def moves_kernel(
    nodes: Values,
    start: Integers,
    end: Integers,
    cell: Integers,
    twin: Integers,
    following: Integers,
    labels: Integers,
    planes: Values,
    part: Integers,
    reach: float,
    highest: Values,
) -> tuple[Integers, Integers, Values, Values, Integers, Integers, Integers]:
    """Nodes (K,), the neighbours (K,) they could move into, the corners (K,) that saves, and what their edges
    sweep: triangles (T, 3, 2), the move of each, the label its points get, and the one they have, (T,).

    A point swept by several edges goes from cell to cell, so that the changes add up. `labels` (C,) of the
    `planes` (P, 3), `part` (C,) of the cells; `highest` (P,) as in `settle_corners`.
    """
    leaving, first = members_kernel(start, len(nodes))
    is_rim = part_rims_kernel(cell, twin, part)
    rank = corner_rank_kernel(nodes, start, end, is_rim)
    moves, swept = 0, 0
    node, into, saved = np.empty(len(start), np.int64), np.empty(len(start), np.int64), np.empty(len(start))
    room = 8 * len(start)
    triangles, move = np.empty((room, 3, 2)), np.empty(room, np.int64)
    gets, has = np.empty(room, np.int64), np.empty(room, np.int64)
    heights = np.empty(MOST_HEIGHTS)
    for half in range(len(start)):
        v, w = start[half], end[half]
        if rank[v] == 2 or rank[v] > rank[w]:
            continue
        if rank[v] == 1 and not is_rim[half]:
            continue
        at_v, at_w = leaving[first[v] : first[v + 1]], leaving[first[w] : first[w + 1]]
        if len(at_v) + len(at_w) > MOST_HEIGHTS or swept + len(at_v) > room:
            continue
        dx, dy = nodes[w, 0] - nodes[v, 0], nodes[w, 1] - nodes[v, 1]
        close = np.hypot(dx, dy) < reach
        if not close and len(at_v) == 2 and rank[v] == 0:
            neighbour = end[at_v[0]] if at_v[1] == half else end[at_v[1]]
            ex, ey = nodes[neighbour, 0] - nodes[v, 0], nodes[neighbour, 1] - nodes[v, 1]
            chord = np.hypot(ex - dx, ey - dy)
            close = abs(dx * ey - dy * ex) < reach * chord
        if not close:
            continue
        closed_left, closed_right = OUTSIDE, OUTSIDE
        if end[following[following[half]]] == v:
            closed_left = cell[half]
        if end[following[following[twin[half]]]] == w:
            closed_right = cell[twin[half]]
        before, count = 0, 0
        for place in range(2):
            fan, at = (at_v, v) if place == 0 else (at_w, w)
            count = 0
            for spoke in fan:
                if cell[spoke] != OUTSIDE:
                    a, b, c = planes[labels[cell[spoke]]]
                    heights[count] = a * nodes[at, 0] + b * nodes[at, 1] + c
                    count += 1
            before += corners_kernel(heights, count)
        met = np.max(heights[:count]) if count else -np.inf
        count, rises = 0, False
        for fan in (at_v, at_w):
            for spoke in fan:
                owner = cell[spoke]
                if owner != OUTSIDE and owner != closed_left and owner != closed_right:
                    a, b, c = planes[labels[owner]]
                    heights[count] = a * nodes[w, 0] + b * nodes[w, 1] + c
                    rises |= heights[count] > max(highest[labels[owner]], met + CLEARLY)
                    count += 1
        fewer = before - corners_kernel(heights, count)
        if fewer <= 0 or rises:
            continue
        node[moves], into[moves], saved[moves] = v, w, fewer
        for edge in at_v:
            left, right, far = cell[edge], cell[twin[edge]], end[edge]
            turn = dx * (nodes[far, 1] - nodes[v, 1]) - dy * (nodes[far, 0] - nodes[v, 0])
            if far == w or left == OUTSIDE or right == OUTSIDE or abs(turn) < 1e-9:
                continue
            triangles[swept, 0], triangles[swept, 1], triangles[swept, 2] = nodes[v], nodes[w], nodes[far]
            move[swept] = moves
            gets[swept] = labels[left] if turn > 0.0 else labels[right]
            has[swept] = labels[right] if turn > 0.0 else labels[left]
            swept += 1
        moves += 1
    return (
        node[:moves],
        into[:moves],
        saved[:moves],
        triangles[:swept],
        move[:swept],
        gets[:swept],
        has[:swept],
    )


@kernel
def corners_kernel(heights: Values, count: int) -> int:
    """Number of corners that the first `count` of the heights (m) over one node make: one for all between
    which no wall is high enough.
    """
    ordered = np.sort(heights[:count])
    corners = 1 if count > 0 else 0
    for k in range(1, count):
        corners += ordered[k] - ordered[k - 1] > LOWEST_WALL
    return corners


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

    The houses of a block have one plan. It is labelled as if no walls were there, so a plane runs through a
    terrace; then party walls cut it. A piece keeps its plane where that saves its points the price
    γ. The block is tidied at once, and each house raised from its part, so neighbours share the corners of
    their walls. A house whose part is not closed, or rises over its points, is drawn by itself.

    Formula
    -------
    min Σ_cells Σ_points a² [min((d/τ)², 1) + min(d/g, 1)] + β Σ_borders length · s(jump) + 2γ · faces,

    d the distance of a roof point from the cell's plane, a the spacing, β, γ the prices, g a limit, τ = T σ
    another, σ the scatter of the points about their planes: what the scan does not tell apart costs little. s
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
    are filled to the ground. Codes: `too_few_points`, `no_area`, `not_closed`; `no_plane`, `poor_fit`,
    `over_points` and `not_closed` as the reason of a fallback; `base_too_high` where the base leaves no room
    for the roof.

    Complexity
    ----------
    O(N log N) in points; lines are at most six a plane, so cells are bounded; each round of moves is linear
    in cells times planes.

    References
    ----------
    [peters2022].
    """

    name: ClassVar[str] = "arrangement"
    draws_blocks: ClassVar[bool] = True
    idea: ClassVar[str] = (
        "Lines cut the footprint into cells; each gets the plane that costs least; the plan is raised."
    )
    paper: ClassVar[str] = "peters2022"

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
        plan = self.draw(points, [footprint.polygon], planes, ground, emit)
        if isinstance(plan, Failure):
            return replace(plan, footprint=footprint)
        return self.raise_part(BlockPart(plan, 0, planes), points, footprint, ground, emit)

    def draw(
        self,
        points: Points,
        parts: Sequence[Polygon],
        planes: list[RoofPlane],
        ground: float,
        emit: Emit = ignore,
    ) -> BlockPlan | Failure:
        """The plan of a block with its parts, from its points (N, 3) and roof planes."""
        footprint = Footprint(parts[0] if len(parts) == 1 else outline_around(parts))
        seen_points = seen_roof(points, footprint)
        if isinstance(seen_points, Failure):
            return seen_points
        _, top = seen_points
        roof = points[top]
        spacing = spacing_on_roof(roof, footprint.polygon)
        labels, coefficients = support_of(points, top, planes, spacing, ground, self)
        unseen = unseen_places(footprint.polygon, roof, spacing)
        highest = highest_of(roof, labels, coefficients, self.residual_limit)
        mirrored = mirrored_planes(unseen, roof, labels, coefficients, highest)
        coefficients = np.insert(coefficients, -1, mirrored, axis=0)
        cells = self.cells(footprint, roof, labels, coefficients, spacing, ground, unseen, ignore)
        if cells is None:
            return Failure("no_area", "the footprint encloses no area wider than 3 cm", self.stage, footprint)
        plan, reach, located, data = cells
        chosen = label_cells(plan, reach, self, data)
        region, first = plan.regions(chosen)
        of_regions = np.vstack([coefficients[chosen[first]], coefficients[-1:]])
        fitted = planes_of_regions(roof, located, region, of_regions, 0.5 * self.residual_limit)
        cells = self.cells(footprint, roof, *fitted, spacing, ground, unseen, emit)
        if cells is not None:
            (plan, reach, _, data), coefficients = cells, fitted[1]
        merged = plan.merged(label_cells(plan, reach, self, data))
        near = [points_near(roof, outline, reach_of(spacing)) for outline in parts]
        whole, of_label, part, highest = divide_plan(*merged, reach, self, parts, near)
        price, limit = self.plane_points, self.residual_limit
        settled = settle_corners(*whole, roof, of_label, self, price, limit, part, highest)
        shown = [roof[points] for points in near]
        return BlockPlan((settled, whole), shown, of_label, part, spacing, self.smallest)

    def raise_part(
        self,
        part: BlockPart,
        points: Points,
        footprint: Footprint,
        ground: float,
        emit: Emit = ignore,
    ) -> BuildingModel | Failure:
        """The model of one part of a block over its base (m), from its own points (N, 3)."""
        block, planes = part.block, part.planes
        assert isinstance(block, BlockPlan)
        seen_points = seen_roof(points, footprint)
        if isinstance(seen_points, Failure):
            return seen_points
        inside, top = seen_points
        roof, coefficients = points[top], block.planes
        shown = block.shown[part.number]
        for draft, tidied in block.of_part(part.number):
            plan, chosen = draft
            fine = extrude_first(tidied, coefficients, ground)
            over = height_over_points(fine.solids, shown) if fine.solids else 0.0
            if fine.solids and not over:
                break  # else corners that moved are in each other's way
        if len(block.shown) > 1 and (over or not fine.solids):
            return self.model(points, footprint, planes, ground, emit)
        if emit is not ignore:
            emit("plan", plan.polygons())
        emit("plane of each cell", chosen)
        solids = coarse_solids(plan, roof, ground, self.level_jump, self.smallest)
        shares: dict[str, float] = {}
        for lod, parts in solids.items():
            alike = lod != "1.2" and parts is solids.get("1.2")
            shares[lod] = shares["1.2"] if alike else share_near(parts, roof)
        if planes and plan.count > 1:
            smallest = min(self.simple_smallest, self.simple_share * float(plan.area.sum()))
            simple = without_numbers(extrude_plan(plan, chosen, coefficients, ground, smallest).solids)
            share = share_near(simple, roof)
            sound = simple and not height_over_points(simple, shown)
            if sound and not self.compare("2.0", share, shares):
                solids["2.0"], shares["2.0"] = simple, share
        fallback: dict[str, Any] = {}
        surface: Surface | None = None
        if not planes:
            fallback = fallen_back("no_plane", "no roof plane was found among the points")
        elif not fine.solids:
            fallback = fallen_back("not_closed", f"LoD 2.2 has {fine.defect}")
        elif over:
            fallback = fallen_back("over_points", f"LoD 2.2 rises {over:.1f} m over its highest point")
        else:
            surface = surface_heights(fine.solids, roof[:, :2])
            fallback = self.compare("2.2", share_near(fine.solids, roof, surface), shares)
        if not fallback:
            solids["2.2"] = fine.solids
            solids.setdefault("2.0", without_numbers(fine.solids))
        else:
            surface = None
        if not solids:
            return Failure(
                "not_closed", f"no level gave a closed solid: {fine.defect}", self.stage, footprint
            )
        fine_planes = coefficients[fine.labels] if "2.2" in solids else np.zeros((0, 3))
        model = BuildingModel(footprint, solids)
        model = model.with_(planes=faces_as_planes(model, fine_planes, points, top, surface))
        facts = describe_roof(model, points[inside], roof, ground, surface)
        if "2.2" in solids:
            facts["surfaces"] = facts["roof_faces"]
            objects = find_superstructures(
                solids["2.2"],
                roof,
                surface,
                footprint.polygon,
                block.spacing,
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
        unseen: Values,
        emit: Emit,
    ) -> tuple[Coverage, PlaneReach, tuple[Integers, Integers], Values] | None:
        """The plan of the lines of planes (P, 3) with `labels` (N,) of the roof points (N, 3), where the
        planes may be, the points with the cells they lie in, and what each plane costs each cell (C, P); None
        for a footprint without an area. No point shows the `unseen` places (K, 2)."""
        plan = self.cut(footprint, roof, labels, planes, spacing, unseen, emit)
        if plan is None:
            return None
        reach = plane_reach(roof, labels, planes, spacing, ground, self)
        located = plan.cells_of(roof)
        return plan, reach, located, cell_costs(plan, reach, self, located)

    def cut(
        self,
        footprint: Footprint,
        roof: Points,
        labels: Labels,
        planes: NDArray[np.float64],
        spacing: float,
        unseen: Values,
        emit: Emit,
    ) -> Coverage | None:
        """The cells the candidate lines cut the footprint into; the footprint alone when they cannot be
        rounded.
        """
        lines = candidate_lines(roof, labels, planes, footprint.polygon, spacing, self)
        lines += unseen_lines(unseen, labels, planes, spacing)
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
        for rival, its in sorted(coarser.items(), reverse=True):
            if share < its - self.worse_by:
                reason = f"{share:.0%} of the points within {NEAR_M} m at LoD {lod}, {its:.0%} at LoD {rival}"
                return fallen_back("poor_fit", reason)
        return {}


def share_near(solids: tuple[Solid, ...], roof: Points, surface: Surface | None = None) -> float:
    """Share of the roof points (N, 3) that lie near the roof; `surface` is that over them where known."""
    height, cosine, _ = surface or surface_heights(solids, roof[:, :2])
    return float(np.mean(~(np.abs(roof[:, 2] - height) * cosine > NEAR_M)))


def fallen_back(code: str, reason: str) -> dict[str, Any]:
    """The attributes of a building that does not reach LoD 2.2."""
    return {"fallback_code": code, "fallback_reason": reason}
