"""An aerial image of the user's own, cut and brought to the frame and size that a page can hold."""

from __future__ import annotations

import base64
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from numpy.typing import NDArray
from pyproj import Transformer
from pyproj.exceptions import ProjError
from rasterio.enums import ColorInterp, Resampling
from rasterio.errors import NotGeoreferencedWarning, RasterioError
from rasterio.io import MemoryFile
from rasterio.transform import Affine
from rasterio.vrt import WarpedVRT
from rasterio.warp import transform_bounds

from eaves.formats import InputError
from eaves.formats.crs import describe_system, horizontal_crs
from eaves.model import Bounds, CoordinateSystem, Mask

PIXELS = 2048
"""Longest side of the image: what graphics of any computer hold."""
BYTES = 1_200_000
"""The image is made coarser until it is no larger."""
QUALITY = 82
"""Of the JPEG: below 80 roofs get visible squares, above 90 it doubles in size."""
BEYOND = 190
"""Grey where the image shows nothing."""
WORLD_RADIUS = 6_378_137.0
"""Of the sphere of web mercator (m)."""
CUT = (2, 98)
"""Percentiles that become black and white in images of more than 8 bits."""


@dataclass(frozen=True)
class Basemap:
    """A JPEG of `width` by `height` pixels over a rectangle (world metres), and the name of its file."""

    jpeg: bytes
    width: int
    height: int
    bounds: Bounds
    name: str

    @property
    def address(self) -> str:
        """The image in an address, for a page that is one file."""
        return "data:image/jpeg;base64," + base64.b64encode(self.jpeg).decode("ascii")


def read_basemap(path: str | Path, system: CoordinateSystem, bounds: Bounds) -> Basemap:
    """The part of an image over `bounds` (world metres), warped to a run's system, within `BYTES`.

    Raises
    ------
    InputError
        When it is no image, it or the run has no reference system, or it shows nothing of the rectangle.
    """
    path, target = Path(path), horizontal_crs(system)
    if target is None:
        raise InputError.about(path, "the run has no reference system to lay it in", "build it with --crs")
    unit = system.horizontal_unit_m
    sides = tuple(side / unit for side in (bounds.west, bounds.south, bounds.east, bounds.north))
    wkt = target.to_wkt()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        try:
            with rasterio.open(path) as image:
                if not image.crs:
                    remedy = "give it one with gdal_edit.py -a_srs"
                    raise InputError.about(path, "has no reference system", remedy)
                covered = transform_bounds(image.crs, wkt, *image.bounds)
                refuse_elsewhere(path, covered, sides, system)
                cell = np.sqrt(
                    (covered[2] - covered[0]) * (covered[3] - covered[1]) / image.width / image.height
                )
                longest = max(sides[2] - sides[0], sides[3] - sides[1])
                pixels = min(PIXELS, max(1, round(longest / cell)))
                while True:
                    shape = image_shape(sides, pixels)
                    colours, valid = warped(image, wkt, sides, shape)
                    if not valid.any():
                        refuse_elsewhere(path, (0.0, 0.0, 0.0, 0.0), sides, system)
                    jpeg = as_jpeg(np.where(valid, colours, np.uint8(BEYOND)))
                    if len(jpeg) <= BYTES or pixels <= 64:
                        return Basemap(jpeg, shape[1], shape[0], bounds, path.name)
                    pixels = int(pixels * min(0.9, 0.97 * np.sqrt(BYTES / len(jpeg))))
        except RasterioError:
            raise InputError.about(path, "is not an image that can be read", "give a GeoTIFF") from None


def fit_web_mercator(
    system: CoordinateSystem, origin: tuple[float, float], reach: float
) -> list[list[float]] | None:
    """Polynomials that place a point on the square of web mercator (0 to 1 from the west, and from the
    north): the coefficients of 1, x, y, x², xy, y² of each, x and y being metres about `origin` up to
    `reach`. None where the reference system has no place on Earth."""
    crs = horizontal_crs(system)
    if crs is None:
        return None
    x, y = (side.ravel() for side in np.meshgrid(*[np.linspace(-1.0, 1.0, 9)] * 2))
    plane = (np.column_stack([x, y]) * reach + origin) / system.horizontal_unit_m
    try:
        move = Transformer.from_crs(crs, "EPSG:3857", always_xy=True)
    except ProjError:
        return None
    world = np.column_stack(move.transform(*plane.T)) / (2 * np.pi * WORLD_RADIUS)
    if not np.isfinite(world).all():
        return None
    terms = np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    solution = np.linalg.lstsq(terms, 0.5 + world * [1.0, -1.0], rcond=None)[0]
    return list((solution.T / reach ** np.array([0, 1, 1, 2, 2, 2])).tolist())


def image_shape(sides: tuple[float, ...], pixels: int) -> tuple[int, int]:
    """Rows and columns of square pixels over a rectangle, the longest side of so many."""
    west, south, east, north = sides
    cell = max(east - west, north - south) / pixels
    return max(1, round((north - south) / cell)), max(1, round((east - west) / cell))


def refuse_elsewhere(
    path: Path, covered: tuple[float, ...], sides: tuple[float, ...], system: CoordinateSystem
) -> None:
    """Raise when two rectangles of a run's system do not meet."""
    west, south, east, north = covered
    if west < sides[2] and sides[0] < east and south < sides[3] and sides[1] < north:
        return
    shown, extent = (",".join(f"{side:.0f}" for side in rectangle) for rectangle in (covered, sides))
    raise InputError.about(
        path,
        f"shows nothing of the run: {shown} in {describe_system(system)}, which lies in {extent}",
        "give an image of the place",
    )


def warped(
    image: Any, wkt: str, sides: tuple[float, ...], shape: tuple[int, int]
) -> tuple[NDArray[np.uint8], Mask]:
    """Colours (3, H, W) of an open image over a rectangle, and where it has any (H, W)."""
    paletted = image.colorinterp[0] == ColorInterp.palette
    way = Resampling.nearest if paletted else Resampling.average
    (west, south, east, north), (rows, columns) = sides, shape
    transform = Affine((east - west) / columns, 0.0, west, 0.0, (south - north) / rows, north)
    grid: dict[str, Any] = {"transform": transform, "width": columns, "height": rows}
    alpha = image.nodata is None and ColorInterp.alpha not in image.colorinterp
    with WarpedVRT(image, crs=wkt, resampling=way, add_alpha=alpha, **grid) as view:
        covered = np.asarray(view.dataset_mask() > 0)
        bands = view.read([1, 2, 3] if image.count >= 3 else [1])
    if paletted:
        table = np.full((256, 3), BEYOND, np.uint8)
        for number, colour in image.colormap(1).items():
            table[number] = colour[:3]
        bands = np.moveaxis(table[bands[0]], -1, 0)
    if bands.dtype != np.uint8:
        low, high = np.percentile(bands[:, covered], CUT) if covered.any() else (0.0, 1.0)
        share = (bands.astype(np.float64) - low) / max(float(high - low), 1e-9)
        bands = np.round(255 * np.clip(np.nan_to_num(share), 0.0, 1.0)).astype(np.uint8)
    return np.broadcast_to(bands, (3, *shape)), covered


def as_jpeg(colours: NDArray[np.uint8]) -> bytes:
    """Colours (3, H, W) as JPEG."""
    _, rows, columns = colours.shape
    profile = {"driver": "JPEG", "width": columns, "height": rows, "count": 3, "dtype": "uint8"}
    with MemoryFile() as memory:
        with memory.open(**profile, quality=QUALITY) as file:
            file.write(colours)
        return bytes(memory.read())
