"""Outlines from our own detection, and given footprints snapped to the eaves: rows of the outline table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import laspy
import numpy as np
import pyogrio
import shapely
from shapely import Polygon, STRtree

from eaves.blocks.block import not_last
from eaves.detect import detect_buildings
from eaves.evaluate.footprints import count_vertices, outline_distances
from eaves.footprints.given import repair_footprints
from eaves.footprints.snap import snap_footprints
from eaves.formats import read
from eaves.geometry.neighbours import measure_spacing
from eaves.ground import classify_ground
from eaves.methods import make_method
from eaves.model import Bounds, Failure, Footprint, Mask, PointCloud, Points
from eaves.model.scene import WALL
from eaves.outline import OutlineMethod, regularise_outlines, trace_outline
from eaves.raster.surfaces import make_scene
from eaves.simulate import scan_town, simulate_town

SEEDS = (3, 11, 12)
"""Towns; thresholds were chosen on the first."""
LEAST_M2 = 10.0
"""Smaller buildings are not asked for here: the detector's own floor would decide the figure."""
MAP_OFF_M = (0.8, -0.6)
"""How far the map is moved before it is snapped back."""


@dataclass(frozen=True, eq=False)
class Group:
    """The roof points (N, 3) of a building our default detector finds, which of them came back once more from
    below.
    """

    points: Points
    divided: Mask | None = None

    def moved(self, by: np.ndarray) -> Group:
        """The same, moved by (3,)."""
        return replace(self, points=self.points + by)


def detected_groups(cloud: PointCloud) -> tuple[list[Group], float]:
    """Every building our default detector finds, and the spacing (m)."""
    scene = make_scene(classify_ground(cloud), Bounds.of(cloud.xyz).buffered(3.0))
    regions = detect_buildings(scene)
    roof = np.ones(len(cloud), np.bool_) if regions.part is None else regions.part != WALL
    divided = not_last(cloud)
    groups = []
    for number in range(1, int(regions.label.max(initial=0)) + 1):
        mine = np.flatnonzero((regions.label == number) & roof)
        if not len(mine):
            continue
        groups.append(Group(cloud.xyz[mine], divided[mine]))
    return groups, scene.spacing


def drawn_together(groups: Sequence[Group], spacing: float, method: OutlineMethod) -> list[Polygon]:
    """The footprints of all groups, neighbours regularised together as in a run."""
    boundaries = [trace_outline(one.points, spacing, method, not_last=one.divided) for one in groups]
    good = [boundary for boundary in boundaries if not isinstance(boundary, Failure)]
    return [one.polygon for one in regularise_outlines(good, method) if isinstance(one, Footprint)]


def detected_figures(found: Sequence[Polygon], truth: Sequence[Polygon]) -> np.ndarray:
    """IoU, RMS, surplus of corners, shift (B, 4) of each true block with the outline that covers it best."""
    tree = STRtree(found)
    table = []
    for block in truth:
        near = [found[k] for k in tree.query(block, predicate="intersects")]
        if not near:
            table.append([0.0, 3.0, -count_vertices(block), np.nan])
            continue
        iou = [one.intersection(block).area / one.union(block).area for one in near]
        best = near[int(np.argmax(iou))]
        away = np.concatenate([outline_distances(best, block), outline_distances(block, best)])
        surplus = count_vertices(best) - count_vertices(block)
        table.append(
            [max(iou), float(np.sqrt((away**2).mean())), surplus, (best.area - block.area) / block.length]
        )
    return np.array(table)


def detected_rows(density: float, goals: Sequence[object], methods: Sequence[str]) -> list[dict[str, object]]:
    """The towns of all `SEEDS`: nothing but points given; touching buildings are one true block."""
    towns = []
    for seed in SEEDS:
        scene = scan_town(simulate_town(0.04, seed=seed), density, seed=seed)
        united = shapely.union_all([one.footprint.buffer(0.01) for one in scene.buildings]).buffer(-0.01)
        inside = Bounds.of(scene.cloud.xyz).buffered(-2.0)
        frame = shapely.box(inside.west, inside.south, inside.east, inside.north)
        blocks = [b for b in shapely.get_parts(united) if b.area >= LEAST_M2 and frame.covers(b)]
        towns.append((detected_groups(scene.cloud), blocks))
    measures = ("median IoU", "median boundary RMS (m)", "median surplus of corners", "median shift (m)")
    rows: list[dict[str, object]] = [
        {"data": f"towns, {density:g}/m², own detection", "measure": measure, "reach": goal}
        for measure, goal in zip((*measures, "share of blocks with IoU over 0.9"), (*goals, "–"), strict=True)
    ]
    for name in methods:
        method = make_method("outline", name)
        assert isinstance(method, OutlineMethod)
        table = np.concatenate(
            [
                detected_figures(drawn_together(groups, spacing, method), blocks)
                for (groups, spacing), blocks in towns
            ]
        )
        for row, figure in zip(rows, (*np.nanmedian(table, axis=0), (table[:, 0] > 0.9).mean()), strict=True):
            row[name] = round(float(figure), 3)
    return rows


def delft_detected(folder: Path) -> tuple[list[Group], float, np.ndarray]:
    """What our detector finds in Delft, the spacing (m), where its local coordinates count from (2,)."""
    cloud = read(folder / "delft/ahn3.laz")
    groups, spacing = detected_groups(cloud)
    return groups, spacing, np.array(cloud.origin)


def snap_rows(folder: Path) -> list[dict[str, object]]:
    """Delft's map as given, and moved by `MAP_OFF_M`, snapped to class 6: what is left of the offset."""
    cloud = laspy.read(folder / "delft/ahn3.laz")
    xyz = cloud.xyz[np.asarray(cloud.classification) == 6]
    origin = np.floor(xyz.min(axis=0) / 240.0) * [240.0, 240.0, 0.0]
    xyz = xyz - origin
    spacing = measure_spacing(xyz)
    shapes = shapely.from_wkb(pyogrio.raw.read(folder / "delft/footprints.gpkg")[2])
    given = repair_footprints(
        [shapely.transform(one, lambda xy: xy - origin[:2]) for one in shapely.make_valid(shapes)]
    )
    off = [one.with_(polygon=shapely.transform(one.polygon, lambda xy: xy + MAP_OFF_M)) for one in given]
    rows: list[dict[str, object]] = []
    straight = snap_footprints(given, xyz, spacing)
    for name, start in (("as given", given), (f"moved by {np.hypot(*MAP_OFF_M):.1f} m", off)):
        snapped = snap_footprints(start, xyz, spacing)
        overhang = [
            (after.polygon.area - before.polygon.area) / before.polygon.length
            for before, after in zip(given, snapped, strict=True)
        ]
        apart = [
            after.polygon.centroid.distance(want.polygon.centroid)
            for after, want in zip(snapped, straight, strict=True)
        ]
        iou = [
            after.polygon.intersection(want.polygon).area / after.polygon.union(want.polygon).area
            for after, want in zip(snapped, straight, strict=True)
        ]
        figures = {
            "overhang added, mean over the outline (m)": np.median(overhang),
            "from the map snapped in place: median distance of centroids (m)": np.median(apart),
            "from the map snapped in place: median IoU": np.median(iou),
        }
        rows += [
            {
                "data": f"delft, map {name}, snapped",
                "measure": what,
                "reach": "–",
                "global_fit": round(float(value), 3),
            }
            for what, value in figures.items()
        ]
    return rows
