"""Building models as 3D Tiles 1.1: `tileset.json` and one GLB a block.

A tile holds the buildings whose coordinates share an origin (those of one owner block), at their finest
level of detail, in one mesh about that origin; every building is a feature with its attributes. The tile's
transform takes it to Earth-centred coordinates: its axes are the images of 100 m east, north and up in the
coordinate system at the tile's middle, so grid convergence and scale are in it, and a block of 240 m leaves
the curve of the Earth by 2 mm. Heights above a geoid need its grid, which PROJ may not have; a warning states
so, and `asset.extras` what was added. Data with no place on Earth make a tileset in local metres. Tiles are
leaves of a quadtree; where it has more than one level, its nodes have an overview that the tiles replace.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from importlib.metadata import version
from itertools import groupby
from pathlib import Path

import numpy as np
import pyproj
from pyproj.transformer import TransformerGroup

from eaves.exports.features import EXTENSIONS, add_feature_numbers, add_property_table
from eaves.exports.glb import GlbParts, Json, mesh_primitives, scene_extras
from eaves.exports.tiles_overview import (
    NODE_PRISMS,
    TILE_PRISMS,
    Prism,
    describe_overview,
    largest,
    prism_of,
)
from eaves.formats import (
    BuildingMesh,
    Format,
    atomic,
    attributes_of,
    clean,
    horizontal_crs,
    pyproj_crs,
    vertical_datum,
    with_meshes,
)
from eaves.model import (
    LOCAL_METRES,
    NOTHING_KNOWN,
    BuildingModel,
    CoordinateSystem,
    Failure,
    Integers,
    Provenance,
    Values,
)

ARM = 100.0
"""Length (m) over which the directions of the axes are measured."""
CHILDREN = 8
"""Most tiles a node holds before it is split into quarters."""
ERROR_SHARE = 1 / 16
"""A node's geometric error as a share of its diameter: at Cesium's 16 pixels and a usual screen its tiles
come into view from about four diameters away."""
STRETCH = 1.002
"""Largest ratio of the unit of a map's axes to a metre, its excess twice UTM's at the rim of its zone."""
GEOCENTRIC, GEODETIC = "EPSG:4978", "EPSG:4979"


@dataclass(frozen=True, eq=False)
class Leaf:
    """One tile with content: its middle in the plane (m), its corners (8, 3) in the tileset's coordinates,
    what it shows from afar."""

    middle: tuple[float, float]
    corners: Values
    tile: Json
    prisms: Sequence[Prism] = ()


def write_3dtiles(
    folder: str | Path,
    models: Iterable[BuildingModel | Failure],
    system: CoordinateSystem = LOCAL_METRES,
    provenance: Provenance = NOTHING_KNOWN,
) -> int:
    """Write `tileset.json` and `content/*.glb` into a folder.

    Parameters
    ----------
    folder : str or Path
        Made when missing. An older tileset in it is removed first; the new `tileset.json` is written last.
    models : iterable of BuildingModel or Failure
        Buildings in metres about their footprint's origin, those of one origin next to each other; one
        origin's buildings are in memory at a time.
    system : CoordinateSystem
        Coordinate system of the buildings.
    provenance : Provenance
        Data the models are made from, recorded in the file.

    Returns
    -------
    int
        The number of buildings with a mesh.

    Raises
    ------
    InputError
        When the folder cannot be written, or the system has no place on Earth.

    Examples
    --------
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> models = [building.model(truth.cloud.origin) for building in truth.buildings]
    >>> from eaves.exports import write_3dtiles
    >>> write_3dtiles("tiles", [model for model in models], truth.placed("EPSG:28992").cloud.system)
    9
    """
    folder = Path(folder)
    (folder / "tileset.json").unlink(missing_ok=True)
    earth = Earth(system)
    leaves: list[Leaf] = []
    overviews = count = 0

    def tile_of(name: str, models: Sequence[BuildingModel], mesh: BuildingMesh, number: Integers) -> Leaf:
        """Write a tile of buildings, whose mesh counts from the first one's origin; `number` (V,) is the
        building of a vertex."""
        origin = models[0].footprint.origin
        with atomic(folder / name) as temporary:
            low, high = write_content(temporary, models, mesh, number, origin, system)
        base = np.array([0.0, 0.0, low[2]])
        frame = earth.frame(np.array([*origin, low[2]]), (low + high) / 2 - base)
        return leaf_of(name, frame, origin, low - base, high - base)

    def draw(inside: Sequence[Leaf]) -> Json:
        """The overview of a node over tiles, as a content in its place."""
        nonlocal overviews
        prisms = largest((prism for leaf in inside for prism in leaf.prisms), NODE_PRISMS)
        if not prisms:
            return {}
        overviews += 1
        shown = [model for _, model, _ in prisms]
        mesh, of_vertex = describe_overview(shown[0].footprint.origin, prisms)
        return tile_of(f"overview/{overviews}.glb", shown, mesh, of_vertex).tile

    for buildings in by_origin(models):
        inside, meshes = zip(*buildings, strict=True)
        of_vertex = np.repeat(np.arange(len(meshes)), [len(mesh.vertices) for mesh in meshes])
        leaf = tile_of(f"content/{len(leaves) + 1}.glb", inside, BuildingMesh.join(meshes), of_vertex)
        seen = (prism for model, mesh in buildings if (prism := prism_of(model, mesh)) is not None)
        leaves.append(replace(leaf, prisms=largest(seen, TILE_PRISMS)))
        count += len(buildings)
    nothing: Json = {"boundingVolume": {"sphere": [0, 0, 0, 1]}, "geometricError": 0}
    root = node_of(leaves, draw if len(leaves) > CHILDREN else None) if leaves else nothing
    for place, number in (("content", len(leaves)), ("overview", overviews)):
        for stale in (folder / place).glob("*.glb"):
            if not (stale.stem.isdigit() and int(stale.stem) <= number):
                stale.unlink()
    extras: Json = {"crs": system.code, "vertical_datum": vertical_datum(system), **provenance.members}
    lifts = earth.added or [0.0]
    extras["geoid_height_added_m"] = [round(min(lifts), 3), round(max(lifts), 3)]
    asset = {"version": "1.1", "generator": f"eaves {version('eaves')}", "extras": extras}
    tileset: Json = {"asset": asset, "geometricError": 2 * root["geometricError"]}
    tileset["root"] = {"refine": "ADD", **root}
    with atomic(folder / "tileset.json") as temporary:
        temporary.write_text(json.dumps(tileset, allow_nan=False), encoding="utf-8")
    return count


def by_origin(
    models: Iterable[BuildingModel | Failure],
) -> Iterator[list[tuple[BuildingModel, BuildingMesh]]]:
    """The buildings that have a mesh, those of one origin together."""
    solid = (
        (model, mesh)
        for model, mesh in with_meshes(models)
        if isinstance(model, BuildingModel) and mesh is not None and len(mesh.triangles)
    )
    for _, group in groupby(solid, key=lambda pair: pair[0].footprint.origin):
        yield list(group)


def write_content(
    path: Path,
    models: Sequence[BuildingModel],
    mesh: BuildingMesh,
    number: Integers,
    origin: tuple[float, float],
    system: CoordinateSystem,
) -> tuple[Values, Values]:
    """Write the GLB of one tile, heights above its lowest point; its lowest and highest coordinates (3,)."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    together = np.zeros(len(mesh.surface), np.int64)
    rows = [
        {"id": model.footprint.id, "lod": model.lod}
        | {
            key: value
            for key, value in clean(attributes_of(model)).items()
            if not isinstance(value, list | dict)
        }
        for model in models
    ]
    with closing(GlbParts(path)) as parts:
        primitives = [
            add_feature_numbers(parts, primitive, number[vertex], len(models))
            for _, primitive, vertex in mesh_primitives(parts, mesh, together, low[2])
        ]
        parts.add("meshes", {"primitives": primitives})
        scene: Json = {"scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}], "extensionsUsed": EXTENSIONS}
        scene["extensions"] = add_property_table(parts, rows)
        parts.assemble(scene, scene_extras(system, origin), path)
    return low, high


def leaf_of(
    name: str,
    frame: Values,
    origin: tuple[float, float],
    low: Values,
    high: Values,
) -> Leaf:
    """The tile of a content file whose coordinates lie between `low` and `high` (3,) in its frame (4, 4)."""
    middle, half = (low + high) / 2, (high - low) / 2
    choice = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    corners = np.where(choice == 1, high, low) @ frame[:3, :3].T + frame[:3, 3]
    box = [*middle.tolist(), half[0], 0.0, 0.0, 0.0, half[1], 0.0, 0.0, 0.0, half[2]]
    tile = {
        "transform": frame.T.ravel().tolist(),
        "boundingVolume": {"box": [float(value) for value in box]},
        "geometricError": 0.0,
        "content": {"uri": name},
    }
    return Leaf((origin[0] + float(middle[0]), origin[1] + float(middle[1])), corners, tile)


def node_of(
    leaves: Sequence[Leaf],
    draw: Callable[[Sequence[Leaf]], Json] | None = None,
    parent: Values | None = None,
) -> Json:
    """A tile over all leaves: their parent when they are few, else of the nodes over their quarters. What
    `draw` makes of the leaves is shown in their place from afar, in a frame of its own; `parent` (4, 4) is
    the frame that the node itself is in, None for the tileset's."""
    corners = np.concatenate([leaf.corners for leaf in leaves])
    centre = (corners.min(axis=0) + corners.max(axis=0)) / 2
    radius = float(np.linalg.norm(corners - centre, axis=1).max())
    overview = {} if draw is None else draw(leaves)
    frame = np.array(overview["transform"]).reshape(4, 4).T if overview else parent
    node: Json = {}
    if overview:
        node = {"transform": framed_tile(overview, parent)["transform"], "refine": "REPLACE"}
        node["content"] = overview["content"]
    if frame is not None:  # its axes are a map's: up to a thousandth longer or shorter than metres
        centre, radius = (np.linalg.inv(frame) @ [*centre, 1.0])[:3], radius * STRETCH
    node["boundingVolume"] = {"sphere": [*centre.tolist(), radius]}
    node["geometricError"] = 2 * radius * ERROR_SHARE
    middles = np.array([leaf.middle for leaf in leaves])
    split = (middles.min(axis=0) + middles.max(axis=0)) / 2
    quarter = (middles[:, 0] > split[0]) + 2 * (middles[:, 1] > split[1])
    if len(leaves) <= CHILDREN or len(np.unique(quarter)) == 1:
        return node | {"children": [framed_tile(leaf.tile, frame) for leaf in leaves]}
    quarters = [
        [leaf for leaf, quarter_of in zip(leaves, quarter, strict=True) if quarter_of == number]
        for number in range(4)
    ]
    return node | {"children": [node_of(quarter, draw, frame) for quarter in quarters if quarter]}


def framed_tile(tile: Json, frame: Values | None) -> Json:
    """A tile that stands in the tileset's frame, below one of another frame (4, 4)."""
    if frame is None:
        return tile
    own = np.linalg.inv(frame) @ np.array(tile["transform"]).reshape(4, 4).T
    return tile | {"transform": own.T.ravel().tolist()}


class Earth:
    """Puts places of a coordinate system into Earth-centred coordinates."""

    def __init__(self, system: CoordinateSystem) -> None:
        self.unit = np.array(system.unit_m)
        self.added: list[float] = []
        """Geoid heights (m) that were added."""
        plane = horizontal_crs(system)
        self.known = plane is not None
        if plane is None:
            return
        self._flat = pyproj.Transformer.from_crs(plane, GEODETIC, always_xy=True)
        self._round = pyproj.Transformer.from_crs(GEODETIC, GEOCENTRIC, always_xy=True)
        whole = pyproj_crs(system)
        self._upright = None
        if whole is not None and whole.is_compound:
            with warnings.catch_warnings():  # warned of below, with the remedy
                warnings.filterwarnings("ignore", message="Best transformation is not available")
                group = TransformerGroup(whole, GEODETIC, always_xy=True)
            self._upright = group.transformers[0] if group.transformers else None

    def frame(self, start: Values, middle: Values) -> Values:
        """The matrix (4, 4) from metres east, north and up of `start` (3,) to the tileset's coordinates,
        exact at `middle` (3,), counted from `start`."""
        matrix = np.eye(4)
        if not self.known:
            matrix[:3, 3] = start
            return matrix
        ends = self.geocentric(start + middle + np.vstack([np.zeros(3), ARM * np.eye(3)]))
        matrix[:3, :3] = ((ends[1:] - ends[0]) / ARM).T
        matrix[:3, 3] = ends[0] - matrix[:3, :3] @ middle
        return matrix

    def geocentric(self, xyz: Values) -> Values:
        """Earth-centred metres of places (N, 3) in the system's metres, all with the first one's geoid."""
        x, y, z = (xyz / self.unit).T
        longitude, latitude = self._flat.transform(x, y)
        lift = self._geoid_height(float(x[0]), float(y[0]), float(z[0]))
        return np.column_stack(self._round.transform(longitude, latitude, xyz[:, 2] + lift))

    def _geoid_height(self, x: float, y: float, z: float) -> float:
        lifted = z * self.unit[2]
        if self._upright is not None:
            height = float(self._upright.transform(x, y, z)[2])
            lifted = height if np.isfinite(height) else lifted
        self.added.append(lifted - z * self.unit[2])
        return self.added[-1]


def write_tileset(
    path: Path, models: Iterable[BuildingModel | Failure], system: CoordinateSystem, provenance: Provenance
) -> int:
    """Write the tileset of this path into its folder, as `write_3dtiles`."""
    return write_3dtiles(path.parent, models, system, provenance)


FORMAT = Format({"models": ("3dtiles/tileset.json", write_tileset)})
