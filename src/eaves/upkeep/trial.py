"""A run's buildings as edits would leave them, modelled in a copy of its results before files are written."""

from __future__ import annotations

import shutil
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import shapely

from eaves.buildings.building_file import SavedBuilding
from eaves.flow.corrected import Corrected, changed_in_layer, correct, kept_edits, outlines_in
from eaves.flow.edits import IS_BUILDING, Edit, StatedFace, divided, write_edits
from eaves.flow.refusals import EDITS, LAYER
from eaves.flow.region import Region, ensure_points, model_plans, open_region
from eaves.flow.run import Progress, no_progress
from eaves.flow.tiles import Area
from eaves.formats import read_polygons
from eaves.model import Block, Bounds, BuildingModel, CoordinateSystem
from eaves.model.block import ring, squares_touching
from eaves.pipeline import find_plans, hold_folder
from eaves.run.keys import BUILDINGS, EDITED, NAMED
from eaves.run.manifest import is_changed, known_files, read_facts
from eaves.run.store import WORK
from eaves.upkeep.update import compute_again, link_results, open_again, read_request

TRIAL = ".eaves-edit"
"""The folder, in that of a run, of the results of edits that are tried; it goes when they end."""


@dataclass(eq=False)
class Trial:
    """Edits tried on the buildings of a run; the folder stays the run's until `update` carries them out.

    Examples
    --------
    >>> from eaves.upkeep import open_trial
    >>> with open_trial("out") as trial:                                  # doctest: +SKIP
    ...     trial.correct(trial.kept())
    """

    folder: Path
    region: Region
    written: dict[str, shapely.Polygon]
    """Id → outline (world metres) of the buildings, as the run's files show them."""
    last: dict[Block, dict[str, bytes]] = field(default_factory=dict)
    saved: Sequence[Edit] | None = None
    """Of a run that kept nothing, the edits that its files show: its blocks are computed when a building in
    them is asked for. None where the buildings of all blocks are there."""
    reached: set[Block] = field(default_factory=set)
    known: set[str] = field(default_factory=set)
    """The blocks computed so, and the written buildings that their owners show."""
    now: Sequence[Edit] = ()
    """The edits that were carried out last."""

    @property
    def system(self) -> CoordinateSystem:
        """The reference system of the run."""
        return self.region.system

    def kept(self) -> list[Edit]:
        """The edits that the folder keeps."""
        return kept_edits(self.folder, self.system)

    def from_layer(self) -> list[Edit]:
        """Those made in its layer of footprints since that was written."""
        return changed_in_layer(self.folder, self.system, self.written)

    def keep(self, edits: Sequence[Edit]) -> list[Edit]:
        """Write edits into the folder's file of them, whole or not at all; the edits as it has them."""
        write_edits(self.folder / EDITS, edits, self.system)
        return self.kept()

    def state(self) -> tuple[tuple[int, int], ...]:
        """What changes when another program writes the edits or the layer."""
        paths = [self.folder / name for name in (EDITS, LAYER, f"{LAYER}-wal")]
        stats = [path.stat() if path.exists() else None for path in paths]
        return tuple((stat.st_mtime_ns, stat.st_size) if stat else (0, 0) for stat in stats)

    def correct(self, edits: Sequence[Edit]) -> Corrected:
        """Carry out all edits in the copy of the results, and take back what is edited no more."""
        self.now = edits
        if self.saved is not None:
            before, after = ({mark_of(edit): edit for edit in some} for some in (self.saved, edits))
            changed = [{**before, **after}[mark] for mark in before.keys() ^ after.keys()]
            self.reach([edit.id for edit in changed], [edit.polygon for edit in changed])
        return self.carry_out(edits)

    def carry_out(self, edits: Sequence[Edit]) -> Corrected:
        """Carry out those of some edits whose buildings are there."""
        self.region.ensured.pop(EDITED, None)  # what was asked for before may be asked for again
        if self.saved is not None:
            there, fresh = self.found(), {edit.id for edit in edits if edit.verdict == IS_BUILDING}
            edits = [
                edit
                for edit in edits
                if divided(edit.id, there)
                or (
                    (edit.id in fresh or not divided(edit.id, self.written))
                    and self.touched([edit.polygon]) & self.reached
                )
            ]
        return correct(self.region, edits)

    def reach(self, names: Iterable[str], shapes: Iterable[shapely.Geometry] = ()) -> None:
        """Compute the blocks that some buildings and shapes lie in where they are not yet, and those around
        until the blocks that own the buildings are among them."""
        if self.saved is None:
            return
        drawn = {edit.id for edit in self.saved if edit.verdict == IS_BUILDING}
        wanted = {stem for name in names if (stem := divided(name, self.written))} - drawn
        more = self.touched([*(self.written[name] for name in wanted), *shapes]) - self.reached
        if not more:
            return
        everywhere = self.touched(self.written.values()) | more
        while more:
            model_plans(self.region, find_plans(self.region, Area(tuple(sorted(more)))))
            self.reached |= more
            there, near = self.found(), {one for block in self.reached for one in ring(block)}
            missing = not all(divided(name, there) for name in wanted)
            more = (near & everywhere) - self.reached if missing else set()
        self.carry_out(self.saved)
        shown, side = self.region.buildings, self.region.run.side
        for owner in set(shown.owners(side)) - self.last.keys():
            self.last[owner] = contents_of(shown.saved(owner))
            self.known |= self.last[owner].keys()
        self.carry_out(self.now)

    def found(self) -> dict[str, shapely.Polygon]:
        """Id → outline of the buildings that are there, as they were found."""
        return outlines_in(self.region.buildings.only(NAMED, BUILDINGS), self.region.run.side)

    def touched(self, shapes: Iterable[shapely.Geometry]) -> set[Block]:
        """The blocks that shapes (world metres) reach into."""
        side = self.region.run.side
        return {block for shape in shapes for block in squares_touching(Bounds(*shape.bounds), side)}

    def outlines(self) -> dict[str, shapely.Polygon]:
        """Id → outline (world metres) of the buildings as they are now."""
        written = {} if self.saved is None else self.written
        kept = {name: outline for name, outline in written.items() if name not in self.known}
        return {**kept, **outlines_in(self.region.buildings, self.region.run.side)}

    def changed(self, owners: Collection[Block]) -> dict[str, SavedBuilding | None]:
        """The buildings that blocks own and that are others than when this was last asked; None for those
        that went."""
        changed: dict[str, SavedBuilding | None] = {}
        now = self.region.buildings
        for owner in sorted(owners):
            before = self.last.get(owner, {})
            saved = now.saved(owner)
            self.last[owner] = contents_of(saved)
            changed |= dict.fromkeys(before.keys() - self.last[owner].keys())
            for building in saved:
                name = str(building.row.values["id"])
                if self.last[owner][name] != before.get(name):
                    changed[name] = building
        return changed

    def buildings(self, names: Collection[str]) -> dict[str, SavedBuilding | None]:
        """Buildings by their ids as they are now; None where there is none."""
        self.reach(names)
        now, side = self.region.buildings, self.region.run.side
        found: dict[str, SavedBuilding | None] = dict.fromkeys(names)
        for owner in now.owners(side) if names else ():
            for building in now.saved(owner):
                name = str(building.row.values["id"])
                if name in found:
                    found[name] = building
        return found

    def faces(self, name: str) -> list[StatedFace]:
        """The faces (world metres) of a building's roof as it is now; none of one without a model."""
        saved = self.buildings([name])[name]
        outcome = None if saved is None else saved.result.outcome
        if not isinstance(outcome, BuildingModel):
            return []
        planes = [plane for plane in outcome.planes if plane.polygon is not None]
        return [StatedFace.of(plane, outcome.footprint.origin) for plane in planes]


def mark_of(edit: Edit) -> tuple[object, ...]:
    """What tells an edit from others."""
    return edit.action, edit.verdict, edit.id, edit.value, edit.plane, edit.polygon.wkb


def written_outlines(folder: Path, system: CoordinateSystem) -> dict[str, shapely.Polygon]:
    """Id → outline (world metres) of the buildings in a run's layer, where that is as the run wrote it; none
    where it is not, or where there is no layer."""
    path, entry = folder / LAYER, known_files(folder).get(LAYER)
    if not path.exists() or not entry or is_changed(path, entry):
        return {}
    polygons, _, rows, _ = read_polygons(path, "footprints", target=system)
    return {str(row["id"]): polygon for polygon, row in zip(polygons, rows, strict=True)}


def contents_of(buildings: Sequence[SavedBuilding]) -> dict[str, bytes]:
    """Id → what a file says of a building."""
    return {str(building.row.values["id"]): building.answers.items[building.number] for building in buildings}


@contextmanager
def open_trial(
    folder: str | Path, jobs: int = 1, progress: Progress = no_progress, methods: Collection[str] = ()
) -> Iterator[Trial]:
    """A run's folder held for edits that are tried, until the block ends.

    Parameters
    ----------
    folder : str or Path
        Folder of `eaves build`; of a run without `keep` the blocks of what is edited are computed again, or
        all where its layer of footprints is not there as it was written, and where footprints were given.
    jobs : int
        Processes.
    progress : callable
        Called with the step, how much of it is done, and how much there is.
    methods : collection of str
        Methods of the run (`module:Class`) that no installed package brings, and that are to be imported.

    Raises
    ------
    InputError
        When the folder holds no run, another run holds it, or an input has changed.
    """
    folder = Path(folder)
    kept = read_request(folder).keep
    run = open_again(folder, jobs=jobs, methods=methods)
    place = folder / TRIAL
    with hold_folder(run) as workers:
        shutil.rmtree(place, ignore_errors=True)
        try:
            region = open_region(run, workers, progress)
            if kept:
                link_results(folder / WORK, place)
            region.move_to(place)
            written, saved = {}, None
            if not kept and run.given is None:
                written = written_outlines(folder, region.system)
            if written:
                region.within = set()
                saved = kept_edits(folder, region.system)[: read_facts(folder).get("edits", 0)]
            elif not kept:
                compute_again(region, folder)
            if not written:
                ensure_points(region)
            shown = region.buildings
            trial = Trial(folder, region, written or outlines_in(shown, run.side), saved=saved)
            trial.last = {owner: contents_of(shown.saved(owner)) for owner in shown.owners(run.side)}
            yield trial
        finally:
            shutil.rmtree(place, ignore_errors=True)
