"""Buildings as clusters of planes grown from planar cells (Chen and Sun)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from eaves.detect.stage import Detector
from eaves.detect.toolkit.cells import Cells, side_near
from eaves.geometry.planes import Sums, fit_planes, plane_rmse, sums_of
from eaves.methods import Emit, ignore, parameter
from eaves.model import Points, Regions, Scene, Values
from eaves.model.scene import ROOF

ALPHA_IN_SPACINGS = 4.8
"""The printed radius of a contour's disc, 2.4 m, at the spacing of its data: Vaihingen, 4 points/m²."""


class PlanarPatches(Detector):
    """Building labels: cells whose points lie in one plane, merged, grown and clustered.

    Points are gridded; a plane is fitted to the points of each cell. A cell with a small residual well above
    the terrain is a patch of a roof or a facade, and facades go by their normal. Patches are merged with
    their neighbours while one plane fits both; each plane then grows into the cells around it that hold
    enough of its points. Neighbouring planes form a building; small planes are tree crowns. All that a
    building's contour encloses belongs to it, courtyards apart: points in there that stand `min_height` above
    the terrain are its roof.

    Formula
    -------
    A cell is a patch when RMSE(cell) < `max_rmse` and mean(z) - mean(DTM) ≥ `min_height`; it joins a plane
    when more than `join_points` of its points, or `join_share` of them, have |z - plane(x, y)| <
    `max_distance`.

    Fidelity
    --------
    Steps 1 to 6 are the document's; the contour itself, as a polygon, is `outline.AlphaShape`, and here its
    area is taken on the cells, by closing with the same disc. By default all points over the terrain inside
    it are roof; `as_published` leaves them to the planes alone. The document names adaptive TIN and cites a
    slope filter; the ground here is Axelsson's adaptive TIN. Its numbers were set for 4 points/m², where a
    cell of 1.5 m is three spacings wide and holds nine points: by default the cell is three spacings wide,
    but not under 1 m (a crown is as smooth as a roof over half a metre); the counts of points stay as
    printed, and the disc grows with the spacing of sparser scans. Not printed, and closed here: the slope
    that makes a facade; the fewest points of a fit; the order of merging (the pair that likes each other best
    merges first, so the answer does not depend on the scan); the cell two planes want (the one with more
    points gets it).

    Fails where
    -----------
    Roofs narrower than two cells, curved or crowded with machinery; at under 2 points/m² houses whose
    faces are smaller than a few cells. Clipped hedges, dense crowns and parked lorries pass as planes
    when they are large and smooth.

    Complexity
    ----------
    Linear in points and cells for each round of merging and growing; some tens of rounds.

    References
    ----------
    [chen_sun_vaihingen]
    """

    name: ClassVar[str] = "planar_patches"
    idea: ClassVar[str] = "cells whose points fit one plane, merged, grown and clustered to buildings"
    paper: ClassVar[str] = "chen_sun_vaihingen"

    cell: float | None = parameter(
        None,
        "Side of a cell; default: three spacings, at least 1.",
        unit="m",
        published=1.5,
        printed_in="step 2",
        gt=0.0,
    )
    max_rmse: float = parameter(
        ...,
        "Largest residual (RMSE) of a patch and of merged patches.",
        unit="m",
        published=0.1,
        printed_in="steps 2 and 3",
        off=100.0,
        step="patches: planar cells",
        gt=0.0,
    )
    min_height: float = parameter(
        ...,
        "Least height of a patch over the terrain.",
        unit="m",
        published=2.0,
        printed_in="step 2",
        off=0.0,
        step="at least 2 m over the DTM",
        ge=0.0,
    )
    max_slope: float = parameter(
        75.0, "Steeper planes are facades.", unit="degree", off=89.99, step="facades go", gt=0.0, lt=90.0
    )
    max_distance: float = parameter(
        ...,
        "Largest vertical distance of a point to its plane.",
        unit="m",
        published=0.1,
        printed_in="step 4",
        off=1e-9,
        step="region growth",
        gt=0.0,
    )
    join_points: float = parameter(
        ...,
        "A cell with more points of a plane than this joins it.",
        unit="point",
        published=10.0,
        printed_in="step 4",
        gt=0.0,
    )
    join_share: float = parameter(
        ...,
        "A cell with this share of its points in a plane joins it.",
        published=0.4,
        printed_in="step 4",
        gt=0.0,
        le=1.0,
    )
    min_cells: int = parameter(
        ...,
        "Planes of fewer cells are crowns.",
        unit="cell",
        published=3,
        printed_in="step 5",
        off=1,
        step="small planes take no part",
        ge=1,
    )
    min_points: float = parameter(
        ...,
        "Planes of fewer points are crowns.",
        unit="point",
        published=10.0,
        printed_in="step 5",
        off=0.5,
        step="small planes take no part",
        gt=0.0,
    )
    alpha: float | None = parameter(
        None,
        "Radius of the largest empty disc inside a building; default: 4.8 spacings, at least 2.4.",
        unit="m",
        symbol="α",
        published=2.4,
        printed_in="step 6",
        off=1e-3,
        step="contour by alpha shape",
        gt=0.0,
    )
    min_hole: float = parameter(
        ...,
        "Inner boundaries smaller than this are dropped.",
        unit="m²",
        published=50.0,
        printed_in="step 6",
        off=0.0,
        step="contour by alpha shape",
        ge=0.0,
    )
    fill: bool = parameter(
        True, "All points over the terrain inside a contour are roof, not those of planes alone.", off=False
    )
    fit_points: int = parameter(5, "Fewest points of a cell that a plane is fitted to.", unit="point", ge=4)

    @property
    def buffer(self) -> float:
        return 30.0

    def label(self, scene: Scene, emit: Emit = ignore) -> Regions:
        number = np.zeros(len(scene.cloud), np.int32)
        used = np.flatnonzero(~scene.cloud.noise)
        if len(used) < self.fit_points:
            return Regions(number, np.zeros(0))
        xyz, height = scene.cloud.xyz[used], scene.height[used]
        xyz = xyz - [0.0, 0.0, np.floor(xyz[:, 2].min())]
        side = self.cell or side_near(max(1.0, 3.0 * scene.spacing))
        cells = Cells.of(xyz, side)

        emit("DTM", scene.dtm)
        sums, patch = self.find_patches(xyz, height, cells)
        emit("patches", cells.raster(patch))
        planes = self.merge_patches(sums, patch, cells)
        emit("merged patches", cells.raster(planes.plane.copy()))
        member = self.grow_planes(planes, xyz, cells, self.join_points)
        emit("grown planes", cells.raster(planes.plane))
        building = self.cluster_planes(planes, cells, self.min_points)
        emit("clusters", cells.raster(building))
        of_plane = np.zeros(len(planes.sums) + 1, np.int32)
        of_plane[planes.plane] = building

        building = self.close_contours(building.reshape(cells.shape), side, scene.spacing).ravel()
        emit("contours", cells.raster(building))

        inside = building[cells.cell] if self.fill else of_plane[member]
        roof = (inside > 0) & (height >= (self.min_height if self.fill else -np.inf))
        number[used[roof]] = inside[roof]
        part = np.zeros(len(number), np.uint8)
        part[used[roof]] = ROOF
        good = np.bincount(inside[roof & (member > 0)], minlength=building.max(initial=0) + 1)[1:]
        every = np.bincount(inside[roof], minlength=building.max(initial=0) + 1)[1:]
        return Regions(number, good / np.maximum(every, 1), part)

    def find_patches(self, xyz: Points, height: Values, cells: Cells) -> tuple[Sums, NDArray[np.bool_]]:
        """Sums (cells, 10) of all cells, and which cells (cells,) are planar, high and no facade: step 2."""
        sums = sums_of(xyz, cells.cell, cells.size)
        patch = np.zeros(cells.size, bool)
        above = cells.total(height) >= self.min_height * cells.count
        some = np.flatnonzero((cells.count >= self.fit_points) & above)
        if len(some):
            _, normal, rmse = fit_planes(sums[some])
            upright = normal[:, 2] >= np.cos(np.radians(self.max_slope))
            patch[some[(rmse < self.max_rmse) & upright]] = True
        return sums, patch

    def merge_patches(self, sums: Sums, patch: NDArray[np.bool_], cells: Cells) -> Planes:
        """Planes of neighbouring patches that one plane fits: step 3."""
        owner = np.flatnonzero(patch)
        place = np.full(cells.size, -1)
        place[owner] = np.arange(len(owner))
        near = place[owner[:, None] + cells.neighbours[:4]]
        one, two = np.broadcast_to(np.arange(len(owner))[:, None], near.shape)[near >= 0], near[near >= 0]
        total, root = merge_mutually(sums[owner], np.minimum(one, two), np.maximum(one, two), self.max_rmse)
        names, which = np.unique(root, return_inverse=True)
        plane = np.zeros(cells.size, np.int64)
        plane[owner] = which + 1
        return Planes(plane, total[names])

    def grow_planes(self, planes: Planes, xyz: Points, cells: Cells, many: float) -> NDArray[np.int64]:
        """Grow `planes` in place until nothing grows: step 4. The plane (N,) of each point, 0 for none: also
        of those near a plane in a cell around it that does not join."""
        plane = planes.plane
        member = plane[cells.cell]
        changed = np.ones(len(planes.sums), bool)
        occupied = cells.count > 0
        while changed.any():
            source = np.flatnonzero((plane > 0) & changed[plane - 1])
            target = source[:, None] + cells.neighbours
            pair = np.stack([np.broadcast_to(plane[source][:, None], target.shape), target], axis=-1).reshape(
                -1, 2
            )
            pair = pair[(plane[pair[:, 1]] == 0) & occupied[pair[:, 1]]]
            changed = np.zeros(len(planes.sums), bool)
            if not len(pair):
                break
            key = np.unique(pair[:, 0] * cells.size + pair[:, 1])
            wanting, target = np.divmod(key, cells.size)
            which, point = cells.points_of(target)
            centre, normal, _ = fit_planes(planes.sums)
            c, n = centre[wanting - 1][which], normal[wanting - 1][which]
            offset = ((xyz[point] - c) * n).sum(axis=1) / n[:, 2]
            near = np.abs(offset) < self.max_distance
            hits = np.bincount(which[near], minlength=len(key))
            joins = np.flatnonzero(
                (hits > many) | (hits >= self.join_share * cells.count[target]) & (hits > 0)
            )
            order = joins[np.lexsort((wanting[joins], -hits[joins], target[joins]))]
            first = np.r_[True, target[order][1:] != target[order][:-1]] if len(order) else np.zeros(0, bool)
            won = np.zeros(len(key), bool)
            won[order[first]] = True
            plane[target[won]] = wanting[won]
            best = np.flatnonzero(near & (member[point] == 0))
            best = best[np.lexsort((wanting[which[best]], np.abs(offset[best])))]
            fresh, first = np.unique(point[best], return_index=True)
            member[fresh] = wanting[which[best[first]]]
            planes.sums += sums_of(xyz[fresh], member[fresh] - 1, len(planes.sums))
            changed[wanting[won] - 1] = True
        return member

    def close_contours(self, building: NDArray[np.int32], side: float, spacing: float) -> NDArray[np.int32]:
        """Buildings (H, W) with all that their contour encloses: step 6, on the cells.

        An alpha shape is what no empty disc of the radius can enter: the closing by that disc. Inner
        boundaries that stay open are filled when they are smaller than a courtyard.
        """
        radius = (self.alpha or ALPHA_IN_SPACINGS * max(0.5, spacing)) / side
        margin = int(np.ceil(radius)) + 1
        whole = building.copy()
        for number, window in enumerate(ndimage.find_objects(building), 1):
            part = np.pad(building[window] == number, margin)
            reached = ndimage.distance_transform_edt(~part) <= radius
            closed = part | (ndimage.distance_transform_edt(np.pad(reached, 1))[1:-1, 1:-1] > radius)
            hole, count = ndimage.label(~closed)
            size = np.bincount(hole.ravel(), minlength=count + 1)
            small = size < self.min_hole / side**2
            small[[0, hole[0, 0]]] = False
            closed = (closed | small[hole])[margin:-margin, margin:-margin]
            free = closed & (whole[window] == 0)
            whole[window][free] = number
        return whole

    def cluster_planes(self, planes: Planes, cells: Cells, few: float) -> NDArray[np.int32]:
        """Building number (cells,), 0 for none, of neighbouring planes that are large enough: step 5."""
        size = np.bincount(planes.plane, minlength=len(planes.sums) + 1)[1:]
        large = np.r_[False, (size >= self.min_cells) & (planes.sums[:, 0] >= few)]
        building, _ = ndimage.label(large[planes.plane].reshape(cells.shape), np.ones((3, 3)))
        return np.asarray(building, np.int32).ravel()


@dataclass(eq=False)
class Planes:
    """Number of the plane (1…K, 0 for none) that owns each cell, and the planes' sums (K, 10)."""

    plane: NDArray[np.int64]
    sums: Sums


def merge_mutually(
    sums: Sums, one: NDArray[np.int64], two: NDArray[np.int64], max_rmse: float
) -> tuple[Sums, NDArray[np.int64]]:
    """Sums (K, 10) and roots (K,) of sets merged along edges `one` < `two` (E,) while one plane fits both.

    In every round the pairs merge that are each other's best neighbour: least RMSE, then lowest number.
    """
    sums, root = sums.copy(), np.arange(len(sums))
    key = np.unique(one * len(sums) + two)
    cost = np.full(len(key), np.nan)
    while len(key):
        one, two = np.divmod(key, len(sums))
        stale = np.flatnonzero(np.isnan(cost))
        cost[stale] = plane_rmse(sums[one[stale]] + sums[two[stale]])
        fits = cost < max_rmse
        one, two, cost = one[fits], two[fits], cost[fits]
        if not len(one):
            break
        node, other = np.r_[one, two], np.r_[two, one]
        order = np.lexsort((other, np.r_[cost, cost], node))
        first = np.r_[True, node[order][1:] != node[order][:-1]]
        best = np.full(len(sums), -1)
        best[node[order][first]] = other[order][first]
        every = np.arange(len(sums))
        keeps = np.flatnonzero((best > every) & (best[best] == every))
        goes = best[keeps]
        sums[keeps] += sums[goes]
        to = every.copy()
        to[goes] = keeps
        root = to[root]
        touched = np.zeros(len(sums), bool)
        touched[keeps] = True
        one, two = to[one], to[two]
        cost[touched[one] | touched[two]] = np.nan
        low, high = np.minimum(one, two), np.maximum(one, two)
        apart = low != high
        key, index = np.unique(low[apart] * len(sums) + high[apart], return_index=True)
        cost = cost[apart][index]
    return sums, root
