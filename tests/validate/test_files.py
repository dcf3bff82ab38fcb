"""Every code of `validate` is found in its failing files and not in the barely valid ones beside them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from eaves.formats import InputError
from eaves.validate import RULES, Tolerances, validate_file

FILES = Path(__file__).parent / "files"
ALL = sorted(FILES.glob("*.city.json"))
FAILING = [path for path in ALL if path.name.endswith("_invalid.city.json")]
VALID = [path for path in ALL if path.name.endswith("_valid.city.json") and path not in FAILING]


def code_of(path: Path) -> int:
    return int(path.name[:3])


@pytest.mark.parametrize("path", FAILING, ids=lambda path: path.name.split(".")[0])
def test_a_failing_file_gives_its_code_and_no_other(path: Path) -> None:
    findings = validate_file(path)
    assert {finding.code for finding in findings} == {code_of(path)}
    assert all(finding.name == RULES[finding.code][0] and finding.detail for finding in findings)


@pytest.mark.parametrize("path", VALID, ids=lambda path: path.name.split(".")[0])
def test_a_barely_valid_file_gives_no_finding(path: Path) -> None:
    assert validate_file(path) == []


def test_every_code_has_a_failing_and_a_barely_valid_file() -> None:
    cannot_fail = {103}  # CityJSON closes every ring itself
    in_text = {914}  # below
    assert {code_of(path) for path in FAILING} == set(RULES) - cannot_fail - in_text
    assert {code_of(path) for path in VALID} == set(RULES) - in_text


def test_a_cityjsonseq_is_checked_feature_by_feature(tmp_path: Path) -> None:
    good = json.loads((FILES / "302_shell_not_closed_valid.city.json").read_text(encoding="utf-8"))
    bad = json.loads((FILES / "302_shell_not_closed_invalid.city.json").read_text(encoding="utf-8"))
    lines = [
        {
            "type": "CityJSON",
            "version": "2.0",
            "transform": good["transform"],
            "CityObjects": {},
            "vertices": [],
        }
    ]
    for name, document in (("a", good), ("b", bad), ("c", good)):
        objects = {name: document["CityObjects"]["building"]}
        feature = {"type": "CityJSONFeature", "id": name, "CityObjects": objects}
        lines.append({**feature, "vertices": document["vertices"]})
    path = tmp_path / "three.city.jsonl"
    path.write_text("\n".join(json.dumps(line) for line in lines), encoding="utf-8")
    assert [(finding.code, finding.building) for finding in validate_file(path)] == [(302, "b")]


def test_a_part_is_named_as_overlapping_in_its_building() -> None:
    (finding,) = validate_file(FILES / "601_buildingparts_overlap_invalid.city.json")
    assert finding.building == "building" and "part 0" in finding.detail and "part 1" in finding.detail


def test_the_place_of_a_hole_is_reported_in_the_coordinates_of_the_file() -> None:
    (finding,) = validate_file(FILES / "302_shell_not_closed_invalid.city.json")
    assert "(85000.000, 447000.000, 0.000)" in finding.detail


def test_a_coarser_tolerance_accepts_a_bent_polygon() -> None:
    path = FILES / "203_non_planar_polygon_distance_plane_invalid.city.json"
    assert validate_file(path, Tolerances(planarity=0.02)) == []


def test_a_tolerance_that_is_not_positive_is_refused() -> None:
    with pytest.raises(ValueError, match="snap"):
        Tolerances(snap=0.0)


def test_a_file_that_is_not_there_is_refused_in_one_line() -> None:
    with pytest.raises(InputError, match=r"nothing\.city\.json: cannot be read .*; check the path"):
        validate_file(FILES / "nothing.city.json")


def test_a_broken_line_of_a_cityjsonseq_is_a_finding(tmp_path: Path) -> None:
    path = tmp_path / "cut.city.jsonl"
    grid = {"scale": [0.001] * 3, "translate": [0, 0, 0]}
    head = {"type": "CityJSON", "version": "2.0", "CityObjects": {}, "vertices": [], "transform": grid}
    path.write_text(json.dumps(head) + '\n{"type": "CityJSONFeature", "id"', encoding="utf-8")
    assert [finding.code for finding in validate_file(path)] == [901]


def test_a_file_spread_over_many_lines_is_read(tmp_path: Path) -> None:
    source = FILES / "302_shell_not_closed_invalid.city.json"
    path = tmp_path / "indented.city.json"
    path.write_text(
        json.dumps(json.loads(source.read_text(encoding="utf-8")), indent=2), encoding="utf-8-sig"
    )
    assert validate_file(path) == validate_file(source)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "not json",
        "[]",
        "{}",
        "3",
        '{"type":"CityJSON"}',
        '{"type":"CityJSON","version":"2.0"',
        "[" * 5000,
    ],
)
def test_what_is_not_cityjson_is_a_finding(tmp_path: Path, text: str) -> None:
    path = tmp_path / "bad.city.json"
    path.write_text(text, encoding="utf-8")
    assert {finding.code for finding in validate_file(path)} <= {901, 904}
    assert validate_file(path)


def test_moved_by_whole_kilometres_a_file_gives_the_same_findings(tmp_path: Path) -> None:
    for path in FAILING:
        document = json.loads(path.read_text(encoding="utf-8"))
        document["transform"]["translate"] = [5_480_000.0, 6_720_000.0, 1_000.0]
        moved = tmp_path / path.name
        moved.write_text(json.dumps(document), encoding="utf-8")
        assert [f.code for f in validate_file(moved)] == [f.code for f in validate_file(path)]


VALUES: tuple[object, ...] = (None, -1, 0, 7, 10**30, 0.5, "x", [], {}, [[]], True, float("nan"))


def mutate(value: object, rng: np.random.Generator) -> object:
    """The value with something in it replaced, dropped or doubled."""
    if rng.random() < 0.15 or not isinstance(value, dict | list) or not value:
        return VALUES[rng.integers(len(VALUES))]
    if isinstance(value, dict):
        key = list(value)[rng.integers(len(value))]
        rest = {k: v for k, v in value.items() if k != key or rng.random() < 0.9}
        return {k: mutate(v, rng) if k == key else v for k, v in rest.items()}
    place = int(rng.integers(len(value)))
    change = rng.random()
    if change < 0.15:
        return value[:place] + value[place + 1 :]
    if change < 0.3:
        return [*value, value[place]]
    return [mutate(item, rng) if k == place else item for k, item in enumerate(value)]


def test_mutated_files_never_give_a_traceback(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    path = tmp_path / "mutated.city.json"
    documents = [json.loads(file.read_text(encoding="utf-8")) for file in ALL]
    for number in range(600):
        document = documents[number % len(documents)]
        for _ in range(1 + number % 3):
            document = mutate(document, rng)
        text = json.dumps(document)
        if number % 10 == 0:
            text = text[: int(rng.integers(len(text) + 1))]
        path.write_text(text, encoding="utf-8")
        assert all(finding.code in RULES for finding in validate_file(path))


def codes_of(path: Path, text: str) -> set[int]:
    path.write_text(text, encoding="utf-8", errors="surrogatepass")
    return {finding.code for finding in validate_file(path)}


def test_what_would_hide_a_solid_is_found(tmp_path: Path) -> None:
    """Two objects of one name, a geometry of no known type, a line without objects."""
    document = json.loads((FILES / "901_invalid_input_file_valid.city.json").read_text(encoding="utf-8"))
    name, item = next(iter(document["CityObjects"].items()))
    text, path = json.dumps(document), tmp_path / "a.city.json"
    assert codes_of(path, text) == set()
    again = json.dumps({name: item})[1:-1]
    assert codes_of(path, text.replace(again, f"{again}, {again}")) == {914}
    assert codes_of(path, text.replace('"Solid"', '"Brep"')) == {901}
    seq = tmp_path / "a.city.jsonl"
    head = json.dumps({**document, "CityObjects": {}, "vertices": []})
    feature = {"type": "CityJSONFeature", "id": name, "CityObjects": {name: item}}
    feature["vertices"] = document["vertices"]
    assert codes_of(seq, f"{head}\n{json.dumps(feature)}\n") == set()
    del feature["CityObjects"]
    assert codes_of(seq, f"{head}\n{json.dumps(feature)}\n[1, 2]\n") == {901}


def test_no_id_forges_a_line_or_ends_the_command(tmp_path: Path) -> None:
    from eaves.cli.results import printable

    text = (FILES / "302_shell_not_closed_invalid.city.json").read_text(encoding="utf-8")
    name = next(iter(json.loads(text)["CityObjects"]))
    for wrong in ("x\\n101 FORGED", "\\ud800", "\\u001b[2J"):
        (tmp_path / "a.city.json").write_text(text.replace(f'"{name}"', f'"{wrong}"'), encoding="utf-8")
        findings = validate_file(tmp_path / "a.city.json")
        assert findings
        for finding in findings:
            told = printable(f"{finding.building} {finding.detail}")
            assert "\n" not in told and "\x1b" not in told and told.encode("utf-8")


@pytest.mark.parametrize(("code", "unit_m"), [(28992, 1.0), (2994, 0.3048), (3089, 1200 / 3937)])
def test_the_limits_are_metres_in_feet_too(tmp_path: Path, code: int, unit_m: float) -> None:
    """What is valid or not in metres is so in feet."""
    good = json.loads((FILES / "203_non_planar_polygon_distance_plane_valid.city.json").read_text("utf-8"))
    bad = json.loads((FILES / "203_non_planar_polygon_distance_plane_invalid.city.json").read_text("utf-8"))
    for document, codes in ((good, set()), (bad, {203})):
        document["metadata"] = {"referenceSystem": f"https://www.opengis.net/def/crs/EPSG/0/{code}"}
        for key in ("scale", "translate"):
            document["transform"][key] = [number / unit_m for number in document["transform"][key]]
        path = tmp_path / "scaled.city.json"
        path.write_text(json.dumps(document), encoding="utf-8")
        assert {finding.code for finding in validate_file(path)} == codes
