"""Roof planes grown from the flattest points [xiao2014]."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np

from eaves.geometry.planes import CALM_QUANTILE, LocalPlanes, local_planes, measure_noise, planes_around
from eaves.methods import Emit, ignore, parameter
from eaves.model import Labels, Mask, Points, RoofPlane
from eaves.roof.stage import RoofMethod
from eaves.roof.toolkit.regions import (
    fit_labels,
    grow_kernel,
    join_coplanar,
    normal_error,
    return_kernel,
    roof_planes,
    seed_order,
    touching_regions,
    without_gaps,
)


class RegionGrowing(RoofMethod):
    """The planes of one roof, grown over smooth points.

    Ridges, valleys and edges have curved neighbourhoods, whose normals belong to no plane. They are set
    aside. From the flattest point left a plane grows over its neighbours, as long as their normals are
    like the plane's and they lie on it; then from the next flattest. The threshold on normals is tight,
    for planes are wanted and not merely smooth surfaces. At last each point set aside goes to the plane
    that is near in both distances: to the plane, and to its nearest point.

    Formula
    -------
    C = 1/k Σ (pᵢ − p̄)(pᵢ − p̄)ᵀ (eq. 1), the normal is the eigenvector of λ₀ ≤ λ₁ ≤ λ₂, and the curvature is
    σ = λ₀ / (λ₀ + λ₁ + λ₂) (eq. 3).

    Fidelity
    --------
    The paper prints no number. Here all follow the noise s (a low quantile of √(λ₀ k / (k − 3)) over
    the building) and the spacing a. k makes the error of a normal, 2 s √π / (a k), two degrees, within
    10 and 40. Curved is λ₀ > 2.5 s², by eq. 3 for a round neighbourhood. The normal threshold is
    four errors of a normal. Left open by the paper and added: the distance to the plane is tested while
    growing, which stops a plane from bending; a neighbourhood that is a line (scan lines) takes more
    points; touching regions that one plane explains are joined; walls, by their normals, and very small
    planes are left out.

    Fails where
    -----------
    Planes narrower than a neighbourhood (small dormers at low density) have no flat point and grow no plane.
    Curved roofs become strips.

    Complexity
    ----------
    O(N k) after one neighbour search, O(N log N).

    References
    ----------
    [xiao2014], section 3.
    """

    name: ClassVar[str] = "region_growing"
    idea: ClassVar[str] = (
        "Curved points set aside, planes grown from the flattest seeds, the points set aside returned."
    )
    paper: ClassVar[str] = "xiao2014"

    neighbours: int | None = parameter(
        None,
        "Neighbours of a point; derived from noise and spacing so that a normal is good to `normal_error`.",
        symbol="k",
        ge=4,
    )
    max_curvature: float | None = parameter(
        None,
        "Curvature above which a point is set aside; that of `curved_share` times the noise's variance.",
        symbol="σ",
        gt=0.0,
    )
    normal_threshold: float | None = parameter(
        None,
        "Angle between a point's normal and the plane's up to which it joins; four errors of a normal.",
        unit="degree",
        gt=0.0,
        lt=90.0,
    )
    distance_share: float = parameter(
        3.0, "Distance to a plane up to which a point belongs to it, in multiples of the noise.", gt=0.0
    )
    gap_share: float = parameter(
        2.5,
        "Distance to a plane's nearest point up to which a point is given to it, in spacings.",
        gt=0.0,
    )
    max_slope: float = parameter(78.0, "Slope above which a plane is a wall.", unit="degree", gt=0.0, lt=90.0)
    fewest_neighbours: int = parameter(
        10, "The fewest neighbours derived: a normal wants ten points.", unit="points", ge=4
    )
    most_neighbours: int = parameter(
        40,
        "The most neighbours derived: more reach across small roof faces at any density.",
        unit="points",
        ge=4,
    )
    normal_error: float = parameter(
        2.0, "Error of a local normal that the number of neighbours is chosen for.", unit="degree", gt=0.0
    )
    curved_share: float = parameter(
        2.5,
        "Times the noise's variance that makes a neighbourhood curved: the 98th percentile of χ²₇ / 7.",
        gt=0.0,
    )
    line_neighbours: int = parameter(
        10, "More neighbours a point may take where the nearest ones are one scan line.", unit="points", ge=0
    )
    sag: float = parameter(
        0.05,
        "Root mean square distance by which a roof built as one plane may have bent, or falls to its drains.",
        unit="m",
        off=0.0,
        ge=0.0,
    )
    join_coplanar: bool = parameter(True, "Touching regions that one plane explains become one.", off=False)
    noise_sample: int = parameter(
        300,
        "Points whose neighbourhoods tell the noise before the number of neighbours is chosen.",
        unit="points",
        ge=1,
    )
    calm_share: float = parameter(
        1.5,
        "The noise is at most this many times that of the calmest neighbourhoods of the fewest points: on "
        "many small faces most larger ones lie across an edge.",
        gt=0.0,
    )

    @property
    def buffer(self) -> float:
        """A building is seen whole: 0 m."""
        return 0.0

    def planes(
        self, points: Points, spacing: float, rng: np.random.Generator, emit: Emit = ignore
    ) -> list[RoofPlane]:
        """The planes of points (N, 3), largest first."""
        if len(points) < 3:
            return []
        local = self.surroundings(points)
        smooth = self.smooth_points(local)
        emit("normals", local.normals)
        emit("curvature", local.curvature)
        labels = self.grow(points, local, smooth)
        emit("grown", labels)
        labels = self.join(points, labels, local)
        labels = self.give_back(points, labels, local)
        labels = self.join(points, labels, local)
        emit("labels", labels)
        return roof_planes(
            labels, points, self.fewest_points(local), float(np.cos(np.radians(self.max_slope)))
        )

    def surroundings(self, points: Points) -> LocalPlanes:
        """The local planes of points (N, 3), with the number of neighbours that noise and spacing ask for."""
        step, few = max(1, len(points) // self.noise_sample), self.fewest_neighbours + self.line_neighbours
        around = planes_around(np.ascontiguousarray(points[::step]), points, self.fewest_neighbours, few)
        calm = measure_noise(around.eigenvalues[:, 0], around.counts, CALM_QUANTILE)
        noise = min(around.noise, self.calm_share * calm)
        count = self.neighbours
        if count is None:
            wished = 2.0 * np.sqrt(np.pi) * noise / (around.spacing * np.radians(self.normal_error))
            count = int(np.clip(np.ceil(wished), self.fewest_neighbours, self.most_neighbours))
        local = local_planes(points, count, count + self.line_neighbours)
        return replace(local, noise=min(local.noise, self.calm_share * calm))

    def smooth_points(self, local: LocalPlanes) -> Mask:
        """The points (N,) whose neighbourhood is flat and no wall."""
        if self.max_curvature is not None:
            flat = local.curvature <= self.max_curvature
        else:
            flat = local.eigenvalues[:, 0] <= self.curved_share * local.noise**2
        upright = local.normals[:, 2] >= np.cos(np.radians(self.max_slope))
        wide = local.eigenvalues[:, 1] > 0.0
        return np.asarray(flat & upright & wide)

    def grow(self, points: Points, local: LocalPlanes, smooth: Mask) -> Labels:
        """Labels (N,) of the regions grown over the smooth points, 0 elsewhere."""
        labels = np.zeros(len(points), np.int32)
        derived = np.clip(4.0 * normal_error(local), 0.08, 0.3)
        angle = np.radians(self.normal_threshold) if self.normal_threshold else derived
        grow_kernel(
            points,
            local.neighbours,
            local.counts,
            local.normals,
            smooth,
            seed_order(local.curvature, smooth),
            float(np.cos(angle)),
            self.distance_share * local.noise,
            self.fewest_points(local),
            labels,
        )
        return labels

    def join(self, points: Points, labels: Labels, local: LocalPlanes) -> Labels:
        """Labels (N,), 1…J without gaps, with touching coplanar regions made one, where they are joined."""
        labels = without_gaps(labels)
        if not self.join_coplanar:
            return labels
        touching = touching_regions(labels, local.neighbours[:, :12], int(labels.max(initial=0)))
        return join_coplanar(points, labels, touching, self.join_tolerance(local.noise), 1.2)

    def give_back(self, points: Points, labels: Labels, local: LocalPlanes) -> Labels:
        """Labels (N,) after the points set aside went to the planes near in both distances."""
        labels = labels.copy()
        while len(labels):
            planes, _, _ = fit_labels(points, labels, int(labels.max(initial=0)))
            tolerance, gap = self.distance_share * local.noise, self.gap_share * local.spacing
            if not return_kernel(points, local.neighbours, planes, tolerance, gap, labels):
                break
        return labels

    def join_tolerance(self, noise: float) -> float:
        """Root mean square distance (m) from one plane up to which regions are pieces of it."""
        return float(np.hypot(1.2 * noise, self.sag))
