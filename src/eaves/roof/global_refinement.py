"""Roof planes refined together: the labelling of all points that costs least."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from eaves.geometry.neighbours import measure_spacing
from eaves.geometry.planes import LocalPlanes, local_planes
from eaves.kernels import kernel
from eaves.methods import Emit, ignore, parameter
from eaves.model import Labels, Mask, Points, RoofPlane, Values
from eaves.roof.region_growing import RegionGrowing
from eaves.roof.stage import RoofMethod
from eaves.roof.toolkit.regions import (
    fit_labels,
    grow_kernel,
    join_coplanar,
    roof_planes,
    touching_kernel,
    touching_regions,
    without_gaps,
)


class GlobalRefinement(RoofMethod):
    """The planes of one roof, refined together.

    Region growing finds planes one after the other, and the first takes what the next would need. Here
    all points choose together. Points that no plane took, or that are too narrow for a flat
    neighbourhood, are looked at alone: neighbourhoods among themselves show dormers, parapets and hip
    ends, and grow further planes. Then each point in turn takes the label that is cheapest for it,
    planes are fitted again, and near coplanar regions become one, also over a gap such as a chimney or
    a dormer leaves. A plane that saves less than its price goes, and its points go to the planes around
    it or to none. Until nothing changes.

    Formula
    -------
    The labelling f minimises Σₚ D(p, fₚ) + λ Σₚ share of neighbours q with f_q ≠ fₚ + price · planes,
    where D is d² / 2v for the distance d from the plane, and T² / 2 for a point left out, T = 3.5. The
    variance v is that of the noise, or the plane's own where it sags.

    Fidelity
    --------
    The energy is that of [isack2012], the parts of PEARL (propose, expand, refit) too. They expand by
    graph cuts; here every point moves alone (iterated conditional modes) among the labels of its
    neighbours: grown planes are a near start, and no plane claims points far away. Cuts lower the
    energy by 1 to 3 per cent, are no better on labelled roofs, and take several times as long. The
    price counts in points left out, so that it means the same area at every density.

    Fails where
    -----------
    Curved roofs become strips. Steps lower than about 1.2 times the noise, or 5 cm, are not seen. A row
    of like dormers less than the gap apart may become one plane.

    Complexity
    ----------
    O(N k) a round, 2 to 6 rounds, after the neighbour search, O(N log N).

    References
    ----------
    [isack2012]; [xiao2014] for the start.
    """

    name: ClassVar[str] = "global_refinement"
    idea: ClassVar[str] = (
        "Grown planes and planes in what they leave, relabelled together: fit, smoothness, a price."
    )
    paper: ClassVar[str] = "isack2012"

    start: RegionGrowing = parameter(RegionGrowing(), "Method that grows the first planes.", unit="method")
    outlier_share: float = parameter(
        3.5,
        "Distance from every plane, in multiples of the noise, at which a point is better left out.",
        gt=0.0,
    )
    smoothness: float = parameter(4.0, "Cost of a point whose neighbours all have another label.", ge=0.0)
    price: float = parameter(
        0.6,
        "Price of a plane, as the share of the smallest plane's points that are left out instead.",
        ge=0.0,
    )
    rounds: int = parameter(6, "Maximum number of rounds of proposing, relabelling and pricing.", ge=1)
    left_neighbours: int = parameter(
        6,
        "Neighbours among the points left over: the fewest that tell a plane from chance.",
        unit="points",
        ge=4,
    )
    ring: int = parameter(
        9,
        "Points whose labels a point looks at, itself included: the ring around it.",
        unit="points",
        ge=2,
    )

    def planes(
        self, points: Points, spacing: float, rng: np.random.Generator, emit: Emit = ignore
    ) -> list[RoofPlane]:
        """The planes of points (N, 3), largest first."""
        if len(points) < 3:
            return []
        start = self.start
        local = start.surroundings(points)
        if on_lines(points, local.neighbours[:, 1], spacing):
            thinned = thin_lines(points, local, start.fewest_neighbours)
            if len(thinned) < len(points):
                between = start.distance_share * local.noise
                return with_points_between(
                    self.planes(points[thinned], spacing, rng, emit), points, thinned, between
                )
        labels = start.grow(points, local, start.smooth_points(local))
        labels = start.join(points, labels, local)
        labels = start.give_back(points, labels, local)
        emit("grown", labels)
        proposed = np.zeros(len(points), bool)
        for turn in range(self.rounds):
            before = labels
            if np.sum((labels == 0) & ~proposed) >= self.fewest_points(local):
                proposed = labels == 0
                labels = self.propose(points, labels, local)
            labels = self.relabel(points, labels, local)
            labels = self.join(points, labels, local)
            labels = self.pay(points, labels, local)
            emit(f"round {turn}", labels)
            if np.array_equal(labels, before):
                break
        least_normal_z = float(np.cos(np.radians(start.max_slope)))
        return roof_planes(labels, points, self.fewest_points(local), least_normal_z)

    def propose(self, points: Points, labels: Labels, local: LocalPlanes) -> Labels:
        """Labels (N,) with new ones grown over the points that have none."""
        loose = np.flatnonzero(labels == 0)
        if len(loose) < self.fewest_points(local):
            return labels
        neighbourhoods = local_planes(points[loose], self.left_neighbours, 2 * self.left_neighbours)
        upright = neighbourhoods.normals[:, 2] >= np.cos(np.radians(self.start.max_slope))
        flat = neighbourhoods.eigenvalues[:, 0] <= (1.5 * local.noise) ** 2
        open_ = upright & (neighbourhoods.eigenvalues[:, 1] > 0.0)
        seeds = np.argsort(neighbourhoods.eigenvalues[:, 0], kind="stable")
        regions = np.zeros(len(loose), np.int32)
        grow_kernel(
            points[loose],
            neighbourhoods.neighbours,
            neighbourhoods.counts,
            neighbourhoods.normals,
            open_,
            seeds[(flat & open_)[seeds]],
            float(np.cos(np.radians(40.0))),
            2.5 * local.noise,
            self.fewest_points(local),
            regions,
        )
        grown = labels.copy()
        grown[loose] = np.where(regions > 0, regions + labels.max(initial=0), 0)
        return grown

    def relabel(self, points: Points, labels: Labels, local: LocalPlanes) -> Labels:
        """Labels (N,) after each point in turn took the cheapest label around it, planes fitted between."""
        labels = labels.copy()
        ring = np.ascontiguousarray(local.neighbours[:, : self.ring])
        for _ in range(3):
            planes, squares, _ = fit_labels(points, labels, int(labels.max(initial=0)))
            planes[np.isnan(planes).any(axis=1)] = (0.0, 0.0, 0.0, 1e9)
            weights = weights_of(squares, local.noise, self.start.join_tolerance(local.noise))
            changed = relabel_kernel(
                points, ring, planes, weights, 0.5 * self.outlier_share**2, self.smoothness, 4, labels
            )
            if not changed:
                break
        return labels

    def join(self, points: Points, labels: Labels, local: LocalPlanes) -> Labels:
        """Labels (N,) with coplanar regions made one, wide ones over gaps of three spacings."""
        labels = without_gaps(labels)
        count = int(labels.max(initial=0))
        gap = 3.0 * local.spacing
        adjacent = near_regions(labels, points, count, gap)
        wide = np.bincount(labels, minlength=count + 1)[1:] * local.spacing**2 >= (2.0 * gap) ** 2
        adjacent &= wide[:, None] & wide[None, :]
        adjacent |= touching_regions(labels, local.neighbours[:, :12], count)
        return join_coplanar(points, labels, adjacent, self.start.join_tolerance(local.noise), 1.2)

    def pay(self, points: Points, labels: Labels, local: LocalPlanes) -> Labels:
        """Labels (N,) without the planes that save less than their price, the worst first."""
        fewest = self.fewest_points(local)
        outlier = 0.5 * self.outlier_share**2
        ring = np.ascontiguousarray(local.neighbours[:, : self.ring])
        while True:
            count = int(labels.max(initial=0))
            planes, squares, sizes = fit_labels(points, labels, count)
            planes[sizes < 3] = (0.0, 0.0, 0.0, 1e9)
            weights, worth = (
                weights_of(squares, local.noise, self.start.join_tolerance(local.noise)),
                np.zeros(count),
            )
            worth_kernel(points, ring, planes, weights, outlier, self.smoothness, labels, worth)
            worth[sizes == 0] = np.inf
            dropped = apart(
                worth, worth < self.price * fewest * outlier, touching_regions(labels, ring, count)
            )
            if len(dropped) == 0:
                return labels
            labels = np.where(np.isin(labels, dropped + 1), 0, labels).astype(np.int32)
            relabel_kernel(points, ring, planes, weights, outlier, self.smoothness, 4, labels)


def weights_of(squares: Values, noise: float, sag: float) -> Values:
    """Weights (K,), one over the variance of the points of each plane, from their mean squares (K,).

    The variance is that of the noise, or more where the plane sags, up to the distance `sag` (m) that makes
    pieces one plane: else the points of a plane joined from pieces would be left out again.
    """
    variance = np.where(np.isnan(squares), 0.0, squares)
    return np.asarray(1.0 / np.minimum(np.maximum(variance, noise**2), sag**2))


def apart(worth: Values, poor: Mask, touching: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The poor planes (K,) that go together: the least worth first, none that touches one that goes."""
    going = np.zeros(len(worth), bool)
    for number in np.argsort(worth, kind="stable")[: int(poor.sum())]:
        if not (touching[number] & going).any():
            going[number] = True
    return np.flatnonzero(going)


@kernel
def relabel_kernel(
    xyz: NDArray[np.float64],
    neighbours: NDArray[np.int64],
    planes: NDArray[np.float64],
    weights: NDArray[np.float64],
    outlier: float,
    smoothness: float,
    sweeps: int,
    labels: NDArray[np.int32],
) -> int:
    """Number of points that changed their label (N,) while each in turn took the cheapest one around it.

    A label costs half the squared distance from its plane (K, 4) times its weight (K,), or `outlier`
    for none (0), and `smoothness` times the share of the `neighbours` (N, M) that have another label.
    """
    changed = 0
    width = neighbours.shape[1]
    # The choice of a point hangs on the labels around it alone: it is made again when one of them changed.
    last_change = np.full(len(xyz), -1)
    for sweep in range(sweeps):
        moved = 0
        for i in range(len(xyz)):
            before = (sweep - 1) * len(xyz) + i
            first = labels[neighbours[i, 0]]
            alike, fresh = True, sweep > 0
            for column in range(width):
                j = neighbours[i, column]
                alike &= labels[j] == first
                fresh &= last_change[j] < before
            if fresh:
                continue
            best, winner = np.inf, labels[i]
            for column in range(width + 1):
                if column > 0 and alike and (column < width or best <= outlier):
                    continue
                label = labels[neighbours[i, column]] if column < width else 0
                repeated = False
                for earlier in range(column if label != 0 else 0):
                    if labels[neighbours[i, earlier]] == label:
                        repeated = True
                        break
                if repeated:
                    continue
                if label == 0:
                    cost = outlier
                else:
                    plane = planes[label - 1]
                    away = plane[0] * xyz[i, 0] + plane[1] * xyz[i, 1] + plane[2] * xyz[i, 2] - plane[3]
                    cost = 0.5 * away * away * weights[label - 1]
                unlike = 0
                for place in range(1, width):
                    if labels[neighbours[i, place]] != label:
                        unlike += 1
                cost += smoothness * unlike / max(width - 1, 1)
                if cost < best - 1e-12:
                    best, winner = cost, label
            if winner != labels[i]:
                labels[i] = winner
                last_change[i] = sweep * len(xyz) + i
                moved += 1
        changed += moved
        if moved == 0:
            break
    return changed


@kernel
def worth_kernel(
    xyz: NDArray[np.float64],
    neighbours: NDArray[np.int64],
    planes: NDArray[np.float64],
    weights: NDArray[np.float64],
    outlier: float,
    smoothness: float,
    labels: NDArray[np.int32],
    worth: NDArray[np.float64],
) -> None:
    """The saving by every plane (K,): the cost of its points without it, less the cost with it.

    Without it a point goes to the cheapest of the planes that touch it, or becomes an outlier; with it, it
    pays for neighbours of other labels. So a plane that passes through a crown by chance saves little.
    """
    count = len(planes)
    touching = touching_kernel(neighbours, labels, count)
    beside = np.empty((count + 1, count), np.int64)
    sizes = np.zeros(count + 1, np.int64)
    for number in range(1, count + 1):
        for label in range(1, count + 1):
            if label == number or touching[number, label]:
                beside[number, sizes[number]] = label
                sizes[number] += 1
    for i in range(len(xyz)):
        number = labels[i]
        if number == 0:
            continue
        cheapest, inner = outlier, 0.0
        for label in beside[number, : sizes[number]]:
            plane = planes[label - 1]
            away = plane[0] * xyz[i, 0] + plane[1] * xyz[i, 1] + plane[2] * xyz[i, 2] - plane[3]
            cost = 0.5 * away * away * weights[label - 1]
            if label == number:
                inner = cost
            elif cost < cheapest:
                cheapest = cost
        unlike = 0
        for column in range(1, neighbours.shape[1]):
            if labels[neighbours[i, column]] != number:
                unlike += 1
        inner += smoothness * unlike / max(neighbours.shape[1] - 1, 1)
        worth[number - 1] += cheapest - inner


def near_regions(labels: Labels, xyz: Points, count: int, gap: float) -> NDArray[np.bool_]:
    """Mask (K, K) of the pairs of regions that come about as near as `gap` (m) in plan: cells that wide
    touch."""
    labelled = labels > 0
    place = np.floor(xyz[labelled, :2] / gap).astype(np.int64)
    place -= place.min(axis=0, initial=0) - 1
    wide = int(place.max(initial=0)) + 2
    number = np.unique((place[:, 0] * wide + place[:, 1]) * count + labels[labelled] - 1)
    adjacent: NDArray[np.bool_] = beside_kernel(number, wide, count)
    return adjacent


@kernel
def beside_kernel(number: NDArray[np.int64], wide: int, count: int) -> NDArray[np.bool_]:
    """Mask (K, K) of the pairs of `count` labels that lie in one cell or in cells that touch. Each `number`
    (M,), ascending, is that of a cell, `wide` to a column, times `count`, and a label in it."""
    adjacent = np.zeros((count, count), np.bool_)
    for code in number:
        cell, label = code // count, code % count
        for step in (0, 1, wide - 1, wide, wide + 1):
            for place in range(np.searchsorted(number, (cell + step) * count), len(number)):
                if number[place] // count != cell + step:
                    break
                neighbour = number[place] % count
                if neighbour != label:
                    adjacent[label, neighbour] = adjacent[neighbour, label] = True
    return adjacent


MOST_NEIGHBOURS = 20
"""Neighbours of a point that its normal comes from, at most: where lines are this many times as far apart as
the points along them, all neighbours lie on one line."""

COARSER = 1.5
"""Times as wide as before are the cells of the next thinning."""

NEAREST = 4
"""Kept points whose planes a point between them may belong to."""


def on_lines(points: Points, nearest: NDArray[np.int64], spacing: float) -> bool:
    """True if most points (N, 3) lie so near their `nearest` (N,), for their `spacing` (m) in plan, that
    neighbours are of one scan line: lines L times as far apart as points along them put these 1 / √L of the
    spacing apart. Points at random are half a spacing apart.
    """
    along = float(np.median(np.linalg.norm(points[nearest, :2] - points[:, :2], axis=1)))
    widest = along * MOST_NEIGHBOURS**0.5
    return bool(widest < spacing and widest < measure_spacing(points))


def thin_lines(points: Points, local: LocalPlanes, fewest: int) -> NDArray[np.int64]:
    """Numbers (K,), ascending, of the points (N, 3) that stay when each cell in plan keeps one, in cells just
    wide enough that most points see others beside their line; all where fewer than `fewest` would stay.
    """
    side = 2.0 * local.spacing
    while True:
        cells = np.floor(points[:, :2] / side).astype(np.int64)
        thinned = np.sort(np.unique(cells, axis=0, return_index=True)[1])
        if len(thinned) < fewest:
            return np.arange(len(points))
        nearest = cKDTree(points[thinned, :2]).query(points[thinned, :2], k=[2])[1][:, 0]
        if not on_lines(points[thinned], nearest, np.inf):
            return thinned
        side *= COARSER


def with_points_between(
    planes: list[RoofPlane], points: Points, thinned: NDArray[np.int64], tolerance: float
) -> list[RoofPlane]:
    """The planes of the `thinned` (K,) of points (N, 3) with the points between: each goes to the nearest of
    the planes of thinned points around it, where it lies within the `tolerance` (m) of that.
    """
    if not planes:
        return []
    label = np.full(len(thinned), -1)
    for number, plane in enumerate(planes):
        label[plane.members] = number
    coefficients = np.array([plane.coefficients for plane in planes])
    normal = np.column_stack([-coefficients[:, :2], np.ones(len(planes))])
    between = np.setdiff1d(np.arange(len(points)), thinned)
    nearest = cKDTree(points[thinned, :2]).query(
        points[between, :2], k=[*range(1, min(NEAREST, len(thinned)) + 1)]
    )[1]
    of = label[nearest]
    over = np.einsum("nki,ni->nk", normal[of], points[between]) - coefficients[of, 2]
    away = np.where(of >= 0, np.abs(over) / np.linalg.norm(normal[of], axis=2), np.inf)
    best = np.argmin(away, axis=1)
    rows = np.arange(len(between))
    assigned = np.where(away[rows, best] <= tolerance, of[rows, best], -1)
    members = [
        np.sort(np.concatenate([thinned[plane.members], between[assigned == number]]))
        for number, plane in enumerate(planes)
    ]
    return [replace(plane, members=numbers) for plane, numbers in zip(planes, members, strict=True)]
