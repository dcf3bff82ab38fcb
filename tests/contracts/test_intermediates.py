"""What methods emit is saved as data only: no file of the folder is a pickle."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from eaves.methods import emitter
from eaves.simulate import nine_roofs_on_a_slope


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (np.eye(2), np.eye(2)),
        ([[0.0, 1.0], [2.0, 3.0]], [[0.0, 1.0], [2.0, 3.0]]),
        ([shapely.Point(1, 2), shapely.Point(3, 4)], ["POINT (1 2)", "POINT (3 4)"]),
        ({"a": 1}, "{'a': 1}"),
        ([], []),
    ],
)
def test_a_value_is_saved_without_a_pickle(tmp_path: Path, value: Any, expected: Any) -> None:
    emitter(tmp_path)("some value", value)
    saved = np.load(tmp_path / "some_value.npy", allow_pickle=False)
    assert np.array_equal(saved, np.asarray(expected))


def test_arrays_of_several_shapes_become_an_archive(tmp_path: Path) -> None:
    emitter(tmp_path)("rings", [np.zeros((3, 2)), np.ones((4, 2))])
    with np.load(tmp_path / "rings.npz", allow_pickle=False) as file:
        assert [file[name].shape for name in file.files] == [(3, 2), (4, 2)]


def test_no_method_leaves_a_pickle(tmp_path: Path) -> None:
    import eaves

    truth = nine_roofs_on_a_slope(density=2.0)
    house = truth.buildings[0]
    inside = truth.cloud.xyz[truth.building == 1]
    model = house.model(truth.cloud.origin)
    planes = eaves.segment_roof(inside, 0.7, debug=tmp_path / "roof")
    for method in ("arrangement", "plane_intersection", "prism"):
        eaves.reconstruct_building(inside, model.footprint, planes, 0.0, method, debug=tmp_path / method)
    eaves.trace_outline(inside, 0.7, debug=tmp_path / "outline")
    saved = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert len(saved) > 5
    for path in saved:
        np.load(path, allow_pickle=False)
