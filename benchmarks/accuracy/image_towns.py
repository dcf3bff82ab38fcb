"""Buildings in drawn clouds of images, by the command: smooth, rough, good and with holes.

`python -m benchmarks.accuracy.image_towns [--scored | --seeds N...] [--kinds KIND...]`. Numbers may be chosen
on the seeds that are drawn by default; those of `--scored` had no say. A roof over 30 m² is found when one
outline covers half of it; an outline over 30 m² is right when half of it lies on roofs.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import get_args

import geopandas
import numpy as np
import shapely

from benchmarks.table import keep
from eaves.simulate import match_images, simulate_town, write_simulation
from eaves.simulate.images import ImageKind
from eaves.simulate.objects.surfaces import TerrainKind

COMMAND = "python -m benchmarks.accuracy.image_towns"
CHOSEN, SCORED = (9101, 9102, 9103, 9104), (9201, 9202, 9203, 9204, 9205, 9206)
KINDS: tuple[ImageKind, ...] = get_args(ImageKind)
TERRAINS: tuple[TerrainKind, ...] = ("flat", "steep", "hilly", "slope")
"""By the seed."""
AREA_KM2, TREES, LEAST_M2 = 0.04, 1.5, 30.0
COUNTS = ("roofs", "found", "outlines", "right", "high trust", "of these false")


def draw(kind: ImageKind, seed: int, folder: Path) -> dict[str, Path]:
    """The files of one town."""
    town = simulate_town(
        AREA_KM2, terrain=TERRAINS[seed % len(TERRAINS)], trees=TREES, seed=seed, style="village"
    )
    return write_simulation(match_images(town, kind, seed), folder)


def judge(outlines: geopandas.GeoDataFrame, roofs: np.ndarray) -> dict[str, float]:
    """Counts of one town, areas common to outlines and `roofs` (K,) polygons, and of either (m²)."""
    drawn = np.asarray(outlines.geometry.values)
    there, found = shapely.union_all(roofs), shapely.union_all(drawn)
    large, wide = shapely.area(roofs) > LEAST_M2, shapely.area(drawn) > LEAST_M2
    roof, outline = shapely.STRtree(drawn).query(roofs, predicate="intersects")
    share = shapely.area(shapely.intersection(roofs[roof], drawn[outline])) / shapely.area(roofs[roof])
    covered = np.isin(np.arange(len(roofs)), roof[share >= 0.5])
    right = shapely.area(shapely.intersection(drawn, there)) >= 0.5 * shapely.area(drawn)
    high = outlines["trust"].to_numpy() == "high"
    counts = (large, covered & large, wide, right & wide, high, high & ~right)
    return {
        **{name: int(mask.sum()) for name, mask in zip(COUNTS, counts, strict=True)},
        "common": there.intersection(found).area,
        "either": there.union(found).area,
    }


def row_of(kind: str, town: str, sums: dict[str, float]) -> dict[str, object]:
    """A row of the table from counts."""
    return {
        "kind": kind,
        "town": town,
        "roofs": sums["roofs"],
        "completeness": sums["found"] / sums["roofs"],
        "outlines": sums["outlines"],
        "correctness": sums["right"] / sums["outlines"] if sums["outlines"] else None,
        "IoU": sums["common"] / sums["either"],
        "high trust": sums["high trust"],
        "of these false": sums["of these false"],
    }


def rows_of(kind: ImageKind, seeds: Sequence[int]) -> list[dict[str, object]]:
    """The rows of all towns of a kind, and of them together."""
    rows, every = [], []
    for seed in seeds:
        with tempfile.TemporaryDirectory() as name:
            files, out = draw(kind, seed, Path(name)), Path(name) / "out"
            words = ["build", files["points"], "-o", out, "--outputs", "footprints", "--allow-empty"]
            subprocess.run([sys.executable, "-m", "eaves", *words], check=True)
            roofs = geopandas.read_file(files["vectors"], layer="footprints").geometry.values
            outlines = geopandas.read_file(out / "footprints.gpkg", layer="footprints")
        every.append(judge(outlines, np.asarray(roofs)))
        rows.append(row_of(kind, f"{seed}, {TERRAINS[seed % len(TERRAINS)]}", every[-1]))
    return [*rows, row_of(kind, "all", {key: sum(one[key] for one in every) for key in every[0]})]


def main() -> None:
    """Print and keep the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    seeds = parser.add_mutually_exclusive_group()
    seeds.add_argument("--scored", action="store_true", help="seeds that had no say in any number")
    seeds.add_argument("--seeds", type=int, nargs="+", default=CHOSEN)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    wanted = parser.parse_args()
    name = f"image-towns{'-scored' * wanted.scored}"
    rows: list[dict[str, object]] = []
    for kind in wanted.kinds:  # kept as it grows: a kind takes minutes
        rows += rows_of(kind, SCORED if wanted.scored else wanted.seeds)
        keep(name, "Drawn clouds of images", rows, " ".join([COMMAND, *sys.argv[1:]]))


if __name__ == "__main__":
    main()
