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
from importlib.metadata import version
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO

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
    with_meshes,
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
)

FLOAT, UNSIGNED_INT = 5126, 5125
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963
LARGEST = 2**32 - 1
"""Bytes a GLB file can hold, by the width of its length fields."""
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
    count = 0
    origin: tuple[float, float] | None = None
    nodes: list[Json] = []
    with atomic(path) as temporary, GlbParts(temporary) as parts:
        for number, (model, mesh) in enumerate(with_meshes(models), 1):
            footprint = model.footprint
            if footprint is None:
                continue
            origin = origin or footprint.origin
            node: Json = {"name": footprint.id or f"building-{number}", "extras": clean(attributes_of(model))}
            base = 0.0 if mesh is None else float(np.floor(mesh.vertices[:, 2].min()))
            east, north = footprint.origin[0] - origin[0], footprint.origin[1] - origin[1]
            node["translation"] = [east, base, -north]
            if mesh is not None:
                primitives = [primitive for primitive, _ in mesh_primitives(parts, [mesh], base)]
                node["mesh"] = parts.add("meshes", {"name": node["name"], "primitives": primitives})
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
    parts: GlbParts, meshes: Sequence[BuildingMesh], base: float
) -> Iterator[tuple[Json, Integers]]:
    """A primitive for every kind of surface that meshes of one origin have, and the mesh of each of its
    vertices (K,); heights are written above `base`."""
    for kind in range(len(SURFACES)):
        pieces = [mesh.flat_shaded(kind) for mesh in meshes]
        sizes = [len(positions) for positions, _, _ in pieces]
        if sum(sizes):
            positions, normals, _ = map(np.concatenate, zip(*pieces, strict=True))
            starts = np.cumsum([0, *sizes[:-1]])
            triangles = np.concatenate(
                [piece[2] + start for piece, start in zip(pieces, starts, strict=True)]
            )
            lowered = positions - [0.0, 0.0, base]
            primitive = parts.primitive(y_up(lowered), y_up(normals), triangles, kind)
            yield primitive, np.repeat(np.arange(len(meshes)), sizes)


class GlbParts:
    """The pieces of a GLB file while it is made: its JSON in memory, its numbers in streams beside it.

    A stream becomes one buffer view: `vertices` (position and normal), `indices`, and what else is written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.lists: dict[str, list[Json]] = {"meshes": [], "accessors": []}
        self._streams: dict[str, tuple[int, BinaryIO, Json]] = {}

    def __enter__(self) -> GlbParts:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for _, file, _ in self._streams.values():
            file.close()

    def add(self, name: str, item: Json) -> int:
        """Put an item into one of the lists of the JSON; its number comes back."""
        self.lists[name].append(item)
        return len(self.lists[name]) - 1

    def write(self, stream: str, data: bytes, **view: int) -> tuple[int, int]:
        """Append to a stream, whose buffer view has the members `view`; the number of the buffer view and
        the offset in it."""
        if stream not in self._streams:
            file: BinaryIO = self.path.with_suffix(f".{stream}").open("w+b")
            self._streams[stream] = (len(self._streams), file, dict(view))
        number, file, _ = self._streams[stream]
        start = file.tell()
        file.write(data)
        return number, start

    def accessor(self, stream: str, values: NDArray[Any], kind: str, component: int, **view: int) -> int:
        """Append values to a stream and describe them; the number of the accessor."""
        number, start = self.write(stream, values.tobytes(), **view)
        count = values.size if kind == "SCALAR" else len(values)
        about = {"bufferView": number, "byteOffset": start, "count": count}
        return self.add("accessors", about | {"componentType": component, "type": kind})

    def primitive(
        self,
        positions: NDArray[np.float32],
        normals: NDArray[np.float32],
        triangles: Integers,
        material: int,
    ) -> Json:
        """Keep vertices (K, 3), their normals and triangles (T, 3); the primitive that uses them."""
        both = np.hstack([positions, normals]).astype("<f4")
        position = self.accessor(
            "vertices", both, "VEC3", FLOAT, byteStride=both.itemsize * 6, target=ARRAY_BUFFER
        )
        first = self.lists["accessors"][position]
        normal = self.add("accessors", {**first, "byteOffset": first["byteOffset"] + both.itemsize * 3})
        first |= {"min": positions.min(axis=0).tolist(), "max": positions.max(axis=0).tolist()}
        indices = self.accessor(
            "indices", triangles.astype("<u4"), "SCALAR", UNSIGNED_INT, target=ELEMENT_ARRAY_BUFFER
        )
        attributes = {"POSITION": position, "NORMAL": normal}
        return {"attributes": attributes, "indices": indices, "material": material}

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
