"""Roof planes refined together: the labelling of all points that costs least."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from eaves.geometry.planes import LocalPlanes, local_planes
from eaves.methods import Emit, ignore, parameter
from eaves.model import Labels, Mask, Points, RoofPlane, Values
from eaves.roof.global_refinement.relabelling import near_regions, relabel_kernel, worth_kernel
from eaves.roof.region_growing import RegionGrowing
from eaves.roof.stage import RoofMethod
from eaves.roof.toolkit.regions import (
    fit_labels,
    grow_kernel,
    join_coplanar,
    roof_planes,
    touching_regions,
    without_gaps,
)
from eaves.roof.toolkit.scan_lines import on_lines, thin_lines, with_points_between


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
            kept = thin_lines(points, local, start.fewest_neighbours)
            if len(kept) < len(points):
                between = start.distance_share * local.noise
                return with_points_between(
                    self.planes(points[kept], spacing, rng, emit), points, kept, between
                )
        labels = start.grow(points, local, start.smooth_points(local))
        labels = start.join(points, labels, local)
        labels = start.give_back(points, labels, local)
        emit("grown", labels)
        tried = np.zeros(len(points), bool)
        for turn in range(self.rounds):
            before = labels
            if np.sum((labels == 0) & ~tried) >= self.fewest_points(local):
                tried = labels == 0
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
        left = np.flatnonzero(labels == 0)
        if len(left) < self.fewest_points(local):
            return labels
        near = local_planes(points[left], self.left_neighbours, 2 * self.left_neighbours)
        upright = near.normals[:, 2] >= np.cos(np.radians(self.start.max_slope))
        flat = near.eigenvalues[:, 0] <= (1.5 * local.noise) ** 2
        open_ = upright & (near.eigenvalues[:, 1] > 0.0)
        seeds = np.argsort(near.eigenvalues[:, 0], kind="stable")
        found = np.zeros(len(left), np.int32)
        grow_kernel(
            points[left],
            near.neighbours,
            near.counts,
            near.normals,
            open_,
            seeds[(flat & open_)[seeds]],
            float(np.cos(np.radians(40.0))),
            2.5 * local.noise,
            self.fewest_points(local),
            found,
        )
        grown = labels.copy()
        grown[left] = np.where(found > 0, found + labels.max(initial=0), 0)
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
        near = near_regions(labels, points, count, gap)
        wide = np.bincount(labels, minlength=count + 1)[1:] * local.spacing**2 >= (2.0 * gap) ** 2
        near &= wide[:, None] & wide[None, :]
        near |= touching_regions(labels, local.neighbours[:, :12], count)
        return join_coplanar(points, labels, near, self.start.join_tolerance(local.noise), 1.2)

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
    known = np.where(np.isnan(squares), 0.0, squares)
    return np.asarray(1.0 / np.minimum(np.maximum(known, noise**2), sag**2))


def apart(worth: Values, poor: Mask, touching: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The poor planes (K,) that go together: the least worth first, none that touches one that goes."""
    going = np.zeros(len(worth), bool)
    for number in np.argsort(worth, kind="stable")[: int(poor.sum())]:
        if not (touching[number] & going).any():
            going[number] = True
    return np.flatnonzero(going)
