"""Rasters as GeoTIFF: the building mask with its world file, DTM and DSM as Cloud-Optimised GeoTIFF.

Files are in the coordinate system's units: the cell size in its horizontal unit (0.5 m in a system of feet is
0.5 / 0.3048 ft), heights in its vertical unit.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.errors import NotGeoreferencedWarning, RasterioError
from rasterio.transform import Affine

from eaves.formats.crs import system_of
from eaves.formats.errors import InputError
from eaves.formats.whole_files import atomic
from eaves.model import LOCAL_METRES, Bounds, CoordinateSystem, Mask, Raster

COG_OPTIONS: dict[str, Any] = {
    "driver": "COG",
    "compress": "DEFLATE",
    "predictor": "YES",
    "level": 1,
    "blocksize": 512,
    "overview_resampling": "AVERAGE",
    "sparse_ok": "TRUE",
    "bigtiff": "IF_SAFER",
}


def transform_of(west: float, north: float, cell: float, system: CoordinateSystem) -> Affine:
    """From column and row to the system's coordinates; `west`, `north` (outer corner) and `cell` are world
    metres."""
    unit = system.horizontal_unit_m
    return Affine(cell / unit, 0.0, west / unit, 0.0, -cell / unit, north / unit)


def profile_of(raster_shape: tuple[int, int], transform: Affine, system: CoordinateSystem) -> dict[str, Any]:
    """The profile of a raster of one band for rasterio."""
    rows, columns = raster_shape
    return {
        "height": rows,
        "width": columns,
        "count": 1,
        "transform": transform,
        "crs": None if system.wkt is None else rasterio.CRS.from_wkt(system.wkt),
    }


def write_raster(
    path: str | Path,
    raster: Raster,
    system: CoordinateSystem = LOCAL_METRES,
    origin: tuple[float, float] = (0.0, 0.0),
    heights: bool = True,
) -> None:
    """Write a raster as float32 Cloud-Optimised GeoTIFF; NaN is the no-data value.

    Parameters
    ----------
    path : str or Path
        The file; it appears when it is whole.
    raster : Raster
        Heights (H, W) in metres, placed in metres about `origin`.
    system : CoordinateSystem
        The coordinate system; position, cell and heights are converted to its units.
    origin : (float, float)
        World metres of the raster's local (0, 0).
    heights : bool
        Values are heights; others are written as they are.

    Raises
    ------
    InputError
        When the folder cannot be written.

    Examples
    --------
    >>> import numpy as np
    >>> from eaves.formats import write_raster
    >>> from eaves.model import Raster
    >>> write_raster("dtm.tif", Raster(np.ones((2, 3), np.float32), west=10.0, north=20.0, cell=0.5))
    """
    transform = transform_of(raster.west + origin[0], raster.north + origin[1], raster.cell, system)
    unit = system.vertical_unit_m if heights else 1.0
    values = (raster.values / np.float32(unit)).astype(np.float32)
    profile = profile_of(raster.shape, transform, system) | COG_OPTIONS
    with (
        atomic(path) as temporary,
        rasterio.open(temporary, "w", dtype="float32", nodata=np.nan, **profile) as image,
    ):
        image.write(values, 1)


def write_mask(
    path: str | Path,
    mask: Mask,
    west: float,
    north: float,
    cell: float,
    system: CoordinateSystem = LOCAL_METRES,
) -> None:
    """Write a building mask as uint8 GeoTIFF of 0 and 1, with its world file (`.tfw`) beside it.

    Parameters
    ----------
    path : str or Path
        The file; it appears when it is whole.
    mask : ndarray (H, W) of bool
        Row 0 north.
    west, north : float
        The outer corner (world m).
    cell : float
        Side of a cell (m, > 0).
    system : CoordinateSystem
        The coordinate system; position and cell are converted to its units.

    Raises
    ------
    InputError
        When the folder cannot be written.

    Examples
    --------
    >>> import numpy as np
    >>> from pathlib import Path
    >>> from eaves.formats import write_mask
    >>> write_mask("mask.tif", np.eye(4, dtype=bool), west=10.0, north=20.0, cell=0.5)
    >>> Path("mask.tfw").exists()
    True
    """
    transform = transform_of(west, north, cell, system)
    rows, columns = mask.shape
    profile = profile_of((rows, columns), transform, system)
    profile |= {"driver": "GTiff", "compress": "DEFLATE", "bigtiff": "IF_SAFER"}
    if min(rows, columns) >= 256:
        profile |= {"tiled": True, "blockxsize": 256, "blockysize": 256}
    with atomic(path) as temporary, rasterio.open(temporary, "w", dtype="uint8", **profile) as image:
        image.write(mask.astype(np.uint8), 1)
    write_world_file(Path(path).with_suffix(".tfw"), transform)


def write_world_file(path: Path, transform: Affine) -> None:
    """Write the six lines of a world file: A, D, B, E and the centre of the upper left cell."""
    x, y = transform @ (0.5, 0.5) if hasattr(transform, "__matmul__") else transform * (0.5, 0.5)
    lines = [transform.a, transform.d, transform.b, transform.e, x, y]
    with atomic(path) as temporary:
        temporary.write_text("".join(f"{value:.12g}\n" for value in lines), encoding="ascii")


class RasterWindow:
    """A raster file held open, of which all or parts are read in metres; a context manager.

    Parameters
    ----------
    path : Path
        A GeoTIFF or a virtual raster of square north-up cells.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def __enter__(self) -> RasterWindow:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            try:
                self.image = rasterio.open(self.path)
            except RasterioError:
                raise _unreadable(self.path) from None
        try:
            self.system = system_of_raster(self.path, self.image)
        except InputError:
            self.image.close()
            raise
        return self

    def __exit__(self, *error: object) -> None:
        self.image.close()

    @property
    def cell(self) -> float:
        """Side of a cell (m)."""
        return float(self.image.transform.a * self.system.horizontal_unit_m)

    @property
    def bounds(self) -> Bounds:
        """World metres of all its cells."""
        return Bounds(*(side * self.system.horizontal_unit_m for side in self.image.bounds))

    def read(self, bounds: Bounds | None = None, origin: tuple[float, float] = (0.0, 0.0)) -> Raster:
        """The cells that meet `bounds` (world metres), or all of them, in metres about `origin`."""
        unit, transform = self.system.horizontal_unit_m, self.image.transform
        cell = self.cell
        left, right, top, low = 0, self.image.width, 0, self.image.height
        if bounds is not None:
            left = max(int(np.floor((bounds.west - transform.c * unit) / cell)), 0)
            right = min(int(np.ceil((bounds.east - transform.c * unit) / cell)), self.image.width)
            top = max(int(np.floor((transform.f * unit - bounds.north) / cell)), 0)
            low = min(int(np.ceil((transform.f * unit - bounds.south) / cell)), self.image.height)
        values = np.full((max(low - top, 1), max(right - left, 1)), np.nan, np.float32)
        if right > left and low > top:
            window = ((top, low), (left, right))
            try:
                stored = self.image.read(1, window=window, masked=True).astype(np.float64).filled(np.nan)
                values = scaled(stored, self.image).astype(np.float32)
            except RasterioError:
                raise _unreadable(self.path) from None
        return Raster(
            values * np.float32(self.system.vertical_unit_m),
            transform.c * unit + left * cell - origin[0],
            transform.f * unit - top * cell - origin[1],
            cell,
        )


def scaled(values: NDArray[np.float64], image: Any) -> NDArray[np.float64]:
    """Stored values of the first band of an open raster by the scale and the offset that the band states."""
    scale, offset = image.scales[0], image.offsets[0]
    return values if (scale, offset) == (1.0, 0.0) else values * scale + offset


def check_cells(path: str | Path, image: Any) -> None:
    """Check that the cells of an open raster are square and north-up.

    Raises
    ------
    InputError
        When they are not.
    """
    transform = image.transform
    if transform.b or transform.d or transform.e >= 0 or abs(transform.a + transform.e) > 1e-6 * transform.a:
        raise InputError.about(
            path, "has cells that are not square and north-up", "resample it with gdalwarp"
        )


def _unreadable(path: Path) -> InputError:
    return InputError.about(path, "is not a raster that can be read", "give a GeoTIFF")


def system_of_raster(path: str | Path, image: Any) -> CoordinateSystem:
    """The system of an open raster of square north-up cells."""
    check_cells(path, image)
    bounds = image.bounds
    if not image.crs:
        return LOCAL_METRES
    from eaves.formats.crs import parse_crs

    centre = (bounds.left + bounds.right) / 2, (bounds.bottom + bounds.top) / 2
    return system_of(parse_crs(image.crs.to_wkt(), path), path, centre)


def read_raster(
    path: str | Path, origin: tuple[float, float] = (0.0, 0.0)
) -> tuple[Raster, CoordinateSystem]:
    """The first band of a raster file in metres about `origin`, and its coordinate system.

    Parameters
    ----------
    path : str or Path
        A GeoTIFF, or another raster format that GDAL reads.
    origin : (float, float)
        World metres that become local (0, 0).

    Returns
    -------
    raster : Raster
        Heights (H, W) float32 in metres; NaN where the file has no data.
    system : CoordinateSystem
        The file's reference system.

    Raises
    ------
    InputError
        When it is no raster of square north-up cells in a plane system.

    Examples
    --------
    >>> import numpy as np
    >>> from eaves.formats import read_raster, write_raster
    >>> from eaves.model import Raster
    >>> write_raster("dtm.tif", Raster(np.ones((2, 3), np.float32), west=10.0, north=20.0, cell=0.5))
    >>> raster, system = read_raster("dtm.tif")
    >>> raster.values.shape, raster.west, raster.cell
    ((2, 3), 10.0, 0.5)
    """
    with RasterWindow(Path(path)) as window:
        return window.read(None, origin), window.system
