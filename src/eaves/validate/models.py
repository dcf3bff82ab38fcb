"""Building models, validated before they are written, on the coordinates that will be written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from eaves.geometry.tolerance import COORDINATE_STEP
from eaves.model import BuildingModel, Finding, Integers
from eaves.model.checks import check_type
from eaves.validate.polygons import to_grid
from eaves.validate.primitives import ReadPrimitive, Tolerances, check_primitives, find_defects


def validate_model(model: BuildingModel, tolerances: Tolerances | None = None) -> list[Finding]:
    """All findings of a model, on its coordinates rounded to the written grid; none means valid.

    Each part of a level of detail is checked as a solid, and the parts of one level against each other and,
    of the finest, against the objects on the roof. The levels appear in `where`, parts and objects by their
    number in `building`: `id/0`, `id/1`, …, `id/i1`, …

    Parameters
    ----------
    model : BuildingModel
        The building; coordinates in local metres.
    tolerances : Tolerances or None
        Limits for snapping, planarity and normals; None takes val3dity's defaults.

    Returns
    -------
    list of Finding
        Defects by val3dity's code numbers.

    Raises
    ------
    TypeError
        When `model` is no BuildingModel.
    ValueError
        When a vertex is not finite.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> eaves.validate_model(truth.buildings[0].model())
    []
    """
    check_type(model, BuildingModel, "model", "give the result of reconstruct_building that is no Failure")
    primitives, vertices = primitives_of(model)
    return check_primitives(primitives, vertices, COORDINATE_STEP, tolerances)


def find_invalid(models: Sequence[BuildingModel], tolerances: Tolerances | None = None) -> list[int]:
    """The numbers of the models that `validate_model` has findings of, all checked together: that takes half
    the time."""
    primitives: list[ReadPrimitive] = []
    vertices = [np.zeros((0, 3), np.int64)]
    count = 0
    for number, model in enumerate(models):
        geometries, places = primitives_of(model, count)
        primitives += [replace(geometry, family=str(number)) for geometry in geometries]
        vertices.append(places)
        count += len(places)
    defects = find_defects(primitives, np.concatenate(vertices), COORDINATE_STEP, tolerances)
    return sorted({int(primitives[number].family) for number, _ in defects})


def primitives_of(model: BuildingModel, first: int = 0) -> tuple[list[ReadPrimitive], Integers]:
    """The solids of a model, and their vertices (V, 3) in whole steps, which are counted from `first`."""
    primitives, vertices, count = [], [np.zeros((0, 3), np.int64)], first
    solids = [
        (lod, "" if len(parts) == 1 else f"/{number}", solid)
        for lod, parts in sorted(model.solids.items())
        for number, solid in enumerate(parts)
    ]
    solids += [
        (model.lod, f"/i{number}", installation.solid)
        for number, installation in enumerate(model.installations, 1)
    ]
    for lod, suffix, solid in solids:
        name = f"{model.footprint.id}{suffix}"
        if not np.isfinite(solid.vertices).all():
            raise ValueError(f"building '{name}' at lod {lod} has a vertex that is not finite")
        shell = [[[count + vertex for vertex in ring] for ring in face.rings] for face in solid.faces]
        primitives.append(ReadPrimitive(name, model.footprint.id, lod, "Solid", [[shell]]))
        vertices.append(to_grid(solid.vertices, COORDINATE_STEP))
        count += len(solid.vertices)
    return primitives, np.concatenate(vertices)
