"""How well outlines are drawn from points whose building is known, and how fast.

Run `EAVES_DATA=... python -m benchmarks.accuracy.outline`.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import laspy
import numpy as np
import pyogrio
import shapely
from numpy.typing import NDArray
from scipy.ndimage import label
from shapely import Polygon, affinity

from benchmarks.accuracy.outline_detected import (
    delft_detected,
    detected_rows,
    drawn_together,
    not_last,
    snap_rows,
)
from benchmarks.table import keep
from benchmarks.wireframes.scores import read_wireframe
from eaves.evaluate.footprint_scores import count_vertices, outline_distances
from eaves.geometry.neighbours import measure_spacing
from eaves.methods import resolve_method
from eaves.model import Failure, Points
from eaves.outline import OutlineMethod, regularise_outlines, trace_outline
from eaves.simulate import scan_town, simulate_town

COMMAND = "python -m benchmarks.accuracy.outline"
METHODS = ("alpha_shape", "ransac_lines", "global_fit")
MEASURES = (
    "median IoU",
    "median boundary RMS (m)",
    "median surplus of corners",
    "mean shift (m)",
    "mean IoU",
    "mean boundary RMS (m)",
    "mean surplus of corners",
    "median shift (m)",
)
SHAPES = {
    "box": Polygon([(0, 0), (12, 0), (12, 8), (0, 8)]),
    "small box": Polygon([(0, 0), (6, 0), (6, 5), (0, 5)]),
    "ell": Polygon([(0, 0), (14, 0), (14, 6), (6, 6), (6, 12), (0, 12)]),
    "tee": Polygon([(0, 0), (16, 0), (16, 6), (11, 6), (11, 13), (5, 13), (5, 6), (0, 6)]),
    "u": Polygon([(0, 0), (18, 0), (18, 14), (12, 14), (12, 6), (6, 6), (6, 14), (0, 14)]),
    "jog": Polygon([(0, 0), (10, 0), (10, 1.2), (18, 1.2), (18, 10), (0, 10)]),
    "bay": Polygon([(0, 0), (4, 0), (4, -1.5), (8, -1.5), (8, 0), (12, 0), (12, 9), (0, 9)]),
    "oblique": Polygon([(0, 0), (14, 0), (12, 9), (1, 8)]),
    "wing": Polygon([(0, 0), (15, 0), (15, 7), (9, 7), (13, 14), (8, 16.5), (2.6, 7), (0, 7)]),
    "courtyard": Polygon([(0, 0), (24, 0), (24, 20), (0, 20)], [[(7, 6), (17, 6), (17, 14), (7, 14)]]),
    "hexagon": Polygon([(6 * np.cos(a), 6 * np.sin(a)) for a in np.arange(6) * np.pi / 3]),
    "cut corner": Polygon([(0, 0), (14, 0), (14, 7), (11, 10), (0, 10)]),
}
Case = tuple[Points, float, Polygon, NDArray[np.bool_] | None]
"""A building's points, their spacing (m), its true outline, which points came back once more from below."""


def drawn(
    points: Points,
    spacing: float,
    method: OutlineMethod,
    not_last: NDArray[np.bool_] | None = None,
) -> Polygon | None:
    """The footprint a method draws, None when it fails."""
    boundary = trace_outline(points, spacing, method, not_last=not_last)
    if isinstance(boundary, Failure):
        return None
    footprint = regularise_outlines([boundary], method)[0]
    return None if isinstance(footprint, Failure) else footprint.polygon


def shape_cases(density: float, stretch: float | None) -> list[Case]:
    """Exact shapes, turned, twice each; at random, or in lines `stretch` times wider apart than dense."""
    cases = []
    spacing = density**-0.5
    for number, shape in enumerate(SHAPES.values()):
        for turn in range(2):
            rng = np.random.default_rng([number, turn, int(density)])
            truth = affinity.rotate(shape, rng.uniform(0, 360))
            west, south, east, north = truth.buffer(2).bounds
            middle = np.array([west + east, south + north]) / 2
            half = np.hypot(east - west, north - south) / 2
            if stretch is None:
                xy = rng.uniform(-half, half, (rng.poisson(density * 4 * half**2), 2))
            else:
                across, along = spacing * stretch**0.5, spacing / stretch**0.5
                lines = np.arange(-half, half, across) + rng.uniform(0, across)
                x = np.arange(-half, half, along)[None, :] + rng.uniform(0, along, (len(lines), 1))
                xy = np.stack([x.ravel(), np.repeat(lines, x.shape[1])], axis=1)
                a = rng.uniform(0, np.pi)
                xy = xy @ np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]])
            xy = xy + middle
            xy = xy[shapely.contains_xy(truth, xy)]
            xy = xy + rng.normal(0, 0.05, xy.shape)
            cases.append((np.column_stack([xy, np.full(len(xy), 5.0)]), spacing, truth, None))
    return cases


def town_cases(density: float, roof_only: bool) -> list[Case]:
    """The buildings of a simulated town, with all their points (walls, balconies) or the roof's only."""
    scene = scan_town(simulate_town(0.04, seed=3), density, seed=3)
    xyz, building = scene.cloud.xyz, np.asarray(scene.building)
    good = np.asarray(scene.plane) > 0 if roof_only else np.ones(len(xyz), np.bool_)
    spacing = measure_spacing(xyz)
    divided = not_last(scene.cloud)
    every = ((one.footprint, (building == one.number) & good) for one in scene.buildings)
    return [(xyz[some], spacing, footprint, divided[some]) for footprint, some in every]


def simulated_rows(name: str, cases: Sequence[Case], reach: Sequence[object]) -> list[dict[str, object]]:
    """IoU, RMS, surplus of corners and shift by method, one measure a row."""
    figures: dict[str, list[NDArray[np.float64]]] = {}
    for method in METHODS:
        outliner = resolve_method("outline", method)
        assert isinstance(outliner, OutlineMethod)
        table = []
        for points, spacing, truth, divided in cases:
            found = drawn(points, spacing, outliner, divided)
            if found is None:
                table.append(np.array([0.0, 3.0, -count_vertices(truth), 0.0]))
                continue
            away = np.concatenate([outline_distances(found, truth), outline_distances(truth, found)])
            table.append(
                np.array(
                    [
                        found.intersection(truth).area / found.union(truth).area,
                        np.sqrt((away**2).mean()),
                        count_vertices(found) - count_vertices(truth),
                        (found.area - truth.area) / truth.length,
                    ]
                )
            )
        figures[method] = table
    rows = []
    for k, measure in enumerate(MEASURES):
        row: dict[str, object] = {"data": name, "measure": measure, "reach": reach[k] if k < 4 else "–"}
        for method, table in figures.items():
            column = np.array(table)[:, k % 4]
            row[method] = round(float(column.mean() if measure.startswith("mean") else np.median(column)), 3)
        rows.append(row)
    return rows


def delft_groups(folder: Path) -> tuple[list[Points], NDArray[np.object_]]:
    """Class-6 points that hang together in 0.6 m cells, and the map's footprints, about one origin."""
    cloud = laspy.read(folder / "delft/ahn3.laz")
    xyz = cloud.xyz[np.asarray(cloud.classification) == 6]
    origin = np.append(delft_origin(folder), 0.0)
    xyz = xyz - origin
    cell = np.floor(xyz[:, :2] / 0.6).astype(np.int64)
    cell -= cell.min(axis=0)
    image = np.zeros(cell.max(axis=0) + 1, np.bool_)
    image[cell[:, 0], cell[:, 1]] = True
    number = label(image, np.ones((3, 3)))[0][cell[:, 0], cell[:, 1]]
    groups = [xyz[number == one] for one in range(1, number.max() + 1) if (number == one).sum() >= 25]
    shapes = shapely.from_wkb(pyogrio.raw.read(folder / "delft/footprints.gpkg")[2])
    return groups, shapely.transform(shapely.make_valid(shapes), lambda xy: xy - origin[:2])


def delft_origin(folder: Path) -> NDArray[np.float64]:
    """Where the local coordinates of Delft count from (2,)."""
    with laspy.open(folder / "delft/ahn3.laz") as file:
        return np.asarray(np.floor(np.asarray(file.header.mins[:2]) / 240.0) * 240.0)


def signed_offsets(found: Polygon, wanted: Polygon, within: float = 1.5) -> NDArray[np.float64]:
    """Distances (m), outwards, of the found outline from points every 0.5 m along the wanted one."""
    whole = shapely.orient_polygons(wanted)
    offsets = []
    for ring in shapely.get_rings(whole):
        xy = shapely.get_coordinates(ring)
        for p, q in pairwise(xy):
            length = np.hypot(*(q - p))
            if length < 1.0:
                continue
            along = (q - p) / length
            outward = np.array([along[1], -along[0]])
            for t in np.arange(0.5, length - 0.3, 0.5):
                here = p + t * along
                ray = shapely.LineString([here - within * outward, here + within * outward])
                hits = (shapely.get_coordinates(ray.intersection(found)) - here) @ outward
                if len(hits):
                    offsets.append(hits[np.abs(hits).argmin()])
    return np.array(offsets)


def delft_rows(folder: Path) -> list[dict[str, object]]:
    """Spread and overhang of edges against the map, and recall of its area."""
    groups, shapes = delft_groups(folder)
    spacing = measure_spacing(np.concatenate(groups))

    def drawn_each(method: OutlineMethod) -> list[Polygon]:
        return [one for group in groups if (one := drawn(group, spacing, method)) is not None]

    rows = delft_figures("delft, class 6", groups, spacing, shapes, drawn_each)
    origin = delft_origin(folder)
    own, own_spacing, corner = delft_detected(folder)
    moved = [one.moved(np.append(corner - origin, 0.0)) for one in own]

    def drawn_own(method: OutlineMethod) -> list[Polygon]:
        return drawn_together(moved, own_spacing, method)

    return rows + delft_figures("delft, own detection", groups, spacing, shapes, drawn_own)


def delft_figures(
    name: str,
    groups: list[Points],
    spacing: float,
    shapes: NDArray[np.object_],
    draw: Callable[[OutlineMethod], list[Polygon]],
) -> list[dict[str, object]]:
    """The rows of one source of points; class 6 (`groups`) says where there are any."""
    everything = np.concatenate(groups)
    united = shapely.union_all(shapes, grid_size=0.001)
    blocks = united.buffer(0.05, join_style="mitre").buffer(-0.05, join_style="mitre")
    crop = shapely.box(*everything[:, :2].min(axis=0), *everything[:, :2].max(axis=0)).buffer(-1.5)
    seen = shapely.buffer(shapely.MultiPoint(everything[:, :2]), spacing)
    names = (
        ("edge spread, 1.48 MAD (m)", "≤ 0.20"),
        ("overhang over the map's walls (m)", "0–0.6"),
        ("recall of the map's area", "≥ 0.98"),
        ("recall of the map's area that has class-6 points", "–"),
        ("IoU with the map's blocks, 1.5 m around", "≥ class 6"),
    )
    rows: list[dict[str, object]] = [
        {"data": name, "measure": measure, "reach": reach} for measure, reach in names
    ]
    cells = np.unique(np.floor(everything[:, :2] / 0.5), axis=0) * 0.5
    hull = shapely.union_all(shapely.box(cells[:, 0], cells[:, 1], cells[:, 0] + 0.5, cells[:, 1] + 0.5))
    rows[4]["reach"] = f"≥ {block_iou(hull, united):.3f} (0.5 m cells of class 6)"
    for method in METHODS:
        outliner = resolve_method("outline", method)
        assert isinstance(outliner, OutlineMethod)
        found = shapely.union_all(draw(outliner))
        offsets = np.concatenate(
            [signed_offsets(found.boundary, part) for part in shapely.get_parts(blocks.intersection(crop))]
        )
        middle = np.median(offsets)
        figures = (
            1.4826 * np.median(np.abs(offsets - middle)),
            middle,
            found.intersection(united).area / united.area,
            found.intersection(united).intersection(seen).area / united.intersection(seen).area,
            block_iou(found, united),
        )
        for row, figure in zip(rows, figures, strict=True):
            row[method] = round(float(figure), 3)
    return rows


def block_iou(found: Polygon, wanted: Polygon) -> float:
    """IoU of what was found within 1.5 m of the wanted area: buildings the map leaves out do not count."""
    near = found.intersection(wanted.buffer(1.5))
    return float(near.intersection(wanted).area / near.union(wanted).area)


def wireframe_plans(folder: Path, close: float) -> Iterator[tuple[int, Points, Polygon]]:
    """Number, points and plan of every roof: what the unbounded face of its wireframe leaves.

    Slits between roof layers, up to twice `close` (m) wide, are closed where it is not zero.
    """
    for path in sorted((folder / "building3d/xyz").glob("*.xyz")):
        xyz = np.loadtxt(path)[:, :3]
        origin = np.floor(xyz.min(axis=0)) * [1.0, 1.0, 0.0]
        frame = read_wireframe(folder / f"building3d/wireframe/{path.stem}.obj")
        plan = np.asarray(frame.corners)[:, :2] - origin[:2]
        lines = [shapely.LineString(plan[list(edge)]) for edge in frame.edges]
        faces = shapely.polygonize(
            [shapely.union_all([one for one in lines if one.length > 0.001], grid_size=0.01)]
        )
        whole = shapely.union_all(shapely.get_parts(faces))
        if close > 0.0:
            grown = whole.buffer(close, join_style="mitre", mitre_limit=3)
            whole = grown.buffer(-close, join_style="mitre", mitre_limit=3)
        parts = [part for part in shapely.get_parts(whole) if part.area > 1.0]
        yield int(path.stem), xyz - origin, shapely.union_all(parts)


def building3d_rows(folder: Path) -> list[dict[str, object]]:
    """IoU with the plan of Building3D's wireframes, and the shift (m), each a mean, by halves."""
    rows: list[dict[str, object]] = []
    for close, name in ((0.0, "building3d"), (0.5, "building3d, slits of the wireframe closed")):
        plans = list(wireframe_plans(folder, close))
        figures: dict[str, NDArray[np.float64]] = {}
        for method in METHODS:
            outliner = resolve_method("outline", method)
            assert isinstance(outliner, OutlineMethod)
            found = [(drawn(xyz, measure_spacing(xyz), outliner), plan) for _, xyz, plan in plans]
            figures[method] = np.array(
                [
                    (0.0, 0.0)
                    if one is None
                    else (
                        one.intersection(plan).area / one.union(plan).area,
                        (one.area - plan.area) / plan.length,
                    )
                    for one, plan in found
                ]
            )
        odd = np.array([number % 2 == 1 for number, _, _ in plans])
        for what, mine in (("all roofs", np.ones(len(odd), bool)), ("roofs of odd number", odd)):
            for k, (measure, reach) in enumerate((("mean IoU", "≥ 0.97"), ("mean shift (m)", "± 0.03"))):
                row: dict[str, object] = {"data": f"{name}, {what}", "measure": measure, "reach": reach}
                rows.append(
                    row
                    | {method: round(float(table[mine, k].mean()), 3) for method, table in figures.items()}
                )
    return rows


def main() -> None:
    """Print the table and keep it."""
    rows: list[dict[str, object]] = []
    reach = {4.0: (0.95, 0.35), 10.0: (0.97, 0.20), 25.0: (0.985, 0.12)}
    for density, (iou, rms) in reach.items():
        goals = (f"≥ {iou}", f"≤ {rms}", "0", "± 0.05" if density == 10.0 else "–")
        for roof_only, what in ((True, "roof points"), (False, "all points")):
            rows += simulated_rows(f"town, {density:g}/m², {what}", town_cases(density, roof_only), goals)
        for stretch, what in ((None, "random"), (3.0, "scan lines 1:3")):
            rows += simulated_rows(f"shapes, {density:g}/m², {what}", shape_cases(density, stretch), goals)
        rows += detected_rows(density, goals, METHODS)
    folder = os.environ.get("EAVES_DATA")
    if folder:
        rows += delft_rows(Path(folder))
        rows += snap_rows(Path(folder))
        rows += building3d_rows(Path(folder))
    else:
        print("EAVES_DATA is not set: the real data are left out", file=sys.stderr)
    keep("outline", "Outlines drawn from points whose building is known", rows, COMMAND, NOTE)


NOTE = (
    "Town: simulated with a beam of 0.4 mrad, trees that hide roofs, balconies the reference leaves out. "
    "Shapes: a beam without width. Own detection: "
    "nothing but points given, towns of three seeds; thresholds were chosen on the first. Delft's map "
    "shows walls. RMS and shift count all buildings, half hidden ones too. "
)

if __name__ == "__main__":
    main()
