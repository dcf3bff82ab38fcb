"""Holes in roofs that pulses pass through, by the command: membranes, meshes, glass.

`python -m benchmarks.accuracy.membranes`. A hall of 80 by 60 m, 20 m high, of which 50 by 36 m are a
membrane; of its pulses a share passes and comes back from the floor. A hole over 20 m² is false.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import geopandas
import laspy
import numpy as np
import shapely

from benchmarks.table import keep

COMMAND = "python -m benchmarks.accuracy.membranes"
SHAPES, PASSING, DENSITIES = ("flat", "gable", "vault"), (0.1, 0.3, 0.6, 0.8), (8.0, 2.0)
SIDE, MIDDLE, SEED, LARGE_M2 = 200.0, 100.0, 4, 20.0
CORNER = (100_100.0, 400_100.0)


def write_hall(path: Path, shape: str, passing: float, density: float) -> None:
    """The points of a hall and six houses on a slope of 1 %."""
    rng = np.random.default_rng(SEED)
    count = int(SIDE**2 * density)
    x, y = rng.uniform(0.0, SIDE, (2, count))
    ground = 10.0 + 0.01 * x
    across, along = np.abs(y - MIDDLE), np.abs(x - MIDDLE)
    roof = ground.mean() + 20.0 - (0.0 if shape == "flat" else 0.15) * across
    roof += 3.0 * np.cos((x - MIDDLE) / 40.0) if shape == "vault" else 0.0
    z = np.where((along < 40.0) & (across < 30.0), roof, ground)
    through = (along < 25.0) & (across < 18.0) & (rng.random(count) < passing)
    z[through] = ground[through]
    for house in range(6):
        plan = (np.abs(x - 20.0 - 30.0 * house) < 6.0) & (np.abs(y - 20.0) < 5.0)
        z[plan] = ground[plan] + 6.0 - 0.5 * np.abs(y[plan] - 20.0)
    las = laspy.create(point_format=6, file_version="1.4")
    las.header.scales, las.header.offsets = [0.001] * 3, [*CORNER, 0.0]
    las.x, las.y = x + CORNER[0], y + CORNER[1]
    las.z = z + rng.normal(0.0, 0.02, count)
    las.return_number = las.number_of_returns = np.ones(count, np.uint8)
    las.gps_time = np.arange(count) * 1e-5
    las.write(path)


def row_of(shape: str, passing: float, density: float) -> dict[str, object]:
    """The row of one hall."""
    with tempfile.TemporaryDirectory() as name:
        points, out = Path(name) / "hall.laz", Path(name) / "out"
        write_hall(points, shape, passing, density)
        words = ["build", points, "-o", out, "--outputs", "footprints", "--crs", "EPSG:28992", "-q"]
        subprocess.run([sys.executable, "-m", "eaves", *map(str, words)], check=True)
        outlines = geopandas.read_file(out / "footprints.gpkg", layer="footprints").geometry
    west, south = np.add(CORNER, MIDDLE)
    hall = shapely.box(west - 40.0, south - 30.0, west + 40.0, south + 30.0)
    holes = [
        shapely.Polygon(ring).area
        for polygon in shapely.get_parts(np.asarray(outlines.values))
        for ring in polygon.interiors
    ]
    return {
        "roof": shape,
        "pulses that pass": passing,
        "points/m²": density,
        "holes over 20 m²": sum(area > LARGE_M2 for area in holes),
        "largest, m²": round(max(holes, default=0.0), 1),
        "of the hall": shapely.union_all(np.asarray(outlines.values)).intersection(hall).area / hall.area,
    }


def main() -> None:
    """Print and keep the table."""
    rows = [row_of(*one) for one in ((s, p, d) for d in DENSITIES for s in SHAPES for p in PASSING)]
    keep("membranes", "Roofs that pulses pass through", rows, COMMAND)


if __name__ == "__main__":
    main()
