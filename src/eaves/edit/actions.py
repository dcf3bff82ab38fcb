"""What an operator does, as edits of a run: outlines moved, drawn, split and joined, roofs and heights."""

from __future__ import annotations

import datetime
import math
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely import Polygon
from shapely.ops import split

from eaves.edit.review import Reviewed, read_queue
from eaves.flow import OVERLAP_M2, VERDICTS, Edit, StatedFace
from eaves.upkeep import Trial, open_trial, update

SAME_CORNER_M = 0.01
"""Corners nearer than this (m) to one another are one, and move together."""
LEAST_M2, MOST_CORNERS, FARTHEST_M = 1.0, 2000, 300.0
"""A building's outline has at least this area (m²) and at most so many corners; none is drawn farther (m)
from all others."""
MOST_TAKEN = 0.5
"""Share of a neighbour that an outline may take of it."""
CLOSED_GAP_M = 0.3
"""Two buildings this near (m) are joined over the gap."""
AT_FACE_M, LEVEL, STEEPEST = 0.05, 0.1, 4.0
"""A face ends, and meets another, within so much (m); a ridge rises by less (m/m), a plane that rises by more
(m/m, 76°) is a wall."""
NO_BUILDING, IS_BUILDING, FOOTPRINT, PARTY_WALLS = "no building", "is a building", "footprint", "party walls"
ROOF_FACE = "roof face"
OF_ROOF = tuple(name for name in VERDICTS if ("roof" in name or "height" in name) and name != ROOF_FACE)


class ActionError(ValueError):
    """An action that cannot be carried out, with the reason in one line."""


@dataclass(frozen=True, eq=False)
class Table:
    """What actions stand on: the outlines of all buildings (world metres), by id, the page's origin, and what
    gives the roof faces of a building."""

    outlines: Mapping[str, Polygon]
    origin: tuple[float, float] = (0.0, 0.0)
    faces: Callable[[str], Sequence[StatedFace]] = lambda name: ()

    def outline(self, name: object) -> Polygon:
        """The outline of a building."""
        if not isinstance(name, str) or name not in self.outlines:
            raise ActionError(f"there is no building {name!r}")
        return self.outlines[name]

    def place(self, values: object) -> tuple[float, float]:
        """A place of the page, [x, y], in world metres."""
        if not isinstance(values, list) or len(values) != 2:
            raise ActionError("a place is not [x, y]")
        if not all(isinstance(value, int | float) and math.isfinite(value) for value in values):
            raise ActionError("a place is not two numbers")
        return float(values[0]) + self.origin[0], float(values[1]) + self.origin[1]

    def places(self, values: object, least: int) -> list[tuple[float, float]]:
        """Places of the page in world metres."""
        if not isinstance(values, list) or not least <= len(values) <= MOST_CORNERS:
            raise ActionError(f"places are not a list of {least} to {MOST_CORNERS:,}")
        return [self.place(value) for value in values]

    def plan(self, values: object) -> Polygon:
        """The polygon of one ring of the page."""
        return sound(Polygon(self.places(values, 3)))


def sound(polygon: Any) -> Polygon:
    """A polygon that can be an outline, on the grid of millimetres."""
    polygon = shapely.set_precision(polygon, 0.001) if shapely.is_valid(polygon) else polygon
    if not isinstance(polygon, Polygon) or not polygon.is_valid:
        raise ActionError("the outline crosses itself or falls apart")
    if polygon.area < LEAST_M2:
        raise ActionError(f"the outline has {polygon.area:.2f} m², less than {LEAST_M2:g}")
    return polygon


def number(value: object) -> float:
    """A finite number."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 10_000.0:
        raise ActionError("the height is no number (m)")
    return float(value)


def edits_of(action: object, table: Table) -> list[Edit]:
    """The edits that an action of the page stands for.

    Raises
    ------
    ActionError
        When it is none, or cannot be carried out.
    """
    if not isinstance(action, dict):
        raise ActionError("an action is a JSON object")
    tool = TOOLS.get(str(action.get("do")))
    if tool is None:
        raise ActionError(f"'do' is none of {', '.join(TOOLS)}")
    return list(tool(action, table))


def move(action: Mapping[str, Any], table: Table) -> Iterator[Edit]:
    """Corners of a building moved, {"id", "moves": [[[x, y], [x, y]], …]}; also those of neighbours."""
    moves = action.get("moves")
    if not isinstance(moves, list) or not 1 <= len(moves) <= MOST_CORNERS:
        raise ActionError("'moves' is not a list")
    pairs = np.array([table.places(pair, 2) for pair in moves])
    if pairs.shape[1:] != (2, 2):
        raise ActionError("a move is not [from, to]")
    name, before = str(action.get("id")), table.outline(action.get("id"))

    def carried(polygon: Polygon) -> Any:
        def shift(xy: Any) -> Any:
            away = np.hypot(*np.moveaxis(xy[:, None] - pairs[None, :, 0], 2, 0))
            nearest = away.argmin(axis=1)
            near = away[np.arange(len(xy)), nearest] <= SAME_CORNER_M
            return np.where(near[:, None], pairs[nearest, 1], xy)

        return shapely.transform(polygon, shift)

    after = carried(before)
    if after.equals(before):
        raise ActionError("no corner of the building is there")
    drawn = {name: sound(after)}
    for other, outline in table.outlines.items():
        if other != name and outline.distance(before) <= SAME_CORNER_M:
            moved = carried(outline)
            if not moved.equals(outline):
                drawn[other] = sound(moved)
    yield from outlined(drawn, table, name)


def outline(action: Mapping[str, Any], table: Table) -> Iterator[Edit]:
    """A building's outline drawn anew: {"id", "plan": [[x, y], …]}; its courtyards stay."""
    name, before = str(action.get("id")), table.outline(action.get("id"))
    plan = table.plan(action.get("plan"))
    yards = [Polygon(ring) for ring in before.interiors]
    yield from outlined({name: sound(plan.difference(shapely.union_all(yards)))}, table, name)


def outlined(drawn: dict[str, Polygon], table: Table, name: str) -> Iterator[Edit]:
    """Outlines drawn; what the one of a `name` takes of neighbours they lose."""
    own = drawn[name]
    for other, before in table.outlines.items():
        if other == name:
            continue
        polygon = drawn.get(other, before)
        taken = shapely.intersection(own, polygon).area
        if taken > shapely.intersection(table.outlines.get(name, Polygon()), before).area + 1e-3:
            if taken > MOST_TAKEN * polygon.area:
                raise ActionError(
                    f"the outline covers {taken / polygon.area:.0%} of {other}; delete or join it"
                )
            rest = shapely.difference(polygon, own)
            parts = [part for part in shapely.get_parts(rest) if part.area >= LEAST_M2]
            if not parts:
                raise ActionError(f"the outline leaves nothing of {other}; delete or join it")
            drawn[other] = sound(max(parts, key=lambda part: part.area))
    for changed, polygon in drawn.items():
        yield Edit(FOOTPRINT, polygon, changed)


def draw(action: Mapping[str, Any], table: Table) -> Iterator[Edit]:
    """A building that was not found: {"plan": [[x, y], …]}."""
    plan = table.plan(action.get("plan"))
    if table.outlines and min(plan.distance(one) for one in table.outlines.values()) > FARTHEST_M:
        raise ActionError(f"the outline lies more than {FARTHEST_M:g} m from all buildings")
    for other, polygon in table.outlines.items():
        taken = shapely.intersection(plan, polygon).area
        if taken > OVERLAP_M2:
            raise ActionError(
                f"the outline covers {taken:.1f} m² of {other}; draw beside it, or move its edge"
            )
        if taken > 0.0:
            plan = sound(shapely.difference(plan, polygon))
    middle = plan.representative_point()
    name = stem = f"e{middle.x:.0f}_{middle.y:.0f}"
    count = 1
    while name in table.outlines:
        count += 1
        name = f"{stem}_{count}"
    yield Edit(IS_BUILDING, plan, name)


def delete(action: Mapping[str, Any], table: Table) -> Iterator[Edit]:
    """A building that is none: {"id"}."""
    yield Edit(NO_BUILDING, table.outline(action.get("id")), str(action["id"]))


def divide(action: Mapping[str, Any], table: Table) -> Iterator[Edit]:
    """A building split by a line, a party wall: {"id", "line": [[x, y], …]}, carried on to its outline."""
    before, places = table.outline(action.get("id")), table.places(action.get("line"), 2)
    line = shapely.LineString(carried_on(np.array(places), before))
    if not line.is_simple:
        raise ActionError("the line crosses itself")
    parts = [part for part in split(before, line).geoms if isinstance(part, Polygon)]
    if len(parts) < 2:
        raise ActionError("the line does not cross the building")
    for part in sorted(parts, key=lambda part: -part.area):
        yield Edit(PARTY_WALLS, sound(part), str(action["id"]))


def carried_on(places: np.ndarray[Any, Any], polygon: Polygon) -> np.ndarray[Any, Any]:
    """A line (N, 2) whose ends inside a polygon are carried on beyond it."""
    reach = np.hypot(*np.diff(np.reshape(polygon.bounds, (2, 2)), axis=0)[0])
    ends = []
    for end, inner in ((places[0], places[1]), (places[-1], places[-2])):
        way = end - inner
        length = float(np.hypot(*way))
        if length == 0.0:
            raise ActionError("the line has two corners at one place")
        ends.append(end + way / length * reach if polygon.contains(shapely.Point(end)) else end)
    return np.array([ends[0], *places[1:-1], ends[1]] if len(places) > 2 else ends)


def join(action: Mapping[str, Any], table: Table) -> Iterator[Edit]:
    """Two buildings that are one: {"ids": [a, b]}; the first gives its id."""
    names = action.get("ids")
    if not isinstance(names, list) or len(names) != 2 or names[0] == names[1]:
        raise ActionError("'ids' are not those of two buildings")
    first, second = (table.outline(name) for name in names)
    whole = shapely.union(first, second)
    if not isinstance(whole, Polygon):
        grown = shapely.buffer(whole, 0.5 * CLOSED_GAP_M, join_style="mitre")
        whole = shapely.union(whole, shapely.buffer(grown, -0.5 * CLOSED_GAP_M, join_style="mitre"))
    if not isinstance(whole, Polygon):
        raise ActionError(f"the buildings lie {first.distance(second):.1f} m apart")
    others = [one for name, one in table.outlines.items() if name not in names]
    edit = Edit(FOOTPRINT, sound(whole.difference(shapely.union_all(others))), names[0])
    yield from (Edit(NO_BUILDING, second, names[1]), edit)


def state(action: Mapping[str, Any], table: Table) -> Iterator[Edit]:
    """A roof or a height stated: {"id", "verdict", "value"}."""
    verdict = str(action.get("verdict"))
    if verdict not in OF_ROOF:
        raise ActionError(f"'verdict' is none of {', '.join(OF_ROOF)}")
    value = number(action.get("value")) if "height" in verdict else None
    yield Edit(verdict, table.outline(action.get("id")), str(action["id"]), value=value)


def face(action: Mapping[str, Any], table: Table) -> Iterator[Edit]:
    """A face of the roof drawn, a dormer: {"id", "plan": [[x, y], …]}; its plane is that of its points."""
    plan = shapely.intersection(table.plan(action.get("plan")), table.outline(action.get("id")))
    yield Edit(ROOF_FACE, sound(plan), str(action["id"]))


def unite(action: Mapping[str, Any], table: Table) -> Iterator[Edit]:
    """Two faces of the roof made one: {"id", "at": [[x, y], [x, y]]}, a place in each; the plane is that of
    the points in both."""
    table.outline(action.get("id"))
    faces, chosen = table.faces(str(action["id"])), list[StatedFace]()
    for place in table.places(action.get("at"), 2)[:2]:
        chosen += [one for one in faces if one.polygon.contains(shapely.Point(place))][:1]
    if len(chosen) < 2 or chosen[0] is chosen[1]:
        raise ActionError("the places are not in two faces of the roof")
    whole = shapely.union_all([one.polygon for one in chosen], grid_size=0.001)
    if not isinstance(whole, Polygon):
        raise ActionError("the faces do not touch")
    yield Edit(ROOF_FACE, sound(whole), str(action["id"]))


def ridge(action: Mapping[str, Any], table: Table) -> Iterator[Edit]:
    """A ridge, or a valley, moved: {"id", "line": [[x, y], [x, y]], "to": [x, y], "rise"}, its ends, a place
    that it is to go through, and how much higher (m) it is to be.

    The two planes that meet there turn about their eaves, the middle of their lowest corners. Over them, and
    over the faces at the ridge's ends that they meet as a hip meets a roof, the roof is the lowest of all
    these planes, of a valley the highest.
    """
    name = str(action.get("id"))
    table.outline(action.get("id"))
    ends, to = np.array(table.places(action.get("line"), 2)[:2]), np.array(table.place(action.get("to")))
    rise, along = number(action.get("rise", 0.0)), ends[1] - ends[0]
    length = float(np.hypot(*along))
    if length < AT_FACE_M:
        raise ActionError("the line has no length")
    normal = np.array([-along[1], along[0]]) / length
    moved = ends + float((to - ends[0]) @ normal) * normal
    faces = table.faces(name)
    near = [
        [one for one in faces if one.polygon.distance(shapely.Point(at)) <= AT_FACE_M]
        for at in (ends.mean(axis=0), *ends)
    ]
    pair = sorted(near[0], key=lambda one: -one.polygon.area)[:2]
    if len(pair) < 2 or np.abs(np.subtract(*(one.height_at(ends) for one in pair))).max() > 4 * AT_FACE_M:
        raise ActionError("no two planes meet there")
    inside = [shapely.get_coordinates(one.polygon.representative_point()) for one in pair]
    sign = 1.0 if pair[0].height_at(inside[0])[0] <= pair[1].height_at(inside[0])[0] else -1.0
    heights = np.mean([one.height_at(ends) for one in pair], axis=0) + rise
    if abs(float(heights[1] - heights[0])) > LEVEL * length:
        raise ActionError("the line slopes: it is a hip; move the ridge")
    planes = [(one, turned(one, np.column_stack([moved, heights]), sign)) for one in pair]
    for hip in near[1] + near[2]:
        more = [*(one for one, _ in planes), hip]
        if hip not in more[:-1] and is_lowest(more, sign):
            planes.append((hip, hip))
    whole = shapely.union_all([one.polygon for one, _ in planes], grid_size=0.001)
    if not whole.contains(shapely.Point(moved.mean(axis=0))):
        raise ActionError("the ridge would lie beyond its faces")
    for _, plane in planes:
        others = [other for _, other in planes if other is not plane]
        for part in shapely.get_parts(lowest_part(whole, plane, others, sign)):
            if part.area >= LEAST_M2:
                yield Edit(ROOF_FACE, part := sound(part), name, plane=plane.over(part).plane)


def turned(one: StatedFace, line: np.ndarray[Any, Any], sign: float) -> StatedFace:
    """A face on the plane through a line (2, 3) and its eaves, the middle of its corners that lie lowest, by
    a sign of -1 highest."""
    corners = shapely.get_coordinates(one.polygon)[:-1]
    heights = one.height_at(corners)
    lowest = sign * heights <= (sign * heights).min() + AT_FACE_M
    eaves = np.append(corners[lowest].mean(axis=0), heights[lowest].mean())
    way = line - eaves
    a, b = np.linalg.lstsq(way[:, :2], way[:, 2], rcond=None)[0].tolist()
    if not math.hypot(a, b) <= STEEPEST:
        raise ActionError("the ridge would lie on its eaves")
    middle = shapely.get_coordinates(one.polygon.centroid)[0]
    return StatedFace(one.polygon, (a, b, float(eaves[2] + (middle - eaves[:2]) @ np.array([a, b]))))


def is_lowest(faces: Sequence[StatedFace], sign: float) -> bool:
    """True if the roof over faces is the lowest of their planes, by a sign of -1 the highest."""
    inside = [shapely.get_coordinates(one.polygon.representative_point()) for one in faces]
    return all(
        sign * (other.height_at(at)[0] - one.height_at(at)[0]) >= -AT_FACE_M
        for one, at in zip(faces, inside, strict=True)
        for other in faces
    )


def lowest_part(whole: Any, plane: StatedFace, others: Sequence[StatedFace], sign: float) -> Any:
    """The part of a shape where a plane lies under others, by a sign of -1 over them."""
    middle, reach = shapely.get_coordinates(whole.centroid), 4.0 * math.sqrt(whole.area) + whole.length
    for other in others:
        a, b = sign * (other.rise - plane.rise)
        apart = sign * float(other.height_at(middle)[0] - plane.height_at(middle)[0])
        steep = math.hypot(a, b)
        if steep < 1e-6:
            whole = whole if apart >= 0.0 else Polygon()
            continue
        up = np.array([a, b]) / steep
        begin, across = middle[0] - up * apart / steep, np.array([-up[1], up[0]]) * reach
        far = up * (reach + abs(apart) / steep)
        half = Polygon([begin - across, begin + across, begin + across + far, begin - across + far])
        whole = shapely.intersection(whole, half, grid_size=0.001)
    return whole


def confirm(action: Mapping[str, Any], table: Table) -> Iterator[Edit]:
    """A building that is right: {"id"}."""
    yield Edit("right", table.outline(action.get("id")), str(action["id"]))


TOOLS: dict[str, Callable[[Mapping[str, Any], Table], Iterator[Edit]]] = {
    "move": move,
    "outline": outline,
    "draw": draw,
    "delete": delete,
    "split": divide,
    "join": join,
    "face": face,
    "unite": unite,
    "ridge": ridge,
    "state": state,
    "right": confirm,
}


def signed(edits: Sequence[Edit], action: int, day: str, reasons: Mapping[str, str]) -> list[Edit]:
    """Edits with the number of their action, the day, and the reasons for which buildings were reviewed."""
    return [
        replace(edit, source="eaves edit", action=action, reviewed=day, reason=reasons.get(edit.id, ""))
        for edit in edits
    ]


@dataclass(frozen=True, eq=False)
class Change:
    """What came of an action: the buildings that are others now, None for those that went, and words."""

    buildings: dict[str, Any] = field(default_factory=dict)
    words: tuple[str, ...] = ()


class Session:
    """The edits of a run's folder, which it holds until it is closed.

    Every action is in the folder's file of edits before it is modelled; what another program writes there, or
    into the layer of footprints, is taken in by the next call.

    Parameters
    ----------
    folder : Path
        Folder of a run.
    jobs : int
        Processes.
    """

    def __init__(self, folder: Path, jobs: int = 1) -> None:
        self.folder, self.jobs = folder, jobs
        self.lock = threading.RLock()
        self.undone: list[list[Edit]] = []
        self.failed: frozenset[str] = frozenset()
        """What edits that give no model were last said to be."""
        self.day = datetime.date.today().isoformat()
        self.open()

    def open(self) -> None:
        """Hold the folder, and model what its edits say."""
        with ExitStack() as held:
            self.trial: Trial = held.enter_context(open_trial(self.folder, self.jobs))
            self.queue: list[Reviewed] = read_queue(self.folder)
            self.own = self.trial.kept()
            self.seen: Any = None
            self.fresh = self.take_in()
            self.held = held.pop_all()

    def close(self) -> None:
        """Let go of the folder."""
        self.held.close()

    @property
    def outlines(self) -> dict[str, Polygon]:
        """Id → outline (world metres) of all buildings as they are now."""
        return self.trial.outlines()

    @property
    def reviewed(self) -> dict[str, Edit]:
        """Id → the last edit of each building that was looked at."""
        return {edit.id: edit for edit in self.own if edit.action}

    def model(self) -> Change:
        """Model what all edits say now."""
        corrected = self.trial.correct([*self.own, *self.trial.from_layer()])
        self.seen = self.trial.state()
        changed, known = self.trial.changed(corrected.touched), self.failed
        self.failed = frozenset((*corrected.conflicts, *corrected.failed))
        return Change(changed, tuple(sorted(self.failed - known)))

    def take_in(self) -> Change:
        """What another program changed since the last call."""
        with self.lock:
            if self.seen == self.trial.state():
                return Change()
            self.own = self.trial.kept()
            return self.model()

    def act(self, action: object, origin: tuple[float, float] = (0.0, 0.0)) -> Change:
        """Carry out an action of the page, whose places count from an origin.

        Raises
        ------
        ActionError
            When it cannot be carried out, or a roof so stated is none; no edit is kept then.
        """
        with self.lock:
            before = self.take_in()
            edits = edits_of(action, Table(self.outlines, origin, self.trial.faces))
            reasons = {entry.id: entry.reason for entry in self.queue}
            edits = signed(edits, self.last_action + 1, self.day, reasons)
            undone, kept = self.undone, self.own
            self.undone = []
            change = self.with_edits([*self.own, *edits], before)
            if change.words and {edit.verdict for edit in edits} <= {ROOF_FACE, *OF_ROOF}:
                self.undone = undone
                self.with_edits(kept, before)
                raise ActionError("; ".join(change.words))
            return change

    @property
    def last_action(self) -> int:
        """The number of the last action; 0 for none."""
        return max((edit.action for edit in self.own), default=0)

    def with_edits(self, edits: Sequence[Edit], before: Change) -> Change:
        """Keep edits and model what they say; with what changed `before`."""
        earlier, self.own = self.own, self.trial.keep(edits)
        try:
            after = self.model()
        except BaseException:  # what cannot be modelled must not stay
            self.own = self.trial.keep(earlier)
            raise
        return Change({**before.buildings, **after.buildings}, after.words)

    def undo(self) -> Change:
        """Take back the last action."""
        with self.lock:
            before, last = self.take_in(), self.last_action
            if not last:
                raise ActionError("nothing to undo")
            self.undone.append([edit for edit in self.own if edit.action == last])
            return self.with_edits([edit for edit in self.own if edit.action != last], before)

    def redo(self) -> Change:
        """Carry out again what was taken back last."""
        with self.lock:
            before = self.take_in()
            if not self.undone:
                raise ActionError("nothing to redo")
            return self.with_edits([*self.own, *self.undone.pop()], before)

    def save(self) -> str:
        """Write all files of the run, as `eaves update` does; the words that it ends with."""
        with self.lock:
            self.held.close()
            try:
                return update(self.folder, jobs=self.jobs).as_text()
            finally:
                self.open()

    def tried(self, action: dict[str, Any], verdicts: Sequence[str]) -> dict[str, Any]:
        """Verdict → the building of an action as each of some verdicts would leave it; nothing is kept."""
        with self.lock:
            self.take_in()
            kept = self.own
            choices: dict[str, Any] = {}
            for verdict in verdicts:
                edits = edits_of({**action, "do": "state", "verdict": verdict}, Table(self.outlines))
                self.trial.correct([*kept, *edits, *self.trial.from_layer()])
                name = edits[0].id
                choices[verdict] = self.trial.buildings([name])[name]
            self.trial.correct([*kept, *self.trial.from_layer()])
            return choices
