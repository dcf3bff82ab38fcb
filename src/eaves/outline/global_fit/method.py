"""The default outliner: one global fit of few edges to the boundary of the points."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from shapely import Polygon

from eaves.geometry.rings import as_polygon, share_edges, signed_area
from eaves.kernels import kernel
from eaves.methods import Emit, ignore, parameter
from eaves.model import Boundary, Failure, Labels, Mask, Points, Values
from eaves.outline.global_fit import circle as circles
from eaves.outline.global_fit.low_parts import LowPartRules, low_parts
from eaves.outline.stage import MIN_POINTS, OutlineMethod
from eaves.outline.toolkit.alpha import (
    SHARE,
    Mesh,
    alpha_parts,
    traced_rings,
    triangulate_points,
    wide_radius,
)
from eaves.outline.toolkit.corners import Drawing, edge_lengths, ends_of_edges, joined_edges, ring_of_edges
from eaves.outline.toolkit.edges import (
    RIGHT_ANGLE,
    OutlineEdges,
    common_axes,
    edge_shift_kernel,
    fit_edges,
    turned_freely,
)
from eaves.outline.toolkit.polyline import Prices, cheapest_polyline, travel_angles

TRIES = 4
"""Times that an outline is drawn, each without the hidden points that the last left outside, at last none."""


class GlobalFit(LowPartRules, OutlineMethod):
    """The closed polyline of least cost through the boundary of the points.

    The alpha shape with a small disc gives the boundary points in order. Of all closed polylines along them
    the cheapest is taken, whose sides follow few directions: half the squared distance of every point to its
    side, in units of its scatter, plus a price for every corner, for a side that does not follow the frame
    of most, and for a point that no side explains. A point with something higher and no ground beside it
    counts less: a crown may hide the rest of the roof. So do points closer than half a metre: a branch or a
    gutter moves them all alike, and in a dense scan its bumps would pay for corners. The first pass has
    directions all around to choose from; those of its sides, joined to right-angled frames where they agree,
    are those of the second. So right angles appear unless the points pay for another one, a rounded or hidden
    corner is drawn where its sides meet, and a spike is left out. Jogs below `detail` go. At last every edge
    moves to where the points behind it end, which corrects the half spacing that points stay inside.

    Formula
    -------
    The cost of a polyline with corners of turn τ, F sides off the first frame and strays, which are points
    on no side, is

        Σ_points w d² / 2σ² + Σ_corners corner / |sin τ| + direction · F + stray · Σ_strays w,
        w = min(1, step / `least_beside`), times `hidden` for points that a crown may hide,
        σ² = (scatter · spacing)² + blur²

    and an edge stands before the k-th point of its strip by the mean distance from a random place to the
    k-th point after it, for k = 1 with gaps g between the points' depths Σ g² / 2 Σ g: 1/density for random
    points, half the distance of scan lines that run along the edge.

    Fidelity
    --------
    The polyline is the optimal polygonal approximation of [perez_vidal1994] with a price per
    corner in place of a number of edges; that a shared direction costs less follows the description length of
    [jung2017]; the mean distance ahead is the forward recurrence time of [cox1962]. The combination, and the
    points on no side, are ours. So is the circle: the one of least squares through the boundary [kasa1976] is
    drawn, as a regular polygon, where it costs less than the polygon; it costs as much as four right corners.

    Before that, points on walls and balconies are set aside: small, narrow surfaces well below a larger one
    beside them (`low_parts`). What falls into parts of the alpha shape, or is joined by a neck narrower than
    what may be a balcony, is as many buildings, each with its outline.

    The beam of a scanner has a width: a pulse that strikes the edge with a part of its spot is placed
    outside, and mostly comes back once more from below. Those pulses fall into a strip as far inside the
    edge as outside it: `spot` is the median depth of their points behind the outermost, but no more than the
    width of a strip they would fill at the roof's density. Where the scan says nothing of returns, or a
    pulse has one only, it is 0, and edges lie outside by up to half the lit disc.

    Fails where
    -----------
    a jog or passage is narrower than twice the spacing; where trees touch the roof and were
    not taken out before (a bulge); on curves that are no circle, which become polygons with a
    scatter's sagitta; on hexagons and octagons under some 8 m, which pass for circles; where
    oblique walls are short against the spacing, which are drawn square.

    Complexity
    ----------
    O(N log N) for the triangulation; O(M² D + M D²) at worst for a ring of M points and D directions, less
    where sides are short, because a stretch that costs more than its points on no side is not made longer.

    References
    ----------
    [perez_vidal1994], [jung2017], [cox1962], [edelsbrunner1983], [kasa1976].
    """

    name: ClassVar[str] = "global_fit"
    idea: ClassVar[str] = "The cheapest polygon: few edges, common directions where supported."
    paper: ClassVar[str] = "perez_vidal1994"

    alpha: float = parameter(1.15, "radius of the largest empty disc, in spacings", gt=0)
    share: float = parameter(SHARE, "least share of the points inside, or alpha is widened", ge=0, le=1)
    sparse: float = parameter(
        3.0,
        "distance, in multiples of alpha, within which points outside are taken in, from each other and "
        "from the rest",
        ge=1,
    )
    scatter: float = parameter(0.28, "scatter of a boundary point about its edge, in spacings", gt=0)
    blur: float = parameter(
        0.1, "horizontal blur of an edge: noise of the points and the laser's spot", unit="m", ge=0
    )
    spot: float | None = parameter(
        None,
        "distance by which the width of the beam lets points reach beyond an edge; from the data half the "
        "strip in which pulses come back twice",
        unit="m",
        ge=0,
    )
    corner: float = parameter(
        6.0, "price of a side with a corner of 90°, in nats; a corner of another angle costs more", gt=0
    )
    direction: float = parameter(
        15.0, "further price of a side that follows another frame of directions than most, in nats", ge=0
    )
    stray: float = parameter(4.0, "price of a boundary point on no side, in nats", gt=0)
    hidden: float = parameter(
        0.1, "weight of a boundary point that something higher may hide the rest of the roof at", gt=0, le=1
    )
    beside: float = parameter(
        1.5,
        "distance from a boundary point, in spacings and at least `least_beside`, within which ground is "
        "beside it; a crown within twice that",
        gt=0,
    )
    over: float = parameter(
        1.0,
        "and a crown stands over the roof by more than this: more than what belongs to it",
        unit="m",
        ge=0,
    )
    sides: int = parameter(24, "fewest sides of a circle, such as a tank or a silo", ge=8)
    step: float = parameter(7.5, "step between the directions that are tried first", unit="°", gt=0, le=45)
    tolerance: float = parameter(12.0, "largest turn of an edge into a common direction", unit="°", ge=0)
    detail: float = parameter(1.5, "shortest edge and smallest jog, in spacings", ge=0)
    min_hole: float = parameter(10.0, "inner boundaries smaller than this are dropped", unit="m²", ge=0)
    widest: float = parameter(2.0, "empty discs wider than this are gaps, in spacings", gt=0)
    wide_share: float = parameter(
        0.7, "share of the area under discs no wider than the one that tells the spacing", gt=0, le=1
    )
    strip_before: float = parameter(
        1.2, "points up to this far before an edge tell where they end, in spacings", gt=0
    )
    strip_behind: float = parameter(4.0, "and up to this far behind it, in spacings", gt=0)
    wall_beside: float = parameter(
        1.0, "distance, in spacings, within which points of a wall have roof points above them", ge=0
    )
    least_beside: float = parameter(
        0.5,
        "and at least within this; boundary points nearer to each other count as one",
        unit="m",
        gt=0,
    )
    widest_spot: float = parameter(
        1.0,
        "pulses are divided by an edge within this: the disc of a beam of 0.5 mrad from 2000 m",
        unit="m",
        gt=0,
    )

    def parts(self, points: Points, spacing: float) -> Labels:
        mesh = triangulate_points(points[:, :2])
        if mesh is None:
            return super().parts(points, spacing)
        spacing = self.spacing_of(mesh, spacing)
        return alpha_parts(mesh, self.alpha * spacing, self.balcony, self.deep - spacing)

    def spacing_of(self, mesh: Mesh, spacing: float) -> float:
        """The spacing (m) of the points of a mesh, where they are sparse another than that of the scan."""
        wide = wide_radius(mesh, self.widest * spacing, self.wide_share) or spacing
        return float(np.clip(np.sqrt(2.0) * wide, 0.7 * spacing, 2.0 * spacing))

    def trace(self, points: Points, spacing: float, emit: Emit = ignore) -> Boundary | Failure:
        """The rings of the alpha shape of `points` (N, 3), with the spacing where they are sparse."""
        mesh = triangulate_points(points[:, :2])
        if mesh is not None:
            least = self.balcony / spacing**2
            low = low_parts(mesh, points[:, 2], self.alpha * 2.0 * spacing, least, self)
            if low.any():
                points = points[~low]
                mesh = triangulate_points(points[:, :2])
        if mesh is not None:
            spacing = self.spacing_of(mesh, spacing)
        rings = traced_rings(
            points,
            mesh,
            self.alpha * spacing,
            share=self.share,
            min_hole=self.min_hole,
            sparse=self.sparse,
            sparse_points=MIN_POINTS,
        )
        if isinstance(rings, Failure):
            return rings
        emit("alpha rings", rings)
        return Boundary(tuple(rings), points, spacing)

    def regularise(self, boundaries: list[Boundary], emit: Emit = ignore) -> list[Polygon | Failure]:
        """The fitted polygons; what two of them cover is of the larger."""
        answers: list[Polygon | Failure] = [self.fitted(boundary) for boundary in boundaries]
        drawn = [number for number, answer in enumerate(answers) if not isinstance(answer, Failure)]
        emit("fitted", [answers[number] for number in drawn])
        if len(drawn) > 1:
            shared = share_edges([polygon for polygon in answers if isinstance(polygon, Polygon)])
            for number, polygon in zip(drawn, shared, strict=True):
                answers[number] = polygon
        return answers

    def fitted(self, boundary: Boundary) -> Polygon | Failure:
        """One boundary's polygon."""
        rings = [self.fitted_ring(ring, boundary) for ring in boundary.rings]
        holes = [ring for ring in rings[1:] if abs(signed_area(ring)) >= self.min_hole]
        whole = as_polygon(Polygon(rings[0], holes))
        if whole is None:
            return Failure("no_area", f"a ring of {len(rings[0])} points encloses no area", "outline")
        return whole

    def fitted_ring(self, ring: NDArray[np.float64], boundary: Boundary) -> NDArray[np.float64]:
        """The corners (C, 2) of one ring (M, 2) of a boundary.

        What crosses itself loses the smaller loops; what encloses another area than the boundary is not
        used: then no point is taken for hidden, then it is the least rectangle around the boundary, and at
        last the boundary, simplified. A point outside what is drawn is not hidden: the roof is there.
        """
        origin = ring[0].copy()
        spacing = boundary.spacing
        local, points = ring - origin, boundary.points - np.append(origin, 0.0)
        divided = None if boundary.not_last is None else boundary.not_last[:, :2] - origin
        density = len(points) / max(abs(signed_area(boundary.rings[0])), 1e-9)
        sigma = float(np.hypot(self.scatter * spacing, self.blur))
        drawing = Drawing(self.detail * spacing, np.inf, sigma, self.corner)
        whole = Polygon(local)
        most = 1.5 * spacing * whole.length
        alone = min(1.0, whole.length / len(local) / self.least_beside)
        hidden = self.hidden_points(ring, boundary)
        for left in range(TRIES, 0, -1):
            hidden = hidden if left > 1 else np.zeros_like(hidden)
            weight = np.where(hidden, self.hidden, 1.0) * alone
            edges = self.cheapest_edges(local, sigma, weight)
            edges = None if edges is None else joined_edges(edges, drawing)
            corners = None
            if edges is not None and len(edges) > 2:
                circle = self.cheaper_circle(edges, local, weight, points, spacing, drawing)
                if circle is not None:
                    return np.asarray(circle + origin, dtype=np.float64)
                corners = self.drawn(edges, points, divided, density, spacing, drawing)
            drawn = None if corners is None or len(corners) < 3 else as_polygon(Polygon(corners))
            beyond = hidden
            if drawn is not None and abs(drawn.area - whole.area) <= most:
                beyond = hidden & (shapely.distance(drawn, shapely.points(local)) > spacing)
                if not beyond.any():
                    return np.asarray(shapely.get_coordinates(drawn.exterior)[:-1] + origin)
            if not hidden.any():
                break
            hidden = hidden & ~beyond
        rectangle = as_polygon(shapely.oriented_envelope(whole))
        if rectangle is not None and rectangle.area - whole.area <= most:
            return np.asarray(shapely.get_coordinates(rectangle.exterior)[:-1] + origin)
        return np.asarray(Polygon(ring).simplify(spacing).exterior.coords)[:-1]

    def hidden_points(self, ring: NDArray[np.float64], boundary: Boundary) -> Mask:
        """Mask (M,) of the points of a ring (M, 2) that may be hidden: those with something that stands over
        the roof, and no ground, beside them.
        """
        if boundary.others is None or not len(boundary.others):
            return np.zeros(len(ring), np.bool_)
        tree = cKDTree(boundary.points[:, :2], balanced_tree=False, compact_nodes=False)
        height = boundary.points[tree.query(ring)[1], 2]
        reach = max(self.beside * boundary.spacing, self.least_beside)
        high = boundary.others[boundary.others[:, 2] > height.min() + self.over]
        high = high[np.argsort(high[:, 0])]
        hidden: Mask = overtopped_kernel(ring, height + self.over, high, 2.0 * reach)
        if boundary.ground is not None and len(boundary.ground) and hidden.any():
            hidden[hidden] = cKDTree(boundary.ground).query(ring[hidden])[0] > reach
        return hidden

    def cheapest_edges(self, ring: NDArray[np.float64], sigma: float, weight: Values) -> OutlineEdges | None:
        """The edges of the cheapest polyline along a ring (M, 2) of points that scatter by `sigma` (m), None
        when there are under three.

        The directions of a first polyline, which has all to choose from, are those of the second.
        """
        prices = Prices(self.corner, self.direction, self.stray)
        far = int(np.argmax(((ring - ring.mean(axis=0)) ** 2).sum(axis=1)))
        ring, weight = np.roll(ring, -far, axis=0), np.roll(weight, -far)
        every = np.arange(0.0, RIGHT_ANGLE, np.radians(self.step))
        every = np.stack([every, every + RIGHT_ANGLE], axis=1).ravel()
        sides = cheapest_polyline(ring, every, sigma, prices, weight)
        if len(sides) < 3:
            return None
        free = turned_freely(fit_edges(ring, sides, every))
        axes = common_axes(free, sigma, np.radians(self.tolerance), len(free), fewest=1)
        longest = int(np.argmax(sides[:, 1] - sides[:, 0]))
        middle = int(sides[longest, :2].sum() // 2)
        ring, weight = np.roll(ring, -middle, axis=0), np.roll(weight, -middle)
        first = int(np.argmax(np.cos(travel_angles(axes) - free.angle[longest])))
        sides = cheapest_polyline(ring, axes, sigma, prices, weight, first)
        if len(sides) < 4:
            return None
        sides[0, 0], sides[0, 1] = sides[-1, 0], sides[0, 1] + len(ring)
        return fit_edges(ring, sides[:-1], axes)

    def cheaper_circle(
        self,
        edges: OutlineEdges,
        ring: NDArray[np.float64],
        weight: Values,
        points: Points,
        spacing: float,
        drawing: Drawing,
    ) -> NDArray[np.float64] | None:
        """The regular polygon (C, 2) of the circle through a ring (M, 2), moved to where the `points` (N, 3)
        end; None where the polygon of the joined edges costs less."""
        circle = circles.circle_through(ring)
        corners, prices = ring_of_edges(edges, drawing), Prices(self.corner, self.direction, self.stray)
        if not circles.is_cheaper(circle, corners, ring, weight, drawing.sigma, prices):
            return None
        strip = self.strip_before * spacing, self.strip_behind * spacing
        circle[2] = circles.moved_out(
            circle, points, strip, self.blur, max(self.wall_beside * spacing, self.least_beside)
        )
        return circles.polygon_of(circle, self.sides, drawing.sigma)

    def drawn(
        self,
        edges: OutlineEdges,
        xyz: Points,
        divided: NDArray[np.float64] | None,
        density: float,
        spacing: float,
        drawing: Drawing,
    ) -> NDArray[np.float64] | None:
        """The corners (C, 2) of the joined edges, moved to where the points `xyz` (N, 3) end; None when under
        three are left. `divided` (K, 2) are the points of pulses that came back once more, among `density`
        per m².
        """
        start, _ = ends_of_edges(edges, drawing)
        length = edge_lengths(edges, drawing)
        shift = edge_shift_kernel(
            xyz,
            edges.normal,
            edges.offset,
            start,
            length,
            self.strip_before * spacing,
            self.strip_behind * spacing,
            self.scatter * spacing,
            self.blur,
            max(self.wall_beside * spacing, self.least_beside),
            MIN_POINTS,
        )
        enough = np.isfinite(shift)
        shift = np.where(
            enough, np.clip(shift, -self.strip_before * spacing, self.strip_before * spacing), -0.5 * spacing
        )
        edges = edges.with_(offset=edges.offset + shift)
        spot = self.spot
        if spot is None:
            spot = 0.0 if divided is None else self.half_width_of_beam(edges, start, length, divided, density)
        finer = replace(drawing, detail=0.5 * drawing.detail)
        edges = joined_edges(edges.with_(offset=edges.offset + spot), finer)
        return ring_of_edges(edges, finer) if len(edges) > 2 else None

    def half_width_of_beam(
        self,
        edges: OutlineEdges,
        start: NDArray[np.float64],
        length: NDArray[np.float64],
        divided: NDArray[np.float64],
        density: float,
    ) -> float:
        """Distance (m) of points beyond their edge, when the edges stand before the outermost points.

        `divided` (K, 2) are the points of the pulses that came back once more from below. The ones an edge
        divided lie up to half the beam's width on both sides of it, so at half the beam behind the outermost
        in the median. They can fill no wider a strip than their number gives; what lies deeper was divided
        by something else, and as many are taken for that beside the edge.
        """
        if len(divided) < MIN_POINTS:
            return 0.0
        away = divided @ edges.normal.T - edges.offset
        along = divided @ edges.direction.T - (start * edges.direction).sum(axis=1)
        beside = (along > 0.0) & (along < length) & (away > -self.widest_spot)
        depth = np.where(beside, away, np.inf).min(axis=1)
        near = depth[depth < self.widest_spot]
        count = len(near) - int(
            np.count_nonzero((depth >= self.widest_spot) & (depth < 2.0 * self.widest_spot))
        )
        if count < MIN_POINTS:
            return 0.0
        return float(np.clip(np.median(near), 0.0, count / (density * float(length.sum()))))


@kernel
def overtopped_kernel(ring: NDArray[np.float64], height: Values, high: Points, reach: float) -> Mask:
    """Mask (M,) of the places of a ring (M, 2) that have one of the points (N, 3), which ascend by x, over
    their `height` (M,; m) and within the `reach` (m) of them in plan."""
    found = np.zeros(len(ring), np.bool_)
    for place in range(len(ring)):
        x, y = ring[place, 0], ring[place, 1]
        for one in range(np.searchsorted(high[:, 0], x - reach), len(high)):
            if high[one, 0] > x + reach or found[place]:
                break
            near = (high[one, 0] - x) ** 2 + (high[one, 1] - y) ** 2 <= reach * reach
            found[place] = near and high[one, 2] > height[place]
    return found
