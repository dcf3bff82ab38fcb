"""Edges of roofs as 3D lines in a DXF file (AutoCAD R12, text), as surveyors draw on.

World coordinates in the coordinate system's units, which DXF itself cannot name: a comment on the first line
does. Layers: `ROOF_EDGES`, `FOOTPRINTS` (at the building's base), `BUILDING_IDS` (a text in the middle).
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from eaves.formats import Format, atomic, describe_system, with_solids
from eaves.geometry import FaceTable
from eaves.model import (
    LOCAL_METRES,
    NOTHING_KNOWN,
    ROOF_SURFACE,
    BuildingModel,
    CoordinateSystem,
    Failure,
    Integers,
    Points,
    Provenance,
)

CORNER_TURN_DEG = 10.0
"""A vertex of a roof face is a corner where its ring turns by more."""
TEXT_HEIGHT = 1.0
"""Of the ids (m)."""
DECIMALS = 3
"""Of a coordinate: a millimetre, or a thousandth of a foot."""
ROOF_LAYER, FOOTPRINT_LAYER, ID_LAYER = "ROOF_EDGES", "FOOTPRINTS", "BUILDING_IDS"


def write_dxf(
    path: str | Path,
    models: Iterable[BuildingModel | Failure],
    system: CoordinateSystem = LOCAL_METRES,
    provenance: Provenance = NOTHING_KNOWN,
) -> int:
    """Write the edges of every roof at the finest level as lines.

    Parameters
    ----------
    path : str or Path
        The file (`.dxf`); it appears when it is whole.
    models : iterable of BuildingModel or Failure
        Buildings in metres about their footprint's origin, taken one by one; those without a model are left
        out.
    system : CoordinateSystem
        Coordinate system; the coordinates are in its units.
    provenance : Provenance
        Data the models are made from, recorded in the file.

    Returns
    -------
    int
        The number of buildings drawn.

    Raises
    ------
    InputError
        When the folder cannot be written.

    Examples
    --------
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> from eaves.exports import write_dxf
    >>> write_dxf("nine.dxf", [building.model(truth.cloud.origin) for building in truth.buildings])
    9
    """
    count = 0
    unit = np.array(system.unit_m)
    with atomic(path) as temporary, temporary.open("w", encoding="ascii", errors="replace") as file:
        remarks = " ".join(f"eaves, {describe_system(system)} {provenance.sentence}".split())
        file.write(f"999\n{remarks}\n0\nSECTION\n2\nENTITIES\n")
        for model in with_solids(models):
            footprint = model.footprint
            shift = np.array([*footprint.origin, 0.0])
            roofs = FaceTable.of_solids(model.solids[model.lod], ROOF_SURFACE)
            corners, edges = turning_corners(roofs)
            placed = (corners + shift) / unit
            file.write(lines_of(ROOF_LAYER, placed[edges[:, 0]], placed[edges[:, 1]]))
            base = min(float(solid.vertices[:, 2].min()) for solid in model.solids[model.lod])
            for ring in (footprint.polygon.exterior, *footprint.polygon.interiors):
                flat = np.asarray(ring.coords)[:, :2]
                upright = (np.column_stack([flat, np.full(len(flat), base)]) + shift) / unit
                file.write(lines_of(FOOTPRINT_LAYER, upright[:-1], upright[1:]))
            middle = footprint.polygon.representative_point()
            place = (np.array([middle.x, middle.y, base]) + shift) / unit
            name = " ".join(footprint.id.split()) or f"building-{count + 1}"
            file.write(f"0\nTEXT\n8\n{ID_LAYER}\n{groups(10) % tuple(place)}40\n")
            file.write(f"{TEXT_HEIGHT / unit[0]:.3f}\n1\n{name}\n")
            count += 1
        file.write("0\nENDSEC\n0\nEOF\n")
    return count


def turning_corners(faces: FaceTable) -> tuple[Points, Integers]:
    """The corners (V, 3) where a ring of faces turns, and the pairs of them (E, 2) that rings join."""
    out = faces.corners[faces.following] - faces.corners
    into = np.empty_like(out)
    into[faces.following] = out
    size = np.linalg.norm(into, axis=1) * np.linalg.norm(out, axis=1)
    turns = (into * out).sum(axis=1) < size * np.cos(np.radians(CORNER_TURN_DEG))
    places = list(map(tuple, np.round(faces.corners, DECIMALS).tolist()))
    number: dict[tuple[float, ...], int] = {}
    for corner in np.flatnonzero(turns).tolist():
        number.setdefault(places[corner], len(number))
    edges, starts = set(), faces.ring_start.tolist()
    for start, end in zip(starts, [*starts[1:], len(places)], strict=True):
        kept = [number[place] for place in places[start:end] if place in number]
        pairs = zip(kept, kept[1:] + kept[:1], strict=True)
        edges |= {(min(pair), max(pair)) for pair in pairs if pair[0] != pair[1]}
    return np.array(list(number)).reshape(-1, 3), np.array(sorted(edges), np.int64).reshape(-1, 2)


def lines_of(layer: str, ones: Points, others: Points) -> str:
    """A LINE between each two places (N, 3)."""
    line = f"0\nLINE\n8\n{layer}\n{groups(10)}{groups(11)}"
    return line * len(ones) % tuple(np.hstack([ones, others]).ravel().tolist())


def groups(code: int) -> str:
    """The three groups of a place, of which `code` is the first one's, without the numbers."""
    number = f"%.{DECIMALS}f"
    return f"{code}\n{number}\n{code + 10}\n{number}\n{code + 20}\n{number}\n"


FORMAT = Format({"models": ("roofs.dxf", write_dxf)})
