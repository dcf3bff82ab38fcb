"""Which buildings of two epochs stand at one place, and the name that each keeps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from eaves.change.changes import BuildingChange
from eaves.change.edits import HALF
from eaves.change.epoch import Building


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
    before = np.array([one.polygon for one in old], dtype=object)
    after = np.array([one.polygon for one in new], dtype=object)
    pairs = shapely.STRtree(before).query(after, predicate="intersects").T if len(old) and len(new) else []
    partners: dict[int, list[int]] = {}
    for j, i in pairs:
        shared = shapely.intersection(before[i], after[j]).area
        if shared >= HALF * min(before[i].area, after[j].area):
            partners.setdefault(int(j), []).append(int(i))
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
    names: dict[int, str] = {}
    taken: set[str] = set()
    for _, name, number in sorted(wanted):
        if number not in names and name not in taken:
            names[number] = name
            taken.add(name)
    named = []
    for number, change in enumerate(changes):
        place = change.polygon.representative_point()
        name = names.get(number) or next(iter(change.new_ids), f"at_{place.x:.0f}_{place.y:.0f}")
        while name in taken and names.get(number) != name:
            name += "-new"
        taken.add(name)
        named.append(replace(change, id=name))
    return tuple(named)
