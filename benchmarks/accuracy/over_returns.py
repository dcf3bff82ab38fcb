"""Roofs over their returns: corners of models that lie higher than anything that was measured there.

Run `python -m benchmarks.accuracy.over_returns RUN POINTS [--metres-per-unit 0.3048006]`. A corner rises when
it lies over the highest return (noise apart) within max(1 m, 2 spacings) of the footprint by more than
max(0.15 m, 3 σ of its planes), unless two planes that have returns near the corner meet in it. σ is that of
a normal distribution with the median distance of the returns from the faces they lie in.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path

import laspy
import numpy as np
import pyogrio
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Array = NDArray[np.float64]

LEAST, SIGMAS, REACH, SPACINGS = 0.15, 3.0, 1.0, 2.0
"""What the law allows: metres, sigmas; metres and spacings in which returns count."""
SAME, ALONGSIDE, TURN = 0.05, 0.1, 0.02
"""Corners nearer than this (m) are one; returns so far (m) beside a face are its own; planes whose slopes
differ by more (m/m) are two."""
MEDIAN_TO_SIGMA = 1.4826
NOISE_CLASSES = (7, 18)


def roof_faces(run: Path) -> dict[str, list[list[Array]]]:
    """The roof faces of LoD 2.2 of each building of a run, as rings of corners (K, 3)."""
    faces: dict[str, list[list[Array]]] = {}
    for file in sorted(run.rglob("*.city.jsonl")):
        with file.open(encoding="utf-8") as lines:
            frame = json.loads(next(lines))["transform"]
            for line in lines:
                feature = json.loads(line)
                corners = np.array(feature["vertices"], float).reshape(-1, 3)
                corners = corners * frame["scale"] + frame["translate"]
                own = faces.setdefault(str(feature["id"]), [])
                for item in feature["CityObjects"].values():
                    for geometry in item.get("geometry", []):
                        if str(geometry.get("lod")) == "2.2" and "semantics" in geometry:
                            own += [[corners[ring] for ring in face] for face in roofs_in(geometry)]
    return {name: own for name, own in faces.items() if own}


def roofs_in(geometry: dict) -> Iterator[list[list[int]]]:
    """The faces of a geometry that are roofs, as rings of numbers of corners."""
    kinds = [surface["type"] for surface in geometry["semantics"]["surfaces"]]
    stack = [(geometry["boundaries"], geometry["semantics"]["values"])]
    while stack:
        parts, values = stack.pop()
        if isinstance(values, list):
            stack += zip(parts, values, strict=True)
        elif values is not None and kinds[values] == "RoofSurface":
            yield parts


def plane_of(ring: Array) -> Array | None:
    """The plane (a, b, c) through a ring (K, 3); None for an upright one."""
    local = ring - ring[0]
    normal = np.cross(local, np.roll(local, -1, axis=0)).sum(axis=0)
    if abs(normal[2]) < 1e-9:
        return None
    a, b = -normal[:2] / normal[2]
    return np.array([a, b, ring[0, 2] - a * ring[0, 0] - b * ring[0, 1]])


def rise(faces: list[list[Array]], own: Array, reach: float) -> float:
    """How far (m) the highest corner that the law forbids lies over the returns (N, 3); 0 where none does."""
    top = own[:, 2].max()
    if max(ring[:, 2].max() for rings in faces for ring in rings) - top <= LEAST:
        return 0.0
    tree, worst = cKDTree(own[:, :2]), 0.0
    planes = [plane_of(rings[0]) for rings in faces]
    away = [
        np.abs(own @ np.append(-plane[:2], 1.0) - plane[2])[
            shapely.contains_xy(shapely.Polygon(rings[0][:, :2]), *own[:, :2].T)
        ]
        for plane, rings in zip(planes, faces, strict=True)
        if plane is not None
    ]
    allowed = max(LEAST, SIGMAS * MEDIAN_TO_SIGMA * float(np.median(np.concatenate(away))))
    shapes = [shapely.Polygon(rings[0][:, :2]).buffer(ALONGSIDE) for rings in faces]
    for corner in np.unique(np.vstack([ring for rings in faces for ring in rings]), axis=0):
        if corner[2] - top <= max(allowed, worst):
            continue
        near = own[tree.query_ball_point(corner[:2], reach)]
        meeting: list[Array] = []
        for rings, shape, plane in zip(faces, shapes, planes, strict=True):
            if plane is None or not any(
                (np.linalg.norm(ring - corner, axis=1) < SAME).any() for ring in rings
            ):
                continue
            off = np.abs(near @ np.append(-plane[:2], 1.0) - plane[2])
            is_shown = (shapely.contains_xy(shape, *near[:, :2].T) & (off <= 2 * allowed)).any()
            if is_shown and all(np.abs(plane[:2] - other[:2]).max() > TURN for other in meeting):
                meeting.append(plane)
        if len(meeting) < 2:
            worst = float(corner[2] - top)
    return worst


def read_returns(points: Path, metres_per_unit: float = 1.0) -> Array:
    """The returns of a file, or of the files in a folder, without noise (m)."""
    files = [points] if points.is_file() else sorted(points.rglob("*.la[sz]"))
    clouds = [laspy.read(file) for file in files]
    return (
        np.vstack([las.xyz[~np.isin(las.classification, NOISE_CLASSES)] for las in clouds]) * metres_per_unit
    )


def risen(run: Path, returns: Array, metres_per_unit: float = 1.0) -> dict[str, float]:
    """How far (m) each model of a run rises over the returns (N, 3; m) by more than the law allows; 0 where
    it does not."""
    table = pyogrio.read_dataframe(run / "footprints.gpkg", layer="footprints")
    cells = np.unique(np.floor(returns[:, :2] / 4.0), axis=0)
    spacing = float(np.sqrt(16.0 * len(cells) / len(returns)))
    reach = max(REACH, SPACINGS * spacing)
    order = np.argsort(returns[:, 0])
    returns = returns[order]
    found: dict[str, float] = {}
    faces = roof_faces(run)
    for row in table.itertuples():
        if str(row.id) not in faces or row.geometry is None:
            continue
        plan = shapely.transform(row.geometry, lambda xy: xy * metres_per_unit)
        west, south, east, north = plan.buffer(reach).bounds
        own = returns[slice(*np.searchsorted(returns[:, 0], [west, east]))]
        own = own[(own[:, 1] >= south) & (own[:, 1] <= north)]
        own = own[shapely.dwithin(plan, shapely.points(own[:, :2]), reach)]
        if len(own):
            scaled = [[ring * metres_per_unit for ring in rings] for rings in faces[str(row.id)]]
            found[str(row.id)] = rise(scaled, own, reach)
    return found


def main() -> None:
    """Print how many models of a run rise over their returns, and which."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("run", type=Path)
    parser.add_argument("points", type=Path)
    parser.add_argument("--metres-per-unit", type=float, default=1.0)
    asked = parser.parse_args()
    unit = asked.metres_per_unit
    found = risen(asked.run, read_returns(asked.points, unit), unit)
    over = {name: round(value, 2) for name, value in found.items() if value > 0.0}
    print({"models": len(found), "over their returns": len(over), "which": over})


if __name__ == "__main__":
    main()
