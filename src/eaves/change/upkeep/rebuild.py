"""Corrections: only the buildings that edits are of are modelled again, from what the run kept."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from shapely import Polygon

from eaves.buildings.building_file import Kept, as_found
from eaves.change.edits import Edit, edits_of_layer, read_edits, settle, write_edits
from eaves.change.upkeep.corrected import correct, outlines_in, overlaps
from eaves.change.upkeep.kept import open_kept
from eaves.flow.classified_points import known_copies
from eaves.flow.collisions import EDITS
from eaves.flow.numbers import keep_numbers, numbers_of_owners
from eaves.flow.outputs import write_outputs
from eaves.flow.region import kept_region
from eaves.flow.run import Progress, no_progress
from eaves.model.summary import Summary
from eaves.pipeline import hold_folder
from eaves.run.manifest import end_manifest, is_changed, known_files
from eaves.run.store import Store

LAYER = "footprints.gpkg"
"""The file of a run whose layer of footprints takes edits."""
WRITTEN = ("footprints", "models", "mask", "classified")
"""The outputs that edits change."""


@dataclass(frozen=True, eq=False)
class Rebuilt:
    """The result of a rebuild."""

    summary: Summary
    edits: tuple[Edit, ...]
    modelled: tuple[str, ...]
    """Ids of the buildings that were modelled again."""
    removed: tuple[str, ...]
    failed: tuple[str, ...]
    """Edits that gave no model, with the reason."""
    conflicts: tuple[str, ...]

    def as_text(self) -> str:
        """The closing lines."""
        lines = [
            f"{len(self.edits)} edits: {len(self.modelled)} buildings modelled again, "
            f"{len(self.removed)} removed"
        ]
        lines += [f"conflict: {words}" for words in self.conflicts]
        lines += [f"no model: {words}" for words in self.failed]
        return "\n".join(lines)


def rebuild(folder: Path, file: Path | None = None, progress: Progress = no_progress) -> Rebuilt:
    """Remodel the edited buildings of a run, and rewrite its vector files.

    Parameters
    ----------
    folder
        Folder of `eaves build --keep`. Edits are those kept in its edits.gpkg, what was changed in its
        footprints.gpkg, and those of `file`.
    file
        More edits: polygons with a field `verdict`, and `id` where they are of a known building.
    progress
        Called with the step, how much of it is done, and how much there is.

    Raises
    ------
    InputError
        When the folder keeps no parts, an input has changed, or an edit cannot be read; nothing changes then.
    """
    folder = Path(folder)
    run = open_kept(folder)
    with hold_folder(run) as workers:
        region = kept_region(run, workers, progress)
        store, side = region.store, run.side
        shown, found = outlines_in(Kept(store), side), outlines_in(as_found(store), side)
        numbers = numbers_of_owners(store, Kept(store).owners(side))
        edits = [*kept_edits(folder, store), *changed_in_layer(folder, store, shown)]
        if file is not None:
            edits += read_edits(file, store.system, {**found, **shown})
        orders, conflicts = settle(edits, found)
        done = correct(region, orders)
        conflicts += overlaps(orders, outlines_in(Kept(store), side))
        keep_numbers(store, sorted(done.touched), numbers)
        before = known_files(folder)
        region.run = run.with_options(outputs=[name for name in WRITTEN if name in run.outputs])
        summary = write_outputs(region, Kept(store).owners(side), copies=known_copies(folder, store))
        write_edits(folder / EDITS, edits, store.system)
        rasters = [folder / name for name in before if name.endswith(".tif") and (folder / name).exists()]
        files = dict.fromkeys([*summary.files, *rasters, folder / EDITS])
        end_manifest(folder, list(files), summary.complete, edits=len(edits))
        return Rebuilt(
            summary,
            tuple(edits),
            tuple(done.modelled),
            tuple(done.removed),
            tuple(done.failed),
            tuple(conflicts),
        )


def kept_edits(folder: Path, store: Store) -> list[Edit]:
    """The edits that a run's folder keeps."""
    path = folder / EDITS
    return list(read_edits(path, store.system)) if path.exists() else []


def changed_in_layer(folder: Path, store: Store, shown: dict[str, Polygon]) -> list[Edit]:
    """The changes of a user in the run's footprints.gpkg, where it is not as the run wrote it."""
    path, entry = folder / LAYER, known_files(folder).get(LAYER)
    if not path.exists() or not entry or not is_changed(path, entry):
        return []
    return edits_of_layer(path, store.system, shown)
