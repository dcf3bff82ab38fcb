"""Building models as a GeoPackage with a layer a level of detail: `lod_1_2`, …, `lod_2_2`, `lod_2_3`.

A row is one kind of surface of one building (roofs, walls or ground) as a MultiPolygon at its own heights.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain, islice
from pathlib import Path

import numpy as np
import shapely

from eaves.formats import (
    PIECE_ROWS,
    SURFACES,
    Format,
    Row,
    append_rows,
    atomic,
    describe_layers,
    with_solids,
)
from eaves.geometry import FaceTable
from eaves.model import (
    LOCAL_METRES,
    LODS,
    NOTHING_KNOWN,
    BuildingModel,
    CoordinateSystem,
    Failure,
    Provenance,
)

AT_ONCE = 100
"""Buildings whose faces are made polygons together."""
KINDS: dict[str, type] = {"id": str, "surface": str, "area_m2": float, "face_count": int}


def write_lod_layers(
    path: str | Path,
    models: Iterable[BuildingModel | Failure],
    system: CoordinateSystem = LOCAL_METRES,
    provenance: Provenance = NOTHING_KNOWN,
) -> int:
    """Write a GeoPackage with a layer for every level of detail from 1.2 on; return the number of buildings.

    Parameters
    ----------
    path : str or Path
        The file (`.gpkg`); it appears when it is whole.
    models : iterable of BuildingModel or Failure
        Buildings in metres about their footprint's origin, taken one by one.
    system : CoordinateSystem
        Coordinate system the coordinates are written in.
    provenance : Provenance
        Data the models are made from, recorded in the file.

    Returns
    -------
    int
        The number of buildings written.

    Raises
    ------
    InputError
        When the folder cannot be written.

    Examples
    --------
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> models = [building.model(truth.cloud.origin) for building in truth.buildings]
    >>> from eaves.exports import write_lod_layers
    >>> write_lod_layers("nine.gpkg", models)
    9
    """
    waiting: dict[str, list[Row]] = {lod: [] for lod in LODS[1:]}
    count = 0
    with atomic(path) as temporary:
        for lod in LODS[1:]:  # every layer is there, also where no building has that level
            append_rows(temporary, [], system, layer_of(lod), KINDS)
        solid = with_solids(models)
        while piece := list(islice(solid, AT_ONCE)):
            count += len(piece)
            for lod in dict.fromkeys(chain.from_iterable(model.solids for model in piece)):
                rows = waiting.setdefault(lod, [])
                rows += lod_rows(piece, lod)
                if len(rows) >= PIECE_ROWS:
                    append_rows(temporary, rows, system, layer_of(lod), KINDS)
                    rows.clear()
        for lod, rows in waiting.items():
            if rows:
                append_rows(temporary, rows, system, layer_of(lod), KINDS)
        describe_layers(temporary, system, provenance)
    return count


def layer_of(lod: str) -> str:
    """`lod_2_2` for `2.2`."""
    return "lod_" + lod.replace(".", "_")


def lod_rows(models: Sequence[BuildingModel], lod: str) -> Iterator[Row]:
    """The rows of buildings at one level, in world metres."""
    solids = [solid for model in models for solid in model.solids.get(lod, ())]
    building = np.repeat(np.arange(len(models)), [len(model.solids.get(lod, ())) for model in models])
    building = building.repeat([len(solid.surfaces) for solid in solids])
    table, surfaces = FaceTable.of_solids(solids), np.concatenate([solid.surfaces for solid in solids])
    origins = np.array([[*model.footprint.origin, 0.0] for model in models])
    shapes = table.polygons_at(table.corners + origins[building[table.face_of_corner]])
    row, face = np.nonzero(surfaces == np.array(SURFACES)[:, None])
    order = np.lexsort((face, row, building[face]))
    face, row = face[order], building[face[order]] * len(SURFACES) + row[order]
    there, first, count = np.unique(row, return_index=True, return_counts=True)
    together = shapely.multipolygons(shapes[face], indices=np.arange(len(there)).repeat(count))
    areas = np.split(table.areas[face], first[1:])
    for number, shape, of_faces in zip(there.tolist(), together, areas, strict=True):
        one, kind = divmod(number, len(SURFACES))
        values = {"id": models[one].footprint.id, "surface": SURFACES[kind]}
        yield Row(shape, values | {"area_m2": round(float(of_faces.sum()), 2), "face_count": len(of_faces)})


FORMAT = Format({"models": ("buildings.gpkg", write_lod_layers)})
