"""What the benchmarks of detection share: surveys and towns without classes, cells, rates.

`unseen` judges every method by the command, `sources` the published systems whole.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import laspy
import numpy as np
from numpy.typing import NDArray

from eaves.model import PointCloud, Points
from eaves.simulate.flight import Pattern
from eaves.simulate.objects.exact import ExactScene
from eaves.simulate.objects.streets import TownStyle
from eaves.simulate.objects.surfaces import TerrainKind
from eaves.simulate.scanner import scan_town
from eaves.simulate.standard import StandardScene
from eaves.simulate.town import simulate_town

CELL = 0.5
"""Side of the cells (m) in which areas are compared; a cell is what its highest point is."""
STYLES: tuple[TownStyle, ...] = ("suburb", "centre", "mixed")
TERRAINS: tuple[TerrainKind, ...] = ("flat", "slope", "hilly", "terraced")
PATTERNS: tuple[Pattern, ...] = ("lines", "zigzag", "ellipse")


@dataclass(frozen=True)
class TownScan:
    """One simulated scan; these seeds are not those the weights were fitted on."""

    terrain: TerrainKind
    density: float
    seed: int
    trees: float = 1.0
    pattern: Pattern = "zigzag"

    @property
    def name(self) -> str:
        """Terrain, trees and density."""
        return f"{self.terrain}{', wooded' if self.trees > 1 else ''} {self.density:g}/m²"


TOWNS = (
    TownScan("flat", 4.0, 31),
    TownScan("hilly", 8.0, 32),
    TownScan("hilly", 8.0, 33, trees=2.5),
    TownScan("slope", 25.0, 34, pattern="lines"),
    TownScan("terraced", 12.0, 35),
    TownScan("hilly", 1.0, 36, pattern="lines"),
)


def scan_of(town: TownScan) -> ExactScene:
    """Four hectares of a town, scanned."""
    made = simulate_town(0.04, seed=town.seed, terrain=town.terrain, trees=town.trees)
    return scan_town(made, town.density, 0.02, town.pattern, town.seed)


def varied_town(kind: str, first_seed: int, number: int, density: float) -> StandardScene:
    """A town whose style, terrain, noise, season and pattern follow from its number."""
    return StandardScene(
        f"{kind} {number}",
        first_seed + number,
        STYLES[number % 3],
        TERRAINS[number % 4],
        density,
        noise=(0.02, 0.03, 0.05)[number // 2 % 3],
        leaf_loss=(2.5, 0.5)[number // 3 % 2],
        pattern=PATTERNS[(number + number // 3) % 3],
    )


def read(paths: Iterable[Path]) -> tuple[PointCloud, NDArray[np.uint8]]:
    """The points of files in canonical order, without their classes, and the classes."""
    files = [laspy.read(path) for path in paths]
    whole = PointCloud.from_world(
        np.concatenate([file.xyz for file in files]),
        return_number=np.concatenate([np.asarray(file.return_number, np.uint8) for file in files]),
        number_of_returns=np.concatenate([np.asarray(file.number_of_returns, np.uint8) for file in files]),
        classification=np.concatenate([np.asarray(file.classification, np.uint8) for file in files]),
    )
    whole = whole.take(whole.canonical_order())
    assert whole.classification is not None
    return whole.with_(classification=None), whole.classification


def top_of_cells(xyz: Points, side: float = CELL) -> NDArray[np.int64]:
    """The highest of the points (N, 3), in world metres, of each occupied cell."""
    cell = np.floor(xyz[:, :2] / side).astype(np.int64)
    order = np.lexsort((xyz[:, 2], cell[:, 0], cell[:, 1]))
    last = np.r_[(np.diff(cell[order], axis=0) != 0).any(axis=1), True]
    return order[last]


def rates(got: NDArray[np.bool_], want: NDArray[np.bool_]) -> tuple[float, float, float]:
    """Completeness (recall), correctness (precision) and IoU of one mask against another."""
    both, either = float((got & want).sum()), float((got | want).sum())
    return both / max(1, want.sum()), both / max(1, got.sum()), both / max(1.0, either)
