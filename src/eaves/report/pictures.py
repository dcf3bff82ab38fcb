"""Pictures of points, rasters, outlines and models in a notebook: small ones, by numpy alone."""

from __future__ import annotations

import base64
import html
import struct
import zlib
from collections.abc import Iterable, Mapping, Sequence
from functools import singledispatch
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

from eaves.model import BuildingModel, Footprint, PointCloud, Raster, Scene, Solid, Values

SHOWN = {
    "roof": "roof_type",
    "eaves (m)": "h_eaves",
    "ridge (m)": "h_ridge",
    "volume (m³)": "volume_m3",
    "RMSE (m)": "rmse_m",
    "points": "points",
}
"""Title → attribute of what stands beside a model."""
SIDE = 360
"""Most dots along a side of a picture."""
CLASS_COLOURS = {
    2: (176, 152, 117), 3: (196, 205, 150), 4: (150, 179, 110), 5: (98, 140, 80), 6: (207, 96, 66),
    7: (255, 0, 255), 9: (110, 160, 200), 18: (255, 0, 255),
}  # fmt: skip
"""By LAS class; others are grey."""
LOW, MIDDLE, HIGH = (68, 90, 120), (150, 180, 150), (250, 240, 200)
"""Colours of heights: the fifth percentile, the middle, the 95th."""
SURFACE_COLOURS = {
    "RoofSurface": (217, 122, 90),
    "WallSurface": (235, 228, 214),
    "GroundSurface": (141, 134, 125),
}
LIGHT = np.array([-0.45, -0.6, 0.66])
"""Direction of the light in a picture of a solid: from before, left and above."""
TURN, LEAN = np.radians(-30.0), np.radians(35.0)
"""From where a solid is seen: degrees clockwise from the south, and over the horizon."""

Image = NDArray[np.uint8]


def png_bytes(image: Image) -> bytes:
    """An image (H, W, 3) as a PNG file."""
    rows, columns, _ = image.shape
    lines = np.zeros((rows, 1 + 3 * columns), np.uint8)
    lines[:, 1:] = image.reshape(rows, -1)

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", columns, rows, 8, 2, 0, 0, 0)
    packed = zlib.compress(lines.tobytes(), 6)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", packed) + chunk(b"IEND", b"")


def cloud_picture(xyz: Values, classes: NDArray[np.uint8] | None) -> Image:
    """Points (N, 3) from above: the highest of each dot, by class where there are classes, else by height."""
    good = np.flatnonzero(np.isfinite(xyz).all(axis=1))
    if not len(good):
        return np.full((8, 8, 3), 255, np.uint8)
    x, y, z = xyz[good].T
    width, depth = float(np.ptp(x)), float(np.ptp(y))
    # a dot holds about two points, or gaps would hide what is seen
    fine = np.sqrt(max(width * depth, 1e-6) / len(good) * 2.0)
    dot = max(fine, max(width, depth) / SIDE, 1e-6)
    columns, rows = int(width / dot) + 1, int(depth / dot) + 1
    place = ((y.max() - y) / dot).astype(np.int64) * columns + ((x - x.min()) / dot).astype(np.int64)
    order = np.lexsort((z, place))
    last = order[np.append(np.diff(place[order]) != 0, True)]
    heights = np.full((rows, columns), np.nan)
    heights.reshape(-1)[place[last]] = z[last]
    colours = height_colours(heights)
    if classes is not None:
        colours.reshape(-1, 3)[place[last]] = class_colours(classes[good][last])
    return shaded(colours, heights, dot)


def class_colours(classes: NDArray[np.uint8]) -> Values:
    """Colours (N, 3), 0 to 255, of LAS classes (N,)."""
    table = np.full((256, 3), 150.0)
    for code, colour in CLASS_COLOURS.items():
        table[code] = colour
    return table[classes]


def raster_picture(heights: NDArray[np.float32], cell: float) -> Image:
    """Heights (H, W) coloured and shaded; no data is white."""
    step = max(1, -(-max(heights.shape) // SIDE))
    thin = np.asarray(heights[::step, ::step], np.float64)
    return shaded(height_colours(thin), thin, cell * step)


def height_colours(heights: Values) -> Values:
    """Colours (H, W, 3) of heights."""
    finite = heights[np.isfinite(heights)]
    low, high = np.percentile(finite, [5.0, 95.0]) if len(finite) else (0.0, 1.0)
    share = np.clip((np.nan_to_num(heights, nan=low) - low) / max(high - low, 1e-9), 0.0, 1.0)
    ramp = np.array([LOW, MIDDLE, HIGH], np.float64)
    return np.stack([np.interp(share, [0.0, 0.5, 1.0], ramp[:, band]) for band in range(3)], axis=2)


def shaded(colours: Values, heights: Values, cell: float) -> Image:
    """Colours (H, W, 3) under light from the north-west; white where there is no height."""
    padded = np.pad(heights, 1, mode="edge")
    down, east = (np.gradient(padded, cell, axis=axis)[1:-1, 1:-1] for axis in (0, 1))
    bright = (0.5 * east + -0.5 * -down + 0.7) / np.sqrt(1.0 + east**2 + down**2)
    bright = np.where(np.isfinite(bright), 0.55 + 0.6 * np.clip(bright, 0.0, 1.0), 1.0)
    image = np.clip(colours * bright[:, :, None], 0.0, 255.0)
    image[~np.isfinite(heights)] = 255.0
    return np.asarray(np.round(image), np.uint8)


def polygon_svg(*polygons: Polygon) -> str:
    """Polygons in plan as SVG."""
    faces = []
    for polygon in polygons:
        rings = [
            np.asarray(ring.coords)[:-1, :2] * [1.0, -1.0] for ring in (polygon.exterior, *polygon.interiors)
        ]
        faces += [(rings, (217, 122, 90))] if len(rings[0]) else []
    return svg(faces)


def solids_svg(solids: Iterable[Solid]) -> str:
    """Solids seen obliquely as SVG, the farthest faces first."""
    turn = np.array([[np.cos(TURN), -np.sin(TURN), 0], [np.sin(TURN), np.cos(TURN), 0], [0, 0, 1]])
    lean = np.array([[1, 0, 0], [0, np.sin(LEAN), np.cos(LEAN)], [0, np.cos(LEAN), -np.sin(LEAN)]])
    view = lean @ turn
    faces = []
    for solid in solids:
        for face in solid.faces:
            rings = [solid.vertices[list(ring)] for ring in face.rings]
            ahead = np.roll(rings[0], -1, axis=0)
            normal = np.cross(rings[0] - rings[0][0], ahead - rings[0][0]).sum(axis=0)
            size = float(np.linalg.norm(normal))
            if size == 0.0 or (view @ normal)[2] >= 0.0:
                continue
            bright = 0.72 + 0.28 * float(normal @ LIGHT) / size
            colour = tuple(int(band * bright) for band in SURFACE_COLOURS.get(face.surface, (180, 180, 180)))
            views = [ring @ view.T for ring in rings]
            faces.append(
                (float(views[0][:, 2].mean()), [ring[:, :2] * [1.0, -1.0] for ring in views], colour)
            )
    faces.sort(key=lambda face: -face[0])
    return svg([(rings, colour) for _, rings, colour in faces])


def svg(faces: Sequence[tuple[list[Values], tuple[int, ...]]]) -> str:
    """Faces of rings (M, 2), y downwards, each in a colour, in order, fitted into a picture."""
    head = f"<svg xmlns='http://www.w3.org/2000/svg' width='{SIDE // 2}' height='{SIDE // 2}'"
    if not faces:
        return f"{head} viewBox='0 0 1 1'></svg>"
    corners = np.concatenate([ring for rings, _ in faces for ring in rings])
    low, size = corners.min(axis=0), float(np.ptp(corners, axis=0).max()) or 1.0
    scale, margin = 0.96 * (SIDE // 2) / size, 0.02 * (SIDE // 2)
    paths = []
    for rings, colour in faces:
        moved = [(ring - low) * scale + margin for ring in rings]
        path = " ".join("M" + " L".join(f"{x:.1f},{y:.1f}" for x, y in ring) + "Z" for ring in moved)
        paths.append(
            f"<path d='{path}' fill='rgb{colour}' fill-rule='evenodd' stroke='#3d342e' stroke-width='0.7' "
            "stroke-linejoin='round'/>"
        )
    side = SIDE // 2
    return f"{head} viewBox='0 0 {side} {side}'>{''.join(paths)}</svg>"


@singledispatch
def picture_of(thing: Any) -> Image | str:
    """The picture of a value: an image, or SVG."""
    raise TypeError(f"{type(thing).__name__}: there is no picture of it")


@singledispatch
def facts_of(thing: Any) -> dict[str, Any]:
    """What is written beside the picture of a value."""
    return {}


def as_html(thing: Any) -> str:
    """A value as a notebook shows it."""
    return table_beside(type(thing).__name__, facts_of(thing), picture_of(thing))


@picture_of.register
def _(cloud: PointCloud) -> Image:
    return cloud_picture(cloud.xyz, cloud.classification)


@facts_of.register
def _(cloud: PointCloud) -> dict[str, Any]:
    finite = np.isfinite(cloud.xyz).all(axis=1)
    box = np.ptp(cloud.xyz[finite], axis=0) if finite.any() else np.zeros(3)
    return {
        "points": f"{len(cloud):,}",
        "extent": f"{box[0]:,.0f} × {box[1]:,.0f} m, {box[2]:,.0f} m high",
        "density": f"{len(cloud) / max(box[0] * box[1], 1.0):,.1f} points/m²",
        "classes": None if cloud.classification is None else np.unique(cloud.classification).tolist(),
        "several returns": "yes" if cloud.has_returns else "no",
        "system": cloud.system.code or ("local" if cloud.system.wkt is None else "without a code"),
    }


@picture_of.register
def _(raster: Raster) -> Image:
    return raster_picture(raster.values, raster.cell)


@facts_of.register
def _(raster: Raster) -> dict[str, Any]:
    finite = raster.values[np.isfinite(raster.values)]
    return {
        "cells": f"{raster.shape[0]:,} × {raster.shape[1]:,} of {raster.cell:g} m",
        "heights": f"{finite.min():.1f} to {finite.max():.1f} m" if len(finite) else "none",
        "no data": f"{1.0 - len(finite) / max(raster.values.size, 1):.1%}",
    }


@picture_of.register
def _(scene: Scene) -> Image | str:
    return picture_of(scene.dsm)


@facts_of.register
def _(scene: Scene) -> dict[str, Any]:
    ground = scene.cloud.ground.mean() if len(scene.cloud) else 0.0
    return {
        "points": f"{len(scene.cloud):,}, {ground:.0%} of them ground",
        "spacing": f"{scene.spacing:.2f} m",
        "rasters": "dtm and dsm",
        "cells": f"{scene.dsm.shape[0]:,} × {scene.dsm.shape[1]:,} of {scene.dsm.cell:g} m",
    }


@picture_of.register
def _(footprint: Footprint) -> str:
    return polygon_svg(footprint.polygon)


@facts_of.register
def _(footprint: Footprint) -> dict[str, Any]:
    facts: dict[str, Any] = {"id": footprint.id or None, "area": f"{footprint.polygon.area:,.1f} m²"}
    return facts | {"corners": len(footprint.polygon.exterior.coords) - 1, "score": f"{footprint.score:.2f}"}


@picture_of.register
def _(model: BuildingModel) -> str:
    return solids_svg(model.solids[model.lod]) if model.solids else polygon_svg(model.footprint.polygon)


@facts_of.register
def _(model: BuildingModel) -> dict[str, Any]:
    values = {title: model.attributes.get(name) for title, name in SHOWN.items()}
    facts: dict[str, Any] = {"id": model.footprint.id or None, "level of detail": model.lod}
    return facts | {
        title: f"{value:,.2f}" if isinstance(value, float) else value for title, value in values.items()
    }


def table_beside(title: str, facts: Mapping[str, Any], picture: Image | str) -> str:
    """A picture (SVG or image) with what is known beside it."""
    if not isinstance(picture, str):
        encoded = base64.b64encode(png_bytes(picture)).decode("ascii")
        picture = f"<img alt='{html.escape(title)}' src='data:image/png;base64,{encoded}'>"
    rows = "".join(
        f"<tr><td style='text-align:left'>{html.escape(str(name))}</td>"
        f"<td style='text-align:left'>{html.escape(str(value))}</td></tr>"
        for name, value in facts.items()
        if value is not None
    )
    return (
        "<div style='display:flex;gap:1em;align-items:flex-start'>"
        f"{picture}<div><b>{html.escape(title)}</b><table>{rows}</table></div></div>"
    )
