"""The buildings owned by one block, as one file of which a reader decodes only the buildings it needs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eaves.model import Labels
from eaves.model.results import BuildingResult
from eaves.run.part_file import open_part, pack_item, unpack_item
from eaves.run.rows import BuildingRow

ROWS, ANSWERS = "rows", "answers"
"""The sections of the file: what tables say of each building, and the model or failure itself."""
SMALL_PARTS = 8
"""How many small parts of buildings stay in memory once they were read."""


class Section:
    """A value a building, each decoded when it is asked for, and kept where it `keeps` them."""

    def __init__(
        self, items: Sequence[bytes], of: Callable[[Any], Any] | None = None, keeps: bool = True
    ) -> None:
        self.items, self._of, self.keeps = items, of, keeps
        self.known: dict[int, Any] = {}
        """Number → value, of those that are decoded."""

    def __len__(self) -> int:
        return len(self.items)

    def __getitem__(self, number: int) -> Any:
        if number in self.known:
            return self.known[number]
        value = unpack_item(self.items[number])
        value = value if self._of is None else self._of(value)
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
        """What tables say of it."""
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
    for one in results:
        if isinstance(one, SavedBuilding):
            sections[ROWS].append(one.rows.items[one.number])
            sections[ANSWERS].append(one.answers.items[one.number])
        else:
            sections[ROWS].append(pack_item(vars(BuildingRow.of(one.outcome, one.seconds))))
            sections[ANSWERS].append(pack_item(one.outcome))
    arrays: dict[str, NDArray[Any]] = {"keys": np.array([*keys] or [""] * len(results), "S32")}
    for name, items in sections.items():
        arrays[name] = np.frombuffer(b"".join(items), np.uint8)
        arrays[f"{name}-ends"] = np.cumsum([len(item) for item in items], dtype=np.int64)
    arrays["points"] = np.array([len(one.point_id) for one in results], np.int64)
    arrays["point_id"] = np.concatenate([np.zeros(0, np.int64), *(one.point_id for one in results)])
    arrays["plane"] = np.concatenate([np.zeros(0, np.int32), *(one.plane for one in results)])
    return arrays


def read_section(path: Path, name: str, keeps: bool = False) -> Section:
    """A section of a file of `building_arrays`; see `Section`."""
    with open_part(path) as file:
        blob, ends = file[name].tobytes(), file[f"{name}-ends"].tolist()
    items = [blob[first:end] for first, end in zip([0, *ends], ends, strict=False)]
    return Section(items, row_of if name == ROWS else None, keeps)


@lru_cache(maxsize=SMALL_PARTS)
def read_small_section(path: Path, name: str, mark: tuple[int, int]) -> Section:
    """A section of a small file that bears the `mark`. The outputs ask for those of a small run a dozen
    times."""
    return read_section(path, name, keeps=True)


def read_planes(path: Path) -> list[tuple[NDArray[np.int64], Labels, str]]:
    """Ids and roof planes (0 for none) of the points of each building of a file, and its key."""
    with open_part(path) as file:
        ends: NDArray[np.int64] = np.cumsum(file["points"])[:-1]
        pieces = (np.split(file[name], ends) for name in ("point_id", "plane"))
        keys = [key.decode() for key in file["keys"].tolist()]
        return list(zip(*(list(some)[: len(keys)] for some in pieces), keys, strict=True))


def row_of(values: Mapping[str, Any]) -> BuildingRow:
    """The row of what was packed of it."""
    return BuildingRow(**values)
