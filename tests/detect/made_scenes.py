"""Small scenes with exact truth for the detectors: flat land, boxes, gables, trees."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from eaves.model import Bounds, PointCloud, Scene
from eaves.model.cloud import GROUND, UNCLASSIFIED
from eaves.raster.surfaces import scene_of

Part = tuple[NDArray[np.float64], int, NDArray[np.uint8], NDArray[np.uint8]]
"""Points (M, 3), the object they are of, return number and number of returns (M,)."""


@dataclass
class MadeScene:
    """Points gathered one object at a time; object 0 is the land, trees are negative, buildings positive."""

    density: float = 8.0
    size: float = 60.0
    noise: float = 0.02
    seed: int = 1
    parts: list[tuple[NDArray[np.float64], int, NDArray[np.uint8], NDArray[np.uint8]]] = field(
        default_factory=list
    )

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.seed)
        self.taken: list[tuple[float, float, float, float]] = []

    def scatter(self, west: float, south: float, east: float, north: float) -> NDArray[np.float64]:
        count = round(self.density * (east - west) * (north - south))
        return self.rng.uniform((west, south), (east, north), (count, 2))

    def add(
        self,
        xy: NDArray[np.float64],
        z: NDArray[np.float64],
        what: int,
        number: NDArray[np.uint8] | None = None,
        of: NDArray[np.uint8] | None = None,
    ) -> None:
        one = np.ones(len(xy), np.uint8)
        z = z + self.rng.normal(0.0, self.noise, len(xy))
        self.parts.append((np.c_[xy, z], what, one if number is None else number, one if of is None else of))

    def box(self, west: float, south: float, east: float, north: float, height: float, what: int) -> None:
        xy = self.scatter(west, south, east, north)
        self.add(xy, np.full(len(xy), height), what)
        self.taken.append((west, south, east, north))

    def gable(
        self, west: float, south: float, east: float, north: float, low: float, high: float, what: int
    ) -> None:
        """A gable roof whose ridge runs east."""
        xy = self.scatter(west, south, east, north)
        middle, half = (south + north) / 2, (north - south) / 2
        self.add(xy, high - (high - low) * np.abs(xy[:, 1] - middle) / half, what)
        self.taken.append((west, south, east, north))

    def tree(self, x: float, y: float, radius: float, top: float, what: int) -> None:
        """A crown of scattered first and second returns, and the third from the ground."""
        xy = self.scatter(x - radius, y - radius, x + radius, y + radius)
        xy = xy[np.hypot(*(xy - [x, y]).T) < radius]
        depth = np.sqrt(np.maximum(1 - (np.hypot(*(xy - [x, y]).T) / radius) ** 2, 0))
        first = top - radius + radius * depth * self.rng.uniform(0.4, 1.0, len(xy))
        one = np.ones(len(xy), np.uint8)
        self.add(xy, first, what, one, 3 * one)
        self.add(xy, first - self.rng.uniform(0.7, 2.0, len(xy)), what, 2 * one, 3 * one)
        below = self.rng.random(len(xy)) < 0.5
        self.add(xy[below], np.zeros(below.sum()), 0, 3 * one[below], 3 * one[below])

    def scene(self, returns: bool = True) -> tuple[Scene, NDArray[np.int64]]:
        """The scene with true ground, and the object of each of its points (N,)."""
        xy = self.scatter(0.0, 0.0, self.size, self.size)
        for west, south, east, north in self.taken:
            xy = xy[~((xy[:, 0] > west) & (xy[:, 0] < east) & (xy[:, 1] > south) & (xy[:, 1] < north))]
        self.add(xy, np.zeros(len(xy)), 0)
        xyz = np.concatenate([part[0] for part in self.parts])
        what = np.concatenate([np.full(len(part[0]), part[1]) for part in self.parts])
        cloud = PointCloud.from_world(
            xyz,
            origin=(0.0, 0.0),
            return_number=np.concatenate([part[2] for part in self.parts]) if returns else None,
            number_of_returns=np.concatenate([part[3] for part in self.parts]) if returns else None,
            classification=np.where(what == 0, GROUND, UNCLASSIFIED).astype(np.uint8),
        )
        order = cloud.canonical_order()
        return scene_of(cloud.take(order), Bounds(0.0, 0.0, self.size, self.size)), what[order]


def two_houses_and_a_tree(density: float = 8.0, seed: int = 1) -> MadeScene:
    made = MadeScene(density=density, seed=seed)
    made.gable(10.0, 10.0, 22.0, 19.0, 4.0, 8.0, 1)
    made.box(35.0, 35.0, 47.0, 45.0, 6.0, 2)
    made.tree(15.0, 45.0, 4.0, 9.0, -1)
    return made
