"""The reconstruction stage: contract of a reconstructor, and the function that models one building."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

from eaves.methods import (
    Emit,
    Method,
    MethodChoice,
    check_returned,
    emitter,
    ignore,
    naming,
    resolve_method,
)
from eaves.model import BuildingModel, Failure, Footprint, PointCloud, Points, Raster, RoofPlane, Scene
from eaves.model.checks import check_planes, check_polygon, check_type, checked_base
from eaves.model.cloud import canonical_order, plain_points
from eaves.raster.surfaces import heights_under
from eaves.reconstruct.toolkit.ceiling import height_over_points

FALLBACK = "prism"
"""The method that models what the chosen one cannot."""
ABSENT = -1
"""The place of a point without coordinates."""


@dataclass(frozen=True, eq=False)
class BlockPart:
    """A house in a block that was drawn as one: what the method drew of the block, the number of the house
    there, and the roof planes of its own points."""

    block: Any
    number: int
    planes: list[RoofPlane]


class Reconstructor(Method):
    """The contract of a reconstruction method.

    `model` gets the building's points (N, 3) in canonical order, its footprint and roof planes, all in the
    same local metres, and the height of the solid's base (m). It returns a BuildingModel whose `solids` are
    closed, or a Failure.

    Examples
    --------
    >>> import eaves
    >>> isinstance(eaves.Arrangement(), eaves.Reconstructor)
    True
    """

    stage: ClassVar[str] = "reconstruct"
    draws_blocks: ClassVar[bool] = False
    """True for a method that models the houses of a block as one: it has `draw` and `raise_part`."""

    def model(
        self,
        points: Points,
        footprint: Footprint,
        planes: list[RoofPlane],
        ground: float,
        emit: Emit = ignore,
    ) -> BuildingModel | Failure:
        """A model or the reason for none; see the class."""
        raise NotImplementedError

    def draw(
        self,
        points: Points,
        parts: Sequence[Polygon],
        planes: list[RoofPlane],
        ground: float,
        emit: Emit = ignore,
    ) -> Any | Failure:
        """What is drawn of a block at once, from all its points (N, 3) and planes: of its houses, whose
        outlines are the `parts`."""
        raise NotImplementedError

    def raise_part(
        self,
        part: BlockPart,
        points: Points,
        footprint: Footprint,
        ground: float,
        emit: Emit = ignore,
    ) -> BuildingModel | Failure:
        """The model of a house in a block that was drawn, from its own points (N, 3), over its base (m)."""
        raise NotImplementedError


def reconstruct_building(
    points: Points | PointCloud,
    footprint: Footprint | Failure,
    planes: list[RoofPlane],
    ground: float | Scene | Raster | None = None,
    method: MethodChoice = None,
    *,
    part: BlockPart | None = None,
    debug: str | Path | Emit | None = None,
) -> BuildingModel | Failure:
    """The model of one building, or the Failure with the reason.

    When the method fails, the building falls back to a prism (LoD 1.2), and its attributes `fallback_code`
    and `fallback_reason` state why; only when that fails too is the result a Failure.

    Parameters
    ----------
    points : ndarray (N, 3) or PointCloud
        x, y, z of the building in local metres; points with NaN coordinates are left out.
    footprint : Footprint or Failure
        The outline, in the same local metres; a Failure of the outline is given back.
    planes : list of RoofPlane
        The planes of `segment_roof`; their `members` index `points`.
    ground : float, Scene or Raster
        Height (m) of the base of the solids, or the terrain, whose lowest height on the outline is the base.
    method : Reconstructor, str, mapping or None
        The method, its name, or its parameters; None is `Arrangement()`.
    part : BlockPart or None
        What `draw_blocks` drew of a house in a block; None for a building alone.
    debug : str, Path, callable or None
        A folder or a callback `(name, value)` that receives every named intermediate.

    Returns
    -------
    BuildingModel or Failure
        The model with the attributes `method`, `lod`, and `over_points_m`: how far (m) a corner of its roof
        lies over the highest point where no two planes that have points there meet.

    Raises
    ------
    TypeError
        When `points` are no numbers, `footprint` no Footprint of a Polygon, or `method` no reconstruction
        method.
    ValueError
        When `points` has another shape, the polygon is not valid, a plane has coefficients that are no
        numbers or members that are no points, `ground` is left out, not finite or over 2 km from the points,
        or no method or parameter has that name.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> points = truth.cloud.xyz[truth.building == 1]
    >>> footprint = eaves.regularise_outlines(eaves.trace_outline(points))
    >>> planes = eaves.segment_roof(points)
    >>> model = eaves.reconstruct_building(points, footprint, planes, ground=truth.buildings[0].base)
    >>> model.lod
    '2.2'
    """
    points = plain_points(points)
    if isinstance(footprint, Failure):
        return footprint
    check_type(footprint, Footprint, "footprint", "use Footprint(polygon) or regularise_outlines")
    check_polygon(footprint.polygon, "footprint.polygon")
    check_planes(planes, len(points))
    if isinstance(ground, Scene | Raster):
        ground = heights_under(footprint, ground.dtm if isinstance(ground, Scene) else ground)[0]
    ground = checked_base(ground, points)
    modeller = resolve_method("reconstruct", method)
    assert isinstance(modeller, Reconstructor)
    emit = emitter(debug)
    order, ordered = in_order(points, planes)
    with naming(modeller):
        if part is None or not modeller.draws_blocks:
            result = modeller.model(points[order], footprint, ordered, ground, emit)
        else:
            part = replace(part, planes=ordered)
            result = modeller.raise_part(part, points[order], footprint, ground, emit)
    is_result = isinstance(result, BuildingModel | Failure)
    check_returned(modeller, is_result, "a BuildingModel or a Failure", result)
    facts: dict[str, object] = {"method": modeller.name}
    if isinstance(result, Failure):
        facts = {"method": FALLBACK, "fallback_code": result.code, "fallback_reason": result.reason}
        fallback = resolve_method("reconstruct", FALLBACK)
        assert isinstance(fallback, Reconstructor)
        result = fallback.model(points[order], footprint, ordered, ground, emit)
    if isinstance(result, Failure):
        return result
    facts["over_points_m"] = round(height_over_points(result.solids[result.lod], points[order]), 2)
    back = tuple(replace(plane, members=np.sort(order[plane.members])) for plane in result.planes)
    return result.with_(planes=back, attributes={**facts, "lod": result.lod, **result.attributes})


def draw_block(
    points: Points, parts: Sequence[Polygon], planes: list[RoofPlane], ground: float, method: Reconstructor
) -> Any | Failure:
    """What a method draws of a block at once, from its points (N, 3), the outlines of its houses, its planes,
    whose members index the points, and the height (m) of its lowest base."""
    order, ordered = in_order(points, planes)
    with naming(method):
        return method.draw(points[order], parts, ordered, ground)


def in_order(points: Points, planes: Sequence[RoofPlane]) -> tuple[NDArray[np.int64], list[RoofPlane]]:
    """The numbers of the points (N, 3) that have coordinates, in canonical order, and the planes by places in
    it."""
    finite = np.flatnonzero(np.isfinite(points).all(axis=1))
    order = finite[canonical_order(points[finite])]
    place = np.full(len(points), ABSENT, np.int64)
    place[order] = np.arange(len(order))
    return order, [replace(plane, members=known_places(place, plane.members)) for plane in planes]


def known_places(place: NDArray[np.int64], members: NDArray[np.int64]) -> NDArray[np.int64]:
    """The places (K,) of a plane's points in canonical order, ascending, without those that are left out."""
    places = np.sort(place[members])
    return places[np.searchsorted(places, 0) :]
