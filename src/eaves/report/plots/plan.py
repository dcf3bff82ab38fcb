"""The plan: footprints and roof planes over the shaded surface."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyogrio
import shapely
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import hsv_to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from eaves.formats import read_polygons, read_raster
from eaves.model import Values
from eaves.report.contents import local_rings

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
    there = {line.get_color() for line in axes.lines}
    keys += [
        Line2D([], [], color=colour, linewidth=1, label=name)
        for name, colour in outlines.items()
        if colour in there
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
