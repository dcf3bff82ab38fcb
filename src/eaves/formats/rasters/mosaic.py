"""Many pieces, in any order, become one Cloud-Optimised GeoTIFF without ever being in memory together."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import rasterio
import rasterio.shutil
from numpy.typing import NDArray
from rasterio.enums import Resampling
from rasterio.windows import Window

from eaves.formats.rasters.geotiff import COG_OPTIONS, profile_of, transform_of
from eaves.formats.rasters.vrt import NO_TAGS
from eaves.formats.whole_files import atomic
from eaves.model import LOCAL_METRES, Bounds, CoordinateSystem, Raster

TILE = 256
"""Side (cells) of the tiles of the file in the making."""
CACHE_BYTES = 64 << 20
"""GDAL's cache while tiles are rewritten: what bounds the memory."""


class MosaicWriter:
    """Collects pieces of one raster and writes it: dtm.tif, dsm.tif (float32 heights) or mask.tif (uint8).

    Every piece has more than its own cells; `write` keeps those whose centre lies within the bounds given, so
    pieces computed with overlap leave no seam. Cells that no piece covers are NaN (0 in a mask).

    Parameters
    ----------
    path : str or Path
        The file; it appears when `finish` has run (leaving the `with` block without an error does).
    bounds : Bounds
        World metres of the whole, widened to whole multiples of `cell`.
    cell : float
        Side of a cell (m, > 0).
    system : CoordinateSystem
        The coordinate system; position, cell and heights are converted to its units.
    mask : bool
        True if values are 0 and 1 (uint8) and not heights.
    tags : mapping of str to str
        Facts recorded in the file.
    heights : bool
        True if values are heights (m), which are converted to the system's unit.

    Raises
    ------
    InputError
        When the folder cannot be written.

    Examples
    --------
    >>> import numpy as np
    >>> from eaves import Bounds, Raster
    >>> from eaves.formats import MosaicWriter, read_raster
    >>> piece = Raster(np.ones((4, 4), np.float32), west=0.0, north=4.0, cell=1.0)
    >>> with MosaicWriter("dtm.tif", Bounds(0.0, 0.0, 4.0, 4.0), 1.0) as writer:
    ...     writer.write(piece, Bounds(0.0, 0.0, 4.0, 4.0))
    >>> read_raster("dtm.tif")[0].shape
    (4, 4)
    """

    def __init__(
        self,
        path: str | Path,
        bounds: Bounds,
        cell: float,
        system: CoordinateSystem = LOCAL_METRES,
        mask: bool = False,
        tags: Mapping[str, str] = NO_TAGS,
        heights: bool = True,
    ) -> None:
        self.path, self.cell, self.mask = Path(path), cell, mask
        self.unit = np.float32(system.vertical_unit_m if heights else 1.0)
        self.first_column, self.last_row = round_down(bounds.west, cell), round_down(bounds.south, cell)
        self.columns = max(-round_down(-bounds.east, cell) - self.first_column, 1)
        self.rows = max(-round_down(-bounds.north, cell) - self.last_row, 1)
        self.top_row = self.last_row + self.rows
        self.transform = transform_of(self.first_column * cell, self.top_row * cell, cell, system)
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self._workplace = Path(tempfile.mkdtemp(prefix=f".{self.path.name}.", dir=self.path.parent))
        self._draft = self._workplace / "draft.tif"
        profile: dict[str, Any] = profile_of((self.rows, self.columns), self.transform, system)
        profile |= {"tiled": True, "blockxsize": TILE, "blockysize": TILE, "bigtiff": "IF_SAFER"}
        profile |= {"dtype": "uint8"} if mask else {"dtype": "float32", "nodata": np.nan}
        with rasterio.Env(GDAL_CACHEMAX=CACHE_BYTES):
            self._image = rasterio.open(self._draft, "w+", driver="GTiff", sparse_ok=True, **profile)
        self._image.update_tags(**tags)

    def write(self, piece: Raster, bounds: Bounds, origin: tuple[float, float] = (0.0, 0.0)) -> None:
        """Put the cells of `piece` (metres about `origin`) whose centre is within `bounds` (world metres)
        in place.

        The piece's cells must be the mosaic's: same side, corners at whole multiples of it.
        """
        if abs(piece.cell - self.cell) > 1e-9:
            raise ValueError(f"the piece has cells of {piece.cell} m, the mosaic of {self.cell} m")
        column = round((piece.west + origin[0]) / self.cell) - self.first_column
        row = self.top_row - round((piece.north + origin[1]) / self.cell)
        rows, columns = piece.shape
        west, east = (
            int(np.ceil(x / self.cell - 0.5)) - self.first_column for x in (bounds.west, bounds.east)
        )
        top, bottom = (self.top_row - int(np.ceil(y / self.cell - 0.5)) for y in (bounds.north, bounds.south))
        left, right = max(column, west, 0), min(column + columns, east, self.columns)
        upper, lower = max(row, top, 0), min(row + rows, bottom, self.rows)
        if left >= right or upper >= lower:
            return
        part = piece.values[upper - row : lower - row, left - column : right - column]
        self._image.write(self._stored(part), 1, window=Window(left, upper, right - left, lower - upper))

    def overlay(self, piece: Raster, origin: tuple[float, float] = (0.0, 0.0)) -> None:
        """Put those cells of `piece` (metres about `origin`) in place that have a value, and lie inside."""
        column = round((piece.west + origin[0]) / self.cell) - self.first_column
        row = self.top_row - round((piece.north + origin[1]) / self.cell)
        rows, columns = piece.shape
        window = Window(column, row, columns, rows).intersection(Window(0, 0, self.columns, self.rows))
        left, upper = window.col_off - column, window.row_off - row
        part = self._stored(piece.values[upper : upper + window.height, left : left + window.width])
        earlier = self._image.read(1, window=window)
        self._image.write(np.where(np.isnan(part), earlier, part), 1, window=window)

    def finish(self) -> None:
        """Write the file itself and drop the draft."""
        options = {key.upper(): str(value) for key, value in COG_OPTIONS.items() if key != "driver"}
        sampling = Resampling.average
        if self.mask:
            options["PREDICTOR"], sampling = "NO", Resampling.nearest
        halvings = int(np.ceil(np.log2(max(self.rows, self.columns) / COG_OPTIONS["blocksize"])))
        with rasterio.Env(GDAL_CACHEMAX=CACHE_BYTES), atomic(self.path) as temporary:
            if halvings > 0:  # overviews of the draft are copied; without, they are compressed twice
                self._image.build_overviews([2**k for k in range(1, halvings + 1)], sampling)
            self._image.close()
            rasterio.shutil.copy(str(self._draft), str(temporary), driver="COG", **options)
        self.discard()

    def discard(self) -> None:
        """Drop the draft without writing the file."""
        self._image.close()
        shutil.rmtree(self._workplace, ignore_errors=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.discard() if kind else self.finish()

    def _stored(self, values: NDArray[np.float32]) -> NDArray[Any]:
        if self.mask:
            return (np.nan_to_num(values) > 0).astype(np.uint8)
        return (values / self.unit).astype(np.float32)


def round_down(value: float, cell: float) -> int:
    """The number of the grid line at or below a coordinate; one a hair above a line counts as on it."""
    return int(np.floor(value / cell + 1e-9))
