"""Houses of which a part shows no return, drawn: their plans, roofs and returns, and what is true of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import laspy
import numpy as np
import pyogrio
import shapely
from numpy.typing import NDArray
from pyproj import CRS
from shapely import Polygon, affinity

Array = NDArray[np.float64]

PLACE, SYSTEM = (85200.0, 446400.0), CRS.from_epsg(28992)
"""South-west corner of a scene, and its system."""
GROUND = 10.0
"""Height of the level ground (m)."""
FINE = 0.1
"""Side of the cells (m) by which volumes are summed."""
ROOFS = ("gable", "hip", "L", "pent", "flat", "two levels")
PARTS = ("nothing", "a face", "half a face", "a corner", "a strip", "a hole")
"""What shows no return; nothing and a hole of a tenth of the plan are there for comparison."""
PIERCED, SPLIT = 0.4, 0.6
"""Shares of the pulses at a crown that go through it, and of the others that have one more echo below."""


@dataclass(frozen=True)
class Roof:
    """A roof about the middle of its house: `faces` planes (a, b, c) over the eaves, joined by `join` of them
    over places (N, 2), and the number of the face there."""

    plan: Polygon
    faces: tuple[tuple[float, float, float], ...]
    join: Callable[[Array], NDArray[np.int64]]

    def face(self, at: Array) -> NDArray[np.int64]:
        """The face over places (N, 2)."""
        return self.join(at)

    def height(self, at: Array) -> Array:
        """The height over the eaves at places (N, 2)."""
        a, b, c = np.array(self.faces)[self.join(at)].T
        return np.asarray(a * at[:, 0] + b * at[:, 1] + c)

    @cached_property
    def cells(self) -> Array:
        """The middles (K, 2) of the fine cells of the plan."""
        west, south, east, north = self.plan.bounds
        x, y = np.meshgrid(np.arange(west + FINE / 2, east, FINE), np.arange(south + FINE / 2, north, FINE))
        at = np.column_stack([x.ravel(), y.ravel()])
        return at[shapely.contains_xy(self.plan, *at.T)]


@dataclass(frozen=True)
class House:
    """A house: its roof, place, turn (radians) and the height of its eaves over the ground; `hidden` says of
    places about its middle which of them show nothing."""

    kind: str
    part: str
    roof: Roof
    middle: tuple[float, float]
    turn: float
    eaves: float
    hidden: Callable[[Array], NDArray[np.bool_]]
    tree: bool = False

    @property
    def plan(self) -> Polygon:
        """The plan, in metres about `PLACE`."""
        turned = affinity.rotate(self.roof.plan, self.turn, (0, 0), use_radians=True)
        return affinity.translate(turned, *self.middle)

    def own(self, at: Array) -> Array:
        """Places (N, 2) of the scene about the house's middle and along its sides."""
        cos, sin = np.cos(self.turn), np.sin(self.turn)
        return (at - self.middle) @ np.array([[cos, -sin], [sin, cos]])

    @property
    def volume(self) -> float:
        """The volume (m³) over the ground."""
        return float(self.roof.plan.area * (self.eaves + self.roof.height(self.roof.cells).mean()))

    @property
    def ridge(self) -> float:
        """The highest point over the ground (m)."""
        return float(self.eaves + self.roof.height(self.roof.cells).max())

    @property
    def hidden_share(self) -> float:
        """The share of the plan that shows nothing."""
        return float(self.hidden(self.roof.cells).mean())


def lowest(faces: Sequence[tuple[float, float, float]]) -> Callable[[Array], NDArray[np.int64]]:
    """Joins planes as a roof of one ridge is: the lowest of them counts."""
    table = np.array(faces)
    return lambda at: np.argmin(at @ table[:, :2].T + table[:, 2], axis=1)


def draw_roof(kind: str, rng: np.random.Generator) -> Roof:
    """A roof of one of `ROOFS`."""
    length, width = rng.uniform(10.0, 15.0), rng.uniform(7.0, 10.0)
    x, y, s = length / 2, width / 2, rng.uniform(0.4, 1.0)
    plan = shapely.box(-x, -y, x, y)
    if kind == "gable":
        faces: tuple[tuple[float, float, float], ...] = ((0.0, s, s * y), (0.0, -s, s * y))
    elif kind == "hip":
        faces = ((0.0, s, s * y), (0.0, -s, s * y), (s, 0.0, s * x), (-s, 0.0, s * x))
    elif kind == "pent":
        slope = rng.uniform(0.1, 0.35)
        faces = ((0.0, slope, slope * y),)
    elif kind == "flat":
        faces = ((0.0, 0.0, 0.0),)
    elif kind == "two levels":
        faces, step = ((0.0, 0.0, 0.0), (0.0, 0.0, rng.uniform(2.5, 4.0))), rng.uniform(-0.2, 0.2) * length
        return Roof(plan, faces, lambda at: (at[:, 0] > step).astype(np.int64))
    else:
        deep, half = rng.uniform(5.0, 7.0), 0.4 * width
        plan = shapely.union(plan, shapely.box(x - 2 * half, -y - deep, x, 0.0))
        middle = x - half
        faces = ((0.0, s, s * y), (0.0, -s, s * y), (s, 0.0, s * (half - middle)), (-s, 0.0, s * x))
        return Roof(plan, faces, l_joined(faces, y))
    return Roof(plan, faces, lowest(faces))


def l_joined(
    faces: Sequence[tuple[float, float, float]], half: float
) -> Callable[[Array], NDArray[np.int64]]:
    """Joins the gables of a house, `half` wide, and of its wing: the higher one of the two counts, each where
    it stands."""
    table = np.array(faces)

    def join(at: Array) -> NDArray[np.int64]:
        heights = at @ table[:, :2].T + table[:, 2]
        house = np.where(np.abs(at[:, 1]) <= half, heights[:, :2].min(axis=1), -np.inf)
        wing = np.where(at[:, 1] <= 0.0, heights[:, 2:].min(axis=1), -np.inf)
        return np.where(house >= wing, heights[:, :2].argmin(axis=1), 2 + heights[:, 2:].argmin(axis=1))

    return join


def draw_hidden(roof: Roof, part: str, rng: np.random.Generator) -> Callable[[Array], NDArray[np.bool_]]:
    """What of a roof shows nothing: a mask of places about its middle."""
    west, south, east, north = roof.plan.bounds
    face = int(rng.integers(len(roof.faces)))
    cut, side, way = rng.uniform(-0.5, 0.5), rng.choice([-1.0, 1.0]), rng.choice([-1.0, 1.0])
    if part == "nothing":
        return lambda at: np.zeros(len(at), bool)
    if part == "a hole":
        reach = 0.5 * np.sqrt(0.1 * roof.plan.area)
        return lambda at: (np.abs(at) <= reach).all(axis=1)
    if part == "a face" and len(roof.faces) > 1:
        return lambda at: roof.face(at) == face
    if part in ("a face", "half a face"):
        middle = float(np.median(roof.cells[roof.face(roof.cells) == face, 0])) + cut
        return lambda at: (roof.face(at) == face) & (side * (at[:, 0] - middle) > 0.0)
    if part == "a corner":
        deep, wide = rng.uniform(0.3, 0.5) * (east - west), rng.uniform(0.4, 0.7) * (north - south)
        corner = np.array([east if side > 0 else west, north if way > 0 else south])
        return lambda at: (np.abs(at - corner) <= (deep, wide)).all(axis=1)
    wide, off, axis = rng.uniform(1.5, 3.0), rng.uniform(-0.3, 0.3), int(rng.integers(2))
    centre = off * ((east - west) if axis == 0 else (north - south))
    return lambda at: np.abs(at[:, axis] - centre) <= wide / 2


def draw_house(
    kind: str, part: str, middle: tuple[float, float], rng: np.random.Generator, tree: bool = False
) -> House:
    """A house of one of `ROOFS` at a place, which shows nothing of one of `PARTS`."""
    roof = draw_roof(kind, rng)
    hidden = draw_hidden(roof, part, rng)
    turn, eaves = rng.uniform(0.0, np.pi), rng.uniform(2.8, 6.0)
    return House(kind, part, roof, middle, turn, eaves, hidden, tree)


@dataclass(frozen=True)
class Returns:
    """Returns (N, 3) about `PLACE` with number and count of each pulse's; `house` (N,) is what each lies on,
    -1 for none."""

    xyz: Array
    number: NDArray[np.int64]
    count: NDArray[np.int64]
    house: NDArray[np.int64]


@dataclass(frozen=True)
class Crown:
    """A crown: an ellipsoid about x, y, z, as wide and as high as its radii; shares of the pulses that go
    through it, and of the others that have one more echo."""

    middle: tuple[float, float, float]
    wide: float
    high: float
    pierced: float = PIERCED
    split: float = SPLIT


def tree_beside(house: House, rng: np.random.Generator) -> Crown:
    """A crown whose edge hangs a metre or less over a side of a house."""
    wide = rng.uniform(2.0, 3.5)
    ring = house.plan.buffer(wide - rng.uniform(0.0, 1.0)).exterior
    at = ring.interpolate(rng.uniform(), normalized=True)
    top = house.ridge * rng.uniform(0.9, 1.5)
    high = min(rng.uniform(1.5, 3.0), 0.4 * top)
    return Crown((at.x, at.y, GROUND + top - high), wide, high)


def scan(
    houses: Sequence[House],
    crowns: Sequence[Crown],
    side: float,
    density: float,
    noise: float,
    rng: np.random.Generator,
) -> Returns:
    """The returns of a square scene from above at a density (pulses/m²): of houses on level ground, less what
    they hide, and of crowns."""
    at = rng.uniform(0.0, side, (int(side**2 * density), 2))
    z, owner, shown = np.full(len(at), GROUND), np.full(len(at), -1), np.ones(len(at), bool)
    for number, house in enumerate(houses):
        west, south, east, north = house.plan.bounds
        near = np.flatnonzero(
            (at[:, 0] >= west) & (at[:, 0] <= east) & (at[:, 1] >= south) & (at[:, 1] <= north)
        )
        own = near[shapely.contains_xy(house.plan, *at[near].T)]
        places = house.own(at[own])
        z[own] = GROUND + house.eaves + house.roof.height(places)
        owner[own], shown[own] = number, ~house.hidden(places)
    xyz = np.column_stack([at, z + rng.normal(0.0, noise, len(at))])
    leaves = []
    first, count = np.ones(len(at), np.int64), np.ones(len(at), np.int64)
    for crown in crowns:
        x, y, middle = crown.middle
        away = np.hypot(at[:, 0] - x, at[:, 1] - y) / crown.wide
        under = np.flatnonzero((away < 1.0) & (rng.uniform(size=len(at)) > crown.pierced))
        height = middle + crown.high * np.sqrt(1.0 - away[under] ** 2) * rng.uniform(-0.4, 1.0, len(under))
        over = height > xyz[under, 2] + 0.5
        under, height = under[over], height[over]
        split = rng.uniform(size=len(under)) < crown.split
        shown[under[~split]] = False
        first[under[split]] = count[under[split]] = 2
        leaves.append(np.column_stack([at[under], height, np.where(split, 2, 1)]))
    leaf = np.concatenate([np.zeros((0, 4)), *leaves])
    ones = np.ones(len(leaf), np.int64)
    return Returns(
        np.concatenate([xyz[shown], leaf[:, :3]]),
        np.concatenate([first[shown], ones]),
        np.concatenate([count[shown], leaf[:, 3].astype(np.int64)]),
        np.concatenate([owner[shown], -ones]),
    )


def write_returns(path: Path, returns: Returns) -> Path:
    """Write returns as LAS 1.4; the path."""
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, 0.001), np.array([*PLACE, 0.0])
    header.add_crs(SYSTEM)
    las = laspy.LasData(header)
    las.xyz = returns.xyz + (*PLACE, 0.0)
    las.return_number, las.number_of_returns = returns.number, returns.count
    las.classification = np.ones(len(returns.xyz), np.uint8)
    las.write(path)
    return path


def write_plans(path: Path, plans: Sequence[Polygon]) -> Path:
    """Write plans as a map whose `id` counts them; the path."""
    wkb = shapely.to_wkb([affinity.translate(plan, *PLACE) for plan in plans])
    names = np.array([str(number) for number in range(len(plans))], dtype=object)
    pyogrio.raw.write(
        path,
        np.array(wkb, object),
        [names],
        ["id"],
        geometry_type="Polygon",
        crs=SYSTEM.to_wkt(),
        driver="GPKG",
    )
    return path
