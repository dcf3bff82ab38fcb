"""Whether a CityJSON document is built as the standard says: types, members, semantics, references.

The geometry is checked elsewhere. The rules are those of the schemas of CityJSON 2.0 that decide what a file
means; names that begin with `+` belong to extensions.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from eaves.model import Finding
from eaves.validate.codes import make_finding

FIRST_LEVEL = frozenset(
    [
        "Bridge",
        "Building",
        "CityFurniture",
        "CityObjectGroup",
        "GenericCityObject",
        "LandUse",
        "OtherConstruction",
        "PlantCover",
        "SolitaryVegetationObject",
        "TINRelief",
        "TransportSquare",
        "Railway",
        "Road",
        "Tunnel",
        "WaterBody",
        "Waterway",
    ]
)
SECOND_LEVEL = frozenset(
    [
        "BridgePart",
        "BridgeInstallation",
        "BridgeConstructiveElement",
        "BridgeRoom",
        "BridgeFurniture",
        "BuildingPart",
        "BuildingInstallation",
        "BuildingConstructiveElement",
        "BuildingFurniture",
        "BuildingStorey",
        "BuildingRoom",
        "BuildingUnit",
        "TunnelPart",
        "TunnelInstallation",
        "TunnelConstructiveElement",
        "TunnelHollowSpace",
        "TunnelFurniture",
    ]
)
"""City objects that are part of another one (CityJSON 2.0, section 2)."""
SURFACES = frozenset(
    [
        "RoofSurface",
        "GroundSurface",
        "WallSurface",
        "ClosureSurface",
        "OuterCeilingSurface",
        "OuterFloorSurface",
        "Window",
        "Door",
        "InteriorWallSurface",
        "CeilingSurface",
        "FloorSurface",
        "WaterSurface",
        "WaterGroundSurface",
        "WaterClosureSurface",
        "TrafficArea",
        "AuxiliaryTrafficArea",
        "TransportationMarking",
        "TransportationHole",
    ]
)
"""Semantic surfaces (section 3.3)."""
SEMANTIC_DEPTH = {
    "MultiPoint": 1,
    "MultiLineString": 1,
    "MultiSurface": 1,
    "CompositeSurface": 1,
    "Solid": 2,
    "MultiSolid": 3,
    "CompositeSolid": 3,
}
"""Geometry type → how many lists deep its semantic values lie: one a point, line or surface."""
INSTANCE = "GeometryInstance"


def check_head(head: dict[str, Any]) -> Iterator[Finding]:
    """Findings of what a file's first object must have."""
    for name, kind in (("CityObjects", dict), ("vertices", list)):
        if not isinstance(head.get(name), kind):
            yield make_finding(915, "", "file", f"it has no {name}, which must be there, be it empty")
    if str(head.get("version")) == "2.0" and not isinstance(head.get("transform"), dict):
        yield make_finding(915, "", "file", "it has no transform, which CityJSON 2.0 asks for")


def check_feature(document: Any) -> Iterator[Finding]:
    """Findings of a later line of a CityJSONSeq file."""
    if not isinstance(document, dict) or document.get("type") != "CityJSONFeature":
        yield make_finding(915, "", "file", 'a line is not an object of type "CityJSONFeature"')
        return
    name = document.get("id")
    if not isinstance(name, str):
        yield make_finding(915, "", "file", "a feature has no id")
    elif isinstance(document.get("CityObjects"), dict) and name not in document["CityObjects"]:
        yield make_finding(912, name, "feature", "no city object of the feature has its id")
    for member, kind in (("CityObjects", dict), ("vertices", list)):
        if not isinstance(document.get(member), kind):
            yield make_finding(915, str(name or ""), "feature", f"it has no {member}")


def check_objects(objects: dict[str, Any], templates: int) -> Iterator[Finding]:
    """Findings of the city objects of one document, geometry left out; `templates` is how many there are."""
    for name, item in objects.items():
        if not isinstance(item, dict):
            continue  # the geometry's check says so
        kind = item.get("type")
        if not isinstance(kind, str) or not (kind in FIRST_LEVEL | SECOND_LEVEL or kind.startswith("+")):
            yield make_finding(911, name, "object", f"{kind!r} is no type of city object")
        yield from check_family(name, item, objects)
        if not isinstance(item.get("attributes", {}), dict):
            yield make_finding(915, name, "object", "its attributes are not an object")
        geometries = item.get("geometry", [])
        for number, geometry in enumerate(geometries if isinstance(geometries, list) else []):
            if isinstance(geometry, dict):
                yield from check_geometry(name, f"geometry {number}", geometry, templates)


def check_family(name: str, item: dict[str, Any], objects: dict[str, Any]) -> Iterator[Finding]:
    """Findings of parents and children: they exist, and name each other."""
    for mine, theirs in (("parents", "children"), ("children", "parents")):
        others = item.get(mine, [])
        if not isinstance(others, list) or not all(isinstance(one, str) for one in others):
            yield make_finding(915, name, "object", f"its {mine} are not a list of ids")
            continue
        for other in others:
            relative = objects.get(other)
            if not isinstance(relative, dict):
                yield make_finding(912, name, "object", f"there is no {other!r}, one of its {mine}")
            elif name not in as_list(relative.get(theirs)):
                yield make_finding(912, name, "object", f"{other!r} does not have it among its {theirs}")
    if str(item.get("type")) in SECOND_LEVEL and not item.get("parents"):
        yield make_finding(912, name, "object", f"a {item['type']} has no parents")


def check_geometry(name: str, where: str, geometry: dict[str, Any], templates: int) -> Iterator[Finding]:
    """Findings of a geometry's type, level of detail, semantics and template."""
    kind = geometry.get("type")
    if kind == INSTANCE:
        number = geometry.get("template")
        if type(number) is not int or not 0 <= number < templates:
            yield make_finding(912, name, where, f"there is no template {number!r} among {templates}")
        matrix = geometry.get("transformationMatrix")
        if not isinstance(matrix, list) or len(matrix) != 16 or not all(map(is_number, matrix)):
            yield make_finding(915, name, where, "its transformationMatrix is not sixteen numbers")
        return
    if not isinstance(kind, str) or kind not in SEMANTIC_DEPTH:
        if isinstance(kind, str) and not kind.startswith("+"):
            yield make_finding(911, name, where, f"{kind!r} is no type of geometry")
        return
    if "lod" in geometry and not isinstance(geometry["lod"], str) and not is_number(geometry["lod"]):
        yield make_finding(915, name, where, "its lod is no text")
    if geometry.get("semantics") is not None:
        yield from check_semantics(name, where, geometry, SEMANTIC_DEPTH[kind])


def as_list(value: Any) -> list[Any]:
    """A value that is a list, else an empty one."""
    return value if isinstance(value, list) else []


def is_number(value: Any) -> bool:
    """Whether a value of JSON is a number."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def check_semantics(name: str, where: str, geometry: dict[str, Any], depth: int) -> Iterator[Finding]:
    """Findings of the semantic surfaces: known types, a value for each surface, none that does not exist."""
    semantics = geometry["semantics"]
    surfaces = semantics.get("surfaces") if isinstance(semantics, dict) else None
    if not isinstance(surfaces, list) or "values" not in semantics:
        yield make_finding(913, name, where, "its semantics are not surfaces and values")
        return
    for number, surface in enumerate(surfaces):
        kind = surface.get("type") if isinstance(surface, dict) else None
        if not isinstance(kind, str) or not (kind in SURFACES or kind.startswith("+")):
            yield make_finding(911, name, where, f"{kind!r} is no type of semantic surface")
            continue
        related = [surface.get("parent"), *as_list(surface.get("children"))]
        if any(one is not None and (type(one) is not int or not 0 <= one < len(surfaces)) for one in related):
            yield make_finding(913, name, where, f"semantic surface {number} names one that is not there")
    if not fits(semantics["values"], geometry.get("boundaries"), depth, len(surfaces)):
        yield make_finding(913, name, where, "its semantic values are not one of its surfaces for each face")


def fits(values: Any, boundaries: Any, depth: int, count: int) -> bool:
    """Whether values are nested as boundaries are, `depth` lists deep, each null or below `count`."""
    if values is None:
        return True
    if not isinstance(values, list) or not isinstance(boundaries, list) or len(values) != len(boundaries):
        return False
    if depth > 1:
        return all(fits(*pair, depth - 1, count) for pair in zip(values, boundaries, strict=True))
    return all(one is None or (type(one) is int and 0 <= one < count) for one in values)
