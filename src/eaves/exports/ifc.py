"""Buildings as IFC 4 for BIM programs, by IfcOpenShell (the extra `ifc`; LGPL, an extra for it).

A site with an IfcBuilding for each building; its solids at the finest level are closed IfcPolygonalFaceSets,
its attributes a property set. Metres; IfcMapConversion and IfcProjectedCRS say where the site lies.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any
from uuid import NAMESPACE_URL, uuid5

import numpy as np

from eaves.formats import Format, atomic, attributes_of, clean, with_solids
from eaves.model import (
    LOCAL_METRES,
    NOTHING_KNOWN,
    BuildingModel,
    CoordinateSystem,
    Failure,
    Provenance,
    Solid,
)

PROPERTIES = "eaves"
"""Name of the property set."""
NO_DATE = "1970-01-01T00:00:00"
"""The same buildings give the same bytes."""
PRECISION_M = 1e-4


def write_ifc(
    path: str | Path,
    models: Iterable[BuildingModel | Failure],
    system: CoordinateSystem = LOCAL_METRES,
    provenance: Provenance = NOTHING_KNOWN,
) -> int:
    """Write the buildings that have solids; how many.

    Raises
    ------
    InputError
        When IfcOpenShell is missing, or the folder cannot be written.
    """
    FORMAT.require()
    import ifcopenshell

    file = ifcopenshell.file(schema="IFC4")
    file.header.file_name.time_stamp = NO_DATE
    file.header.file_description.description = (provenance.sentence or "buildings by eaves",)
    found = list(with_solids(models))
    origin = np.array([*(found[0].footprint.origin if found else (0.0, 0.0)), 0.0])
    context, site = make_site(file, system, origin)
    buildings = [make_building(file, model, context, origin) for model in found]
    if buildings:
        file.createIfcRelAggregates(guid("buildings"), None, None, None, site, buildings)
    with atomic(path) as temporary:
        file.write(str(temporary))
    return len(buildings)


def guid(name: str) -> str:
    """The id of a thing, from its name."""
    from ifcopenshell.guid import compress

    return str(compress(uuid5(NAMESPACE_URL, f"eaves:{name}").hex))


def make_site(file: Any, system: CoordinateSystem, origin: Any) -> tuple[Any, Any]:
    """The geometric context, placed on Earth where the system is known, and the site."""
    units = [("LENGTHUNIT", "METRE"), ("AREAUNIT", "SQUARE_METRE"), ("VOLUMEUNIT", "CUBIC_METRE")]
    measures = [file.createIfcSIUnit(None, kind, None, name) for kind, name in units]
    axes = file.createIfcAxis2Placement3D(file.createIfcCartesianPoint((0.0, 0.0, 0.0)))
    context = file.createIfcGeometricRepresentationContext(None, "Model", 3, PRECISION_M, axes)
    if system.code is not None:
        unit = np.array(system.unit_m)
        place = file.createIfcProjectedCRS(system.code.split("+")[0])
        file.createIfcMapConversion(context, place, *(origin / unit).tolist(), 1.0, 0.0, 1.0 / float(unit[0]))
    about = (None, "eaves", None, None, None, None, [context], file.createIfcUnitAssignment(measures))
    project = file.createIfcProject(guid("project"), *about)
    placement = file.createIfcLocalPlacement(None, axes)
    site = file.createIfcSite(guid("site"), None, "Site", None, None, placement)
    file.createIfcRelAggregates(guid("site of project"), None, None, None, project, [site])
    return context, site


def make_building(file: Any, model: BuildingModel, context: Any, origin: Any) -> Any:
    """A building with its body and its properties."""
    shift = np.array([*model.footprint.origin, 0.0]) - origin
    bodies = [make_body(file, solid, shift) for solid in model.solids[model.lod]]
    body = file.createIfcShapeRepresentation(context, "Body", "Tessellation", bodies)
    shape = file.createIfcProductDefinitionShape(None, None, [body])
    name = model.footprint.id
    building = file.createIfcBuilding(guid(name), None, name, None, None, None, shape)
    values = {
        key: one for key, one in clean(attributes_of(model)).items() if not isinstance(one, list | dict)
    }
    properties = [
        file.createIfcPropertySingleValue(key, None, nominal(file, one))
        for key, one in values.items()
        if one is not None
    ]
    if properties:
        group = file.createIfcPropertySet(guid(f"{name} properties"), None, PROPERTIES, None, properties)
        file.createIfcRelDefinesByProperties(guid(f"{name} has"), None, None, None, [building], group)
    return building


def make_body(file: Any, solid: Solid, shift: Any) -> Any:
    """A solid as a closed set of polygons, holes included."""
    points = file.createIfcCartesianPointList3D((solid.vertices + shift).tolist())
    faces = []
    for face in solid.faces:
        outer, *holes = ([number + 1 for number in ring] for ring in face.rings)
        kind = "IfcIndexedPolygonalFaceWithVoids" if holes else "IfcIndexedPolygonalFace"
        faces.append(file.create_entity(kind, outer, *([holes] if holes else [])))
    return file.createIfcPolygonalFaceSet(points, True, faces)


def nominal(file: Any, value: Any) -> Any:
    """A value of a property."""
    kinds = {bool: "IfcBoolean", int: "IfcInteger", float: "IfcReal"}
    kind = kinds.get(type(value), "IfcText")
    return file.create_entity(kind, value if kind != "IfcText" else str(value))


FORMAT = Format(
    {"models": ("buildings.ifc", write_ifc)},
    extra=("ifc", "ifcopenshell", "IFC needs IfcOpenShell"),
)
