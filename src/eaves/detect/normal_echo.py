"""Buildings by taking away walls, trees and ground, then by component and curvature (Xiao et al.)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pgeof
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from eaves.detect.stage import Detector, covered_area
from eaves.methods import Emit, ignore, parameter
from eaves.model import Labels, Points, Regions, Scene, Values
from eaves.model.scene import NOISE, ROOF, TREE, WALL

NEIGHBOURS_IN_PLANE = 3
"""Fewer points than this and itself have no normal."""


class NormalEcho(Detector):
    """Building labels: what is left after walls, trees and ground, in components that are large and flat.

    Walls leave first, by normals at right angles to the vertical; then trees, by the share of later returns
    around each point. Normals and curvature are computed again on what remains, free of both. The rest, off
    the ground, is joined to Euclidean connected components; area, the ratio of width to height and mean
    density remove trees, and the share of points of high curvature decides. Walls and trees are kept as parts
    of the answer.

    C = 1/k Σ(pᵢ-p̄)(pᵢ-p̄)ᵀ (eq. 1); f_mr = Σ(return number > 1)/Σ points (eq. 2);
    σ = λ₀/(λ₀+λ₁+λ₂) (eq. 3).

    Fidelity
    --------
    The order of steps, equations 1 to 3 and the four tests of a component are the paper's,
    as is its ground filter (`ground.SmoothRegion`), which runs before and not between. None of its thresholds
    is printed, nor is k: all are ours. k follows the density, so that the noise of a range stays small
    against the neighbourhood. Walls get the label of the roof they stand under, within `wall_distance` in
    plan.

    Fails where
    -----------
    No returns: trees then leave by curvature alone. Roofs of many small faces are as curved as trees; trees
    over roofs take the echoes of the roof's edge with them; buildings that touch a hedge become one with it.

    Complexity
    ----------
    Two neighbour searches, O(n log n).

    References
    ----------
    [xiao2014]
    """

    name: ClassVar[str] = "normal_echo"
    idea: ClassVar[str] = "walls by normal, trees by echo, then components of little curvature"
    paper: ClassVar[str] = "xiao2014"
    ground_method: ClassVar[str] = "smooth_region"

    neighbours: int | None = parameter(
        None,
        "Points of a neighbourhood; default: what a disc of 0.75 m holds, 12 to 40.",
        unit="point",
        symbol="k",
        ge=4,
    )
    min_height: float = parameter(1.0, "Lower points are left out before all steps.", unit="m", ge=0.0)
    wall_angle: float = parameter(
        75.0, "Normals that far from the vertical are walls.", unit="degree", gt=0.0, le=90.0
    )
    max_later: float = parameter(
        0.25, "Points with more later returns around them are trees.", symbol="f_mr", ge=0.0, le=1.0
    )
    join: float | None = parameter(
        None,
        "Points nearer than this are one component; default: 3 spacings, at least 0.8.",
        unit="m",
        gt=0.0,
    )
    min_area: float = parameter(6.0, "Smaller components are no buildings.", unit="m²", ge=0.0)
    min_width_to_height: float = parameter(0.4, "Narrower components are trees or poles.", ge=0.0)
    min_density: float = parameter(
        0.3, "Least density, as a share of the scene's: echoes leave trees sparse.", ge=0.0, le=1.0
    )
    curved: float = parameter(0.08, "A larger curvature is high.", symbol="σ", gt=0.0, lt=1.0)
    max_curved: float = parameter(
        0.7, "Components with a larger share of curved points are trees.", ge=0.0, le=1.0
    )
    wall_distance: float = parameter(1.0, "Walls this near to a roof in plan are its.", unit="m", ge=0.0)

    @property
    def buffer(self) -> float:
        return 30.0

    def label(self, scene: Scene, emit: Emit = ignore) -> Regions:
        cloud = scene.cloud
        number = np.zeros(len(cloud), np.int32)
        part = np.where(cloud.noise, NOISE, 0).astype(np.uint8)
        off = np.flatnonzero(~cloud.ground & ~cloud.noise & (scene.height >= self.min_height))
        k = self.neighbours or int(np.clip(round(np.pi * (0.75 / scene.spacing) ** 2), 12, 40))
        if len(off) <= k:
            return Regions(number, np.zeros(0), part)
        xyz = cloud.xyz[off] - [0.0, 0.0, np.floor(cloud.xyz[off, 2].min())]

        near = find_neighbours(xyz, k)
        wall = near.upright(xyz) < np.cos(np.radians(self.wall_angle))
        tree = ~wall & (self.later_returns(scene, off, near) > self.max_later)
        part[off[wall]], part[off[tree]] = WALL, TREE
        emit("walls", cloud.xyz[off[wall]])
        emit("trees", cloud.xyz[off[tree]])
        rest = np.flatnonzero(~wall & ~tree)
        if len(rest) <= k:
            return Regions(number, np.zeros(0), part)
        again = find_neighbours(xyz[rest], k)
        component = again.components(self.join or max(0.8, 3.0 * scene.spacing))
        emit("components", numbers_of_all(component, off[rest], len(cloud)))
        label, score = self.judge(scene, off[rest], component, again.curvature(xyz[rest]))
        number[off[rest]] = label
        part[off[rest[label > 0]]] = ROOF
        self.claim_walls(cloud.xyz, off[wall], number)
        return Regions(number, score, part)

    def later_returns(self, scene: Scene, off: NDArray[np.int64], near: Neighbourhoods) -> Values:
        """f_mr (M,), eq. 2; zero where the cloud does not tell returns apart."""
        if not scene.cloud.has_returns or scene.cloud.return_number is None:
            return np.zeros(len(off))
        return np.asarray((scene.cloud.return_number[off] > 1)[near.index].mean(axis=1), np.float64)

    def judge(
        self, scene: Scene, index: NDArray[np.int64], component: Labels, curvature: Values
    ) -> tuple[Labels, Values]:
        """Labels (M,) of the points `index` (M,) of components that pass the tests, and their scores (K,)."""
        count = int(component.max()) + 1
        xyz, height = scene.cloud.xyz[index], scene.height[index]
        size = np.bincount(component, minlength=count)
        area = covered_area(xyz, component.astype(np.int64), count, scene.spacing)
        top = np.zeros(count)
        np.maximum.at(top, component, height)
        density = size * scene.spacing**2 / np.maximum(area, 1e-9)
        curved = np.bincount(component, weights=curvature > self.curved, minlength=count) / size
        building = (
            (area >= self.min_area)
            & (np.sqrt(area) >= self.min_width_to_height * top)
            & (density >= self.min_density)
            & (curved <= self.max_curved)
        )
        new = np.zeros(count, np.int32)
        new[building] = np.arange(1, int(building.sum()) + 1)
        return new[component], 1.0 - curved[building]

    def claim_walls(self, xyz: Points, wall: NDArray[np.int64], number: Labels) -> None:
        """Give wall points (indices) the label of the nearest roof point, if near in plan and not lower."""
        roof = np.flatnonzero(number > 0)
        if not len(roof) or not len(wall):
            return
        tree = cKDTree(xyz[roof, :2])
        answer = tree.query(xyz[wall, :2], distance_upper_bound=self.wall_distance)
        distance, nearest = np.asarray(answer[0]), np.asarray(answer[1])
        found = np.flatnonzero(np.isfinite(distance))
        owner = roof[nearest[found]]
        under = xyz[wall[found], 2] <= xyz[owner, 2] + 0.2
        number[wall[found[under]]] = number[owner[under]]


def numbers_of_all(number: Labels, index: NDArray[np.int64], count: int) -> Labels:
    """Numbers 1…K (count,) of all points, 0 for none, from those 0…K-1 (M,) of the points `index` (M,)."""
    every = np.zeros(count, np.int32)
    every[index] = number + 1
    return every


@dataclass(frozen=True, eq=False)
class Neighbourhoods:
    """The k nearest of each of M points: `index` (M, k), itself first, and squared distances (M, k)."""

    index: NDArray[np.int64]
    squared: NDArray[np.float32]

    def _features(self, xyz: Points) -> NDArray[np.float32]:
        count, k = self.index.shape
        start = np.arange(count + 1, dtype=np.uint32) * np.uint32(k)
        flat = self.index.astype(np.uint32).ravel()
        return np.asarray(
            pgeof.compute_features(
                xyz.astype(np.float32), flat, start, k_min=NEIGHBOURS_IN_PLANE, verbose=False
            ),
            np.float32,
        )

    def upright(self, xyz: Points) -> Values:
        """The vertical component of the normal (M,): 1 on flat roofs, 0 on walls; eq. 1."""
        return np.abs(self._features(xyz)[:, 6]).astype(np.float64)

    def curvature(self, xyz: Points) -> Values:
        """σ (M,), eq. 3."""
        return self._features(xyz)[:, 10].astype(np.float64)

    def components(self, join: float) -> Labels:
        """Numbers (M,) of the Euclidean connected components: neighbours nearer than `join` (m) are one."""
        count, k = self.index.shape
        close = self.squared <= join * join
        one = np.repeat(np.arange(count), k)[close.ravel()]
        graph = coo_array((np.ones(len(one), np.int8), (one, self.index[close])), (count, count))
        return np.asarray(connected_components(graph, directed=False)[1], np.int32)


def find_neighbours(xyz: Points, count: int) -> Neighbourhoods:
    """The `count` nearest points of each point (M, 3), M > `count`."""
    local = np.ascontiguousarray(xyz, np.float32)
    index, squared = pgeof.knn_search(local, local, count)
    return Neighbourhoods(index.astype(np.int64), squared)
