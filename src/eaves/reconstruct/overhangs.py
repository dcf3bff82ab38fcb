"""LoD 2.3: where the walls stand under a roof, and the solid with its overhangs and undersides."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.special import bdtrc
from shapely import Polygon

from eaves.figures.attributes import LEAST_SHOWN, surface_heights
from eaves.geometry.face_table import FaceTable
from eaves.geometry.neighbours import measure_spacing
from eaves.model import OVERHANGS, WALL_SURFACE, Bounds, BuildingModel, Mask, Points, Solid, Values
from eaves.model.checks import as_points, check_type
from eaves.solids.coverage import MOST_ROUNDS
from eaves.solids.undersides import RoofPlan, build_overhanging, walls_inside

SOURCE = "2.2"
"""The level that is given its overhangs."""
WALL, OPEN, UNKNOWN = "seen", "open", "unknown"
"""State of the building under an edge of its roof."""
FEWEST_IN_STRIP = 4
"""Fewer points in a strip say nothing: three lie in it by chance."""


@dataclass(frozen=True)
class OverhangRules:
    """Limits by which a wall under a roof is seen, or that there is none.

    The limits are sizes of buildings and of errors in a scan, not of one survey: dwellings overhang by 0.2 to
    1 m, farms by up to 1.5 m.
    """

    widest: float = 1.5
    """Walls are looked for up to this far (m) inside the edge of the roof; lower roofs have no room below."""
    window: float = 0.2
    """Points of one wall lie in a strip this wide (m): relief of a wall, and noise of a scan in plan; nearer
    than this to the underside they are of the roof's edge or gutter. Overhangs of less than half of it are
    not built."""
    thickness: float = 0.25
    """Upright thickness (m) of a roof at its edge, which no scan from above shows: rafter, boards, tiles."""
    certainty: float = 0.85
    """Least certainty of a wall: one less the chance that as many of the points strewn there would lie in one
    strip of three, as four of four do."""
    spread: float = 0.25
    """Share of an edge along which its wall's points lie, at least: a post or a shrub is no wall."""

    @property
    def beside(self) -> float:
        """Distance (m) of the middle of a strip from the far side of the next: walls are looked for so far
        outside an edge, too, for outlines and wall points are both uncertain."""
        return 1.5 * self.window

    @property
    def above_ground(self) -> float:
        """Points lower than this (m) over the terrain are ground, kerbs, low plants."""
        return 2.0 * self.window

    @property
    def open_depth(self) -> float:
        """Ground seen farther (m) than this, three strips, inside an edge without a wall lies under a roof
        without walls."""
        return 2.0 * self.beside


@dataclass(frozen=True)
class Overhang:
    """The wall under one edge of a roof, or that there is none.

    Parameters
    ----------
    start, end : (float, float)
        The edge in plan (local m), the building to its left.
    kind : str
        `seen`, `open` or `unknown`.
    width : float or None
        Distance (m) by which the roof reaches beyond the wall; None where no wall is seen.
    certainty : float
        Of the kind, 0 to 1.
    points : int
        Points that show it.

    Examples
    --------
    >>> from eaves.reconstruct.overhangs import Overhang
    >>> Overhang((0.0, 0.0), (8.0, 0.0), "seen", 0.52, 0.99, 14).length
    8.0
    """

    start: tuple[float, float]
    end: tuple[float, float]
    kind: str
    width: float | None
    certainty: float
    points: int

    @property
    def length(self) -> float:
        """Of the edge (m)."""
        return float(np.hypot(self.end[0] - self.start[0], self.end[1] - self.start[1]))


def measure_overhangs(
    solids: tuple[Solid, ...],
    outline: Polygon,
    points: Points,
    over_ground: Values,
    rules: OverhangRules | None = None,
) -> list[Overhang]:
    """The walls that points show under each edge of a roof's outline, in the order of its rings.

    A wall is an upright strip of points below the roof and along its edge. Edges are taken from the surest
    down; the points of a wall that is found are no longer evidence for its neighbours, whose strips it
    crosses. An edge without a wall is open where the ground is seen under the roof, and else unknown; where
    no wall is seen at any edge, those points of all edges count together.

    Parameters
    ----------
    solids : tuple of Solid
        The building with walls under the edges of its roof (LoD 2.2).
    outline : shapely.Polygon
        The outline of the roof, counter-clockwise.
    points : ndarray (N, 3)
        All points of the scan there, those below the roof as well.
    over_ground : ndarray (N,)
        Their heights (m) above the terrain.
    rules : OverhangRules or None
        The limits; None takes the defaults.

    Returns
    -------
    list of Overhang
        One for each edge.

    Examples
    --------
    >>> import numpy as np, shapely
    >>> from eaves.reconstruct.overhangs import measure_overhangs
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> house = nine_roofs_on_a_slope(density=1.0).buildings[0].model()
    >>> none = measure_overhangs(house.solids["2.2"], house.footprint.polygon, np.zeros((0, 3)), np.zeros(0))
    >>> {edge.kind for edge in none}
    {'unknown'}
    """
    rules = rules or OverhangRules()
    start, end = edges_inward(outline)
    around = Bounds(*outline.bounds).buffered(rules.beside + rules.window).contains(points)
    points, over_ground = points[around], over_ground[around]
    over, below = depth_below(solids, outline, points, rules)
    upright = below & (over_ground > rules.above_ground)
    wall, passing = points[upright], points[below & ~upright & (over > rules.widest)]
    overhangs = find_walls(start, end, wall, rules)
    along, depth, length = edge_frames(start, end, passing)
    beneath = shapely.contains_xy(outline, passing[:, 0], passing[:, 1])
    roof = points[shapely.contains_xy(outline, points[:, 0], points[:, 1]) & (np.abs(over) < rules.thickness)]
    if len(roof) and len(passing):
        beneath &= cKDTree(roof[:, :2]).query(passing[:, :2])[0] <= measure_spacing(roof)
    edge_of = nearest_edge(start, end, passing)
    unseen = [edge for edge in range(len(start)) if edge not in overhangs]
    deep = {edge: beneath & (edge_of == edge) & (depth[edge] > rules.open_depth) for edge in unseen}
    # a roof none of whose walls is seen stands free when its edges together show the ground below, and more
    # of it than of what may be a wall; a single point may be an error
    within = wall[shapely.contains_xy(outline, wall[:, 0], wall[:, 1]), :2]
    hanging = int((shapely.distance(outline.exterior, shapely.points(within)) > rules.beside).sum())
    free = not overhangs and sum(int(members.sum()) for members in deep.values()) >= max(2, hanging + 1)
    for edge, members in deep.items():
        count = int(members.sum())
        extent = float(np.ptp(along[edge][members])) if count else 0.0
        is_open = count >= FEWEST_IN_STRIP and extent >= LEAST_SHOWN * length[edge]
        is_open = is_open or (free and count > 0)
        kind, certainty = (OPEN, 1.0 - 0.5**count) if is_open else (UNKNOWN, 0.0)
        overhangs[edge] = Overhang(*ends_of(start, end, edge), kind, None, certainty, count)
    return [overhangs[edge] for edge in range(len(start))]


def find_walls(
    start: NDArray[np.float64],
    end: NDArray[np.float64],
    wall: Points,
    rules: OverhangRules,
) -> dict[int, Overhang]:
    """The edges (E, 2) under which upright points (N, 3) below the roof show a wall."""
    along, inside, length = edge_frames(start, end, wall)
    around = (along > 0.0) & (along < length[:, None])
    candidates = around & (inside > -rules.beside) & (inside < rules.widest)
    walls: dict[int, Overhang] = {}
    edges = set(range(len(start)))
    while edges:
        strips = [
            (
                edge,
                *find_strip(inside[edge], along[edge], candidates[edge], around[edge], length[edge], rules),
            )
            for edge in edges
        ]
        edge, certainty, width, count = max(
            strips, key=lambda one: (one[1] >= rules.certainty, one[1] * one[3], -one[0])
        )
        if certainty < rules.certainty:
            break
        edges.discard(edge)
        walls[edge] = Overhang(*ends_of(start, end, edge), WALL, max(width, 0.0), certainty, count)
        strip = candidates[edge] & (np.abs(inside[edge] - width) <= 0.5 * rules.window)
        candidates[:, strip] = False
        around[:, strip] = False
    return walls


def ends_of(
    start: NDArray[np.float64], end: NDArray[np.float64], edge: int
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Start and end of an edge of those from `start` to `end` (E, 2)."""
    (x, y), (u, v) = start[edge].tolist(), end[edge].tolist()
    return (x, y), (u, v)


def edges_inward(outline: Polygon) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Start and end (E, 2) of the edges of an outline, the inside to their left, ring by ring."""
    starts, ends = [], []
    for ring in [outline.exterior, *outline.interiors]:
        places = shapely.get_coordinates(ring)
        starts.append(places[:-1])
        ends.append(places[1:])
    return np.concatenate(starts), np.concatenate(ends)


def depth_below(
    solids: tuple[Solid, ...], outline: Polygon, points: Points, rules: OverhangRules
) -> tuple[Values, Mask]:
    """Depth (N,; m) of points (N, 3) below the roof over or beside them, and mask (N,) of those clearly below
    the underside of the roof.
    """
    if len(points) == 0:
        return np.zeros(0), np.zeros(0, bool)
    places = points[:, :2].copy()
    outer = ~shapely.contains_xy(outline, places[:, 0], places[:, 1])
    if outer.any():  # the roof beside a point outside is that of the nearest place just inside
        inner = shapely.buffer(outline, -0.02, join_style="mitre")
        nearest = shapely.shortest_line(
            shapely.points(places[outer]), inner if not inner.is_empty else outline
        )
        places[outer] = shapely.get_coordinates(shapely.get_point(nearest, 1))
    below = np.nan_to_num(surface_heights(solids, places)[0] - points[:, 2])
    return below, np.asarray(below > rules.thickness + rules.window)


def edge_frames(
    start: NDArray[np.float64], end: NDArray[np.float64], points: Points
) -> tuple[NDArray[np.float64], NDArray[np.float64], Values]:
    """Distance (E, N; m) of points (N, 3) along and to the left of edges (E, 2), and the edges' lengths."""
    step = end - start
    length = np.hypot(step[:, 0], step[:, 1])
    ways = step / length[:, None]
    away = points[None, :, :2] - start[:, None]
    along = away[..., 0] * ways[:, None, 0] + away[..., 1] * ways[:, None, 1]
    inside = ways[:, None, 0] * away[..., 1] - ways[:, None, 1] * away[..., 0]
    return along, inside, length


def nearest_edge(start: NDArray[np.float64], end: NDArray[np.float64], points: Points) -> NDArray[np.int64]:
    """The edge (N,) nearest to each point (N, 3) in plan."""
    if len(points) == 0:
        return np.zeros(0, np.int64)
    lines = shapely.linestrings(np.stack([start, end], axis=1))
    return np.asarray(shapely.STRtree(lines).nearest(shapely.points(points[:, :2])), np.int64)


def find_strip(
    inside: Values, along: Values, candidates: Mask, around: Mask, length: float, rules: OverhangRules
) -> tuple[float, float, int]:
    """Certainty, place (m inside the edge) and points of the fullest strip, among the `candidates` (N,).

    The certainty is one less the chance that so many of the points in the strip and in those beside it, some
    of which may lie outside what is searched, fall into the strip: a crown fills all three.
    """
    places = np.sort(inside[candidates])
    last = np.searchsorted(places, places + rules.window, side="right")
    first = int(np.argmax(last - np.arange(len(places)))) if len(places) else 0
    inner = places[first : last[first]] if len(places) else places
    if len(inner) < FEWEST_IN_STRIP:
        return 0.0, 0.0, len(inner)
    middle = float(np.median(inner))
    strip = candidates & (np.abs(inside - middle) <= 0.5 * rules.window)
    if not strip.any() or np.ptp(along[strip]) < rules.spread * length:
        return 0.0, middle, len(inner)
    beside = around & (np.abs(inside - middle) <= rules.beside)
    places_tried = (rules.widest + rules.beside) / rules.window
    chance = min(1.0, places_tried * float(bdtrc(strip.sum() - 1, beside.sum(), 1.0 / 3.0)))
    return 1.0 - chance, middle, len(inner)


def add_overhangs(
    model: BuildingModel, points: Points, over_ground: Values, rules: OverhangRules | None = None
) -> BuildingModel:
    """The model with LoD 2.3 beside its coarser levels, where points show its walls or that it has none.

    The solid of LoD 2.2 keeps its roof. Its walls move in by what they were measured to stand back, the rest
    stay under the edge of the roof and are marked unknown. A free-standing roof becomes a slab. Where LoD 2.3
    cannot be had the attributes `fallback_code` and `fallback_reason` say why.

    Parameters
    ----------
    model : BuildingModel
        With LoD 2.2.
    points : ndarray (N, 3) of float64
        All points of the scan in and around its footprint, in its local metres.
    over_ground : ndarray (N,)
        Their heights (m) above the terrain.
    rules : OverhangRules or None
        The limits; None takes the defaults.

    Returns
    -------
    BuildingModel
        With the attributes `overhang_m`, `overhang_known_share`, `open_share`, `stands_free` and `overhangs`,
        one entry an edge.

    Raises
    ------
    TypeError
        When `model` is no BuildingModel, or `points` no float64 array.
    ValueError
        When `points` has another shape.

    Examples
    --------
    >>> import numpy as np
    >>> from eaves.reconstruct import add_overhangs
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> house = nine_roofs_on_a_slope(density=1.0).buildings[0].model()
    >>> add_overhangs(house, np.zeros((0, 3)), np.zeros(0)).attributes["fallback_code"]
    'walls_unseen'
    """
    check_type(model, BuildingModel, "model", "give the result of reconstruct_building that is no Failure")
    points = as_points(points)
    rules = rules or OverhangRules()
    if SOURCE not in model.solids:
        return model
    built: list[Solid] = []
    edges: list[Overhang] = []
    for solid in model.solids[SOURCE]:
        roof = RoofPlan.of(solid)
        outline = roof.outline
        if not isinstance(outline, Polygon):
            return without_overhangs(model, edges, "not_closed", "its roof is no single area in plan")
        overhangs = measure_overhangs((solid,), outline, points, over_ground, rules)
        parts, overhangs = build_part(roof, outline, overhangs, rules)
        if not parts:
            return without_overhangs(model, edges, "not_closed", "LoD 2.3 cannot be drawn")
        built += [number_walls(part, overhangs, len(edges), roof.base) for part in parts]
        edges += overhangs
    if all(edge.kind == UNKNOWN for edge in edges):
        return without_overhangs(
            model, edges, "walls_unseen", "no wall is seen under its roof, and no ground"
        )
    solids = {**model.solids, OVERHANGS: tuple(built)}
    return model.with_(
        solids=solids, attributes={**model.attributes, **describe_overhangs(edges), "lod": OVERHANGS}
    )


def build_part(
    roof: RoofPlan, outline: Polygon, edges: list[Overhang], rules: OverhangRules
) -> tuple[tuple[Solid, ...], list[Overhang]]:
    """The solids of one roof over its walls, and what is known of its edges; where the solid would touch
    itself the nearest wall stays under the edge.
    """
    if stands_free(edges):
        parts, touching = build_overhanging(roof, Polygon(), rules.thickness)
        return (parts, edges) if len(touching) == 0 else ((), edges)
    width = np.array([edge.width if edge.width is not None else 0.0 for edge in edges])
    width[width < 0.5 * rules.window] = 0.0
    lines = shapely.linestrings([[edge.start, edge.end] for edge in edges])
    for _ in range(MOST_ROUNDS):
        walls = walls_inside(outline, width.tolist())
        parts, touching = build_overhanging(roof, walls, rules.thickness)
        if (parts and len(touching) == 0) or not width.any():
            return parts, edges
        moved = np.flatnonzero(width > 0.0)
        if not parts:
            width[moved[np.argmin(width[moved])]] = 0.0
            continue
        nearest = shapely.STRtree(lines[moved]).nearest(shapely.points(touching))
        width[moved[np.unique(nearest)]] = 0.0
    return (), edges


def number_walls(solid: Solid, edges: list[Overhang], first: int, base: float) -> Solid:
    """The solid whose walls on the `base` (m) refer to the edge they stand under, counted from `first`."""
    start, end = (np.array([getattr(edge, side) for edge in edges]) for side in ("start", "end"))
    width = np.array([edge.width or 0.0 for edge in edges])
    table = FaceTable.of_solids([solid])
    low = np.flatnonzero((solid.surfaces == WALL_SURFACE) & (table.heights[0] <= base))
    if len(low) == 0:
        return solid
    middles = table.ring_figures[1][table.outer[low]]
    along, inside, length = edge_frames(start, end, middles)
    aside = np.minimum(np.abs(inside - width[:, None]), np.abs(inside))
    aside += np.maximum(np.maximum(-along, along - length[:, None]), 0.0)
    planes = solid.planes.copy()
    planes[low] = first + np.argmin(aside, axis=0)
    return replace(solid, planes=planes)


def stands_free(edges: list[Overhang]) -> bool:
    """True if a roof has open sides and no wall at all."""
    kinds = {edge.kind for edge in edges}
    return OPEN in kinds and WALL not in kinds


def describe_overhangs(edges: list[Overhang]) -> dict[str, Any]:
    """The attributes that tell of the overhangs of a building."""
    perimeter = sum(edge.length for edge in edges)
    walls = [edge for edge in edges if edge.width is not None]
    measured = sum(edge.length for edge in walls)
    mean = sum(edge.length * (edge.width or 0.0) for edge in walls) / measured if measured else None
    records = [
        {
            "wall": edge.kind,
            "overhang_m": None if edge.width is None else round(edge.width, 3),
            "wall_certainty": round(edge.certainty, 3),
            "wall_points": edge.points,
        }
        for edge in edges
    ]
    return {
        "overhang_m": None if mean is None else round(mean, 3),
        "overhang_known_share": round(measured / perimeter, 3) if perimeter else 0.0,
        "open_share": round(sum(edge.length for edge in edges if edge.kind == OPEN) / perimeter, 3)
        if perimeter
        else 0.0,
        "stands_free": stands_free(edges),
        "overhangs": records,
    }


def without_overhangs(model: BuildingModel, edges: list[Overhang], code: str, reason: str) -> BuildingModel:
    """The model as it is, with the reason why it has no LoD 2.3."""
    facts = describe_overhangs(edges) if edges else {}
    why = {"fallback_code": code, "fallback_reason": reason}
    return replace(model, attributes={**model.attributes, **facts, **why})
