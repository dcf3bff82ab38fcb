"""From a labelled plan to sound solids: tidied more and more firmly until they are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eaves.model import Solid
from eaves.model.building import ROOF_SURFACE
from eaves.reconstruct.toolkit.coverage import Coverage, Integers
from eaves.reconstruct.toolkit.extrude import extrude
from eaves.reconstruct.toolkit.simplification import (
    SHORTEST_EDGE,
    absorb_slivers,
    drop_straight_nodes,
    is_sound,
    merge_short_edges,
)
from eaves.reconstruct.toolkit.soundness import find_defect
from eaves.reconstruct.toolkit.welding import weld_necks

FIRMNESS = (1.0, 2.5, 6.0)
"""Multiples of the shortest edge and the narrowest face, tried in turn until the solids are sound."""

JOG = 0.15
"""A border inside the plan that leaves a straight line by less than this (m) is straight."""


@dataclass(frozen=True, eq=False)
class Raised:
    """Solids over a plan, and the number of the label (F,) each of their roof faces carries, in order.

    `Face.plane` counts the roof faces. Without solids, `defect` says what was wrong with the last try.
    """

    solids: tuple[Solid, ...]
    labels: Integers
    defect: str = ""


def raise_plan(
    plan: Coverage,
    labels: Integers,
    planes: NDArray[np.float64],
    ground: float,
    smallest: float,
    narrowest: float,
    held_down: Callable[[Coverage, Integers], Integers] | None = None,
) -> Raised:
    """The solids over a plan whose cells carry `labels` (C,) of `planes` (P, 3), or why there are none.

    Faces smaller (m²) or narrower (m) than the limits go to their neighbours. `held_down` gives cells that
    rise too high by that another label.
    """
    defect = ""
    for firmness in FIRMNESS:
        tidied, kept = tidy(plan, labels, smallest, firmness * narrowest, firmness * SHORTEST_EDGE)
        if held_down is not None:
            tidied, kept = tidied.merged(held_down(tidied, kept))
        solids = extrude(tidied, planes[kept], ground)
        if solids is None:
            defect = "the plan touches itself"
            continue
        defect = next(filter(None, map(find_defect, solids)), "")
        if not defect:
            return number_faces(solids, kept)
    return Raised((), np.zeros(0, np.int64), defect)


def tidy(
    plan: Coverage, labels: Integers, smallest: float, narrowest: float, shortest: float
) -> tuple[Coverage, Integers]:
    """The plan without slivers, short edges, needless nodes and necks, and the label (C,) of each cell."""
    plan, labels = absorb_slivers(plan, labels, smallest, narrowest)
    plan, labels = drop_straight_nodes(plan, labels)
    plan, labels = merge_short_edges(plan, labels, shortest)
    plan, labels = plan.merged(labels)
    plan, labels = absorb_slivers(plan, labels, smallest, narrowest)
    plan, labels = drop_straight_nodes(plan, labels)
    straight = drop_straight_nodes(plan, labels, JOG)
    plan, labels = straight if is_sound(straight[0]) else (plan, labels)
    return weld_necks(plan, labels)


def number_faces(solids: list[Solid], labels: Integers) -> Raised:
    """The solids with their roof faces counted through, and the label of each."""
    answer, used = [], []
    for solid in solids:
        faces = []
        for face in solid.faces:
            if face.surface == ROOF_SURFACE and face.plane is not None:
                used.append(int(labels[face.plane]))
                face = replace(face, plane=len(used) - 1)
            faces.append(face)
        answer.append(replace(solid, faces=tuple(faces)))
    return Raised(tuple(answer), np.array(used, np.int64))


def without_numbers(solids: tuple[Solid, ...]) -> tuple[Solid, ...]:
    """The solids with roof faces that belong to no roof plane, as at the coarser levels."""
    return tuple(
        replace(solid, faces=tuple(replace(face, plane=None) for face in solid.faces)) for solid in solids
    )
