"""Walls that a building shares with its neighbours, and its surfaces in the open for energy models."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from eaves.figures.attributes import QUARTERS, quarter_of
from eaves.geometry.face_table import FaceTable
from eaves.model import WALL_SURFACE, BuildingModel, Failure

PARTY_WALLS = "party_wall_area_m2"

PARTY_GAP = 0.3
"""Walls of two buildings that are nearer (m) are one wall: maps and outlines are no better than that."""

MOST_TURN_DEG = 5.0
"""Walls that face each other to this angle (degrees) are parallel."""

DECIMALS = 3


@dataclass(frozen=True, eq=False)
class Walls:
    """Walls as upright polygons: `start`, `end` (W, 2) in plan about `origin` (world metres), `outward`
    (W, 2) unit normals, `corners` the corners (K, 3) of each.
    """

    origin: tuple[float, float]
    start: NDArray[np.float64]
    end: NDArray[np.float64]
    outward: NDArray[np.float64]
    corners: tuple[NDArray[np.float64], ...]

    @classmethod
    def of(cls, model: BuildingModel) -> Walls:
        """The walls of a model's finest level, about the origin of its footprint."""
        faces = FaceTable.of_solids(model.solids.get(model.lod, ()), WALL_SURFACE)
        faces = faces.take(np.hypot(*faces.vectors[:, :2].T) > 0.0)
        corners = [faces.rings_of(face)[0] for face in range(len(faces))]
        start = [places[0, :2] for places in corners]
        far = [np.hypot(*(places[:, :2] - places[0, :2]).T).argmax() for places in corners]
        end = [places[last, :2] for places, last in zip(corners, far, strict=True)]
        outward = faces.vectors[:, :2] / np.hypot(*faces.vectors[:, :2].T)[:, None]
        return cls(model.footprint.origin, pairs(start), pairs(end), outward, tuple(corners))

    def about(self, origin: tuple[float, float]) -> Walls:
        """The same walls about another origin (world metres)."""
        shift = np.array([*np.subtract(self.origin, origin), 0.0])
        if not shift.any():
            return self
        moved = tuple(places + shift for places in self.corners)
        return Walls(origin, self.start + shift[:2], self.end + shift[:2], self.outward, moved)

    def areas(self) -> NDArray[np.float64]:
        """Area (m², W) of each wall."""
        return np.asarray(shapely.area(self.faces), np.float64)

    @cached_property
    def faces(self) -> NDArray[np.object_]:
        """The walls (W,) as polygons of length along themselves and height."""
        return upright(self.corners, self.start, self.end)

    def lines(self) -> NDArray[np.object_]:
        """The walls in plan (W,)."""
        return np.asarray(shapely.linestrings(np.stack([self.start, self.end], axis=1)), object)


def pairs(rows: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Rows of two numbers as an array (K, 2), also when there are none."""
    return np.array(rows, np.float64).reshape(-1, 2)


def shared_areas(subject: Walls, neighbours: Sequence[Walls]) -> NDArray[np.float64]:
    """Area (m², W) of each wall that others stand against.

    Two walls stand against each other where they face each other at most `PARTY_GAP` apart; what of one
    rises above the other is not shared.
    """
    area = np.zeros(len(subject.corners))
    if not len(area):
        return area
    tree = shapely.STRtree(subject.lines())
    corners: list[NDArray[np.float64]] = []
    against: list[int] = []
    for neighbour in neighbours:
        walls = neighbour.about(subject.origin)
        if not walls.corners:
            continue
        neighbouring, subject_wall = tree.query(walls.lines(), predicate="dwithin", distance=PARTY_GAP)
        facing = (walls.outward[neighbouring] * subject.outward[subject_wall]).sum(axis=1)
        facing = facing < -np.cos(np.radians(MOST_TURN_DEG))
        corners += [walls.corners[k] for k in neighbouring[facing].tolist()]
        against += subject_wall[facing].tolist()
    covers = upright(corners, subject.start[against], subject.end[against])
    by_wall: dict[int, list[BaseGeometry]] = {}
    for wall, cover in zip(against, covers, strict=True):
        by_wall.setdefault(wall, []).append(cover)
    unions = [parts[0] if len(parts) == 1 else shapely.union_all(parts) for parts in by_wall.values()]
    walled = list(by_wall)
    area[walled] = shapely.area(shapely.intersection(subject.faces[walled], unions))
    return area


def upright(
    corners: Sequence[NDArray[np.float64]], start: NDArray[np.float64], end: NDArray[np.float64]
) -> NDArray[np.object_]:
    """The corners (K, 3) of walls as polygons (W,) of length along the lines from `start` to `end` (W, 2) and
    height.
    """
    if not corners:
        return np.empty(0, object)
    wall = np.repeat(np.arange(len(corners)), [len(places) for places in corners])
    places = np.concatenate(corners)
    step = end - start
    step /= np.maximum(np.hypot(step[:, 0], step[:, 1]), 1e-9)[:, None]
    away = places[:, :2] - start[wall]
    along = away[:, 0] * step[wall, 0] + away[:, 1] * step[wall, 1]
    rings = shapely.linearrings(np.column_stack([along, places[:, 2]]), indices=wall)
    return np.asarray(shapely.make_valid(shapely.polygons(rings)), object)


def wall_figures(subject: Walls, neighbours: Sequence[Walls]) -> dict[str, float]:
    """Areas (m²) of walls that `neighbours` stand against, and of free ones by quarter of the compass."""
    shared = shared_areas(subject, neighbours)
    free = np.maximum(subject.areas() - shared, 0.0)
    turn = np.degrees(np.arctan2(subject.outward[:, 0], subject.outward[:, 1])) % 360.0
    sides = dict.fromkeys(QUARTERS, 0.0)
    for azimuth, area in zip(turn, free, strict=True):
        sides[quarter_of(float(azimuth))] += float(area)
    by_side = {f"free_wall_{side}_m2": area for side, area in sides.items()}
    areas = {PARTY_WALLS: float(shared.sum()), "free_wall_area_m2": float(free.sum()), **by_side}
    return {name: round(area, 2) for name, area in areas.items()}


def envelope_figures(
    walls: Mapping[str, float], attributes: Mapping[str, Any], area_m2: float, map_storeys: Any = None
) -> dict[str, Any]:
    """The walls with floor area, envelope (free walls, roof, ground; m²) and its share of the volume (1/m).

    Storeys and floors are the map's where it has them, else estimated.
    """
    roof, volume = attributes.get("roof_area_m2"), attributes.get("volume_m3")
    figures: dict[str, Any] = {**walls}
    floors = attributes.get("floor_area_m2")
    if isinstance(map_storeys, int) and map_storeys > 0:
        floors = area_m2 * map_storeys
    if floors is not None:
        figures |= {"floor_storeys": max(1, round(floors / area_m2)), "floor_area_m2": round(floors, 1)}
    if roof is not None:
        envelope = walls["free_wall_area_m2"] + roof + area_m2
        figures["envelope_m2"] = round(envelope, 1)
        if volume:
            figures["envelope_per_volume"] = round(envelope / volume, 3)
    return figures


def share_walls(models: Sequence[BuildingModel | Failure]) -> list[BuildingModel | Failure]:
    """The models with the walls that they share with each other, their numbers to a millimetre: the last step
    before they are written.

    Parameters
    ----------
    models : sequence of BuildingModel or Failure
        Buildings with their footprints about any origins; failures stay as they are.

    Returns
    -------
    list of BuildingModel or Failure
        In the same order, with the areas (m²) of party walls and of free ones, by quarter of the compass, and
        the floors and the envelope that follow, as docs/columns.md lists them.

    Raises
    ------
    AttributeError
        When an element is no building.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> house = nine_roofs_on_a_slope(density=1.0).buildings[0].model()
    >>> eaves.share_walls([house])[0].attributes["party_wall_area_m2"]
    0.0
    """
    placed = [model for model in models if model.footprint is not None]
    shapes = np.array([model.footprint.world for model in placed if model.footprint is not None], object)
    walls = iter(walls_between(shapes, range(len(placed)), cache(lambda number: walls_of(placed[number]))))
    return [with_walls(model, None if model.footprint is None else next(walls)) for model in models]


def walls_between(
    shapes: NDArray[np.object_], subjects: Sequence[int], load: Callable[[int], Walls | None]
) -> list[dict[str, float] | None]:
    """The walls (`wall_figures`) of some of several buildings, by number, beside all of them; None for one
    without solids. `shapes` are their outlines in the world, `load` gives the walls of one."""
    first, second = shapely.STRtree(shapes).query(
        shapes[list(subjects)], predicate="dwithin", distance=PARTY_GAP
    )
    found: list[dict[str, float] | None] = []
    for place, number in enumerate(subjects):
        own = load(number)
        near = [load(other) for other in np.sort(second[first == place]).tolist() if own and other != number]
        known = [walls for walls in near if walls is not None]
        found.append(None if own is None else wall_figures(own, known))
    return found


def walls_of(outcome: BuildingModel | Failure) -> Walls | None:
    """The walls of a building that has solids."""
    return Walls.of(outcome) if isinstance(outcome, BuildingModel) and outcome.solids else None


def with_walls(
    outcome: BuildingModel | Failure, walls: Mapping[str, float] | None
) -> BuildingModel | Failure:
    """The result of a building, a model with the figures that follow from its walls (`wall_figures`)."""
    if not isinstance(outcome, BuildingModel):
        return outcome
    attributes, storeys = outcome.attributes, outcome.footprint.attributes.get("storeys")
    if walls is not None:
        attributes = attributes | envelope_figures(walls, attributes, outcome.footprint.polygon.area, storeys)
    return outcome.with_(attributes=with_decimals(attributes))


def with_decimals(value: Any) -> Any:
    """Attributes with every number to 0.001 of its unit, a millimetre of heights: more is no measurement."""
    if isinstance(value, float):
        return round(value, DECIMALS)
    if isinstance(value, dict):
        return {name: with_decimals(item) for name, item in value.items()}
    return [with_decimals(item) for item in value] if isinstance(value, list | tuple) else value
