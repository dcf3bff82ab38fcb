"""Outlines from our own detection, and given footprints snapped to the eaves: rows of the outline table.

Run alone, `python -m benchmarks.accuracy.outline_detected` measures corners in towns under crowns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import laspy
import numpy as np
import pyogrio
import shapely
from scipy.spatial import cKDTree
from shapely import Polygon, STRtree

from benchmarks.table import keep
from eaves.blocks.block_file import CANDIDATE_HEIGHT
from eaves.buildings.gather import MARGIN
from eaves.detect import detect_buildings
from eaves.evaluate.footprint_scores import count_vertices, outline_distances
from eaves.footprints.read import repair_footprints
from eaves.footprints.snap import snap_footprints
from eaves.formats import read
from eaves.geometry.neighbours import measure_spacing
from eaves.ground import classify_ground
from eaves.methods import resolve_method
from eaves.model import Bounds, Failure, Footprint, Mask, PointCloud, Points
from eaves.model.cloud import GROUND, NOISE_CLASSES
from eaves.model.scene import WALL
from eaves.outline import OutlineMethod, regularise_outlines, trace_outline
from eaves.raster.surfaces import CELL, make_scene
from eaves.simulate import scan_town, simulate_town

SEEDS = (3, 11, 12)
"""Towns; thresholds were chosen on the first."""
LEAST_M2 = 10.0
"""Smaller buildings are not asked for here: the detector's own floor would decide the figure."""
MAP_OFF_M = (0.8, -0.6)
"""How far the map is moved before it is snapped back."""


def not_last(cloud: PointCloud) -> Mask:
    """The points (N,) whose pulses came back once more from below; none where the scan does not say."""
    if cloud.return_number is None or cloud.number_of_returns is None:
        return np.zeros(len(cloud), bool)
    return np.asarray(cloud.return_number < cloud.number_of_returns)


@dataclass(frozen=True, eq=False)
class Group:
    """The roof points (N, 3) of a building our default detector finds, which of them came back once more from
    below, the ground (K, 2) and the other high points (L, 3) around it.
    """

    points: Points
    divided: Mask | None = None
    ground: Points | None = None
    others: Points | None = None

    def moved(self, by: np.ndarray) -> Group:
        """The same, moved by (3,)."""
        return replace(self, points=self.points + by)


CROWN_SEEDS, TREES, CORNER_DEG = (31, 32, 33), 2.0, 35.0
"""Towns that chose nothing, with twice the trees; a corner turns by more than this."""


def turns_of(polygon: Polygon) -> tuple[np.ndarray, np.ndarray]:
    """Places (C, 2) and turns (C,) in degrees of the corners of the rings, simplified by 5 cm."""
    places, turns = [], []
    for ring in shapely.get_rings(polygon):
        xy = shapely.get_coordinates(ring.simplify(0.05))[:-1]
        run = np.roll(xy, -1, axis=0) - xy
        way = np.arctan2(run[:, 1], run[:, 0])
        turn = np.abs(np.degrees(np.mod(way - np.roll(way, 1) + np.pi, 2.0 * np.pi) - np.pi))
        places.append(xy[turn > CORNER_DEG])
        turns.append(turn[turn > CORNER_DEG])
    return np.concatenate(places), np.concatenate(turns)


def met_corners(one: np.ndarray, other: np.ndarray, within: float) -> int:
    """How many places (A, 2), (B, 2) pair up one to one within a distance (m), nearest first."""
    near = cKDTree(one).sparse_distance_matrix(cKDTree(other), within, output_type="coo_matrix")
    left: tuple[set[int], set[int]] = (set(), set())
    for k in np.argsort(near.data, kind="stable"):
        if near.row[k] not in left[0] and near.col[k] not in left[1]:
            left[0].add(near.row[k])
            left[1].add(near.col[k])
    return len(left[0])


def crown_rows(density: float, methods: Sequence[str]) -> list[dict[str, object]]:
    """Corners, right angles and IoU of what is found in towns under crowns, by method."""
    towns = [town_blocks(density, seed, TREES) for seed in CROWN_SEEDS]
    table: dict[str, dict[str, object]] = {}
    for name in methods:
        method = resolve_method("outline", name)
        assert isinstance(method, OutlineMethod)
        counts, right, wanted_right, iou = np.zeros(3), [], [], []
        for (groups, spacing), blocks in towns:
            found = drawn_together(groups, spacing, method)
            one, other = STRtree(found).query(blocks, predicate="intersects")
            common = shapely.area(shapely.intersection(np.array(blocks)[one], np.array(found)[other]))
            own = np.concatenate([turns_of(found[k])[0] for k in np.unique(other[common > 1.0])])
            true = np.concatenate([turns_of(block)[0] for block in blocks])
            counts += met_corners(own, true, 0.5), len(own), len(true)
            for block, drawn, area in zip(one, other, common, strict=True):
                share = area / (blocks[block].area + found[drawn].area - area)
                if share > 0.5:
                    iou.append(share)
                    right += list(np.abs(turns_of(found[drawn])[1] - 90.0) < 5.0)
                    wanted_right += list(np.abs(turns_of(blocks[block])[1] - 90.0) < 5.0)
        figures = {
            "true corners met within 0.5 m": (counts[0] / counts[2], "≥ 0.9"),
            "own corners at a true one": (counts[0] / counts[1], "≥ 0.9"),
            "share of right angles": (np.mean(right), f"{np.mean(wanted_right):.3f} ± 0.05"),
            "mean IoU of pairs": (np.mean(iou), "not lower"),
            "pairs": (len(iou), "–"),
        }
        for measure, (value, reach) in figures.items():
            row = table.setdefault(measure, {"density": density, "measure": measure, "reach": reach})
            row[name] = round(float(value), 3)
    return list(table.values())


def detected_groups(cloud: PointCloud) -> tuple[list[Group], float]:
    """Every building our default detector finds, and the spacing (m)."""
    cloud = classify_ground(cloud)
    scene = make_scene(cloud, Bounds.of(cloud.xyz).buffered(3.0))
    regions = detect_buildings(scene)
    roof = np.ones(len(cloud), np.bool_) if regions.part is None else regions.part != WALL
    divided = not_last(cloud)
    assert cloud.classification is not None
    seen = cloud.classification == GROUND
    ground = (np.unique(np.floor(cloud.xyz[seen, :2] / CELL), axis=0) + 0.5) * CELL
    high = (scene.height >= CANDIDATE_HEIGHT) & ~np.isin(cloud.classification, (GROUND, *NOISE_CLASSES))
    others = cloud.xyz[high & (regions.label == 0)]
    groups = []
    for number in range(1, int(regions.label.max(initial=0)) + 1):
        mine = np.flatnonzero((regions.label == number) & roof)
        if not len(mine):
            continue
        around = Bounds.of(cloud.xyz[mine]).buffered(MARGIN)
        beside = (ground[around.contains(ground)], others[around.contains(others)])
        groups.append(Group(cloud.xyz[mine], divided[mine], *beside))
    return groups, scene.spacing


def drawn_together(groups: Sequence[Group], spacing: float, method: OutlineMethod) -> list[Polygon]:
    """The footprints of all groups, neighbours regularised together as in a run."""
    boundaries = [
        trace_outline(one.points, spacing, method, not_last=one.divided, ground=one.ground, others=one.others)
        for one in groups
    ]
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


def town_blocks(
    density: float, seed: int, trees: float = 1.0
) -> tuple[tuple[list[Group], float], list[Polygon]]:
    """What our detector finds in a town, the spacing (m), and its true blocks: houses that touch are one."""
    scene = scan_town(simulate_town(0.04, trees=trees, seed=seed), density, seed=seed)
    grown = [one.footprint.buffer(0.01, join_style="mitre") for one in scene.buildings]
    united = shapely.union_all(grown).buffer(-0.01, join_style="mitre")
    inside = Bounds.of(scene.cloud.xyz).buffered(-2.0)
    frame = shapely.box(inside.west, inside.south, inside.east, inside.north)
    blocks = [b for b in shapely.get_parts(united) if b.area >= LEAST_M2 and frame.covers(b)]
    return detected_groups(scene.cloud), blocks


def detected_rows(density: float, goals: Sequence[object], methods: Sequence[str]) -> list[dict[str, object]]:
    """The towns of all `SEEDS`: nothing but points given; touching buildings are one true block."""
    towns = [town_blocks(density, seed) for seed in SEEDS]
    measures = ("median IoU", "median boundary RMS (m)", "median surplus of corners", "median shift (m)")
    rows: list[dict[str, object]] = [
        {"data": f"towns, {density:g}/m², own detection", "measure": measure, "reach": goal}
        for measure, goal in zip((*measures, "share of blocks with IoU over 0.9"), (*goals, "–"), strict=True)
    ]
    for name in methods:
        method = resolve_method("outline", name)
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


def main() -> None:
    """Print and keep the table of towns under crowns."""
    methods = ("alpha_shape", "ransac_lines", "global_fit")
    rows = [row for density in (2.0, 4.0, 10.0, 20.0) for row in crown_rows(density, methods)]
    keep("outline-crowns", "Corners of outlines in towns under crowns", rows, COMMAND, NOTE)


COMMAND = "python -m benchmarks.accuracy.outline_detected"
NOTE = (
    "Towns drawn with twice the trees, found by our own detection; seeds that chose nothing. Blocks whose "
    "houses touch are one. A corner turns by more than 35°; corners pair up one to one, nearest first; "
    "right angles within 5°, on pairs with IoU over 0.5."
)

if __name__ == "__main__":
    main()
