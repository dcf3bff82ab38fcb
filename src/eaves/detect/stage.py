"""The detection stage: contract of a detector, and the function that finds buildings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import shapely
from numpy.typing import NDArray

from eaves.methods import Emit, Method, MethodChoice, check_returned, emitter, ignore, naming, resolve_method
from eaves.model import Labels, PointCloud, Points, Regions, Scene
from eaves.model.checks import check_type, is_array
from eaves.raster.surfaces import make_scene

MIN_AREA_M2 = 6.0
MIN_HEIGHT_M = 2.0
"""The smallest shed that counts as a building."""
STOREY_M, ROOM_M = 3.0, 2.5
"""Height of a storey: bushes and hedges stay below it, and parts of a building step by no more;
and the width and height of the smallest room, below which parts are hedges and walls."""

MOST = 0.75
"""Most of a thing: of a hole's rim that is raised, of a vehicle's top that is level."""
FEW_CELLS = 9
"""Groups of no more cells are measured by their hull, too."""
OBJECT = "an object of the size of a house, and no building"
"""What a doubt about such an object begins with."""
HOUSE_M2 = (30.0, 200.0)
"""Area of a house in plan."""
TALL_SHARE = 0.1
"""A building is as high as a tenth of its points: roof, not chimney."""


class Detector(Method):
    """The contract of a building detector.

    `label` gets a scene whose cloud is in canonical order, about the origin of its block. Noise points (class
    7, 18) are still in it and must get label 0, as must ground and vegetation. Labels need not be
    consecutive.

    Examples
    --------
    >>> import eaves
    >>> isinstance(eaves.Consensus(), eaves.Detector)
    True
    """

    stage: ClassVar[str] = "detect"
    ground_method: ClassVar[str] = "adaptive_tin"
    """The ground filter of the detector's own paper, used unless another is asked for."""

    @property
    def signs_buffer(self) -> float:
        """Width (m) of the surroundings of a block whose signs are added up."""
        return 0.0

    def count_signs(self, scene: Scene) -> NDArray[np.float64] | None:
        """What is counted in a scene of images, to be added up over its surroundings and given to `label` as
        `Scene.signs`; None for nothing."""
        return None

    def label(self, scene: Scene, emit: Emit = ignore) -> Regions:
        """A label for every point of the scene; see the class."""
        raise NotImplementedError


def detect_buildings(
    scene: Scene | PointCloud,
    method: MethodChoice = None,
    *,
    min_area: float = MIN_AREA_M2,
    min_height: float = MIN_HEIGHT_M,
    debug: str | Path | Emit | None = None,
) -> Regions:
    """Regions numbered 1…K from west to east, without the small and the low.

    Parameters
    ----------
    scene : Scene or PointCloud
        A classified cloud of N points, or that with its terrain and surface (`make_scene`).
    method : Detector, str, mapping or None
        The detector, its name, or its parameters; None is `Consensus()`.
    min_area : float
        Smallest area (m², ≥ 0) of a region in plan.
    min_height : float
        Height above the terrain (m, ≥ 0) that a tenth of a region's points must reach.
    debug : str, Path, callable or None
        A folder or a callback `(name, value)` that receives every named intermediate.

    Returns
    -------
    Regions
        `label` (N,) int32 in the order of the scene's points, 0 for no building.

    Raises
    ------
    TypeError
        When `scene` is no Scene, or `method` no detector.
    ValueError
        When no method or parameter has that name, or a value is out of range.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> cloud = truth.classified()
    >>> scene = eaves.make_scene(cloud)
    >>> regions = eaves.detect_buildings(scene)
    >>> int(regions.label.max()), len(regions.label) == len(cloud)
    (9, True)
    """
    if isinstance(scene, PointCloud):
        scene = make_scene(scene)
    check_type(scene, Scene, "scene", "use eaves.make_scene(cloud)")
    detector = resolve_method("detect", method)
    assert isinstance(detector, Detector)
    if not scene.cloud.ordered:
        order = scene.cloud.canonical_order()
        ordered = replace(scene, cloud=scene.cloud.in_canonical_order(), height=scene.height[order])
        found = detect_buildings(ordered, detector, min_area=min_area, min_height=min_height, debug=debug)
        back = np.argsort(order)
        part = None if found.part is None else found.part[back]
        return Regions(found.label[back], found.score, part, found.doubts)
    with naming(detector):
        found = detector.label(scene, emitter(debug))
    check_regions(detector, found, len(scene.cloud))
    label, kept = keep_regions(found.label, scene, min_area, min_height)
    score = found.score[kept - 1] if len(found.score) else np.ones(len(kept))
    part = None
    if found.part is not None:
        part = np.where((found.label > 0) & (label == 0), 0, found.part).astype(np.uint8)
    return Regions(label, score, part, found.doubts)


def check_regions(method: Detector, found: Regions, count: int) -> None:
    """Raise ContractError where what a detector returned is no Regions of so many points."""
    check_returned(method, isinstance(found, Regions), "Regions", found)
    held = is_array(found.label, count, "iu")
    check_returned(method, held, f"Regions whose label is an array ({count},) of int32", found.label)
    held = found.part is None or is_array(found.part, count, "u")
    check_returned(method, held, f"Regions whose part is an array ({count},) of uint8, or None", found.part)
    most = int(found.label.max(initial=0))
    held = len(found.score) == 0 or len(found.score) >= most
    check_returned(method, held, f"Regions with a score of each of {most} regions, or none", found.score)


def keep_regions(
    label: Labels, scene: Scene, min_area: float, min_height: float
) -> tuple[Labels, NDArray[np.int64]]:
    """Labels (N,) renumbered 1…K by the regions' westernmost cell, without the small and the low; the old
    numbers (K,)."""
    inside = np.flatnonzero(label > 0)
    if len(inside) == 0:
        return np.zeros_like(label), np.zeros(0, np.int64)
    numbers, which = np.unique(label[inside], return_inverse=True)
    area = area_of_cells(scene.cloud.xyz[inside], which, len(numbers), scene.spacing)
    order = np.argsort(which, kind="stable")
    count = np.bincount(which, minlength=len(numbers))
    start = np.cumsum(count) - count
    tall = np.bincount(which[scene.height[inside] >= min_height], minlength=len(numbers))
    good = np.flatnonzero((area >= min_area) & (tall > TALL_SHARE * count))
    west, south = (np.minimum.reduceat(scene.cloud.xyz[inside[order], axis], start) for axis in (0, 1))
    good = good[np.lexsort((south[good], west[good]))]
    new = np.zeros(len(numbers), np.int32)
    new[good] = np.arange(1, len(good) + 1, dtype=np.int32)
    result = np.zeros_like(label)
    result[inside] = new[which]
    return result, numbers[good].astype(np.int64)


def area_of_cells(xyz: Points, which: NDArray[np.int64], count: int, spacing: float) -> NDArray[np.float64]:
    """Area (m²) that the points of each of `count` groups cover: occupied cells about two spacings wide, and
    of few cells, which points on their borders overstate, no more than the hull and half a spacing around it.
    """
    side = max(0.5, 2.0 * spacing)
    cell = np.floor(xyz[:, :2] / side).astype(np.int64)
    cell -= cell.min(axis=0)
    key = (which * (int(cell[:, 0].max()) + 1) + cell[:, 0]) * (int(cell[:, 1].max()) + 1) + cell[:, 1]
    _, first = np.unique(key, return_index=True)
    cells = np.bincount(which[first], minlength=count)
    area = np.asarray(cells * (side * side), np.float64)
    few = cells <= FEW_CELLS
    member = np.flatnonzero(few[which])
    member = member[np.argsort(which[member], kind="stable")]
    number = (np.cumsum(few) - 1)[which[member]]
    hulls = shapely.convex_hull(shapely.multipoints(shapely.points(xyz[member, :2]), indices=number))
    area[few] = np.minimum(area[few], shapely.area(shapely.buffer(hulls, spacing / 2)))
    return area
