"""Adaptive TIN (Axelsson 2000): the default ground filter."""

from __future__ import annotations

from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from eaves.geometry.neighbours import measure_spacing
from eaves.geometry.planes import median
from eaves.geometry.tin import Tin
from eaves.ground.adaptive_tin.densification import (
    Limits,
    Waiting,
    densify,
    insert_residuals,
    near_surface,
    update_residuals,
)
from eaves.ground.stage import GroundMethod, numbers_within
from eaves.ground.toolkit.floor import Floor, edges_without_step
from eaves.ground.toolkit.seeds import Opening, lowest_of_cells, lowest_surface, seeds_by_opening
from eaves.ground.toolkit.wide_objects import Patch, find_wide_objects
from eaves.methods import Emit, ignore, parameter
from eaves.model import GRID_STEP, Bounds, Mask, PointCloud, Points
from eaves.model.cloud import snap
from eaves.model.scene import DOUBTFUL
from eaves.raster.blur import height_kept
from eaves.raster.grid import EMPTY

SMOOTHED_WEIGHT = 1.0
"""`level_weight` where walls were smoothed: sharpened again, a low one uphill is level. Chosen on drawn
clouds of images (`benchmarks.accuracy.image_towns`, the first seeds)."""


def rim_points(sure: Points, bounds: Bounds, rules: AdaptiveTin) -> Points:
    """Points (K, 3) around `bounds`, at the heights that the sure ground points (N, 3) predict.

    Without them the hull of a TIN runs through roofs and crowns that the rim of the data cuts. Its facets
    there are slivers as steep as walls, and points climb them. Each height is that of a plane through the
    nearest ground points, fitted with a little stiffness (a metre), for their place may not tell a slope; it
    goes on for twice `rim_apart`, and level from there.
    """
    if len(sure) == 0:
        return np.zeros((0, 3))
    xy = rim_ring(bounds.buffered(rules.rim_apart / 2), rules.rim_apart)
    number = min(rules.rim_nearest, len(sure))
    distance, nearest = map(
        np.asarray,
        cKDTree(sure[:, :2], compact_nodes=False, balanced_tree=False).query(xy, k=np.arange(1, number + 1)),
    )
    around = sure[nearest]
    middle = around.mean(axis=1)
    offset = around - middle[:, None]
    spread = np.einsum("ijk,ijl->ikl", offset[..., :2], offset[..., :2])
    spread += number * np.eye(2)
    rise = np.einsum("ijk,ij->ik", offset[..., :2], offset[..., 2])
    slope = np.linalg.solve(spread, rise[..., None])[..., 0]
    step = xy - around[:, 0, :2]
    step *= np.minimum(1.0, 2 * rules.rim_apart / np.maximum(distance[:, :1], GRID_STEP))
    height = middle[:, 2] + ((around[:, 0, :2] + step - middle[:, :2]) * slope).sum(axis=1)
    return np.asarray(np.c_[xy, np.round(height / GRID_STEP) * GRID_STEP])


def rim_ring(bounds: Bounds, apart: float) -> Points:
    """Points (K, 2) along the rim of `bounds`, corners among them, at most `apart` (m) apart."""
    columns = np.linspace(bounds.west, bounds.east, 1 + int(np.ceil((bounds.east - bounds.west) / apart)))
    rows = np.linspace(bounds.south, bounds.north, 1 + int(np.ceil((bounds.north - bounds.south) / apart)))
    south, north = (np.c_[columns, np.full(len(columns), y)] for y in (bounds.south, bounds.north))
    west, east = (np.c_[np.full(len(rows) - 2, x), rows[1:-1]] for x in (bounds.west, bounds.east))
    return np.asarray(np.round(np.concatenate([south, north, west, east]) / GRID_STEP) * GRID_STEP)


class AdaptiveTin(Opening, GroundMethod):
    """Ground by progressive densification of a TIN.

    The mask (N,) of the ground points.

    A sparse TIN is made of points that are certainly ground. A point joins when it lies close to the facet
    beneath it and is seen at a small angle from the facet's vertices. Where the facet is steep there may be a
    break line: the point is then mirrored at the nearest vertex and compared with the facet across, extended.
    All candidates are judged on the same surface, those that fit are inserted, and so on until none joins.
    How far a point may be off follows the statistics of the surface: its roughness, and the spacing.

    Formula
    -------
    ::

        d ≤ d_max   and   α_k = arcsin(d / |p − v_k|) ≤ α_max,  k = 1, 2, 3
        d_max = 0.85 spacing,   α_max = 12° + 6° · spacing / m
        p' = 2 v − p,   |z − (2 z_v − facet(p'))| ≤ min(d_max, tan α_max · |p − v|)
        ground:  |z − facet(p)| ≤ t + s · spacing / 2,   t = min(max(7 ρ, 0.1 m), 0.4 m)

    with d the distance to the facet, s its slope, v its vertex nearest to p, and ρ the median distance of
    the seeds from a TIN of the lowest of them in cells twice as wide.

    Fidelity
    --------
    Followed [axelsson2000]: low outliers first (`find_outliers`), seeds, distance and angles, mirroring,
    rounds until nothing joins, limits from the statistics of the surface. The paper prints no number, so
    `as_published()` is the default. With `seed_cell` the seeds are the lowest points of such cells, as in its
    words; `AdaptiveTin(seed_cell=40, distance_share=2.8, angle=14, angle_share=0, rounds=1000)` is
    the plainest reading of them, and is measured in benchmarks/results as "plain". The
    lowest point of a wide cell misses every hilltop and terrace, so by default we leave it in this:

    - Large raised surfaces (halls, bridges) are removed first. They are found in the lowest heights of cells
      of 1.5 m (3 or 6 m in thinner data) that are fixed to the world. Squares of two by two cells without a
      step join to surfaces, so that what joins two of them is a way at least two cells wide. An object steps
      down on its rim; terrain is what others stand on, and what terrain leads to. So a surface stands over
      the terrain when the length of its rim that steps down by a `wall` is more than `up_weight` of what goes
      up or to crowns and machines, `void_weight` of that beyond which nothing was measured, and
      `level_weight` of what meets wide terrain level; the widest surface is terrain, and what it reaches
      follows until nothing changes. Points over the terrain beneath a raised surface, drawn from around it,
      are never ground; the steps below see them as objects. Not with `seed_cell`.
    - The default seeds are all lowest points that survive an opening with a growing window [zhang2003,
      pingel2013], up to `window`. The opening is done twice, so that a roof between roofs is found.
    - A piece that the opening took is weighed in the same way: it is terrain again where `level_weight` of
      the rim that meets the ground level is more than what steps down, and `window`. Roofs step down on
      all sides, spurs and high fields do not.
    - The larger the spacing, the larger the angle: the terrain bends more within a wide facet.
    - Where the spacing is more than `cell_least` a cell holds one point, and where the borders of the cells
      fall decides what is an object. So the ground is found in `looks` sets of cells, shifted against each
      other by parts of a cell, and a point is what most of them make of it.
    - A seed or point within a seventh of t of a facet is not inserted: the TIN stays small.
    - Points around the data, at heights that the seeds nearest to them predict, keep the hull of the TIN
      away from roofs and crowns that the rim of the data cuts: its slivers are as steep as walls. Not with
      `seed_cell`: the paper has none.

    The reach of a window of `window` is its width, and a chain of joining points adds little: half as much.
    The TIN of a block of a run ends half a window beyond it, as at the edge of data, which changes one point
    in ten thousand.
    Roughness and spacing are measured over the whole cloud that is given, which in a run is a square of
    240 m fixed to the world, whatever the blocks are, + reach. What is wide is looked for
    within `wide_around`, 600 m, in squares of 480 m that are fixed to the world: a point farther than 1,080 m
    has no say.

    Fails where
    -----------
    Water is taken for ground, and much of a bridge that goes on at the level of its road. A building wider
    than `window` in both directions stays where a ramp or a slope two cells wide leads up to it, as to a
    parking deck or to the stands of a stadium on its embankment, where the rim of the data cuts through more
    than half of its walls, or where it is wider than `wide_around`; so does a roof dug into a slope, flush
    with the ground uphill. A wide low roof
    enclosed by higher wings is taken for their court. A terrace that the rim of the data cuts goes where
    nothing stands on it and more than three sevenths of its rim step down, or where it is narrower than
    `window`. A plateau of rock with vertical walls all round goes. A hill narrower than the window goes when
    it is steep on all sides. A kerb of three decimetres on dense data is cut off, a step of two decimetres is
    kept. Dense low plants that no pulse passes are ground. Heaps and rocks in thin data lose their tops.

    Complexity
    ----------
    O(N + C log C) with C cells of `cell_least` or one spacing: about 0.4 CPU seconds per million points at 15
    points/m², 2 for each of the `looks` at 1 point/m², where every point has a cell of its own. What is wide
    costs 0.1 s per million cells of 1.5 m, and 0.02 s per million points.

    References
    ----------
    [axelsson2000], [zhang2003], [pingel2013]
    """

    name: ClassVar[str] = "adaptive_tin"
    idea: ClassVar[str] = "A TIN of sure ground points takes in the points that fit it, until none joins."
    paper: ClassVar[str] = "axelsson2000"

    rim_nearest: int = parameter(
        32, "Number of nearest sure ground points that define the plane of each.", ge=1
    )
    seed_cell: float | None = parameter(
        None,
        "Seeds are the lowest points of cells this wide; None takes those that survive the opening.",
        unit="m",
        gt=0,
    )
    wide_around: float = parameter(
        600.0,
        "Distance around a square within which large objects are judged: a hall of 500 m with its "
        "surroundings.",
        unit="m",
        gt=0,
    )
    cell_least: float = parameter(
        0.7, "Side of the cells of the lowest points; one spacing where that is more.", unit="m", gt=0
    )
    fine_cell: float = parameter(
        0.5,
        "Side of the cells whose lowest points are candidates; half a spacing where that is more.",
        unit="m",
        gt=0,
    )
    distance_share: float = parameter(0.85, "Largest distance to the facet, in spacings.", symbol="d", gt=0)
    angle: float = parameter(12.0, "Largest angle to the facet.", unit="degree", symbol="α", gt=0, le=90)
    angle_share: float = parameter(
        6.0,
        "Added per metre of spacing: wide facets bend more.",
        unit="degree",
        ge=0,
    )
    steep: float = parameter(
        0.6, "A facet as steep may hide a break line; a flatter one is extended across it.", ge=0
    )
    looks: int = parameter(
        5,
        "Sets of cells that are tried where the spacing is more than `cell_least`; most of them decide.",
        ge=1,
    )
    rounds: int = parameter(8, "Maximum number of rounds of densification.", ge=0)

    @property
    def rim_apart(self) -> float:
        """Distance (m) between points that predict the terrain; the first stand half as far outside the
        data."""
        return self.window / 2.0

    @property
    def buffer(self) -> float:
        return self.window + self.rim_apart

    def for_scan(self, blur: float, roughness: float) -> Self:
        if blur == 0.0:
            return self
        rise = self.object_slope * height_kept(blur)
        return self.unless_set(level_weight=SMOOTHED_WEIGHT, object_slope=rise, angle_share=0.0)

    @property
    def wide_buffer(self) -> float:
        return self.wide_around if self.seed_cell is None else 0.0

    def find_wide_objects(self, floor: Floor) -> Patch | None:
        return find_wide_objects(floor, self) if self.seed_cell is None else None

    def ground_mask(self, cloud: PointCloud, emit: Emit = ignore) -> Mask:
        return self.separate(cloud, np.zeros(len(cloud), bool), emit)[0]

    def separate(
        self, cloud: PointCloud, over: Mask, emit: Emit = ignore, core: Bounds | None = None
    ) -> tuple[Mask, NDArray[np.uint8] | None]:
        if len(cloud) < 3:
            return np.ones(len(cloud), bool), None
        spacing = measure_spacing(cloud.xyz)
        within = cloud.bounds if core is None else core
        inner = numbers_within(within.buffered(self.rim_apart), cloud.xyz)
        if len(inner) == 0:
            return np.zeros(len(cloud), bool), None
        looks = self.looks if spacing > self.cell_least and self.seed_cell is None else 1
        own, votes = cloud.xyz.take(inner, axis=0), np.zeros(len(inner), np.int64)
        for k in range(looks):
            shift = spacing * np.array([k / looks, (2 * k % looks) / looks, 0.0])
            xyz = snap(cloud.xyz + shift) if k else cloud.xyz
            near = xyz.take(inner, axis=0) if k else own
            votes += self.ground_mask_in_cells(xyz, near, inner, spacing, over, ignore if k else emit)
        mask = 2 * votes > looks
        doubtful = (votes > 0) & (votes < looks)
        if looks == 1:
            cell = max(2 * self.fine_cell, spacing)
            doubtful = edges_without_step(own, mask, cell, self.tolerance_most)
        ground, unsure = np.zeros(len(cloud), bool), np.zeros(len(cloud), np.uint8)
        ground[inner], unsure[inner] = mask, np.where(doubtful, np.uint8(DOUBTFUL), np.uint8(0))
        return ground, unsure

    def ground_mask_in_cells(
        self,
        around: Points,
        xyz: Points,
        inner: NDArray[np.int64],
        spacing: float,
        over: Mask,
        emit: Emit = ignore,
    ) -> Mask:
        """The mask (K,) of points (K, 3) that the cells give as they lie about the local origin.

        Objects are looked for among all those `around`, too (N, 3), of which they are the `inner` (K,).
        """
        cell = max(self.cell_least, spacing)
        if self.seed_cell is not None:
            seeds = lowest_of_cells(around, self.seed_cell)
        else:
            seeds = seeds_by_opening(lowest_surface(around, Bounds.of(around), cell, over), self)
        place = np.full(len(around), EMPTY)
        place[inner] = np.arange(len(inner))
        over, seeds = over.take(inner), place.take(seeds)
        seeds, waiting = seeds[seeds != EMPTY], ~over
        emit("seeds", xyz.take(seeds, axis=0))
        if len(seeds) == 0:
            return np.zeros(len(inner), bool)
        bounds = Bounds.of(xyz)
        candidates = lowest_of_cells(xyz, max(self.fine_cell, 0.5 * spacing), bounds)
        first = seeds[lowest_of_cells(xyz.take(seeds, axis=0), 2 * cell)]
        waiting[first] = False
        fine = seeds[waiting[seeds]]
        waiting[fine] = False
        candidates = candidates[waiting[candidates]]
        inserted = np.zeros(len(xyz), bool)  # into the TIN: seeds and candidates alone
        inserted[seeds] = inserted[candidates] = True
        place = np.cumsum(inserted) - 1
        rim = rim_points(xyz[first] if self.seed_cell is None else xyz[:0], bounds, self)
        low = np.concatenate([xyz.take(np.flatnonzero(inserted), axis=0), rim])
        tin = Tin(low, np.concatenate([place[first], np.arange(len(low) - len(rim), len(low))]))
        waiting_fine, residual = Waiting.of(place[fine]), np.zeros(len(fine))
        update_residuals(tin, low, waiting_fine, residual)
        tolerance = self.tolerance(median(residual) if len(fine) else 0.0)
        noise = tolerance / self.tolerance_gain
        insert_residuals(tin, low, waiting_fine, residual, noise)
        angle = np.radians(self.angle + self.angle_share * spacing)
        limits = Limits(self.distance_share * spacing, angle, self.steep, 2 * cell, noise)
        densify(tin, low, Waiting.of(place[candidates]), limits, self.rounds)
        if emit is not ignore:
            emit("triangles", low[tin.triangles])
        return near_surface(tin, low, xyz, tolerance, 0.5 * spacing) & ~over
