"""Names for the array shapes that flow through the package."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.extensions import imported

Points = NDArray[np.float64]
"""(N, 3) x, y, z: east, north, up; metres about a local origin."""
Mask = NDArray[np.bool_]
"""(N,) or (H, W) truth values."""
Labels = NDArray[np.int32]
"""(N,) or (H, W) labels; 0 means none."""
Values = NDArray[np.float64]
"""(N,) numbers."""
Integers = NDArray[np.int64]
"""(N,) whole numbers: places, counts, vertices of faces."""
Grid = NDArray[np.float32]
"""(H, W) raster values, row 0 north, NaN where missing."""
Rectangle = tuple[float, float, float, float]
"""West, south, east, north, in the units of a file."""


class Pictured:
    """A value that shows itself in a notebook, drawn by `eaves.report.pictures`."""

    def _repr_html_(self) -> str:
        return str(imported("eaves.report.pictures:as_html")(self))
