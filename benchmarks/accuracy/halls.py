"""Halls that stand on the terrain beside terraces, as wide and as high, that are terrain.

`python -m benchmarks.accuracy.halls`
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from itertools import product

import numpy as np

from benchmarks.table import keep
from eaves.ground import classify_ground
from eaves.model import Mask, PointCloud, Points, Values

COMMAND = "python -m benchmarks.accuracy.halls"
EAVES_M = 6.0
"""Height of the eaves over the highest terrain at the hall."""
RAMP_M, RAMP_SLOPE = 6.0, 0.12
"""Width and slope of the way up to the terrace."""
NOISE_M = 0.03
ROOFS = ("flat", "saw-tooth", "vaulted")


@dataclass(frozen=True, eq=False)
class HallScene:
    """A scan (N,) of a hall and of a terrace as wide and as high, and which points lie on them."""

    cloud: PointCloud
    hall: Mask
    terrace: Mask


def simulate_hall(width: float, roof: str, slope: float, density: float = 2.0, seed: int = 0) -> HallScene:
    """A hall `width` by 0.6 `width` (m) on terrain that rises east, and a terrace of its size north of it.

    The terrace is as high as the eaves, has walls all round, and is terrain: a ramp leads up to it from the
    east. Points lie where a regular scan puts them, two decimetres off at random, and on the walls.
    """
    rng = np.random.default_rng(seed)
    depth, free = 0.6 * width, 0.4 * width + 30.0
    ramp = EAVES_M / RAMP_SLOPE + 20.0
    east, north = width + 2 * free + ramp, 2 * depth + 3 * free
    step = 1.0 / np.sqrt(density)
    grid = np.stack(np.meshgrid(np.arange(0, east, step), np.arange(0, north, step)), axis=-1).reshape(-1, 2)
    xy = grid + rng.normal(0.0, 0.2, grid.shape)
    level = slope * (free + width) + EAVES_M
    hall, terrace = (inside(xy, free, south, width, depth) for south in (free, 2 * free + depth))
    x, y = xy[:, 0] - free, xy[:, 1] - free
    z = slope * xy[:, 0]
    z[hall] = level + over_eaves(x[hall], y[hall], width, depth, roof)
    z[terrace] = level
    middle = 2 * free + 1.5 * depth
    way = np.abs(xy[:, 1] - middle) < RAMP_M / 2.0
    way &= (x >= width) & (level - RAMP_SLOPE * (x - width) > z)
    z[way] = level - RAMP_SLOPE * (x[way] - width)
    z += rng.normal(0.0, NOISE_M, len(z))
    walls = np.concatenate(
        [
            wall_points(free, south, width, depth, slope, level, step, rng)
            for south in (free, 2 * free + depth)
        ]
    )
    cloud = PointCloud.from_world(np.concatenate([np.c_[xy, z], walls]))
    none = np.zeros(len(walls), bool)
    return HallScene(cloud, np.r_[hall, none], np.r_[terrace, none])


def inside(xy: Points, west: float, south: float, width: float, depth: float) -> Mask:
    """Which points (N, 2) lie in a rectangle."""
    x, y = xy[:, 0] - west, xy[:, 1] - south
    return np.asarray((x >= 0) & (x < width) & (y >= 0) & (y < depth))


def over_eaves(x: Values, y: Values, width: float, depth: float, roof: str) -> Values:
    """Height of a roof over its eaves."""
    if roof == "saw-tooth":  # teeth of 12 m, 4 m high, their steep sides glazed
        return np.asarray(4.0 * (x % 12.0) / 12.0)
    if roof == "vaulted":  # barrels of up to 40 m, a fifth as high as wide
        span = depth / np.ceil(depth / 40.0)
        return np.asarray(0.8 * span * ((y % span) / span) * (1.0 - (y % span) / span))
    return np.zeros_like(x)


def wall_points(
    west: float,
    south: float,
    width: float,
    depth: float,
    slope: float,
    level: float,
    step: float,
    rng: np.random.Generator,
) -> Points:
    """A few echoes (K, 3) from the walls of a rectangle."""
    count = int(0.3 * 2 * (width + depth) / step)
    along = rng.uniform(0.0, 2 * (width + depth), count)
    x = np.where(along < width, along, np.where(along < 2 * width, along - width, 0.0))
    y = np.where(along < width, 0.0, np.where(along < 2 * width, depth, along - 2 * width))
    second = along >= 2 * width + depth
    x[second], y[second] = width, y[second] - depth
    foot = slope * (west + x)
    return np.asarray(np.c_[west + x, south + y, foot + rng.uniform(0.0, 1.0, count) * (level - foot)])


def judge_scenes() -> None:
    """Every roof on every slope, at widths up to 500 m."""
    rows: list[dict[str, object]] = []
    for width, roof, slope in product((50.0, 120.0, 250.0, 500.0), ROOFS, (0.0, 0.05, 0.1, 0.15)):
        if width > 250.0 and slope not in (0.0, 0.15):
            continue
        scene = simulate_hall(width, roof, slope, density=2.0)
        ground = classify_ground(scene.cloud).ground
        free = ~scene.hall & ~scene.terrace
        rows.append(
            {
                "width m": width,
                "roof": roof,
                "slope %": 100 * slope,
                "points": len(ground),
                "hall not ground": float((~ground[scene.hall]).mean()),
                "terrace ground": float(ground[scene.terrace].mean()),
                "terrain ground": float(ground[free].mean()),
            }
        )
    found, kept = (
        np.mean([float(str(row[name])) > 0.99 for row in rows])
        for name in ("hall not ground", "terrace ground")
    )
    note = (
        f"Halls found (99 % of the roof): {found:.3f}; terraces kept (99 %): {kept:.3f}. Of the terraces the "
        "ramps are left out; points on walls count with the terrain, and are not ground."
    )
    keep("halls", "Halls beside terraces of their height", rows, COMMAND, note)


def main() -> None:
    """Print and keep the table."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    judge_scenes()


if __name__ == "__main__":
    main()
