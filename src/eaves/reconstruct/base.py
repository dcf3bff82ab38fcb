"""The reconstruction stage: contract of a reconstructor, and the verb that models one building."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from eaves.methods import Emit, Method, emitter, ignore, make_method
from eaves.model import BuildingModel, Failure, Footprint, Points, RoofPlane


class Reconstructor(Method):
    """Makes the solids of one building.

    `model` sees the building's points (N, 3), its footprint and roof planes, all in the same local
    metres, and the
    height of the solid's base (m). It answers a BuildingModel whose `solids` are closed, or a Failure.
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
        raise NotImplementedError


def reconstruct_building(
    points: Points,
    footprint: Footprint,
    planes: list[RoofPlane],
    ground: float,
    method: Reconstructor | None = None,
    *,
    debug: str | Path | Emit | None = None,
) -> BuildingModel | Failure:
    """The model of one building, or the Failure that says why there is none.

    When the method fails, the building falls back to a prism (LoD 1.2), and says so in its attributes
    `fallback_code` and `fallback_reason`; only when that fails too is the answer a Failure.
    """
    from eaves.reconstruct.prism import Prism

    modeller = method or make_method("reconstruct")
    assert isinstance(modeller, Reconstructor)
    emit = emitter(debug)
    answer = modeller.model(points, footprint, planes, ground, emit)
    if isinstance(answer, BuildingModel):
        return answer.with_(attributes={"method": modeller.name, "lod": answer.lod, **answer.attributes})
    simple = Prism().model(points, footprint, planes, ground, emit)
    if isinstance(simple, Failure):
        return simple
    return simple.with_(
        attributes={
            "method": Prism.name,
            "lod": simple.lod,
            "fallback_code": answer.code,
            "fallback_reason": answer.reason,
            **simple.attributes,
        }
    )
