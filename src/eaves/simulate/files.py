"""A simulation on disk: the points with their truth, the reference models, footprints and planes."""

from __future__ import annotations

import json
from datetime import date
from pathlib import Path
from typing import Any

import laspy
import numpy as np

from eaves.formats import Row, atomic, pyproj_crs, undated, write_cityjson, write_geopackage
from eaves.simulate.objects.exact import ExactBuilding, ExactScene

STEP = 0.001
"""Resolution of written coordinates (m)."""

UNDATED = date(2000, 1, 1)
"""Creation date of every file, so that the same seed gives the same bytes."""

POINTS, MODELS, VECTORS, SUMMARY = "points.laz", "reference.city.json", "reference.gpkg", "simulation.json"


def write_simulation(
    scene: ExactScene, folder: str | Path, settings: dict[str, Any] | None = None
) -> dict[str, Path]:
    """Write a scene to a folder. The same scene gives the same bytes.

    points.laz: LAS 1.4, format 6, with colours 7, with near infrared 8; the class of a point is its true
    one, and the extra dimensions `building_id` and `plane_id` are the numbers of its building and roof face
    (0: none).
    reference.city.json: the true models at LoD 2.2. reference.gpkg: layers `footprints` and `roof_planes`.
    simulation.json: the settings, and counts.

    Parameters
    ----------
    scene : ExactScene
        The points with their truth.
    folder : str or Path
        Made when missing.
    settings : dict or None
        The parameters the scene was made with, for simulation.json.

    Returns
    -------
    dict of str to Path
        The files: `points`, `models`, `vectors`, `summary`.

    Raises
    ------
    InputError
        When the folder cannot be written.

    Examples
    --------
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> from eaves.simulate import write_simulation
    >>> sorted(path.name for path in write_simulation(truth, "nine").values())
    ['points.laz', 'reference.city.json', 'reference.gpkg', 'simulation.json']
    """
    target = Path(folder)
    paths = {name: target / name for name in (POINTS, MODELS, VECTORS, SUMMARY)}
    _write_cloud(scene, paths[POINTS])
    origin = scene.cloud.origin
    models = [building.model(origin) for building in scene.buildings]
    write_cityjson(paths[MODELS], models, scene.cloud.system)
    with undated():
        write_geopackage(paths[VECTORS], *_vector_rows(scene), scene.cloud.system)
    with atomic(paths[SUMMARY]) as temporary:
        temporary.write_text(
            json.dumps({**(settings or {}), **_counts(scene)}, indent=1, sort_keys=True) + "\n",
            encoding="utf-8",
        )
    return {
        "points": paths[POINTS],
        "models": paths[MODELS],
        "vectors": paths[VECTORS],
        "summary": paths[SUMMARY],
    }


def _write_cloud(scene: ExactScene, path: Path) -> None:
    cloud = scene.cloud
    point_format = 8 if "nir" in cloud.fields else 7 if "red" in cloud.fields else 6
    header = laspy.LasHeader(point_format=point_format, version="1.4")
    header.creation_date = UNDATED
    header.system_identifier, header.generating_software = "SIMULATION", "eaves simulate"
    unit = np.array(cloud.system.unit_m)
    header.scales = np.full(3, STEP)
    header.offsets = np.array([*np.floor(np.array(cloud.origin) / unit[:2]), 0.0])
    crs = pyproj_crs(cloud.system)
    if crs is not None:
        header.add_crs(crs)
    header.add_extra_dims(
        [laspy.ExtraBytesParams("building_id", "uint32"), laspy.ExtraBytesParams("plane_id", "uint32")]
    )
    las = laspy.LasData(header)
    world = (cloud.xyz + np.array([*cloud.origin, 0.0])) / unit
    las.x, las.y, las.z = world.T
    if cloud.return_number is not None and cloud.number_of_returns is not None:
        las.return_number, las.number_of_returns = cloud.return_number, cloud.number_of_returns
    for name, values in cloud.fields.items():
        las[name] = np.clip(values, 0, 65535).astype(np.uint16)
    las.classification = scene.truth_class
    las.building_id, las.plane_id = scene.building.astype(np.uint32), scene.plane.astype(np.uint32)
    if scene.strip is not None and scene.time_s is not None:
        las.point_source_id, las.gps_time = scene.strip, scene.time_s
    with atomic(path) as temporary, temporary.open("wb") as file:
        las.write(file, do_compress=True)


def _vector_rows(scene: ExactScene) -> tuple[list[Row], list[Row]]:
    """The rows of the layers `footprints` and `roof_planes`, in world metres."""
    footprints, planes = [], []
    for building in scene.buildings:
        placed = building.translated(*scene.cloud.origin)
        attributes = {
            "id": building.id,
            "number": building.number,
            "kind": building.kind,
            "h_ground": building.base,
            "h_roof_max": _highest(building),
            "faces": len(building.faces),
        }
        footprints.append(Row(placed.footprint, attributes))
        for face, here in zip(building.faces, placed.faces, strict=True):
            a, b, _ = face.coefficients
            slope = float(np.degrees(np.arctan(np.hypot(a, b))))
            planes.append(
                Row(
                    here.polygon,
                    {
                        "id": building.id,
                        "plane": face.number,
                        "slope": round(slope, 6),
                        "azimuth": round(float(np.degrees(np.arctan2(-a, -b)) % 360.0), 6),
                        "a": a,
                        "b": b,
                        "c": here.coefficients[2],
                    },
                )
            )
    return footprints, planes


def _highest(building: ExactBuilding) -> float:
    """The highest corner of the roof (m)."""
    corners = [face.height_at(np.array(face.polygon.exterior.coords)).max() for face in building.faces]
    return round(float(max(corners)), 3)


def _counts(scene: ExactScene) -> dict[str, Any]:
    classes, counts = np.unique(scene.truth_class, return_counts=True)
    return {
        "points": len(scene.cloud),
        "buildings": len(scene.buildings),
        "roof_faces": len(scene.faces),
        "points_by_class": {str(c): int(n) for c, n in zip(classes, counts, strict=True)},
    }
