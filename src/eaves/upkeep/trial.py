"""A run's buildings as edits would leave them, modelled in a copy of its results before files are written."""

from __future__ import annotations

import shutil
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import shapely

from eaves.buildings.building_file import SavedBuilding, SavedBuildings
from eaves.flow.refusals import EDITS, LAYER
from eaves.flow.region import ensure_points, open_region
from eaves.flow.run import Progress, no_progress
from eaves.flow.step import Region
from eaves.model import Block, BuildingModel, CoordinateSystem
from eaves.pipeline import hold_folder
from eaves.run.keys import EDITED
from eaves.run.store import WORK
from eaves.upkeep.corrected import Corrected, changed_in_layer, correct, kept_edits, outlines_in
from eaves.upkeep.edits import Edit, StatedFace, write_edits
from eaves.upkeep.kept import link_results, open_again, read_request
from eaves.upkeep.update import compute_again

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

    @property
    def system(self) -> CoordinateSystem:
        """The reference system of the run."""
        return self.region.store.system

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
        self.region.ensured.pop(EDITED, None)  # what was asked for before may be asked for again
        return correct(self.region, edits)

    def outlines(self) -> dict[str, shapely.Polygon]:
        """Id → outline (world metres) of the buildings as they are now."""
        return outlines_in(SavedBuildings(self.region.store), self.region.run.side)

    def changed(self, owners: Collection[Block]) -> dict[str, SavedBuilding | None]:
        """The buildings that blocks own and that are others than when this was last asked; None for those
        that went."""
        changed: dict[str, SavedBuilding | None] = {}
        now = SavedBuildings(self.region.store)
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
        now, side = SavedBuildings(self.region.store), self.region.run.side
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
        Folder of `eaves build`; of a run without `keep` all is computed again.
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
            else:
                region.store.discard()
            region.store = replace(region.store, folder=place, persistent=True)
            if not kept:
                region.store.prepare()
                compute_again(region, folder)
            ensure_points(region)
            shown = SavedBuildings(region.store)
            trial = Trial(folder, region, outlines_in(shown, run.side))
            trial.last = {owner: contents_of(shown.saved(owner)) for owner in shown.owners(run.side)}
            yield trial
        finally:
            shutil.rmtree(place, ignore_errors=True)
