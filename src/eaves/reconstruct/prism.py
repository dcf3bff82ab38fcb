"""The block model: the footprint raised to one height."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from eaves.figures.attributes import describe_roof
from eaves.methods import Emit, ignore, parameter
from eaves.model import BuildingModel, Failure, Footprint, Points, RoofPlane
from eaves.reconstruct.stage import Reconstructor
from eaves.reconstruct.toolkit.evidence import (
    PRISM_PERCENTILE,
    seen_roof,
)
from eaves.solids.cutting import arrange
from eaves.solids.extrude import LOWEST_ROOF, extrude
from eaves.solids.soundness import find_defect


class Prism(Reconstructor):
    """The footprint raised to one height: LoD 1.2.

    The height is a percentile of the roof points inside the footprint, the highest ones around
    their place, so that walls and what lies under eaves do not count.

    Formula
    -------
    z = percentile_p { zᵢ : no point more than 0.6 m above pᵢ within 0.3 m }

    Fidelity
    --------
    LoD 1.2 after [biljecki2016]; the 70th percentile is what the 3DBAG [peters2022] raises its blocks to.

    Fails where
    -----------
    Fewer than three roof points: `too_few_points`. A footprint without area: `no_area`.

    Complexity
    ----------
    O(N log N).

    References
    ----------
    [biljecki2016], [peters2022].
    """

    name: ClassVar[str] = "prism"
    idea: ClassVar[str] = "The footprint raised to the 70th percentile of its roof points."
    paper: ClassVar[str] = "peters2022"

    percentile: float = parameter(
        PRISM_PERCENTILE,
        "Percentile of the roof points' heights at which the roof is put.",
        unit="percent",
        symbol="p",
        ge=0.0,
        le=100.0,
    )

    def model(
        self,
        points: Points,
        footprint: Footprint,
        planes: list[RoofPlane],
        ground: float,
        emit: Emit = ignore,
    ) -> BuildingModel | Failure:
        """The block model of one building from its points (N, 3)."""
        seen_points = seen_roof(points, footprint)
        if isinstance(seen_points, Failure):
            return seen_points
        inside, top = seen_points
        roof = points[top]
        coverage = arrange(footprint.polygon, np.zeros((0, 4)))
        if coverage is None:
            return Failure("no_area", "the footprint encloses no area", "reconstruct", footprint)
        height = max(float(np.percentile(roof[:, 2], self.percentile)), ground + LOWEST_ROOF)
        emit("height", height)
        plane = np.tile([0.0, 0.0, height], (coverage.count, 1))
        solids = extrude(coverage, plane, ground)
        if solids is None or any(find_defect(solid) for solid in solids):
            return Failure(
                "touches_itself",
                "the footprint touches itself and could not be parted",
                "reconstruct",
                footprint,
            )
        flat = RoofPlane(
            (0.0, 0.0, height), inside, float(np.sqrt(np.mean((roof[:, 2] - height) ** 2))), footprint.polygon
        )
        model = BuildingModel(footprint, {"1.2": tuple(solids)}, (flat,))
        return model.with_(attributes=describe_roof(model, points[inside], roof, ground))
