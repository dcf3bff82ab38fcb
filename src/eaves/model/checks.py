"""Checks of arguments: each raises one sentence with argument, rule, value and remedy."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon
from shapely.validation import explain_validity

from eaves.extensions import imported

log = logging.getLogger("eaves")

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


SIZE = np.dtype(np.float64).itemsize
DIGITS_LOST = 0.001
"""Coordinates that are rounded by more (m), the resolution of scans, are said."""


def check_type(value: Any, kind: type, name: str, remedy: str) -> None:
    """Raise TypeError when a value is not of a class."""
    if not isinstance(value, kind):
        raise TypeError(f"{name} must be a {kind.__name__}, not {describe(value)}; {remedy}")


def as_points(points: Any, name: str = "points") -> NDArray[np.float64]:
    """Points (N, 3) of float64 in rows, made of any array or sequence of numbers, and said where its numbers
    have lost digits; TypeError or ValueError when they are no x, y, z."""
    if isinstance(points, np.ndarray) and points.dtype == np.float64 and points.flags.c_contiguous:
        array = points
    else:
        try:
            given = np.asarray(points)
        except ValueError:  # rows of several lengths
            given = np.zeros(0, object)
        if given.dtype.kind not in "fiu":
            raise TypeError(
                f"{name} must be numbers (N, 3), not {describe(points)}; pass an array of x, y, z in metres"
            )
        if given.dtype.kind == "f" and given.dtype.itemsize < SIZE:
            farthest = np.abs(given[np.isfinite(given)]).max(initial=0)
            if (step := float(np.spacing(farthest))) > DIGITS_LOST:
                log.warning(
                    "%s is %s, whose steps at %.0f are %.1f cm: take the numbers before they are rounded",
                    *(name, given.dtype, farthest, 100 * step),
                )
        array = np.ascontiguousarray(given, np.float64)
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"{name} must have the shape (N, 3), not {array.shape}; give x, y, z in its columns")
    return array


def check_polygon(polygon: Any, name: str) -> None:
    """Raise TypeError or ValueError when a value is no polygon that encloses an area once."""
    if not isinstance(polygon, Polygon):
        raise TypeError(f"{name} must be a Polygon, not {describe(polygon)}; make a footprint of each part")
    if polygon.is_empty or not polygon.is_valid:
        raise ValueError(
            f"{name} must be valid and not empty, but: {explain_validity(polygon)}; "
            "make a footprint of each polygon in shapely.make_valid(polygon)"
        )


def check_planes(planes: Sequence[Any], count: int) -> None:
    """Raise ValueError when a roof plane is not of numbers, or has members that are no points of `count`."""
    for number, plane in enumerate(planes):
        if not np.isfinite(plane.coefficients).all():
            raise ValueError(
                f"planes[{number}] must have finite coefficients, not {plane.coefficients}; leave it out"
            )
        members = np.asarray(plane.members)
        if members.ndim != 1 or (len(members) and members.dtype.kind not in "iu"):
            raise ValueError(
                f"planes[{number}].members must be an array (K,) of integers, not {describe(members)}; "
                "give the numbers of its points"
            )
        if len(members) and not 0 <= members.min() <= members.max() < count:
            raise ValueError(
                f"planes[{number}].members must be numbers of the {count} points, from 0 on, not "
                f"{members.min()} to {members.max()}; give the planes of these points"
            )


FARTHEST_BASE_M = 2000.0
"""No roof stands higher (m) over its base: the highest building is 828 m."""


def checked_base(ground: float | None, points: NDArray[np.float64]) -> float:
    """The height of a base; ValueError when it is none, or not of the building of some points (N, 3)."""
    if ground is None or not np.isfinite(ground):
        raise ValueError(
            f"ground must be a finite height in metres, not {ground}; give that of the base, or a scene"
        )
    heights = points[np.isfinite(points).all(axis=1), 2]
    middle = float(np.median(heights)) if len(heights) else ground
    if abs(middle - ground) > FARTHEST_BASE_M:
        raise ValueError(
            f"ground must lie within {FARTHEST_BASE_M:.0f} m of the points, not at {ground:.0f} m with these "
            f"at {middle:.0f} m; give the base of the building in metres"
        )
    return ground


def check_lengths(count: int, arrays: dict[str, NDArray[Any] | None]) -> None:
    """Raise TypeError or ValueError when one of some arrays has not the shape (count,)."""
    for name, array in arrays.items():
        if array is None:
            continue
        if not isinstance(array, np.ndarray):
            raise TypeError(f"{name} must be a numpy array ({count},), not {describe(array)}; use np.asarray")
        if array.shape != (count,):
            raise ValueError(
                f"{name} must have the shape ({count},), one value a point, not {array.shape}; "
                "take the same points of every array"
            )


def is_array(value: Any, count: int, kinds: str) -> bool:
    """True if a value is an array (count,) whose dtype is of one of some kinds, as numpy abbreviates them."""
    return isinstance(value, np.ndarray) and value.shape == (count,) and value.dtype.kind in kinds


def error_line(error: BaseException) -> str:
    """An exception in one line: its class, its message and its notes, which name the method that raised."""
    notes = "".join(f" ({note})" for note in getattr(error, "__notes__", ()))
    return " ".join(f"{type(error).__name__}: {error}{notes}".split())


def check_positive(value: Any, name: str, unit: str = "m") -> None:
    """Raise TypeError or ValueError when a value is no number above 0."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise TypeError(f"{name} must be a number of {unit}, not {describe(value)}; give a number above 0")
    if not 0 < value < np.inf:
        raise ValueError(f"{name} must be above 0 {unit} and finite, not {value}; give a number above 0")


def check_same_shape(first: NDArray[Any], second: NDArray[Any], names: Sequence[str]) -> None:
    """Raise ValueError when two arrays differ in shape."""
    if np.shape(first) != np.shape(second):
        raise ValueError(
            f"{names[0]} and {names[1]} must have the same shape, not {np.shape(first)} and "
            f"{np.shape(second)}; give both for the same elements"
        )


def describe(value: Any) -> str:
    """A value's type, and its dtype and shape when it is an array."""
    if isinstance(value, np.ndarray):
        return f"an array {value.shape} of {value.dtype}"
    if isinstance(value, list | tuple):
        kinds = sorted({type(item).__name__ for item in value})
        return f"a {type(value).__name__} of {len(value)} {' and '.join(kinds) or 'values'}"
    return "None" if value is None else f"a value of type {type(value).__name__}"
