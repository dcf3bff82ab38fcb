"""CityJSON and CityJSONSeq read: every city object with its vertices in world metres, as written;
buildings as the values that the writers of other formats take."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, groupby
from operator import index
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from eaves.formats.crs import parse_crs, system_of
from eaves.formats.errors import InputError
from eaves.formats.models.cityjson import WKT_MEMBER
from eaves.formats.points.chunk import FARTHEST
from eaves.model import (
    BLOCK_SIDE,
    LOCAL_METRES,
    LODS,
    NO_PLANE,
    BuildingModel,
    CoordinateSystem,
    Face,
    Failure,
    Footprint,
    Installation,
    Solid,
    Values,
)

REPAIR = "write it again, or check it with cjio or cjval"
INSTALLATION = "BuildingInstallation"
NESTING = {"MultiSurface": 1, "CompositeSurface": 1, "Solid": 2, "MultiSolid": 3, "CompositeSolid": 3}
"""Number of lists around a surface (a list of rings) in a geometry's boundaries (CityJSON 2.0,
section 3.1)."""


@dataclass(frozen=True, eq=False)
class CityGeometry:
    """One geometry of a city object: shells of surfaces of rings of vertex numbers."""

    type: str
    lod: str
    solids: tuple[tuple[Solid, ...], ...]
    """Solid → shells (the first is the outer one), over the vertices of the object; surfaces outside solids
    are one solid of one shell.

    `Face.surface` is the semantic type (empty when there is none), `Face.plane` the number in `surfaces`.
    """
    surfaces: tuple[Mapping[str, Any], ...] = ()
    """The semantic surfaces with their attributes."""

    @property
    def is_solid(self) -> bool:
        """True if the shells claim to be closed."""
        return self.type.endswith("Solid")

    @property
    def faces(self) -> Iterator[Face]:
        """The faces of all shells."""
        return (face for shells in self.solids for shell in shells for face in shell.faces)


@dataclass(frozen=True, eq=False)
class CityObject:
    """A Building, BuildingPart or other object of a CityJSON file.

    Parameters
    ----------
    id, type : str
        Its id and CityJSON type.
    attributes : mapping
        Its attributes.
    geometries : tuple of CityGeometry
        Its geometries, one a level of detail.
    vertices : ndarray (V, 3)
        World metres, of the feature (CityJSONSeq) or file; the geometries' numbers point into it.
    parents, children : tuple of str
        Ids of the objects above and below it.
    system : CoordinateSystem
        Reference system of the file.

    Examples
    --------
    >>> import numpy as np
    >>> from eaves.formats import CityObject
    >>> CityObject("a", "Building", {}, (), np.zeros((0, 3))).type
    'Building'
    """

    id: str
    type: str
    attributes: Mapping[str, Any]
    geometries: tuple[CityGeometry, ...]
    vertices: Values
    parents: tuple[str, ...] = ()
    children: tuple[str, ...] = ()
    system: CoordinateSystem = field(default=LOCAL_METRES)

    def lod(self, name: str) -> tuple[CityGeometry, ...]:
        """The geometries of one level of detail."""
        return tuple(geometry for geometry in self.geometries if geometry.lod == name)

    def as_solids(
        self, geometry: CityGeometry, origin: tuple[float, float] = (0.0, 0.0)
    ) -> tuple[Solid, ...]:
        """The outer shell of every solid of a geometry, with its own vertices in metres about `origin`."""
        return tuple(self._as_solid(shells[0], origin) for shells in geometry.solids if shells)

    def _as_solid(self, shell: Solid, origin: tuple[float, float]) -> Solid:
        used = np.zeros(len(self.vertices), bool)
        used[shell.corners] = True
        vertices, corners = self.vertices[used] - [*origin, 0.0], (used.cumsum() - 1)[shell.corners]
        return Solid(vertices, corners, shell.ring_sizes, shell.ring_counts, shell.surfaces, shell.planes)


def read_cityjson(path: str | Path, crs: str | None = None) -> dict[str, CityObject]:
    """All city objects of a CityJSON or CityJSONSeq file by id, in the file's order.

    Parameters
    ----------
    path : str or Path
        `.city.json` or `.city.jsonl`.
    crs : str or None
        The system of the coordinates, when the file names none and it is not in metres.

    Returns
    -------
    dict of str to CityObject
        Buildings, their parts and other objects.

    Raises
    ------
    InputError
        When the file is missing, no CityJSON 1.1 or 2.0, or its geometry points nowhere.

    Examples
    --------
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> models = [building.model(truth.cloud.origin) for building in truth.buildings]
    >>> from eaves.formats import read_cityjson, write_cityjson
    >>> write_cityjson("nine.city.json", models)
    9
    >>> models[0].footprint.id in read_cityjson("nine.city.json")
    True
    """
    return {found.id: found for found in iter_cityjson(path, crs)}


def iter_cityjson(path: str | Path, crs: str | None = None) -> Iterator[CityObject]:
    """The city objects of a file, one by one; of CityJSONSeq one line is in memory at a time.

    Parameters
    ----------
    path : str or Path
        `.city.json` or `.city.jsonl`.
    crs : str or None
        The system of the coordinates, when the file names none and it is not in metres.

    Returns
    -------
    iterator of CityObject
        Buildings, their parts and other objects, in the file's order.

    Raises
    ------
    InputError
        When the file is missing, no CityJSON 1.1 or 2.0, or its geometry points nowhere.

    Examples
    --------
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> models = [building.model(truth.cloud.origin) for building in truth.buildings]
    >>> from eaves.formats import iter_cityjson, write_cityjson_seq
    >>> write_cityjson_seq("nine.city.jsonl", models)
    9
    >>> len({item.parents[0] if item.parents else item.id for item in iter_cityjson("nine.city.jsonl")})
    9
    """
    path = Path(path)
    try:
        with path.open(encoding="utf-8-sig") as file:
            first = _parsed(path, file.readline(), 1)
            if first is None:  # an object spread over many lines
                file.seek(0)
                first = _parsed(path, file.read(), 1, whole=True)
            frame = _Frame(path, first or {}, crs)
            yield from frame.objects(first or {})
            for number, line in enumerate(file, 2):
                if line.strip():
                    feature = _parsed(path, line, number, whole=True) or {}
                    if feature.get("type") != "CityJSONFeature":
                        raise InputError.about(path, f"line {number} is no CityJSONFeature", REPAIR)
                    yield from frame.objects(feature)
    except OSError as error:
        raise InputError.about(path, f"cannot be read ({error.strerror})", "check the path") from None
    except UnicodeDecodeError:
        raise InputError.about(path, "is not text", "give a CityJSON or CityJSONSeq file") from None


def _parsed(path: Path, text: str, line: int, whole: bool = False) -> dict[str, Any] | None:
    """The JSON object of a text; None when it is cut off and may go on in the next line (not `whole`)."""
    try:
        value = json.loads(text)
    except (ValueError, RecursionError) as error:
        if not whole and text.lstrip().startswith("{"):
            return None
        reason = getattr(error, "msg", "nested too deeply")
        raise InputError.about(path, f"line {line} is not JSON ({reason})", REPAIR) from None
    if not isinstance(value, dict):
        raise InputError.about(path, f"line {line} is no JSON object", REPAIR)
    return value


class _Frame:
    """Transform and coordinate system of the file: what every feature's integers mean."""

    def __init__(self, path: Path, head: dict[str, Any], crs: str | None) -> None:
        self.path = path
        version = head.get("version")
        if head.get("type") != "CityJSON" or version not in ("1.0", "1.1", "2.0"):
            raise InputError.about(
                path,
                f"is {head.get('type')} {version}, not CityJSON 1.0 to 2.0",
                "convert it with cjio upgrade",
            )
        transform = head.get("transform", {"scale": [1, 1, 1], "translate": [0, 0, 0]})
        try:
            self.scale = np.array(transform["scale"], np.float64).reshape(3)
            self.translate = np.array(transform["translate"], np.float64).reshape(3)
            finite = bool(np.isfinite([self.scale, self.translate]).all() and (self.scale != 0).all())
        except (TypeError, KeyError, ValueError):
            finite = False
        if not finite:
            raise InputError.about(path, "has a transform that is not scale and translate", REPAIR)
        self.system = system_of_head(head, path, crs)

    def objects(self, feature: dict[str, Any]) -> Iterator[CityObject]:
        """The city objects of the file's head or of one feature."""
        raw = feature.get("CityObjects", {})
        try:
            vertices = np.array(feature.get("vertices", []), np.float64).reshape(-1, 3)
        except (TypeError, ValueError, OverflowError):
            raise InputError.about(
                self.path, "has vertices that are not triples of numbers", REPAIR
            ) from None
        if not isinstance(raw, dict) or not np.isfinite(vertices).all():
            raise InputError.about(self.path, "has CityObjects or vertices that are damaged", REPAIR)
        with np.errstate(over="ignore", invalid="ignore"):
            world = (vertices * self.scale + self.translate) * self.system.unit_m
        if not (np.abs(world) <= FARTHEST).all():
            raise InputError.about(self.path, "has vertices that are out of this world", REPAIR)
        world.flags.writeable = False
        for name, value in raw.items():
            yield self._object(name, value, world)

    def _object(self, name: str, value: Any, world: Values) -> CityObject:
        try:
            geometries = [_geometry(entry, world) for entry in value.get("geometry", [])]
            return CityObject(
                name,
                str(value["type"]),
                MappingProxyType(dict(value.get("attributes") or {})),
                tuple(geometry for geometry in geometries if geometry is not None),
                world,
                tuple(map(str, value.get("parents") or ())),
                tuple(map(str, value.get("children") or ())),
                self.system,
            )
        except KeyError as error:
            raise InputError.about(self.path, f"object '{name}' lacks {error}", REPAIR) from None
        except ValueError as error:
            raise InputError.about(self.path, f"object '{name}' {error}", REPAIR) from None
        except (TypeError, AttributeError, IndexError, RecursionError):
            raise InputError.about(
                self.path, f"object '{name}' does not follow the CityJSON specification", REPAIR
            ) from None


def read_models(path: str | Path) -> Iterator[BuildingModel | Failure]:
    """The buildings of a CityJSONSeq file one by one, with their parts and what stands on their roofs.

    Coordinates are those of the file, to its step of 1 mm; roof planes are not kept in it.

    Raises
    ------
    InputError
        When the file is missing or damaged.
    """
    yield from models_of(iter_cityjson(path))


def models_of(objects: Iterable[CityObject]) -> Iterator[BuildingModel | Failure]:
    """The buildings of city objects, of which the parts of each follow it."""
    for _, parts in groupby(objects, key=lambda one: one.parents[0] if one.parents else one.id):
        yield model_of(list(parts))


def model_of(parts: Sequence[CityObject]) -> BuildingModel | Failure:
    """A building from its objects, the Building first; a Failure where it has no solid."""
    places = [one.vertices[:, :2] for one in parts if len(one.vertices)] or [np.zeros((1, 2))]
    west, south = np.concatenate(places).min(axis=0)
    origin = float(west // BLOCK_SIDE * BLOCK_SIDE), float(south // BLOCK_SIDE * BLOCK_SIDE)
    solids: dict[str, tuple[Solid, ...]] = {}
    for one in parts:
        for geometry in one.geometries if one.type != INSTALLATION else ():
            if geometry.is_solid and geometry.lod in LODS:
                solids[geometry.lod] = (*solids.get(geometry.lod, ()), *one.as_solids(geometry, origin))
    attributes = dict(parts[0].attributes)
    score = float(attributes.pop("score", None) or 0.0)
    footprint = Footprint(outline_of(parts[0], origin), origin, parts[0].id, score)
    if not solids:
        code, reason = (str(attributes.pop(f"failure_{name}", "")) for name in ("code", "reason"))
        return Failure(code, reason, footprint=footprint.with_(attributes=attributes))
    bodies = [one for one in parts if one.type == INSTALLATION and one.geometries]
    objects = tuple(installation_of(one, origin) for one in bodies)
    return BuildingModel(footprint, dict(sorted(solids.items())), (), attributes, objects)


def outline_of(building: CityObject, origin: tuple[float, float]) -> Polygon:
    """The polygon (metres about `origin`) of LoD 0; an empty one where there is none."""
    for geometry in building.lod("0"):
        for face in geometry.faces:
            outer, *holes = (building.vertices[list(ring), :2] - origin for ring in face.rings)
            return Polygon(outer, holes)
    return Polygon()


def installation_of(one: CityObject, origin: tuple[float, float]) -> Installation:
    """An object on a roof; its outline is that of its roof faces in plan."""
    solid = one.as_solids(one.geometries[0], origin)[0]
    about: dict[str, Any] = dict(one.attributes)
    faces = [Polygon(solid.vertices[list(face.rings[0]), :2]) for face in solid.faces if face.rings]
    plan = shapely.union_all([face for face in faces if face.is_valid and face.area > 0.0])
    outline = max(plan.geoms, key=lambda part: part.area) if isinstance(plan, MultiPolygon) else plan
    return Installation(
        str(about.get("function", "")),
        outline if isinstance(outline, Polygon) else Polygon(),
        float(solid.vertices[:, 2].max()),
        float(about.get("height_m") or 0.0),
        int(about.get("points") or 0),
        solid,
    )


def read_head(path: Path) -> dict[str, Any]:
    """The first object of a CityJSONSeq file, which holds its frame and its metadata."""
    with path.open(encoding="utf-8-sig") as file:
        return _parsed(path, file.readline(), 1, whole=True) or {}


def system_of_head(head: dict[str, Any], path: Path, crs: str | None = None) -> CoordinateSystem:
    """The coordinate system that a file's first object states, or `crs`; local metres when there is none.

    Raises
    ------
    InputError
        When it is no system that is known.
    """
    metadata = head.get("metadata")
    given = metadata if isinstance(metadata, dict) else {}
    url, wkt = given.get("referenceSystem"), given.get(WKT_MEMBER)
    if crs is None and not isinstance(url, str) and not isinstance(wkt, str):
        return LOCAL_METRES
    code = str(url).rstrip("/").replace("::", ":").replace("/", ":").split(":")[-1]
    text = crs or wkt or f"EPSG:{code}"
    return system_of(parse_crs(str(text), path), path, (np.inf, np.inf))


def has_corners(face: Face) -> bool:
    """True if a face has a ring, and three corners in each; `eaves validate` names those that have not."""
    return bool(face.rings) and min(map(len, face.rings)) >= 3


def _geometry(entry: dict[str, Any], vertices: Values) -> CityGeometry | None:
    kind = entry["type"]
    if kind not in NESTING:
        return None
    semantics = entry.get("semantics") or {}
    surfaces = tuple(dict(surface) for surface in semantics.get("surfaces") or ())
    boundaries, values = entry["boundaries"], semantics.get("values")
    for _ in range(3 - NESTING[kind]):
        boundaries, values = [boundaries], None if values is None else [values]
    solids = tuple(
        tuple(
            _shell(faces, _pick(values, solid, shell), surfaces, vertices)
            for shell, faces in enumerate(shells)
        )
        for solid, shells in enumerate(boundaries)
    )
    return CityGeometry(kind, str(entry.get("lod", "")), solids, surfaces)


def _pick(values: Any, *path: int) -> Any:
    """The semantic values of a shell; null may stand for those of a whole shell or solid."""
    for step in path:
        if values is None:
            return None
        values = values[step]
    return values


def _shell(
    faces: list[list[list[int]]], values: Any, surfaces: tuple[dict[str, Any], ...], vertices: Values
) -> Solid:
    """A shell of faces of rings, with the semantic value of each face."""
    rings = list(chain.from_iterable(faces))
    corners = list(map(index, chain.from_iterable(rings)))
    if corners and not 0 <= min(corners) <= max(corners) < len(vertices):
        raise ValueError(f"has a face that points outside the {len(vertices)} vertices")
    known = [None if values is None or values[k] is None else index(values[k]) for k in range(len(faces))]
    wrong = [value for value in known if value is not None and not 0 <= value < len(surfaces)]
    if wrong:
        raise ValueError(f"has a face with semantics {wrong[0]} of {len(surfaces)}")
    return Solid(
        vertices,
        np.array(corners, np.int64),
        np.array(list(map(len, rings)), np.int64),
        np.array(list(map(len, faces)), np.int64),
        np.array(["" if value is None else str(surfaces[value]["type"]) for value in known], np.str_),
        np.array([NO_PLANE if value is None else value for value in known], np.int64),
    )
