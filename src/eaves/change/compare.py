"""Two epochs of a place compared: what became of each building.

```
two folders ─→ points by block ─→ shift of the new epoch ─→ roof points faced ─→ verdicts ─→ files
               of each epoch       from what is the same     with the other's     a building
```

Models are not compared: a footprint that one run drew wider, or a house that it merged with its neighbour,
is no change. The points decide.
"""

from __future__ import annotations

import logging
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from shapely import MultiPolygon, Polygon

from eaves.change.epoch import Building, Epoch, open_epoch
from eaves.change.shift import FEWEST, Shift, fit_shift
from eaves.change.surface import (
    STEEPEST,
    LocalPlanes,
    face_points,
    is_covered,
    local_planes,
    nearest_distances,
    planar,
)
from eaves.change.verdict import (
    DEMOLISHED,
    NEW,
    Rules,
    Side,
    Verdict,
    came,
    is_vehicle,
    judge_building,
    patches_of,
)
from eaves.geometry.neighbours import measure_spacing
from eaves.model import Block, Bounds, PointCloud, Points, Values
from eaves.model.cloud import BUILDING, GROUND, NOISE_CLASSES
from eaves.run.run import Progress, no_progress

log = logging.getLogger("eaves")

SIDE = 240.0
"""Side of the blocks that are compared one after the other (m)."""

REACH = 6.0
"""Width of the surroundings of a block that its points are faced with (m): more than any radius."""

COARSE = 2.0
"""Side of the cells whose lowest ground gives a first difference in height (m)."""

MOST_IN_PLAN = 1.0
"""Epochs lie at most so far beside each other (m): more is another place."""

PAIRED = 1.0
"""Points that far (m) off a plane are no pair of it: less than half a storey."""

OVERLAPPING = 0.5
"""Two outlines are of one building when they share this part of either."""

TOUCHING_M2 = 1.0
"""Outlines that share less are neighbours (m²)."""

BLOCKS_FOR_SHIFT = 60
"""The shift follows from at most so many blocks, spread evenly."""

SMOOTH = 3.0
"""A surface is planar when its points lie this many standard deviations of the noise about a plane."""

SMOOTHEST = 0.08
"""Noise of tiles and gravel (m) under which no roof lies."""

LOWEST_ROOF = 1.9
"""Planes lower than this (m) over the ground are cars, walls and hedges."""

WALL_NEAR, WALL_RISE = 0.3, 0.9
"""A point with another so near in plan and so much higher (m) is on a wall: steeper than 71°."""

BESIDE_M = 1.5
"""A part that no run found is at most so far (m) from its building."""

COMPACT = 0.5
"""Share of the convex hull that a building covers; what is less is a hedge, or rows of cars."""

TOLERANCE = 0.25
"""A surface nearer than this (m) is the same one: half of the smallest change that must be found."""


@dataclass(frozen=True, eq=False)
class Change:
    """What became of one building.

    `id` is the building's name over time: the old epoch's where it was there; `old_ids` and `new_ids` name
    all that stand at its place. `polygon` is its outline, the new epoch's where there is one (world metres).
    """

    id: str
    old_ids: tuple[str, ...]
    new_ids: tuple[str, ...]
    polygon: Polygon | MultiPolygon
    verdict: Verdict
    points: tuple[int, int]
    volumes: tuple[float | None, float | None]
    """Of the models (m³), where the runs know them."""

    @property
    def row(self) -> dict[str, Any]:
        """The change as tables show it."""
        verdict = self.verdict
        both = [volume for volume in self.volumes if volume is not None]
        return {
            "id": self.id,
            "change": verdict.change,
            "also": ", ".join(verdict.also) or None,
            "height_difference_m": round(verdict.height_m, 2),
            "volume_difference_m3": round(verdict.volume_m3, 1),
            "model_volume_difference_m3": round(both[1] - both[0], 1) if len(both) == 2 else None,
            "built_m2": round(verdict.built_m2, 1),
            "gone_m2": round(verdict.gone_m2, 1),
            "moved_m2": round(verdict.moved_m2, 1),
            "points_old": self.points[0],
            "points_new": self.points[1],
            "share_seen": verdict.figures.get("seen"),
            "share_same": verdict.figures.get("same"),
            "ids_old": ", ".join(self.old_ids) or None,
            "ids_new": ", ".join(self.new_ids) or None,
            "area_m2": round(float(self.polygon.area), 2),
            "reason": verdict.reason,
        }


@dataclass(frozen=True, eq=False)
class Comparison:
    """What became of every building of two epochs, and what the epochs are."""

    old: Epoch
    new: Epoch
    changes: tuple[Change, ...]
    shift: Shift
    tolerance: float
    """A surface nearer than this (m) counts as the same one."""
    spacings: tuple[float, float]
    """Mean spacings of the points (m)."""

    @property
    def densities(self) -> tuple[float, float]:
        """Points a square metre."""
        return self.spacings[0] ** -2, self.spacings[1] ** -2

    @property
    def counts(self) -> dict[str, int]:
        """How many buildings underwent each change."""
        names = [change.verdict.change for change in self.changes]
        return {name: names.count(name) for name in sorted(set(names), key=names.index)}


def compare_epochs(
    old: Path, new: Path, work: Path, progress: Progress = no_progress, rules: Rules | None = None
) -> Comparison:
    """What became of every building between the runs in two folders.

    Parameters
    ----------
    old, new
        What `eaves build` wrote for each epoch.
    work
        Folder for the points by block; it is removed.
    progress
        Called with the step, how much of it is done, and how much there is.
    rules
        From what size on a difference is a change.

    Raises
    ------
    InputError
        When a folder holds no complete run, or the systems cannot be brought together.
    """
    work.mkdir(parents=True, exist_ok=True)
    place = Path(tempfile.mkdtemp(prefix="compare-", dir=work))
    try:
        epochs: list[Epoch] = []
        for name, folder in (("old", old), ("new", new)):
            target = epochs[0].system if epochs else None
            epochs.append(open_epoch(folder, place / name, target, SIDE, partial(progress, f"read {name}")))
        return Comparer(epochs[0], epochs[1], rules or Rules(), progress).compare()
    finally:
        shutil.rmtree(place, ignore_errors=True)


@dataclass(frozen=True, eq=False)
class Site:
    """A row of the table before it is judged: the new building there, or an old one that none stands for."""

    polygon: Polygon | MultiPolygon
    old: tuple[Building, ...]
    new: tuple[Building, ...]


class Comparer:
    """The comparison of two opened epochs, step by step."""

    def __init__(self, old: Epoch, new: Epoch, rules: Rules, progress: Progress) -> None:
        self.old, self.new, self.rules, self.progress = old, new, rules, progress
        self.blocks = sorted(set(old.blocks()) & set(new.blocks()))
        self.all_blocks = sorted(set(old.blocks()) | set(new.blocks()))
        self.trees = [shapely.STRtree([one.polygon for one in epoch.buildings]) for epoch in (old, new)]

    def compare(self) -> Comparison:
        """All steps."""
        self.measure()
        sites, old_site, new_site = make_sites(self.old.buildings, self.new.buildings)
        parts: list[list[_Faced]] = [[], []]
        covered = np.zeros((len(sites), 3), np.int64)
        polygons = [site.polygon for site in sites]
        tree = shapely.STRtree(polygons)
        for done, block in enumerate(self.all_blocks, 1):
            for epoch, faced in enumerate(self.face_block(block, sites, (old_site, new_site), covered, tree)):
                parts[epoch].append(faced)
            self.progress("compare", done, len(self.all_blocks))
        changes = []
        whole = [_Faced.join(some) for some in parts]
        sides = [
            faced.by_site(len(sites), epoch.buildings, spacing)
            for faced, epoch, spacing in zip(whole, (self.old, self.new), self.spacings, strict=True)
        ]
        link = max(1.5, 2.5 * max(self.spacings))
        for number, site in enumerate(sites):
            before, after = sides[0][number], sides[1][number]
            enough = covered[number, :2] >= self.rules.least_seen * max(int(covered[number, 2]), 1)
            seen = bool(enough[0]), bool(enough[1])
            outlined = bool(site.old), bool(site.new)
            verdict = judge_building(before, after, self.rules, seen, link, outlined)
            changes.append(self.told(site, verdict, (len(before), len(after))))
        for faced, spacing, epoch in zip(whole, self.spacings, (0, 1), strict=True):
            changes += found_beside(faced, spacing, epoch, self.rules, link)
        named = carry_ids(changes, sites)
        return Comparison(self.old, self.new, named, self.shift, self.tolerance, self.spacings)

    def measure(self) -> None:
        """Spacings, and the new epoch's shift, from blocks spread evenly over what both cover."""
        evenly = np.unique(np.linspace(0, len(self.blocks) - 1, BLOCKS_FOR_SHIFT).astype(int))
        some = [self.blocks[k] for k in evenly] if self.blocks else []  # none where nothing is in both
        spacings: list[list[float]] = [[], []]
        coarse: list[NDArray[np.float64]] = [np.zeros(0)]
        for block in some:
            clouds = [epoch.points(block, 0.0) for epoch in (self.old, self.new)]
            for kept, cloud in zip(spacings, clouds, strict=True):
                if len(cloud) > FEWEST:
                    kept.append(measure_spacing(cloud.xyz))
            coarse.append(ground_differences(*clouds))
        old, new = (float(np.median(kept)) if kept else 1.0 for kept in spacings)
        self.spacings = old, new
        self.radius = max(0.75, 1.5 * max(self.spacings))
        first = fit_shift(np.zeros((0, 2)), np.zeros(0))
        differences = np.concatenate(coarse)
        if len(differences) >= FEWEST:
            first = Shift(up=float(np.median(differences)), pairs=len(differences))
        slopes, distances, roughness = [np.zeros((0, 2))], [np.zeros(0)], [np.zeros(0)]
        for done, block in enumerate(some, 1):
            before, after = self.old.points(block, 0.0), self.new.points(block, REACH)
            roof = before.xyz[classes_of(before) == BUILDING]
            if len(roof) < FEWEST or not len(after):
                continue
            planes = local_planes(roof, 2.0 * self.radius)
            flat = planar(planes, 2 * SMOOTHEST)
            others = after.xyz - first.vector
            found = nearest_distances(roof[flat], planes.slope[flat], others, self.radius, PAIRED)
            slopes.append(planes.slope[flat])
            distances.append(found)
            roughness.append(planes.rms[flat])
            self.progress("align", done, len(some))
        fitted = fit_shift(np.concatenate(slopes), np.concatenate(distances), MOST_IN_PLAN)
        up = first.up + (fitted.up if fitted.pairs >= FEWEST else 0.0)
        self.shift = replace(fitted, up=up, pairs=fitted.pairs or first.pairs)
        rough = np.concatenate(roughness)
        self.rough = float(np.median(rough)) if len(rough) else SMOOTHEST / SMOOTH
        self.tolerance = max(TOLERANCE, 4.0 * self.shift.noise)

    def face_block(
        self,
        block: Block,
        sites: Sequence[Site],
        site_of: tuple[dict[str, list[int]], dict[str, list[int]]],
        covered: NDArray[np.int64],
        tree: shapely.STRtree,
    ) -> tuple[_Faced, _Faced]:
        """The roof points of both epochs in a block, each faced with the other epoch."""
        before, after = self.old.points(block, REACH), self.new.points(block, REACH)
        moved = after.xyz - self.shift.vector
        core = Bounds(0.0, 0.0, block.side, block.side)
        clouds = ((before, before.xyz), (after, moved))
        near = tree.query(shapely.box(*vars(block.bounds.buffered(REACH)).values()))
        local = {
            int(k): shapely.transform(sites[k].polygon, lambda xy: xy - np.array(block.origin)) for k in near
        }
        self.note_cover(local, clouds, covered, core)
        roofs = [self.roof_points(xyz, cloud, epoch) for epoch, (cloud, xyz) in enumerate(clouds)]
        faced = []
        for epoch, (_, xyz) in enumerate(clouds):
            roof, other = roofs[epoch], roofs[1 - epoch]
            places = xyz[roof.which]
            inside = np.flatnonzero(core.contains(places))
            owner, building = self.owners(places[inside], epoch, block, site_of[epoch], local)
            mine_of = np.flatnonzero((owner >= 0) | roof.flat[inside])
            mine = inside[mine_of]
            usable = ~np.isin(other.classes, NOISE_CLASSES)
            facing = face_points(
                places[mine],
                roof.planes.slope[mine],
                clouds[1 - epoch][1][usable],
                other.classes[usable],
                self.radius,
                self.tolerance,
                self.spacings[1 - epoch] ** -2,
            )
            world = places[mine] + np.array([*block.origin, 0.0])
            faced.append(
                _Faced(
                    world,
                    owner[mine_of],
                    building[mine_of],
                    facing.state,
                    facing.distance,
                    roof.flat[mine],
                    roof.known[mine],
                )
            )
        return faced[0], faced[1]

    def roof_points(self, xyz: Points, cloud: PointCloud, epoch: int) -> _Roof:
        """The points of roofs: those the run found, without walls, and others that lie high on a plane."""
        classes = classes_of(cloud).copy()
        spacing = self.spacings[epoch]
        ground = xyz[classes == GROUND]
        found = classes == BUILDING
        high = ~found & ~np.isin(classes, (GROUND, *NOISE_CLASSES))
        if len(ground):
            some = np.flatnonzero(high)
            _, nearest = cKDTree(ground[:, :2]).query(xyz[some, :2])
            high[some] = xyz[some, 2] - ground[nearest, 2] >= LOWEST_ROOF
        else:
            high[:] = False
        which = np.flatnonzero(found | high)
        which = which[~is_covered(xyz[which], WALL_NEAR, WALL_RISE)]
        planes = local_planes(xyz[which], max(0.75, 2.0 * spacing))
        flat = planar(planes, max(SMOOTHEST, SMOOTH * self.rough)) & (np.hypot(*planes.slope.T) <= STEEPEST)
        kept = found[which] | flat
        which = which[kept]
        classes[which] = BUILDING
        return _Roof(
            which, LocalPlanes(planes.slope[kept], planes.rms[kept]), flat[kept], found[which], classes
        )

    def note_cover(
        self,
        local: dict[int, Polygon],
        clouds: Sequence[tuple[PointCloud, Points]],
        covered: NDArray[np.int64],
        core: Bounds,
    ) -> None:
        """Count for each site the cells in this block, and those in which an epoch has points."""
        cells = round(core.width / COARSE)
        seen = np.zeros((2, cells, cells), bool)
        for epoch, (_, xyz) in enumerate(clouds):
            place = np.floor(xyz[core.contains(xyz), :2] / COARSE).astype(np.int64)
            seen[epoch, place[:, 1], place[:, 0]] = True
        middle = (np.arange(cells) + 0.5) * COARSE
        for k, polygon in local.items():
            wide = polygon.buffer(COARSE / 2)
            west, south, east, north = np.clip(np.array(wide.bounds) / COARSE, 0, cells)
            columns, rows = slice(int(west), int(np.ceil(east))), slice(int(south), int(np.ceil(north)))
            x, y = np.meshgrid(middle[columns], middle[rows])
            if not x.size:
                continue
            inside = shapely.contains_xy(wide, x, y)
            covered[k, 2] += int(inside.sum())
            covered[k, :2] += (seen[:, rows, columns] & inside).sum(axis=(1, 2))

    def owners(
        self, xyz: Points, epoch: int, block: Block, site_of: dict[str, list[int]], local: dict[int, Polygon]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """The site (N,) of each roof point of an epoch and the building, −1 for none: a point beside a
        building of either epoch may belong to a part of it that was not found."""
        owner, of = np.full(len(xyz), -1, np.int64), np.full(len(xyz), -1, np.int64)
        if not len(xyz):
            return owner, of
        west, south, east, north = vars(block.bounds.buffered(REACH)).values()
        buildings = (self.old, self.new)[epoch].buildings
        box = shapely.box(west, south, east, north)
        for number in np.sort(self.trees[epoch].query(box, predicate="intersects")).tolist():
            building = buildings[number]
            mine = shapely.transform(building.polygon, lambda xy: xy - np.array(block.origin)).buffer(
                self.spacings[epoch] / 2
            )
            w, s, e, n = mine.bounds
            near = np.flatnonzero(
                (xyz[:, 0] >= w) & (xyz[:, 0] <= e) & (xyz[:, 1] >= s) & (xyz[:, 1] <= n) & (owner < 0)
            )
            near = near[shapely.contains_xy(mine, xyz[near, 0], xyz[near, 1])]
            of[near] = number
            sites = site_of[building.id]
            if len(sites) == 1:
                owner[near] = sites[0]
                continue
            places = shapely.points(xyz[near, :2])
            away = np.stack([shapely.distance(places, local.get(k, mine)) for k in sites])
            owner[near] = np.array(sites)[np.argmin(away, axis=0)]
        loose = np.flatnonzero(owner < 0)
        if len(loose) and local:
            numbers = np.array(sorted(local))
            places = shapely.points(xyz[loose, :2])
            tree = shapely.STRtree([local[int(k)] for k in numbers])
            which, nearest = tree.query_nearest(places, max_distance=BESIDE_M, all_matches=False)
            owner[loose[which]] = numbers[nearest]
        return owner, of

    def told(self, site: Site, verdict: Verdict, points: tuple[int, int]) -> Change:
        """A judged site, before ids are carried over."""
        volumes = [
            None
            if not side or any(one.row.get("volume_m3") is None for one in side)
            else float(sum(one.row["volume_m3"] for one in side))
            for side in (site.old, site.new)
        ]
        old_ids, new_ids = (tuple(one.id for one in side) for side in (site.old, site.new))
        return Change("", old_ids, new_ids, site.polygon, verdict, points, (volumes[0], volumes[1]))


@dataclass(frozen=True, eq=False)
class _Roof:
    """The roof points of a block: their numbers, planes, whether they are flat; and all points' classes, with
    6 for each of these."""

    which: NDArray[np.int64]
    planes: LocalPlanes
    flat: NDArray[np.bool_]
    known: NDArray[np.bool_]
    classes: NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class _Faced:
    """Roof points (N,) of an epoch with their sites and buildings, and what the other epoch shows there."""

    xyz: Points
    site: NDArray[np.int64]
    building: NDArray[np.int64]
    state: NDArray[np.uint8]
    distance: Values
    flat: NDArray[np.bool_]
    known: NDArray[np.bool_]

    @classmethod
    def join(cls, parts: Sequence[_Faced]) -> _Faced:
        """All the points, by site."""
        dtypes = np.int64, np.int64, np.uint8, np.float64, bool, bool
        nothing = cls(np.zeros((0, 3)), *(np.zeros(0, dtype) for dtype in dtypes))
        names = list(vars(nothing))
        whole = [np.concatenate([getattr(part, name) for part in (nothing, *parts)]) for name in names]
        order = np.argsort(whole[1], kind="stable")
        return cls(*(values[order] for values in whole))

    def by_site(self, count: int, buildings: Sequence[Building], spacing: float) -> list[Side]:
        """The points of each site; each stands for its share of its building's outline."""
        points = np.bincount(self.building[self.building >= 0], minlength=len(buildings))
        areas = np.array([one.polygon.area for one in buildings])
        share = np.clip(areas / np.maximum(points, 1), 0.5 * spacing**2, 2.0 * spacing**2)
        size = np.append(share, spacing**2)[self.building]  # the last is that of no building
        ends = np.searchsorted(self.site, np.arange(count + 1))
        parts = [slice(a, b) for a, b in pairwise(ends)]
        return [
            Side(self.xyz[k], self.state[k], self.distance[k], self.flat[k], self.known[k], size[k])
            for k in parts
        ]


def found_beside(faced: _Faced, spacing: float, epoch: int, rules: Rules, link: float) -> list[Change]:
    """Flat surfaces far from every footprint that came or went: buildings that a run did not find."""
    some = faced.site < 0
    part = [getattr(faced, name)[some] for name in ("xyz", "state", "distance", "flat", "known")]
    xyz, state, distance, flat, known = part
    side = Side(xyz, state, distance, flat, known, np.full(len(xyz), spacing**2))
    whole = replace(rules, smallest_m2=rules.smallest_alone_m2)
    changes = []
    for patch in patches_of(side, came(side), whole, link):
        xy = side.xyz[patch, :2]
        outline = outline_of(xy, spacing)
        if side.area_of(patch) < COMPACT * shapely.convex_hull(outline).area:
            continue
        if is_vehicle(side, patch, rules, link):
            continue
        height = float(abs(np.median(side.distance[patch])))
        kind = (DEMOLISHED, NEW)[epoch]
        area = side.area_of(patch)
        verdict = Verdict(
            kind,
            height_m=height if epoch else -height,
            built_m2=area * epoch,
            gone_m2=area * (1 - epoch),
            volume_m3=float(-(side.distance * side.size)[patch].sum()) * (1 if epoch else -1),
            reason=f"a flat surface {height:.1f} m high, in no footprint of the epoch's run",
            patches=(xy,),
        )
        count = int(patch.sum())
        points = (0, count) if epoch else (count, 0)
        changes.append(Change("", (), (), outline, verdict, points, (None, None)))
    return changes


def outline_of(xy: NDArray[np.float64], spacing: float) -> Polygon | MultiPolygon:
    """The area (world metres) that points (N, 2) cover."""
    wide = max(spacing, 0.5)
    grown = shapely.union_all(shapely.buffer(shapely.points(xy), 1.5 * wide, quad_segs=2))
    return shapely.simplify(shapely.buffer(grown, -wide, quad_segs=2), 0.2)


def classes_of(cloud: PointCloud) -> NDArray[np.uint8]:
    """The classes (N,)."""
    assert cloud.classification is not None
    return cloud.classification


def ground_differences(old: PointCloud, new: PointCloud) -> NDArray[np.float64]:
    """How much higher the new epoch's ground lies (K,) in the cells that both show, those median in each."""
    keys, heights = [], []
    for cloud in (old, new):
        ground = cloud.xyz[classes_of(cloud) == GROUND]
        place = np.floor(ground[:, :2] / COARSE).astype(np.int64)
        key = place[:, 0] * 2**32 + place[:, 1]
        order = np.lexsort((ground[:, 2], key))
        key, z = key[order], ground[order, 2]
        known, first, count = np.unique(key, return_index=True, return_counts=True)
        keys.append(known)
        heights.append(z[first + count // 2])
    _, one, other = np.intersect1d(keys[0], keys[1], assume_unique=True, return_indices=True)
    return np.asarray(heights[1][other] - heights[0][one])


def make_sites(
    old: Sequence[Building], new: Sequence[Building]
) -> tuple[list[Site], dict[str, list[int]], dict[str, list[int]]]:
    """A site for each new building with the old ones at its place, and one for each old one that no new one
    stands for; the sites of each building by its id."""
    before = np.array([one.polygon for one in old], dtype=object)
    after = np.array([one.polygon for one in new], dtype=object)
    pairs = shapely.STRtree(before).query(after, predicate="intersects").T if len(old) and len(new) else []
    partners: dict[int, list[int]] = {}
    for j, i in pairs:
        shared = shapely.intersection(before[i], after[j]).area
        half = OVERLAPPING * min(before[i].area, after[j].area)
        if shared >= half and shared >= min(TOUCHING_M2, half):
            partners.setdefault(int(j), []).append(int(i))
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


def carry_ids(changes: Sequence[Change], sites: Sequence[Site]) -> tuple[Change, ...]:
    """The changes, named: a building keeps the id of the old one with which it shares most, each id once."""
    wanted = []
    for number, site in enumerate(sites):
        for one in site.old:
            shared = shapely.intersection(one.polygon, site.polygon).area
            wanted.append((-float(shared), one.id, number))
    names: dict[int, str] = {}
    taken: set[str] = set()
    for _, name, number in sorted(wanted):
        if number not in names and name not in taken:
            names[number] = name
            taken.add(name)
    named = []
    for number, change in enumerate(changes):
        place = change.polygon.representative_point()
        name = names.get(number) or next(iter(change.new_ids), f"at_{place.x:.0f}_{place.y:.0f}")
        while name in taken and names.get(number) != name:
            name += "-new"
        taken.add(name)
        named.append(replace(change, id=name))
    return tuple(named)
