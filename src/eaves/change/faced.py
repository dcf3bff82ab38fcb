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

from eaves.change.changes import BuildingChange
from eaves.change.epoch import Building
from eaves.change.measure import SMOOTHEST, classes_of
from eaves.change.shift import TRIM
from eaves.change.surface import point_planes
from eaves.change.verdict import DEMOLISHED, NEW, ChangeRules, Side, Verdict, patches_of
from eaves.detect import Cells
from eaves.flow import STRIP_CELL
from eaves.geometry import nearest
from eaves.model import BUILDING, Mask, PointCloud, Points, Values

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
