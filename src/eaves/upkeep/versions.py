"""Ids over time: what stays keeps its id, what is modelled again is its next version, what went has a date.

`creationDate` and `terminationDate` are CityGML's: when a version of a building came into the model, and when
it left it. A building that no update has touched has neither, and is version 1.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import shapely
from scipy import ndimage
from shapely import Polygon

from eaves.buildings.building_file import SavedBuilding, SavedBuildings
from eaves.buildings.edited import CREATED, VERSION, version_of
from eaves.formats.whole_files import atomic
from eaves.geometry.face_table import FaceTable, RoofFaces, highest_faces
from eaves.geometry.inside import connected_groups_kernel, edges_of, members, points_in_polygons
from eaves.geometry.rings import half_shared, pair_off
from eaves.model import BLOCK_SIDE, ROOF_SURFACE, Block, BuildingModel, Failure, Mask, Points, Values
from eaves.model.results import BuildingResult
from eaves.run.keys import BUILDINGS, NAMED
from eaves.run.store import pack

SAME_SURFACE_M = 0.25
"""A surface nearer than this (m) is the same one: half of the smallest change that must be found."""
SMALLEST_CHANGE_M2, NARROWEST_CHANGE_M = 2.5, 0.8
"""A patch of roof that came or went is at least so large, and so wide somewhere. Half of an annex of 4 m²
lies too near to the house to be seen apart from it; balconies and eaves are seen from one side only."""

HISTORY = "history.city.jsonl"
"""File of the versions that have ended: a line each, with `terminationDate`."""

TERMINATED, IDENTIFIER = "terminationDate", "identifier"
"""Attributes of versions that have ended; `identifier` is the building's id, which its versions share."""


@dataclass(frozen=True, eq=False)
class Versions:
    """Ids of the buildings that an update found new, modelled otherwise than before, and no more."""

    new: list[str] = field(default_factory=list)
    remodelled: list[str] = field(default_factory=list)
    gone: list[str] = field(default_factory=list)

    @property
    def ended(self) -> list[str]:
        """Those of which a version has ended."""
        return [*self.gone, *self.remodelled]


@dataclass(frozen=True, eq=False)
class Placed:
    """A result with its place: the owner block, the outline in world metres."""

    owner: Block
    result: BuildingResult
    polygon: Polygon

    @classmethod
    def of(cls, owner: Block, saved: SavedBuilding) -> Placed:
        """A building as it was saved."""
        return cls(owner, saved.result, saved.row.polygon)

    @property
    def id(self) -> str:
        """The id it bears now."""
        footprint = self.result.outcome.footprint
        return "" if footprint is None else footprint.id


def name_versions(
    detected: SavedBuildings,
    before: SavedBuildings,
    owners: Sequence[Block],
    ended: set[str],
    date: str | None,
    gave_way: Points,
) -> tuple[Versions, set[Block]]:
    """Give the buildings their ids and versions, in a layer over those found; what became of them, and the
    owner blocks whose buildings are others than before.

    Parameters
    ----------
    detected, before
        What was found now, and by the earlier run with the names that it gave.
    owners
        The blocks that own buildings now.
    ended
        Ids of removed buildings, which no new one may get.
    date
        Of the update, as `YYYY-MM-DD`; None where no points came: what other code models otherwise is no new
        version.
    gave_way
        Places (N, 2; world metres) of the earlier points that the new ones took the place of. Only where
        some are can new points confirm a building: where all that it was made of stays, they lie beside it.
    """
    side = owners[0].side if owners else BLOCK_SIDE
    entries = before.only(BUILDINGS).keys(before.owners(side)).items()
    same = {name for name, key in detected.only(BUILDINGS).keys(owners).items() if (name, key) in entries}
    changed = {owner for owner in (*owners, *before.owners(side)) if owner.name not in same}
    detected.take_layer(NAMED, [owner for owner in owners if owner.name in same], before)
    fresh, earlier = (
        [Placed.of(owner, saved) for owner in sorted(changed) for saved in layer.saved(owner)]
        for layer in (detected, before)
    )
    stay = (row.values["id"] for row in before.rows([owner for owner in owners if owner.name in same]))
    names_used = {*ended, *map(str, stay), *(building.id for building in earlier)}
    results: dict[Block, list[BuildingResult]] = {}
    if date is not None:
        measured_again = shapely.STRtree(shapely.points(gave_way))
        earlier, fresh, confirmed = confirmed_apart(earlier, fresh, set(owners), measured_again)
        for building in confirmed:
            results.setdefault(building.owner, []).append(building.result)
    partners = match(earlier, fresh)
    names: dict[int, str] = {}
    for k, building in enumerate(fresh):
        names[k] = earlier[partners[k]].id if k in partners else unused(building.id, names_used)
        names_used.add(names[k])
    versions = Versions()
    blocks = block_names(fresh, earlier, partners, names)
    for k, building in enumerate(fresh):
        old = earlier[partners[k]].result if k in partners else None
        result, is_same = versioned(building.result, names[k], blocks, old, date)
        results.setdefault(building.owner, []).append(result)
        if old is None:
            versions.new.append(names[k])
        elif not is_same:
            versions.remodelled.append(names[k])
    matched = set(partners.values())
    versions.gone.extend(building.id for k, building in enumerate(earlier) if k not in matched)
    for owner, buildings in results.items():
        detected.save(NAMED, owner, buildings)
    return versions, changed


def confirmed_apart(
    earlier: Sequence[Placed],
    fresh: Sequence[Placed],
    owners: Collection[Block],
    measured_again: shapely.STRtree,
) -> tuple[list[Placed], list[Placed], list[Placed]]:
    """The earlier and the fresh buildings that differ, and the earlier ones that new points only confirm:
    they lie in blocks that own buildings now, the `owners`, and on places that were measured again."""
    blocks = [*(f"earlier {name}" * bool(name) for name in map(block_id, earlier)), *map(block_id, fresh)]
    stay: set[int] = set()
    replaced: set[int] = set()
    outlines = [[building.polygon for building in buildings] for buildings in (earlier, fresh)]
    for old, new in overlapping_groups(outlines[0], outlines[1], blocks):
        before, after = models_of(earlier, old), models_of(fresh, new)
        all_modelled = old and new and (len(before), len(after)) == (len(old), len(new))
        seen = all(len(measured_again.query(earlier[k].polygon, predicate="intersects")) for k in old)
        if (
            all_modelled
            and seen
            and all(earlier[k].owner in owners for k in old)
            and is_confirmed(before, after)
        ):
            stay.update(old)
            replaced.update(new)
    return (
        [building for k, building in enumerate(earlier) if k not in stay],
        [building for k, building in enumerate(fresh) if k not in replaced],
        [earlier[k] for k in sorted(stay)],
    )


def models_of(buildings: Sequence[Placed], numbers: Sequence[int]) -> list[BuildingModel]:
    """The models of buildings by their numbers; failures have none."""
    outcomes = (buildings[k].result.outcome for k in numbers)
    return [outcome for outcome in outcomes if isinstance(outcome, BuildingModel)]


def match(earlier: Sequence[Placed], fresh: Sequence[Placed]) -> dict[int, int]:
    """Number among `fresh` → number among `earlier` of the same building: the same id of a given footprint,
    or half of either outline in common, those with most in common first."""
    by_id = {building.id: k for k, building in enumerate(earlier)}
    partners = {
        k: by_id[building.id]
        for k, building in enumerate(fresh)
        if building.id in by_id
        and shapely.intersects(building.polygon, earlier[by_id[building.id]].polygon)
        and is_given(building)
    }
    before, after = ([building.polygon for building in buildings] for buildings in (earlier, fresh))
    shared = [
        (-area, earlier[j].id, k, j) for area, j, k in half_shared(before, after) if not is_given(fresh[k])
    ]
    return pair_off(((k, j) for _, _, k, j in sorted(shared)), partners)


def is_given(building: Placed) -> bool:
    """True if a map gave the outline, and with it the id."""
    footprint = building.result.outcome.footprint
    return footprint is not None and bool(footprint.attributes)


def unused(name: str, names: set[str]) -> str:
    """A name that no building has or had: the name itself, or with a number behind it."""
    number = 2
    free = name
    while free in names:
        free, number = f"{name}_{number}", number + 1
    return free


def block_names(
    fresh: Sequence[Placed], earlier: Sequence[Placed], partners: Mapping[int, int], names: Mapping[int, str]
) -> dict[str, str]:
    """Name of a detected block now → the name it keeps: that of the earlier block it shares most with."""
    shared: dict[tuple[str, str], float] = {}
    for k, building in enumerate(fresh):
        now = block_id(building)
        if now == building.id:
            shared[now, names[k]] = np.inf
        elif now and k in partners and (old := block_id(earlier[partners[k]])):
            area = building.polygon.area
            shared[now, old] = shared.get((now, old), 0.0) + area
    return pair_off(pair for pair, _ in sorted(shared.items(), key=lambda item: (-item[1], item[0])))


def block_id(building: Placed) -> str:
    """The detected block that a building is of."""
    outcome = building.result.outcome
    return str(outcome.attributes.get("block_id") or "") if isinstance(outcome, BuildingModel) else ""


def versioned(
    result: BuildingResult, name: str, blocks: Mapping[str, str], old: BuildingResult | None, date: str | None
) -> tuple[BuildingResult, bool]:
    """A result with its name and version, and whether its model is the earlier one."""
    outcome = result.outcome
    assert outcome.footprint is not None
    outcome = replace(outcome, footprint=outcome.footprint.with_(id=name))
    before = {} if old is None else version_of(old)
    if isinstance(outcome, BuildingModel):
        attributes = dict(outcome.attributes)
        if "block_id" in attributes:
            attributes["block_id"] = blocks.get(str(attributes["block_id"]), attributes["block_id"])
        outcome = outcome.with_(attributes={**attributes, **before})
    if old is not None and same_outcome(outcome, old.outcome):
        return replace(result, outcome=old.outcome), True
    if isinstance(outcome, BuildingModel) and date is not None:
        number = 1 if old is None else int(before.get(VERSION, 1)) + 1
        outcome = outcome.with_(attributes={**outcome.attributes, VERSION: number, CREATED: date})
    return replace(result, outcome=outcome), False


def same_outcome(first: BuildingModel | Failure, second: BuildingModel | Failure) -> bool:
    """True if two results are identical to the last bit."""
    return pack(first) == pack(second)


def lines_of(path: Path) -> dict[str, str]:
    """Id → line of a CityJSONSeq, without its first; nothing where there is no such file."""
    if not path.exists():
        return {}
    with path.open("rb") as file:
        next(file, None)
        return {str(json.loads(line)["id"]): line.decode("utf-8") for line in file}


def known_ids(folder: Path) -> set[str]:
    """Ids of all removed buildings."""
    ids = set()
    for line in lines_of(folder / HISTORY).values():
        feature = json.loads(line)
        ids.add(str(feature["CityObjects"][feature["id"]]["attributes"][IDENTIFIER]))
    return ids


def write_history(folder: Path, out: Path, models: str, versions: Versions, date: str | None) -> list[Path]:
    """Write the versions that have ended: those of `folder`, and on a date those that ended as its file
    `models` had them.

    Nothing is written where there are none.
    """
    lines = list(lines_of(folder / HISTORY).values())
    path = folder / models
    if date is not None:
        current = lines_of(path)
        lines += [terminated(current[name], date) for name in sorted(set(versions.ended)) if name in current]
    if not lines:
        return []
    with path.open(encoding="utf-8") as file:
        header = next(file)
    with atomic(out / HISTORY) as temporary:
        temporary.write_text(header + "".join(lines), encoding="utf-8", newline="\n")
    return [out / HISTORY]


def terminated(line: str, date: str) -> str:
    """The line of a version that ended: its id with its number, its building's id, its date."""
    feature = json.loads(line)
    old = feature["id"]
    attributes = feature["CityObjects"][old]["attributes"]
    number = int(attributes.get(VERSION, 1))
    new = f"{old}@{number}"
    names = {
        name: new + name[len(old) :] if name.startswith(old) else f"{name}@{number}"
        for name in feature["CityObjects"]
    }
    feature["id"] = new
    objects = {names[name]: value for name, value in feature["CityObjects"].items()}
    for value in objects.values():
        for link in ("children", "parents"):
            if link in value:
                value[link] = [names[name] for name in value[link]]
    attributes |= {IDENTIFIER: old, VERSION: number, TERMINATED: date}
    feature["CityObjects"] = objects
    return json.dumps(feature, separators=(",", ":"), ensure_ascii=False, allow_nan=False) + "\n"


SAMPLE_M = 0.5
"""Roofs are compared at places so far apart (m): a few of them lie in the smallest change."""


def overlapping_groups(
    earlier: Sequence[Polygon], fresh: Sequence[Polygon], blocks: Sequence[str]
) -> Iterator[tuple[list[int], list[int]]]:
    """Numbers of the earlier and of the fresh outlines that have half of either in common, or their detected
    block (one name for each outline, the earlier ones first; "" for none), directly or by others."""
    pairs = [(j, len(earlier) + k) for _, j, k in half_shared(earlier, fresh)]
    first: dict[str, int] = {}
    for number, block in enumerate(blocks):
        if block:
            pairs.append((first.setdefault(block, number), number))
    first_number, second_number = np.reshape(np.array(pairs, np.int64), (-1, 2)).T
    group = connected_groups_kernel(first_number, second_number, len(earlier) + len(fresh))
    for numbers in members(group, int(group.max(initial=-1)) + 1):
        old = numbers < len(earlier)
        yield numbers[old].tolist(), (numbers[~old] - len(earlier)).tolist()


def is_confirmed(earlier: Sequence[BuildingModel], fresh: Sequence[BuildingModel]) -> bool:
    """True if the models of one group of buildings differ nowhere by as much as `eaves compare` would list.

    Parameters
    ----------
    earlier, fresh : sequence of BuildingModel
        All models of the group, before and now.

    Returns
    -------
    bool
        False where a patch as wide and large as the smallest change lies under the roofs of one of both
        alone, or the roofs over it are farther apart than the tolerance of a comparison. Where walls inside
        the group stand does not count.
    """
    places, shape = samples_over([*earlier, *fresh])
    (old, old_height), (new, new_height) = (roofs_at(models, places) for models in (earlier, fresh))
    with np.errstate(invalid="ignore"):
        differs = (old != new) | (np.abs(old_height - new_height) > SAME_SURFACE_M)
    width = int(np.ceil(NARROWEST_CHANGE_M / SAMPLE_M))
    patches, _ = ndimage.label(ndimage.binary_opening(differs.reshape(shape), np.ones((width, width))))
    largest = np.bincount(patches.ravel())[1:].max(initial=0)
    return bool(largest * SAMPLE_M**2 < SMALLEST_CHANGE_M2)


def samples_over(models: Sequence[BuildingModel]) -> tuple[Points, tuple[int, int]]:
    """Places (N, 2; world metres) over the outlines of models, row by row, and how many rows and columns."""
    boxes = np.array(
        [model.footprint.polygon.bounds + np.tile(model.footprint.origin, 2) for model in models]
    )
    low = np.floor(boxes[:, :2].min(axis=0) / SAMPLE_M) * SAMPLE_M - SAMPLE_M
    size = np.ceil((boxes[:, 2:].max(axis=0) - low) / SAMPLE_M).astype(int) + 1
    x, y = (low[axis] + (np.arange(size[axis]) + 0.5) * SAMPLE_M for axis in (0, 1))
    east, north = np.meshgrid(x, y)
    return np.column_stack([east.ravel(), north.ravel()]), (len(y), len(x))


def roofs_at(models: Sequence[BuildingModel], places: Points) -> tuple[Mask, Values]:
    """Which places (N, 2; world metres) lie in an outline, and the height of the roof there (N,), NaN where
    there is none."""
    inside, heights = np.zeros(len(places), bool), np.full(len(places), np.nan)
    for model in models:
        local = places - model.footprint.origin
        within, _ = points_in_polygons(local, *edges_of(np.array([model.footprint.polygon], object)), 1)
        inside[within] = True
        faces = RoofFaces.of(FaceTable.of_solids(model.solids.get(model.lod, ()), ROOF_SURFACE))
        if len(faces.polygons):
            _, height = highest_faces(local[within], *edges_of(faces.polygons), faces.coefficients)
            heights[within] = np.fmax(heights[within], height)
    return inside, heights
