"""Error maps of the ground on the eight ISPRS samples and on every drawn kind: docs/gallery/ground-sheet.png.

Run `EAVES_DATA=... python -m benchmarks.gallery.ground_sheet [--keep MASKS] [--before MASKS]`. `--keep`
writes the masks (.npz) and draws nothing; those that older code kept stand above those of now by `--before`.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from benchmarks.accuracy.ground import ISPRS, RULES_SEED, read_isprs
from benchmarks.accuracy.ground_kinds import DENSITIES, KINDS, scan
from benchmarks.gallery.ground import SHADES
from benchmarks.gallery.solids import FOLDER, save_small
from eaves.ground import classify_ground
from eaves.model import Mask, PointCloud

COLUMNS = 9
"""Maps beside each other."""


def cases(data: Path) -> Iterator[tuple[str, PointCloud, Mask]]:
    """Name, cloud and truth of each map."""
    for name in ISPRS:
        sample = read_isprs(data, name)
        yield name, sample.cloud, sample.truth
    for kind in KINDS:
        yield kind.__name__.replace("_", " "), *scan(kind, DENSITIES[0], RULES_SEED)


def draw_map(axes: Axes, title: str, cloud: PointCloud, truth: Mask, ground: Mask) -> None:
    """One map: ground grey, objects green, ground lost blue, objects taken red."""
    lost, taken = truth & ~ground, ~truth & ground
    colours = (
        ("0.85", truth & ground),
        ("#c3dbaa", ~truth & ~ground),
        ("tab:blue", lost),
        ("tab:red", taken),
    )
    for colour, which in colours:
        size = 0.3 if colour.startswith(("0", "#")) else 1.0
        axes.scatter(*cloud.xyz[which, :2].T, s=size, c=colour, linewidths=0, rasterized=True)
    share = 100.0 * float(np.mean(lost)), 100.0 * float(np.mean(taken))
    axes.set_title(f"{title}: {sum(share):.2f} %", fontsize=6, pad=2)
    axes.set_aspect("equal")
    axes.axis("off")


def main() -> None:
    """Draw the sheet, or keep the masks."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--before", type=Path)
    wanted = parser.parse_args()
    shown = list(cases(Path(os.environ["EAVES_DATA"])))
    now = {name: classify_ground(cloud).ground for name, cloud, _ in shown}
    if wanted.keep:
        np.savez_compressed(wanted.keep, **now)
        return
    sets = ([("before", np.load(wanted.before))] if wanted.before else []) + [("now", now)]
    rows = -(-len(shown) // COLUMNS)
    figure, grid = plt.subplots(
        rows * len(sets), COLUMNS, figsize=(13, 2.2 * rows * len(sets)), squeeze=False
    )
    for number, (name, cloud, truth) in enumerate(shown):
        for place, (when, masks) in enumerate(sets):
            axes = grid[number // COLUMNS * len(sets) + place, number % COLUMNS]
            draw_map(axes, f"{name}, {when}", cloud, truth, masks[name])
    figure.tight_layout(pad=0.3)
    save_small(figure, FOLDER / "ground-sheet.png", 110, SHADES)


if __name__ == "__main__":
    main()
