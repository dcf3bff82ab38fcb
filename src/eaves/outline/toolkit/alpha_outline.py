"""What the published outline methods have in common: the alpha shape, part by part, before it is drawn."""

from __future__ import annotations

from shapely import Polygon

from eaves.geometry.rings import as_polygon
from eaves.methods import Emit, ignore, parameter
from eaves.model import Boundary, Failure, Labels, Points
from eaves.outline.stage import OutlineMethod
from eaves.outline.toolkit.alpha import SHARE, alpha_parts, traced_rings, triangulate_points, widen


class AlphaOutline(OutlineMethod):
    """An outline method that draws each part of the alpha shape of a region, each on its own."""

    share: float = parameter(
        SHARE, "least share of the points inside; alpha is widened until it holds", off=0.0, ge=0, le=1
    )
    min_hole: float = parameter(
        50.0, "inner boundaries smaller than this are dropped", unit="m²", off=0.0, ge=0
    )

    def radius(self, spacing: float) -> float:
        """Radius (m) of the largest empty disc inside, at a spacing (m) of the points."""
        raise NotImplementedError

    def draw(self, boundary: Boundary, emit: Emit) -> Polygon:
        """The polygon of a boundary, valid or not."""
        raise NotImplementedError

    def parts(self, points: Points, spacing: float) -> Labels:
        mesh = triangulate_points(points[:, :2])
        if mesh is None:
            return super().parts(points, spacing)
        radius = widen(mesh, self.radius(spacing), self.share)[1]
        return alpha_parts(mesh, radius, radius**2)  # fewer triangles than that are strays

    def trace(self, points: Points, spacing: float, emit: Emit = ignore) -> Boundary | Failure:
        """The rings of the alpha shape of `points` (N, 3)."""
        mesh, radius = triangulate_points(points[:, :2]), self.radius(spacing)
        rings = traced_rings(points, mesh, radius, share=self.share, min_hole=self.min_hole)
        if isinstance(rings, Failure):
            return rings
        emit("alpha rings", rings)
        return Boundary(tuple(rings), points, spacing)

    def regularise(self, boundaries: list[Boundary], emit: Emit = ignore) -> list[Polygon | Failure]:
        """The polygon of each boundary, or the Failure that it encloses nothing."""
        drawn = [as_polygon(self.draw(boundary, emit)) for boundary in boundaries]
        nothing = [f"a ring of {len(boundary.rings[0])} points encloses no area" for boundary in boundaries]
        return [
            Failure("no_area", reason, "outline") if polygon is None else polygon
            for polygon, reason in zip(drawn, nothing, strict=True)
        ]
