"""High trust is for what was seen: what lowers it, and what does not."""

from __future__ import annotations

from typing import Any

import pytest

from eaves.figures.rows import judge

SOUND: dict[str, Any] = {"lod": "2.2", "area_m2": 100.0, "inlier_share": 1.0, "share_no_data": 0.0}


def test_sound_house_is_trusted_without_a_reason() -> None:
    trust, _, reason = judge(SOUND | {"rmse_m": 0.3, "share_no_data": 0.23, "blank_share": 0.07})
    assert (trust, reason) == ("high", "")


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ({"share_no_data": 0.25}, "25% of its plan has no points"),
        ({"rmse_m": 0.31}, "0.31 m (RMSE) off the roof"),
        ({"blank_share": 0.08}, "nothing was seen beside 8% of its outline"),
        (
            {"roof_type": "flat", "h_ground": 0.0, "h_eaves": 3.0, "h_ridge": 6.0, "share_no_data": 0.1},
            "it has several levels, and 10% of its plan has no points",
        ),
    ],
)
def test_house_with_one_thing_unseen_is_never_highly_trusted_and_says_it_once(
    fault: dict[str, Any], words: str
) -> None:
    trust, _, reason = judge(SOUND | fault)
    assert trust == "medium"
    assert reason.count(words) == 1


def test_given_outline_without_a_roof_has_low_trust() -> None:
    row = {"failure_code": "no_roof", "failure_reason": "leaves", "lod": "1.2"}
    trust, _, reason = judge(SOUND | row)
    assert trust == "low" and "leaves" in reason
