"""Why the default detector and the references differ, place by place, as seen in the clouds."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Reason:
    """A place in world metres, whether it is missed or false there, why, and whose fault it is."""

    x: float
    y: float
    kind: str
    why: str
    reference: bool = False


CARS = "cars parked on the roof of a garage; the deck around and below them is class 6"
MOVED = "the polygon lies 1.5 m beside the roof"

REASONS: dict[str, tuple[Reason, ...]] = {
    "delft": (
        Reason(84823, 447445, "missed", "a slab of 0.6 to 1.5 m; a building begins at 2 m", True),
        Reason(84812, 447429, "false", CARS, True),
        Reason(84818, 447416, "false", CARS, True),
        Reason(84812, 447442, "false", CARS, True),
        Reason(84810, 447440, "false", CARS, True),
        Reason(84814, 447425, "false", CARS, True),
        Reason(84823, 447434, "false", "cars and a mast's wires at the edge of the same garage"),
        Reason(84829, 447429, "false", "the mast's wires and rails at the edge of the same garage"),
        Reason(84830, 447424, "false", "a car and the mast's wires at the edge of the same garage"),
        Reason(84946, 447514, "false", "a dome 2.5 m high beside a tree: bush or arbour"),
        Reason(84934, 447587, "false", "flat, 2.0 m high, between two sheds that are class 6"),
        Reason(84937, 447508, "false", "level and 2.0 m high, alone in a garden: a shed or a clipped hedge"),
        Reason(84887, 447631, "false", "lean-tos and bushes between sheds"),
    ),
    "ign_urban": (
        Reason(
            770570,
            6277597,
            "false",
            "a hedge 2 m high and a clipped bush of 3 m, cut by the edge of the tile",
        ),
        Reason(770544, 6277575, "false", "a rounded bush 3.3 m high, dense and smooth on top"),
        Reason(
            770539, 6277524, "missed", "a porch or gallery 6 m high and 1.2 m wide before a house of 16 m"
        ),
        Reason(770563, 6277584, "false", "a clipped block 3.5 m high with a smooth rounded top"),
        Reason(770559, 6277569, "false", "a bush against the wall, joined to the house"),
        Reason(770589, 6277560, "false", "level and 2.7 m high, half of it seen through: a pergola"),
        Reason(770501, 6277531, "missed", "a roof of which the tile shows 1.2 m, and its facade"),
        Reason(770594, 6277538, "false", "a bush against the wall, joined to the house"),
    ),
    "ign_buildings": (
        Reason(870218, 6617098, "false", MOVED + " and leaves out its western lean-to, 5 m wide", True),
        Reason(870286, 6617098, "false", MOVED + " and leaves out a lean-to in the north", True),
        Reason(870288, 6617120, "false", "a carport 4 m wide along the house, class 6, in no polygon", True),
        Reason(870220, 6617122, "false", "a shed with a level roof, class 6, in no polygon", True),
        Reason(870206, 6617103, "false", "a shed with a level roof 2.4 m up, in no polygon", True),
        Reason(870215, 6617131, "false", "the overhang of the roof; " + MOVED, True),
        Reason(870276, 6617126, "false", "a porch, class 6, in no polygon", True),
        Reason(870206, 6617134, "false", "the overhang of the roof; " + MOVED, True),
    ),
    "hilly 32": (
        Reason(2407, 4936, "missed", "a shed with the measures and the level top of a van"),
        Reason(2402, 4874, "false", "a van, cut by the edge of the scan and by a crown: too short for a van"),
        Reason(2568, 4910, "false", "a van of 2.5 m whose end bushes hide: too short for a van"),
    ),
    "slope 34": (
        Reason(2480, 4978, "missed", "a shed of two levels, 2.4 and 3.5 m, each too small for a surface"),
    ),
    "terraced 35": (
        Reason(2599, 4996, "false", "a terrace 2 m high, cut off from its land by the edge of the scan"),
    ),
    "hilly 36": (
        Reason(2492, 4890, "missed", "a shed on which 19 points lie, not one window flat"),
        Reason(2559, 4864, "missed", "a shed with some 15 points, half of it below a crown"),
        Reason(2450, 4954, "false", "a dozen points of bushes 2 to 3 m up that happen to be level"),
    ),
}
