"""What became of one building, from what each epoch shows at the other's roof points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from eaves.change.surface import (
    GROUND_BELOW,
    HIDDEN,
    OTHER_BELOW,
    ROOF_ABOVE,
    ROOF_BELOW,
    SAME,
    UNSEEN,
)
from eaves.change.vehicles import StandingRules, are_vehicles, is_wide, linked
from eaves.model import Mask, Points, Values

UNCHANGED, NEW, DEMOLISHED, RAISED, LOWERED, EXTENDED = (
    "unchanged",
    "new",
    "demolished",
    "raised",
    "lowered",
    "extended",
)
PARTLY_DEMOLISHED, ROOF_REPLACED, UNCLEAR, NOT_COVERED = (
    "partly demolished",
    "roof replaced",
    "unclear",
    "not covered",
)
ONE_WAY = 0.9
"""Of a roof that was raised as a whole at least this share of the points lies higher."""

ONE_PLANE, ROUNDS = 0.15, 3
"""So near (m) to a plane lie the points of a small roof with its gravel and noise; it is fitted so often."""

VERDICTS = (
    *(UNCHANGED, NEW, DEMOLISHED, RAISED, LOWERED, EXTENDED, PARTLY_DEMOLISHED, ROOF_REPLACED),
    *(UNCLEAR, NOT_COVERED),
)
"""All that can be said of a building."""


@dataclass(frozen=True)
class ChangeRules:
    """From what size on a difference is a change."""

    smallest_m2: float = 2.5
    """A patch of roof that came or went is at least so large; half of an annex of 4 m² lies too near to the
    house to be seen apart from it."""
    smallest_beside_m2: float = 5.0
    """The same for a patch that most of its run did not take for a building: a hedge, a stack."""
    least_moved: float = 0.15
    surely_moved_m2: float = 15.0
    """A roof that moved does so over this share of its building or this area (m²): what is smaller is a
    balcony, a dormer or plant, which one flight sees and the other does not."""
    narrowest: float = 0.8
    """A patch is as wide as this (m) somewhere: balconies and eaves are seen from one side only."""
    smallest_alone_m2: float = 25.0
    """The same for a surface that stands alone and is in no run's footprints: larger than a lorry."""
    vehicles: StandingRules = field(default_factory=StandingRules)
    """What stands alone and is like these is a vehicle, a trailer or a container."""
    doubted: float = 0.5
    """What stands alone, and the one run that has it scores lower, is told by neither: rather no building."""
    smallest_height: float = 0.35
    """A roof that was raised or lowered lies at least so far off (m): between noise and half a metre."""
    flat: float = 0.5
    """Share of a patch's points that lie on planes: crowns have fewer."""
    lowest: float = 1.9
    """A roof that came or went lies at least so high (m) over the ground: cars and hedges are lower."""
    on_plane: float = 0.6
    compact: float = 0.6
    """A small roof beside a wall lies on one plane with this share of its points, and fills this share of its
    convex hull."""
    steepest: float = 1.75
    """What is one plane and steeper than this (60°) is a wall that one flight sees and the other does not."""
    crown: float = 0.3
    """What the detector took for a building and has fewer points on planes than this share may be a crown."""
    most: float = 0.5
    """Share of a building's points that decides on the whole of it."""
    least_seen: float = 0.3
    """A building is unclear when the other epoch shows less than this share of its roof."""
    least_points: int = 4
    """Fewer points decide nothing."""
    uniform: float = 0.25
    """A roof was moved as a whole when the middle half of its points moved alike to so much (m), and else
    replaced by another."""


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
    size: Values
    height: Values | None = None
    """Over the ground of its own epoch (m); NaN where it is not known, None where nowhere."""

    def __len__(self) -> int:
        return len(self.xyz)

    @property
    def area(self) -> float:
        """The area (m²) of all points."""
        return float(self.size.sum())

    def share(self, *states: int) -> float:
        """The share of the points that have one of some states."""
        return float(np.isin(self.state, states).mean()) if len(self) else 0.0

    def area_of(self, mask: Mask) -> float:
        """The area (m²) of some points."""
        return float(self.size[mask].sum())

    def are_vehicles(
        self, mask: Mask, rules: StandingRules, link: float, outline: Polygon | MultiPolygon | None = None
    ) -> bool:
        """Whether some points, or their outline, are like those of vehicles."""
        if not mask.any():
            return False
        known = np.zeros(0) if self.height is None else self.height[mask & np.isfinite(self.height)]
        height = float(np.median(known)) if len(known) else float(abs(np.median(self.distance[mask])))
        size = float(np.median(self.size[mask]))
        return are_vehicles(self.xyz[mask], height, size, rules, link / 2, outline)


@dataclass(frozen=True, eq=False)
class Verdict:
    """What became of a building: the change, others it underwent beside, the figures, and why."""

    change: str
    also: tuple[str, ...] = ()
    height_m: float = 0.0
    """How much higher the roof lies where it moved."""
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
    outline: Polygon | MultiPolygon | None = None,
    attached: bool = False,
    score: float | None = None,
) -> Verdict:
    """What became of a building that is in the new epoch, in the old one, or in both.

    Parameters
    ----------
    old, new
        Its roof points in each epoch, and what the other shows there.
    rules
        From what size on a difference is a change.
    covered
        Whether the old and the new epoch have points at its place.
    link
        Points of a patch lie at most so far apart (m).
    outlined
        Whether the old and the new run have a building at its place; points of a run that has none are its
        neighbours'.
    outline
        The run's, for what is as narrow as a vehicle; None where the points must say it.
    attached
        Whether it touches another building: no vehicle does.
    score
        How sure the one run that has it is that it is a building; None where it does not say.
    """
    if not all(covered):
        which = "old" if not covered[0] else "new"
        return Verdict(NOT_COVERED, reason=f"the {which} epoch has no points here")
    built, gone = came(new), came(old)
    seen_new, seen_old = 1.0 - new.share(UNSEEN, HIDDEN), 1.0 - old.share(UNSEEN, HIDDEN)
    same = max(new.share(SAME), old.share(SAME))
    volume = volume_change(old, new)
    if len(new) + len(old) < rules.least_points:
        return Verdict(UNCLEAR, reason=f"only {len(new) + len(old)} roof points in both epochs")
    seen = seen_new if len(new) >= len(old) else seen_old
    side = new if len(new) >= len(old) else old
    if seen < rules.least_seen and side.share(UNSEEN) >= side.share(HIDDEN):
        which = "old" if side is new else "new"
        reason = f"the {which} epoch has points over {seen:.0%} of the roof alone"
        return Verdict(NOT_COVERED, reason=reason)
    if seen < rules.least_seen:
        return Verdict(UNCLEAR, reason=f"{1 - seen:.0%} of the roof is hidden or not seen in the other epoch")
    figures = {"seen": round(seen, 3), "same": round(same, 3)}
    alone = new if not outlined[0] else old if not outlined[1] else None
    if alone is not None and score is not None:
        figures["score"] = score
    if alone is not None and not attached:
        if score is not None and score < rules.doubted:
            return Verdict(
                UNCHANGED, reason=f"one run alone has it, and scores it {score:.2f}", figures=figures
            )
        if alone.are_vehicles(alone.known, rules.vehicles, link, outline):
            return Verdict(UNCHANGED, reason="as narrow, long, low and level as vehicles", figures=figures)
    built &= not is_low(new, built, rules)
    gone &= not is_low(old, gone, rules)
    stands_new = built.sum() >= max(rules.most * len(new) * seen_new, rules.least_points)
    stands_new &= new.area_of(built) >= rules.smallest_m2
    if stands_new and outlined[1] and (not outlined[0] or gone_all(old, new, rules)):
        if new.flat[built].mean() < rules.crown:
            return Verdict(UNCLEAR, reason="what is new here is not flat: a crown, perhaps", figures=figures)
        return Verdict(
            NEW,
            height_m=float(-np.median(new.distance[built])),
            built_m2=new.area_of(built),
            volume_m3=volume,
            reason=f"{new.share(GROUND_BELOW, OTHER_BELOW):.0%} of its roof stands where no roof was",
            figures=figures,
            patches=(new.xyz[built, :2],),
        )
    stood_old = gone.sum() >= max(rules.most * len(old), rules.least_points)  # what is hidden is not gone
    stood_old &= old.area_of(gone) >= rules.smallest_m2
    if stood_old and (not outlined[1] or gone_all(new, old, rules)):
        if old.flat[gone].mean() < rules.crown:
            return Verdict(UNCLEAR, reason="what went is not flat: a crown, perhaps", figures=figures)
        return Verdict(
            DEMOLISHED,
            height_m=float(np.median(old.distance[gone])),
            gone_m2=old.area_of(gone),
            volume_m3=volume,
            reason=f"{old.share(GROUND_BELOW, OTHER_BELOW):.0%} of its roof is gone down to the ground",
            figures=figures,
            patches=(old.xyz[gone, :2],),
        )
    return judge_parts(old, new, rules, link, volume, figures)


def gone_all(one: Side, other: Side, rules: ChangeRules) -> bool:
    """Whether nothing that matters of one epoch's roof is left in the other."""
    states = SAME, ROOF_ABOVE, ROOF_BELOW
    left = one.area_of(np.isin(one.state, states))
    return left < rules.smallest_m2 or (
        left < rules.most * other.area and one.share(*states) < 1.0 - rules.most
    )


def came(side: Side) -> Mask:
    """The points of a roof under which the other epoch shows the ground, or what is no roof."""
    return np.asarray(np.isin(side.state, (GROUND_BELOW, OTHER_BELOW)))


def judge_parts(
    old: Side, new: Side, rules: ChangeRules, link: float, volume: float, figures: dict[str, Any]
) -> Verdict:
    """What became of a building that stands in both epochs."""
    built = patches_of(new, came(new), rules, link)
    gone = patches_of(old, came(old), rules, link)
    found: list[tuple[float, str]] = []
    for patches, side, kind in ((built, new, EXTENDED), (gone, old, PARTLY_DEMOLISHED)):
        if patches:
            found.append((sum(side.area_of(patch) for patch in patches), kind))
    side, rise = max(
        ((new, moved(new, -1.0, rules)), (old, moved(old, 1.0, rules))),
        key=lambda pair: pair[0].area_of(np.isfinite(pair[1])),
    )
    share = max(rules.smallest_m2, rules.least_moved * side.area)
    lifted = patches_of(side, np.isfinite(rise), rules, link)
    if sum(side.area_of(patch) for patch in lifted) < share:
        sure = max(rules.smallest_m2, rules.surely_moved_m2)
        lifted = [patch for patch in lifted if side.area_of(patch) >= sure]
    height = float(np.median(rise[lifted[0]])) if lifted else 0.0
    if lifted:
        found.append((sum(side.area_of(patch) for patch in lifted), kind_of_move(rise, lifted, rules)))
    if not found:
        reason = f"{figures['same']:.0%} of the roof is where it was"
        return Verdict(UNCHANGED, reason=reason, figures=figures)
    found.sort(key=lambda one: -one[0])
    sizes = {kind: size for size, kind in found}
    return Verdict(
        found[0][1],
        tuple(kind for _, kind in found[1:]),
        height,
        sizes.get(EXTENDED, 0.0),
        sizes.get(PARTLY_DEMOLISHED, 0.0),
        max(sizes.get(kind, 0.0) for kind in (RAISED, LOWERED, ROOF_REPLACED)),
        volume,
        ", ".join(f"{kind} over {size:.1f} m²" for size, kind in found),
        figures,
        tuple(new.xyz[patch, :2] for patch in built)
        + tuple(old.xyz[patch, :2] for patch in gone)
        + tuple(side.xyz[patch, :2] for patch in lifted),
    )


def kind_of_move(rise: Values, patches: Sequence[Mask], rules: ChangeRules) -> str:
    """Raised or lowered when each patch moved alike and all the same way, else replaced."""
    for patch in patches:
        low, middle, high = (float(v) for v in np.percentile(rise[patch], (25, 50, 75)))
        if high - low > max(rules.uniform, 0.3 * abs(middle)):
            return ROOF_REPLACED
    all_rises = np.concatenate([rise[patch] for patch in patches])
    up = float((all_rises > 0).mean())
    return RAISED if up >= ONE_WAY else LOWERED if up <= 1 - ONE_WAY else ROOF_REPLACED


def moved(side: Side, way: float, rules: ChangeRules) -> Values:
    """How much higher the new roof lies at each point (m); NaN where it is the same, or no roof."""
    rise = np.where(np.isin(side.state, (ROOF_ABOVE, ROOF_BELOW)), way * side.distance, np.nan)
    return np.where(np.abs(rise) >= rules.smallest_height, rise, np.nan)


def patches_of(side: Side, mask: Mask, rules: ChangeRules, link: float) -> list[Mask]:
    """The groups of some points, each linked to the next (m): those large enough, largest first."""
    some = np.flatnonzero(mask)
    if len(some) < rules.least_points:
        return []
    patches = []
    for group in linked(side.xyz[some, :2], link):
        if len(group) < rules.least_points:
            continue
        patch = np.zeros(len(mask), bool)
        patch[some[group]] = True
        known = side.known[patch].mean() >= rules.most
        smallest = rules.smallest_m2 if known else max(rules.smallest_m2, rules.smallest_beside_m2)
        if side.area_of(patch) < smallest:
            continue
        whole = known and patch.sum() >= rules.most * len(side)  # a shed has few points off its rim
        if is_low(side, patch, rules):
            continue
        if whole or (
            is_roof_patch(side, patch, rules) and is_wide(side.xyz[patch, :2], rules.narrowest, link / 2)
        ):
            patches.append(patch)
    return sorted(patches, key=lambda patch: (-int(patch.sum()), int(np.argmax(patch))))


def is_low(side: Side, patch: Mask, rules: ChangeRules) -> bool:
    """Whether a patch that came or went lies lower over the other epoch's ground than any roof."""
    over_ground = side.distance[patch & (side.state == GROUND_BELOW)]
    return len(over_ground) >= rules.least_points and -float(np.median(over_ground)) < rules.lowest


def is_roof_patch(side: Side, patch: Mask, rules: ChangeRules) -> bool:
    """Whether most points of a patch lie on planes: each on that of its neighbours, or all on one.

    A small roof beside a wall is flat as a whole where its points' neighbours are not; a wall is steep.
    """
    xyz = side.xyz[patch]
    centred = np.column_stack([xyz[:, :2] - xyz[:, :2].mean(axis=0), np.ones(len(xyz))])
    plane = np.array([0.0, 0.0, np.median(xyz[:, 2])])

    def away() -> Values:
        return np.asarray(np.abs(xyz[:, 2] - centred @ plane) / np.sqrt(1.0 + plane[0] ** 2 + plane[1] ** 2))

    for _ in range(ROUNDS):
        left = away()
        kept = left <= max(float(np.median(left)), ONE_PLANE)
        plane = np.linalg.lstsq(centred[kept], xyz[kept, 2], rcond=None)[0]
    one = float((away() <= ONE_PLANE).mean())
    if one >= rules.flat and np.hypot(plane[0], plane[1]) > rules.steepest:
        return False
    if side.flat[patch].mean() >= rules.flat:
        return True
    hull = shapely.convex_hull(shapely.multipoints(xyz[:, :2])).area
    return one >= rules.on_plane and side.area_of(patch) >= rules.compact * hull


def volume_change(old: Side, new: Side) -> float:
    """How much larger the building is (m³): each point of a roof stands for a column down to the other
    epoch's surface; of a roof that both have, the new one's count."""
    here = np.isfinite(new.distance) & (new.state != SAME) & (new.state != HIDDEN)
    lost = came(old)
    more = float(-(new.distance * new.size)[here].sum())
    return more + float((old.distance * old.size)[lost].sum())
