"""A town from a CityJSON file instead of random numbers: `eaves simulate --model`."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np
import shapely
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree

from eaves.formats import CityObject, InputError, has_corners, read_cityjson
from eaves.geometry import FaceTable, as_polygon, edges_of, highest_faces
from eaves.model import GROUND_SURFACE, ROOF_SURFACE, WALL_SURFACE, Bounds, Face, Solid, Values
from eaves.simulate.objects.exact import ExactBuilding, ExactFace, extrude_partition
from eaves.simulate.objects.surfaces import CELL, Foliage, ScannedSurfaces, Terrain, grow_tree
from eaves.simulate.town import TRUNK_CLEARANCE, Town

logger = logging.getLogger(__name__)

RIM = 20.0
"""The town's bounds lie this far outside the outermost building (m)."""

TREES_PER_HECTARE = 25.0
"""Trees scattered between the buildings when `trees` is 1."""

LOWEST_ROOF_NORMAL = 0.05
"""A face without semantics is a roof when its normal's z is above this, ground when below minus this."""

GROUND_NEIGHBOURS = 6
"""Number of nearest buildings whose bases, weighted by distance, give the terrain at a place."""

CLOSING_GRIDS = (0.001, 0.005, 0.01, 0.02)
"""Grids (m) to which the corners of roof faces are snapped, in turn, until a solid closes over them."""

LARGEST = (10_000.0, 10_000.0, 900.0)
"""The largest extent of a town (m): terrain and points are held in memory, and surveys fly 1,000 m high."""

SMOOTHING = 5.0
"""Standard deviation (m) of the filter that rounds the terrain between buildings."""


def town_of_model(path: str | Path, trees: float = 0.0, seed: int = 0, crs: str | None = None) -> Town:
    """The town of a CityJSON file, at each building's finest level of detail.

    The terrain goes through the bases of the buildings. Only what the file holds is known: its outlines are
    the truth, with no overhang, and its faces keep their own small errors of planarity.

    Parameters
    ----------
    path : str or Path
        `.city.json` or `.city.jsonl`.
    trees : float
        Share of 25 trees per hectare (≥ 0), scattered where no building is; none by default.
    seed : int
        Of the trees.
    crs : str or None
        The system of a file that names none.

    Returns
    -------
    Town
        The town; `scan_town` makes points of it.

    Raises
    ------
    InputError
        When the file cannot be read, holds no building with surfaces, or is too large.

    Examples
    --------
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> models = [building.model(truth.cloud.origin) for building in truth.buildings]
    >>> from eaves.formats import write_cityjson
    >>> from eaves.simulate import town_of_model
    >>> write_cityjson("nine.city.json", models)
    9
    >>> len(town_of_model("nine.city.json").buildings)
    9
    """
    solids = [(item, solid) for item in read_cityjson(path, crs).values() for solid in _shells(item)]
    if not solids:
        raise InputError.about(
            path, "holds no building with surfaces", "give a CityJSON file with LoD 1 or 2"
        )
    corners = np.concatenate([solid.vertices for _, solid in solids])
    if (np.ptp(corners, axis=0) > LARGEST).any():
        sides = " × ".join(f"{side:.0f}" for side in np.ptp(corners, axis=0))
        most = " × ".join(f"{side:.0f}" for side in LARGEST)
        raise InputError.about(path, f"measures {sides} m, more than {most}", "give a part of it, in metres")
    west, south = np.floor((corners.min(axis=0)[:2] - RIM) / 10.0) * 10.0
    origin = float(west), float(south)
    buildings: list[ExactBuilding] = []
    faces = 1
    for item, solid in solids:
        local = replace(solid, vertices=solid.vertices - [*origin, 0.0])
        building = _exact_building(item.id, local, len(buildings) + 1, faces)
        if building is None:
            logger.warning("%s: '%s' has no roof to scan and is left out", path, item.id)
            continue
        buildings.append(building)
        faces += len(building.faces)
    open_shells = sum(building.closed is None for building in buildings)
    if open_shells:
        logger.warning(
            "%s: %d of %d buildings cannot be closed over their roofs and are referred to as they are",
            path,
            open_shells,
            len(buildings),
        )
    east, north = np.ceil(corners.max(axis=0)[:2] - origin + RIM)
    bounds = Bounds(0.0, 0.0, float(east), float(north))
    terrain = _terrain_through(buildings, bounds)
    trunks, leaves = _scatter_trees(buildings, bounds, terrain, trees, seed)
    return Town(bounds, terrain, tuple(buildings), trunks, leaves, origin, solids[0][0].system)


def _shells(item: CityObject) -> tuple[Solid, ...]:
    """The shells of the object's finest geometry that has faces; of damaged ones those faces with corners."""
    finest = max(item.geometries, key=lambda geometry: geometry.lod, default=None)
    if finest is None:
        return ()
    shells = (Solid.of(solid.vertices, filter(has_corners, solid.faces)) for solid in item.as_solids(finest))
    return tuple(solid for solid in shells if len(solid.corners))


def _exact_building(name: str, solid: Solid, number: int, first_face: int) -> ExactBuilding | None:
    """The building of a shell: roof faces numbered, other faces classified; None when it has no roof."""
    shell: list[Face] = []
    faces: list[ExactFace] = []
    table = FaceTable.of_solids([solid])
    rows = zip(solid.faces, table.polygons(), table.normals, table.planes.tolist(), strict=True)
    for face, shape, normal, (a, b, c) in rows:
        surface, plane = face.surface or _guess(normal), None
        if surface == ROOF_SURFACE:
            polygon = as_polygon(shape) if abs(normal[2]) > LOWEST_ROOF_NORMAL else None
            if polygon is None:
                surface = WALL_SURFACE
            else:
                plane = len(faces)
                faces.append(ExactFace(polygon, (a, b, c), first_face + plane))
        shell.append(Face(face.rings, surface, plane))
    outline = (
        as_polygon(shapely.union_all([face.polygon for face in faces], grid_size=0.001)) if faces else None
    )
    if outline is None:
        return None
    base = float(solid.vertices[:, 2].min())
    plan = shapely.orient_polygons(outline)
    scanned = Solid.of(solid.vertices, shell)
    closed = _close(faces, base)
    if closed is None:
        logger.info("'%s' cannot be closed over its roof; its reference is as the file has it", name)
    return ExactBuilding(number, "model", plan, plan, tuple(faces), base, scanned, closed, name)


def _close(faces: list[ExactFace], base: float) -> Solid | None:
    """The closed solid under the highest of roof faces that may leave cracks; None when it would touch
    itself."""
    polygons = np.array([face.polygon for face in faces], object)
    planes = np.array([face.coefficients for face in faces])
    for grid in CLOSING_GRIDS:
        network = shapely.union_all(shapely.boundary(polygons), grid_size=grid)
        cells = shapely.get_parts(shapely.polygonize([network]))
        places = shapely.get_coordinates(shapely.point_on_surface(cells))
        highest, _ = highest_faces(places, *edges_of(polygons), planes)
        covered = highest >= 0
        try:
            return extrude_partition(cells[covered], highest[covered], planes, base)
        except ValueError:
            continue
    return None


def _guess(normal: Values) -> str:
    if normal[2] > LOWEST_ROOF_NORMAL:
        return ROOF_SURFACE
    return GROUND_SURFACE if normal[2] < -LOWEST_ROOF_NORMAL else WALL_SURFACE


def _terrain_through(buildings: list[ExactBuilding], bounds: Bounds) -> Terrain:
    """Terrain through the bases of the buildings."""
    blank = Terrain.blank(bounds)
    places = np.array([shapely.get_coordinates(shapely.centroid(b.footprint))[0] for b in buildings])
    bases = np.array([building.base for building in buildings])
    count = min(GROUND_NEIGHBOURS, len(bases))
    nearest = cKDTree(places).query(blank.nodes().reshape(-1, 2), k=count)
    far, which = np.reshape(nearest[0], (-1, count)), np.reshape(nearest[1], (-1, count))
    weight = 1.0 / (far + CELL) ** 2
    heights = (weight * bases[which]).sum(axis=1) / weight.sum(axis=1)
    rough = np.asarray(heights).reshape(blank.heights.shape)
    return replace(blank, heights=np.asarray(gaussian_filter(rough, SMOOTHING / CELL), np.float64))


def _scatter_trees(
    buildings: list[ExactBuilding], bounds: Bounds, terrain: Terrain, trees: float, seed: int
) -> tuple[ScannedSurfaces, Foliage]:
    rng = np.random.default_rng([seed, 41])
    count = round(trees * TREES_PER_HECTARE * bounds.width * bounds.height / 1e4)
    places = rng.uniform((bounds.west, bounds.south), (bounds.east, bounds.north), (count, 2))
    built = shapely.union_all([shapely.buffer(b.footprint, TRUNK_CLEARANCE) for b in buildings])
    shapely.prepare(built)
    free = places[~shapely.contains_xy(built, places[:, 0], places[:, 1])]
    ground = terrain.at(free)
    grown = [grow_tree(float(x), float(y), float(z), rng) for (x, y), z in zip(free, ground, strict=True)]
    return ScannedSurfaces.join([trunk for _, trunk in grown]), Foliage.join([leaves for leaves, _ in grown])
