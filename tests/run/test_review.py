"""The buildings to look at first: their order, their reasons, their place on the page."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
import shapely

from eaves.figures.rows import HIGH, LOW, BuildingRow, judge
from eaves.flow.results import review_rows, write_review
from eaves.formats.vectors.geopackage import Row
from eaves.model.coordinates import LOCAL_METRES

GOOD = {"id": "good", "lod": "2.2", "score": 0.99, "supported_share": 1.0, "inlier_share": 0.99}


def building(side: float = 10.0, **values: object) -> BuildingRow:
    return BuildingRow(
        shapely.box(0, 0, side, 8), {**GOOD, "area_m2": 8.0 * side, **values}, {}, [], True, None, {}
    )


def test_the_worst_stands_first_with_its_reason_and_a_link() -> None:
    rows = review_rows(
        [
            building(),
            building(id="b 2", supported_share=0.4),
            building(id="b3", lod=None, failure_code="no_ground", failure_reason="no terrain"),
        ]
    )
    assert [row.attributes["id"] for row in rows] == ["b3", "b 2"]
    assert [row.attributes["rank"] for row in rows] == [1, 2]
    assert rows[0].attributes["reason"] == "no model: no terrain"
    assert rows[1].attributes["reason"].startswith("60% of the roof is not supported by its points")
    assert rows[1].attributes["link"] == "report.html#building=b%202"


def test_what_is_worth_most_stands_first_and_what_nobody_can_see_is_left_out() -> None:
    rows = review_rows(
        [
            building(id="small", side=2.0, supported_share=0.2),
            building(id="large", side=40.0, supported_share=0.6),
            building(id="worse", supported_share=0.1),
            building(id="row", wall_certainty=0.3),
            building(id="steady", outline_agreement=0.95),
        ]
    )
    assert [row.attributes["id"] for row in rows] == ["large", "worse"]
    assert [row.attributes["worth_m2"] for row in rows] == [128.0, 72.0]


def test_a_polygon_without_a_model_is_listed_whatever_its_size() -> None:
    (row,) = review_rows([building(side=1.0, lod=None, failure_code="no_area", failure_reason="no area")])
    assert row.attributes["worth_m2"] == 8.0


@pytest.mark.parametrize(
    ("width", "length", "height", "kind", "vehicle"),
    [
        (2.6, 12.2, 2.9, "flat", True),
        (2.7, 16.2, 4.3, "flat", True),
        (5.5, 16.4, 4.2, "flat", True),
        (13.4, 16.9, 4.5, "flat", True),
        (2.6, 12.2, 2.9, "gable", False),
        (2.8, 5.8, 2.5, "flat", False),
        (2.7, 16.2, 6.5, "flat", False),
        (6.6, 16.4, 4.2, "flat", False),
        (5.5, 16.4, 2.9, "flat", False),
        (5.5, 24.0, 4.2, "flat", False),
    ],
)
def test_what_has_the_form_of_trailers_may_be_some(
    width: float, length: float, height: float, kind: str, vehicle: bool
) -> None:
    form = {"width_m": width, "length_m": length, "measuredHeight": height, "roof_type": kind}
    trust, _, reason = judge({**GOOD, **form})
    assert (trust == "low", "vehicle" in reason) == (vehicle, vehicle)


@pytest.mark.parametrize(
    ("worse", "word"),
    [
        ({"supported_share": 0.3}, "supported"),
        ({"inlier_share": 0.6}, "within 0.2 m"),
        ({"share_no_data": 0.98}, "has no points"),
        ({"outline_agreement": 0.4}, "half of its boundary points"),
    ],
)
def test_each_fault_lowers_the_trust_and_is_said(worse: dict[str, float], word: str) -> None:
    good, bad = judge(GOOD), judge({**GOOD, **worse})
    assert good[0] == "high" and good[2] == "" and good[1] < 1.0 - HIGH
    assert bad[0] != "high" and word in bad[2] and bad[1] > good[1]


def test_a_base_that_no_ground_shows_is_never_of_high_trust() -> None:
    assert judge({**GOOD, "ground_source": "interpolated"})[0] == "medium"
    assert 0.0 < LOW < HIGH < 1.0


def test_the_table_has_a_place_inside_each_building_and_its_head_where_there_is_none(tmp_path: Path) -> None:
    told = {"rank": 1, "id": "b1", "trust": "low", "worth_m2": 72.0, "reason": "a, b; c", "link": "r#b1"}
    path = write_review(tmp_path / "review.csv", [Row(shapely.box(0, 0, 10, 8), told)], LOCAL_METRES)
    with path.open(newline="", encoding="utf-8") as file:
        (row,) = csv.DictReader(file)
    assert row["reason"] == "a, b; c" and shapely.box(0, 0, 10, 8).contains(
        shapely.Point(float(row["x"]), float(row["y"]))
    )
    write_review(path, [], LOCAL_METRES)
    assert path.read_text("utf-8").splitlines() == ["rank,id,trust,worth_m2,reason,link,x,y"]
