"""Scans with more points than a building needs: few decide it, all are classified."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np

from eaves.buildings.gather import ENOUGH_PER_M2
from eaves.pipeline import build
from eaves.simulate import nine_roofs_on_a_slope, write_simulation


def test_all_points_of_a_dense_scan_have_their_building_and_plane(tmp_path: Path) -> None:
    scene = nine_roofs_on_a_slope(density=1.5 * ENOUGH_PER_M2, noise=0.02)
    path = write_simulation(scene, tmp_path / "scan")["points"]
    build(path, tmp_path / "out", formats=("cityjson",))
    written = laspy.read(tmp_path / "out" / "classified.laz")
    assert len(written.points) == len(scene.cloud)
    building, plane = np.asarray(written["building_id"]), np.asarray(written["plane_id"])
    roof = scene.plane > 0
    assert (building[roof] > 0).mean() > 0.99 and (building[~roof] > 0).mean() < 0.01
    assert (plane[roof] > 0).mean() > 0.99
    for number in scene.faces:
        counts = np.unique(plane[scene.plane == number], return_counts=True)[1]
        assert counts.max() > 0.95 * counts.sum(), number
