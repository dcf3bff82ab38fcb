"""Whether `score` means what it says: the share of real buildings among regions of like score.

Run `python -m benchmarks.accuracy.detection_scores`. The towns are neither those the score was calibrated on
(seeds 7300 to 7386) nor the standard ones.
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from benchmarks.accuracy.detection import CELL, top_of_cells, varied_town
from benchmarks.table import keep
from eaves.detect import detect_buildings
from eaves.detect.consensus import Consensus
from eaves.ground import classify_ground
from eaves.model.cloud import BUILDING
from eaves.raster.grid import whole_cells
from eaves.raster.surfaces import make_scene

COMMAND = "python -m benchmarks.accuracy.detection_scores"
DENSITIES = (1.5, 3.0, 6.0, 10.0, 18.0, 30.0, 10.0, 18.0, 30.0, 1.5, 3.0, 6.0)
FIRST_SEED = 7200
BINS = (0.0, 0.2, 0.5, 0.8, 0.9, 0.95, 0.98, 0.99, 0.999, 1.0)


def scored_town(number: int) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """The score of each region of one town (K,), and whether at least half of it is building (K,)."""
    town = varied_town("scores", FIRST_SEED, number, DENSITIES[number])
    exact = town.make()
    order = exact.cloud.canonical_order()
    cloud = exact.cloud.take(order)
    if number % 4 == 3:
        cloud = cloud.with_(return_number=None, number_of_returns=None)
    scene = make_scene(classify_ground(cloud), whole_cells(cloud.bounds, CELL))
    regions = detect_buildings(scene, Consensus())
    top = top_of_cells(cloud.xyz + [*cloud.origin, 0.0], max(CELL, town.density**-0.5))
    label, true = regions.label[top], exact.truth_class[order][top] == BUILDING
    size = np.bincount(label, minlength=regions.count + 1)[1:]
    hits = np.bincount(label[true], minlength=regions.count + 1)[1:]
    return regions.score, hits >= 0.5 * size


def main() -> None:
    """Print and keep the reliability table."""
    towns = [scored_town(number) for number in range(len(DENSITIES))]
    score = np.concatenate([town[0] for town in towns])
    true = np.concatenate([town[1] for town in towns])
    rows: list[dict[str, object]] = []
    for low, high in itertools.pairwise(BINS):
        some = (score >= low) & ((score < high) | (high == BINS[-1]))
        rows.append(
            {
                "score": f"{low:g} to {high:g}",
                "regions": int(some.sum()),
                "mean score": round(float(score[some].mean()), 4) if some.any() else None,
                "share real": round(float(true[some].mean()), 4) if some.any() else None,
            }
        )
    keep("detection-scores", "How sure `consensus` is, and how right", rows, COMMAND, note_of(score, true))


def note_of(score: NDArray[np.float64], true: NDArray[np.bool_]) -> str:
    """What the table was made from, and two measures over all regions."""
    brier = float(np.mean((score - true) ** 2))
    blind = float(true.mean() * (1.0 - true.mean()))
    return (
        f"{len(true)} regions of {len(DENSITIES)} simulated towns (seeds {FIRST_SEED} to "
        f"{FIRST_SEED + len(DENSITIES) - 1}, 1.5 to 30 points/m², three of them without returns), "
        f"{int((~true).sum())} of them false; real: at least half of the region's cells are building. "
        f"Brier score {brier:.4f}; {blind:.4f} for the same score everywhere. "
        f"Mean score {score.mean():.4f}, share real {true.mean():.4f}."
    )


if __name__ == "__main__":
    main()
