"""Closed solid from a roof partition: roof faces, outer walls, walls at height steps, ground."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np
import shapely
from shapely import Polygon

from eaves.geometry.tolerance import COORDINATE_STEP
from eaves.model import Face, Solid
from eaves.model.building import GROUND_SURFACE, ROOF_SURFACE, WALL_SURFACE
from eaves.simulate.objects.masses import Plane

SAME_HEIGHT = 0.005
"""Heights at a node nearer than this (m) are one vertex: on a steep roof 1 mm in plan is 3 mm in height."""

NARROWEST = 0.01
"""A face with a corner nearer than this (m) in plan to another corner or edge of it is refused: rounded to 1
mm, its triangles would no longer lie in its plane."""

Node = tuple[int, int]
"""A node of the plan, in whole coordinate steps."""
Ring = list[Node]


def extrude_partition(faces: Sequence[tuple[Polygon, Plane]], base: float) -> Solid:
    """The closed, outward-oriented solid between the roof faces and the level `base` (m).

    `faces` tile the footprint and share their nodes, as `roof_partition` makes them. A roof face keeps its
    number in `Face.plane`.

    Raises
    ------
    ValueError
        When the solid would touch itself in an edge or a vertex, or a roof reaches down to its base.
    """
    rings = [[_nodes(ring) for ring in _oriented_rings(polygon)] for polygon, _ in faces]
    _leave_out_straight_nodes(rings)
    _add_crossing_nodes(rings, [plane for _, plane in faces])
    if any(_narrowest(face) < NARROWEST for face in rings):
        raise ValueError("a face is narrower somewhere than rounding allows")
    levels = _levels_at_nodes(rings, [plane for _, plane in faces])
    if min(level for stack in levels.values() for level in stack) < base + SAME_HEIGHT:
        raise ValueError("the roof reaches below the base of the solid")
    left = {edge: number for number, face in enumerate(rings) for edge in _edges(face)}
    numbers: dict[tuple[Node, float], int] = {}

    def vertex(node: Node, height: float) -> int:
        return numbers.setdefault((node, height), len(numbers))

    def roof(node: Node, face: int) -> float:
        height = _height(node, faces[face][1])
        return min(levels[node], key=lambda level: abs(level - height))

    def stack(node: Node, low: float, high: float) -> list[int]:
        between = [level for level in levels[node] if low < level < high]
        return [vertex(node, level) for level in sorted({low, high, *between})]

    result = []
    for number, face in enumerate(rings):
        shell = tuple(tuple(vertex(node, roof(node, number)) for node in ring) for ring in face)
        result.append(Face(shell, ROOF_SURFACE, number))
    outside: dict[Node, list[Node]] = {}
    for (p, q), number in left.items():
        beside = left.get((q, p))
        if beside is None:
            outside.setdefault(q, []).append(p)
        low = [base, base] if beside is None else [roof(p, beside), roof(q, beside)]
        high = [roof(p, number), roof(q, number)]
        if high[0] + high[1] > low[0] + low[1]:
            ring = stack(q, low[1], high[1]) + stack(p, low[0], high[0])[::-1]
            result.append(Face((tuple(ring),), WALL_SURFACE))
    result.append(Face(_ground_rings(outside, base, vertex), GROUND_SURFACE))
    vertices = np.array([(n[0] * COORDINATE_STEP, n[1] * COORDINATE_STEP, z) for n, z in numbers])
    solid = Solid.of(vertices, result)
    _refuse_unless_closed(solid)
    return solid


def _oriented_rings(polygon: Polygon) -> list[shapely.LinearRing]:
    turned = shapely.orient_polygons(polygon)
    return [turned.exterior, *turned.interiors]


def _nodes(ring: shapely.LinearRing) -> Ring:
    steps = np.round(shapely.get_coordinates(ring)[:-1] / COORDINATE_STEP).astype(np.int64)
    return [(int(x), int(y)) for x, y in steps]


def _edges(rings: list[Ring]) -> list[tuple[Node, Node]]:
    return [edge for ring in rings for edge in zip(ring, ring[1:] + ring[:1], strict=True)]


def _narrowest(face: list[Ring]) -> float:
    """The least distance (m) of a corner of a face from another corner or edge of it; 0 without area."""
    if any(len(ring) < 3 for ring in face):
        return 0.0
    edges = np.array(_edges(face), np.float64) * COORDINATE_STEP
    start, along = edges[:, 0], edges[:, 1] - edges[:, 0]
    towards = start[:, None] - start
    length = np.maximum((along**2).sum(axis=1), COORDINATE_STEP**2)
    share = np.clip((towards * along).sum(axis=2) / length, 0.0, 1.0)
    distance = np.linalg.norm(towards - share[..., None] * along, axis=2)
    corners = [corner for ring in face for corner in ring]
    after = [corner for ring in face for corner in ring[1:] + ring[:1]]
    place = {corner: number for number, corner in enumerate(corners)}
    number = np.arange(len(corners))
    distance[number, number] = np.inf
    distance[[place[corner] for corner in after], number] = np.inf
    return float(min(distance.min(), np.sqrt(length.min())))


def _height(node: Node, plane: Plane) -> float:
    return plane[0] * node[0] * COORDINATE_STEP + plane[1] * node[1] * COORDINATE_STEP + plane[2]


def _leave_out_straight_nodes(rings: list[list[Ring]]) -> None:
    """Take out, in place, nodes inside a straight edge at which no third face begins."""
    degree = Counter(
        node for edge in {tuple(sorted(e)) for face in rings for e in _edges(face)} for node in edge
    )
    for face in rings:
        for number, ring in enumerate(face):
            bends = [
                node
                for before, node, after in zip(ring[-1:] + ring[:-1], ring, ring[1:] + ring[:1], strict=True)
                if degree[node] > 2 or not _straight(before, node, after)
            ]
            face[number] = bends


def _straight(p: Node, q: Node, r: Node) -> bool:
    """True if q lies on the segment from p to r, within two coordinate steps, as snap rounding moves it."""
    ux, uy, vx, vy = r[0] - p[0], r[1] - p[1], q[0] - p[0], q[1] - p[1]
    return abs(ux * vy - uy * vx) <= 2 * np.hypot(ux, uy) and ux * (r[0] - q[0]) + uy * (r[1] - q[1]) > 0


def _add_crossing_nodes(rings: list[list[Ring]], planes: list[Plane]) -> None:
    """Put a node, in place, where the roofs on the two sides of an edge change order."""
    left = {edge: number for number, face in enumerate(rings) for edge in _edges(face)}
    inserted: dict[tuple[Node, Node], Node] = {}
    for (p, q), number in left.items():
        beside = left.get((q, p))
        if beside is None or (q, p) in inserted:
            continue
        first = _height(p, planes[number]) - _height(p, planes[beside])
        last = _height(q, planes[number]) - _height(q, planes[beside])
        if min(first, last) < -SAME_HEIGHT and max(first, last) > SAME_HEIGHT:
            share = first / (first - last)
            middle = round(p[0] + share * (q[0] - p[0])), round(p[1] + share * (q[1] - p[1]))
            inserted[p, q] = inserted[q, p] = middle
    for face in rings:
        for number, ring in enumerate(face):
            longer: Ring = []
            for edge in zip(ring, ring[1:] + ring[:1], strict=True):
                longer.append(edge[0])
                if edge in inserted:
                    longer.append(inserted[edge])
            face[number] = longer


def _levels_at_nodes(rings: list[list[Ring]], planes: list[Plane]) -> dict[Node, list[float]]:
    """The distinct heights of the roof at each node, in rising order."""
    raw: dict[Node, list[float]] = {}
    for face, plane in zip(rings, planes, strict=True):
        for ring in face:
            for node in ring:
                raw.setdefault(node, []).append(_height(node, plane))
    levels = {}
    for node, heights in raw.items():
        groups: list[list[float]] = []
        for height in sorted(heights):
            if groups and height - groups[-1][-1] < SAME_HEIGHT:
                groups[-1].append(height)
            else:
                groups.append([height])
        levels[node] = [round(float(np.mean(group)) / COORDINATE_STEP) * COORDINATE_STEP for group in groups]
    return levels


def _ground_rings(
    outside: dict[Node, list[Node]], base: float, vertex: Callable[[Node, float], int]
) -> tuple[tuple[int, ...], ...]:
    """The rings of the ground face, seen from below: the outer one, then the holes."""
    if any(len(after) > 1 for after in outside.values()):
        raise ValueError("the outline touches itself in a point")
    rings: list[Ring] = []
    unseen = set(outside)
    while unseen:
        ring = [min(unseen)]
        while (after := outside[ring[-1]][0]) != ring[0]:
            ring.append(after)
        unseen -= set(ring)
        rings.append(ring)
    rings.sort(key=_doubled_area)
    if _doubled_area(rings[0]) >= 0 or any(_doubled_area(ring) <= 0 for ring in rings[1:]):
        raise ValueError("the faces do not make one connected building")
    return tuple(tuple(vertex(node, base) for node in ring) for ring in rings)


def _doubled_area(ring: Ring) -> int:
    return sum(p[0] * q[1] - p[1] * q[0] for p, q in zip(ring, ring[1:] + ring[:1], strict=True))


def _refuse_unless_closed(solid: Solid) -> None:
    """ValueError when an edge is not between two faces, or a vertex not in one fan of faces."""
    after: dict[int, dict[int, int]] = {}
    for face in solid.faces:
        for ring in face.rings:
            for before, here, follow in zip(ring[-1:] + ring[:-1], ring, ring[1:] + ring[:1], strict=True):
                if follow in after.setdefault(here, {}):
                    raise ValueError("the solid touches itself along an edge")
                after[here][follow] = before
    for fan in after.values():
        start = next(iter(fan))
        steps, here = 1, fan[start]
        while here != start and here in fan and steps <= len(fan):
            here, steps = fan[here], steps + 1
        if here != start or steps != len(fan):
            raise ValueError("the solid is not closed, or touches itself in a vertex")
