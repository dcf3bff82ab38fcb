"""The file of an owner block's buildings: each by itself, written again as it lies there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely

from eaves.buildings import building_file
from eaves.buildings.building_file import SavedBuilding, building_arrays, saved_buildings
from eaves.model import Failure, Footprint
from eaves.model.results import BuildingResult
from eaves.run.store import load_part, save_part


def some_results() -> list[BuildingResult]:
    """Three failures, of which one has no points."""
    footprints = [Footprint(shapely.box(k, 0, k + 1, 2), id=f"b{k}", score=0.5) for k in range(3)]
    failures = [Failure("no_area", "why", "outline", footprint) for footprint in footprints]
    return [
        BuildingResult(failure, np.arange(3 * k), np.full(3 * k, k, np.int32), {"roof": 0.1 * k})
        for k, failure in enumerate(failures)
    ]


def saved_in(path: Path) -> list[SavedBuilding]:
    """The buildings of a file."""
    return saved_buildings(load_part(path))


def test_a_building_that_is_written_again_is_not_decoded_and_keeps_its_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = some_results(), some_results()
    save_part(tmp_path / "a.part", building_arrays(first))
    saved = saved_in(tmp_path / "a.part")
    assert [one.row.values["id"] for one in saved] == ["b0", "b1", "b2"]
    unpack, decoded = building_file.unpack, list[bytes]()
    monkeypatch.setattr(building_file, "unpack", lambda data: decoded.append(data) or unpack(data))
    save_part(tmp_path / "b.part", building_arrays([saved[0], second[1], saved[2]]))
    assert not decoded
    assert (tmp_path / "a.part").read_bytes() == (tmp_path / "b.part").read_bytes()


def test_a_building_is_decoded_alone_and_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save_part(tmp_path / "a.part", building_arrays(some_results()))
    one = saved_in(tmp_path / "a.part")[2]
    unpack, decoded = building_file.unpack, list[bytes]()
    monkeypatch.setattr(building_file, "unpack", lambda data: decoded.append(data) or unpack(data))
    result = one.result
    assert result.outcome == one.result.outcome == some_results()[2].outcome
    assert result.seconds == {"roof": 0.2} and np.array_equal(result.plane, np.full(6, 2))
    assert len(decoded) == 2  # its row and its answer
