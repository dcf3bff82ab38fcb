"""The buildings owned by one block, as one file of which a reader decodes only the buildings it needs."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eaves.figures.rows import BuildingRow
from eaves.formats.whole_files import atomic
from eaves.model import Block, BuildingModel, Failure, Labels
from eaves.model.results import BuildingResult
from eaves.run.keys import BUILDINGS, EDITED, NAMED
from eaves.run.store import PartFile, Store, load_part, pack, unpack

ROWS, ANSWERS = "rows", "answers"
"""The sections of the file: what tables say of each building, and the model or failure itself."""
SMALL_PART = 2_000_000
"""Parts of buildings up to this size (bytes) stay in memory once they were read."""
SMALL_PARTS, PARTS_OF_ROWS = 8, 64
"""How many of them stay in memory, and of how many the rows alone do, which are small."""


class Section:
    """A value a building, each decoded when it is asked for, and kept where it `keeps` them."""

    def __init__(self, items: Sequence[bytes], keeps: bool = True) -> None:
        self.items, self.keeps = items, keeps
        self.known: dict[int, Any] = {}
        """Number → value, of those that are decoded."""

    def __len__(self) -> int:
        return len(self.items)

    def __getitem__(self, number: int) -> Any:
        if number in self.known:
            return self.known[number]
        value = unpack(self.items[number])
        if self.keeps:
            self.known[number] = value
        return value

    def __iter__(self) -> Iterator[Any]:
        return (self[number] for number in range(len(self)))


@dataclass(frozen=True, eq=False)
class SavedBuilding:
    """A building as it lies in a file, by its number there: it can be written again without decoding it."""

    rows: Section
    answers: Section
    number: int
    point_id: NDArray[np.int64]
    plane: Labels
    key: str = ""
    """Of all that it follows from (`eaves.run.keys`)."""

    @property
    def row(self) -> BuildingRow:
        """The row of tables for it."""
        row: BuildingRow = self.rows[self.number]
        return row

    @property
    def result(self) -> BuildingResult:
        """The result that was saved."""
        return BuildingResult(self.answers[self.number], self.point_id, self.plane, dict(self.row.seconds))


def building_arrays(
    results: Sequence[BuildingResult | SavedBuilding], keys: Sequence[str] = ()
) -> dict[str, NDArray[Any]]:
    """Buildings, with the keys of what they follow from, as the arrays of their file."""
    sections: dict[str, list[bytes]] = {ROWS: [], ANSWERS: []}
    for result in results:
        if isinstance(result, SavedBuilding):
            sections[ROWS].append(result.rows.items[result.number])
            sections[ANSWERS].append(result.answers.items[result.number])
        else:
            sections[ROWS].append(pack(BuildingRow.of(result.outcome, result.seconds)))
            sections[ANSWERS].append(pack(result.outcome))
    arrays: dict[str, NDArray[Any]] = {"keys": np.array([*keys] or [""] * len(results), "S32")}
    for name, items in sections.items():
        arrays[name] = np.frombuffer(b"".join(items), np.uint8)
        arrays[f"{name}-ends"] = np.cumsum([len(item) for item in items], dtype=np.int64)
    arrays["points"] = np.array([len(result.point_id) for result in results], np.int64)
    arrays["point_id"] = np.concatenate([np.zeros(0, np.int64), *(result.point_id for result in results)])
    arrays["plane"] = np.concatenate([np.zeros(0, np.int32), *(result.plane for result in results)])
    return arrays


def read_section(path: Path, name: str, keeps: bool = False) -> Section:
    """A section of a file of `building_arrays`; see `Section`."""
    return section_of(PartFile(path), name, keeps)


def section_of(arrays: Mapping[str, NDArray[Any]], name: str, keeps: bool) -> Section:
    """A section of `building_arrays`; see `Section`."""
    blob, ends = arrays[name].tobytes(), arrays[f"{name}-ends"].tolist()
    items = [blob[first:end] for first, end in zip([0, *ends], ends, strict=False)]
    return Section(items, keeps)


def saved_buildings(arrays: Mapping[str, NDArray[Any]]) -> list[SavedBuilding]:
    """The buildings of `building_arrays`, as they were saved."""
    rows, outcomes = section_of(arrays, ROWS, keeps=True), section_of(arrays, ANSWERS, keeps=True)
    return [SavedBuilding(rows, outcomes, number, *facts) for number, facts in enumerate(planes_of(arrays))]


@lru_cache(maxsize=SMALL_PARTS)
def read_answers(path: Path, mark: tuple[int, int]) -> Section:
    """The answers of a small file that bears the `mark`."""
    return read_section(path, ANSWERS, keeps=True)


@lru_cache(maxsize=PARTS_OF_ROWS)
def read_rows(path: Path, mark: tuple[int, int]) -> Section:
    """The rows of a file that bears the `mark`. The outputs ask for those of a small run a dozen times."""
    return read_section(path, ROWS, keeps=True)


def planes_of(arrays: Mapping[str, NDArray[Any]]) -> list[tuple[NDArray[np.int64], Labels, str]]:
    """Ids and roof planes (0 for none) of the points of each building of `building_arrays`, and its key."""
    ends: NDArray[np.int64] = np.cumsum(arrays["points"])[:-1]
    pieces = (np.split(arrays[name], ends) for name in ("point_id", "plane"))
    keys = [key.decode() for key in arrays["keys"].tolist()]
    return list(zip(*(list(piece)[: len(keys)] for piece in pieces), keys, strict=True))


def load_buildings(path: Path) -> list[SavedBuilding]:
    """The buildings of a file, as they were saved."""
    return saved_buildings(PartFile(path))


@dataclass(frozen=True)
class SavedBuildings:
    """The buildings of a store, of each owner block those in the first of some layers that has it."""

    store: Store
    layers: tuple[str, ...] = (EDITED, NAMED, BUILDINGS)

    def only(self, *layers: str) -> SavedBuildings:
        """The buildings of some layers alone."""
        return replace(self, layers=layers)

    def keys(self, owners: Iterable[Block]) -> dict[str, str]:
        """Owner block, by its name → the key of its buildings."""
        layers = [dict(self.store.found(layer, owners)) for layer in reversed(self.layers)]
        return {name: key for layer in layers for name, key in layer.items()}

    def save(self, layer: str, owner: Block, results: Sequence[BuildingResult | SavedBuilding]) -> None:
        """Keep the buildings of an owner block in a layer."""
        self.store.save(layer, owner, building_arrays(results))

    def take_layer(self, layer: str, owners: Iterable[Block], before: SavedBuildings) -> None:
        """Have of a layer what another store has of it for some owner blocks, and nothing else."""
        self.store.evict_others(layer, ())
        for owner in owners:
            if before.store.has(layer, owner):
                before.store.link(layer, owner, self.store)

    def owners(self, side: float) -> list[Block]:
        """The blocks of a side (m) that own buildings, in order."""
        return sorted({unit for layer in self.layers for unit in self.store.units(layer, side)})

    def path(self, owner: Block) -> Path | None:
        """The file of an owner block's buildings; None where there is none."""
        paths = (self.store.path(layer, owner) for layer in self.layers)
        return next((path for path in paths if path.exists()), None)

    def saved(self, owner: Block) -> list[SavedBuilding]:
        """The buildings owned by one block, as they were saved."""
        path = self.path(owner)
        return [] if path is None else load_buildings(path)

    def rows(self, owners: Sequence[Block]) -> Iterator[BuildingRow]:
        """The rows of all buildings, owner block by owner block."""
        for owner in owners:
            yield from self.section(owner, ROWS)

    def answers(self, owners: Sequence[Block]) -> Iterator[BuildingModel | Failure]:
        """All buildings, owner block by owner block."""
        for owner in owners:
            yield from self.section(owner, ANSWERS)

    def planes(self, owner: Block) -> Iterator[tuple[NDArray[np.int64], Labels]]:
        """Ids and roof planes (0 for none) of the points of each building owned by one block."""
        path = self.path(owner)
        if path is not None:
            yield from ((ids, plane) for ids, plane, _ in planes_of(PartFile(path)))

    def section(self, owner: Block, name: str) -> Section:
        """A section of the file of an owner block's buildings."""
        path = self.path(owner)
        if path is None:
            return Section([])
        state = path.stat()
        mark = state.st_mtime_ns, state.st_size
        if name == ROWS:
            return read_rows(path, mark)
        return read_section(path, name) if state.st_size > SMALL_PART else read_answers(path, mark)


def found_buildings(store: Store) -> SavedBuildings:
    """The buildings of a store as its run found them, before any edit."""
    return SavedBuildings(store, (NAMED, BUILDINGS))


def load_found(store: Store, owner: Block) -> dict[str, NDArray[Any]]:
    """The arrays of the buildings of a block as its run found them; empty for none."""
    path = found_buildings(store).path(owner)
    return {} if path is None else load_part(path)


NUMBERS = "numbers.json"
"""Beside the buildings of a run that was updated or corrected; else they are numbered in their order."""


@dataclass(frozen=True)
class Numbers:
    """Id → the number of a building, the number before its first plane, and how many planes that leaves it;
    and the next free ones. Numbers of removed buildings are never reused."""

    of: dict[str, tuple[int, int, int]]
    next: tuple[int, int]


def read_numbers(buildings: SavedBuildings) -> Numbers | None:
    """The numbers of buildings that were kept; None where they are numbered in their order."""
    path = buildings.store.folder / NUMBERS
    if not path.exists():
        return None
    content = json.loads(path.read_text(encoding="utf-8"))
    return Numbers({name: tuple(numbers) for name, numbers in content["of"].items()}, tuple(content["next"]))


def count_planes(buildings: SavedBuildings, owners: Sequence[Block]) -> dict[str, int]:
    """Id → how many planes the points of a building bear, in the order of the buildings."""
    counts = {}
    for owner in owners:
        for row, (_, plane) in zip(buildings.rows([owner]), buildings.planes(owner), strict=True):
            counts[str(row.values["id"])] = int(plane.max(initial=0))
    return counts


def numbers_of_owners(buildings: SavedBuildings, owners: Sequence[Block]) -> Numbers:
    """The numbers of all buildings, those of the `owners`."""
    return read_numbers(buildings) or continued(Numbers({}, (1, 0)), count_planes(buildings, owners))


def continued(before: Numbers, planes: dict[str, int]) -> Numbers:
    """The numbers with those of buildings that came, and new ones for planes that have no room."""
    of, (number, plane) = dict(before.of), before.next
    for name, count in planes.items():
        earlier = of.get(name)
        if earlier is not None and count <= earlier[2]:
            continue
        of[name] = (number if earlier is None else earlier[0]), plane, count
        number, plane = number + (earlier is None), plane + count
    return replace(before, of=of, next=(number, plane))


def keep_numbers(buildings: SavedBuildings, owners: Sequence[Block], before: Numbers) -> None:
    """Write the numbers of buildings: those before, and what follows for owner blocks that changed."""
    now = continued(before, count_planes(buildings, owners))
    with atomic(buildings.store.folder / NUMBERS) as temporary:
        temporary.write_text(json.dumps(vars(now)), encoding="utf-8")
