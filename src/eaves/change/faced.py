"""The roof points of an epoch, and what the other epoch shows at each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from eaves.change.epoch import Building, Epoch
from eaves.change.surface import TRIM, Shift, fit_shift, nearest_distances, point_planes
from eaves.change.verdict import DEMOLISHED, NEW, BuildingChange, ChangeRules, Side, Verdict, patches_of
from eaves.detect import Cells
from eaves.flow import FEWEST, STRIP_CELL, Progress
from eaves.geometry import half_shared, measure_spacing, nearest, pair_off
from eaves.model import BUILDING, GROUND, Block, Mask, PointCloud, Points, Values
from eaves.upkeep import SAME_SURFACE_M

REACH = 6.0
"""Width of the surroundings of a block that its points are faced with (m): more than any radius."""

FARTHEST = 1.0
"""Largest shift in plan between epochs, and of pairs from planes (m): half a storey is more."""

BLOCKS_FOR_SHIFT = 60
"""Maximum number of blocks that the shift is derived from, spread evenly."""

SMOOTHEST = 0.08
"""Noise of tiles and gravel (m) under which no roof lies."""


@dataclass(frozen=True)
class Measured:
    """Of two epochs: mean spacings (m), the new one's shift, how rough roofs are (m, one standard deviation),
    how near a surface must lie to be the same (m), and the radius that faces a point with the other epoch."""

    spacings: tuple[float, float]
    shift: Shift
    rough: float
    tolerance: float
    radius: float


def measure_epochs(old: Epoch, new: Epoch, blocks: Sequence[Block], progress: Progress) -> Measured:
    """Spacings, noise and shift, from blocks spread evenly over the given ones, which both epochs cover."""
    evenly = np.unique(np.linspace(0, len(blocks) - 1, BLOCKS_FOR_SHIFT).astype(int))
    some = [blocks[k] for k in evenly] if blocks else []  # none where nothing is in both
    spacings: list[list[float]] = [[], []]
    coarse: list[NDArray[np.float64]] = [np.zeros(0)]
    for block in some:
        clouds = [epoch.points(block, 0.0) for epoch in (old, new)]
        for kept, cloud in zip(spacings, clouds, strict=True):
            if len(cloud) > FEWEST:
                kept.append(measure_spacing(cloud.xyz))
        coarse.append(ground_differences(*clouds))
    one, other = (float(np.median(kept)) if kept else 1.0 for kept in spacings)
    radius = max(0.75, 1.5 * max(one, other))
    differences = np.concatenate(coarse)
    enough = len(differences) >= FEWEST
    first = Shift(0.0, 0.0, float(np.median(differences)) if enough else 0.0, 0.0, len(differences) * enough)
    slopes, distances, roughness = [np.zeros((0, 2))], [np.zeros(0)], [np.zeros(0)]
    for done, block in enumerate(some, 1):
        before, after = old.points(block, 0.0), new.points(block, REACH)
        roof = before.xyz[classes_of(before) == BUILDING]
        if len(roof) < FEWEST or not len(after):
            continue
        slope, rms = point_planes(roof)
        flat = rms <= 2 * SMOOTHEST
        others = after.xyz - first.vector
        slopes.append(slope[flat])
        distances.append(nearest_distances(roof[flat], slope[flat], others, radius, FARTHEST))
        roughness.append(rms[flat])
        progress("align", done, len(some))
    fitted = fit_shift(np.concatenate(slopes), np.concatenate(distances))
    up = first.up + (fitted.up if fitted.pairs >= FEWEST else 0.0)
    shift = replace(fitted, up=up, pairs=fitted.pairs or first.pairs)
    rough = np.concatenate(roughness)
    typical = float(np.median(rough)) if len(rough) else SMOOTHEST / TRIM
    return Measured((one, other), shift, typical, max(SAME_SURFACE_M, 4.0 * shift.noise), radius)


def ground_differences(old: PointCloud, new: PointCloud) -> NDArray[np.float64]:
    """Rise (K,) of the median heights of ground from the old to the new epoch, in the cells that both
    show."""
    keys, heights = [], []
    for cloud in (old, new):
        ground = cloud.xyz[classes_of(cloud) == GROUND]
        place = np.floor(ground[:, :2] / STRIP_CELL).astype(np.int64)
        key = place[:, 0] * 2**32 + place[:, 1]
        order = np.lexsort((ground[:, 2], key))
        key, z = key[order], ground[order, 2]
        known, first, count = np.unique(key, return_index=True, return_counts=True)
        keys.append(known)
        heights.append(z[first + count // 2])
    _, one, other = np.intersect1d(keys[0], keys[1], assume_unique=True, return_indices=True)
    return np.asarray(heights[1][other] - heights[0][one])


def classes_of(cloud: PointCloud) -> NDArray[np.uint8]:
    """The classes (N,)."""
    assert cloud.classification is not None
    return cloud.classification


IN_PLAN = np.array([1.0, 1.0, 0.0])
MOSTLY = 0.6
"""Where a roof that the run did not find stands, this share of the high points lies on planes."""


@dataclass(frozen=True, eq=False)
class Roof:
    """The roof points of a block: their numbers, slopes, whether they are flat, whether the run found them,
    heights over the nearest ground (m); and all points' classes, with 6 for each of these."""

    which: NDArray[np.int64]
    slope: NDArray[np.float64]
    flat: NDArray[np.bool_]
    known: NDArray[np.bool_]
    height: Values
    classes: NDArray[np.uint8]


def roof_points(xyz: Points, cloud: PointCloud, rough: float, lowest: float) -> Roof:
    """The points of roofs: those the run found, and others that lie on a plane `lowest` (m) or
    more over the ground; roofs are `rough` (m, one standard deviation)."""
    classes = classes_of(cloud).copy()
    ground, found = xyz[cloud.ground], classes == BUILDING
    high = ~(found | cloud.ground | cloud.noise)
    height = np.full(len(xyz), np.nan)
    if len(ground):
        some = np.flatnonzero(found | high)
        beneath, _ = nearest(xyz[some] * IN_PLAN, ground * IN_PLAN, 1)
        height[some] = xyz[some, 2] - ground[beneath[:, 0], 2]
    high &= height >= lowest
    which = np.flatnonzero(found | high)
    slope, rms = point_planes(xyz[which])
    flat = rms <= max(SMOOTHEST, TRIM * rough)
    kept = found[which] | (flat & mostly(flat, xyz[which], STRIP_CELL))
    which = which[kept]
    classes[which] = BUILDING
    return Roof(which, slope[kept], flat[kept], found[which], height[which], classes)


def mostly(flat: Mask, xyz: Points, side: float) -> Mask:
    """Mask (N,) of the points in square cells most (`MOSTLY`) of whose points are flat: roofs are, and in
    crowns a few leaves lie on a plane by chance."""
    if not len(xyz):
        return flat
    cells = Cells.of(xyz, side, 0)
    return np.asarray((cells.total(flat.astype(np.float64)) >= MOSTLY * cells.count)[cells.cell])


Faced = tuple[NDArray[Any], ...]
"""Of the roof points (N,) of an epoch in a block: sites and buildings, −1 for none, then the columns of a
`Side` but for their sizes."""


def by_site(
    parts: Sequence[Faced], count: int, buildings: Sequence[Building], spacing: float
) -> tuple[list[Side], Side]:
    """The points of each of `count` sites, and those of none; each stands for its share of its building's
    outline."""
    site, building, *columns = (np.concatenate(some) for some in zip(*parts, strict=True))
    points = np.bincount(building[building >= 0], minlength=len(buildings))
    areas = np.array([one.polygon.area for one in buildings])
    share = np.clip(areas / np.maximum(points, 1), 0.5 * spacing**2, 2.0 * spacing**2)
    size = np.append(share, spacing**2)[building]  # the last is that of no building
    order = np.argsort(site, kind="stable")
    ends = np.searchsorted(site[order], np.arange(-1, count + 1))
    none, *sides = (Side(*(one[order[a:b]] for one in (*columns, size))) for a, b in pairwise(ends))
    return sides, none


def found_beside(
    side: Side, spacing: float, epoch: int, rules: ChangeRules, link: float
) -> list[BuildingChange]:
    """Flat surfaces far from every footprint that came or went: buildings that a run did not find."""
    whole = replace(rules, smallest_m2=rules.smallest_alone_m2)
    changes = []
    for patch in patches_of(side, side.came, whole, link):
        xy = side.xyz[patch, :2]
        outline = outline_of(xy, spacing)
        if side.are_vehicles(patch, link / 2):
            continue
        rise = float(abs(np.median(side.distance[patch])))
        kind = (DEMOLISHED, NEW)[epoch]
        area = side.area_of(patch)
        verdict = Verdict(
            kind,
            height_m=rise if epoch else -rise,
            built_m2=area * epoch,
            gone_m2=area * (1 - epoch),
            volume_m3=float(-(side.distance * side.size)[patch].sum()) * (1 if epoch else -1),
            reason=f"a flat surface {rise:.1f} m high, in no footprint of the epoch's run",
            patches=(xy,),
        )
        count = int(patch.sum())
        points = (0, count) if epoch else (count, 0)
        changes.append(BuildingChange("", (), (), outline, verdict, points, (None, None)))
    return changes


def outline_of(xy: NDArray[np.float64], spacing: float) -> Polygon | MultiPolygon:
    """The area (world metres) that points (N, 2) cover."""
    wide = max(spacing, 0.5)
    grown = shapely.union_all(shapely.buffer(shapely.points(xy), 1.5 * wide, quad_segs=2))
    return shapely.simplify(shapely.buffer(grown, -wide, quad_segs=2), 0.2)


@dataclass(frozen=True, eq=False)
class Site:
    """A row of the table before it is judged: the new building there, or an old one that none stands for."""

    polygon: Polygon | MultiPolygon
    old: tuple[Building, ...]
    new: tuple[Building, ...]


def make_sites(
    old: Sequence[Building], new: Sequence[Building]
) -> tuple[list[Site], dict[str, list[int]], dict[str, list[int]]]:
    """A site for each new building with the old ones at its place, and one for each old one that no new one
    stands for; the sites of each building by its id."""
    partners: dict[int, list[int]] = {}
    for _, i, j in half_shared(*([one.polygon for one in some] for some in (old, new))):
        partners.setdefault(j, []).append(i)
    sites = [
        Site(one.polygon, tuple(old[i] for i in sorted(partners.get(j, ()))), (one,))
        for j, one in enumerate(new)
    ]
    new_site = {one.id: [j] for j, one in enumerate(new)}
    old_site: dict[str, list[int]] = {}
    for j, some in partners.items():
        for i in some:
            old_site.setdefault(old[i].id, []).append(j)
    for one in old:
        if one.id not in old_site:
            old_site[one.id] = [len(sites)]
            sites.append(Site(one.polygon, (one,), ()))
        old_site[one.id].sort()
    return sites, old_site, new_site


def carry_ids(changes: Sequence[BuildingChange], sites: Sequence[Site]) -> tuple[BuildingChange, ...]:
    """The changes, named: a building keeps the id of the old one with which it shares most, each id once."""
    wanted = []
    for number, site in enumerate(sites):
        for one in site.old:
            shared = shapely.intersection(one.polygon, site.polygon).area
            wanted.append((-float(shared), one.id, number))
    names = pair_off((number, name) for _, name, number in sorted(wanted))
    taken, named = set(names.values()), []
    for number, change in enumerate(changes):
        place = change.polygon.representative_point()
        name = names.get(number) or next(iter(change.new_ids), f"at_{place.x:.0f}_{place.y:.0f}")
        while name in taken and names.get(number) != name:
            name += "-new"
        taken.add(name)
        named.append(replace(change, id=name))
    return tuple(named)
