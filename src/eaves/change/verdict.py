"""The change of one building, from the state of each roof point in the other epoch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from shapely import MultiPolygon, Polygon

from eaves.change.epoch import Epoch
from eaves.change.surface import (
    GROUND_BELOW,
    HIDDEN,
    LEAST_NEIGHBOURS,
    OTHER_BELOW,
    ROOF_ABOVE,
    ROOF_BELOW,
    SAME,
    UNSEEN,
    Shift,
)
from eaves.detect import MIN_HEIGHT_M, VehicleRules, find_vehicles
from eaves.flow import FEWEST, frame_of
from eaves.geometry import connected_groups_kernel, members
from eaves.model import Mask, Points, Values
from eaves.upkeep import NARROWEST_CHANGE_M, SAME_SURFACE_M, SMALLEST_CHANGE_M2

if TYPE_CHECKING:
    from geopandas import GeoDataFrame

SEEN_WELL, SURE_SCORE = 0.8, 0.9
"""Share of a roof that the other epoch shows, and the score of what one run alone has: see `certainty`."""


@dataclass(frozen=True, eq=False)
class BuildingChange:
    """The change of one building.

    `id` is the building's name over time: the old epoch's where it was there; `old_ids` and `new_ids` name
    all that stand at its place. `polygon` is its outline, the new epoch's where there is one (world metres).
    """

    id: str
    old_ids: tuple[str, ...]
    new_ids: tuple[str, ...]
    polygon: Polygon | MultiPolygon
    verdict: Verdict
    points: tuple[int, int]
    volumes: tuple[float | None, float | None]
    """Of the models (m³), where the runs know them."""

    @property
    def certainty(self) -> str | None:
        """Certainty of the change, `high`, `medium` or `low`; None where there is none.

        A change rests on the points that show it, on how much of the roof the other epoch shows, and, where
        one run alone has the building, on that run's score. What is unchanged rests on the last two.
        """
        verdict, figures = self.verdict, self.verdict.figures
        if verdict.change in (UNCLEAR, NOT_COVERED):
            return None
        seen, score = figures.get("seen", 1.0), figures.get("score")
        doubted = score is not None and score < SURE_SCORE
        if verdict.change == UNCHANGED:
            seen = min(seen, figures.get("same", 0.0))
        elif sum(map(len, verdict.patches)) < FEWEST:  # of such 3 of 10 were wrong
            return "low"
        return "high" if seen >= SEEN_WELL and not doubted else "medium"

    @property
    def row(self) -> dict[str, Any]:
        """The change as tables show it."""
        verdict = self.verdict
        both = [volume for volume in self.volumes if volume is not None]
        return {
            "id": self.id,
            "change": verdict.change,
            "also": ", ".join(verdict.also) or None,
            "certainty": self.certainty,
            "height_difference_m": round(verdict.height_m, 2),
            "volume_difference_m3": round(verdict.volume_m3, 1),
            "model_volume_difference_m3": round(both[1] - both[0], 1) if len(both) == 2 else None,
            "built_m2": round(verdict.built_m2, 1),
            "gone_m2": round(verdict.gone_m2, 1),
            "moved_m2": round(verdict.moved_m2, 1),
            "points_old": self.points[0],
            "points_new": self.points[1],
            "share_seen": verdict.figures.get("seen"),
            "share_same": verdict.figures.get("same"),
            "ids_old": ", ".join(self.old_ids) or None,
            "ids_new": ", ".join(self.new_ids) or None,
            "area_m2": round(float(self.polygon.area), 2),
            "reason": verdict.reason,
        }


@dataclass(frozen=True, eq=False)
class Comparison:
    """The change of every building of two epochs, and the epochs."""

    old: Epoch
    new: Epoch
    changes: tuple[BuildingChange, ...]
    shift: Shift
    tolerance: float
    """A surface nearer than this (m) counts as the same one."""
    spacings: tuple[float, float]
    """Mean spacings of the points (m)."""

    @property
    def densities(self) -> tuple[float, float]:
        """Points a square metre."""
        return self.spacings[0] ** -2, self.spacings[1] ** -2

    @property
    def table(self) -> GeoDataFrame:
        """One row a building, as changes.gpkg has it, as a geopandas.GeoDataFrame."""
        rows, shapes = [one.row for one in self.changes], [one.polygon for one in self.changes]
        return frame_of(rows, shapes, self.old.system)

    @property
    def counts(self) -> dict[str, int]:
        """Number of buildings that underwent each change."""
        names = [change.verdict.change for change in self.changes]
        return {name: names.count(name) for name in sorted(set(names), key=names.index)}


UNCHANGED, NEW, DEMOLISHED, RAISED, LOWERED = "unchanged", "new", "demolished", "raised", "lowered"
EXTENDED, PARTLY_DEMOLISHED, ROOF_REPLACED = "extended", "partly demolished", "roof replaced"
UNCLEAR, NOT_COVERED = "unclear", "not covered"
VERDICTS = (
    *(UNCHANGED, NEW, DEMOLISHED, RAISED, LOWERED, EXTENDED, PARTLY_DEMOLISHED, ROOF_REPLACED),
    *(UNCLEAR, NOT_COVERED),
)
"""All that can be said of a building."""


@dataclass(frozen=True)
class ChangeRules:
    """From what size on a difference is a change."""

    smallest_m2: float = SMALLEST_CHANGE_M2
    """A patch of roof that came or went is at least so large."""
    smallest_beside_m2: float = 5.0
    """The same for a patch that most of its run did not take for a building: a hedge, a stack."""
    smallest_alone_m2: float = 25.0
    """The same for a surface that stands alone and is in no run's footprints: larger than a lorry."""
    least_moved: float = 0.15
    """A roof that moved does so over this share of its building: what is smaller is a balcony, a dormer or
    plant, which one flight sees and the other does not."""
    narrowest: float = NARROWEST_CHANGE_M
    """A patch is as wide as this (m) somewhere."""
    flat: float = 0.3
    """Share of a patch's points that lie on planes: crowns have fewer."""
    lowest: float = MIN_HEIGHT_M
    """A roof that came or went lies at least so high (m) over the ground: cars and hedges are lower."""
    least_seen: float = 0.3
    """A building is unclear when the other epoch shows less than this share of its roof."""
    most: float = 0.5
    """Share of the points that decides on the whole of a building, and whether its run found a patch."""


@dataclass(frozen=True, eq=False)
class Side:
    """The roof points of one epoch that belong to a building, and what the other shows there.

    `flat` (N,) are those on a plane, `known` those that the run took for a building; `size` (N,) is the area
    (m²) that each stands for.
    """

    xyz: Points
    state: NDArray[np.uint8]
    distance: Values
    flat: Mask
    known: Mask
    height: Values
    """Over the ground of its own epoch (m); NaN where it is not known."""
    size: Values

    def __len__(self) -> int:
        return len(self.xyz)

    @property
    def area(self) -> float:
        """The area (m²) of all points."""
        return float(self.size.sum())

    @property
    def came(self) -> Mask:
        """The points under which the other epoch shows the ground, or what is no roof."""
        return self.having(GROUND_BELOW, OTHER_BELOW)

    def having(self, *states: int) -> Mask:
        """The points that have one of some states."""
        chosen = np.zeros(HIDDEN + 1, bool)  # a state in each place
        chosen[list(states)] = True
        return chosen[self.state]

    def share(self, *states: int) -> float:
        """The share of the points that have one of some states."""
        return float(self.having(*states).mean()) if len(self) else 0.0

    def area_of(self, *masks: Mask) -> float:
        """The area (m²) of some points."""
        return float(sum(self.size[mask].sum() for mask in masks))

    def are_vehicles(self, mask: Mask, link: float) -> bool:
        """True if most of some points are those of vehicles, by the detector's rules; points of one body are
        linked to those nearer than `link` (m)."""
        if not mask.any():
            return False
        xyz, rules = self.xyz[mask], VehicleRules()
        height = np.where(np.isfinite(self.height), self.height, np.abs(self.distance))[mask]
        body = (linked(xyz[:, :2], link) + 1).astype(np.int32)
        vehicle = find_vehicles(xyz, np.nan_to_num(height), body, int(body.max()) + 1, rules)
        return bool(vehicle[body].mean() >= rules.vehicle_flat)


@dataclass(frozen=True, eq=False)
class Verdict:
    """The verdict on a building: the change, others it underwent beside, the figures, and why."""

    change: str
    also: tuple[str, ...] = ()
    height_m: float = 0.0
    """Rise (m) of the roof where it moved."""
    built_m2: float = 0.0
    gone_m2: float = 0.0
    moved_m2: float = 0.0
    """Areas where a roof came, went, was raised or lowered."""
    volume_m3: float = 0.0
    reason: str = ""
    figures: dict[str, Any] = field(default_factory=dict)
    patches: tuple[NDArray[np.float64], ...] = ()
    """Places (K, 2) of the points of each part that changed."""


def judge_building(
    old: Side,
    new: Side,
    rules: ChangeRules,
    covered: tuple[bool, bool],
    link: float,
    outlined: tuple[bool, bool] = (True, True),
    attached: bool = False,
    score: float | None = None,
) -> Verdict:
    """The change of a building that is in the new epoch, in the old one, or in both.

    Parameters
    ----------
    old, new
        Its roof points in each epoch, and what the other shows there.
    rules
        From what size on a difference is a change.
    covered
        True for the old and for the new epoch if it has points at its place.
    link
        Points of a patch lie at most so far apart (m).
    outlined
        True for the old and for the new run if it has a building at its place; points of a run that has none
        are its neighbours'.
    attached
        True if it touches another building: no vehicle does.
    score
        How sure the one run that has it is that it is a building; None where it does not say.
    """
    if not all(covered):
        return Verdict(NOT_COVERED, reason=f"the {'new' if covered[0] else 'old'} epoch has no points here")
    if len(new) + len(old) < LEAST_NEIGHBOURS:
        return Verdict(UNCLEAR, reason=f"only {len(new) + len(old)} roof points in both epochs")
    side, other = (new, "old") if len(new) >= len(old) else (old, "new")
    seen = 1.0 - side.share(UNSEEN, HIDDEN)
    if seen < rules.least_seen and side.share(UNSEEN) >= side.share(HIDDEN):
        return Verdict(NOT_COVERED, reason=f"the {other} epoch has points over {seen:.0%} of the roof alone")
    if seen < rules.least_seen:
        return Verdict(UNCLEAR, reason=f"{1 - seen:.0%} of the roof is hidden or not seen in the other epoch")
    figures = {"seen": round(seen, 3), "same": round(max(new.share(SAME), old.share(SAME)), 3)}
    if not all(outlined) and score is not None:
        figures["score"] = score
    having = [one for one, has in zip((old, new), outlined, strict=True) if has]
    if not attached and all(one.are_vehicles(one.known, link / 2) for one in having):
        return Verdict(UNCHANGED, reason="as narrow, long, low and level as vehicles", figures=figures)
    built, gone = (patches_of(one, one.came, rules, link) for one in (new, old))
    volume = volume_change(old, new)
    for here, there, patches, has, had, kind, words in (
        (new, old, built, outlined[1], outlined[0], NEW, "stands where no roof was"),
        (old, new, gone, outlined[0], outlined[1], DEMOLISHED, "is gone down to the ground"),
    ):
        whole = here.area_of(*patches) >= rules.most * here.area > 0.0
        if has and whole and (not had or is_gone(there, here, rules)):
            sign = 1.0 if kind == NEW else -1.0
            area = here.area_of(*patches)
            return Verdict(
                kind,
                height_m=float(-sign * np.median(here.distance[np.any(patches, axis=0)])),
                built_m2=area if kind == NEW else 0.0,
                gone_m2=area if kind == DEMOLISHED else 0.0,
                volume_m3=volume,
                reason=f"{here.share(GROUND_BELOW, OTHER_BELOW):.0%} of its roof {words}",
                figures=figures,
                patches=tuple(here.xyz[patch, :2] for patch in patches),
            )
    return judge_parts(old, new, built, gone, rules, link, volume, figures)


def is_gone(one: Side, other: Side, rules: ChangeRules) -> bool:
    """True if no significant part of one epoch's roof is left in the other."""
    left = one.area_of(one.having(SAME, ROOF_ABOVE, ROOF_BELOW))
    return left < max(rules.smallest_m2, rules.most * min(one.area, other.area))


def judge_parts(
    old: Side,
    new: Side,
    built: Sequence[Mask],
    gone: Sequence[Mask],
    rules: ChangeRules,
    link: float,
    volume: float,
    figures: dict[str, Any],
) -> Verdict:
    """The change of a building that stands in both epochs."""
    side, rise = max(
        ((new, moved(new, -1.0)), (old, moved(old, 1.0))),
        key=lambda pair: pair[0].area_of(np.isfinite(pair[1])),
    )
    lifted = patches_of(side, np.isfinite(rise), rules, link)
    if side.area_of(*lifted) < rules.least_moved * side.area:
        lifted = []
    kind = kind_of_move(np.concatenate([rise[patch] for patch in lifted])) if lifted else ""
    sizes = {
        EXTENDED: new.area_of(*built),
        PARTLY_DEMOLISHED: old.area_of(*gone),
        kind: side.area_of(*lifted),
    }
    found = sorted(((size, name) for name, size in sizes.items() if size > 0.0), reverse=True)
    if not found:
        reason = f"{figures['same']:.0%} of the roof is where it was"
        return Verdict(UNCHANGED, reason=reason, figures=figures)
    groups = (new, built), (old, gone), (side, lifted)
    return Verdict(
        found[0][1],
        tuple(name for _, name in found[1:]),
        float(np.median(rise[lifted[0]])) if lifted else 0.0,
        sizes[EXTENDED],
        sizes[PARTLY_DEMOLISHED],
        sizes[kind],
        volume,
        ", ".join(f"{name} over {size:.1f} m²" for size, name in found),
        figures,
        tuple(one.xyz[patch, :2] for one, patches in groups for patch in patches),
    )


def kind_of_move(rise: Values) -> str:
    """Raised or lowered when the middle half of the points moved alike, else replaced."""
    low, high = np.percentile(rise, (25, 75))
    if high - low > SAME_SURFACE_M or low * high < 0:
        return ROOF_REPLACED
    return RAISED if low > 0 else LOWERED


def moved(side: Side, way: float) -> Values:
    """Rise (m) of the roof at each point, old to new; NaN where it is the same, or no roof."""
    return np.where(side.having(ROOF_ABOVE, ROOF_BELOW), way * side.distance, np.nan)


def patches_of(side: Side, mask: Mask, rules: ChangeRules, link: float) -> list[Mask]:
    """The groups of some points, each linked to the next (m): those large, high and wide enough and flat, the
    largest first. What is most of a building is a roof, however few of its points lie off the rim."""
    some = np.flatnonzero(mask)
    patches = []
    for group in members(found := linked(side.xyz[some, :2], link), int(found.max(initial=-1)) + 1):
        patch = np.zeros(len(mask), bool)
        patch[some[group]] = True
        over_ground = side.distance[patch & (side.state == GROUND_BELOW)]
        known = side.known[patch].mean() >= rules.most
        smallest = rules.smallest_m2 if known else max(rules.smallest_m2, rules.smallest_beside_m2)
        if len(group) < LEAST_NEIGHBOURS or side.area_of(patch) < smallest:
            continue
        if len(over_ground) >= LEAST_NEIGHBOURS and -float(np.median(over_ground)) < rules.lowest:
            continue
        whole = known and patch.sum() >= rules.most * len(side)
        flat = side.flat[patch].mean() >= rules.flat
        if whole or (flat and is_wide(side.xyz[patch, :2], rules.narrowest, link / 2)):
            patches.append(patch)
    return sorted(patches, key=lambda patch: (-int(patch.sum()), int(np.argmax(patch))))


def linked(xy: NDArray[np.float64], link: float) -> NDArray[np.int64]:
    """The group (N,) of each point (N, 2): each is linked to those nearer than `link` (m)."""
    pairs = cKDTree(xy).query_pairs(link, output_type="ndarray")
    groups: NDArray[np.int64] = connected_groups_kernel(pairs[:, 0], pairs[:, 1], len(xy))
    return groups


def is_wide(xy: NDArray[np.float64], width: float, reach: float) -> bool:
    """True if points (N, 2), each of which covers what lies within its `reach` (m), cover a disc of some
    diameter (m) between them: strips along edges do not."""
    covered = shapely.union_all(shapely.buffer(shapely.points(xy), reach, quad_segs=2))
    return not shapely.buffer(covered, -reach - width / 2, quad_segs=2).is_empty


def volume_change(old: Side, new: Side) -> float:
    """Growth (m³) of the building: each point of a roof stands for a column down to the other epoch's
    surface; of a roof that both have, the new one's count."""
    here = np.isfinite(new.distance) & (new.state != SAME) & (new.state != HIDDEN)
    more = float(-(new.distance * new.size)[here].sum())
    return more + float((old.distance * old.size)[old.came].sum())
