"""The schemas of CityJSON 2.0 for each object, and what of a file written here breaks them (draft 7).

In words of this project for the rules of https://www.cityjson.org/schemas/2.0.2; the lists of types are its
own.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from jsonschema import Draft7Validator
from referencing import Registry, Resource
from referencing.jsonschema import DRAFT7

Schema = Mapping[str, Any]


def schema_defects(path: Path) -> list[str]:
    """The breaks of CityJSON's schema, of families and of semantics by a file; none means that it is as the
    standard says."""
    text = path.read_text(encoding="utf-8")
    documents = [json.loads(line) for line in text.splitlines() if line.strip()]
    found = list(breaks(documents[0], HEAD))
    for document in documents[1:]:
        found += breaks(document, FEATURE)
    for document in documents:
        for name, item in document["CityObjects"].items():
            found += [f"{name}: {defect}" for defect in object_defects(name, item, document["CityObjects"])]
    return found


def object_defects(name: str, item: Any, objects: Mapping[str, Any]) -> Iterator[str]:
    """What is wrong with one city object: members, relatives, geometries and their semantics."""
    yield from breaks(item, OBJECTS[item["type"]])
    for role, inverse in (("parents", "children"), ("children", "parents")):
        for other in item.get(role, []):
            if name not in objects[other].get(inverse, []):
                yield f"{other} does not name it among its {inverse}"
    allowed = {**FIRST_LEVEL, **SECOND_LEVEL}[item["type"]]
    for geometry in item.get("geometry", []):
        kind = geometry["type"]
        if kind not in allowed:
            yield f"a {item['type']} may not be a {kind}"
        yield from breaks(geometry, GEOMETRIES[kind])
        if "semantics" in geometry:
            surfaces = geometry["semantics"]["surfaces"]
            if not {surface["type"] for surface in surfaces} <= set(SURFACES):
                yield "a semantic surface is of no type of the standard"
            if not fits(
                geometry["semantics"]["values"], geometry["boundaries"], DEPTHS[kind] - 2, len(surfaces)
            ):
                yield "its semantic values are not one of its surfaces for each face"


def fits(values: Any, boundaries: Any, depth: int, count: int) -> bool:
    """Whether values are nested as boundaries are, `depth` lists deep, each null or below `count`."""
    if len(values) != len(boundaries):
        return False
    if depth > 1:
        return all(fits(*pair, depth - 1, count) for pair in zip(values, boundaries, strict=True))
    return all(value is None or 0 <= value < count for value in values)


def breaks(value: Any, schema: Schema) -> Iterator[str]:
    """The breaks of a schema by a value, a phrase each that begins with the place."""
    whole = {**SHAPES, "definitions": SHAPES}
    registry: Registry[Any] = Registry(  # type: ignore[call-arg] # an attrs class
        retrieve=lambda address: Resource.from_contents(whole, default_specification=DRAFT7)
    )
    for error in Draft7Validator(schema, registry=registry).iter_errors(value):
        yield f"{list(error.absolute_path)}: {error.message}"


TEXT: Schema = {"type": "string"}
NUMBER: Schema = {"type": "number"}
WHOLE: Schema = {"type": "integer"}
OBJECT: Schema = {"type": "object"}
NEVER: Schema = {"not": {}}


def list_of(items: Schema, least: int = 0, most: int | None = None) -> Schema:
    """A list of like items."""
    return {"type": "array", "items": items, "minItems": least} | ({} if most is None else {"maxItems": most})


def nested(items: Schema, depth: int) -> Schema:
    """Lists in lists, none of them empty."""
    return items if depth == 0 else list_of(nested(items, depth - 1), 1)


def nested_or_null(items: Schema, depth: int) -> Schema:
    """Lists in lists, of which null may stand for each."""
    if depth == 0:
        return {"type": [items["type"], "null"]}
    return {"type": ["array", "null"], "items": nested_or_null(items, depth - 1)}


def record(known: Mapping[str, Schema], needed: tuple[str, ...] = (), closed: bool = False) -> Schema:
    """An object with known members, of which some must be there; `closed` to all others."""
    return {"type": "object", "properties": known, "required": needed, "additionalProperties": not closed}


def each(member: Schema) -> Schema:
    """An object of which all members are alike."""
    return {"type": "object", "additionalProperties": member}


def numbers(count: int, most: int | None = None) -> Schema:
    """A list of so many numbers."""
    return list_of(NUMBER, count, most or count)


SURFACES = (
    *("RoofSurface", "GroundSurface", "WallSurface", "ClosureSurface", "OuterCeilingSurface"),
    *("OuterFloorSurface", "Window", "Door", "InteriorWallSurface", "CeilingSurface", "FloorSurface"),
    *("WaterSurface", "WaterGroundSurface", "WaterClosureSurface", "TrafficArea", "AuxiliaryTrafficArea"),
    *("TransportationMarking", "TransportationHole"),
)
"""Semantic surfaces (CityJSON 2.0, section 3.3)."""
LODS = (*"0123", *(f"{whole}.{part}" for whole in range(4) for part in range(4)))
DEPTHS = {
    "MultiPoint": 1,
    "MultiLineString": 2,
    "MultiSurface": 3,
    "CompositeSurface": 3,
    "Solid": 4,
    "MultiSolid": 5,
    "CompositeSolid": 5,
}
"""Geometry type → how many lists deep its vertices lie."""
INSTANCE = "GeometryInstance"


def geometry_of(kind: str, depth: int) -> Schema:
    """A geometry with `boundaries` so many lists deep."""
    values = max(1, depth - 2)  # one a point, line or surface
    known: dict[str, Schema] = {
        "type": {"const": kind},
        "lod": {"enum": LODS},
        "boundaries": {"type": "array"} if depth > 2 else nested(WHOLE, depth),
        "semantics": OBJECT,
    }
    if depth > 2:  # points and lines have no colour
        material = record({"values": nested_or_null(WHOLE, values), "value": WHOLE})
        one_way: Schema = {"oneOf": [{"required": ["value"]}, {"required": ["values"]}]}
        known["material"] = each({"allOf": [material, one_way]})
        known["texture"] = each(record({"values": {"type": "array"}}))
    return record(known, ("type", "lod", "boundaries"), closed=True)


GEOMETRIES: dict[str, Schema] = {kind: geometry_of(kind, depth) for kind, depth in DEPTHS.items()} | {
    INSTANCE: record(
        {
            "type": {"const": INSTANCE},
            "template": WHOLE,
            "boundaries": list_of(WHOLE, 1, 1),
            "transformationMatrix": numbers(16),
        },
        ("type", "template", "boundaries", "transformationMatrix"),
        closed=True,
    )
}

_FACES = ("MultiSurface", "CompositeSurface")
_BODIES = (*_FACES, "Solid", "CompositeSolid")
_PLAIN = (*_BODIES, "MultiPoint", "MultiLineString", "MultiSolid")
_ALL = (*_PLAIN, INSTANCE)
_LINES = ("MultiLineString", *_FACES)
_PARTS = {
    "Part": _BODIES,
    "Installation": _ALL,
    "ConstructiveElement": _ALL,
    "Furniture": _ALL,
}
FIRST_LEVEL: dict[str, tuple[str, ...]] = {
    "Bridge": _BODIES,
    "Building": _BODIES,
    "CityFurniture": _ALL,
    "CityObjectGroup": _PLAIN,
    "GenericCityObject": _ALL,
    "LandUse": _FACES,
    "OtherConstruction": _ALL,
    "PlantCover": (*_BODIES, "MultiSolid"),
    "Railway": _LINES,
    "Road": _LINES,
    "SolitaryVegetationObject": _ALL,
    "TINRelief": ("CompositeSurface",),
    "TransportSquare": _LINES,
    "Tunnel": _BODIES,
    "WaterBody": (*_BODIES, "MultiLineString"),
    "Waterway": _LINES,
}
"""City object → the geometries it may have."""
SECOND_LEVEL: dict[str, tuple[str, ...]] = {
    **{
        f"{whole}{part}": kinds
        for whole in ("Bridge", "Building", "Tunnel")
        for part, kinds in _PARTS.items()
    },
    **dict.fromkeys(("BridgeRoom", "BuildingRoom", "BuildingStorey", "BuildingUnit"), _BODIES),
    "TunnelHollowSpace": _BODIES,
}
"""City objects that are part of another one (section 2)."""
_ADDRESSED = ("Bridge", "BridgePart", "Building", "BuildingPart", "BuildingUnit")

COMMON: dict[str, Schema] = {
    "attributes": OBJECT,
    "parents": list_of(TEXT),
    "children": list_of(TEXT),
    "geographicalExtent": numbers(6),
}


def object_of(kind: str) -> Schema:
    """A city object; its geometries, which may be many, are checked each by its own type."""
    known = {**COMMON, "geometry": list_of(OBJECT)}
    if kind in _ADDRESSED:
        known["address"] = list_of(record({"location": {"$ref": "shapes#/MultiPoint"}}))
    if kind == "CityObjectGroup":
        known["children_roles"] = list_of({"type": ["string", "null"]})
    needed = ("parents",) if kind in SECOND_LEVEL else ("children",) if kind == "CityObjectGroup" else ()
    return record(known, needed)


OBJECTS: dict[str, Schema] = {kind: object_of(kind) for kind in (*FIRST_LEVEL, *SECOND_LEVEL)}

_MATERIAL = record(
    {
        "name": TEXT,
        "ambientIntensity": NUMBER,
        **dict.fromkeys(("diffuseColor", "emissiveColor", "specularColor"), numbers(3)),
        "shininess": NUMBER,
        "transparency": NUMBER,
        "isSmooth": {"type": "boolean"},
    },
    ("name",),
    closed=True,
)
_TEXTURE = record(
    {
        "type": {"enum": ("PNG", "JPG")},
        "image": TEXT,
        "wrapMode": {"enum": ("none", "wrap", "mirror", "clamp", "border")},
        "textureType": {"enum": ("unknown", "specific", "typical")},
        "borderColor": numbers(3, 4),
    },
    closed=True,
)
APPEARANCE = record(
    {
        "default-theme-texture": TEXT,
        "default-theme-material": TEXT,
        "materials": list_of(_MATERIAL),
        "textures": list_of(_TEXTURE),
        "vertices-texture": list_of(numbers(2)),
    },
    closed=True,
)
_ROLES = (
    *("resourceProvider", "custodian", "owner", "user", "distributor", "originator", "pointOfContact"),
    *("principalInvestigator", "processor", "publisher", "author", "sponsor", "co-author", "collaborator"),
    *("editor", "mediator", "rightsHolder", "contributor", "funder", "stakeholder"),
)
METADATA = record(
    {
        "identifier": TEXT,
        "pointOfContact": record(
            {
                **dict.fromkeys(("contactName", "phone", "emailAddress", "organization"), TEXT),
                "address": OBJECT,
                "contactType": {"enum": ("individual", "organization")},
                "role": {"enum": _ROLES},
                "website": {"type": "string", "pattern": "^(https?)://"},
            },
            ("contactName", "emailAddress"),
        ),
        "referenceDate": {"type": "string", "pattern": r"^\d{4}-\d{2}-\d{2}$"},
        "title": TEXT,
        "geographicalExtent": numbers(6),
        "referenceSystem": {"type": "string", "pattern": "^https?://www.opengis.net/def/crs/"},
    }
)
HEAD = record(
    {
        "type": {"const": "CityJSON"},
        "version": {"const": "2.0"},
        "metadata": METADATA,
        "extensions": each(
            record(
                {"url": TEXT, "version": {"type": "string", "pattern": r"^\d+\.\d+(\.\d+)?$"}},
                ("url", "version"),
            )
        ),
        "CityObjects": OBJECT,
        "vertices": {"type": "array"},
        "transform": record(
            {"scale": numbers(3), "translate": numbers(3)}, ("scale", "translate"), closed=True
        ),
        "appearance": APPEARANCE,
        "geometry-templates": record(
            {"templates": list_of(OBJECT), "vertices-templates": list_of(numbers(3))},
            ("templates", "vertices-templates"),
            closed=True,
        ),
    },
    ("type", "transform", "version", "CityObjects", "vertices"),
)
"""The first object of a file; city objects, templates and vertices are checked each by its own."""
FEATURE = record(
    {
        "type": {"const": "CityJSONFeature"},
        "id": TEXT,
        "CityObjects": OBJECT,
        "vertices": {"type": "array"},
        "appearance": APPEARANCE,
        **{name: NEVER for name in ("transform", "version", "metadata", "geometry-templates", "extensions")},
    },
    ("type", "id", "CityObjects", "vertices"),
)
SHAPES: dict[str, Schema] = {**OBJECTS, **GEOMETRIES}
"""The parts that other parts name."""
