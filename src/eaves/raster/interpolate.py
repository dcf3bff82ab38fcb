"""Cells without a value get one from the cells that have."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.geometry.tin import OUTSIDE, Ids, Tin, walk
from eaves.kernels import kernel
from eaves.model import GRID_STEP, Grid, Integers, Mask, Points, Raster, Values

FARTHEST_CELLS = 1 << 24
"""More cells than a raster has along a side."""

ADJOINING = 2
"""Square of the distance of two cells that touch at a corner."""


def nearest_cells(occupied: Mask, rows: Integers, columns: Integers) -> tuple[Integers, Integers]:
    """Row and column (K,) of the cell of `occupied` (H, W) nearest to each of the cells (K,) given by row and
    column, whose rows do not fall; at least one is known.

    Of cells equally near it is the one in the westernmost column, of two in a column the northern one.
    """
    row, column = nearest_kernel(occupied, away_kernel(occupied), rows, columns)
    return row, column


def near_cells(occupied: Mask, square: int) -> Mask:
    """The cells (H, W) with one of `occupied` (H, W) no farther than the root of `square`, in cells."""
    steps = np.arange(int(np.sqrt(square)) + 1)
    return np.asarray(near_kernel(away_kernel(occupied), np.sqrt(square - steps**2).astype(np.int32)))


def places(rows: Integers, columns: Integers) -> Points:
    """Cells (K,) as points (K, 2) of a plane, x to the east and y to the north."""
    return np.asarray(np.c_[columns, -rows], np.float64)


@kernel
def away_kernel(occupied: Mask) -> NDArray[np.int32]:
    """Rows (H, W) between each cell and the nearest known one in its column, up or down."""
    rows, columns = occupied.shape
    away = np.full((rows, columns), FARTHEST_CELLS, np.int32)
    for row in range(rows):
        for column in range(columns):
            if occupied[row, column]:
                away[row, column] = 0
            elif row > 0:
                away[row, column] = away[row - 1, column] + 1
    for row in range(rows - 2, -1, -1):
        for column in range(columns):
            away[row, column] = min(away[row, column], away[row + 1, column] + 1)
    return away


@kernel
def nearest_kernel(
    occupied: Mask, away: NDArray[np.int32], rows: Integers, columns: Integers
) -> tuple[Integers, Integers]:
    """Row and column (K,) of the known cell nearest to each of some cells (K,), whose rows do not fall.

    `away` is that of `away_kernel`. The squares of the distances to the nearest known cell of each column are
    parabolas along a row; `envelope` holds those of their lower envelope, from west to east, and `first` the
    column from which each is the least (Felzenszwalb and Huttenlocher 2012).
    """
    width = occupied.shape[1]
    nearest_row, nearest_column = np.empty(len(rows), np.int64), np.empty(len(rows), np.int64)
    envelope, first, last_row, count = np.empty(width, np.int64), np.empty(width, np.int64), -1, 0
    for i in range(len(rows)):
        row = rows[i]
        if row != last_row:
            last_row, count = row, 0
            for column in range(width):
                if away[row, column] >= FARTHEST_CELLS:
                    continue
                height = np.int64(away[row, column]) ** 2 + column * column
                start = np.int64(0)
                while count > 0:
                    before = envelope[count - 1]
                    rise = height - (np.int64(away[row, before]) ** 2 + before * before)
                    start = rise // (2 * (column - before)) + 1
                    if start > first[count - 1]:
                        break
                    count -= 1
                if count == 0:
                    start = np.int64(0)
                if start < width:
                    envelope[count], first[count] = column, start
                    count += 1
        low, high = 0, count - 1
        while low < high:
            middle = (low + high + 1) // 2
            if first[middle] <= columns[i]:
                low = middle
            else:
                high = middle - 1
        column = envelope[low]
        above = row - away[row, column]
        nearest_row[i] = above if above >= 0 and occupied[above, column] else row + away[row, column]
        nearest_column[i] = column
    return nearest_row, nearest_column


@kernel
def near_kernel(away: NDArray[np.int32], most: NDArray[np.int32]) -> Mask:
    """Cells (H, W) that are `away` from a known one, in a column so many steps aside, by at most `most`."""
    rows, columns = away.shape
    mask = np.zeros((rows, columns), np.bool_)
    for row in range(rows):
        here, line = away[row], mask[row]
        for step in range(min(len(most), columns)):
            limit, span = most[step], columns - step
            aside, line_aside = here[step:], line[step:]
            for column in range(span):
                line[column] |= aside[column] <= limit
            for column in range(span):
                line_aside[column] |= here[column] <= limit
    return mask


SHORT_GAP = 2  # cells; a gap in a row or column of cells that needs no triangles


def fill_nearest(raster: Raster, within: float) -> Raster:
    """Empty cells take the value of the nearest filled cell that is at most `within` (m) away, as
    `nearest_cells` picks it."""
    most = int(within / raster.cell)
    down, right = np.indices((2 * most + 1, 2 * most + 1)).reshape(2, -1) - most
    order = np.lexsort((down, right, down**2 + right**2))
    order = order[np.hypot(down, right)[order] * raster.cell <= within]
    return raster.with_(values=first_filled_kernel(raster.values, down[order], right[order]))


@kernel
def first_filled_kernel(values: Grid, down: Integers, right: Integers) -> Grid:
    """Values (H, W) in which an empty cell has that of the first filled one among the steps (K,) from it."""
    rows, columns = values.shape
    filled = values.copy()
    for row in range(rows):
        for column in range(columns):
            if not np.isnan(values[row, column]):
                continue
            for k in range(len(down)):
                r, c = row + down[k], column + right[k]
                if 0 <= r < rows and 0 <= c < columns and not np.isnan(values[r, c]):
                    filled[row, column] = values[r, c]
                    break
    return filled


def fill_linear(raster: Raster) -> Raster:
    """Empty cells in a short gap take the height between its ends, the others that of the Delaunay triangle
    of filled cells they lie in, or the nearest outside the hull.
    """
    return fill_between(raster.with_(values=short_gaps_kernel(raster.values, SHORT_GAP)))


def fill_between(raster: Raster) -> Raster:
    """Empty cells take the height of the Delaunay triangle of filled cells they lie in, or the nearest
    outside the hull: for thin scans, whose gaps are mostly short."""
    finite = np.isfinite(raster.values)
    if finite.all() or not finite.any():
        return raster
    rim = finite & near_cells(~finite, ADJOINING)
    return raster.with_(values=interpolate_cells(raster.values, rim, ~finite))


def fill_linear_twice(raster: Raster, richer: Raster) -> tuple[Raster, Raster]:
    """A raster and a richer one, in which more of the same cells are filled or their values are others, both
    filled as `fill_linear` does: the cells that only the second has join the triangles of the first.
    """
    raster, richer = (
        source.with_(values=short_gaps_kernel(source.values, SHORT_GAP)) for source in (raster, richer)
    )
    finite, more = np.isfinite(raster.values), np.isfinite(richer.values)
    if finite.all() or not finite.any() or more.all():
        return fill_between(raster), fill_between(richer)
    rim, second_rim = (cells & near_cells(~cells, ADJOINING) for cells in (finite, more))
    rows, columns = np.concatenate([np.nonzero(rim), np.nonzero(second_rim & ~finite)], axis=1)
    count = np.count_nonzero(rim)
    tin = Tin(places(rows, columns), np.arange(count))

    def filled(source: Raster, around: Mask, target: Mask) -> Raster:
        heights = source.values[rows, columns].astype(np.float64)
        return source.with_(values=interpolate_in(tin, heights, source.values, around, target))

    first = filled(raster, rim, ~finite)
    tin.insert(np.arange(count, len(rows)))
    return first, filled(richer, second_rim, ~more)


@kernel
def short_gaps_kernel(values: Grid, most: int) -> Grid:
    """Values (H, W) in which an empty cell has the height between the two ends of its gap, if that is at most
    `most` cells long in its row or column; of both the shorter, their mean when they are as long."""
    rows, columns = values.shape
    filled = values.copy()
    for row in range(rows):
        for column in range(columns):
            if not np.isnan(values[row, column]):
                continue
            shortest, total, count = most + 1, 0.0, 0
            for down, right in ((0, 1), (1, 0)):
                back, ahead = 1, 1
                while (
                    back <= most
                    and row - back * down >= 0
                    and column - back * right >= 0
                    and np.isnan(values[row - back * down, column - back * right])
                ):
                    back += 1
                while (
                    back + ahead <= most + 1
                    and row + ahead * down < rows
                    and column + ahead * right < columns
                    and np.isnan(values[row + ahead * down, column + ahead * right])
                ):
                    ahead += 1
                if row - back * down < 0 or column - back * right < 0:
                    continue
                if row + ahead * down >= rows or column + ahead * right >= columns:
                    continue
                before = values[row - back * down, column - back * right]
                behind = values[row + ahead * down, column + ahead * right]
                if back + ahead > shortest or np.isnan(before) or np.isnan(behind):
                    continue
                if back + ahead < shortest:
                    shortest, total, count = back + ahead, 0.0, 0
                total += (ahead * before + back * behind) / (back + ahead)
                count += 1
            if count:
                filled[row, column] = total / count
    return filled


def interpolate_cells(values: Grid, finite: Mask, target: Mask) -> Grid:
    """Values (H, W), those of the wanted cells (H, W) linear between the known cells (H, W)."""
    known_rows, known_columns = np.nonzero(finite)
    heights = values[known_rows, known_columns].astype(np.float64)
    return interpolate_in(Tin(places(known_rows, known_columns)), heights, values, finite, target)


def interpolate_in(tin: Tin, heights: Values, values: Grid, finite: Mask, target: Mask) -> Grid:
    """Values (H, W), those of the wanted cells (H, W) from a TIN of cells with heights (N,); beyond its hull
    from the nearest known cell (H, W)."""
    filled = values.astype(np.float32)
    outside = target
    if len(tin.vertices):
        outside = facets_kernel(
            filled, target, tin.xy, heights, tin.whole, tin.corner, tin.vertices, tin.neighbours
        )
    rows, columns = np.nonzero(outside)
    if len(rows):
        filled[rows, columns] = values[nearest_cells(finite, rows, columns)]
    return filled


@kernel
def facets_kernel(
    filled: Grid,
    target: Mask,
    xy: Points,
    heights: Values,
    steps: Integers,
    corner: Values,
    vertices: Ids,
    neighbours: Ids,
) -> Mask:
    """Write the height of the facet at each wanted cell (H, W) into `filled`; those beyond the hull (H, W).

    The points of the TIN are those of `places`.
    """
    rows, columns = target.shape
    outside = np.zeros((rows, columns), np.bool_)
    here = 0
    for row in range(rows):
        y = -float(row)
        steps_y = int(np.rint((y - corner[1]) / GRID_STEP))
        for column in range(columns):
            if not target[row, column]:
                continue
            x = float(column)
            here = walk(steps, vertices, neighbours, here, int(np.rint((x - corner[0]) / GRID_STEP)), steps_y)
            a, b, c = vertices[here, 0], vertices[here, 1], vertices[here, 2]
            if a == OUTSIDE or b == OUTSIDE or c == OUTSIDE:
                outside[row, column] = True
                continue
            ux, uy = xy[b, 0] - xy[a, 0], xy[b, 1] - xy[a, 1]
            vx, vy = xy[c, 0] - xy[a, 0], xy[c, 1] - xy[a, 1]
            wx, wy = x - xy[a, 0], y - xy[a, 1]
            area = ux * vy - uy * vx
            s, t = (wx * vy - wy * vx) / area, (ux * wy - uy * wx) / area
            filled[row, column] = heights[a] + s * (heights[b] - heights[a]) + t * (heights[c] - heights[a])
    return outside
