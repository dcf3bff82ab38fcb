"""The cloud that matching makes of images of a town: its surface from above, blurred, rough, with holes."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Literal, get_args

import numpy as np
from scipy import ndimage

from eaves.model import (
    BUILDING,
    HIGH_VEGETATION,
    LOW_VEGETATION,
    UNCLASSIFIED,
    WIRE,
    Bounds,
    Integers,
    Labels,
    Mask,
    PointCloud,
    Values,
)
from eaves.model.checks import check_positive
from eaves.simulate.flight import ABOVE
from eaves.simulate.objects.clutter import photographed, sunlight
from eaves.simulate.objects.exact import ExactScene
from eaves.simulate.objects.surfaces import CONE, ELLIPSOID, Foliage, ScannedSurfaces, building_surfaces
from eaves.simulate.ray_grid import RayGrid, index_town
from eaves.simulate.scanner import PENCIL, Receiver, trace_pulses
from eaves.simulate.town import Town

ImageKind = Literal["smooth", "rough", "good", "holes"]

FINEST, COARSEST = 0.1, 0.25
"""Side (m) of the squares on which heights are blurred: half the blur, between these."""

ANY_ECHO = Receiver(dead_zone=0.1, threshold=0.0)
"""A receiver that takes the nearest surface, however steep."""

LIFTED = 0.5
"""Where blur lifts the ground beside a building by more than this (m), the picture shows its wall."""

COVER_LENGTH, HIDDEN_LENGTH = 15.0, 3.0
"""Lengths (m) over which the ground has one cover, and the strip without points one width."""


@dataclass(frozen=True)
class Matching:
    """What matching makes of a surface; by default exactly this surface.

    Parameters
    ----------
    density : float
        Points per square metre (> 0).
    blur : float
        Standard deviation (m, ≥ 0) of the Gaussian over which heights are averaged: walls become slopes.
    noise : float
        Standard deviation (m, ≥ 0) of each height by itself.
    ripple, roof_ripple, crown_ripple : float
        Standard deviation (m, ≥ 0) of errors that neighbours share: on the ground, on buildings, on crowns.
    ripple_length : float
        Distance (m, > 0) at which the correlation of these errors has fallen to 1/e.
    hidden : float
        Mean width (m, ≥ 0) of the strip beside walls where no point lies; where it is widest the roof's rim
        is missing, too.
    melted : float
        Gaps (m, ≥ 0) between crowns and walls up to this width are filled by a surface from one to the other.

    Examples
    --------
    >>> from eaves.simulate import Matching
    >>> Matching(blur=1.5).noise
    0.0
    """

    density: float = 10.0
    blur: float = 0.0
    noise: float = 0.0
    ripple: float = 0.0
    roof_ripple: float = 0.0
    crown_ripple: float = 0.0
    ripple_length: float = 1.0
    hidden: float = 0.0
    melted: float = 0.0

    def __post_init__(self) -> None:
        for name in (field.name for field in fields(self)):
            if name in ("density", "ripple_length"):
                check_positive(getattr(self, name), name)
            elif not getattr(self, name) >= 0:
                raise ValueError(f"{name} must be at least 0 m, not {getattr(self, name)}")


_CLEAR = {"noise": (0.03, 0.03), "blur": (0.3, 0.3), "crown_ripple": (0.2, 0.4)}
RANGES: dict[ImageKind, dict[str, tuple[float, float]]] = {
    "smooth": {
        "density": (1.0, 2.0),
        "blur": (1.5, 3.0),
        "ripple": (0.1, 0.1),
        "roof_ripple": (0.1, 0.1),
        "crown_ripple": (0.1, 0.2),
        "ripple_length": (2.0, 4.0),
    },
    "rough": {
        "density": (5.0, 20.0),
        "blur": (0.3, 0.6),
        "ripple": (0.2, 0.2),
        "roof_ripple": (0.55, 0.68),
        "crown_ripple": (0.4, 0.6),
    },
    "good": {"density": (20.0, 60.0), **_CLEAR},
    "holes": {"density": (20.0, 60.0), **_CLEAR, "hidden": (0.5, 1.2), "melted": (2.0, 4.0)},
}
"""From which each parameter of a kind is drawn evenly; the others are their defaults."""


def match_images(town: Town, matching: Matching | ImageKind = "good", seed: int = 0) -> ExactScene:
    """The cloud of a town by image matching, in colours, and the truth of each point in plan.

    Parameters
    ----------
    town : Town
        The town that is photographed.
    matching : Matching or str
        What matching makes of its surface; or a kind, whose parameters are drawn from `RANGES`: `smooth`
        (walls are slopes of about 45°), `rough` (roofs as rough as crowns), `good`, or `holes` (good but
        beside walls).
    seed : int
        The same seed gives the same points.

    Returns
    -------
    ExactScene
        The points, all of one return, with the fields `red`, `green` and `blue` (0 to 65535). The truth of a
        point is the surface over its place before blur; the fill between a crown and a wall is unclassified.

    Raises
    ------
    ValueError
        When `matching` names no kind.

    Examples
    --------
    >>> from eaves.simulate import match_images, simulate_town
    >>> scene = match_images(simulate_town(0.01, seed=3), "smooth", seed=3)
    >>> sorted(scene.cloud.fields)
    ['blue', 'green', 'red']
    """
    if isinstance(matching, str):
        matching = _draw_matching(matching, seed)
    rng = np.random.default_rng([seed, 41])
    crowns, solids = town.ray_grid(), _solids_of(town)
    xy = _scatter(town.bounds, matching.density, rng)
    exact, label = _seen_from_above(solids, crowns, xy)
    lattice = _Lattice(town.bounds, min(max(matching.blur / 2, FINEST), COARSEST))
    sharp, there = _seen_from_above(solids, crowns, lattice.middles())
    surface = sharp.reshape(lattice.shape)
    roofs, leaves = (mask.reshape(lattice.shape) for mask in (there[:, 0] == BUILDING, _is_crown(there)))
    light = lattice.at(sunlight(surface, lattice.cell, rng), xy)
    rim = lattice.at(_rim_distance(roofs, lattice.cell), xy)
    filled = np.zeros(len(xy), bool)
    z = exact
    if matching.melted > 0:
        surface, gap = _melt(surface, roofs, leaves, matching.melted / lattice.cell)
        filled = (lattice.at(gap.astype(float), xy) > 0.5) & (label[:, 0] != BUILDING)
        z = np.where(filled, lattice.at(surface, xy), z)
        label[filled] = UNCLASSIFIED, 0, 0
    if matching.blur > 0:
        z = lattice.at(ndimage.gaussian_filter(surface, matching.blur / lattice.cell, mode="nearest"), xy)
    on_wall = (label[:, 0] != BUILDING) & (z - exact > LIFTED) & (rim < 2 * matching.blur) & ~filled
    z = z + _errors(town.bounds, xy, label, matching, rng)
    cover = _shared(town.bounds, xy, COVER_LENGTH, rng)
    colours = photographed(label, xy, cover, on_wall, filled, light, rng)
    shown = filled | ~_is_hidden(rim, matching.hidden, _shared(town.bounds, xy, HIDDEN_LENGTH, rng))
    return _scene_of(town, np.column_stack([xy, z])[shown], label[shown], colours[shown])


def _draw_matching(kind: ImageKind, seed: int) -> Matching:
    """One set of parameters from the ranges of a kind."""
    if kind not in RANGES:
        raise ValueError(
            f"matching must be a Matching or one of {', '.join(get_args(ImageKind))}, not {kind}"
        )
    rng = np.random.default_rng([seed, 42])
    return replace(Matching(), **{name: rng.uniform(*ends) for name, ends in RANGES[kind].items()})


def _solids_of(town: Town) -> RayGrid:
    """What of a town is matched, without its leaves: no wire is."""
    every = ScannedSurfaces.join([*map(building_surfaces, town.buildings), town.furniture])
    seen = np.flatnonzero(every.truth_class != WIRE)
    kept = ScannedSurfaces(
        every.corners[seen], every.truth_class[seen], every.building[seen], every.plane[seen]
    )
    return index_town(town.terrain, kept, Foliage.none())


def _scatter(bounds: Bounds, density: float, rng: np.random.Generator) -> Values:
    """Places (N, 2), one somewhere in each square of a lattice."""
    columns, rows = (max(1, round(side * np.sqrt(density))) for side in (bounds.width, bounds.height))
    place = np.stack(np.meshgrid(np.arange(columns), np.arange(rows), indexing="ij"), axis=-1).reshape(-1, 2)
    share = (place + rng.uniform(size=place.shape)) / (columns, rows)
    return np.asarray((bounds.west, bounds.south) + share * (bounds.width, bounds.height))


@dataclass(frozen=True)
class _Lattice:
    """Squares over a town; a raster (I, J) holds one value a square, x first."""

    bounds: Bounds
    cell: float

    @property
    def shape(self) -> tuple[int, int]:
        """How many squares along x and y."""
        return int(np.ceil(self.bounds.width / self.cell)), int(np.ceil(self.bounds.height / self.cell))

    def middles(self) -> Values:
        """Places (I·J, 2) of the middles."""
        corner = self.bounds.west, self.bounds.south
        return np.asarray((np.indices(self.shape).reshape(2, -1).T + 0.5) * self.cell + corner)

    def at(self, raster: Values, xy: Values) -> Values:
        """Values (N,) at places (N, 2), bilinear between the middles."""
        place = (xy - (self.bounds.west, self.bounds.south)) / self.cell - 0.5
        return np.asarray(ndimage.map_coordinates(raster, place.T, order=1, mode="nearest"))


def _seen_from_above(solids: RayGrid, crowns: RayGrid, xy: Values) -> tuple[Values, Labels]:
    """Heights (N,) of the highest surface over places (N, 2), and class, building and plane (N, 3) of it."""
    top, down = solids.highest + ABOVE, np.tile([0.0, 0.0, -1.0], (len(xy), 1))
    origins = np.column_stack([xy, np.full(len(xy), top)])
    ranges, row, _ = trace_pulses(solids, origins, down, 0.0, PENCIL, ANY_ECHO, 0)
    z, label = top - ranges[:, 0], solids.labels[row[:, 0]]
    point, leaf, crown = _crowns_over(crowns, xy)
    higher = crown > z[point]
    order = np.flatnonzero(higher)[np.argsort(crown[higher], kind="stable")]  # of several, the highest stays
    z[point[order]], label[point[order]] = crown[order], crowns.labels[crowns.leaf_label[leaf[order]]]
    return z, label


def _crowns_over(grid: RayGrid, xy: Values) -> tuple[Integers, Labels, Values]:
    """Each place under a body of leaves, the number of the body, and the height (m) of its top there."""
    terrain = grid.terrain
    i, j = np.floor((xy - (terrain.west, terrain.south)) / terrain.cell).astype(np.int64).T
    square = i * terrain.water.shape[1] + j
    first, count = grid.leaf_starts[square], np.diff(grid.leaf_starts)[square]
    point = np.repeat(np.arange(len(xy)), count)
    step = np.arange(len(point)) - np.repeat(np.cumsum(count) - count, count)
    leaf = grid.leaf_members[first[point] + step]
    x, y, z, half_x, half_y, half_z, cos, sin, _ = grid.foliage.bodies[leaf].T
    dx, dy = xy[point].T - (x, y)
    u, v = (dx * cos + dy * sin) / half_x, (dy * cos - dx * sin) / half_y
    away, shape = np.hypot(u, v), grid.foliage.shape[leaf]
    round_top, cone_top = np.sqrt(np.clip(1.0 - away**2, 0.0, None)), 1.0 - 2.0 * away
    rise = np.select([shape == ELLIPSOID, shape == CONE], [round_top, cone_top], 1.0)
    reach = np.where((shape == ELLIPSOID) | (shape == CONE), away, np.maximum(np.abs(u), np.abs(v)))
    over = np.flatnonzero(reach <= 1.0)
    return point[over], leaf[over], (z + half_z * rise)[over]


def _is_crown(label: Labels) -> Mask:
    """Mask (N,) of leaves, from labels (N, 3)."""
    return np.asarray((label[:, 0] >= LOW_VEGETATION) & (label[:, 0] <= HIGH_VEGETATION))


def _rim_distance(roofs: Mask, cell: float) -> Values:
    """Distances (I, J) from the edge of the roofs (m), below 0 on them."""
    if not roofs.any():
        return np.full(roofs.shape, roofs.size * cell)
    outside, inside = (ndimage.distance_transform_edt(mask) for mask in (~roofs, roofs))
    return np.asarray((outside - inside) * cell)


def _melt(surface: Values, roofs: Mask, crowns: Mask, widest: float) -> tuple[Values, Mask]:
    """A surface whose gaps between roofs and crowns, up to `widest` squares, are bridged; and these gaps."""
    if not (roofs.any() and crowns.any()):
        return surface, np.zeros(surface.shape, bool)
    (to_roof, roof), (to_crown, crown) = (
        ndimage.distance_transform_edt(~mask, return_indices=True) for mask in (roofs, crowns)
    )
    gap = ~roofs & ~crowns & (to_roof + to_crown <= widest)
    bridge = surface[tuple(roof)] * to_crown + surface[tuple(crown)] * to_roof
    return np.where(gap, bridge / np.maximum(to_roof + to_crown, 1.0), surface), gap


def _is_hidden(rim: Values, hidden: float, share: Values) -> Mask:
    """Mask (N,) of the points that no image shows: beside walls, and on the rim where `share` is large."""
    return np.asarray(np.where(rim > 0, rim < hidden * (1.0 + 0.5 * share), -rim < hidden * (share - 1.0)))


def _errors(
    bounds: Bounds, xy: Values, label: Labels, matching: Matching, rng: np.random.Generator
) -> Values:
    """Errors of the heights (N,) at places (N, 2) with labels (N, 3)."""
    of_solid = np.where(label[:, 0] == BUILDING, matching.roof_ripple, matching.ripple)
    amplitude = np.where(_is_crown(label), matching.crown_ripple, of_solid)
    shared = amplitude * _shared(bounds, xy, matching.ripple_length, rng)
    return np.asarray(shared + rng.normal(0.0, matching.noise, len(xy)))


def _shared(bounds: Bounds, xy: Values, length: float, rng: np.random.Generator) -> Values:
    """Errors (N,) of deviation 1 at places (N, 2); their correlation is 1/e at a distance of `length` (m)."""
    lattice = _Lattice(bounds, length / 4.0)
    raster = ndimage.gaussian_filter(rng.normal(size=lattice.shape), 2.0, mode="wrap")
    return lattice.at(raster / raster.std(), xy)


def _scene_of(town: Town, xyz: Values, label: Labels, colours: Values) -> ExactScene:
    """The scene of points (N, 3), each the only return of its kind."""
    ones = np.ones(len(xyz), np.uint8)
    cloud = PointCloud.from_world(
        xyz + np.array([*town.origin, 0.0]),
        town.origin,
        return_number=ones,
        number_of_returns=ones,
        classification=np.full(len(xyz), UNCLASSIFIED, np.uint8),
        point_id=np.arange(len(xyz)),
        system=town.system,
    )
    cloud = cloud.with_(fields=dict(zip(("red", "green", "blue"), colours.T.copy(), strict=True)))
    classes, building, plane = label.T.copy()
    return ExactScene(cloud, classes.astype(np.uint8), building, plane, town.buildings)
