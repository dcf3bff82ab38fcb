"""Tests without their judge are counted, and fail where judges must be there."""

from __future__ import annotations

import pytest

from tests.judges import MISSING, judging_module, need_judge, summary_of


def test_a_missing_judge_skips__and_fails_where_judges_must_be(monkeypatch: pytest.MonkeyPatch) -> None:
    need_judge("QGIS", True)
    monkeypatch.delenv("EAVES_JUDGES", raising=False)
    with pytest.raises(pytest.skip.Exception, match="no judge: nobody"):
        judging_module("nobody.at_all")
    monkeypatch.setenv("EAVES_JUDGES", "1")
    with pytest.raises(pytest.fail.Exception, match="no judge: QGIS"):
        need_judge("QGIS", None)


def test_one_line_counts_what_was_skipped() -> None:
    reasons = [
        f"Skipped: {MISSING}QGIS",
        f"Skipped: {MISSING}pvlib",
        f"Skipped: {MISSING}QGIS",
        "Skipped: Windows",
    ]
    assert summary_of(reasons).startswith("3 tests skipped without their judge: QGIS 2, pvlib 1")
    assert summary_of(["Skipped: Windows"]) == ""
