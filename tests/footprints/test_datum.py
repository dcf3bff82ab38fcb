"""A map in another datum: PROJ's own messages never reach the screen."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import geopandas
import numpy as np
import pytest
import shapely
from pyproj import CRS, Transformer
from tests.conftest import write_laz


@pytest.mark.slow
def test_messages_of_proj_stay_off_the_screen__where_it_lacks_the_grid(tmp_path: Path) -> None:
    place = np.array([690000.0, 5336000.0, 500.0])
    rng = np.random.default_rng(1)
    xyz = rng.uniform((0, 0, 0), (40, 40, 0.05), (4000, 3))
    xyz[((xyz[:, :2] > 12) & (xyz[:, :2] < 26)).all(axis=1), 2] += 6.0
    write_laz(tmp_path / "tile.laz", xyz + place, 25832)
    way = Transformer.from_crs(25832, 31468, always_xy=True)
    outline = shapely.box(*(place[:2] + 12), *(place[:2] + 26))
    there = shapely.transform(outline, lambda xy: np.column_stack(way.transform(*xy.T)))
    geopandas.GeoDataFrame(geometry=[there], crs=CRS.from_epsg(31468)).to_file(tmp_path / "map.gpkg")
    words = ["build", "tile.laz", "-o", "out", "--footprints", "map.gpkg", "--outputs", "footprints"]
    done = subprocess.run(
        [sys.executable, "-m", "eaves", *words],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PROJ_NETWORK": "OFF"},
    )
    words_of_proj = ("proj", "pj_", "grid", ".gsb", ".tif", "cannot open")
    lines = [line for line in done.stderr.splitlines() if any(word in line.lower() for word in words_of_proj)]
    assert all(line.startswith("WARNING: map.gpkg: PROJ lacks the grid") for line in lines)
    assert len(lines) <= 1  # none where the grid is installed
