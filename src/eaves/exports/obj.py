"""Building models as Wavefront OBJ with a material library.

Coordinates are in the coordinate system's units, less an offset of whole units that a line near the top
states (`# offset x y z`, east, north, up): programs that read OBJ keep seven digits, and world coordinates
need ten. As Blender and most programs expect of the format, the second axis points up: a corner is written
as east, up, south.
Every building is an object and a group named by its id, at its finest level of detail; every kind of surface
has its material. A building without a model is a comment with its reason.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from eaves.formats import COLOURS, SURFACES, Format, atomic, describe_system, with_meshes
from eaves.model import (
    LOCAL_METRES,
    NOTHING_KNOWN,
    BuildingModel,
    CoordinateSystem,
    Failure,
    Provenance,
)

DECIMALS = 4
"""Of a coordinate: a tenth of a millimetre, or of a thousandth of a foot."""


def write_obj(
    path: str | Path,
    models: Iterable[BuildingModel | Failure],
    system: CoordinateSystem = LOCAL_METRES,
    provenance: Provenance = NOTHING_KNOWN,
) -> int:
    """Write the meshes of buildings (`.obj`) and the materials beside them (`.mtl`).

    Parameters
    ----------
    path : str or Path
        The file; it appears when it is whole.
    models : iterable of BuildingModel or Failure
        Buildings in metres about their footprint's origin, taken one by one.
    system : CoordinateSystem
        Coordinate system whose units the coordinates are in.
    provenance : Provenance
        Data the models are made from, recorded in the file.

    Returns
    -------
    int
        The number of buildings with a mesh.

    Raises
    ------
    InputError
        When the folder cannot be written.

    Examples
    --------
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> models = [building.model(truth.cloud.origin) for building in truth.buildings]
    >>> from eaves.exports import write_obj
    >>> write_obj("nine.obj", models)
    9
    """
    path = Path(path)
    unit = np.array(system.unit_m)
    offset: np.ndarray | None = None
    count, start = 0, 1
    with atomic(path) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as file:
        file.write(
            "# eaves: buildings as east, up, south from an offset (east, north, up) in "
            f"{describe_system(system)}\n"
        )
        file.write(f"# {provenance.sentence}\n" if provenance else "")
        for number, (model, mesh) in enumerate(with_meshes(models), 1):
            footprint = model.footprint
            name = "_".join((footprint.id if footprint else "").split()) or f"building-{number}"
            if mesh is None or footprint is None:
                reason = "" if isinstance(model, BuildingModel) else f": {model.code}, {model.reason}"
                file.write(" ".join(f"# {name} has no model{reason}".split()) + "\n")
                continue
            world = (mesh.vertices + np.array([*footprint.origin, 0.0])) / unit
            if offset is None:
                offset = np.floor(np.array([*world.min(axis=0)[:2], 0.0]))
                file.write("# offset {:.0f} {:.0f} {:.0f}\n".format(*offset))
                file.write(f"mtllib {path.with_suffix('.mtl').name}\n")
            file.write(f"o {name}\ng {name}\n")
            row = f"v %.{DECIMALS}f %.{DECIMALS}f %.{DECIMALS}f\n"
            placed = (world - offset)[:, [0, 2, 1]] * [1.0, 1.0, -1.0]
            file.writelines(row % tuple(place) for place in placed.tolist())
            for kind, surface in enumerate(SURFACES):
                triangles = mesh.triangles_of(kind) + start
                if len(triangles):
                    file.write(f"usemtl {surface}\n")
                    file.writelines(f"f {a} {b} {c}\n" for a, b, c in triangles.tolist())
            start += len(world)
            count += 1
    with atomic(path.with_suffix(".mtl")) as temporary:
        temporary.write_text(material_lines(), encoding="utf-8", newline="\n")
    return count


def material_lines() -> str:
    """One matt material for every kind of surface."""
    lines = []
    for surface, colour in COLOURS.items():
        shown = " ".join(f"{part:.2f}" for part in colour)
        lines.append(f"newmtl {surface}\nKa {shown}\nKd {shown}\nKs 0 0 0\nd 1\nillum 1\n")
    return "\n".join(lines)


FORMAT = Format({"models": ("buildings.obj", write_obj)}, beside=("buildings.mtl",))
