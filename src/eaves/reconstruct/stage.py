"""The reconstruction stage: contract of a reconstructor, and the verb that models one building."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from eaves.methods import Emit, Method, MethodChoice, emitter, ignore, make_method, resolve_method
from eaves.model import BuildingModel, Failure, Footprint, Points, RoofPlane
from eaves.model.cloud import canonical_order

FALLBACK = "prism"
"""The method that models what the chosen one cannot."""


class Reconstructor(Method):
    """Makes the solids of one building.

    `model` sees the building's points (N, 3) in canonical order, its footprint and roof planes, all in
    the same local metres, and the height of the solid's base (m). It answers a BuildingModel whose
    `solids` are closed, or a Failure.
    """

    stage: ClassVar[str] = "reconstruct"

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


def reconstruct_building(
    points: Points,
    footprint: Footprint,
    planes: list[RoofPlane],
    ground: float,
    method: MethodChoice = None,
    *,
    debug: str | Path | Emit | None = None,
) -> BuildingModel | Failure:
    """The model of one building, or the Failure that says why there is none.

    When the method fails, the building falls back to a prism (LoD 1.2), and says so in its attributes
    `fallback_code` and `fallback_reason`; only when that fails too is the answer a Failure.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> points = truth.cloud.xyz[truth.building == 1]
    >>> outline = eaves.trace_outline(points, spacing=0.5)
    >>> footprint = eaves.regularise_outlines([outline])[0]
    >>> planes = eaves.segment_roof(points, spacing=0.5)
    >>> model = eaves.reconstruct_building(points, footprint, planes, ground=truth.buildings[0].base)
    >>> model.lod
    '2.2'
    """
    modeller = resolve_method("reconstruct", method)
    assert isinstance(modeller, Reconstructor)
    emit = emitter(debug)
    order = canonical_order(points)
    place = np.empty(len(points), np.int64)
    place[order] = np.arange(len(points))
    ordered = [replace(plane, members=np.sort(place[plane.members])) for plane in planes]
    answer = modeller.model(points[order], footprint, ordered, ground, emit)
    facts: dict[str, object] = {"method": modeller.name}
    if isinstance(answer, Failure):
        facts = {"method": FALLBACK, "fallback_code": answer.code, "fallback_reason": answer.reason}
        fallback = make_method("reconstruct", FALLBACK)
        assert isinstance(fallback, Reconstructor)
        answer = fallback.model(points[order], footprint, ordered, ground, emit)
    if isinstance(answer, Failure):
        return answer
    back = tuple(replace(plane, members=np.sort(order[plane.members])) for plane in answer.planes)
    return answer.with_(planes=back, attributes={**facts, "lod": answer.lod, **answer.attributes})
