"""changes.html: both epochs as shaded pictures under a slider, every building's outline, the table."""

from __future__ import annotations

import base64
import html
import warnings
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
import rasterio
import shapely
from numpy.typing import NDArray
from rasterio.enums import Resampling
from rasterio.errors import NotGeoreferencedWarning
from rasterio.io import MemoryFile
from rasterio.vrt import WarpedVRT
from rasterio.windows import from_bounds
from shapely import MultiPolygon, Polygon

from eaves.change.changes import Comparison
from eaves.change.epoch import Epoch
from eaves.change.output import as_text
from eaves.change.verdict import UNCHANGED, VERDICTS
from eaves.formats.atomic import atomic
from eaves.formats.crs import horizontal_crs
from eaves.model import Bounds
from eaves.model.columns import COLUMNS
from eaves.report.page_file import as_json

PIXELS = 1800
"""Longest side of the pictures."""

FINEST = 0.25
"""A pixel is at least so wide (m)."""

MARGIN = 20.0
"""Surroundings shown around the buildings (m)."""

SUN = np.array([-0.5, 0.5, 0.7071])
"""From the north-west, 45° high."""

SHOWN = (
    *(
        "id",
        "change",
        "also",
        "certainty",
        "height_difference_m",
        "volume_difference_m3",
        "built_m2",
        "gone_m2",
        "moved_m2",
    ),
    *("points_old", "points_new", "reason"),
)
"""Columns of the table."""

ROWS_SHOWN = 4_000
"""Of more buildings only those that changed are in the table, and outlined."""


def write_change_page(comparison: Comparison, folder: Path) -> Path:
    """Write changes.html into a folder; its path."""
    path = folder / "changes.html"
    with atomic(path) as temporary:
        temporary.write_text(render_changes(comparison), encoding="utf-8")
    return path


def render_changes(comparison: Comparison) -> str:
    """The page as text, with its style, script, pictures and data inside."""
    place = files("eaves.report").joinpath("page")
    changes = list(comparison.changes)
    if len(changes) > ROWS_SHOWN:
        changes = [one for one in changes if one.verdict.change != UNCHANGED][:ROWS_SHOWN]
    bounds = page_extent(comparison)
    pixel = max(FINEST, max(bounds.width, bounds.height) / PIXELS)
    pictures = [picture_of(epoch, comparison, bounds, pixel) for epoch in (comparison.old, comparison.new)]
    outlines: dict[str, list[dict[str, str]]] = {
        name: [
            {"id": one.id, "path": svg_path(shape, bounds)}
            for one in epoch.buildings
            for shape in [one.polygon]
        ]
        for name, epoch in (("old", comparison.old), ("new", comparison.new))
        if len(epoch.buildings) <= ROWS_SHOWN
    }
    data: dict[str, Any] = {
        "width": bounds.width,
        "height": bounds.height,
        "changes": [{**one.row, "path": svg_path(one.polygon, bounds)} for one in changes],
        "outlines": outlines,
        "columns": [[name, COLUMNS[name].label] for name in SHOWN],
        "verdicts": [name for name in VERDICTS if name in comparison.counts],
    }
    names = [html.escape(epoch.folder.resolve().name) for epoch in (comparison.old, comparison.new)]
    return Template(place.joinpath("changes.html").read_text("utf-8")).substitute(
        style=place.joinpath("style.css").read_text("utf-8"),
        script=place.joinpath("changes.js").read_text("utf-8"),
        summary=html.escape(as_text(comparison)).replace("\n", "<br>"),
        old_name=names[0],
        new_name=names[1],
        old_picture=pictures[0],
        new_picture=pictures[1],
        data=as_json(data),
    )


def page_extent(comparison: Comparison) -> Bounds:
    """World metres of all buildings, with a margin."""
    polygons = [change.polygon for change in comparison.changes]
    if not polygons:
        return Bounds(0.0, 0.0, 1.0, 1.0)
    return Bounds(*map(float, shapely.total_bounds(polygons))).buffered(MARGIN)


def svg_path(shape: Polygon | MultiPolygon, bounds: Bounds) -> str:
    """The rings of a polygon in metres from the picture's north-west corner."""
    rings = [
        ring
        for part in shapely.get_parts(shape)
        if part.geom_type == "Polygon"
        for ring in (part.exterior, *part.interiors)
    ]
    return "".join(
        "M" + "L".join(f"{x - bounds.west:.2f} {bounds.north - y:.2f}" for x, y, *_ in ring.coords[:-1]) + "Z"
        for ring in rings
    )


def picture_of(epoch: Epoch, comparison: Comparison, bounds: Bounds, pixel: float) -> str:
    """The shaded surface of an epoch as a PNG in a data address; one grey where the run wrote no surface."""
    shape = max(1, round(bounds.height / pixel)), max(1, round(bounds.width / pixel))
    path = epoch.folder / "dsm.tif"
    heights = read_heights(path, comparison, bounds, shape) if path.exists() else np.full(shape, np.nan)
    grey = relief_shade(heights, pixel)
    with MemoryFile() as memory:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            profile = {"driver": "PNG", "height": shape[0], "width": shape[1], "count": 1, "dtype": "uint8"}
            with memory.open(**profile) as image:
                image.write(grey, 1)
        return "data:image/png;base64," + base64.b64encode(memory.read()).decode("ascii")


def read_heights(
    path: Path, comparison: Comparison, bounds: Bounds, shape: tuple[int, int]
) -> NDArray[np.float64]:
    """Heights (H, W) over the bounds, in the comparison's system; NaN where there are none."""
    unit = comparison.old.system.horizontal_unit_m
    sides = tuple(side / unit for side in (bounds.west, bounds.south, bounds.east, bounds.north))
    target = horizontal_crs(comparison.old.system)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        with rasterio.open(path) as image:
            if image.crs is not None and target is not None:
                with WarpedVRT(image, crs=target.to_wkt(), nodata=np.nan) as warped:
                    return padded(warped, sides, shape)
            return padded(image, sides, shape)


def padded(image: Any, sides: tuple[float, ...], shape: tuple[int, int]) -> NDArray[np.float64]:
    """The part of a picture in a rectangle, NaN beyond its rim."""
    west, south, east, north = sides
    b = image.bounds
    values = np.full(shape, np.nan)
    left, right = max(west, b.left), min(east, b.right)
    low, high = max(south, b.bottom), min(north, b.top)
    if left >= right or low >= high:
        return values
    rows, columns = shape
    c0, c1 = (round((x - west) / (east - west) * columns) for x in (left, right))
    r0, r1 = (round((north - y) / (north - south) * rows) for y in (high, low))
    if c0 < c1 and r0 < r1:
        part = image.read(
            1,
            window=from_bounds(left, low, right, high, transform=image.transform),
            out_shape=(r1 - r0, c1 - c0),
            masked=True,
            resampling=Resampling.bilinear,
        )
        values[r0:r1, c0:c1] = np.ma.filled(part.astype(np.float64), np.nan)
    return values


def relief_shade(heights: NDArray[np.float64], pixel: float) -> NDArray[np.uint8]:
    """The light (H, W) on a surface of heights; white where none are known."""
    if min(heights.shape) < 2:
        return np.full(heights.shape, 255, np.uint8)
    down, right = np.gradient(heights, pixel)
    normal = np.stack([-right, down, np.ones_like(heights)])
    normal /= np.linalg.norm(normal, axis=0)
    light = np.clip(np.tensordot(SUN, normal, 1), 0.0, 1.0)
    return np.where(np.isfinite(light), 40 + 200 * np.nan_to_num(light), 255).astype(np.uint8)
