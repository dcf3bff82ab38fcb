"""Building models as one binary glTF 2.0 file (GLB).

glTF is in metres with y up, so east is x, up is y and south is z. Every building is a node with its id as
name and its attributes in `extras`; its mesh, at the finest level of detail, has one primitive and material
for every kind of surface, and normals of its faces. Positions are 32-bit floats about the building's own
origin, which the node's translation, in doubles, puts into the scene. `asset.extras` states the origin of the
scene in the coordinate system: world = origin + (x, -z, y) / unit_m. A building without a model is a node
without a mesh.
"""

from __future__ import annotations

import json
import shutil
import struct
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, closing
from importlib.metadata import version
from pathlib import Path
from tempfile import SpooledTemporaryFile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eaves.formats import (
    COLOURS,
    SURFACES,
    BuildingMesh,
    Format,
    InputError,
    atomic,
    attributes_of,
    clean,
    meshed_pieces,
)
from eaves.model import (
    LOCAL_METRES,
    NOTHING_KNOWN,
    BuildingModel,
    CoordinateSystem,
    Failure,
    Integers,
    Points,
    Provenance,
    Values,
)

FLOAT, UNSIGNED_INT = 5126, 5125
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963
LARGEST = 2**32 - 1
"""Bytes a GLB file can hold, by the width of its length fields."""
IN_MEMORY = 1 << 20
"""Bytes of a stream that are held in memory."""
ALIGNMENT = 8
"""Bytes to which every stream is padded, as wide numbers of EXT_structural_metadata need."""

Json = dict[str, Any]


def write_glb(
    path: str | Path,
    models: Iterable[BuildingModel | Failure],
    system: CoordinateSystem = LOCAL_METRES,
    provenance: Provenance = NOTHING_KNOWN,
) -> int:
    """Write one node a building.

    Parameters
    ----------
    path : str or Path
        The file (`.glb`); it appears when it is whole.
    models : iterable of BuildingModel or Failure
        Buildings in metres about their footprint's origin, taken one by one; only their attributes and the
        sizes of their meshes stay in memory.
    system : CoordinateSystem
        Coordinate system that `asset.extras` states the origin in.
    provenance : Provenance
        Data the models are made from, recorded in the file.

    Returns
    -------
    int
        The number of buildings with a mesh.

    Raises
    ------
    InputError
        When the buildings need more than the 4 GB of a GLB file, or the folder cannot be written.

    Examples
    --------
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> models = [building.model(truth.cloud.origin) for building in truth.buildings]
    >>> from eaves.exports import write_glb
    >>> write_glb("nine.glb", models)
    9
    """
    count = read = 0
    origin: tuple[float, float] | None = None
    nodes: list[Json] = []
    with atomic(path) as temporary, closing(GlbParts(temporary)) as parts:
        for piece, mesh, vertices, faces in meshed_pieces(models):
            of_vertex, of_face = (np.arange(len(piece)).repeat(np.diff(first)) for first in (vertices, faces))
            base = np.full(len(piece), np.inf)
            np.minimum.at(base, of_vertex, mesh.vertices[:, 2])
            base = np.floor(base, where=np.isfinite(base), out=np.zeros(len(base)))
            primitives: dict[int, list[Json]] = {}
            for building, primitive, _ in mesh_primitives(parts, mesh, of_face, base[of_vertex]):
                primitives.setdefault(building, []).append(primitive)
            for number, result in enumerate(piece):
                read, footprint = read + 1, result.footprint
                if footprint is None:
                    continue
                origin = origin or footprint.origin
                name = footprint.id or f"building-{read}"
                east, north = footprint.origin[0] - origin[0], footprint.origin[1] - origin[1]
                place = {"translation": [east, float(base[number]), -north]}
                node: Json = {"name": name, "extras": clean(attributes_of(result)), **place}
                if vertices[number] < vertices[number + 1]:
                    own = {"name": name, "primitives": primitives.get(number, [])}
                    node["mesh"] = parts.add("meshes", own)
                    count += 1
                nodes.append(node)
        extras = scene_extras(system, origin or (0.0, 0.0)) | provenance.members
        parts.assemble({"scenes": [{"nodes": list(range(len(nodes)))}], "nodes": nodes}, extras, path)
    return count


def scene_extras(system: CoordinateSystem, origin: tuple[float, float]) -> Json:
    """The reference that puts the scene back on the map."""
    unit = np.array(system.unit_m)
    extras = {"origin": (np.array([*origin, 0.0]) / unit).tolist(), "unit_m": unit.tolist()}
    return extras | {"crs": system.code, "wkt": system.wkt, "axes": "x east, y up, -z north, metres"}


def y_up(xyz: Points) -> NDArray[np.float32]:
    """Points or normals (N, 3), z up, in the axes of glTF."""
    return np.column_stack([xyz[:, 0], xyz[:, 2], -xyz[:, 1]]).astype(np.float32)


def mesh_primitives(
    parts: GlbParts, mesh: BuildingMesh, group: Integers, base: Values | float
) -> Iterator[tuple[int, Json, Integers]]:
    """A primitive for every kind of surface of each `group` (F,) of the faces of a mesh: its group, it, and
    the vertex of the mesh (K,) that each of its own is. Heights are above the `base` (V,) of a vertex."""
    part = group * len(SURFACES) + mesh.surface
    face, vertex, triangles = mesh.flat_shaded(part)
    if not len(face):
        return
    first = np.flatnonzero(np.diff(part[face], prepend=-1))
    parts_there, of_triangle = part[face[first]], part[face[triangles[:, 0]]]
    triangles -= first[np.searchsorted(parts_there, of_triangle), None]
    lowered = mesh.vertices[vertex]
    lowered[:, 2] -= np.broadcast_to(base, len(mesh.vertices))[vertex]
    both = np.hstack([y_up(lowered), y_up(mesh.normal[face])]).astype("<f4")
    low, high = (extreme.reduceat(both[:, :3], first).tolist() for extreme in (np.minimum, np.maximum))
    width = both.itemsize * 6
    views = (
        parts.write("vertices", both.tobytes(), byteStride=width, target=ARRAY_BUFFER),
        parts.write("indices", triangles.astype("<u4").tobytes(), target=ELEMENT_ARRAY_BUFFER),
    )
    places = [*first.tolist(), len(both)]
    corners = [0, *(3 * np.searchsorted(of_triangle, parts_there, side="right")).tolist()]
    for number, one in enumerate(parts_there.tolist()):
        (start, end), (begin, stop) = (ends[number : number + 2] for ends in (places, corners))
        at = parts.accessor(views[0], start * width, end - start, "VEC3", FLOAT)
        normal = parts.accessor(views[0], start * width + width // 2, end - start, "VEC3", FLOAT)
        parts.lists["accessors"][at] |= {"min": low[number], "max": high[number]}
        indices = parts.accessor(views[1], begin * 4, stop - begin, "SCALAR", UNSIGNED_INT)
        attributes = {"POSITION": at, "NORMAL": normal}
        primitive = {"attributes": attributes, "indices": indices, "material": one % len(SURFACES)}
        yield one // len(SURFACES), primitive, vertex[start:end]


class GlbParts:
    """The pieces of a GLB file while it is made: its JSON in memory, its numbers in streams, the long ones
    on the disk.

    A stream becomes one buffer view: `vertices` (position and normal), `indices`, and what else is written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.lists: dict[str, list[Json]] = {"meshes": [], "accessors": []}
        self._files = ExitStack()
        self._streams: dict[str, tuple[int, SpooledTemporaryFile[bytes], Json]] = {}

    def close(self) -> None:
        """Close the streams."""
        self._files.close()

    def add(self, name: str, item: Json) -> int:
        """Put an item into one of the lists of the JSON; its number comes back."""
        self.lists[name].append(item)
        return len(self.lists[name]) - 1

    def write(self, stream: str, data: bytes, **view: int) -> tuple[int, int]:
        """Append to a stream, whose buffer view has the members `view`; the number of the buffer view and
        the offset in it."""
        if stream not in self._streams:
            spooled = SpooledTemporaryFile(IN_MEMORY, dir=str(self.path.parent))  # noqa: SIM115 closed below
            file = self._files.enter_context(spooled)
            self._streams[stream] = (len(self._streams), file, dict(view))
        number, file, _ = self._streams[stream]
        start = file.tell()
        file.write(data)
        return number, start

    def accessor(self, view: tuple[int, int], offset: int, count: int, kind: str, component: int) -> int:
        """Describe values at an offset in what was appended to a buffer view; the number of the accessor."""
        number, start = view
        about = {"bufferView": number, "byteOffset": start + offset, "count": count}
        return self.add("accessors", about | {"componentType": component, "type": kind})

    def assemble(self, scene: Json, extras: Json, path: str | Path) -> None:
        """Write the whole file: header, JSON, numbers."""
        views, binary = [], 0
        for _, file, view in self._streams.values():
            length = file.tell()
            views.append({"buffer": 0, "byteOffset": binary, "byteLength": length, **view})
            file.write(bytes(-length % ALIGNMENT))
            binary = binary + file.tell()
        asset = {"version": "2.0", "generator": f"eaves {version('eaves')}", "extras": extras}
        document: Json = {"asset": asset, "scene": 0, **scene}
        if binary:
            primitives = [one for mesh in self.lists["meshes"] for one in mesh["primitives"]]
            used = sorted({one["material"] for one in primitives})
            for one in primitives:
                one["material"] = used.index(one["material"])
            document |= self.lists | {"materials": glb_materials(used), "buffers": [{"byteLength": binary}]}
            document["bufferViews"] = views
        text = json.dumps(document, separators=(",", ":"), ensure_ascii=False, allow_nan=False).encode()
        text += b" " * (-len(text) % ALIGNMENT)
        whole = 12 + 8 + len(text) + (8 + binary if binary else 0)
        if whole > LARGEST:
            raise InputError.about(path, f"needs {whole:,} bytes and GLB holds {LARGEST:,}", "write 3dtiles")
        with self.path.open("wb") as target:
            target.write(struct.pack("<4sII", b"glTF", 2, whole))
            target.write(struct.pack("<I4s", len(text), b"JSON") + text)
            if binary:
                target.write(struct.pack("<I4s", binary, b"BIN\0"))
            for _, file, _ in self._streams.values():
                file.seek(0)
                shutil.copyfileobj(file, target)


def glb_materials(kinds: Sequence[int]) -> list[Json]:
    """One matt material for every kind of surface, by their numbers in `SURFACES`."""
    return [
        {
            "name": name,
            "pbrMetallicRoughness": {
                "baseColorFactor": [*COLOURS[name], 1.0],
                "metallicFactor": 0.0,
                "roughnessFactor": 1.0,
            },
        }
        for name in (SURFACES[kind] for kind in kinds)
    ]


FORMAT = Format({"models": ("buildings.glb", write_glb)})
