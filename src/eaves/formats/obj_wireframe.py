"""Roofs as wireframes in Wavefront OBJ: corners and the straight edges between them, `v` and `l` lines.

World coordinates in the coordinate system's units, as Building3D's wireframes are; one object a building.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eaves.formats.atomic import atomic
from eaves.formats.cityjson import footprint_of
from eaves.formats.crs import describe
from eaves.model import BuildingModel, CoordinateSystem, Failure, Points
from eaves.model.building import ROOF_SURFACE
from eaves.model.coordinates import LOCAL_METRES
from eaves.model.provenance import NOTHING_KNOWN, Provenance

CORNER_TURN_DEG = 10.0
"""A vertex of a roof face is a corner where its ring turns by more."""

SAME_CORNER = 0.3
"""Corners of one roof nearer than this (m) are one: the head and foot of a low step."""

DECIMALS = 3
"""Of a coordinate: a millimetre, or a thousandth of a foot."""


def roof_wireframe(model: BuildingModel) -> tuple[Points, NDArray[np.int64]]:
    """Corners (V, 3) about the footprint's origin and edges (E, 2) of the roof faces at the finest level.

    Parameters
    ----------
    model
        A building with at least one level that has roof faces.

    Returns
    -------
    Corners, where a ring of a face turns by more than 10°, those nearer than 0.3 m made one; and the pairs of
    their numbers that a face's ring joins, each once.

    Examples
    --------
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> from eaves.formats.obj_wireframe import roof_wireframe
    >>> shed = nine_roofs_on_a_slope(density=4.0).buildings[2].model((0.0, 0.0))
    >>> corners, edges = roof_wireframe(shed)
    >>> len(corners), len(edges)
    (4, 4)
    """
    corners: list[NDArray[np.float64]] = []
    edges: set[tuple[int, int]] = set()

    def number_of(place: NDArray[np.float64]) -> int:
        if corners:
            away = np.linalg.norm(np.array(corners) - place, axis=1)
            if away.min() <= SAME_CORNER:
                return int(away.argmin())
        corners.append(place)
        return len(corners) - 1

    for solid in model.solids.get(model.lod, ()):
        turning = np.zeros(len(solid.vertices), bool)
        rings = [
            np.array(ring) for face in solid.faces if face.surface == ROOF_SURFACE for ring in face.rings
        ]
        for ring in rings:
            places = solid.vertices[ring]
            into, out = places - np.roll(places, 1, axis=0), np.roll(places, -1, axis=0) - places
            size = np.linalg.norm(into, axis=1) * np.linalg.norm(out, axis=1)
            turning[ring[(into * out).sum(axis=1) / size < np.cos(np.radians(CORNER_TURN_DEG))]] = True
        for ring in rings:
            kept = [number_of(solid.vertices[vertex]) for vertex in ring[turning[ring]]]
            pairs = zip(kept, kept[1:] + kept[:1], strict=True)
            edges |= {(min(pair), max(pair)) for pair in pairs if pair[0] != pair[1]}
    return np.array(corners).reshape(-1, 3), np.array(sorted(edges), np.int64).reshape(-1, 2)


def write_obj_wireframe(
    path: str | Path,
    models: Iterable[BuildingModel | Failure],
    system: CoordinateSystem = LOCAL_METRES,
    provenance: Provenance = NOTHING_KNOWN,
) -> int:
    """Write the roofs' corners and edges to `path` (`.obj`); return the number of buildings with a roof.

    Parameters
    ----------
    path : str or Path
        The file; it appears when it is whole.
    models : iterable of BuildingModel or Failure
        Buildings in metres about their footprint's origin, taken one by one.
    system : CoordinateSystem
        Coordinate system whose units the coordinates are in.
    provenance : Provenance
        What the models are made from, which the file then says.

    Returns
    -------
    int
        The number of buildings written; one without a model is a comment with its reason.

    Raises
    ------
    InputError
        When the folder cannot be written.

    Examples
    --------
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> models = [building.model(truth.cloud.origin) for building in truth.buildings]
    >>> from eaves.formats import write_obj_wireframe
    >>> write_obj_wireframe("wireframe.obj", models)
    9
    """
    unit = np.array(system.unit_m)
    count, start = 0, 1
    with atomic(path) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as file:
        file.write(f"# eaves: corners and edges of roofs; coordinates are in {describe(system)}\n")
        file.write(f"# {provenance.sentence}\n" if provenance else "")
        for number, model in enumerate(models, 1):
            footprint = footprint_of(model)
            name = "_".join((footprint.id if footprint else "").split()) or f"building-{number}"
            if isinstance(model, Failure) or footprint is None or not model.solids:
                reason = f": {model.code}, {model.reason}" if isinstance(model, Failure) else ""
                file.write(" ".join(f"# {name} has no roof{reason}".split()) + "\n")
                continue
            corners, edges = roof_wireframe(model)
            world = (corners + np.array([*footprint.origin, 0.0])) / unit
            file.write(f"o {name}\n")
            for row in world:
                file.write("v " + " ".join(f"{value:.{DECIMALS}f}" for value in row) + "\n")
            file.writelines(f"l {a} {b}\n" for a, b in (edges + start).tolist())
            start += len(world)
            count += 1
    return count
