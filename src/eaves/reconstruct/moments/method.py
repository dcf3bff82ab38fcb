"""Parametric houses from invariant moments [maas_vosselman1999]."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

from eaves.figures.attributes import describe_roof
from eaves.geometry.roof_fit import roof_point_mask
from eaves.methods import Emit, ignore, parameter
from eaves.model import BuildingModel, Failure, Footprint, Points, RoofPlane, Solid, canonical_order
from eaves.reconstruct.moments.building import ParametricBuilding, fit_building
from eaves.reconstruct.moments.parametric_roof import CUT
from eaves.reconstruct.moments.solid import (
    PartLimits,
    RoofPart,
    explained,
    find_parts,
    rectangle_of,
    solids_of,
)
from eaves.reconstruct.stage import Reconstructor
from eaves.reconstruct.toolkit.evidence import points_inside


class Moments(Reconstructor, PartLimits):
    """A house with a flat, shed, gable, hip, half-hip or pyramid roof, its parameters, and their variances.

    The moments of order 0 to 2 of the area under the points, plain and weighted with height, determine a
    house with a simple roof in closed form: its place, orientation, length, width, heights, slope and type.
    They are integrated over the triangles between the points, so that density does not weigh. From there
    one robust least-squares fit of the roof's heights gives orientation, ridge, slopes; the edges follow
    from how far the explained points reach. Residuals that hang together over 2 m² are dormers or terraces
    and become parts of the model. Points that do not fill the rectangle, or that the roof leaves
    unexplained, are not those of a house: a Failure.

    Formula
    -------
    In the axes u along the ridge and v across, with h̄ the mean height and n the area: L = √(12 μ20 / n), W
    = √(12 μ02 / n), Δv = −48 Σ(h − h̄)v² / (n W²), Δu = −48 Σ(h − h̄)u² / (n L²), tilt 12 Σ(h − h̄)v / (n
    W). Gable: Δ = Δv, h_e = h̄ − Δ/2. Hip: Δv = Δ(15L − 7W)/(15L), Δu = ΔW(20L² − 15LW + 3W²)/(15L³), h_e =
    h̄ − Δ(1/2 − W/6L). Pyramid: both 8Δ/15. Shed: Δ is the tilt.

    Fidelity
    --------
    The paper's text prints no formula; these are derived again and tested on exact integrals. Integrals
    over triangles take the place of sums over points: they correct for uneven density and are several times
    more precise. The border that the hull of n points loses is given back as 8/3 · ln n / n of the area.
    The axis is tan 2θ = 2 μ11 / (μ20 − μ02), which a square leaves undefined (μ20 = μ02); n points at random
    tell it to L W / (√n (L² − W²)) radians. Squarish houses take the axes of the height tensor, or, where
    heights are the same all around, of the fourth moment, which is above order 2. Of the solutions for each
    type, ridge along and across, the one whose roof lies nearest to the points is taken; points off it are
    dormers and other asymmetries, they take its height, and the moments are integrated again, until the
    same points are off. A ridge beside the middle follows from the tilt: t (1 − q²)² = q (3 − q²), t the tilt
    over Δv, q its distance in half widths. With a ground plan axes, place and sizes are the plan's. The fit
    adds what the closed solution does not have: slopes of their own for both sides, ends that begin above
    the eaves (half-hips; also the name where the ends differ). Edges lie half a gap, Σg²/2Σg of the gaps g
    between points, beyond the outermost points.

    Fails where
    -----------
    Roofs that are none of the six: L-shapes and other areas that are no rectangle, gambrels, mansards:
    `not_a_house`. Annexes are not modelled: a house whose annex is more than a fifth of its points is
    `not_a_house`.

    Complexity
    ----------
    O(N log N) for the triangles, O(N) for each of up to 60 fitting steps.

    References
    ----------
    [maas_vosselman1999]; [renyi_sulanke1963] for the hull; [cox1962] for the gap beyond the last point.
    """

    name: ClassVar[str] = "moments"
    idea: ClassVar[str] = (
        "A simple roof in closed form from moments, one least-squares fit, dormers from the residuals."
    )
    paper: ClassVar[str] = "maas_vosselman1999"

    ground_plan: bool = parameter(
        False, "Take place, orientation, length and width from the footprint instead of the points."
    )
    empty_share: float = parameter(
        0.05,
        "Share of the rectangle that may lack points, beside what chance leaves of n: 1/√n, measured on "
        "drawn rectangles of 100 to 2,500 points, random and in scan lines.",
        ge=0.0,
        le=1.0,
    )
    closed_only: bool = parameter(
        False,
        "Leave the fit out: the closed solution alone makes the roof, without standard deviations.",
        off=True,
    )
    unexplained_share: float = parameter(
        0.2, "Share of the roof points that neither the roof nor its parts need explain.", ge=0.0, le=1.0
    )

    def model(
        self,
        points: Points,
        footprint: Footprint,
        planes: list[RoofPlane],
        ground: float,
        emit: Emit = ignore,
    ) -> BuildingModel | Failure:
        """The parametric house of one building from its points (N, 3), or the Failure that says why not."""
        finite = points[np.isfinite(points).all(axis=1)]
        roof = finite[roof_point_mask(finite)]
        roof = roof[canonical_order(roof)]
        house = self.house_of(roof, footprint.polygon)
        if isinstance(house, Failure):
            return replace(house, footprint=footprint)
        emit("closed solution", house.closed)
        emit("house", house)
        parts = find_parts(house, roof, self)
        emit("parts", parts)
        for count in range(len(parts), -1, -1):  # the smallest part may be one that cannot be built
            doubt = self.doubt(house, parts[:count], roof)
            if doubt:
                return Failure("not_a_house", doubt, "reconstruct", footprint)
            solids = solids_of(house, parts[:count], ground)
            if solids is not None:
                return self.present(house, parts[:count], solids, points, roof, footprint, ground)
        return Failure("not_sound", "the roof does not make a sound solid", "reconstruct", footprint)

    def house_of(self, roof: Points, plan: Polygon) -> ParametricBuilding | Failure:
        """The house under roof points (N, 3) over a plan, fitted or closed, as the parameters say."""
        return fit_building(roof, plan if self.ground_plan else None, closed_only=self.closed_only)

    def doubt(self, house: ParametricBuilding, parts: list[RoofPart], roof: Points) -> str:
        """Why the points are not those of a house with this roof; empty when they are."""
        allowed = self.empty_share + 1.0 / np.sqrt(len(roof))
        if abs(house.empty_share) > allowed:
            return (
                f"the points cover {1.0 - house.empty_share:.0%} of a rectangle of "
                f"{house.length:.1f} m × {house.width:.1f} m; {allowed:.0%} may differ"
            )
        unexplained = 1.0 - float(explained(house, parts, roof, self.tolerance).mean())
        if unexplained > self.unexplained_share:
            return (
                f"{unexplained:.0%} of the roof points are off the {house.roof} roof; "
                f"{self.unexplained_share:.0%} may be"
            )
        return ""

    def present(
        self,
        house: ParametricBuilding,
        parts: list[RoofPart],
        built: tuple[list[Solid], NDArray[np.float64]],
        points: Points,
        roof: Points,
        footprint: Footprint,
        ground: float,
    ) -> BuildingModel:
        """The model of a house, its planes with the points on them, and its measures."""
        solids, faces = built
        reach = max(CUT * house.fit.scale, self.tolerance)
        planes = tuple(members_on(points, (float(a), float(b), float(c)), reach) for a, b, c in faces)
        plan = rectangle_of(house)
        model = BuildingModel(footprint.with_(polygon=plan), {"2.2": tuple(solids)}, planes)
        inside, top = points[points_inside(points, plan)], roof[points_inside(roof, plan)]
        attributes = {**describe_roof(model, inside, top, ground), **measures(house, parts)}
        return model.with_(footprint=footprint, attributes=attributes)


def members_on(points: Points, coefficients: tuple[float, float, float], reach: float) -> RoofPlane:
    """The roof plane with those of the points (N, 3) that are within `reach` (m) of it."""
    bare = RoofPlane(coefficients, np.zeros(0, np.int64), 0.0)
    away = bare.distance_to(points)
    members = np.flatnonzero(np.abs(away) <= reach)
    rmse = float(np.sqrt(np.mean(away[members] ** 2))) if len(members) else 0.0
    return RoofPlane(coefficients, members, rmse)


def measures(house: ParametricBuilding, parts: list[RoofPart]) -> dict[str, Any]:
    """The parameters of a house as attributes (m, degrees), with standard deviations, fitted and closed."""
    deviations, closed = house.deviations, house.closed
    figures: dict[str, Any] = {
        "house_type": house.roof,
        "house_parts": len(parts),
        "house_rmse_m": house.rmse,
    }
    for name in ("length", "width", "eaves", "ridge"):
        figures[f"house_{name}_m"] = getattr(house, name)
        figures[f"house_{name}_sd_m"] = deviations[name] if np.isfinite(deviations[name]) else None
        figures[f"house_{name}_closed_m"] = getattr(closed, name)
    for name, value in (("orientation", house.orientation), ("slope", house.slope)):
        figures[f"house_{name}_deg"] = float(np.degrees(value))
        certain = np.isfinite(deviations[name])
        figures[f"house_{name}_sd_deg"] = float(np.degrees(deviations[name])) if certain else None
    figures["house_orientation_closed_deg"] = float(np.degrees(closed.orientation)) % 180.0
    figures["house_slope_closed_deg"] = float(np.degrees(closed.slope))
    figures["house_ridge_offset_m"] = house.ridge_offset
    return figures
