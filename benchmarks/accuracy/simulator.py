"""How alike a simulated scan is to a real one: the same figures on both.

Run `EAVES_DATA=... python -m benchmarks.accuracy.simulator`.
"""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path

import laspy
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmarks.table import keep
from eaves.simulate.flight import Flight
from eaves.simulate.objects.streets import TownStyle
from eaves.simulate.scanner import scan_town
from eaves.simulate.town import simulate_town

COMMAND = "python -m benchmarks.accuracy.simulator"
SAMPLE = 20_000
"""Points a figure of roughness is taken from."""

NEIGHBOURS = 12
WALL_ABOVE, WALL_WITHIN = 0.6, 0.3
"""A building point with another building point this much above it (m) within that radius in plan is no roof
point.
"""

CELL = 1.0


@dataclass(frozen=True, eq=False)
class Scan:
    """A cloud with coarse classes: ground, building, vegetation (more than 2 m above ground), other."""

    xyz: NDArray[np.float64]
    number: NDArray[np.int64]
    of: NDArray[np.int64]
    kind: NDArray[np.str_]


def above_ground(xyz: NDArray[np.float64], ground: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Height (N,) of points over the nearest ground points' mean."""
    near = cKDTree(xyz[ground, :2]).query(xyz[:, :2], k=3)[1]
    return np.asarray(xyz[:, 2] - xyz[ground, 2][near].mean(axis=1))


def real(paths: list[Path], vegetation: tuple[int, ...]) -> Scan:
    """A vendor's cloud; `vegetation` are the classes that hold its trees."""
    clouds = [laspy.read(path) for path in paths]
    xyz = np.concatenate([cloud.xyz for cloud in clouds])
    classes = np.concatenate([np.asarray(cloud.classification) for cloud in clouds])
    number = np.concatenate([np.asarray(cloud.return_number, np.int64) for cloud in clouds])
    of = np.concatenate([np.asarray(cloud.number_of_returns, np.int64) for cloud in clouds])
    return Scan(xyz - xyz.min(axis=0), number, of, kinds(xyz, classes, vegetation))


def kinds(
    xyz: NDArray[np.float64], classes: NDArray[np.uint8], vegetation: tuple[int, ...]
) -> NDArray[np.str_]:
    """Ground, building, vegetation or other for each point."""
    high = above_ground(xyz, classes == 2) > 2.0
    kind = np.full(len(xyz), "other     ")
    kind[classes == 2], kind[classes == 6] = "ground", "building"
    kind[np.isin(classes, vegetation) & high] = "vegetation"
    return np.char.strip(kind)


def simulated(density: float, half_angle: float, style: TownStyle, leaf_loss: float, seed: int) -> Scan:
    """A scan of a generated town of 200 m by 200 m."""
    town = simulate_town(0.04, seed=seed, style=style, leaf_loss=leaf_loss)
    scene = scan_town(town, density, seed=seed, flight=Flight(half_angle_deg=half_angle))
    cloud = scene.cloud
    assert cloud.return_number is not None and cloud.number_of_returns is not None
    kind = kinds(cloud.xyz, scene.truth_class, (3, 4, 5))
    return Scan(
        cloud.xyz, cloud.return_number.astype(np.int64), cloud.number_of_returns.astype(np.int64), kind
    )


def roughness(xyz: NDArray[np.float64], some: NDArray[np.int64]) -> float:
    """Median distance (m, root mean square) of a point's neighbours from the plane through them."""
    some = some[:: max(1, len(some) // SAMPLE)]
    if len(some) < NEIGHBOURS:
        return float("nan")
    tree = cKDTree(xyz[some]) if len(some) < NEIGHBOURS else cKDTree(xyz)
    near = xyz[tree.query(xyz[some], k=NEIGHBOURS)[1]]
    centred = near - near.mean(axis=1, keepdims=True)
    spread = np.linalg.eigvalsh(np.einsum("nki,nkj->nij", centred, centred) / NEIGHBOURS)[:, 0]
    return float(np.median(np.sqrt(np.maximum(spread, 0.0))))


def wall_share(xyz: NDArray[np.float64]) -> float:
    """Share of building points (N, 3) with a building point more than 0.6 m above them within 0.3 m in
    plan.
    """
    some = np.arange(len(xyz))[:: max(1, len(xyz) // SAMPLE)]
    near = cKDTree(xyz[:, :2]).query_ball_point(xyz[some, :2], WALL_WITHIN)
    return float(np.mean([xyz[n, 2].max() > xyz[k, 2] + WALL_ABOVE for k, n in zip(some, near, strict=True)]))


def figures(scan: Scan) -> dict[str, float]:
    """Everything that is compared."""
    xyz, of, number, kind = scan.xyz, scan.of, scan.number, scan.kind
    last = number == of
    cells = np.unique(np.floor(xyz[:, :2] / CELL).astype(np.int64), axis=0)
    size = cells.max(axis=0) - cells.min(axis=0) + 1
    tree, roof, ground = (np.flatnonzero(kind == name) for name in ("vegetation", "building", "ground"))
    through = number[tree] < of[tree]
    return {
        "last returns per m²": float(last.sum() / len(cells) / CELL**2),
        "points per pulse": float(len(xyz) / (number == 1).sum()),
        "share of points in pulses with 2": float(np.mean(of == 2)),
        "… with 3": float(np.mean(of == 3)),
        "… with 4 or more": float(np.mean(of >= 4)),
        "vegetation: share of points": len(tree) / len(xyz),
        "vegetation: points per pulse that begins in it": float(of[tree][number[tree] == 1].mean()),
        "vegetation: share of echoes with another below": float(through.mean()),
        "vegetation: roughness (m)": roughness(xyz[tree], np.arange(len(tree))),
        "building: share of points": len(roof) / len(xyz),
        "building: share of points in pulses of several": float(np.mean(of[roof] > 1)),
        "building: share of wall points": wall_share(xyz[roof]),
        "building: roughness (m)": roughness(xyz[roof], np.arange(len(roof))),
        "ground: roughness (m)": roughness(xyz[ground], np.arange(len(ground))),
        "ground: share of points in pulses of several": float(np.mean(of[ground] > 1)),
        "share of 1 m cells without a point": 1 - len(cells) / float(size.prod()),
    }


def main() -> None:
    """Print and keep the table."""
    data = Path(os.environ["EAVES_DATA"])
    delft = figures(real([data / "delft" / "ahn3.laz"], (1,)))
    ign = figures(real(sorted((data / "ign_urban").glob("*.laz")), (3, 4, 5)))
    start = time.perf_counter()
    like_delft = figures(simulated(12.5, 30.0, "centre", 0.4, seed=11))
    like_ign = figures(simulated(24.0, 25.0, "mixed", 2.5, seed=12))
    spent = time.perf_counter() - start
    rows = [
        {
            "figure": name,
            "delft (AHN3)": delft[name],
            "simulated, centre, ±30°, out of leaf": like_delft[name],
            "ign_urban (LiDAR HD)": ign[name],
            "simulated, mixed, ±25°, in leaf": like_ign[name],
        }
        for name in delft
    ]
    keep(
        "simulator",
        "The simulated scan beside a real one",
        rows,
        COMMAND,
        f"Towns of 200 m by 200 m, flat, seeds 11 and 12. Simulation and its figures: {spent:.0f} s.",
    )


if __name__ == "__main__":
    main()
