"""Roofs as wireframes in Wavefront OBJ: corners and the straight edges between them, `v` and `l` lines.

World coordinates in metres; one object a building, as Building3D's wireframes are.
Run `python -m benchmarks.wireframes.drawing OUT/buildings.city.jsonl wireframe.obj`.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from heapq import heapify, heappop, heappush
from pathlib import Path

import numpy as np
import shapely
from scipy.spatial import cKDTree

from eaves.exports.dxf import DECIMALS, turning_corners
from eaves.formats.crs import describe_system
from eaves.formats.models.cityjson_read import read_models
from eaves.formats.whole_files import atomic
from eaves.geometry.face_table import FaceTable
from eaves.geometry.inside import connected_groups_kernel, members
from eaves.geometry.rings import COORDINATE_STEP
from eaves.model import LOCAL_METRES, BuildingModel, Failure, Integers, Points, Solid
from eaves.model.building import ROOF_SURFACE
from eaves.model.checks import check_positive

DRAWN_DETAIL = 0.8
"""A detail smaller than this (m) is drawn as one corner: head and foot of a low step, a parapet, a jog.
Corners of Building3D are paired over 1 m."""


def roof_wireframe(model: BuildingModel, detail: float = DRAWN_DETAIL) -> tuple[Points, Integers]:
    """Corners (V, 3) about the footprint's origin and edges (E, 2) of the roof faces at the finest level.

    Parameters
    ----------
    model : BuildingModel
        A building with at least one level that has roof faces.
    detail : float
        Size (m, > 0) of what is drawn as one. Faces beside each other whose corners lie within a quarter of
        it of one plane are one face. Corners of a group that are all nearer than it to one another become
        one, where the edges that leave the group meet best, and a corner of two edges is left out where the
        one line in their place passes it nearer than half of it. As small as 1e-6 keeps every corner of the
        solid.

    Returns
    -------
    Corners, where a ring of a face turns by more than 10°; and the pairs of their numbers that a face's ring
    joins, each once.

    Raises
    ------
    ValueError
        When `detail` is not above 0.

    Examples
    --------
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> from benchmarks.wireframes.drawing import roof_wireframe
    >>> shed = nine_roofs_on_a_slope(density=4.0).buildings[2].model((0.0, 0.0))
    >>> corners, edges = roof_wireframe(shed)
    >>> len(corners), len(edges)
    (4, 4)
    """
    check_positive(detail, "detail")
    solids = model.solids.get(model.lod, ())
    rings = [ring for solid in solids for ring in drawn_rings(solid, 0.25 * detail)]
    corners, edges = turning_corners(FaceTable.of([[ring] for ring in rings]))
    group = corner_groups(corners, detail)
    corners = meeting_places(corners, edges, group, detail)
    drawn = {(min(pair), max(pair)) for pair in group[edges].tolist() if pair[0] != pair[1]}
    kept = without_straight_corners(corners, drawn, 0.5 * detail)
    used, numbers = np.unique(np.array(sorted(kept), np.int64).reshape(-1, 2), return_inverse=True)
    return corners[used], numbers.reshape(-1, 2)


def drawn_rings(solid: Solid, reach: float) -> list[Points]:
    """The rings, each (N, 3), of a solid's roof faces, those that nearly lie on one plane made one.

    Neighbours become one when the corners of both lie within `reach` (m) of their plane of least squares, the
    pair that does so best first.
    """
    faces = [face for face in solid.faces if face.surface == ROOF_SURFACE]
    rings = [[solid.vertices[list(ring)] for ring in face.rings] for face in faces]
    together = joined_faces(rings, reach)
    answer: list[Points] = []
    for one in together:
        if len(one) == 1:
            answer += rings[one[0]]
            continue
        corners = np.vstack([ring for face in one for ring in rings[face]])
        polygons = [shapely.Polygon(rings[face][0], rings[face][1:]) for face in one]
        whole = shapely.union_all(shapely.force_2d(polygons), grid_size=COORDINATE_STEP)
        for part in shapely.get_parts(whole):
            for boundary in (part.exterior, *part.interiors):
                places = shapely.get_coordinates(boundary)[:-1]
                near = np.abs(places[:, None, :] - corners[None, :, :2]).max(axis=2) < COORDINATE_STEP
                count = near.sum(axis=1)
                height = (near @ corners[:, 2])[count > 0] / count[count > 0]
                answer.append(np.column_stack([places[count > 0], height]))
    return answer


def joined_faces(rings: list[list[Points]], reach: float) -> list[list[int]]:
    """The numbers of the faces, given by their rings, in groups that lie within `reach` (m) of one plane."""
    beside: dict[tuple[tuple[float, float], ...], set[int]] = {}
    for face, own in enumerate(rings):
        for ring in own:
            places = [(x, y) for x, y, _ in np.round(ring / COORDINATE_STEP).tolist()]
            for start, end in zip(places, places[1:] + places[:1], strict=True):
                beside.setdefault((min(start, end), max(start, end)), set()).add(face)
    corners = {face: np.vstack(own) for face, own in enumerate(rings)}
    members = {face: [face] for face in corners}
    near: dict[int, set[int]] = {face: set() for face in corners}
    waiting: list[tuple[float, int, int, int, int]] = []

    def offer(first: int, second: int) -> None:
        one, other = min(first, second), max(first, second)
        places = np.vstack([corners[one], corners[other]])
        centred = places - places.mean(axis=0)
        columns = np.column_stack([centred[:, :2], np.ones(len(centred))])
        slope = np.linalg.lstsq(columns, centred[:, 2], rcond=None)[0]
        away = float(np.abs(columns @ slope - centred[:, 2]).max())
        if away <= reach:
            heappush(waiting, (away, one, other, len(members[one]), len(members[other])))

    for one, other in sorted({(min(pair), max(pair)) for pair in beside.values() if len(pair) == 2}):
        near[one].add(other)
        near[other].add(one)
        offer(one, other)
    while waiting:
        _, one, other, *sizes = heappop(waiting)
        if [len(members.get(face, ())) for face in (one, other)] != sizes:
            continue
        members[one] += members.pop(other)
        corners[one] = np.vstack([corners[one], corners.pop(other)])
        for face in near.pop(other):
            near[face].discard(other)
            if face != one:
                near[face].add(one)
                near[one].add(face)
        for face in sorted(near[one]):
            offer(one, face)
    return list(members.values())


def corner_groups(corners: Points, detail: float) -> Integers:
    """The group (V,) of each corner (V, 3), 0, 1, …: all of one group are within `detail` (m) of one another.

    The two groups that lie nearest become one, again and again (complete linkage).
    """
    from scipy.cluster.hierarchy import fcluster, linkage

    if len(corners) == 0:
        return np.zeros(0, np.int64)
    pairs = cKDTree(corners).query_pairs(detail, output_type="ndarray")
    together = connected_groups_kernel(pairs[:, 0], pairs[:, 1], len(corners))
    answer = np.zeros(len(corners), np.int64)
    count = 0
    for nearby in members(together, int(together.max()) + 1):
        group = np.zeros(len(nearby), np.int64)
        if len(nearby) > 1:
            group = fcluster(linkage(corners[nearby], "complete"), detail, "distance").astype(np.int64) - 1
        answer[nearby] = count + group
        count += int(group.max()) + 1
    return answer


def meeting_places(corners: Points, edges: Integers, group: Integers, detail: float) -> Points:
    """One corner for each group (V,) of the corners (V, 3): nearest in square to the lines of the edges
    (E, 2) that leave it, each by its length, and to the mean of its corners, which counts as one of
    `detail` (m).

    Without a jog, the long edges beside it meet there.
    """
    size = np.bincount(group)
    mean = np.column_stack([np.bincount(group, axis) / size for axis in corners.T]).reshape(-1, 3)
    leaving = edges[group[edges[:, 0]] != group[edges[:, 1]]]
    near, far = np.vstack([leaving, leaving[:, ::-1]]).T
    along = corners[far] - corners[near]
    length = np.linalg.norm(along, axis=1)[:, None, None]
    across = length * np.eye(3) - along[:, :, None] * along[:, None, :] / length
    weight = np.tile(detail * np.eye(3), (len(mean), 1, 1))
    np.add.at(weight, group[near], across)
    pull = np.zeros_like(mean)
    np.add.at(pull, group[near], (across @ (corners[near] - mean[group[near]])[:, :, None])[:, :, 0])
    return np.asarray(mean + np.linalg.solve(weight, pull[:, :, None])[:, :, 0])


def without_straight_corners(
    corners: Points, edges: set[tuple[int, int]], reach: float
) -> set[tuple[int, int]]:
    """The edges between corners (V, 3) without corners of two edges that lie within `reach` (m) of the line
    between their neighbours; the one nearest to it goes first.
    """
    beside: dict[int, set[int]] = {}
    for one, other in edges:
        beside.setdefault(one, set()).add(other)
        beside.setdefault(other, set()).add(one)

    def away(corner: int) -> float:
        if len(beside[corner]) != 2:
            return np.inf
        start, end = corners[sorted(beside[corner])]
        chord, step = end - start, corners[corner] - start
        share = float(step @ chord) / max(float(chord @ chord), 1e-12)
        return float(np.linalg.norm(step - share * chord)) if 0.0 < share < 1.0 else np.inf

    waiting = [(away(corner), corner) for corner in beside]
    heapify(waiting)
    while waiting and waiting[0][0] < reach:
        distance, corner = heappop(waiting)
        if corner not in beside or away(corner) != distance:
            continue
        one, other = sorted(beside.pop(corner))
        for end, far in ((one, other), (other, one)):
            beside[end].discard(corner)
            beside[end].add(far)
            heappush(waiting, (away(end), end))
    return {(one, other) for one, ends in beside.items() for other in ends if one < other}


def write_obj_wireframe(path: str | Path, models: Iterable[BuildingModel | Failure]) -> int:
    """Write the roofs' corners and edges to `path` (`.obj`), in metres; the number of buildings written. One
    without a model is a comment with its reason.

    Examples
    --------
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> models = [building.model(truth.cloud.origin) for building in truth.buildings]
    >>> from benchmarks.wireframes.drawing import write_obj_wireframe
    >>> write_obj_wireframe("wireframe.obj", models)
    9
    """
    count, start = 0, 1
    with atomic(path) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as file:
        file.write(
            f"# eaves: corners and edges of roofs; coordinates are in {describe_system(LOCAL_METRES)}\n"
        )
        for number, model in enumerate(models, 1):
            footprint = model.footprint
            name = "_".join((footprint.id if footprint else "").split()) or f"building-{number}"
            if isinstance(model, Failure) or footprint is None or not model.solids:
                reason = f": {model.code}, {model.reason}" if isinstance(model, Failure) else ""
                file.write(" ".join(f"# {name} has no roof{reason}".split()) + "\n")
                continue
            corners, edges = roof_wireframe(model)
            world = corners + np.array([*footprint.origin, 0.0])
            file.write(f"o {name}\n")
            for row in world:
                file.write("v " + " ".join(f"{value:.{DECIMALS}f}" for value in row) + "\n")
            file.writelines(f"l {a} {b}\n" for a, b in (edges + start).tolist())
            start += len(world)
            count += 1
    return count


if __name__ == "__main__":
    print(write_obj_wireframe(sys.argv[2], read_models(sys.argv[1])), "roofs")
