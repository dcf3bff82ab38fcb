"""The snap-rounded arrangement of line segments inside a polygon."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from eaves.geometry.coverage import Coverage, coverage_of
from eaves.geometry.tolerance import COORDINATE_STEP


def arrange(
    polygon: Polygon, segments: NDArray[np.float64], grid: float = COORDINATE_STEP
) -> Coverage | None:
    """The cells that segments (S, 4: x, y, x, y) cut a polygon into, nodes on the grid (m).

    Ends that hang free cut nothing. None when the polygon has no area on the grid.
    """
    whole = shapely.set_precision(polygon, grid)
    if whole.geom_type != "Polygon" or whole.is_empty:
        return None
    if len(segments) == 0:
        return coverage_of(np.array([whole], object), grid)
    lines = shapely.linestrings(np.asarray(segments, float).reshape(-1, 2, 2))
    net = shapely.union_all(np.append(lines, whole.boundary), grid_size=grid)
    cells = shapely.get_parts(shapely.polygonize(shapely.get_parts(net)))
    if len(cells) == 0:
        return None
    shapely.prepare(whole)
    inside = shapely.contains_properly(whole, shapely.point_on_surface(cells))
    return coverage_of(cells[inside], grid) if inside.any() else None
