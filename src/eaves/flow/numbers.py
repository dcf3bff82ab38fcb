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


def read_numbers(buildings: Kept) -> Numbers | None:
    """The numbers of buildings that were kept; None where they are numbered in their order."""
    path = buildings.store.folder / NUMBERS
    if not path.exists():
        return None
    content = json.loads(path.read_text(encoding="utf-8"))
    return Numbers({name: tuple(numbers) for name, numbers in content["of"].items()}, tuple(content["next"]))


def count_planes(buildings: Kept, owners: Sequence[Block]) -> dict[str, int]:
    """Id → how many planes the points of a building bear, in the order of the buildings."""
    counts = {}
    for owner in owners:
        for row, (_, plane) in zip(buildings.rows([owner]), buildings.planes(owner), strict=True):
            counts[str(row.values["id"])] = int(plane.max(initial=0))
    return counts


def numbers_of_owners(buildings: Kept, owners: Sequence[Block]) -> Numbers:
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


def keep_numbers(buildings: Kept, owners: Sequence[Block], before: Numbers) -> None:
    """Write the numbers of buildings: those before, and what follows for owner blocks that changed."""
    now = continued(before, count_planes(buildings, owners))
    with atomic(buildings.store.folder / NUMBERS) as temporary:
        temporary.write_text(json.dumps(vars(now)), encoding="utf-8")
