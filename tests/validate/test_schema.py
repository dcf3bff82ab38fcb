"""What the schema of CityJSON 2.0 forbids is found; extensions are checked by their definition."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import pytest

from eaves.formats import InputError
from eaves.validate import validate_file
from eaves.validate.cityjson_schema import breaks

BODY = [[[[0, 2, 1]], [[0, 1, 3]], [[1, 2, 3]], [[2, 0, 3]]]]
UNIT = [1.0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
WHOLE: dict[str, Any] = {
    "type": "CityJSON",
    "version": "2.0",
    "transform": {"scale": [0.001, 0.001, 0.001], "translate": [0, 0, 0]},
    "metadata": {
        "title": "all members",
        "referenceDate": "2020-01-01",
        "geographicalExtent": [0, 0, 0, 1, 1, 1],
        "referenceSystem": "https://www.opengis.net/def/crs/EPSG/0/7415",
        "pointOfContact": {"contactName": "a", "emailAddress": "a@b.c", "role": "owner"},
    },
    "extensions": {"Noise": {"url": "https://example.org/noise.ext.json", "version": "1.0"}},
    "appearance": {
        "materials": [{"name": "m", "isSmooth": True, "diffuseColor": [0, 0, 1]}],
        "textures": [{"type": "PNG", "image": "a.png", "wrapMode": "none"}],
        "vertices-texture": [[0, 0], [1, 0], [1, 1]],
    },
    "geometry-templates": {
        "templates": [{"type": "MultiSurface", "lod": "2.1", "boundaries": [[[0, 1, 2]]]}],
        "vertices-templates": [[0, 0, 0], [1, 0, 0], [0, 1, 0]],
    },
    "vertices": [[0, 0, 0], [1000, 0, 0], [0, 1000, 0], [0, 0, 1000]],
    "CityObjects": {
        "b": {
            "type": "Building",
            "attributes": {"a": 1},
            "geographicalExtent": [0, 0, 0, 1, 1, 1],
            "children": ["i"],
            "address": [{"location": {"type": "MultiPoint", "lod": "1", "boundaries": [0]}}],
            "geometry": [
                {
                    "type": "Solid",
                    "lod": "2.2",
                    "boundaries": BODY,
                    "semantics": {
                        "surfaces": [{"type": "RoofSurface", "children": [1]}, {"type": "Door", "parent": 0}],
                        "values": [[0, 1, None, 1]],
                    },
                    "material": {"t": {"values": [[0, 0, None, 0]]}},
                    "texture": {"t": {"values": [[[[0, 0, 1, 2]], [[None]], [[None]], [[0, 1, 2, 0]]]]}},
                }
            ],
        },
        "i": {
            "type": "BuildingInstallation",
            "parents": ["b"],
            "geometry": [
                {"type": "GeometryInstance", "template": 0, "boundaries": [1], "transformationMatrix": UNIT},
                {"type": "MultiLineString", "lod": "1", "boundaries": [[0, 1]]},
            ],
        },
        "g": {"type": "CityObjectGroup", "children": ["x"], "children_roles": ["a"]},
        "x": {"type": "+NoiseWall", "parents": ["g"], "geometry": []},
    },
}
NOISE: dict[str, Any] = {
    "type": "CityJSONExtension",
    "name": "Noise",
    "url": "https://example.org/noise.ext.json",
    "version": "1.0",
    "versionCityJSON": "2.0",
    "extraRootProperties": {"+survey": {"type": "object", "required": ["year"]}},
    "extraAttributes": {"Building": {"+noise": {"type": "number", "minimum": 0}}},
    "extraCityObjects": {
        "+NoiseWall": {
            "allOf": [
                {"$ref": "cityobjects.schema.json#/_AbstractCityObject"},
                {"properties": {"height": {"$ref": "#/definitions/length"}}, "required": ["type"]},
            ]
        }
    },
    "extraSemanticSurfaces": {"+NoiseSurface": {"properties": {"type": {"enum": ["+NoiseSurface"]}}}},
    "definitions": {"length": {"type": "number"}},
}
GONE = object()
B, S, INSTALLED = "CityObjects/b", "CityObjects/b/geometry/0", "CityObjects/i/geometry"
BREAKS: list[tuple[str, Any, int]] = [
    ("version", 2.0, 915),
    ("transform", GONE, 915),
    ("transform/more", 1, 915),
    ("transform/scale", [1, 1], 901),
    ("vertices", GONE, 915),
    ("vertices/1/1", True, 901),
    ("vertices/1/1", "0", 901),
    ("metadata", [], 915),
    ("metadata/title", 1, 915),
    ("metadata/referenceDate", "yesterday", 915),
    ("metadata/referenceSystem", "EPSG:7415", 915),
    ("metadata/geographicalExtent", [1, 2], 915),
    ("metadata/pointOfContact/contactName", GONE, 915),
    ("metadata/pointOfContact/role", "friend", 915),
    ("extensions/Noise/version", 1, 915),
    ("extensions/Noise/url", GONE, 915),
    ("appearance/colour", 1, 915),
    ("appearance/materials/0/name", GONE, 915),
    ("appearance/materials/0/isSmooth", 1, 915),
    ("appearance/textures/0/type", "GIF", 915),
    ("appearance/vertices-texture/0", [1], 915),
    ("geometry-templates/templates", GONE, 915),
    ("geometry-templates/templates/0/lod", 2.1, 915),
    ("geometry-templates/vertices-templates/0", [1, 2], 901),
    (f"{B}/type", "House", 911),
    (f"{B}/type", GONE, 911),
    (f"{B}/attributes", [], 915),
    (f"{B}/geographicalExtent", [1, 2, 3], 915),
    (f"{B}/address", {}, 915),
    (f"{B}/address/0/location/type", "Point", 915),
    (f"{B}/children", "i", 915),
    (f"{B}/children/0", "j", 912),
    (f"{B}/geometry", {}, 901),
    (f"{S}/type", "Brep", 911),
    (f"{S}/type", "+Brep", 911),
    (f"{S}/lod", GONE, 915),
    (f"{S}/lod", "4", 915),
    (f"{S}/lod", 2.2, 915),
    (f"{S}/boundaries", GONE, 915),
    (f"{S}/boundaries/0/0/0/0", 7, 901),
    (f"{S}/more", 1, 915),
    (f"{S}/semantics", None, 915),
    (f"{S}/semantics/values", GONE, 913),
    (f"{S}/semantics/values/0", [0], 913),
    (f"{S}/semantics/surfaces/0/type", "Attic", 911),
    (f"{S}/semantics/surfaces/0/children", [7], 913),
    (f"{S}/material/t", {"values": [[0, 0, None, 0]], "value": 0}, 915),
    (f"{S}/material/t", {"value": 1}, 912),
    (f"{S}/material/t/values/0/0", 1, 912),
    (f"{S}/texture/t/values/0/0/0", [0, 0, 1], 912),
    (f"{S}/texture/t/values/0/0/0", [0, 0, 1, 3], 912),
    (f"{S}/texture/t", [], 915),
    (f"{INSTALLED}/0/template", 1, 912),
    (f"{INSTALLED}/0/boundaries", [0, 1], 915),
    (f"{INSTALLED}/0/boundaries", [9], 901),
    (f"{INSTALLED}/0/transformationMatrix", [1], 915),
    (f"{INSTALLED}/1/boundaries", [[0, 9]], 901),
    (f"{INSTALLED}/1/boundaries", [], 915),
    ("CityObjects/i/parents", GONE, 912),
    ("CityObjects/g/children", GONE, 915),
    ("CityObjects/g/children_roles", [1], 915),
    ("CityObjects/x/type", "+wall", 911),
]
"""Place, what stands there instead, and the code that says so."""


def changed(place: str, value: Any) -> dict[str, Any]:
    """The whole document with one thing exchanged."""
    document = copy.deepcopy(WHOLE)
    *path, last = place.split("/")
    holder: Any = document
    for step in path:
        holder = holder[int(step) if isinstance(holder, list) else step]
    key: Any = int(last) if isinstance(holder, list) else last
    if value is GONE:
        del holder[key]
    else:
        holder[key] = value
    return document


def codes_of(document: Any, folder: Path, *extensions: Path) -> set[int]:
    path = folder / "a.city.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    return {finding.code for finding in validate_file(path, extensions=extensions)}


def written(document: Any, folder: Path) -> Path:
    path = folder / "noise.ext.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


def test_a_document_with_every_member_is_valid(tmp_path: Path) -> None:
    assert codes_of(WHOLE, tmp_path) == set()


@pytest.mark.parametrize(
    ("place", "value", "code"), BREAKS, ids=[f"{one[0]}-{k}" for k, one in enumerate(BREAKS)]
)
def test_each_break_of_the_schema_is_found(tmp_path: Path, place: str, value: Any, code: int) -> None:
    assert code in codes_of(changed(place, value), tmp_path)


@pytest.mark.parametrize("kind", ["TINRelief", "LandUse", "Road"])
def test_a_surface_object_may_be_no_solid(tmp_path: Path, kind: str) -> None:
    assert 915 in codes_of(changed(f"{B}/type", kind), tmp_path)


def test_a_feature_may_not_hold_what_belongs_to_the_first_line(tmp_path: Path) -> None:
    head = {**WHOLE, "CityObjects": {}, "vertices": []}
    objects = {name: WHOLE["CityObjects"][name] for name in ("b", "i")}
    feature = {"type": "CityJSONFeature", "id": "b", "CityObjects": objects, "vertices": WHOLE["vertices"]}
    path = tmp_path / "a.city.jsonl"
    for more, codes in (({}, set()), ({"transform": WHOLE["transform"]}, {915})):
        path.write_text(f"{json.dumps(head)}\n{json.dumps({**feature, **more})}\n", encoding="utf-8")
        assert {finding.code for finding in validate_file(path)} == codes


def test_what_an_extension_adds_is_checked_by_its_definition(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    noise = written(NOISE, tmp_path)
    document = changed(f"{B}/attributes/+noise", 3.5)
    document["+survey"] = {"year": 2020}
    document["CityObjects"]["b"]["geometry"][0]["semantics"]["surfaces"][1] = {"type": "+NoiseSurface"}
    assert codes_of(document, tmp_path, noise) == set()
    assert not caplog.records
    assert codes_of(changed(f"{B}/attributes/+noise", -1), tmp_path, noise) == {915}
    assert codes_of(changed(f"{B}/attributes/+loud", 1), tmp_path, noise) == {911}
    assert codes_of(changed("+survey", {}), tmp_path, noise) == {915}
    assert codes_of(changed("CityObjects/x/height", "tall"), tmp_path, noise) == {915}
    assert codes_of(changed("CityObjects/x/type", "+Fence"), tmp_path, noise) == {911}


def test_an_extension_without_its_definition_is_said_to_be_unchecked(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    codes_of(WHOLE, tmp_path)
    assert "extension Noise adds is not checked" in caplog.text


def test_what_no_extension_is_declared_for_is_found(tmp_path: Path) -> None:
    assert codes_of(changed("extensions", GONE), tmp_path) == {911}


@pytest.mark.parametrize(
    "document",
    [
        {**NOISE, "type": "CityJSON"},
        {**NOISE, "extraCityObjects": {"NoiseWall": {}}},
        {**NOISE, "definitions": {}},
        {**NOISE, "definitions": {"length": {"$ref": "#/definitions/length"}}},
        [],
    ],
)
def test_a_definition_that_cannot_be_followed_is_refused(tmp_path: Path, document: Any) -> None:
    with pytest.raises(InputError, match=r"noise\.ext\.json"):
        codes_of(changed("CityObjects/x/height", 2), tmp_path, written(document, tmp_path))


@pytest.mark.parametrize(
    ("schema", "good", "bad"),
    [
        ({"type": "integer"}, [0, 1.0], [True, 1.5, "1", None]),
        ({"enum": [1, "a"]}, [1, "a"], [True, "b"]),
        ({"type": ["string", "null"], "minLength": 1, "maxLength": 2}, [None, "ab"], ["", "abc", 1]),
        ({"minimum": 0, "exclusiveMaximum": 1}, [0, 0.5, "a"], [-1, 1]),
        ({"exclusiveMinimum": 0}, [1], [0]),
        ({"items": [{"const": 1}, {"const": 2}]}, [[1, 2, 3], [1]], [[2]]),
        ({"uniqueItems": True, "minItems": 1}, [[1, 2]], [[1, 1], []]),
        (
            {"patternProperties": {"^a": {"type": "null"}}, "additionalProperties": False},
            [{"ab": None}],
            [{"b": 1}],
        ),
        (
            {"additionalProperties": {"type": "null"}, "maxProperties": 1},
            [{"b": None}],
            [{"b": 1}, {"b": None, "c": None}],
        ),
        ({"anyOf": [{"const": 1}, {"type": "number"}]}, [1, 2], ["a"]),
        ({"oneOf": [{"const": 1}, {"type": "number"}]}, [2], [1, "a"]),
        ({"not": {"type": "null"}}, [1], [None]),
        (True, [1], []),
        (False, [], [1]),
    ],
)
def test_a_schema_allows_what_draft_7_allows(schema: Any, good: list[Any], bad: list[Any]) -> None:
    assert not [value for value in good if any(breaks(value, schema))]
    assert not [value for value in bad if not any(breaks(value, schema))]
