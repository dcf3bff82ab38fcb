"""Single roofs of all data sets, and how badly each was segmented.

Where the truth is known a point is bad when it is not on the plane its face is found by; elsewhere when it
is a roof point that no plane took.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import laspy
import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from benchmarks.accuracy.models import ply_points
from benchmarks.accuracy.roof import delft_roofs, trondheim_roofs
from eaves.geometry.face_table import roof_point_mask
from eaves.model import Bounds, Points, RoofPlane
from eaves.simulate import scan_town, simulate_town, town_of_model
from eaves.simulate.objects.exact import ExactScene

FEWEST = 60
"""Roofs of fewer points are not looked at."""

LINK = 0.8
"""Building points (m) this near in plan are of one building, where no footprints are known."""


PART = Bounds(400.0, 250.0, 600.0, 450.0)
"""The part of Delfshaven that is scanned (m from its south-west corner)."""


@dataclass(frozen=True, eq=False)
class Roof:
    """Points (N, 3) in local metres of one building, and their true faces (N,), 0 for none, where known."""

    data: str
    name: str
    points: Points
    faces: NDArray[np.int64] | None = None


def roofs_of(data: Path) -> Iterator[Roof]:
    """All roofs of at least `FEWEST` points."""
    for roof in _all_roofs(data):
        if len(roof.points) >= FEWEST:
            yield replace(roof, points=roof.points - np.floor(roof.points.mean(axis=0)))


def badness(roof: Roof, planes: list[RoofPlane]) -> float:
    """Share of the roof's points that are bad, as the module says."""
    mine = np.zeros(len(roof.points), np.int64)
    for number, plane in enumerate(planes, 1):
        mine[plane.members] = number
    if roof.faces is None:
        seen = roof_point_mask(roof.points)
        return float(np.mean(mine[seen] == 0)) if seen.any() else 0.0
    on = roof.faces > 0
    if not on.any():
        return 0.0
    table = np.zeros((int(roof.faces.max()) + 1, len(planes) + 1), np.int64)
    np.add.at(table, (roof.faces, mine), 1)
    agree = np.minimum(table[1:, 1:], np.maximum(2 * table[1:, 1:] - table[1:].sum(axis=1)[:, None], 0))
    good = sum(int(table[1 + row, 1 + column]) for row, column in zip(*np.nonzero(agree), strict=True))
    return 1.0 - good / int(on.sum())


def _all_roofs(data: Path) -> Iterator[Roof]:
    for number, (_, points) in enumerate(delft_roofs(data)):
        yield Roof("delft", str(number), points)
    for name, points, faces in trondheim_roofs(data):
        yield Roof("trondheim", name, points, faces)
    for path in sorted((data / "building3d" / "xyz").glob("*.xyz")):
        yield Roof("building3d", path.stem, np.loadtxt(path)[:, :3])
    for path in sorted((data / "city3d_ahn3").glob("*.ply")):
        yield Roof("city3d", path.stem, ply_points(path))
    yield from _ign(data / "ign_urban")
    yield from _of_scene("town", scan_town(simulate_town(0.04, seed=1), 10.0, 0.03, "lines"))
    town = town_of_model(data / "towns" / "delfshaven.city.json")
    inside = [b for b in town.buildings if PART.contains(_middle(b.footprint))[0]]
    part = replace(town, buildings=tuple(inside), bounds=PART)
    yield from _of_scene("delfshaven", scan_town(part, 10.0, 0.03, "lines"))


def _middle(footprint: shapely.Polygon) -> Points:
    return np.array([[footprint.centroid.x, footprint.centroid.y]])


def _ign(folder: Path) -> Iterator[Roof]:
    clouds = [laspy.read(path) for path in sorted(folder.glob("*.laz"))]
    if not clouds:
        return
    points = np.vstack([np.asarray(cloud.xyz)[np.asarray(cloud.classification) == 6] for cloud in clouds])
    pairs = cKDTree(points[:, :2]).query_pairs(LINK, output_type="ndarray")
    size = len(points)
    graph = coo_matrix((np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), shape=(size, size))
    group = connected_components(graph, directed=False)[1]
    for number in np.flatnonzero(np.bincount(group) >= 10 * FEWEST):
        yield Roof("ign", str(number), points[group == number])


def _of_scene(data: str, scene: ExactScene) -> Iterator[Roof]:
    for building in scene.buildings:
        own = np.flatnonzero(scene.building == building.number)
        yield Roof(data, str(building.number), scene.cloud.xyz[own], scene.plane[own].astype(np.int64))
