"""Fc-S, steps 1 to 3 (Ren, Zhou, Cen, Zhang, Zhang): ground from the contours of the surface."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from scipy.spatial import cKDTree

from eaves.geometry.neighbours import measure_spacing
from eaves.ground.stage import GroundMethod
from eaves.ground.toolkit.seeds import lowest_of_cells
from eaves.ground.toolkit.wide_objects import rise_within
from eaves.methods import Emit, ignore, parameter
from eaves.model import Grid, Mask, PointCloud, Points, Raster
from eaves.raster.contours import Contour, slopes_at, trace_contours
from eaves.raster.grid import cell_centres, empty_raster, lowest_points, whole_cells
from eaves.raster.interpolate import fill_between


class ContourGround(GroundMethod):
    """Ground by telling contours of the terrain from contours of what stands on it.

    The mask (N,) of the ground points.

    The surface is gridded by the nearest point, which keeps the jump at walls. Its contours are drawn:
    around a house or a tree they are closed, and cut by the rim of the data they are short; on terrain they
    run from rim to rim, long and with their ends far apart. A first terrain is interpolated between the
    latter. Then, round by round, the cells of the surface that lie close to the terrain, or below it, become
    its new support, until nothing changes. Points close to the last terrain are ground.

    Formula
    -------
    support of the terrain:  z − terrain ≤ t + `rise` · cell · slope of the terrain,   t = `tolerance`

    Fidelity
    --------
    Followed: steps 1 to 3 of the paper, the three properties of a contour, nearest-neighbour gridding. The
    paper prints no number and does not describe the iteration; cell, interval, lengths, and the rule above
    are ours. Closing is read as: a closed contour is not on terrain, which costs hills inside the data;
    length, as that of an open one. Data narrower than both lengths show a part of each contour: one that
    runs across them is long, unless along half of it the surface is steeper than `wall_slope`, as along a row
    of houses that leaves the data. The first round of the iteration makes the filter. Where the contours of
    walls lie over one another, the lowest holds. Flat terrain has no contour; a block in which none lies on
    terrain begins with the lowest point of each cell of `least_length`, which a run counts and says.
    Contours carry the method where terrain has relief; on flat terrain those lowest points do better.

    Fails where
    -----------
    A hill lies wholly inside the data, or a row of houses runs from rim to rim and no terrain beneath it
    was drawn; crowns that touch make one long line.

    Complexity
    ----------
    O(cells × levels) for tracing, O(N log N) for the nearest points: about 3 CPU seconds per million points.

    References
    ----------
    [ren_fcs]
    """

    name: ClassVar[str] = "contours"
    start: ClassVar[str] = "contours on terrain"
    idea: ClassVar[str] = "Long open contours of the surface lie on terrain, short and closed ones do not."
    paper: ClassVar[str] = "ren_fcs"

    cell_least: float = parameter(
        0.5,
        "Side of the cells of the surface, as in the scene's rasters; one spacing where that is more.",
        unit="m",
        gt=0.0,
    )
    interval: float = parameter(0.5, "Contour interval.", unit="m", gt=0.0)
    end_distance: float = parameter(
        40.0,
        "An open contour with ends farther apart than this, or across all data, lies on terrain.",
        unit="m",
        off=1e-3,
        step="open contours: end distance",
        gt=0.0,
    )
    least_length: float = parameter(
        120.0,
        "An open contour longer than this, or than all data across, and with far ends, lies on terrain.",
        unit="m",
        off=1e-3,
        step="open contours: length",
        gt=0.0,
    )
    wall_slope: float = parameter(
        1.0,
        "Across data narrower than both lengths, a contour along half of which the surface is steeper than "
        "this, 45°, runs along walls.",
        off=1e9,
        step="open contours: walls across narrow data",
        gt=0.0,
    )
    tolerance: float = parameter(
        0.3, "Distance from the terrain within which points belong to it.", unit="m", gt=0.0
    )
    rise: float = parameter(
        0.3, "Added to the tolerance per unit of slope of the terrain, times the cell.", ge=0.0
    )
    rounds: int = parameter(
        10, "Maximum number of rounds of refinement.", off=0, step="iteration of the DTM", ge=0
    )

    @property
    def buffer(self) -> float:
        return self.least_length / 2

    def ground_mask(self, cloud: PointCloud, emit: Emit = ignore) -> Mask:
        xyz = cloud.xyz
        if len(xyz) < 3:
            return np.ones(len(xyz), bool)
        cell = max(self.cell_least, measure_spacing(xyz))
        surface = self.grid_surface(xyz, cell)
        emit("surface", surface)
        contours = self.draw_contours(surface)
        lies = [self.on_terrain(contour, surface) for contour in contours]
        on_terrain = [contour for contour, on in zip(contours, lies, strict=True) if on]
        emit(self.start, on_terrain)
        emit("contours off terrain", [contour for contour, on in zip(contours, lies, strict=True) if not on])
        terrain = self.first_terrain(on_terrain, surface, xyz)
        emit("first terrain", terrain)
        terrain = self.refine(terrain, surface)
        emit("terrain", terrain)
        allowed = self.allowed(terrain)[terrain.cell_of(xyz)]
        return np.asarray(np.abs(xyz[:, 2] - terrain.at(xyz)) <= allowed)

    def grid_surface(self, xyz: Points, cell: float) -> Raster:
        """The height of the point nearest to each cell's centre."""
        surface = empty_raster(whole_cells(PointCloud(xyz).bounds, cell), cell)
        nearest = cKDTree(xyz[:, :2]).query(cell_centres(surface))[1]
        return surface.with_(values=xyz[nearest, 2].reshape(surface.shape).astype(np.float32))

    def draw_contours(self, surface: Raster) -> list[Contour]:
        """All contours of the surface at whole multiples of the interval."""
        low, high = (float(end(surface.values)) / self.interval for end in (np.min, np.max))
        return trace_contours(surface, np.arange(np.ceil(low), np.floor(high) + 1) * self.interval)

    def on_terrain(self, contour: Contour, surface: Raster | None = None) -> bool:
        """True if a contour lies on terrain: by closing, distance of its ends, and length; in a narrow
        `surface`, also if it runs across it and not along walls."""
        ends, length = contour.end_distance, contour.length
        whole = ends > self.end_distance and length > self.least_length
        if surface is not None and not (whole or contour.closed):
            across = surface.cell * (min(surface.shape) - 2)
            whole = (
                ends > min(self.end_distance, across)
                and length > min(self.least_length, across)
                and float(np.median(slopes_at(surface, contour.xy))) <= self.wall_slope
            )
        return whole and not contour.closed

    def first_terrain(self, contours: list[Contour], surface: Raster, xyz: Points) -> Raster:
        """Linear between the contours on terrain; where several cross a cell the lowest holds."""
        lines = [np.c_[contour.xy, np.full(len(contour.xy), contour.level)] for contour in contours]
        support = np.concatenate(lines) if lines else xyz[lowest_of_cells(xyz, self.least_length)]
        number = lowest_points(support, surface.bounds, surface.cell)
        values = np.where(number >= 0, support[np.maximum(number, 0), 2], np.nan)
        return fill_between(surface.with_(values=values.astype(np.float32)))

    def allowed(self, terrain: Raster) -> Grid:
        """Largest distance (H, W), m, from the terrain of what belongs to it."""
        return np.asarray(self.tolerance + self.rise * rise_within(terrain.values), np.float32)

    def refine(self, terrain: Raster, surface: Raster) -> Raster:
        """The terrain supported by the cells of the surface that lie on it, repeated until they stay the
        same.
        """
        before = np.zeros(surface.shape, bool)
        for _ in range(self.rounds):
            support = surface.values - terrain.values <= self.allowed(terrain)
            if not support.any() or (support == before).all():
                break
            terrain = fill_between(
                surface.with_(values=np.where(support, surface.values, np.nan).astype(np.float32))
            )
            before = support
        return terrain
