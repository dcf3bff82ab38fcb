"""Checks of arguments: each raises one sentence with argument, rule, value and remedy."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

log = logging.getLogger("eaves")

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
