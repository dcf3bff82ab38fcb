"""All models of a run seen obliquely, over the terrain and among the trees: a picture for print."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from eaves.formats.models.meshes import SURFACES
from eaves.model import Integers, Mask, Points, Values
from eaves.raster.grid import cell_centres
from eaves.report.contents import Contents, finest_faces, read_contents
from eaves.report.plots.plan import SUN_ALTITUDE_DEG, SUN_AZIMUTH_DEG

ROOF_COLOUR, WALL_COLOUR, EARTH_COLOUR, TREE_COLOUR = "#dd7a5b", "#f3eee4", "#cdd2b6", "#6f8f56"
FLAT_ROOF_COLOUR, EDGE_COLOUR = "#cdc7bc", "#4a4038"
AZIMUTH_DEG, ELEVATION_DEG = -30.0, 38.0
"""From where the models are seen: clockwise from south-on, and over the horizon."""
SLABS = 60
"""Number of layers by depth in which surfaces and points are drawn, the farthest first."""
POINTS_DRAWN = 120_000
PIECE = 5.0
"""Faces and edges are cut to pieces of this size (m): pieces are drawn by depth."""
SUNKEN = 0.3
"""Depth (m) of a piece's middle under the terrain from which it is left out."""
IN_FRONT = 1.0
"""Distance (m) by which edges are drawn nearer, so that the faces they bound do not cover them."""


def models_figure(folder: str | Path, size_inches: float) -> Figure:
    """The finest models of a run, seen from `AZIMUTH_DEG` and `ELEVATION_DEG`."""
    contents = read_contents(folder, points=POINTS_DRAWN)
    view = view_matrix(AZIMUTH_DEG, ELEVATION_DEG)
    corners, colours, points = drawn_scene(contents)
    finest = contents.faces.take(finest_faces(contents.faces))
    starts = finest.table.corners
    lines = cut_lines(np.stack([starts, starts[finest.table.following]], axis=1))
    lines = lines[over_terrain(contents, lines)]
    seen, spots, rims = corners @ view.T, points @ view.T, lines @ view.T
    rim_depth = rims[:, :, 2].mean(axis=1) + IN_FRONT
    depth = seen[:, :, 2].mean(axis=1)
    figure = Figure(figsize=(size_inches, size_inches))
    axes = figure.add_axes((0, 0, 1, 1))
    edges = np.quantile(depth, np.linspace(0, 1, SLABS + 1)) if len(depth) else np.zeros(2)
    edges[-1], first = np.inf, -np.inf
    for order, last in enumerate(edges[1:]):
        slab = np.flatnonzero((depth >= first) & (depth < last))
        slab = slab[np.argsort(depth[slab], kind="stable")]
        shades = colours[slab]
        axes.add_collection(
            PolyCollection(
                list(seen[slab][:, :, :2]),
                facecolors=shades,
                edgecolors=shades,
                linewidths=0.25,
                zorder=order,
            )
        )
        drawn = rims[(rim_depth >= first) & (rim_depth < last)]
        axes.add_collection(
            LineCollection(list(drawn[:, :, :2]), colors=EDGE_COLOUR, linewidths=0.3, zorder=order + 0.3)
        )
        among = (spots[:, 2] >= first) & (spots[:, 2] < last)
        x, y = spots[among, :2].T
        axes.scatter(x, y, s=1.1, c=TREE_COLOUR, linewidths=0, zorder=order + 0.5, rasterized=True)
        first = last
    everything = np.concatenate([seen.reshape(-1, 3), np.zeros((1, 3))])
    low, high = everything[:, :2].min(axis=0) - 2, everything[:, :2].max(axis=0) + 2
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    axes.set_axis_off()
    wide, tall = high - low
    figure.set_size_inches(size_inches, size_inches * float(tall / wide))
    return figure


def view_matrix(azimuth_deg: float, elevation_deg: float) -> Values:
    """Rows: right, up and towards the eye, of an eye south of the scene turned by `azimuth_deg`."""
    turn, tilt = np.radians(azimuth_deg), np.radians(elevation_deg)
    back = np.array([-np.sin(turn) * np.cos(tilt), -np.cos(turn) * np.cos(tilt), np.sin(tilt)])
    right = np.array([np.cos(turn), -np.sin(turn), 0.0])
    return np.stack([right, np.cross(back, right), back])


def drawn_scene(contents: Contents) -> tuple[Points, Values, Points]:
    """Triangles (T, 3, 3) of terrain and finest models, their shaded colours (T, 3), and the points (N, 3) of
    trees."""
    faces = contents.faces.take(finest_faces(contents.faces))
    corner, face = faces.table.triangles()
    ground = terrain_triangles(contents)
    parts, whole = cut_triangles(faces.table.corners[corner])
    seen = over_terrain(contents, parts)
    parts, whole = parts[seen], whole[seen]
    corners = np.concatenate([parts, ground])
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    roof = faces.kind[face[whole]] == SURFACES.index("RoofSurface")
    steep = np.abs(normal[: len(roof), 2]) < np.cos(np.radians(5.0))
    base = np.empty((len(corners), 3))
    base[: len(roof)] = to_rgb(WALL_COLOUR)
    base[: len(roof)][roof] = to_rgb(FLAT_ROOF_COLOUR)
    base[: len(roof)][roof & steep] = to_rgb(ROOF_COLOUR)
    base[len(roof) :] = to_rgb(EARTH_COLOUR)
    azimuth, altitude = np.radians(SUN_AZIMUTH_DEG - 85.0), np.radians(SUN_ALTITUDE_DEG)
    sun = np.array([np.sin(azimuth) * np.cos(altitude), np.cos(azimuth) * np.cos(altitude), np.sin(altitude)])
    light = 0.8 + 0.26 * np.clip(normal @ sun, -0.8, 1.0)
    trees = (contents.points.building == 0) & np.isin(contents.points.classification, (1, 3, 4, 5))
    return corners, np.clip(base * light[:, None], 0, 1), contents.points.xyz[trees]


def over_terrain(contents: Contents, pieces: Points) -> Mask:
    """Mask (K,) of the pieces (K, corners, 3) not under the terrain, where sorting by depth could show
    them."""
    middle = pieces.mean(axis=1)
    if not contents.terrain.values.size or not len(pieces):
        return np.ones(len(pieces), bool)
    return np.asarray(~(middle[:, 2] < contents.terrain.at(middle) - SUNKEN))


def cut_triangles(corners: Points) -> tuple[Points, Integers]:
    """Triangles (T, 3, 3) halved across their longest side until it is short, and which each came from."""
    owner = np.arange(len(corners))
    done, origin = [np.zeros((0, 3, 3))], [np.zeros(0, np.int64)]
    while len(corners):
        sides = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
        small = sides.max(axis=1) <= PIECE
        done.append(corners[small])
        origin.append(owner[small])
        corners, owner, longest = corners[~small], owner[~small], sides[~small].argmax(axis=1)
        turned = np.take_along_axis(corners, ((longest[:, None] + np.arange(3)) % 3)[:, :, None], axis=1)
        one, two, far = turned[:, 0], turned[:, 1], turned[:, 2]
        middle = (one + two) / 2
        corners = np.concatenate([np.stack([one, middle, far], 1), np.stack([middle, two, far], 1)])
        owner = np.concatenate([owner, owner])
    return np.concatenate(done), np.concatenate(origin)


def cut_lines(ends: Points) -> Points:
    """Segments (E, 2, 3) cut into equal pieces no longer than `PIECE`."""
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    count = np.maximum(np.ceil(length / PIECE), 1).astype(np.int64)
    owner = np.repeat(np.arange(len(ends)), count)
    step = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    shares = np.stack([step, step + 1], axis=1) / count[owner][:, None]
    return np.asarray(ends[owner, :1] + shares[:, :, None] * (ends[owner, 1:] - ends[owner, :1]))


def terrain_triangles(contents: Contents) -> Points:
    """Two triangles (T, 3, 3) a cell of the drawn terrain, where all corners are known."""
    terrain = contents.terrain
    if min(terrain.shape) < 2:
        return np.zeros((0, 3, 3))
    grid = np.dstack([cell_centres(terrain).reshape(*terrain.shape, 2), terrain.values])
    a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[:-1, 1:], grid[1:, 1:]
    both = np.stack([np.stack([a, b, c], axis=2), np.stack([c, b, d], axis=2)], axis=2).reshape(-1, 3, 3)
    return np.asarray(both[np.isfinite(both).all(axis=(1, 2))])
