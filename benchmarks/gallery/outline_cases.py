"""Outlines of all data sets beside what is known of the building, for the gallery."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import laspy
import numpy as np
import pyogrio
import shapely
from numpy.typing import NDArray
from scipy.ndimage import label
from shapely.geometry.base import BaseGeometry

from benchmarks.accuracy.outline import METHODS, drawn, wireframe_plans
from benchmarks.accuracy.outline_detected import Group, delft_detected, detected_groups, drawn_together
from eaves.geometry.neighbours import measure_spacing
from eaves.methods import make_method
from eaves.model import Bounds, Points
from eaves.outline import OutlineMethod
from eaves.simulate import scan_town, simulate_town

KNOWN_SEEDS, DETECTED_SEEDS = (21, 22, 23), (24, 25)
"""Towns on which nothing was chosen: with the building of each point known, and with nothing known."""
DENSITY = 10.0
LEAST_M2 = 20.0
"""Smaller buildings are left out: a tree or a car takes half of them."""
CELL_M, FEWEST = 0.6, 40

"""Roof points that hang together in such cells are of one building, where only their class is known."""


@dataclass(frozen=True, eq=False)
class Case:
    """One building: points of it and around it (N, 3) in local metres, the truth, and what was drawn."""

    data: str
    name: str
    points: Points
    around: Points
    truth: BaseGeometry
    found: BaseGeometry

    @property
    def iou(self) -> float:
        """Area in common over area of both."""
        return float(self.found.intersection(self.truth).area / self.found.union(self.truth).area)


def outline_cases(data: Path) -> Iterator[Case]:
    """Every outline of the simulated towns, Building3D, Delft and IGN, by the default method."""
    method = make_method("outline", METHODS[-1])
    assert isinstance(method, OutlineMethod)
    for seed in KNOWN_SEEDS:
        yield from known_town(seed, method)
    for seed in DETECTED_SEEDS:
        yield from detected_town(seed, method)
    for name, points, parts in wireframe_plans(data, 0.5):
        found = drawn(points, measure_spacing(points), method) or shapely.Polygon()
        yield Case("building3d", name, points, points[:0], shapely.union_all(parts), found)
    yield from delft_blocks(data, method)
    yield from ign_houses(data / "ign_buildings", method)


def known_town(seed: int, method: OutlineMethod) -> Iterator[Case]:
    """A town whose scan says of each point which building it is of; walls and balconies count."""
    scene = scan_town(simulate_town(0.04, seed=seed), DENSITY, seed=seed)
    xyz, building = scene.cloud.xyz, np.asarray(scene.building)
    spacing = measure_spacing(xyz)
    for one in scene.buildings:
        if one.footprint.area < LEAST_M2:
            continue
        mine = building == one.number
        found = drawn(xyz[mine], spacing, method) or shapely.Polygon()
        rest = xyz[~mine]
        yield Case(
            "town", f"{seed}/{one.number}", xyz[mine], beside(rest, one.footprint), one.footprint, found
        )


def detected_town(seed: int, method: OutlineMethod) -> Iterator[Case]:
    """A town of which only the points are given: each block with the outline that covers it best."""
    scene = scan_town(simulate_town(0.04, seed=seed), DENSITY, seed=seed)
    groups, spacing = detected_groups(scene.cloud)
    found = drawn_together(groups, spacing, method)
    united = shapely.union_all([one.footprint.buffer(0.01) for one in scene.buildings]).buffer(-0.01)
    inside = Bounds.of(scene.cloud.xyz).buffered(-2.0)
    frame = shapely.box(inside.west, inside.south, inside.east, inside.north)
    blocks = [b for b in shapely.get_parts(united) if b.area >= LEAST_M2 and frame.covers(b)]
    yield from blocks_of(f"found {seed}", blocks, found, groups, scene.cloud.xyz)


def blocks_of(
    data: str,
    blocks: Sequence[shapely.Polygon],
    found: Sequence[shapely.Polygon],
    groups: Sequence[Group],
    xyz: Points,
) -> Iterator[Case]:
    """Each true block with the outline that covers most of it."""
    tree = shapely.STRtree(found)
    own = np.concatenate([one.points for one in groups])
    for number, block in enumerate(blocks):
        near = [found[k] for k in tree.query(block, predicate="intersects")]
        best = max(near, key=lambda one: one.intersection(block).area, default=shapely.Polygon())
        both = block.union(best)
        yield Case(data, str(number), beside(own, both), beside(xyz, both), block, best)


def delft_blocks(data: Path, method: OutlineMethod) -> Iterator[Case]:
    """The blocks of Delft's map that no edge of the tile cuts, drawn from what our detector finds."""
    groups, spacing, corner = delft_detected(data)
    cloud = laspy.read(data / "delft/ahn3.laz")
    xyz = np.asarray(cloud.xyz) - np.append(corner, 0.0)
    shapes = shapely.from_wkb(pyogrio.raw.read(data / "delft/footprints.gpkg")[2])
    united = shapely.union_all(shapely.make_valid(shapes), grid_size=0.001)
    united = shapely.transform(united, lambda xy: xy - corner)
    blocks = united.buffer(0.05, join_style="mitre").buffer(-0.05, join_style="mitre")
    bounds = Bounds.of(xyz).buffered(-1.0)
    frame = shapely.box(bounds.west, bounds.south, bounds.east, bounds.north)
    outlines = shapely.union_all(drawn_together(groups, spacing, method))
    own = np.concatenate([one.points for one in groups])
    for number, block in enumerate(shapely.get_parts(blocks)):
        if block.area < LEAST_M2 or not frame.covers(block):
            continue
        near = shapely.get_parts(outlines.intersection(block.buffer(1.5)))
        found = shapely.union_all(near[shapely.intersects(near, block)])
        yield Case("delft", str(number), beside(own, block), beside(xyz, block), block, found)


def ign_houses(folder: Path, method: OutlineMethod) -> Iterator[Case]:
    """The houses of a tile with a vendor's polygons, drawn from class 6."""
    cloud = laspy.read(next(folder.glob("*postValidation.laz")))
    xyz = np.asarray(cloud.xyz)
    corner = np.floor(xyz.min(axis=0)) * [1.0, 1.0, 0.0]
    xyz = xyz - corner
    roofs = xyz[np.asarray(cloud.classification) == 6]
    cell = np.floor(roofs[:, :2] / CELL_M).astype(np.int64)
    cell -= cell.min(axis=0)
    image = np.zeros(cell.max(axis=0) + 1, np.bool_)
    image[cell[:, 0], cell[:, 1]] = True
    number = label(image, np.ones((3, 3)))[0][cell[:, 0], cell[:, 1]]
    groups = [Group(roofs[number == k]) for k in range(1, number.max() + 1) if (number == k).sum() >= FEWEST]
    shapes = shapely.from_wkb(pyogrio.raw.read(next(folder.glob("*postIA.shp")))[2])
    shapes = shapely.transform(shapely.make_valid(shapes), lambda xy: xy - corner[:2])
    blocks = shapely.get_parts(shapely.union_all(shapely.buffer(shapes, 0.3)).buffer(-0.3))
    bounds = Bounds.of(xyz)
    frame = shapely.box(bounds.west, bounds.south, bounds.east, bounds.north)
    blocks = [block for block in blocks if block.area >= LEAST_M2 and frame.covers(block)]
    found = drawn_together(groups, measure_spacing(xyz), method)
    yield from blocks_of("ign", blocks, found, groups, xyz)


def beside(xyz: Points, shape: BaseGeometry) -> NDArray[np.float64]:
    """The points in the box of a shape and 3 m around it."""
    west, south, east, north = shape.buffer(3.0).bounds
    x, y = xyz[:, 0], xyz[:, 1]
    return np.asarray(xyz[(x > west) & (x < east) & (y > south) & (y < north)])
