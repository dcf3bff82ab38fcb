"""Matching of the buildings of two epochs that stand at one place, and the name that each keeps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import shapely
from shapely import MultiPolygon, Polygon

from eaves.change.changes import BuildingChange
from eaves.change.epoch import Building
from eaves.geometry import half_shared, pair_off


@dataclass(frozen=True, eq=False)
class Site:
    """A row of the table before it is judged: the new building there, or an old one that none stands for."""

    polygon: Polygon | MultiPolygon
    old: tuple[Building, ...]
    new: tuple[Building, ...]


def make_sites(
    old: Sequence[Building], new: Sequence[Building]
) -> tuple[list[Site], dict[str, list[int]], dict[str, list[int]]]:
    """A site for each new building with the old ones at its place, and one for each old one that no new one
    stands for; the sites of each building by its id."""
    partners: dict[int, list[int]] = {}
    for _, i, j in half_shared(*([one.polygon for one in some] for some in (old, new))):
        partners.setdefault(j, []).append(i)
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


def carry_ids(changes: Sequence[BuildingChange], sites: Sequence[Site]) -> tuple[BuildingChange, ...]:
    """The changes, named: a building keeps the id of the old one with which it shares most, each id once."""
    wanted = []
    for number, site in enumerate(sites):
        for one in site.old:
            shared = shapely.intersection(one.polygon, site.polygon).area
            wanted.append((-float(shared), one.id, number))
    names = pair_off((number, name) for _, name, number in sorted(wanted))
    taken, named = set(names.values()), []
    for number, change in enumerate(changes):
        place = change.polygon.representative_point()
        name = names.get(number) or next(iter(change.new_ids), f"at_{place.x:.0f}_{place.y:.0f}")
        while name in taken and names.get(number) != name:
            name += "-new"
        taken.add(name)
        named.append(replace(change, id=name))
    return tuple(named)
