"""A cross-section through a building: its points, the cut model and the terrain."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import shapely
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from eaves.model import Points, Values
from eaves.report.contents import Contents, finest_faces, read_contents

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
    near = (np.abs(aside) <= WIDTH / 2) & (np.abs(along) <= reach)
    heights = contents.points.xyz[:, 2] + contents.base
    classes = contents.points.classification
    for code, (name, colour) in [*COLOURS.items(), (None, OTHER)]:
        shown = near & (classes == code if code else ~np.isin(classes, list(COLOURS)))
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
    wanted = (contents.faces.building == building) == only
    faces = contents.faces.take(wanted & finest_faces(contents.faces))
    if not faces:
        return np.zeros((0, 2, 2))
    corners = faces.table.corners[faces.table.triangles()[0]]
    along, aside = place_on_line(corners, centre, direction)
    ends = []
    for one, two in ((0, 1), (1, 2), (2, 0)):
        here, there = aside[:, one], aside[:, two]
        crosses = (here < 0) != (there < 0)
        share = here / np.where(crosses, here - there, 1.0)
        place = along[:, one] + share * (along[:, two] - along[:, one])
        height = corners[:, one, 2] + share * (corners[:, two, 2] - corners[:, one, 2])
        ends.append(np.where(crosses[:, None], np.stack([place, height], axis=1), np.nan))
    crossing = np.stack(ends, axis=1)
    cut = np.isfinite(crossing[:, :, 0]).sum(axis=1) == 2
    pairs = crossing[cut]
    return np.asarray(pairs[np.isfinite(pairs[:, :, 0])].reshape(-1, 2, 2))
