"""Surface rasters as points: each cell of a DSM is one, at its middle, of the ground where a DTM says so."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pyproj
import rasterio
import scipy
from numpy.typing import NDArray
from rasterio.enums import Resampling
from rasterio.errors import RasterioError
from rasterio.vrt import WarpedVRT
from rasterio.windows import Window

from eaves.formats.crs import is_same_unit, name_of_unit, plane_part, unit_of
from eaves.formats.errors import InputError
from eaves.formats.rasters.geotiff import check_cells, scaled
from eaves.formats.statements import Stated
from eaves.model import GROUND, UNCLASSIFIED

STEP, DEGREE_STEP = 0.001, 1e-8
"""Resolution of the coordinates (units of the file), and of degrees."""
UNITS = {
    **dict.fromkeys(("m", "metre", "meter", "metres", "meters"), 1.0),
    **dict.fromkeys(("ft", "foot", "feet", "international foot"), 0.3048),
    **dict.fromkeys(("us-ft", "ftus", "us survey foot", "us survey feet", "us_survey_foot"), 1200 / 3937),
    **{"dm": 0.1, "cm": 0.01, "mm": 0.001},
}
"""Names of units of bands, in lower case, and their lengths (m)."""
LOWEST_M, HIGHEST_M = -2000.0, 10_000.0
"""No land lies below or above (m); the values for no data that writers use do: -9999, -32768, ± 3.4e38."""
FILLED, LEAST_DATA, ONE_PIECE, APART_M = 0.5, 0.1, 0.8, 1.0
"""A value is no height where it holds such a share of the border's cells, the others are such a share of all
and such a share of them one piece, and it lies farther (m) from them: heights above ground are 0 between
many pieces, and a house on a level plane is a small one."""
LOOKED_AT = 512
"""Largest side of the picture of a raster in which pieces are counted."""
NAMED = 3
"""Values that are left out and named."""
LOW_M = 0.3
"""Height (m) over the terrain up to which a cell is ground."""
PIECE = 1 << 20
"""Number of cells in memory at a time, about."""
NOWHERE = rasterio.CRS.from_epsg(3857)
"""Stands for the system of rasters that name none."""


def write_cells(path: Path, made: Path, dtm: Path | None = None) -> list[str]:
    """Write the cells of a raster that have a height as LAZ, in its system, with the classes 2 and 1 where a
    DTM is given, 0 elsewhere; the remarks on what is left out. A pulse has no returns: nothing says what lies
    beneath a cell.

    Raises
    ------
    InputError
        When one of both is no raster of heights in square north-up cells, or no cell has a height.
    """
    count = 0
    with ExitStack() as stack:
        image = stack.enter_context(opened(path))
        check_cells(path, image)
        surface, transform = Heights.of(path, image), image.transform
        terrain = None if dtm is None else Heights.of(dtm, stack.enter_context(opened(dtm)))
        below = None if terrain is None else stack.enter_context(aligned(terrain, image))
        header = laspy.LasHeader(version="1.4", point_format=6)
        header.scales = np.array([surface.step, surface.step, STEP])
        header.offsets = np.floor([image.bounds.left, image.bounds.bottom, 0.0])
        if image.crs:
            header.add_crs(pyproj.CRS.from_wkt(image.crs.to_wkt()))
        file = stack.enter_context(made.open("w+b"))
        writer = stack.enter_context(laspy.LasWriter(file, header, do_compress=True, closefd=False))
        for window in pieces_of(image):
            heights = surface.read(image, window)
            row, column = np.nonzero(np.isfinite(heights))
            points = laspy.ScaleAwarePointRecord.zeros(len(row), header=header)
            points.x = transform.c + (column + 0.5) * transform.a
            points.y = transform.f + (row + window.row_off + 0.5) * transform.e
            points.z = heights[row, column] / surface.unit
            if terrain is not None:
                above = (heights - terrain.read(below, window))[row, column]
                points.classification = np.where(above <= LOW_M, GROUND, UNCLASSIFIED)
            writer.write_points(points)
            count += len(row)
    if not count:
        raise InputError.about(path, "has no cell with a height", "check its band and its value for no data")
    return surface.remarks() + ([] if terrain is None else terrain.remarks())


def pieces_of(image: Any) -> Iterator[Window]:
    """The rows of an open raster, about `PIECE` cells at a time."""
    rows = max(1, PIECE // image.width)
    for first in range(0, image.height, rows):
        yield Window(0, first, image.width, min(rows, image.height - first))


@dataclass(frozen=True, eq=False)
class Heights:
    """The way of the numbers of a raster to heights in metres.

    Parameters
    ----------
    path : Path
        The file.
    image : raster
        It, open: its band states scale and offset.
    factor, unit : float
        Metres in a unit of its values, and in a unit of heights of its system.
    step : float
        Resolution of its places (units of the file).
    left_out : tuple of float
        Values, as stored, that stand for no data and are not declared to.
    counts : Counter
        Values left out so far, with how many cells hold them.
    """

    path: Path
    image: Any
    factor: float
    unit: float
    step: float
    left_out: tuple[float, ...]
    counts: Counter[float] = field(default_factory=Counter)

    @classmethod
    def of(cls, path: Path, image: Any) -> Heights:
        """The way of an open raster.

        Raises
        ------
        InputError
            When the units of its band and of its system contradict.
        """
        crs = pyproj.CRS.from_wkt(image.crs.to_wkt()) if image.crs else None
        stated, band = Stated(crs).upright, UNITS.get((image.units[0] or "").strip().lower())
        flat = 1.0 if crs is None or crs.is_geographic else unit_of(plane_part(crs))
        unit = flat if stated is None else stated
        if band is not None and stated is not None and not is_same_unit(band, stated):
            raise InputError.about(
                path,
                f"its band says heights in {image.units[0]}, its system in {name_of_unit(stated)}",
                "correct the unit of the band (gdal_edit -units)",
            )
        step = STEP if crs is None or not crs.is_geographic else DEGREE_STEP
        return cls(path, image, band or unit, unit, step, undeclared_values(image, band or unit))

    def read(self, cells: Any, window: Window) -> NDArray[np.float64]:
        """The heights (H, W) in metres of the raster, or of it on other `cells`, in a window; NaN where there
        is none.

        Raises
        ------
        InputError
            When it is cut off or damaged.
        """
        try:
            stored = cells.read(1, window=window, masked=True)
        except RasterioError:
            raise InputError.about(self.path, "is damaged", "copy or download it again") from None
        heights = scaled(np.ma.filled(stored.astype(np.float64), np.nan), self.image) * self.factor
        nothing = np.isin(stored.data, self.left_out) | (heights < LOWEST_M) | (heights > HIGHEST_M)
        nothing &= ~np.isnan(heights)
        if nothing.any():
            values, counts = np.unique(stored.data[nothing], return_counts=True)
            self.counts.update(dict(zip(values.tolist(), counts.tolist(), strict=True)))
            heights[nothing] = np.nan
        return heights

    def remarks(self) -> list[str]:
        """A line for each of the commonest values that were left out."""
        return [
            f"{self.path.name}: {count:,} cells hold the value {value:g}, which is no height and is not "
            "declared to be no data; they are left out"
            for value, count in self.counts.most_common(NAMED)
        ]


def undeclared_values(image: Any, factor: float) -> tuple[float, ...]:
    """Values of an open raster, as stored, that stand for no data and are not declared to: the ends of whole
    numbers, and one that fills the border around a single piece of other values, far from them."""
    kind = np.dtype(image.dtypes[0])
    ends = (np.iinfo(kind).max, *[np.iinfo(kind).min] * (kind.kind == "i")) if kind.kind in "iu" else ()
    found = tuple(float(end) for end in ends if kind.itemsize > 1)
    height, width = image.height, image.width
    sides = [Window(0, 0, width, 1), Window(0, height - 1, width, 1)]
    sides += [Window(0, 0, 1, height), Window(width - 1, 0, 1, height)]
    try:
        border = np.concatenate([image.read(1, window=side, masked=True).ravel() for side in sides])
        shape = min(height, LOOKED_AT), min(width, LOOKED_AT)
        whole = image.read(1, out_shape=shape, masked=True)
    except RasterioError:  # reading its cells will say so
        return found
    border = np.ma.masked_invalid(border).compressed()
    if not len(border):
        return found
    values, counts = np.unique(border, return_counts=True)
    fill, many = float(values[counts.argmax()]), int(counts.max())
    heights = scaled(np.ma.filled(whole.astype(np.float64), np.nan), image) * factor
    rest = (heights > LOWEST_M) & (heights < HIGHEST_M) & ~np.isin(whole.data, (*found, fill))
    if many < FILLED * len(border) or rest.mean() < LEAST_DATA:
        return found
    pieces, _ = scipy.ndimage.label(rest, np.ones((3, 3)))
    low, high = np.percentile(heights[rest], [1, 99])
    place = float(scaled(np.array(fill), image)) * factor
    alone = not low - APART_M <= place <= high + APART_M
    one = np.bincount(pieces.ravel())[1:].max() >= ONE_PIECE * rest.sum()
    return (*found, fill) if alone and one else found


def opened(path: Path) -> Any:
    """An open raster of one band.

    Raises
    ------
    InputError
        When it cannot be read, or has several bands.
    """
    try:
        with rasterio.Env(GTIFF_REPORT_COMPD_CS=True):
            image = rasterio.open(path, driver="GTiff")  # no list of other files by this name
    except RasterioError:
        raise InputError.about(path, "is not a raster that can be read", "give a GeoTIFF") from None
    if image.count != 1:
        image.close()
        raise InputError.about(path, f"has {image.count} bands, no heights alone", "give a DSM of one band")
    return image


def aligned(terrain: Heights, image: Any) -> Any:
    """A raster on the cells of another one, between its own cells by their distance."""
    grid = {"transform": image.transform, "width": image.width, "height": image.height}
    system, own = image.crs or NOWHERE, terrain.image
    if own.nodata is None and terrain.left_out:
        grid["src_nodata"] = terrain.left_out[-1]
    return WarpedVRT(
        own, src_crs=own.crs or system, crs=system, resampling=Resampling.bilinear, nodata=np.nan,
        dtype="float32", **grid
    )  # fmt: skip
