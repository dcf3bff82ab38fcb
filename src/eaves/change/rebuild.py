"""Corrections: only the buildings that edits are of are modelled again, from the parts that the run kept."""

from __future__ import annotations

import logging
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import shapely
from shapely import Polygon

from eaves.change.edits import EDITS, Edit, Order, edits_of_layer, read_edits, settle, write_edits
from eaves.change.kept import MODELS, open_kept, read_request, write_request
from eaves.change.versions import version_of
from eaves.formats.atomic import report_full_disk
from eaves.model import Block, BuildingModel, Failure, Footprint
from eaves.model.results import BuildingResult
from eaves.model.summary import Summary
from eaves.run.building import building_pass
from eaves.run.building_file import SavedBuilding, Section, read_section
from eaves.run.classified_points import EarlierPoints
from eaves.run.earlier_lines import EarlierLines
from eaves.run.gather import Gatherer
from eaves.run.join import BuildingPlan, OwnedBuildings, about, block_of
from eaves.run.lock import lock_folder
from eaves.run.manifest import end_manifest, entry_of, known_files
from eaves.run.numbers import keep_numbers, numbers_in
from eaves.run.outputs import write_outputs
from eaves.run.recipe import Recipe
from eaves.run.region import Region
from eaves.run.rows import BuildingRow
from eaves.run.run import Progress, no_progress
from eaves.run.store import Store
from eaves.run.workers import Workers

log = logging.getLogger("eaves")

LAYER = "footprints.gpkg"
"""The file of a run whose layer of footprints takes edits."""

ORIGINALS = "originals"
"""Folder, beside the buildings of a kept run, of those parts as the run found them before any edit."""

OVERLAP_M2 = 1.0
"""An edited outline that covers more of a neighbour than this (m²) is told."""


class RememberingStore(Store):
    """A store that decodes each part once: everything a few buildings take is decoding the others."""

    def section(self, owner: Block, name: str) -> Section:
        """A section of the file of an owner block's buildings."""
        key = (*stamp_of(self.path("buildings", owner)), name)
        if key not in REMEMBERED:
            REMEMBERED[key] = read_section(self.path("buildings", owner), name, keeps=True)
        return REMEMBERED[key]

    def save_buildings(
        self, owner: Block, results: Sequence[BuildingResult | SavedBuilding]
    ) -> dict[str, Section]:
        """Keep the buildings owned by one block, and remember them."""
        sections = super().save_buildings(owner, results)
        stamp = stamp_of(self.path("buildings", owner))
        REMEMBERED.update({(*stamp, name): section for name, section in sections.items()})
        return sections


def stamp_of(path: Path) -> tuple[int, int]:
    """What tells a file from all others, whatever its name, for runs share parts, and from itself before."""
    state = path.stat()
    return state.st_ino, state.st_mtime_ns


REMEMBERED: dict[tuple[int, int, str], Section] = {}
"""What was decoded of parts, by file, time and section."""


@dataclass(frozen=True, eq=False)
class Rebuilt:
    """What a rebuild did."""

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
        lines += [f"conflict: {told}" for told in self.conflicts]
        lines += [f"no model: {told}" for told in self.failed]
        return "\n".join(lines)


def rebuild(folder: Path, file: Path | None = None, progress: Progress = no_progress) -> Rebuilt:
    """Model the edited buildings of a run again, and write its vector files anew.

    Parameters
    ----------
    folder
        What `eaves build --keep` wrote. Edits are those kept in its edits.gpkg, what was changed in its
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
    REMEMBERED.clear()
    run = open_kept(folder)
    with lock_folder(folder), report_full_disk(folder), Workers() as workers:
        region = Region(run, run.work_folder, workers, progress)
        request = read_request(folder)
        region.store = RememberingStore(**vars(region.store))
        state = State(region.store, request.blocks, request.owners, run.recipe)
        before, found = state.shown(), state.found()
        numbers = numbers_in(region.store, request.owners)
        edits = list(read_edits(folder / EDITS, region.store.system)) if (folder / EDITS).exists() else []
        edits += changed_in_layer(folder, region.store, before)
        if file is not None:
            edits += read_edits(file, region.store.system, {**found, **before})
        others = {*state.edited(), *(found.keys() - before.keys())}
        orders, conflicts = settle(edits, found)
        modelled, removed, failed = state.apply(orders, progress)
        conflicts += state.overlaps(orders)
        owners = state.owners
        others |= {*modelled, *removed, *(order.id for order in orders)}
        places = [one[name] for one in (before, state.shown()) for name in others if name in one]
        lines = EarlierLines.read(folder / MODELS, others, places)
        earlier = known_files(folder)
        outputs = tuple(
            name for name in ("footprints", "models", "mask", "classified") if name in run.outputs
        )
        region.run = run.with_options(outputs=outputs)
        plans = [OwnedBuildings(owner, ()) for owner in owners]
        keep_numbers(region.store, sorted(state.touched), numbers)
        points = EarlierPoints.of(folder, region.store, run.index)
        summary = write_outputs(region, request.blocks, plans, earlier=lines, points=points)
        write_edits(folder / EDITS, edits, region.store.system)
        write_request(region.store, replace(request, owners=tuple(owners)))
        kept = [folder / name for name in earlier if name.endswith(".tif") and (folder / name).exists()]
        files = dict.fromkeys([*summary.files, *kept, folder / EDITS])
        about_run = {**summary.about, "edits": len(edits)}
        end_manifest(folder, list(files), about_run, summary.complete)
        return Rebuilt(
            summary, tuple(edits), tuple(modelled), tuple(removed), tuple(failed), tuple(conflicts)
        )


def changed_in_layer(folder: Path, store: Store, shown: dict[str, Polygon]) -> list[Edit]:
    """What a user changed in the run's footprints.gpkg, where it is not as the run wrote it."""
    return edits_of_layer(folder / LAYER, store.system, shown) if is_edited(folder) else []


def is_edited(folder: Path) -> bool:
    """Whether a run's footprints.gpkg is not as the run wrote it."""
    path = folder / LAYER
    entry = known_files(folder).get(LAYER)
    return path.exists() and bool(entry) and entry_of(path) != entry


class State:
    """The buildings of a kept run, as found and as they are after edits."""

    def __init__(
        self, store: Store, blocks: Sequence[Block], owners: Sequence[Block], recipe: Recipe
    ) -> None:
        self.store, self.blocks, self.owners, self.recipe = store, set(blocks), list(owners), recipe
        self.originals = replace(store, folder=store.folder / ORIGINALS)
        (self.originals.folder / "buildings").mkdir(parents=True, exist_ok=True)
        self.side = self.owners[0].side if self.owners else 240.0
        self.touched = set[Block]()
        """The owner blocks that `apply` has written."""

    def shown(self) -> dict[str, Polygon]:
        """Id → outline (world metres) of the buildings as the files show them."""
        return {str(row.values["id"]): row.polygon for row in self.store.building_rows(self.owners)}

    def edited(self) -> set[str]:
        """Ids of the buildings that bear an edit."""
        rows = self.store.building_rows(self.owners)
        return {str(row.values["id"]) for row in rows if row.values.get("edit")}

    def as_found(self, owner: Block) -> Store:
        """The store that holds an owner block's buildings as the run found them."""
        return self.originals if self.originals.has("buildings", owner) else self.store

    def as_found_rows(self) -> Iterator[BuildingRow]:
        """What is told of the buildings as the run found them."""
        for owner in self.owners:
            if self.originals.has("buildings", owner) or not self.is_added(owner):
                yield from self.as_found(owner).building_rows([owner])

    def found(self) -> dict[str, Polygon]:
        """Id → outline (world metres) of the buildings as the run found them, failures among them."""
        self.home: dict[str, Block] = {}
        outlines: dict[str, Polygon] = {}
        for owner in self.owners:
            if self.originals.has("buildings", owner) or not self.is_added(owner):
                for row in self.as_found(owner).building_rows([owner]):
                    outlines[str(row.values["id"])] = row.polygon
                    self.home[str(row.values["id"])] = owner
        return outlines

    def is_added(self, owner: Block) -> bool:
        """Whether edits alone gave an owner block its buildings."""
        return (self.originals.folder / f"{owner.name}.added").exists()

    def apply(self, orders: Sequence[Order], progress: Progress) -> tuple[list[str], list[str], list[str]]:
        """Carry out all orders; ids modelled, ids removed, and what gave no model."""
        mine: dict[Block, list[Order]] = {}
        for order in orders:
            outline = order.outlines[0] if order.outlines else None
            owner = self.home.get(order.id)
            if owner is None:
                assert outline is not None
                owner = block_of(Footprint(outline), self.side)
            mine.setdefault(owner, []).append(order)
        edited = {path.stem for path in (self.originals.folder / "buildings").glob("*.npz")}
        again = [owner for owner in self.owners if owner.name in edited and owner not in mine]
        modelled: list[str] = []
        removed: list[str] = []
        failed: list[str] = []
        self.touched = {*mine, *again}
        for done, owner in enumerate(sorted(self.touched), 1):
            self.keep_original(owner)
            results: list[BuildingResult | SavedBuilding] = []
            wanted = {order.id: order for order in mine.get(owner, ())}
            for saved in self.as_found(owner).saved_buildings(owner):
                mine_too = wanted.pop(str(saved.row.values["id"]), None)
                if mine_too is None:
                    results.append(saved)
                elif not mine_too.outlines:
                    removed.append(mine_too.id)
                else:
                    version = version_of(saved.result)
                    results += self.model(owner, mine_too, len(results), modelled, failed, version)
            for order in wanted.values():
                results += self.model(owner, order, len(results), modelled, failed)
            self.store.save_buildings(owner, results)
            if owner not in self.owners:
                self.owners = sorted([*self.owners, owner])
            progress("buildings", done, len(mine))
        return modelled, removed, failed

    def keep_original(self, owner: Block) -> None:
        """Copy an owner block's buildings before they are first edited."""
        there, kept = self.store.path("buildings", owner), self.originals.path("buildings", owner)
        if kept.exists():
            return
        if there.exists() and owner in self.owners and not self.is_added(owner):
            shutil.copyfile(there, kept)
        elif not there.exists():
            (self.originals.folder / f"{owner.name}.added").touch()

    def model(
        self,
        owner: Block,
        order: Order,
        before: int,
        modelled: list[str],
        failed: list[str],
        version: Mapping[str, Any] | None = None,
    ) -> list[BuildingResult]:
        """One building for each outline of an order, with the `version` of the building as it was found."""
        gatherer = Gatherer(self.store)
        results = []
        for number, outline in enumerate(order.outlines, 1):
            name = order.id if number == 1 else f"{order.id}-{number}"
            west, south, east, north = outline.bounds
            first, last = Block.at(west, south, self.side), Block.at(east, north, self.side)
            under = tuple(
                (block, 0)
                for column in range(first.column, last.column + 1)
                for row in range(first.row, last.row + 1)
                if (block := Block(column, row, self.side)) in self.blocks
            )
            given = about(Footprint(outline, id=name, attributes=dict(order.provenance)), owner.origin)
            if given is None:
                failed.append(f"{name}: its outline has no area")
                continue
            building = gatherer.gather(owner, BuildingPlan(before + number, under, given))
            if isinstance(building, Failure):
                result = BuildingResult.without_points(building)
            else:
                unit = self.store.system.horizontal_unit_m
                result = building_pass(building, given, self.recipe, unit, flat=order.flat)
            outcome = result.outcome
            if isinstance(outcome, BuildingModel):
                of = {"block_id": order.id} if len(order.outlines) > 1 else {}
                outcome = outcome.with_(
                    attributes={**outcome.attributes, **order.provenance, **of, **(version or {})}
                )
                result = replace(result, outcome=outcome)
            else:
                failed.append(f"{name}: {outcome.reason}")
            modelled.append(name)
            results.append(result)
        return results

    def overlaps(self, orders: Sequence[Order]) -> list[str]:
        """Edited outlines that cover a part of another building."""
        edited = {order.id: shapely.union_all(order.outlines) for order in orders if order.outlines}
        shown = self.shown()
        names = list(shown)
        tree = shapely.STRtree([shown[name] for name in names])
        told = []
        for name, outline in edited.items():
            for k in tree.query(outline, predicate="intersects"):
                other = names[k]
                own = other == name or other.startswith(f"{name}-")
                if own or (other in edited and other < name):
                    continue
                area = shapely.intersection(outline, shown[other]).area
                if area > OVERLAP_M2:
                    told.append(f"{name}: its outline covers {area:.1f} m² of {other}")
        return told
