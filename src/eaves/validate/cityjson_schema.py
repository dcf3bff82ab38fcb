"""The schemas of CityJSON 2.0 for each object, and whether a value fulfils them (draft 7, by jsonschema).

Own words for the rules of https://www.cityjson.org/schemas/2.0.2; the lists of types are theirs. What
geometry, semantics and references mean, and how they are nested, is checked in `structure.py` and `files.py`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from jsonschema import Draft7Validator
from jsonschema.exceptions import SchemaError, UnknownType
from referencing import Registry, Resource
from referencing.exceptions import Unresolvable
from referencing.jsonschema import DRAFT7

Schema = Mapping[str, Any]
LONGEST = 40
"""Characters of a value in a message: no more than a line holds."""


def registry_of(shapes: Schema) -> Registry[Any]:
    """A registry in which the fragment of any address names one of the `shapes`: `x.schema.json#/Solid`."""
    whole = {**shapes, "definitions": shapes}
    return Registry(  # type: ignore[call-arg] # an attrs class
        retrieve=lambda address: Resource.from_contents(whole, default_specification=DRAFT7)
    )


def breaks(value: Any, schema: Schema | bool, registry: Registry[Any] | None = None) -> Iterator[str]:
    """The breaks of a schema by a value, a phrase each that begins with the place.

    Parameters
    ----------
    value : object
        What `json` reads.
    schema : mapping or bool
        The schema; true allows all, false nothing.
    registry : Registry or None
        Documents that a `$ref` may name (`registry_of`).

    Raises
    ------
    ValueError
        When the schema leads round in a circle, names what does not exist, or is none.
    """
    validator = Draft7Validator(schema, registry=Registry() if registry is None else registry)
    try:
        for error in validator.iter_errors(value):
            place = "".join(
                f"[{step}]" if isinstance(step, int) else f".{step}" for step in error.absolute_path
            )
            text = repr(error.instance)
            shown = text if len(text) < LONGEST else f"{text[: LONGEST - 4]}…"
            yield f"{place.lstrip('.') or 'it'}: {error.message.replace(text, shown)}"
    except RecursionError:
        raise ValueError("a schema refers to itself without end") from None
    except (Unresolvable, SchemaError, UnknownType, TypeError, re.error) as error:
        raise ValueError(f"the schema cannot be followed: {str(error).splitlines()[0]}") from None


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
SHAPES: dict[str, Schema] = {
    **OBJECTS,
    **GEOMETRIES,
    "_AbstractCityObject": {"properties": COMMON},
    **{f"_Abstract{kind}": {"properties": OBJECTS[kind]["properties"]} for kind in ("Bridge", "Building")},
    "_AbstractTransportationComplex": {"properties": COMMON},
    "Semantics": record({"type": TEXT}, ("type",)),
    "Lods": {"enum": LODS},
    "Material": _MATERIAL,
    "Texture": _TEXTURE,
    "metadata": METADATA,
}
"""The parts of CityJSON's schemas that extensions name."""
SCHEMAS = registry_of(SHAPES)
PLUS = r"^\+"
_EXTRA = {"type": "object", "patternProperties": {PLUS: True}, "additionalProperties": False}
EXTENSION = record(
    {
        "type": {"const": "CityJSONExtension"},
        "name": {"type": "string", "pattern": r"^\w[a-zA-Z@#0-9._]*$"},
        "url": TEXT,
        "version": {"type": "string", "pattern": r"^\d\.(\d+\.)?(\*|\d+)$"},
        "versionCityJSON": {"type": "string", "pattern": r"^\d\.\d$"},
        "description": TEXT,
        "extraRootProperties": _EXTRA,
        "extraAttributes": record(dict.fromkeys(OBJECTS, _EXTRA), closed=True),
        "extraCityObjects": _EXTRA,
        "extraSemanticSurfaces": _EXTRA,
    },
    (
        *("type", "name", "version", "versionCityJSON"),
        *("extraAttributes", "extraCityObjects", "extraRootProperties", "extraSemanticSurfaces"),
    ),
)
"""A file that defines an extension (section 8)."""
