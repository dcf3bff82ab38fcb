"""A parameter over a range of values, against a reference."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from eaves.report.sweep import parse_values, sweep
from eaves.simulate import nine_roofs_on_a_slope, write_simulation


def test_values_are_listed_or_evenly_spread() -> None:
    assert list(parse_values("0.05,0.1,0.2")) == [0.05, 0.1, 0.2]
    assert list(parse_values("1:2:3")) == pytest.approx([1.0, 1.5, 2.0])


def test_a_height_above_all_roofs_finds_none_of_them(tmp_path: Path) -> None:
    files = write_simulation(nine_roofs_on_a_slope(density=4.0), tmp_path / "nine")
    out = tmp_path / "swept"
    sweep([str(files["points"])], out, "detect.min_height", [1.5, 40.0], files["points"], options={"jobs": 1})
    with (out / "sweep.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    name = next(key for key in rows[0] if "area" in key and "completeness" in key)
    low, high = (float(row[name] or 0.0) for row in rows)
    assert low > 0.9 and not high > 0.1
    assert (out / "sweep.md").exists()
