"""The numbers by which the classified points call buildings and roof planes: they stay with them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace

from eaves.buildings.building_file import Kept
from eaves.formats.atomic import atomic
from eaves.model import Block

NUMBERS = "numbers.json"
"""Beside the buildings of a run that was updated or corrected; else they are numbered in their order."""


@dataclass(frozen=True)
class Numbers:
    """Id → the number of a building, the number before its first plane, and how many planes that leaves it;
    and the next free ones. Numbers of removed buildings are never reused."""

    of: dict[str, tuple[int, int, int]]
    next: tuple[int, int]


def read_numbers(kept: Kept) -> Numbers | None:
    """The numbers of buildings that were kept; None where they are numbered in their order."""
    path = kept.store.folder / NUMBERS
    if not path.exists():
        return None
    words = json.loads(path.read_text(encoding="utf-8"))
    return Numbers({name: tuple(some) for name, some in words["of"].items()}, tuple(words["next"]))


def count_planes(kept: Kept, owners: Sequence[Block]) -> dict[str, int]:
    """Id → how many planes the points of a building bear, in the order of the buildings."""
    found = {}
    for owner in owners:
        for row, (_, plane) in zip(kept.rows([owner]), kept.planes(owner), strict=True):
            found[str(row.values["id"])] = int(plane.max(initial=0))
    return found


def numbers_of_owners(kept: Kept, owners: Sequence[Block]) -> Numbers:
    """The numbers of all buildings, those of the `owners`."""
    return read_numbers(kept) or continued(Numbers({}, (1, 0)), count_planes(kept, owners))


def continued(before: Numbers, planes: dict[str, int]) -> Numbers:
    """The numbers with those of buildings that came, and new ones for planes that have no room."""
    of, (number, plane) = dict(before.of), before.next
    for name, count in planes.items():
        known = of.get(name)
        if known is not None and count <= known[2]:
            continue
        of[name] = (number if known is None else known[0]), plane, count
        number, plane = number + (known is None), plane + count
    return replace(before, of=of, next=(number, plane))


def keep_numbers(kept: Kept, owners: Sequence[Block], before: Numbers) -> None:
    """Write the numbers of buildings: those before, and what follows for owner blocks that changed."""
    now = continued(before, count_planes(kept, owners))
    with atomic(kept.store.folder / NUMBERS) as temporary:
        temporary.write_text(json.dumps(vars(now)), encoding="utf-8")
