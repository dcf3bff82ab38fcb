"""The ground stage: contract of a ground filter, and the function that classifies a cloud."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from eaves.ground.toolkit.floor import Floor
from eaves.ground.toolkit.seeds import find_outliers
from eaves.ground.toolkit.wide_objects import Patch, WideObjects
from eaves.kernels import kernel
from eaves.methods import Emit, Method, MethodChoice, check_returned, emitter, ignore, naming, resolve_method
from eaves.model import (
    GROUND,
    HIGH_NOISE,
    LOW_NOISE,
    UNCLASSIFIED,
    Bounds,
    Integers,
    Mask,
    PointCloud,
    Points,
)
from eaves.model.checks import check_type, is_array


class GroundMethod(Method):
    """Interface of a ground filter.

    `ground_mask` gets a cloud without noise, in canonical order, about the origin of its block, with or
    without returns, and returns a mask (N,). It must accept 0, 1, 2, collinear and duplicate points.

    Examples
    --------
    >>> import eaves
    >>> isinstance(eaves.AdaptiveTin(), eaves.GroundMethod)
    True
    """

    stage: ClassVar[str] = "ground"
    start: ClassVar[str] = ""
    """Name of the intermediate that a block's terrain begins with; a run says in how many it is empty."""

    def ground_mask(self, cloud: PointCloud, emit: Emit = ignore) -> Mask:
        """Mask (N,) of the points that are ground; see the class."""
        raise NotImplementedError

    def separate(
        self, cloud: PointCloud, over: Mask, emit: Emit = ignore, core: Bounds | None = None
    ) -> tuple[Mask, NDArray[np.uint8] | None]:
        """The mask (N,), and the walls, trees and small regions (N,) found on the way, by a filter that does;
        or the points it is not sure of. Some points (N,) are known to stand `over` the terrain, and only
        those within `core` need an answer.

        What is found once is handed on with the cloud (`PointCloud.part`), so that the detector of the same
        paper need not find it again.
        """
        mask = np.zeros(len(cloud), bool)
        below = np.flatnonzero(~over)
        ground = self.ground_mask(cloud.take(below), emit)
        check_returned(self, is_array(ground, len(below), "b"), f"an array ({len(below)},) of bool", ground)
        mask[below] = ground
        return mask, None

    @property
    def wide_buffer(self) -> float:
        """Largest distance (m) at which a point still changes what `find_wide_objects` finds here; 0 where it
        finds nothing. A tiler adds the side of its squares.
        """
        return 0.0

    def find_wide_objects(self, floor: Floor) -> Patch | None:
        """Objects of any width that the method removes before its filter sees a point; None for nothing.

        `floor` may be that of a far wider surrounding than `buffer`.
        """
        return None


def classify_ground(
    cloud: PointCloud,
    method: MethodChoice = None,
    *,
    use_classes: bool = False,
    wide: WideObjects | None = None,
    core: Bounds | None = None,
    debug: str | Path | Emit | None = None,
) -> PointCloud:
    """The cloud with classes 2 (ground), 7 and 18 (low and high noise) and 1 (the rest).

    Parameters
    ----------
    cloud : PointCloud
        N ≥ 0 points in any order, in local metres; those with NaN coordinates become class 7.
    method : GroundMethod, str, mapping or None
        The filter, its name, or its parameters; None is `AdaptiveTin()`.
    use_classes : bool
        Use the file's classes 2, 7 and 18 instead of filtering, and keep its other classes; without any class
        2 the method runs all the same. Noise classes of the file are kept in any case.
    wide : WideObjects or None
        What stands over the terrain, where more than the cloud was seen to find it; by default it is looked
        for in the cloud.
    core : Bounds or None
        Local metres in which points are wanted; the others are there to judge them, and their class may be 1.
    debug : str, Path, callable or None
        A folder or a callback `(name, value)` that receives every named intermediate.

    Returns
    -------
    PointCloud
        The same N points in the same order; `classification` (N,) uint8 is replaced.

    Raises
    ------
    TypeError
        When `cloud` is no PointCloud, or `method` no ground method.
    ValueError
        When no method or parameter has that name, or a value is out of range.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> cloud = eaves.classify_ground(truth.cloud)
    >>> wrong = (cloud.classification == 2) != (truth.truth_class == 2)
    >>> bool(wrong.mean() < 0.05)
    True
    """
    if hasattr(cloud, "header"):  # of laspy
        cloud = PointCloud.from_laspy(cloud)
    check_type(cloud, PointCloud, "cloud", "use eaves.read(path) or PointCloud.from_world(xyz)")
    filter_ = resolve_method("ground", method)
    assert isinstance(filter_, GroundMethod)
    file_classes = cloud.classification
    finite = finite_kernel(cloud.xyz)
    classes = np.full(len(cloud), UNCLASSIFIED, np.uint8)
    classes[~finite] = LOW_NOISE
    if use_classes and file_classes is not None and bool((file_classes == GROUND).any()):
        classes[finite] = file_classes[finite]
        return cloud.with_(classification=classes)

    noise = finite & cloud.noise
    if file_classes is not None:  # noise classes of the file are always kept
        classes[noise] = file_classes[noise]
    usable = np.flatnonzero(finite & ~noise)
    clean = cloud.with_(classification=None, part=None, point_id=None).take(usable)
    low, high = find_outliers(clean)
    classes[usable[low]], classes[usable[high]] = LOW_NOISE, HIGH_NOISE
    good = np.flatnonzero(~(low | high))
    clean, place = clean.take(good), usable.take(good)
    if not clean.ordered:
        order = clean.canonical_order()
        clean, place = clean.take(order), place.take(order)
    del usable, good, low, high, finite, noise  # of a dense square they would be alive at the peak of memory
    if wide is None and len(clean):
        patch = filter_.find_wide_objects(Floor.of(clean))
        wide = None if patch is None else WideObjects((patch,))
    over = np.zeros(len(clean), bool) if wide is None else wide.over(clean)
    emit = ignore if debug is None else of_all_points(emitter(debug), place, len(cloud))
    with naming(filter_):
        mask, unsure = filter_.separate(clean, over, emit, core)
    check_returned(filter_, is_array(mask, len(clean), "b"), f"an array ({len(clean)},) of bool", mask)
    classes[place[mask]] = GROUND
    part = None
    if unsure is not None:
        part = np.zeros(len(cloud), np.uint8)
        part[place] = unsure
    return cloud.with_(classification=classes, part=part)


def of_all_points(emit: Emit, place: Integers, count: int) -> Emit:
    """An `Emit` that takes numbers of the points `place` (M,) as numbers of all points (N,), without 0, NaN
    where none were computed: the filter sees no outliers, and the caller does not know which they are."""

    def spread(name: str, value: Any) -> None:
        if isinstance(value, np.ndarray) and value.shape == (len(place),):
            every = np.full(count, np.nan) if value.dtype.kind == "f" else np.zeros(count, value.dtype)
            every[place] = value
            value = every
        emit(name, value)

    return spread


def numbers_within(bounds: Bounds, xyz: Points) -> Integers:
    """The numbers (K,) of the points (N, 3) that lie within some bounds, rising."""
    return np.asarray(within_kernel(xyz, bounds.west, bounds.south, bounds.east, bounds.north))


@kernel
def within_kernel(xyz: Points, west: float, south: float, east: float, north: float) -> Integers:
    """The numbers (K,) of the points (N, 3) in a rectangle, half-open towards east and north."""
    numbers, count = np.empty(len(xyz), np.int64), 0
    for i in range(len(xyz)):
        numbers[count] = i
        count += west <= xyz[i, 0] < east and south <= xyz[i, 1] < north
    return numbers[:count].copy()


@kernel
def finite_kernel(xyz: Points) -> Mask:
    """Mask (N,) of the points (N, 3) that have coordinates."""
    finite = np.empty(len(xyz), np.bool_)
    for i in range(len(xyz)):
        finite[i] = np.isfinite(xyz[i, 0]) and np.isfinite(xyz[i, 1]) and np.isfinite(xyz[i, 2])
    return finite
