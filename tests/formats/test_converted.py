"""PLY and E57 files hold the points that were written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from eaves.formats import InputError, read
from eaves.formats.points.remote import localise

XYZ = np.random.default_rng(2).uniform([85_000, 447_000, 0], [85_100, 447_100, 20], (500, 3)).round(3)


def points_of(path: Path, folder: Path) -> np.ndarray:
    [local], _ = localise(path, folder)
    cloud = read(local, crs="metres")
    return np.asarray(cloud.xyz + [*cloud.origin, 0.0])


def test_ply_with_classes_keeps_points_and_classes(tmp_path: Path) -> None:
    plyfile = pytest.importorskip("plyfile")
    rows = np.zeros(500, [("x", "f8"), ("y", "f8"), ("z", "f8"), ("scalar_Classification", "f4")])
    for axis, name in enumerate("xyz"):
        rows[name] = XYZ[:, axis]
    rows["scalar_Classification"] = 6
    plyfile.PlyData([plyfile.PlyElement.describe(rows, "vertex")]).write(tmp_path / "a.ply")
    np.testing.assert_allclose(points_of(tmp_path / "a.ply", tmp_path), XYZ, atol=1e-3)
    [local], _ = localise(tmp_path / "a.ply", tmp_path)
    assert (read(local, crs="metres").classification == 6).all()


def test_e57_of_two_scans_keeps_the_points_of_both(tmp_path: Path) -> None:
    pye57 = pytest.importorskip("pye57")
    with pye57.E57(str(tmp_path / "a.e57"), mode="w") as file:
        for part in (XYZ[:200], XYZ[200:]):
            file.write_scan_raw({f"cartesian{axis}": part[:, k] for k, axis in enumerate("XYZ")})
    np.testing.assert_allclose(points_of(tmp_path / "a.e57", tmp_path), XYZ, atol=1e-3)


@pytest.mark.parametrize("suffix", ["ply", "e57"])
def test_damaged_or_without_its_library_is_one_line(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"bad.{suffix}"
    path.write_bytes(b"no points\n\nat all")
    with pytest.raises(InputError, match=rf"bad\.{suffix}: .*; ") as refused:
        localise(path, tmp_path)
    assert "\n" not in str(refused.value)
