"""Whether a CityJSON document is built as the standard says: members, types, semantics, references.

Of version 2.0 every member is held against the standard's schema (`cityjson_schema.py`), of 1.0 and 1.1 what
decides what a file means. The geometry is checked elsewhere. Names that begin with `+` belong to extensions:
what they may hold is known where the extension's file is given.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from eaves.formats import InputError
from eaves.model import Finding
from eaves.validate.cityjson_schema import (
    DEPTHS,
    FEATURE,
    FIRST_LEVEL,
    GEOMETRIES,
    HEAD,
    INSTANCE,
    OBJECTS,
    SCHEMAS,
    SECOND_LEVEL,
    SURFACES,
    breaks,
)
from eaves.validate.codes import make_finding
from eaves.validate.extensions import Extension

ADDED_OBJECT = re.compile(r"\+[A-Z]\w+")
ADDED_SURFACE = re.compile(r"\+\w+")
"""How the names of an extension's city objects and surfaces are formed."""


@dataclass(frozen=True)
class Rules:
    """The context against which the documents of one file are checked."""

    strict: bool = True
    """Whether the file is of version 2.0, of which there is a schema here."""
    declared: frozenset[str] = frozenset()
    """Names of the extensions that the file uses."""
    extensions: tuple[Extension, ...] = ()
    """Those of them whose file was given."""
    templates: int = 0
    appearance: Mapping[str, Any] = field(default_factory=dict)
    """Of the file's first object, for features that have none."""

    @classmethod
    def of(cls, head: dict[str, Any], extensions: Sequence[Extension] = ()) -> Rules:
        """The rules of a file by its first object, and the definitions given of extensions."""
        given, appearance = head.get("extensions"), head.get("appearance")
        declared = frozenset(given) if isinstance(given, dict) else frozenset()
        return cls(
            str(head.get("version")) == "2.0",
            declared,
            tuple(extensions),
            count_templates(head),
            appearance if isinstance(appearance, dict) else {},
        )

    def adding(self, part: str, name: str) -> Extension | None:
        """The extension that adds something by this name."""
        return next((one for one in self.extensions if name in one.added(part)), None)

    @property
    def all_known(self) -> bool:
        """Whether every extension that the file uses was given."""
        return self.declared <= {extension.name for extension in self.extensions}


def count_templates(head: dict[str, Any]) -> int:
    """How many geometry templates a document has."""
    given = head.get("geometry-templates")
    templates = given.get("templates") if isinstance(given, dict) else None
    return len(templates) if isinstance(templates, list) else 0


def check_head(head: dict[str, Any], rules: Rules) -> Iterator[Finding]:
    """Findings of what a file's first object must have."""
    if not rules.strict:
        for name, kind in (("CityObjects", dict), ("vertices", list)):
            if not isinstance(head.get(name), kind):
                yield make_finding(915, "", "file", f"it has no {name}, which must be there, be it empty")
        return
    for broken in breaks(head, HEAD, SCHEMAS):
        yield make_finding(915, "", "file", broken)
    for name, value in head.items():
        if name.startswith("+"):
            yield from check_added("", "file", "extraRootProperties", name, value, rules)
    templates = head.get("geometry-templates")
    listed = templates.get("templates") if isinstance(templates, dict) else None
    for number, geometry in enumerate(as_list(listed)):
        if isinstance(geometry, dict):
            where = f"template {number}"
            if geometry.get("type") == INSTANCE:
                yield make_finding(911, "geometry-templates", where, "a template is no instance of another")
            yield from check_geometry("geometry-templates", where, geometry, rules, rules.appearance)


def check_feature(document: Any) -> Iterator[Finding]:
    """Findings of a later line of a CityJSONSeq file."""
    if not isinstance(document, dict) or document.get("type") != "CityJSONFeature":
        yield make_finding(915, "", "file", 'a line is not an object of type "CityJSONFeature"')
        return
    name = document.get("id")
    for broken in breaks(document, FEATURE, SCHEMAS):
        yield make_finding(915, str(name or ""), "feature", broken)
    objects = document.get("CityObjects")
    if isinstance(name, str) and isinstance(objects, dict) and name not in objects:
        yield make_finding(912, name, "feature", "no city object of the feature has its id")


def check_objects(document: dict[str, Any], rules: Rules) -> Iterator[Finding]:
    """Findings of the city objects of one document, geometry left out."""
    objects = document.get("CityObjects", {})
    own = document.get("appearance")
    appearance = own if isinstance(own, dict) else rules.appearance
    for name, item in objects.items():
        if not isinstance(item, dict):
            continue  # the geometry's check says so
        kind = item.get("type")
        yield from check_object(name, item, kind, rules)
        yield from check_family(name, item, objects)
        geometries = item.get("geometry", [])
        for number, geometry in enumerate(as_list(geometries)):
            if isinstance(geometry, dict):
                where = f"geometry {number}"
                yield from check_geometry(name, where, geometry, rules, appearance)
                allowed = {**FIRST_LEVEL, **SECOND_LEVEL}.get(kind) if isinstance(kind, str) else None
                known = isinstance(geometry.get("type"), str) and geometry["type"] in GEOMETRIES
                if rules.strict and allowed is not None and known and geometry["type"] not in allowed:
                    yield make_finding(915, name, where, f"a {kind} may not be a {geometry['type']}")


def check_object(name: str, item: dict[str, Any], kind: Any, rules: Rules) -> Iterator[Finding]:
    """Findings of a city object's type and members."""
    if isinstance(kind, str) and kind in OBJECTS:
        if rules.strict:
            schema = {key: one for key, one in OBJECTS[kind].items() if key != "required"}
            for broken in breaks(item, schema, SCHEMAS):
                yield make_finding(915, name, "object", broken)
            if kind == "CityObjectGroup" and "children" not in item:
                yield make_finding(915, name, "object", "it has no children")
            for attribute, value in as_object(item.get("attributes")).items():
                if attribute.startswith("+") and rules.extensions:
                    part = "extraAttributes"
                    yield from check_added(name, "attributes", part, attribute, value, rules, kind)
        elif not isinstance(item.get("attributes", {}), dict):
            yield make_finding(915, name, "object", "its attributes are not an object")
    elif isinstance(kind, str) and ADDED_OBJECT.match(kind):
        yield from check_added(name, "object", "extraCityObjects", kind, item, rules)
    else:
        yield make_finding(911, name, "object", f"{kind!r} is no type of city object")


def check_added(
    name: str, where: str, part: str, added: str, value: Any, rules: Rules, owner: str = ""
) -> Iterator[Finding]:
    """Findings of what an extension adds: it is declared, and as the definition says where that is given."""
    if not rules.strict:
        return
    if not rules.declared:
        yield make_finding(911, name, where, f"{added!r} belongs to an extension, and none is declared")
        return
    part = f"{part}/{owner}" if owner else part
    extension = rules.adding(part, added)
    if extension is not None:
        try:
            for broken in extension.breaks(value, part, added):
                yield make_finding(915, name, where, f"by extension {extension.name}, {broken}")
        except ValueError as error:
            raise InputError.about(extension.path, f"cannot be followed: {error}", "correct it") from None
    elif rules.all_known:
        yield make_finding(911, name, where, f"none of the extensions given has {added!r}")


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


def check_geometry(
    name: str, where: str, geometry: dict[str, Any], rules: Rules, appearance: Mapping[str, Any]
) -> Iterator[Finding]:
    """Findings of a geometry's type, members, semantics, materials, textures and template."""
    kind = geometry.get("type")
    if not isinstance(kind, str) or kind not in GEOMETRIES:
        if isinstance(kind, str):
            yield make_finding(911, name, where, f"{kind!r} is no type of geometry")
        return
    if rules.strict:
        for broken in breaks(geometry, GEOMETRIES[kind], SCHEMAS):
            yield make_finding(915, name, where, broken)
    if kind == INSTANCE:
        number = geometry.get("template")
        if type(number) is not int or not 0 <= number < rules.templates:
            yield make_finding(912, name, where, f"there is no template {number!r} among {rules.templates}")
        return
    depth = max(1, DEPTHS[kind] - 2)  # one value a point, line or surface
    if isinstance(geometry.get("semantics"), dict):
        yield from check_semantics(name, where, geometry, depth, rules)
    materials = len(as_list(appearance.get("materials")))
    for theme, one in as_object(geometry.get("material")).items():
        given = as_object(one)
        single = given.get("value")
        exists = single is None or (type(single) is int and 0 <= single < materials)
        if not exists or not fits(given.get("values"), geometry.get("boundaries"), depth, materials):
            yield make_finding(
                912, name, where, f"material {theme!r} is not one of {materials} for each face"
            )
    counts = tuple(len(as_list(appearance.get(member))) for member in ("textures", "vertices-texture"))
    for theme, one in as_object(geometry.get("texture")).items():
        values = as_object(one).get("values")
        if values is not None and not covers(values, geometry.get("boundaries"), depth, *counts):
            detail = (
                f"texture {theme!r} is not one of {counts[0]} with a place of {counts[1]} for each vertex"
            )
            yield make_finding(912, name, where, detail)


def covers(values: Any, boundaries: Any, depth: int, textures: int, places: int) -> bool:
    """Whether texture values are nested as boundaries: for each ring its texture and a place for each vertex,
    or null alone. `depth` counts the lists above the rings' list."""
    if not isinstance(values, list) or not isinstance(boundaries, list) or len(values) != len(boundaries):
        return False
    pairs = zip(values, boundaries, strict=True)
    if depth > 0:
        return all(covers(*pair, depth - 1, textures, places) for pair in pairs)
    return all(has_texture(*pair, textures, places) for pair in pairs)


def has_texture(values: Any, ring: Any, textures: int, places: int) -> bool:
    """Whether a ring's texture values are null alone, or a texture and a place for each vertex."""
    if values == [None]:
        return True
    if not isinstance(values, list) or not isinstance(ring, list) or len(values) != len(ring) + 1:
        return False
    texture, *others = values
    if type(texture) is not int or not 0 <= texture < textures:
        return False
    return all(type(one) is int and 0 <= one < places for one in others)


def as_list(value: Any) -> list[Any]:
    """A value that is a list, else an empty one."""
    return value if isinstance(value, list) else []


def as_object(value: Any) -> dict[str, Any]:
    """A value that is an object, else an empty one."""
    return value if isinstance(value, dict) else {}


def check_semantics(
    name: str, where: str, geometry: dict[str, Any], depth: int, rules: Rules
) -> Iterator[Finding]:
    """Findings of the semantic surfaces: known types, a value for each surface, none that does not exist."""
    semantics = geometry["semantics"]
    surfaces = semantics.get("surfaces") if isinstance(semantics, dict) else None
    if not isinstance(surfaces, list) or "values" not in semantics:
        yield make_finding(913, name, where, "its semantics are not surfaces and values")
        return
    for number, surface in enumerate(surfaces):
        kind = surface.get("type") if isinstance(surface, dict) else None
        if isinstance(kind, str) and ADDED_SURFACE.match(kind):
            yield from check_added(name, where, "extraSemanticSurfaces", kind, surface, rules)
        elif kind not in SURFACES:
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
