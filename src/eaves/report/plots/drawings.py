"""The pictures of a run: its plan, the map of its errors, a section, all models seen obliquely."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import shapely
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import ListedColormap, hsv_to_rgb, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from eaves.formats import read_polygons, read_raster
from eaves.formats.models.meshes import SURFACES
from eaves.model import Integers, Mask, Points, Raster, Values
from eaves.raster.grid import (
    FALSE_NEGATIVE,
    FALSE_POSITIVE,
    TRUE_POSITIVE,
    UNKNOWN,
    agreement_codes,
    cell_centres,
    rasterize,
)
from eaves.report.contents import Contents, finest_faces, local_rings, read_contents

SUN_AZIMUTH_DEG, SUN_ALTITUDE_DEG = 315.0, 45.0
"""Light from the north-west, half-way up: the cartographer's habit."""
DARKEST = -0.9
"""The shade that would be black: shadows stay pale, so that what is drawn over them can be read."""
DIRECTIONS = ("N", "NE", "E", "SE", "S", "SW", "W", "NW")


def hillshade(heights: NDArray[np.float32], cell: float) -> Values:
    """Hillshade (H, W) in 0 to 1 of a raster with row 0 north; NaN where the heights are."""
    padded = np.pad(heights.astype(np.float64), 1, mode="edge")
    down = np.gradient(padded, cell, axis=0)[1:-1, 1:-1]
    east = np.gradient(padded, cell, axis=1)[1:-1, 1:-1]
    azimuth, altitude = np.radians(SUN_AZIMUTH_DEG), np.radians(SUN_ALTITUDE_DEG)
    light: Values = np.array(
        [np.sin(azimuth) * np.cos(altitude), np.cos(azimuth) * np.cos(altitude), np.sin(altitude)]
    )
    bright = (-east * light[0] + down * light[1] + light[2]) / np.sqrt(1 + east**2 + down**2)
    return np.asarray(np.clip(bright, 0, 1))


def face_colour(slope_deg: float, azimuth_deg: float | None) -> Values:
    """Hue by azimuth, paler the flatter: faces that look alike face alike."""
    if azimuth_deg is None:
        return np.array([0.85, 0.85, 0.85])
    return np.asarray(hsv_to_rgb([azimuth_deg / 360.0, min(0.62, 0.2 + slope_deg / 90.0), 0.93]))


def draw_shade(axes: Axes, path: Path) -> None:
    """Draw the hillshade of a raster in world metres; nothing where the file is not there."""
    if not path.exists():
        return
    raster, _ = read_raster(path)
    bounds = raster.bounds
    axes.imshow(
        hillshade(raster.values, raster.cell),
        cmap="gray",
        extent=(bounds.west, bounds.east, bounds.south, bounds.north),
        vmin=DARKEST,
        vmax=1,
        interpolation="nearest",
    )


def draw_run_plan(axes: Axes, folder: Path) -> None:
    """Draw a run's plan into axes, in metres of its reference system."""
    draw_shade(axes, folder / "dsm.tif")
    if has_layer(folder / "footprints.gpkg", "roof_planes"):
        faces, _, rows, _ = read_polygons(folder / "footprints.gpkg", layer="roof_planes")
        rings = [shapely.get_coordinates(polygon.exterior) for polygon in faces]
        colours = [face_colour(row["slope_deg"], row["azimuth_deg"]) for row in rows]
        axes.add_collection(
            PolyCollection(rings, facecolors=colours, edgecolors="0.3", linewidths=0.3, alpha=0.85)
        )
    prints, _, rows, _ = read_polygons(folder / "footprints.gpkg", layer="footprints")
    for polygon, row in zip(prints, rows, strict=True):
        colour = (
            "black"
            if row.get("lod") in ("2.2", "2.3")
            else "tab:red"
            if row.get("lod") is None
            else "tab:blue"
        )
        for ring in local_rings(polygon):
            axes.plot(*np.vstack([ring, ring[:1]]).T, color=colour, linewidth=0.7)
    axes.set_xlabel("east (m)", fontsize=7)
    axes.set_ylabel("north (m)", fontsize=7)


def has_layer(path: Path, name: str) -> bool:
    """True if a GeoPackage has a layer with anything in it."""
    layers = [str(layer) for layer, _ in pyogrio.list_layers(path)]
    return name in layers and pyogrio.read_info(path, layer=name)["features"] > 0


def plan_figure(folder: str | Path, size_inches: float = 9.0) -> Figure:
    """A run's plan: roof faces coloured by azimuth, outlines black (LoD 2.2), blue (coarser), red (none)."""
    figure = Figure(figsize=(size_inches, size_inches), layout="constrained")
    axes = figure.subplots()
    draw_run_plan(axes, Path(folder))
    keys: list[Artist] = [
        Patch(facecolor=face_colour(45.0, 45.0 * k), edgecolor="0.3", linewidth=0.3, label=f"faces {name}")
        for k, name in enumerate(DIRECTIONS)
    ]
    keys.append(Patch(facecolor=face_colour(0.0, None), edgecolor="0.3", linewidth=0.3, label="flat"))
    outlines = {"LoD 2.2": "black", "coarser": "tab:blue", "no model": "tab:red"}
    colours = {line.get_color() for line in axes.lines}
    keys += [
        Line2D([], [], color=colour, linewidth=1, label=name)
        for name, colour in outlines.items()
        if colour in colours
    ]
    return finished_map(axes, keys, 6, 7, size_inches)


def finished_map(
    axes: Axes, keys: Sequence[Artist], columns: int, fontsize: int, size_inches: float
) -> Figure:
    """The figure of a map that is drawn in the axes: true to scale, with its keys in columns below."""
    figure = axes.figure
    assert isinstance(figure, Figure)
    axes.set_aspect("equal")
    axes.ticklabel_format(style="plain", useOffset=False)
    axes.tick_params(labelsize=6)
    figure.legend(handles=keys, loc="outside lower center", ncols=columns, frameon=False, fontsize=fontsize)
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    shape = (north - south) / (east - west) if east > west else 1.0
    figure.set_size_inches(size_inches, size_inches * min(1.6, max(0.4, shape)))
    return figure


KINDS = {
    TRUE_POSITIVE: ("found", "#3d9a50"),
    FALSE_NEGATIVE: ("missed", "#2f6fd6"),
    FALSE_POSITIVE: ("false", "#d0302f"),
    UNKNOWN: ("unknown", "#c8c8c8"),
}
"""Name and colour (distinct for the colour-blind too) of each value of the map of agreement."""


def agreement(folder: Path, reference: Path) -> Raster:
    """The map of agreement of a run with a reference: polygons, or the map of `eaves evaluate detection`.

    Cells hold 0 or one of `KINDS`; polygons are compared with the run's mask.tif.
    """
    if reference.suffix.lower() in (".tif", ".tiff"):
        labels, system = read_raster(reference)
        codes = np.round(labels.values / np.float32(system.vertical_unit_m))  # codes are no heights
        return Raster(codes, labels.west, labels.north, labels.cell)
    mask, system = read_raster(folder / "mask.tif")
    true = rasterize(read_polygons(reference, target=system)[0], mask.bounds, mask.cell).values > 0
    values = agreement_codes(mask.values > 0, true)
    return Raster(values.astype(np.float32), mask.west, mask.north, mask.cell)


def errors_figure(folder: str | Path, reference: str | Path, size_inches: float = 9.0) -> Figure:
    """The map of agreement over the shaded surface, with each area's size in the legend."""
    folder = Path(folder)
    agreement_map = agreement(folder, Path(reference))
    figure = Figure(figsize=(size_inches, size_inches), layout="constrained")
    axes = figure.subplots()
    draw_shade(axes, folder / "dsm.tif")
    bounds = agreement_map.bounds
    handles = []
    for value, (name, colour) in KINDS.items():
        cells: NDArray[np.bool_] = agreement_map.values == value
        if not cells.any():
            continue
        axes.imshow(
            np.ma.masked_where(~cells, cells),
            cmap=ListedColormap([colour]),
            extent=(bounds.west, bounds.east, bounds.south, bounds.north),
            alpha=0.8,
            interpolation="nearest",
        )
        area = np.count_nonzero(cells) * agreement_map.cell**2
        handles.append(Patch(color=colour, label=f"{name} {area:,.0f} m²"))
    axes.set_xlim(bounds.west, bounds.east)
    axes.set_ylim(bounds.south, bounds.north)
    return finished_map(axes, handles, 4, 8, size_inches)


WIDTH = 1.0
SURROUNDINGS = 8.0
"""Distance (m) by which a section goes on beyond the building."""
COLOURS = {2: ("ground", "#a9824f"), 6: ("building", "#d0563b")}
OTHER = ("other", "#7f9a63")


def section_figure(folder: str | Path, building: str | None, size_inches: float) -> Figure:
    """A section across a building (the largest with a model for None), with the points of a strip `WIDTH` (m)
    wide.

    It goes through the middle, across the longer side of the building's smallest rectangle, where a ridge
    shows.

    Raises
    ------
    ValueError
        When the run has no such building.
    """
    contents = read_contents(folder, points=3_000_000)
    number = choose_building(contents, building)
    centre, direction, reach = line_across(contents.polygons[number])
    figure = Figure(figsize=(size_inches, 0.55 * size_inches), layout="constrained")
    axes = figure.subplots()
    axes.set_aspect("equal")

    along, aside = place_on_line(contents.points.xyz, centre, direction)
    in_strip = (np.abs(aside) <= WIDTH / 2) & (np.abs(along) <= reach)
    heights = contents.points.xyz[:, 2] + contents.base
    classes = contents.points.classification
    for code, (name, colour) in [*COLOURS.items(), (None, OTHER)]:
        shown = in_strip & (classes == code if code else ~np.isin(classes, list(COLOURS)))
        if shown.any():
            axes.plot(along[shown], heights[shown], ".", color=colour, markersize=2.2, label=f"{name} points")
    for label, colour, thick, only in (("neighbours", "0.55", 0.9, False), ("model", "black", 1.6, True)):
        cuts = cut_models(contents, centre, direction, number, only)
        cuts = cuts[(np.abs(cuts[:, :, 0]) <= reach).all(axis=1)] + [0.0, contents.base]
        if len(cuts):
            axes.add_collection(LineCollection(list(cuts), colors=colour, linewidths=thick, label=label))
    if contents.terrain.values.size:
        steps = np.arange(-reach, reach, contents.terrain.cell / 2)
        ground = contents.terrain.at(centre + steps[:, None] * direction) + contents.base
        axes.plot(steps, ground, color="#6b4f2a", linewidth=0.9, linestyle="--", label="terrain", zorder=1)
    axes.set_xlim(-reach, reach)
    axes.margins(y=0.08)
    row: dict[str, Any] = contents.rows[number]
    axes.set_title(f"{row['id']}  LoD {row.get('lod') or 'none'}", fontsize=9)
    axes.set_xlabel("along the section (m)", fontsize=8)
    axes.set_ylabel("height (m)", fontsize=8)
    axes.tick_params(labelsize=7)
    figure.legend(loc="outside lower center", ncols=3, fontsize=7, frameon=False, markerscale=4)
    low, high = axes.get_ylim()
    figure.set_size_inches(size_inches, size_inches * min(1.2, 0.2 + (high - low) / (2 * reach)))
    return figure


def choose_building(contents: Contents, building: str | None) -> int:
    """The row of a building by its id; for None of the largest that has a model."""
    ids = [str(row["id"]) for row in contents.rows]
    if building is not None:
        if building not in ids:
            raise ValueError(f"{contents.folder}: no building has the id {building}; see footprints.gpkg")
        return ids.index(building)
    if not ids:
        raise ValueError(f"{contents.folder}: the run found no building to cut through")
    modelled = set(contents.faces.building.tolist())
    return max(range(len(ids)), key=lambda k: (k in modelled, float(shapely.area(contents.polygons[k]))))


def line_across(polygon: shapely.Polygon) -> tuple[Values, Values, float]:
    """Middle (2,), direction (2,) across the longer side, and half length (m) of the section of a polygon."""
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(polygon))[:4]
    sides = np.diff(corners[[0, 1, 2]], axis=0)
    lengths = np.hypot(*sides.T)
    short = int(np.argmin(lengths))
    middle = shapely.get_coordinates(shapely.point_on_surface(polygon))[0]
    return middle, np.asarray(sides[short] / lengths[short]), float(lengths[short] / 2 + SURROUNDINGS)


def place_on_line(xyz: Points, centre: Values, direction: Values) -> tuple[Values, Values]:
    """Distance (m) of points along a line from its middle, and to its left."""
    away = xyz[..., :2] - centre
    return away @ direction, away @ np.array([-direction[1], direction[0]])


def cut_models(
    contents: Contents,
    centre: Values,
    direction: Values,
    building: int,
    only: bool,
) -> Values:
    """Section of the finest models by the upright plane: segments (S, 2, 2) of (along, height), of the
    building alone or of all others."""
    selected = (contents.faces.building == building) == only
    faces = contents.faces.take(selected & finest_faces(contents.faces))
    if not faces:
        return np.zeros((0, 2, 2))
    corners = faces.table.corners[faces.table.triangles()[0]]
    along, aside = place_on_line(corners, centre, direction)
    ends = []
    for start, end in ((0, 1), (1, 2), (2, 0)):
        aside_start, aside_end = aside[:, start], aside[:, end]
        crosses = (aside_start < 0) != (aside_end < 0)
        share = aside_start / np.where(crosses, aside_start - aside_end, 1.0)
        place = along[:, start] + share * (along[:, end] - along[:, start])
        height = corners[:, start, 2] + share * (corners[:, end, 2] - corners[:, start, 2])
        ends.append(np.where(crosses[:, None], np.stack([place, height], axis=1), np.nan))
    crossing = np.stack(ends, axis=1)
    cut = np.isfinite(crossing[:, :, 0]).sum(axis=1) == 2
    pairs = crossing[cut]
    return np.asarray(pairs[np.isfinite(pairs[:, :, 0])].reshape(-1, 2, 2))


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
    projected, spots, rims = corners @ view.T, points @ view.T, lines @ view.T
    rim_depth = rims[:, :, 2].mean(axis=1) + IN_FRONT
    depth = projected[:, :, 2].mean(axis=1)
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
                list(projected[slab][:, :, :2]),
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
    everything = np.concatenate([projected.reshape(-1, 3), np.zeros((1, 3))])
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
    parts, source = cut_triangles(faces.table.corners[corner])
    visible = over_terrain(contents, parts)
    parts, source = parts[visible], source[visible]
    corners = np.concatenate([parts, ground])
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    roof = faces.kind[face[source]] == SURFACES.index("RoofSurface")
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
    pieces, origin = [np.zeros((0, 3, 3))], [np.zeros(0, np.int64)]
    while len(corners):
        sides = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
        small = sides.max(axis=1) <= PIECE
        pieces.append(corners[small])
        origin.append(owner[small])
        corners, owner, longest = corners[~small], owner[~small], sides[~small].argmax(axis=1)
        turned = np.take_along_axis(corners, ((longest[:, None] + np.arange(3)) % 3)[:, :, None], axis=1)
        start, end, far = turned[:, 0], turned[:, 1], turned[:, 2]
        middle = (start + end) / 2
        corners = np.concatenate([np.stack([start, middle, far], 1), np.stack([middle, end, far], 1)])
        owner = np.concatenate([owner, owner])
    return np.concatenate(pieces), np.concatenate(origin)


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
    pairs = np.stack([np.stack([a, b, c], axis=2), np.stack([c, b, d], axis=2)], axis=2).reshape(-1, 3, 3)
    return np.asarray(pairs[np.isfinite(pairs).all(axis=(1, 2))])
