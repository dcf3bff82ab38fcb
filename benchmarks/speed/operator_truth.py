"""What is right of an outline, by a map or by an operator's marks, and what is to be done to it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import shapely
from shapely import Polygon

FITS, KNOWN = 0.9, 0.6
"""An outline with this IoU is right; a map shows a building when it covers this share of it."""
MARKED_OK = 0.85
"""The IoU from which `marks.py` of the data's owner has an outline as that of the mark."""
SMALLEST_M, FARTHEST_M, LEAST_GAIN = 0.2, 4.0, 0.01
"""Edges move by at least and at most so much (m), and where the IoU gains this."""


@dataclass(frozen=True, eq=False)
class Goal:
    """What is to be done to a building: `right`, `delete`, `join`, `split`, `reshape`, or `unknown`."""

    act: str
    other: str = ""
    line: Any = None
    shape: Any = None


UNKNOWN = Goal("unknown")


def iou(one: Any, two: Any) -> float:
    """Intersection over union."""
    both = float(one.intersection(two).area)
    return both / max(float(one.area + two.area) - both, 1e-9)


@dataclass(frozen=True, eq=False)
class Map:
    """A map of a part of the town, divided by address; metres."""

    houses: list[Any]

    @classmethod
    def read(cls, path: Path) -> Map:
        """The polygons of a file in metres."""
        return cls(list(shapely.from_wkb(pyogrio.raw.read(path)[2])))

    def goal(self, name: str, outlines: Mapping[str, Polygon]) -> Goal:
        """What the map says of a building."""
        own = outlines[name]
        if sum(own.intersection(house).area for house in self.houses) < KNOWN * own.area:
            return UNKNOWN
        inside = [house for house in self.houses if own.intersection(house).area >= 0.6 * house.area]
        if len(inside) > 1:
            one, two = max(combinations(inside, 2), key=lambda pair: shared(*pair))
            line = party_line(one, two)
            return UNKNOWN if line is None else Goal("split", line=line)
        house = max(self.houses, key=lambda one: own.intersection(one).area)
        if not inside and own.intersection(house).area > 0.7 * own.area:
            near = [one for one in outlines if one != name and own.distance(outlines[one]) < 0.3]
            whole = {one: iou(own.union(outlines[one]), house) for one in near}
            best = max(near, key=lambda one: whole[one], default="")
            if best and whole[best] > max(iou(outlines[best], house), KNOWN):
                return Goal("join", other=best)
        return Goal("right") if iou(own, house) >= FITS else Goal("reshape", shape=house)


@dataclass(frozen=True, eq=False)
class Marks:
    """An operator's verdicts on places, with the outline (m) that was judged."""

    kinds: list[str]
    places: list[Any]
    shapes: list[Any]

    @classmethod
    def read(cls, path: Path, unit_m: float) -> Marks:
        """Those of a file in a unit (m)."""
        facts, _, geometry, columns = pyogrio.raw.read(path)
        table = dict(zip(facts["fields"], columns, strict=True))

        def scaled(shape: Any) -> Any:
            return shapely.transform(shape, lambda xy: xy * unit_m)

        shapes = [
            scaled(shapely.make_valid(shapely.from_wkt(text))) if isinstance(text, str) else None
            for text in table["outline"]
        ]
        return cls(list(table["kind"]), [scaled(one) for one in shapely.from_wkb(geometry)], shapes)

    def goal(self, name: str, outlines: Mapping[str, Polygon]) -> Goal:
        """What the marks say of a building: those that lie in it, of an outline that is mostly its own."""
        own = outlines[name]
        for kind, place, shape in zip(self.kinds, self.places, self.shapes, strict=True):
            if not own.contains(place):
                continue
            if kind == "false":
                return Goal("delete")
            if shape is None:
                continue
            if kind == "ok":
                fits = iou(own, shape) >= MARKED_OK
                return Goal("right") if fits else Goal("reshape", shape=shape)
            covers = own.intersection(shape).area / shape.area
            if kind == "merged" and covers > 0.7:
                return Goal("split", line=narrowest(own))
            if kind == "oversplit" and own.area < 1.4 * shape.area:
                near = {one: shared(own, outline) for one, outline in outlines.items() if one != name}
                best = max(near, key=lambda one: near[one], default="")
                return Goal("join", other=best) if best and near[best] > 1.0 else UNKNOWN
        return UNKNOWN


def shared(one: Any, two: Any) -> float:
    """The length (m) of border that two shapes share."""
    return float(one.boundary.intersection(two.buffer(0.3)).length) if one.distance(two) < 0.3 else 0.0


def party_line(one: Any, two: Any) -> Any:
    """The ends (2, 2) of the border of two houses; None where they share none."""
    border = one.buffer(0.1).intersection(two.buffer(0.1))
    if border.is_empty or border.area < 0.1:
        return None
    box = shapely.get_coordinates(border.minimum_rotated_rectangle)[:4]
    sides = [(box[0] + box[1], box[2] + box[3]), (box[1] + box[2], box[3] + box[0])]
    return max(
        (np.array(ends) / 2.0 for ends in sides), key=lambda ends: float(np.hypot(*(ends[1] - ends[0])))
    )


def narrowest(shape: Any) -> Any:
    """The ends (2, 2) of the shortest chord across the longer way of a shape, in its middle two thirds: where
    buildings are joined, for marks do not say it."""
    box = shapely.get_coordinates(shape.minimum_rotated_rectangle)[:4]
    one, two = box[1] - box[0], box[3] - box[0]
    along, across = (one, two) if np.hypot(*one) > np.hypot(*two) else (two, one)
    chords = []
    for share in np.linspace(1.0 / 6.0, 5.0 / 6.0, 41):
        begin = box[0] + share * along
        cut = shape.intersection(shapely.LineString([begin - 0.01 * across, begin + 1.01 * across]))
        chords.append((cut.length, share, begin, begin + across))
    return np.array(min(chords, key=lambda chord: chord[:2])[2:])


def edge_moves(own: Polygon, target: Any) -> Iterator[tuple[float, Any, Any]]:
    """Moves of an edge to an edge of a target: the IoU after it, the edge's middle, and where that goes."""
    ring = shapely.get_coordinates(own.exterior)[:-1]
    aims = list[tuple[Any, Any]]()
    for part in shapely.get_parts(target):
        places = shapely.get_coordinates(part.exterior)
        aims += list(pairwise(places))
    for number in range(len(ring)):
        start, end = ring[number], ring[(number + 1) % len(ring)]
        length = float(np.hypot(*(end - start)))
        if length < 0.8:
            continue
        way = (end - start) / length
        normal = np.array([-way[1], way[0]])
        for one, two in aims:
            span = two - one
            if abs(span @ normal) > 0.2 * np.hypot(*span):
                continue
            first, last = sorted(((one - start) @ way, (two - start) @ way))
            if min(last, length) - max(first, 0.0) < 0.3 * min(length, last - first):
                continue
            deep = float(((one + two) / 2.0 - start) @ normal)
            if SMALLEST_M <= abs(deep) <= FARTHEST_M:
                after = with_edge(ring, number, deep)
                middle = (start + end) / 2.0
                if after.is_valid:
                    yield iou(after, target), middle, middle + deep * normal


def with_edge(ring: Any, number: int, deep: float) -> Polygon:
    """A ring (N, 2) with an edge moved along its normal, as the table moves it."""
    count, after = len(ring), ring.copy()
    start, end = ring[number], ring[(number + 1) % count]
    normal = np.array([start[1] - end[1], end[0] - start[0]]) / np.hypot(*(end - start))
    for place, beside in ((number, number - 1), ((number + 1) % count, (number + 2) % count)):
        way = ring[beside] - ring[place]
        rise = float(way @ normal)
        steep = abs(rise) > 0.3 * np.hypot(*way)
        after[place] = ring[place] + (way * deep / rise if steep else normal * deep)
    return Polygon(after)
