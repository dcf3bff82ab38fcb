"""The terrain of Fc-S, contour by contour and round by round, on scans with a reference ground.

Run `EAVES_DATA=... python -m benchmarks.accuracy.contour_terrain`.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.table import keep
from eaves.formats import read
from eaves.geometry.neighbours import measure_spacing
from eaves.model import Mask, Points, Raster
from eaves.model.cloud import GROUND
from eaves.published.ren_fcs.ground import ContourGround
from eaves.raster.contours import Contour

COMMAND = "python -m benchmarks.accuracy.contour_terrain"
SCANS = ("misc/lidR_Topography.laz", "delft/ahn3.laz", "ign_urban/*.laz")
ISPRS = "isprs_filter/*.txt"
ROUNDS = (0, 1, 10)
RULES: dict[str, tuple[ContourGround, bool]] = {
    "all three": (ContourGround(), True),
    "walls too": (ContourGround(wall_slope=1e9), True),
    "long is 120 m": (ContourGround(), False),
    "no length": (ContourGround(least_length=1e-3), True),
    "no end distance": (ContourGround(end_distance=1e-3), True),
    "no contour": (ContourGround(least_length=1e9), False),
}
"""A filter, and whether a contour across narrow data is long."""
PIECE = 60.0
"""Side (m) of the piece about the middle of each ISPRS sample: a small tile that chose nothing."""


def scans(data: Path) -> Iterator[tuple[str, Points, Mask]]:
    """Name, points (N, 3) about their corner, and which of them are ground (N,)."""
    for path in sorted(data.glob(ISPRS)):
        table = np.loadtxt(path)
        xyz, ground = table[:, :3] - np.floor(table[:, :3].min(axis=0)), table[:, 3] == 0
        yield path.stem, xyz, ground
        inside = (np.abs(xyz[:, :2] - np.median(xyz[:, :2], axis=0)) < 0.5 * PIECE).all(axis=1)
        piece = xyz[inside]
        yield f"{path.stem}, 60 m", piece - np.floor(piece.min(axis=0)), ground[inside]
    for pattern in SCANS:
        for path in sorted(data.glob(pattern)):
            cloud = read(path)
            assert cloud.classification is not None
            xyz = cloud.xyz - np.floor(cloud.xyz.min(axis=0))
            yield path.stem.replace("_LA93_IGN69", ""), xyz, cloud.classification == GROUND


def error(terrain: Raster, xyz: Points, truth: Mask) -> float:
    """Per cent of the points (N, 3) that are taken for what they are not."""
    row, column = terrain.cell_of(xyz)
    ground = np.abs(xyz[:, 2] - terrain.at(xyz)) <= ContourGround().allowed(terrain)[row, column]
    return 100.0 * float((ground != truth).mean())


def rows(data: Path) -> Iterator[dict[str, object]]:
    """One scan a row."""
    for name, xyz, truth in scans(data):
        plain = ContourGround()
        surface = plain.grid_surface(xyz, max(plain.cell_least, measure_spacing(xyz)))
        contours: list[Contour] = plain.draw_contours(surface)
        far = [one for one in contours if not one.closed and one.end_distance > plain.end_distance]
        row: dict[str, object] = {
            "scan": name,
            "closed": sum(one.closed for one in contours),
            "open": sum(not one.closed for one in contours),
            "ends far apart": len(far),
            "and long": sum(map(plain.on_terrain, contours)),
            "or across the data": 0,
        }
        for rule, (method, narrow) in RULES.items():
            lying = [one for one in contours if method.on_terrain(one, surface if narrow else None)]
            row |= {"or across the data": len(lying)} if rule == "all three" else {}
            first = plain.first_terrain(lying, surface, xyz)
            for count in ROUNDS if rule == "all three" else (0, 10):
                refined = method.model_copy(update={"rounds": count}).refine(first, surface)
                row[f"{rule}: {count} rounds %"] = round(error(refined, xyz, truth), 2)
        yield row


def main() -> None:
    """Print and keep the table."""
    table = list(rows(Path(os.environ["EAVES_DATA"])))
    columns = [name for name in table[0] if name.endswith("%")]
    mean: dict[str, object] = {name: None for name in table[0]} | {"scan": "mean"}
    pieces = [row for row in table if str(row["scan"]).endswith(", 60 m")]
    whole = [row for row in table if row not in pieces]
    for group, title in ((whole, "mean"), (pieces, "mean, 60 m")):
        means = {name: round(float(np.mean([row[name] for row in group])), 2) for name in columns}  # type: ignore[arg-type]
        table.append(mean | {"scan": title} | means)
    keep(
        "contour-terrain",
        "Terrain of Fc-S",
        table,
        COMMAND,
        "Total error of the ground, in per cent of all points, in memory: of the first DTM, drawn between "
        "the contours on terrain (0 rounds), after one round and after ten. *No length*, *no end distance*: "
        "without that property; *no contour*: the lowest points of cells of 120 m alone; *long is 120 m*: "
        "however narrow the data; *walls too*: one across narrow data however steep the surface is along it. "
        "The lengths were chosen while looking at the whole scans, the rule of walls at one tile of IGN; the "
        "pieces of 60 m chose nothing.",
    )


if __name__ == "__main__":
    main()
