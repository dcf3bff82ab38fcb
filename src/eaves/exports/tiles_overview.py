"""The view of 3D Tiles from afar: prisms in place of the largest buildings under a node.

Tiles of whole models come into view from a few of their diameters away. Over a city, which is larger, nothing
would be seen: every node over tiles therefore has a content of its own, which they replace as one comes near.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from eaves.formats import SURFACES, BuildingMesh, mesh_of_solids
from eaves.model import ROOF_SURFACE, WALL_SURFACE, BuildingModel, Face, Integers, Points, Solid

NODE_PRISMS = 500
"""Most prisms of a node: 0.4 MB, and some 100 nodes are in sight at a time."""
TILE_PRISMS = 32
"""Most prisms kept of a tile, by their area: of a million buildings those of 7,000 tiles are in memory."""
STRAIGHT = 1.0
"""Corners (m) of the hull that lie closer to a straight line are left out."""
KEPT = ("roof_type", "h_ground", "h_ridge", "rmse_m", "area_m2")
"""Attributes of the buildings that prisms keep: what a viewer colours by."""

Prism = tuple[float, BuildingModel, Solid]
"""Area (m²), building, prism about the building's origin."""


def prism_of(model: BuildingModel, mesh: BuildingMesh) -> Prism | None:
    """The hull of a building's footprint up to the mean height of its roof; None where it has no roof."""
    roof = mesh.triangles_of(SURFACES.index(ROOF_SURFACE))
    hull = model.footprint.polygon.convex_hull.simplify(STRAIGHT)
    if not len(roof) or hull.geom_type != "Polygon":
        return None
    corners = np.asarray(hull.exterior.coords)[:-1, :2]
    corners = corners if hull.exterior.is_ccw else corners[::-1]
    base, top = float(mesh.vertices[:, 2].min()), float(mesh.vertices[roof, 2].mean())
    solid = standing_prisms(corners, base, top)
    kept = {name: model.attributes[name] for name in KEPT if name in model.attributes}
    plain = model.with_(solids={model.lod: ()}, planes=(), installations=(), attributes=kept)
    return hull.area, plain, solid


def standing_prisms(corners: Points, base: float, top: float) -> Solid:
    """Walls and roof over counter-clockwise corners (M, 2)."""
    count = len(corners)
    vertices = np.vstack([np.column_stack([corners, np.full(count, height)]) for height in (base, top)])
    roof = Face((tuple(range(count, 2 * count)),), ROOF_SURFACE)
    following = [*range(1, count), 0]
    walls = [Face(((k, after, after + count, k + count),), WALL_SURFACE) for k, after in enumerate(following)]
    return Solid.of(vertices, (roof, *walls))


def largest(prisms: Iterable[Prism], count: int) -> list[Prism]:
    """The largest of the prisms, by area, then by id."""
    return heapq.nlargest(count, prisms, key=lambda prism: (prism[0], prism[1].footprint.id))


def describe_overview(origin: tuple[float, float], prisms: Sequence[Prism]) -> tuple[BuildingMesh, Integers]:
    """The mesh of prisms about one origin (world m), and the prism of each of its vertices (V,)."""
    mesh = mesh_of_solids([solid for *_, solid in prisms])
    number = np.repeat(np.arange(len(prisms)), [len(solid.vertices) for *_, solid in prisms])
    shifts = np.array([[*np.subtract(model.footprint.origin, origin), 0.0] for _, model, _ in prisms])
    return replace(mesh, vertices=mesh.vertices + shifts[number]), number
