"""Map of a mask against a reference: found, missed and false areas."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from eaves.evaluate.detection import FALSE_NEGATIVE, FALSE_POSITIVE, TRUE_POSITIVE, UNKNOWN
from eaves.formats import read_polygons, read_raster
from eaves.model import Raster
from eaves.raster.rasterize import rasterize
from eaves.report.plots.plan import draw_shade, finished_map

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
    drawn = mask.values > 0
    values = np.select([drawn & true, true, drawn], [TRUE_POSITIVE, FALSE_NEGATIVE, FALSE_POSITIVE], 0)
    return Raster(values.astype(np.float32), mask.west, mask.north, mask.cell)


def errors_figure(folder: str | Path, reference: str | Path, size_inches: float = 9.0) -> Figure:
    """The map of agreement over the shaded surface, with each area's size in the legend."""
    folder = Path(folder)
    found = agreement(folder, Path(reference))
    figure = Figure(figsize=(size_inches, size_inches), layout="constrained")
    axes = figure.subplots()
    draw_shade(axes, folder / "dsm.tif")
    bounds = found.bounds
    handles = []
    for value, (name, colour) in KINDS.items():
        there: NDArray[np.bool_] = found.values == value
        if not there.any():
            continue
        axes.imshow(
            np.ma.masked_where(~there, there),
            cmap=ListedColormap([colour]),
            extent=(bounds.west, bounds.east, bounds.south, bounds.north),
            alpha=0.8,
            interpolation="nearest",
        )
        area = np.count_nonzero(there) * found.cell**2
        handles.append(Patch(color=colour, label=f"{name} {area:,.0f} m²"))
    axes.set_xlim(bounds.west, bounds.east)
    axes.set_ylim(bounds.south, bounds.north)
    return finished_map(axes, handles, 4, 8, size_inches)
