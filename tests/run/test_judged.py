"""What a run writes agrees with itself, as other libraries read it: the judges of the benchmark."""

from __future__ import annotations

from pathlib import Path

import pytest

from eaves.report.build import build

judges = pytest.importorskip("benchmarks.accuracy.judges")


def test_files_of_a_clipped_run_at_lod_2_3_contradict_nothing(nine_roofs_file: Path, tmp_path: Path) -> None:
    bounds = 84960.0, 447120.0, 85010.0, 447200.0
    summary = build(nine_roofs_file, tmp_path, lod="2.3", bounds=bounds, formats=["cityjson", "geojson"])
    judged = judges.judge(tmp_path)
    assert dict(judged.wrong) == {} and summary.found and judged.compared["volumes"]


def test_files_of_a_survey_in_feet_contradict_nothing(data: Path, tmp_path: Path) -> None:
    assert build(data / "ucla" / "royce.laz", tmp_path).complete
    judged = judges.judge(tmp_path)
    assert dict(judged.wrong) == {} and judged.compared["volumes"]
