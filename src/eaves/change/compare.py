"""Two epochs of a place compared: what became of each building.

```
two folders ─→ points by block ─→ shift of the new epoch ─→ roof points faced ─→ verdicts ─→ files
               of each epoch       from what is the same     with the other's     a building
               epoch.py            measure.py, shift.py      faced.py, surface.py verdict.py  output.py
```

Models are not compared: a footprint that one run drew wider, or a house that it merged with its neighbour,
is no change. The points decide.
"""

from __future__ import annotations

import logging
import shutil
import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from eaves.change.epoch import Epoch, open_epoch
from eaves.change.faced import (
    REACH,
    Faced,
    Site,
    by_site,
    carry_ids,
    found_beside,
    make_sites,
    measure_epochs,
    roof_points,
)
from eaves.change.output import as_text, write_change_page, write_comparison
from eaves.change.surface import face_points
from eaves.change.verdict import BuildingChange, ChangeRules, Comparison, Verdict, judge_building
from eaves.figures import PARTY_GAP
from eaves.flow import STRIP_CELL, Progress, claim, no_progress
from eaves.formats import InputError, report_full_disk
from eaves.geometry import edges_of, members, points_in_polygons
from eaves.model import Block, Bounds, PointCloud, Points
from eaves.pipeline import build
from eaves.run import MANIFEST, RunOptions, begin_manifest, end_manifest, lock_folder

log = logging.getLogger("eaves")

BESIDE_M = 1.5
"""Largest distance (m) of a part that no run found from its building."""


def compare(
    old: str | Path,
    new: str | Path,
    work: str | Path | None = None,
    progress: Progress = no_progress,
    rules: ChangeRules | None = None,
) -> Comparison:
    """The change of every building between the runs in two folders.

    Parameters
    ----------
    old, new : str or Path
        Folder of `eaves build` for each epoch.
    work : str, Path or None
        Folder for the points by block, which are removed; None for the system's temporary folder.
    progress : callable
        Called with the step, how much of it is done, and how much there is.
    rules : ChangeRules or None
        From what size on a difference is a change; None for the defaults.

    Returns
    -------
    Comparison
        The change of each building, and the shift between the epochs.

    Raises
    ------
    InputError
        When a folder holds no complete run, or the systems cannot be brought together.

    Examples
    --------
    >>> import eaves
    >>> comparison = eaves.compare("run-2020", "run-2025")                # doctest: +SKIP
    >>> comparison.counts                                                 # doctest: +SKIP
    {'unchanged': 152, 'new': 2}
    """
    if work is not None:
        Path(work).mkdir(parents=True, exist_ok=True)
    place = Path(tempfile.mkdtemp(prefix="compare-", dir=work))
    try:
        epochs: list[Epoch] = []
        for name, folder in (("old", Path(old)), ("new", Path(new))):
            target = epochs[0].system if epochs else None
            epochs.append(open_epoch(folder, place / name, target, partial(progress, f"read {name}")))
        return Comparer(epochs[0], epochs[1], rules or ChangeRules(), progress).compare()
    finally:
        shutil.rmtree(place, ignore_errors=True)


class Comparer:
    """The comparison of two opened epochs, step by step."""

    def __init__(self, old: Epoch, new: Epoch, rules: ChangeRules, progress: Progress) -> None:
        self.old, self.new, self.rules, self.progress = old, new, rules, progress
        both = sorted(set(old.blocks()) & set(new.blocks()))
        self.measured = measure_epochs(old, new, both, progress)
        self.all_blocks = sorted(set(old.blocks()) | set(new.blocks())) or [Block(0, 0)]  # without points
        self.trees = [shapely.STRtree([one.polygon for one in epoch.buildings]) for epoch in (old, new)]

    def compare(self) -> Comparison:
        """All steps."""
        sites, old_site, new_site = make_sites(self.old.buildings, self.new.buildings)
        parts: list[list[Faced]] = [[], []]
        covered = np.zeros((len(sites), 3), np.int64)
        polygons = [site.polygon for site in sites]
        tree = shapely.STRtree(polygons)
        for done, block in enumerate(self.all_blocks, 1):
            for epoch, faced in enumerate(self.face_block(block, sites, (old_site, new_site), covered, tree)):
                parts[epoch].append(faced)
            self.progress("compare", done, len(self.all_blocks))
        changes = self.judge(sites, parts, covered)
        named = carry_ids(changes, sites)
        return Comparison(
            self.old, self.new, named, self.measured.shift, self.measured.tolerance, self.measured.spacings
        )

    def judge(
        self, sites: Sequence[Site], parts: Sequence[Sequence[Faced]], covered: NDArray[np.int64]
    ) -> list[BuildingChange]:
        """The change of each site, and of surfaces in none, from the faced points of both epochs."""
        changes = []
        spacings = self.measured.spacings
        faced = [
            by_site(some, len(sites), epoch.buildings, spacing)
            for some, epoch, spacing in zip(parts, (self.old, self.new), spacings, strict=True)
        ]
        link = max(1.5, 2.5 * max(spacings))
        for number, site in enumerate(sites):
            before, after = (sides[number] for sides, _ in faced)
            enough = covered[number, :2] >= self.rules.least_seen * max(int(covered[number, 2]), 1)
            seen = bool(enough[0]), bool(enough[1])
            outlined = bool(site.old), bool(site.new)
            score = None if all(outlined) else (site.old or site.new)[0].row.get("score")
            verdict = judge_building(
                before, after, self.rules, seen, link, outlined, self.is_attached(site), score
            )
            changes.append(self.words(site, verdict, (len(before), len(after))))
        for epoch, ((_, beside), spacing) in enumerate(zip(faced, spacings, strict=True)):
            changes += found_beside(beside, spacing, epoch, self.rules, link)
        return changes

    def is_attached(self, site: Site) -> bool:
        """True if a run has another building that touches those of a site."""
        return any(
            len(tree.query(one.polygon, "dwithin", PARTY_GAP)) > len(here)
            for tree, here in zip(self.trees, (site.old, site.new), strict=True)
            for one in here
        )

    def face_block(
        self,
        block: Block,
        sites: Sequence[Site],
        site_of: tuple[dict[str, list[int]], dict[str, list[int]]],
        covered: NDArray[np.int64],
        tree: shapely.STRtree,
    ) -> tuple[Faced, Faced]:
        """The roof points of both epochs in a block, each faced with the other epoch."""
        before, after = self.old.points(block, REACH), self.new.points(block, REACH)
        moved = after.xyz - self.measured.shift.vector
        core = Bounds(0.0, 0.0, block.side, block.side)
        clouds = ((before, before.xyz), (after, moved))
        near = tree.query(shapely.box(*block.bounds.buffered(REACH)))
        local = {
            int(k): shapely.transform(sites[k].polygon, lambda xy: xy - np.array(block.origin)) for k in near
        }
        self.note_cover(local, clouds, covered, core)
        roofs = [roof_points(xyz, cloud, self.measured.rough, self.rules.lowest) for cloud, xyz in clouds]
        faced = []
        for epoch, (_, xyz) in enumerate(clouds):
            roof, other = roofs[epoch], roofs[1 - epoch]
            places = xyz[roof.which]
            inside = np.flatnonzero(core.contains(places))
            owner, building = self.owners(places[inside], epoch, block, site_of[epoch], local)
            mine_of = np.flatnonzero((owner >= 0) | roof.flat[inside])
            own = inside[mine_of]
            usable = np.flatnonzero(~clouds[1 - epoch][0].noise)
            state, distance = face_points(
                places[own],
                roof.slope[own],
                clouds[1 - epoch][1].take(usable, axis=0),
                other.classes.take(usable),
                self.measured.radius,
                self.measured.tolerance,
            )
            world = places[own] + np.array([*block.origin, 0.0])
            seen = (world, state, distance, roof.flat[own], roof.known[own], roof.height[own])
            faced.append((owner[mine_of], building[mine_of], *seen))
        return faced[0], faced[1]

    def note_cover(
        self,
        local: dict[int, Polygon],
        clouds: Sequence[tuple[PointCloud, Points]],
        covered: NDArray[np.int64],
        core: Bounds,
    ) -> None:
        """Count for each site the cells in this block, and those in which an epoch has points."""
        cells = round(core.width / STRIP_CELL)
        seen = np.zeros((2, cells, cells), bool)
        for epoch, (_, xyz) in enumerate(clouds):
            place = np.floor(xyz[core.contains(xyz), :2] / STRIP_CELL).astype(np.int64)
            seen[epoch, place[:, 1], place[:, 0]] = True
        middle = (np.arange(cells) + 0.5) * STRIP_CELL
        for k, polygon in local.items():
            wide = polygon.buffer(STRIP_CELL / 2)
            west, south, east, north = np.clip(np.array(wide.bounds) / STRIP_CELL, 0, cells)
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
        buildings = (self.old, self.new)[epoch].buildings
        box = shapely.box(*block.bounds.buffered(REACH))
        around = np.sort(self.trees[epoch].query(box, predicate="intersects"))
        outlines = shapely.transform(
            np.array([buildings[number].polygon for number in around], object),
            lambda xy: xy - np.array(block.origin),
        )
        grown = shapely.buffer(outlines, self.measured.spacings[epoch] / 2)
        parts, outline = shapely.get_parts(grown, return_index=True)
        point, part = points_in_polygons(xyz, *edges_of(parts), len(parts))
        point, first = np.unique(point, return_index=True)  # of several the first
        place = outline[part[first]]
        of[point] = around[place]
        for k, members_of in enumerate(members(place, len(around))):
            near, sites = point[members_of], site_of[buildings[around[k]].id]
            if len(sites) == 1:
                owner[near] = sites[0]
                continue
            places = shapely.points(xyz[near, :2])
            away = np.stack([shapely.distance(places, local.get(site, grown[k])) for site in sites])
            owner[near] = np.array(sites)[np.argmin(away, axis=0)]
        loose = np.flatnonzero(owner < 0)
        if len(loose) and local:
            numbers = np.array(sorted(local))
            places = shapely.points(xyz[loose, :2])
            tree = shapely.STRtree([local[int(k)] for k in numbers])
            within = np.unique(tree.query(places, "dwithin", BESIDE_M)[0])
            which, nearest = tree.query_nearest(places[within], all_matches=False)
            owner[loose[within[which]]] = numbers[nearest]
        return owner, of

    def words(self, site: Site, verdict: Verdict, points: tuple[int, int]) -> BuildingChange:
        """A judged site, before ids are carried over."""
        volumes = [
            None
            if not side or any(one.row.get("volume_m3") is None for one in side)
            else float(sum(one.row["volume_m3"] for one in side))
            for side in (site.old, site.new)
        ]
        old_ids, new_ids = (tuple(one.id for one in side) for side in (site.old, site.new))
        return BuildingChange("", old_ids, new_ids, site.polygon, verdict, points, (volumes[0], volumes[1]))


WANTED = ("footprints", "models", "rasters", "classified")
"""The outputs of a scan that is built first."""


def run_comparison(
    old: Path, new: Path, out: Path, crs: str | None, jobs: int, progress: Callable[[str, int, int], None]
) -> tuple[str, bool]:
    """Compare and write; the closing lines, and whether everything that was built first is whole."""
    for path in (old, new):
        if not path.exists():
            raise InputError.about(path, "does not exist", "give the folder of a run, or a scan")
    if old.resolve() == new.resolve():
        raise InputError.about(old, "is given as both epochs", "give two")
    if out.resolve() in (old.resolve(), new.resolve()):
        raise InputError.about(out, "is the folder of an epoch", "choose another with -o")
    claim(out)
    whole = True
    folders = []
    for name, path in (("old", old), ("new", new)):
        folder = path
        if not (path / MANIFEST).exists():
            log.info("%s: is a scan and is built first, into %s", path, out / name)
            options = RunOptions(crs=crs, jobs=jobs, outputs=WANTED, resume=True)
            summary = build(path, out / name, progress=progress, allow_failures=True, **options)
            whole &= summary.complete
            folder = out / name
        folders.append(folder)
    with lock_folder(out), report_full_disk(out):
        comparison = compare(folders[0], folders[1], out, progress)
        begin_manifest(out)
        paths = write_comparison(comparison, out)
        paths.append(write_change_page(comparison, out))
        end_manifest(out, paths, whole, command="compare")
    return f"{as_text(comparison)}\npage: {paths[-1]}", whole
