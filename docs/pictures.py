"""Draws the steps of every method on a small simulated town: `python -m docs.pictures [STAGE] [METHOD]`.

The steps are the intermediates that a method hands to `emit`, in their order; the last panel is its answer.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from docs.scenes import Scenery, make_scenery
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from shapely import Polygon

from eaves.methods import REGISTRY, methods_of, resolve_method
from eaves.model import Failure, Footprint, Raster

FOLDER = Path(__file__).parent / "images" / "methods"
PANEL_INCHES, DOTS_AN_INCH, COLUMNS = 2.6, 100, 4
TRIANGLES_DRAWN = 20_000
POINT_AREA = 30_000.0
"""Points of ink of a whole cloud, so that few points are drawn larger."""
LARGEST_POINT = 6.0
FRAME, MARGIN_SHARE = "0.75", 0.02
MARGIN = 30.0
"""Points farther than this (m) from the cloud are no points, but some other numbers."""
GOLDEN_SHARE = 0.381966
INK = "#b03020"
NOT_DRAWN = {"given_classes", "row_walls"}
"""Methods without steps worth a picture."""


@dataclass(frozen=True)
class Step:
    """A named intermediate, and the points (N, 3) that labels of theirs belong to."""

    name: str
    value: Any


def draw_method(stage: str, name: str, scenery: Scenery) -> Path:
    """The picture of one method's steps; its file."""
    import matplotlib.pyplot as plt

    steps: list[Step] = []
    points, answer = RUNS[stage](
        resolve_method(stage, name), scenery, lambda title, v: steps.append(Step(title, v))
    )
    drawn = [step for step in [*steps, Step("answer", answer)] if drawable(step.value, points)]
    rows = -(-len(drawn) // COLUMNS)
    columns = -(-len(drawn) // rows)
    size = (PANEL_INCHES * columns, PANEL_INCHES * 1.1 * rows)
    figure, axes = plt.subplots(rows, columns, figsize=size, squeeze=False, layout="constrained")
    for panel in axes.ravel():
        panel.set_axis_off()
    for number, (panel, step) in enumerate(zip(axes.ravel(), drawn, strict=False), 1):
        panel.margins(MARGIN_SHARE)
        draw(panel, step.value, points)
        panel.set_title(f"{number}. {step.name}{range_of(step.value, points)}", fontsize=8)
        panel.set_axis_on()
        panel.set(aspect="equal", xticks=[], yticks=[])
        panel.spines[:].set_color(FRAME)
    FOLDER.mkdir(parents=True, exist_ok=True)
    path = FOLDER / f"{stage}-{name}.png"
    figure.savefig(path, dpi=DOTS_AN_INCH, metadata={"Software": None})
    plt.close(figure)
    return path


def run_ground(method: Any, scenery: Scenery, emit: Callable[[str, Any], None]) -> tuple[Any, Any]:
    return scenery.cloud.xyz, method.ground_mask(scenery.cloud, emit)


def run_detect(method: Any, scenery: Scenery, emit: Callable[[str, Any], None]) -> tuple[Any, Any]:
    return scenery.scene.cloud.xyz, method.label(scenery.scene, emit).label


def run_outline(method: Any, scenery: Scenery, emit: Callable[[str, Any], None]) -> tuple[Any, Any]:
    boundary = method.trace(scenery.house, scenery.scene.spacing, emit)
    return scenery.house, boundary if isinstance(boundary, Failure) else method.regularise([boundary], emit)


def run_roof(method: Any, scenery: Scenery, emit: Callable[[str, Any], None]) -> tuple[Any, Any]:
    labels = np.zeros(len(scenery.house), np.int64)
    planes = method.planes(scenery.house, scenery.scene.spacing, np.random.default_rng(0), emit)
    for number, plane in enumerate(planes, 1):
        labels[plane.members] = number
    return scenery.house, labels


def run_reconstruct(method: Any, scenery: Scenery, emit: Callable[[str, Any], None]) -> tuple[Any, Any]:
    model = method.model(scenery.house, scenery.footprint, list(scenery.planes), scenery.ground, emit)
    if isinstance(model, Failure):
        return scenery.house, model
    faces = [(solid, face) for solid in model.solids[model.lod] for face in solid.faces]
    roofs = [Polygon(s.vertices[list(f.rings[0]), :2]) for s, f in faces if f.surface == "RoofSurface"]
    return scenery.house, roofs


RUNS = {
    "ground": run_ground,
    "detect": run_detect,
    "outline": run_outline,
    "roof": run_roof,
    "reconstruct": run_reconstruct,
}


def drawable(value: Any, points: np.ndarray[Any, Any]) -> bool:
    """Whether `draw` knows what to do with a value."""
    if isinstance(value, list | tuple):
        return bool(lines_of(value))
    if isinstance(value, Raster):
        return True
    if not isinstance(value, np.ndarray):
        return False
    if value.ndim == 1:
        return len(value) == len(points)
    if value.shape[1:] == (3,) and len(value) == len(points):
        return True
    if value.shape[1:] == (3,) or is_segments(value):
        xy = value[:, :2]
        low, high = points[:, :2].min(axis=0) - MARGIN, points[:, :2].max(axis=0) + MARGIN
        return bool(((xy >= low) & (xy <= high)).all())
    return value.ndim == 2 or value.shape[1:] == (3, 3)


def is_segments(value: np.ndarray[Any, Any]) -> bool:
    """Whether an array holds segments: (K, 4) with x, y of both ends."""
    return value.ndim == 2 and value.shape[1] == 4


def lines_of(values: Any) -> list[np.ndarray[Any, Any]]:
    """Polylines (M, 2) of rings, polygons, contours and lists of them; none for anything else."""
    lines: list[np.ndarray[Any, Any]] = []
    for value in values:
        if isinstance(value, Footprint):
            value = value.polygon
        if isinstance(value, Polygon):
            lines += [np.asarray(r.coords)[:, :2] for r in (value.exterior, *value.interiors)]
            continue
        ring = getattr(value, "points", getattr(value, "xy", value))
        if isinstance(ring, np.ndarray) and ring.ndim == 2 and ring.shape[1] >= 2:
            closed = getattr(value, "closed", True)
            lines.append((np.vstack([ring, ring[:1]]) if closed else ring)[:, :2])
        elif isinstance(value, list | tuple):
            lines += lines_of(value)
    return lines


def range_of(value: Any, points: np.ndarray[Any, Any]) -> str:
    """What the darkest and the brightest colour of a grid of measures stand for; nothing for other values."""
    if isinstance(value, Raster):
        value = value.values
    if not isinstance(value, np.ndarray) or value.dtype.kind != "f" or is_segments(value):
        return ""
    if value.ndim != 2 or value.shape[1] == 3 or len(value) == len(points):
        return ""
    low, high = colour_range(value)
    return f" ({low:.2g} to {high:.2g})"


def colour_range(grid: np.ndarray[Any, Any]) -> tuple[float, float]:
    """The values (H, W) between which colours change: all but the outermost fiftieth at either end."""
    low, high = np.nanpercentile(np.where(np.isfinite(grid), grid, np.nan), [2, 98])
    return float(low), float(high)


def size_of(marked: int, points: int) -> float:
    """Ink of each of `marked` points of a cloud, so that a few of them are seen as well."""
    return float(min(LARGEST_POINT, POINT_AREA / points * np.sqrt(points / max(1, marked))))


def draw(panel: Axes, value: Any, points: np.ndarray[Any, Any]) -> None:
    """Draw a raster, a grid, what is known of every point, points, triangles or lines into a panel."""
    size = size_of(len(points), len(points))
    if isinstance(value, Raster):
        value = value.values
    if not isinstance(value, np.ndarray) or is_segments(value):
        lines = list(value.reshape(-1, 2, 2)) if isinstance(value, np.ndarray) else lines_of(value)
        panel.scatter(*points[:, :2].T, s=size, c="0.7", linewidths=0)
        panel.add_collection(LineCollection(lines, colors=INK, linewidths=0.9 if len(lines) < 200 else 0.3))
    elif len(value) == len(points) and value.ndim <= 2:
        off = value == 0 if value.dtype.kind in "iub" else np.zeros(len(points), bool)
        panel.scatter(*points[off, :2].T, s=size / 2, c="0.85", linewidths=0)
        panel.scatter(
            *points[~off, :2].T,
            s=size_of(int((~off).sum()), len(points)),
            c=colours(value[~off]),
            linewidths=0,
        )
    elif value.ndim == 3:
        some = value[:: max(1, len(value) // TRIANGLES_DRAWN)]
        height = some[..., 2].mean(axis=1)
        panel.add_collection(PolyCollection(some[..., :2], array=height, cmap="terrain"))
        panel.autoscale()
    elif value.shape[1] == 3:
        panel.scatter(*points[:, :2].T, s=size / 4, c="0.88", linewidths=0)
        panel.scatter(*value[:, :2].T, s=size_of(len(value), len(points)), c=INK, linewidths=0)
    elif value.dtype.kind in "iu":
        image = np.ones((*value.shape, 3))
        image[value > 0] = colours(value[value > 0])
        panel.imshow(image, interpolation="nearest")
    elif value.dtype.kind == "b":
        panel.imshow(value, cmap="Greys", interpolation="nearest")
    else:
        low, high = colour_range(value)
        panel.imshow(value, cmap="viridis", vmin=low, vmax=high)


def colours(values: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """A colour (N, 3) for each value: hues far apart for labels, a scale for numbers, parts for vectors."""
    if values.ndim == 2:
        return np.asarray(np.clip((values + 1) / 2, 0, 1))
    if values.dtype.kind == "f":
        span = float(np.ptp(values)) or 1.0
        return np.asarray(matplotlib.colormaps["viridis"]((values - values.min()) / span))[:, :3]
    hue = (values.astype(np.float64) * GOLDEN_SHARE) % 1.0
    return np.asarray(matplotlib.colormaps["hsv"](hue))[:, :3] * 0.85


def main() -> None:
    """Draw the methods asked for, or all."""
    matplotlib.use("Agg")
    wanted = sys.argv[1:]
    scenery = make_scenery()
    for stage, names in ((stage, methods_of(stage)) for stage in REGISTRY):
        for name in names:
            if name in NOT_DRAWN:
                continue
            if (not wanted or stage == wanted[0]) and (len(wanted) < 2 or name == wanted[1]):
                sys.stdout.write(f"{draw_method(stage, name, scenery).name}\n")


if __name__ == "__main__":
    main()
