"""Surface rasters as points: each cell of a DSM is one, at its middle, of the ground where a DTM says so."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pyproj
import rasterio
from numpy.typing import NDArray
from rasterio.enums import Resampling
from rasterio.errors import RasterioError
from rasterio.vrt import WarpedVRT
from rasterio.windows import Window

from eaves.formats.errors import InputError
from eaves.formats.rasters.geotiff import system_of_raster
from eaves.model import GROUND, UNCLASSIFIED

RASTERS = (".tif", ".tiff")
"""Suffixes of the rasters that are read as points."""
STEP = 0.001
"""Resolution of the coordinates (units of the file)."""
LOW_M = 0.3
"""Height (m) over the terrain up to which a cell is ground."""
PIECE = 1 << 20
"""Number of cells in memory at a time, about."""
NOWHERE = rasterio.CRS.from_epsg(3857)
"""Stands for the system of rasters that name none."""


def is_raster(path: str | Path) -> bool:
    """True if a file is read as a raster of heights, by its suffix."""
    return Path(path).suffix.lower() in RASTERS


def write_cells(path: Path, made: Path, dtm: Path | None = None) -> None:
    """Write the cells of a raster that have a height as LAZ, in its system, with the classes 2 and 1 where a
    DTM is given, 0 elsewhere. A pulse has no returns: nothing says what lies beneath a cell.

    Raises
    ------
    InputError
        When one of both is no raster of heights in square north-up cells, or no cell has a height.
    """
    count = 0
    with ExitStack() as stack:
        image = stack.enter_context(opened(path))
        system, transform = system_of_raster(path, image), image.transform
        terrain = None if dtm is None else stack.enter_context(aligned(dtm, image, stack))
        header = laspy.LasHeader(version="1.4", point_format=6)
        header.scales = np.full(3, STEP)
        header.offsets = np.floor([image.bounds.left, image.bounds.bottom, 0.0])
        if image.crs:
            header.add_crs(pyproj.CRS.from_wkt(image.crs.to_wkt()))
        file = stack.enter_context(made.open("w+b"))
        writer = stack.enter_context(laspy.LasWriter(file, header, do_compress=True, closefd=False))
        rows = max(1, PIECE // image.width)
        for first in range(0, image.height, rows):
            window = Window(0, first, image.width, min(rows, image.height - first))
            heights = heights_in(image, window)
            row, column = np.nonzero(np.isfinite(heights))
            points = laspy.ScaleAwarePointRecord.zeros(len(row), header=header)
            points.x = transform.c + (column + 0.5) * transform.a
            points.y = transform.f + (row + first + 0.5) * transform.e
            points.z = heights[row, column]
            if terrain is not None:
                above = (heights - heights_in(terrain, window))[row, column] * system.unit_m[2]
                points.classification = np.where(above <= LOW_M, GROUND, UNCLASSIFIED)
            writer.write_points(points)
            count += len(row)
    if not count:
        raise InputError.about(path, "has no cell with a height", "check its band and its value for no data")


def opened(path: Path) -> Any:
    """An open raster of one band.

    Raises
    ------
    InputError
        When it cannot be read, or has several bands.
    """
    try:
        image = rasterio.open(path, driver="GTiff")  # no list of other files by this name
    except RasterioError:
        raise InputError.about(path, "is not a raster that can be read", "give a GeoTIFF") from None
    if image.count != 1:
        image.close()
        raise InputError.about(path, f"has {image.count} bands, no heights alone", "give a DSM of one band")
    return image


def aligned(path: Path, image: Any, stack: ExitStack) -> Any:
    """A raster on the cells of another one, between its own cells by their distance."""
    terrain = stack.enter_context(opened(path))
    grid = {"transform": image.transform, "width": image.width, "height": image.height}
    system = image.crs or NOWHERE
    return WarpedVRT(
        terrain, src_crs=terrain.crs or system, crs=system, resampling=Resampling.bilinear, nodata=np.nan,
        dtype="float32", **grid
    )  # fmt: skip


def heights_in(image: Any, window: Window) -> NDArray[np.float64]:
    """The values (H, W) of an open raster in a window, NaN where it has none.

    Raises
    ------
    InputError
        When it is cut off or damaged.
    """
    try:
        values = image.read(1, window=window, masked=True)
    except RasterioError:
        raise InputError.about(image.name, "is damaged", "copy or download it again") from None
    return np.ma.filled(values.astype(np.float64), np.nan)
