"""The plan: footprints and roof planes over the shaded terrain."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import hsv_to_rgb
from matplotlib.figure import Figure
from numpy.typing import NDArray

from eaves.formats import read_polygons, read_raster

SUN_AZIMUTH_DEG, SUN_ALTITUDE_DEG = 315.0, 45.0
"""Light from the north-west, half-way up: the cartographer's habit."""


def shade(heights: NDArray[np.float32], cell: float) -> NDArray[np.float64]:
    """Hillshade (H, W) in 0 to 1 of a raster with row 0 north; NaN where the heights are."""
    padded = np.pad(heights.astype(np.float64), 1, mode="edge")
    down = np.gradient(padded, cell, axis=0)[1:-1, 1:-1]
    east = np.gradient(padded, cell, axis=1)[1:-1, 1:-1]
    azimuth, altitude = np.radians(SUN_AZIMUTH_DEG), np.radians(SUN_ALTITUDE_DEG)
    light: NDArray[np.float64] = np.array(
        [np.sin(azimuth) * np.cos(altitude), np.cos(azimuth) * np.cos(altitude), np.sin(altitude)]
    )
    bright = (-east * light[0] + down * light[1] + light[2]) / np.sqrt(1 + east**2 + down**2)
    return np.asarray(np.clip(bright, 0, 1))


def face_colour(slope_deg: float, azimuth_deg: float | None) -> NDArray[np.float64]:
    """Hue by azimuth, paler the flatter: faces that look alike face alike."""
    if azimuth_deg is None:
        return np.array([0.85, 0.85, 0.85])
    return np.asarray(hsv_to_rgb([azimuth_deg / 360.0, min(1.0, 0.25 + slope_deg / 60.0), 0.95]))


def draw_plan(axes: Axes, folder: Path, surface: str = "dsm") -> None:
    """Draw a run's plan into axes in the coordinates of its reference system."""
    raster, _ = read_raster(folder / f"{surface}.tif")
    bounds = raster.bounds
    axes.imshow(
        shade(raster.values, raster.cell),
        cmap="gray",
        extent=(bounds.west, bounds.east, bounds.south, bounds.north),
        vmin=0,
        vmax=1,
        interpolation="nearest",
    )
    faces, _, rows, _ = read_polygons(folder / "footprints.gpkg", layer="roof_planes")
    rings = [shapely.get_coordinates(polygon.exterior) for polygon in faces]
    colours = [face_colour(row["slope_deg"], row["azimuth_deg"]) for row in rows]
    axes.add_collection(
        PolyCollection(rings, facecolors=colours, edgecolors="0.3", linewidths=0.3, alpha=0.85)
    )
    prints, _, rows, _ = read_polygons(folder / "footprints.gpkg", layer="footprints")
    for polygon, row in zip(prints, rows, strict=True):
        colour = "black" if row.get("lod") == "2.2" else "tab:red" if row.get("lod") is None else "tab:blue"
        for ring in (polygon.exterior, *polygon.interiors):
            axes.plot(*ring.xy, color=colour, linewidth=0.7)
    axes.set_aspect("equal")
    axes.ticklabel_format(style="plain", useOffset=False)
    axes.tick_params(labelsize=6)


def plan_figure(folder: str | Path, size_inches: float = 9.0) -> Figure:
    """A run's plan: roof faces coloured by azimuth, outlines black (LoD 2.2), blue (coarser) or red
    (none)."""
    figure = Figure(figsize=(size_inches, size_inches), layout="constrained")
    draw_plan(figure.subplots(), Path(folder))
    return figure


def plot_plan(folder: str | Path, path: str | Path, dpi: int = 150) -> Path:
    """Save the plan of a run; PNG, SVG or PDF by the extension."""
    plan_figure(folder).savefig(path, dpi=dpi)
    return Path(path)
