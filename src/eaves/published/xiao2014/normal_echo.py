"""Buildings by taking away walls, trees and ground, then by component and curvature (Xiao et al.)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from eaves.detect.stage import MIN_HEIGHT_M, ROOM_M, Detector, area_of_cells
from eaves.detect.toolkit.surface_grid import GROUP_M2
from eaves.geometry.planes import (
    NEIGHBOURS,
    NOISE_AREA_M2,
    SMOOTH_ANGLE_DEG,
    TREE_SHARE,
    WALL_ANGLE_DEG,
    euclidean_components,
    find_walls_and_trees,
    grow_regions,
    local_planes,
    region_areas,
)
from eaves.methods import Emit, ignore, parameter
from eaves.model import Labels, Points, Regions, Scene, Values
from eaves.model.scene import DOUBTFUL, NOISE, ROOF, TREE, WALL


class NormalEcho(Detector):
    """Building labels: what is left after walls, trees and ground, in components that are large and flat.

    Walls leave first, by normals at right angles to the vertical; then trees, by the share of later returns
    around each point; then, with the ground, the small smooth regions, which are birds and crowns. The ground
    filter of the same paper finds all three on its way and hands them on. Normals and curvature are computed
    again on what remains. The rest, off the ground, is joined to Euclidean connected components; area, the
    ratio of width to height and mean density remove trees, and the share of points of high curvature decides.
    Walls and trees are kept as parts of the answer.

    Formula
    -------
    C = 1/k Σ(pᵢ-p̄)(pᵢ-p̄)ᵀ (eq. 1); f_mr = Σ(return number > 1)/Σ points (eq. 2);
    σ = λ₀/(λ₀+λ₁+λ₂) (eq. 3).

    Fidelity
    --------
    The order of steps, equations 1 to 3 and the tests of a component are the paper's, as is its ground filter
    (`ground.SmoothRegion`). None of its thresholds is printed, nor is k: all are ours. k follows the density,
    so that the noise of a range stays small against the neighbourhood. Added: a least width; and walls, small
    regions and echoes at most `wall_distance` from a roof in plan go back to it where they lie on it (ridges,
    chimneys, rims), over which components are joined once more; the paper leaves them out. The test of mean
    density removes next to nothing: where echoes and small regions have left, what is left of a crown is as
    dense as a roof (docs/sources).

    Fails where
    -----------
    No returns: trees then leave by small regions and curvature alone. Clipped hedges over two metres wide;
    roofs of many small faces; where other ground is used, walls and trees are found here, at the same cost.

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
    min_height: float = parameter(
        MIN_HEIGHT_M, "Lower points are left out before all steps.", unit="m", off=0.0, ge=0.0
    )
    wall_angle: float = parameter(
        WALL_ANGLE_DEG,
        "Normals that far from the vertical are walls; only where the ground filter set none apart.",
        unit="degree",
        gt=0.0,
        le=90.0,
    )
    max_later: float = parameter(
        TREE_SHARE,
        "Points with more later returns around them are trees; as before.",
        symbol="f_mr",
        ge=0.0,
        le=1.0,
    )
    smooth_angle: float = parameter(
        SMOOTH_ANGLE_DEG,
        "Largest angle between neighbours on one surface; as before.",
        unit="degree",
        gt=0.0,
        le=90.0,
    )
    flat_links: bool = parameter(
        True,
        "Neighbours of one surface also lie in each other's plane: a step of like normals parts them.",
        off=False,
        step="a step parts a small region",
    )
    noise_area: float = parameter(
        NOISE_AREA_M2, "Smaller smooth regions are noise; as before.", unit="m²", ge=0.0
    )
    join: float | None = parameter(
        None,
        "Points nearer than this are one component; default: 3 spacings, at least 0.8.",
        unit="m",
        gt=0.0,
    )
    min_area: float = parameter(
        GROUP_M2, "Smallest area of a building component.", unit="m²", off=0.0, step="area", ge=0.0
    )
    min_width: float = parameter(
        ROOM_M, "Components with a narrower side are hedges and walls.", unit="m", off=0.0, ge=0.0
    )
    min_width_to_height: float = parameter(
        0.3,
        "Components narrower than this share of their height are trees or poles.",
        off=0.0,
        step="width to height",
        ge=0.0,
    )
    min_density: float = parameter(
        0.3,
        "Least density, as a share of the scene's: echoes leave trees sparse.",
        off=0.0,
        step="mean density",
        ge=0.0,
        le=1.0,
    )
    curved: float = parameter(
        0.03,
        "A larger curvature is high: that of a ridge of two faces of 25°, seen from the ridge.",
        symbol="σ",
        gt=0.0,
        lt=1.0,
    )
    max_curved: float = parameter(
        0.5,
        "Components with a larger share of curved points are trees.",
        off=1.0,
        step="share of high curvature",
        ge=0.0,
        le=1.0,
    )
    wall_distance: float = parameter(
        0.5,
        "Walls and small regions this near to a roof in plan, a beam's width, are its.",
        unit="m",
        off=0.0,
        ge=0.0,
    )
    on_roof: float = parameter(
        1.0, "Small regions this near to the roof's height are on it.", unit="m", ge=0.0
    )

    @property
    def buffer(self) -> float:
        return 30.0

    def label(self, scene: Scene, emit: Emit = ignore) -> Regions:
        cloud = scene.cloud
        number = np.zeros(len(cloud), np.int32)
        part = np.where(cloud.noise, NOISE, self.separate(scene)).astype(np.uint8)
        off = np.flatnonzero(~cloud.ground & (scene.height >= self.min_height))
        part[cloud.ground | ((scene.height < self.min_height) & (part != WALL))] = 0
        emit("walls", cloud.xyz[part == WALL])
        emit("trees", cloud.xyz[part == TREE])
        rest = off[part[off] == 0]
        k = self.neighbours or neighbours_of_disc(scene.spacing)
        if len(rest) <= k:
            return Regions(number, np.zeros(0), part)
        xyz = cloud.xyz[rest] - [0.0, 0.0, np.floor(cloud.xyz[rest, 2].min())]
        again = local_planes(xyz, k, k)  # free of walls and trees
        join = self.join or max(0.8, 3.0 * scene.spacing)
        component = euclidean_components(xyz, again, join)
        emit("components", numbers_of_all(component, rest, len(cloud)))
        curvature = np.full(len(cloud), np.nan)
        curvature[rest] = again.curvature
        emit("curvature", curvature)
        label, score = self.judge(scene, rest, component, again.curvature)
        number[rest] = label
        part[rest[label > 0]] = ROOF
        self.claim(cloud.xyz, off, number, part)
        whole = np.flatnonzero(number)
        if self.wall_distance == 0.0 or len(whole) <= k:
            return Regions(number, score, part)
        xyz = cloud.xyz[whole] - [0.0, 0.0, np.floor(cloud.xyz[whole, 2].min())]
        linked = euclidean_components(xyz, local_planes(xyz, k, k), join)  # over what was claimed
        size, pairs = len(score) + len(whole), (number[whole] - 1, linked + len(score))
        links = coo_array((np.ones(len(whole), bool), pairs), shape=(size, size))
        building = connected_components(links, directed=False)[1][: len(score)]
        number[whole] = building[number[whole] - 1] + 1
        return Regions(number, np.bincount(building, weights=score) / np.bincount(building), part)

    def separate(self, scene: Scene) -> NDArray[np.uint8]:
        """WALL, TREE, NOISE or 0 (N,): what the ground filter of the paper found, else found here."""
        known = scene.cloud.part
        if known is not None and DOUBTFUL not in known:
            return known
        part = np.zeros(len(scene.cloud), np.uint8)
        some = np.flatnonzero(~scene.cloud.noise)
        cloud = scene.cloud.take(some)
        part[some] = find_walls_and_trees(cloud, NEIGHBOURS, self.wall_angle, self.max_later)
        left = np.flatnonzero(~scene.cloud.noise & (part == 0))
        if len(left) <= NEIGHBOURS:
            return part
        xyz = scene.cloud.xyz[left]
        planes = local_planes(xyz, NEIGHBOURS, NEIGHBOURS)
        region = grow_regions(xyz, planes, self.smooth_angle, self.flat_links)
        area = region_areas(xyz, region, 2.0 * planes.spacing)
        part[left[(area < self.noise_area)[region]]] = NOISE
        return part

    def judge(
        self, scene: Scene, index: NDArray[np.int64], component: Labels, curvature: Values
    ) -> tuple[Labels, Values]:
        """Labels (M,) of the points `index` (M,) of components that pass the tests, and their scores (K,)."""
        count = int(component.max()) + 1
        xyz, height = scene.cloud.xyz[index], scene.height[index]
        size = np.bincount(component, minlength=count)
        area = area_of_cells(xyz, component.astype(np.int64), count, scene.spacing)
        top = np.zeros(count)
        np.maximum.at(top, component, height)
        density = size * scene.spacing**2 / np.maximum(area, 1e-9)
        curved = np.bincount(component, weights=curvature > self.curved, minlength=count) / size
        narrow = narrow_sides(xyz, component, count)
        building = (
            (area >= self.min_area)
            & (narrow >= np.maximum(self.min_width, self.min_width_to_height * top))
            & (density >= self.min_density)
            & (curved <= self.max_curved)
        )
        new = np.zeros(count, np.int32)
        new[building] = np.arange(1, int(building.sum()) + 1)
        return new[component], 1.0 - curved[building]

    def claim(self, xyz: Points, off: NDArray[np.int64], number: Labels, part: NDArray[np.uint8]) -> None:
        """Give walls under a roof, and small regions and echoes on it, its label where it is near in plan."""
        roof = np.flatnonzero(number > 0)
        other = off[number[off] == 0]
        other = other[part[other] != 0]
        if not len(roof) or not len(other):
            return
        answer = cKDTree(xyz[roof, :2]).query(xyz[other, :2], distance_upper_bound=self.wall_distance)
        distance, nearest = np.asarray(answer[0]), np.asarray(answer[1])
        found = np.flatnonzero(np.isfinite(distance))
        owner, other = roof[nearest[found]], other[found]
        above = xyz[other, 2] - xyz[owner, 2]
        wall = (part[other] == WALL) & (above <= self.on_roof)
        on = np.isin(part[other], (NOISE, TREE)) & (np.abs(above) <= self.on_roof)
        number[other[wall | on]] = number[owner[wall | on]]
        part[other[on]] = ROOF


def narrow_sides(xyz: Points, component: Labels, count: int) -> Values:
    """Narrow side (m, (count,)) of the smallest rectangle around each component of points (N, 3)."""
    order = np.argsort(component, kind="stable")
    rings = shapely.minimum_rotated_rectangle(
        shapely.multipoints(shapely.points(xyz[order, :2]), indices=component[order])
    )
    sides = np.zeros(count)
    flat = np.flatnonzero(shapely.get_type_id(rings) == shapely.GeometryType.POLYGON)
    corners = shapely.get_coordinates(rings[flat]).reshape(-1, 5, 2)
    length = np.hypot(*np.moveaxis(np.diff(corners[:, :3], axis=1), -1, 0))
    sides[flat] = length.min(axis=1)
    return sides


def neighbours_of_disc(spacing: float) -> int:
    """The number of points in a disc of 0.75 m, 12 to 40."""
    return int(np.clip(round(np.pi * (0.75 / spacing) ** 2), 12, 40))


def numbers_of_all(number: Labels, index: NDArray[np.int64], count: int) -> Labels:
    """Numbers 1…K (count,) of all points, 0 for none, from those 0…K-1 (M,) of the points `index` (M,)."""
    every = np.zeros(count, np.int32)
    every[index] = number + 1
    return every
