"""A few drawn houses of which everything is known, their points, and what a run says of them beside it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import laspy
import numpy as np
import pyogrio
import shapely
from numpy.typing import NDArray
from pyproj import CRS, Transformer
from shapely import Polygon, affinity

PLACE = 85200.0, 446400.0
"""South-west corner of the scene, in EPSG:28992."""
SYSTEM = CRS.from_epsg(28992)
SIDE, GROUND, NOISE = 90.0, 10.0, 0.02
"""Side of the scene, height of its ground, and noise of its points (m)."""
AREA, HEIGHT, VOLUME, OVERLAP = 0.15, 0.5, 0.1, 0.6
"""What a run may be off: share of an area, m of a ridge over the ground, share of a volume; and the least
intersection over union of an outline with the house that it stands for."""

World = NDArray[np.float64]


@dataclass(frozen=True)
class House:
    """A house with a flat or a gable roof: plan in metres about `PLACE`, heights (m) above the datum."""

    plan: Polygon
    eaves: float
    ridge: float
    volume: float


@dataclass(frozen=True)
class Scene:
    """Houses on level ground, their points (N, 3) in metres about `PLACE`, the house of each (-1: none)."""

    houses: tuple[House, ...]
    xyz: World
    house: NDArray[np.int64]


def draw_houses(rng: np.random.Generator, count: int = 3, density: float = 10.0) -> Scene:
    """A scene of `count` houses apart from each other, scanned from above at `density` (points/m²)."""
    at = rng.uniform(0.0, SIDE, (int(SIDE**2 * density), 2))
    xyz = np.column_stack([at, np.full(len(at), GROUND)])
    house = np.full(len(at), -1)
    houses = []
    places = [(22.0, 22.0), (66.0, 24.0), (24.0, 66.0), (66.0, 66.0)][:count]
    for number, (x, y) in enumerate(places):
        length, width, turn = rng.uniform(10, 16), rng.uniform(7, 10), rng.uniform(0, np.pi)
        eaves = GROUND + rng.uniform(3.0, 6.0)
        slope = 0.0 if number % 2 else rng.uniform(0.5, 0.9)
        box = shapely.box(-length / 2, -width / 2, length / 2, width / 2)
        plan = affinity.translate(affinity.rotate(box, turn, (0, 0), use_radians=True), x, y)
        inside = shapely.contains_xy(plan, at[:, 0], at[:, 1])
        across = (at[inside] - (x, y)) @ (-np.sin(turn), np.cos(turn))
        xyz[inside, 2] = eaves + slope * (width / 2 - np.abs(across))
        house[inside] = number
        ridge = eaves + slope * width / 2
        volume = length * width * (eaves - GROUND) + length * width * (ridge - eaves) / 2
        houses.append(House(plan, eaves, ridge, volume))
    xyz[:, 2] += rng.normal(0, NOISE, len(xyz))
    return Scene(tuple(houses), xyz, house)


def in_world(xyz: World) -> World:
    """Points about `PLACE` in the world."""
    return xyz + (*PLACE, 0.0)


def write_points(
    path: Path, world: World, system: CRS | None = SYSTEM, scale: float | Sequence[float] = 0.001
) -> Path:
    """Write points of the world (x, y, z as they are) as LAS 1.4 with a system as WKT; the path."""
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = np.broadcast_to(scale, 3).astype(float)
    header.offsets = np.floor(world.min(axis=0))
    if system is not None:
        header.add_crs(system)
    las = laspy.LasData(header)
    las.xyz = world
    las.return_number[:] = las.number_of_returns[:] = 1
    las.classification[:] = 1
    las.write(path)
    return path


def measured_wrong(
    scene: Scene,
    heights: bool = True,
    moved: Callable[[World], World] = in_world,
    only: Sequence[int] | None = None,
    layer: str = "footprints.gpkg",
    system: CRS = SYSTEM,
) -> Callable[[Path], str]:
    """The judge of a run's folder by the truth: what is wrong with its houses, in words; "" for nothing.

    Parameters
    ----------
    scene : Scene
        The truth.
    heights : bool
        Heights, volumes and trust count.
    moved : callable
        From points about `PLACE` to those of `system`, where the scene was moved.
    only : sequence of int or None
        The houses that are there; all.
    layer : str
        The file of the footprints.
    system : CRS
        In metres and true to length, what `moved` leads to.
    """

    def judge(out: Path) -> str:
        table = pyogrio.read_dataframe(out / layer, layer="footprints")
        if table.crs is None:
            return "the footprints have no system"
        to_metres = Transformer.from_crs(CRS(table.crs).to_2d(), system, always_xy=True)
        plans = [
            shapely.transform(shape, lambda xy: np.column_stack(to_metres.transform(*xy.T)))
            for shape in table.geometry
        ]
        numbers = range(len(scene.houses)) if only is None else only
        said: list[str] = []
        for number in numbers:
            house = scene.houses[number]
            true = shapely.transform(
                house.plan, lambda xy: moved(np.column_stack([xy, np.zeros(len(xy))]))[:, :2]
            )
            shares = [shapely.area(plan & true) / shapely.area(plan | true) for plan in plans]
            if not shares or max(shares) < OVERLAP:
                said.append(f"house {number} is not there (overlap {max(shares, default=0.0):.2f})")
                continue
            row = table.iloc[int(np.argmax(shares))]
            if abs(row.area_m2 / house.plan.area - 1) > AREA:
                said.append(f"house {number} has {row.area_m2:.0f} m² for {house.plan.area:.0f}")
            if not heights:
                continue
            ridge = row.h_max - row.h_ground
            if not abs(ridge - (house.ridge - GROUND)) <= HEIGHT:
                said.append(f"house {number} is {ridge:.1f} m high for {house.ridge - GROUND:.1f}")
            if not abs(row.volume_m3 / house.volume - 1) <= VOLUME:
                said.append(f"house {number} has {row.volume_m3:.0f} m³ for {house.volume:.0f}")
        if len(plans) > len(numbers):
            said.append(f"{len(plans)} buildings for {len(numbers)}")
        return "; ".join(said)

    return judge
