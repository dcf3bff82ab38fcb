"""Sources of points: finding input files, opening them, reading their points in world metres."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pyproj

from eaves.formats.crs import LENGTHS, agree, crs_text, parse_crs, plane_part, system_of, unbound, unit_of
from eaves.formats.errors import InputError
from eaves.formats.in_memory import as_point_files, is_path
from eaves.formats.inputs import find_inputs, fingerprint
from eaves.formats.points.chunk import FARTHEST, Chunk
from eaves.formats.points.las import WHOLE, iter_las, readable_fields
from eaves.formats.points.las_header import LasHeader, read_las_header
from eaves.formats.points.plausible import Corner, are_degrees
from eaves.formats.points.recovery import corrected
from eaves.formats.points.text import TextLayout, iter_text, read_text_layout
from eaves.formats.statements import Stated
from eaves.formats.transformation import (
    AS_STORED,
    Transformation,
    scale_remark,
    target_of,
    transformed_remark,
    with_heights_of,
    zone_of,
)
from eaves.model import (
    LOCAL_METRES,
    Block,
    Bounds,
    CoordinateSystem,
    Mask,
    PointCloud,
    Points,
    Rectangle,
)
from eaves.model.cloud import snap

FIELDS = ("return_number", "number_of_returns", "classification")
MISSING = {"return_number": 1, "number_of_returns": 1, "classification": 0}
"""The values of a field in points of files that lack it."""

GIVEN = "--crs"
"""Who states what a caller gives."""

log = logging.getLogger("eaves")

CHUNK_POINTS = 300_000


@dataclass(frozen=True)
class Source:
    """One input file, as its header describes it. Picklable, so that workers can open it again.

    Parameters
    ----------
    path : Path
        The file.
    kind : str
        `las`, `laz`, `copc` or `text`.
    count : int
        Records in the file, withheld ones included.
    bounds : Bounds
        World metres, closed on all sides.
    heights : (float, float)
        Lowest and highest point (m).
    system : CoordinateSystem
        Its reference system.
    fields : tuple of str
        Those of `return_number`, `number_of_returns`, `classification` that the points have.
    layout : LasHeader or TextLayout
        Layout of the records in the file.
    mark : bytes
        Its fingerprint when it was opened.
    stored : Bounds
        Its place in the file's own units.
    own : Stated
        The system that the file, or the caller in its place, states.
    transformation : Transformation or None
        The way to `system` from another one that the points are stored in.

    Examples
    --------
    >>> from eaves.formats import open_source
    >>> from eaves.simulate import nine_roofs_on_a_slope, write_simulation
    >>> source = open_source(write_simulation(nine_roofs_on_a_slope(density=1.0), "nine")["points"])
    >>> source.kind, source.count
    ('laz', 10404)
    """

    path: Path
    kind: str
    count: int
    bounds: Bounds
    heights: tuple[float, float]
    system: CoordinateSystem
    fields: tuple[str, ...]
    layout: LasHeader | TextLayout = field(repr=False, compare=False)
    mark: bytes = field(default=b"", repr=False, compare=False)
    stored: Bounds = field(default=Bounds(0.0, 0.0, 0.0, 0.0), repr=False, compare=False)
    own: Stated = field(default=Stated(), repr=False, compare=False)
    transformation: Transformation | None = field(default=None, repr=False, compare=False)

    @property
    def target(self) -> str:
        """The system to which its points are transformed, as `to_crs` of other files; `none`: their own."""
        return AS_STORED if self.transformation is None else self.transformation.named

    @property
    def remarks(self) -> list[str]:
        """What must be said of its system: that it is transformed, or by how much its scale is off."""
        if self.own.crs is None or not self.count:
            return []
        box = self.stored
        x, y = (box.west + box.east) / 2, (box.south + box.north) / 2
        if self.transformation is None:
            remark = scale_remark(self.path, self.own.crs, x, y)
            return [] if remark is None else [remark]
        target = pyproj.CRS.from_wkt(self.transformation.target)
        return [transformed_remark(self.path, self.own.crs, target, x, y)]

    def to_metres(self, xyz: Points) -> Points:
        """Stored coordinates (N, 3) as world metres, in place."""
        if self.transformation is not None:
            return self.transformation.to_metres(xyz)
        if self.system.unit_m != (1.0, 1.0, 1.0):
            xyz *= self.system.unit_m
        return xyz

    @property
    def measured(self) -> bool:
        """True if the points had to be read to know this."""
        layout = self.layout
        return not (isinstance(layout, LasHeader) and _box_is_likely(layout))

    @property
    def has_wrong_bbox(self) -> bool:
        """True if its header states a bounding box that cannot be that of its points."""
        layout = self.layout
        return isinstance(layout, LasHeader) and layout.extent_is_known and not _box_is_likely(layout)


def open_source(path: str | Path, crs: str | None = None, to_crs: str | None = None) -> Source:
    """The description of a file, from its header alone (a text file has none: its points are read once).

    Parameters
    ----------
    path : str or Path
        LAS, LAZ, COPC or text `x y z [label]`.
    crs : str or None
        EPSG code, compound code (`28992+5709`), a file with WKT or PROJJSON, or `metres`, `feet` or `us-feet`
        of a local plane; it overrides the file's own.
    to_crs : str or None
        The projected system to which points are transformed as they are read; `none` leaves them in theirs;
        None: the UTM zone of the file's middle if its system is in degrees or its scale there is off by over
        1 %, else its own.

    Returns
    -------
    Source
        What the header states, in metres.

    Raises
    ------
    InputError
        When the file is missing, empty, cut off, damaged, in degrees that no system goes with, its header
        contradicts its points, or two statements of its system contradict each other.

    Examples
    --------
    >>> from eaves.formats import open_source
    >>> from eaves.simulate import nine_roofs_on_a_slope, write_simulation
    >>> open_source(write_simulation(nine_roofs_on_a_slope(density=1.0), "nine")["points"]).count
    10404
    """
    path = Path(path)
    try:
        with path.open("rb") as file:
            if os.fstat(file.fileno()).st_size == 0:
                raise InputError.about(path, "is empty (0 bytes)", "copy or download it again")
            header, mark = read_las_header(path, file), fingerprint(file)
            header = header and corrected(header, file)
        opened = _open_text(path, crs, to_crs) if header is None else _open_las(header, crs, to_crs)
        return replace(opened, mark=mark)
    except OSError as error:
        raise InputError.about(
            path, f"cannot be read ({error.strerror or error})", "check the path and its permissions"
        ) from None


def common_system(sources: Sequence[Source]) -> CoordinateSystem:
    """The coordinate system all files share; warns once when there is none.

    Parameters
    ----------
    sources : sequence of Source
        At least one file.

    Returns
    -------
    CoordinateSystem
        The system of all of them.

    Raises
    ------
    InputError
        When units or systems differ.

    Examples
    --------
    >>> from eaves.formats import common_system, open_source
    >>> from eaves.simulate import nine_roofs_on_a_slope, write_simulation
    >>> files = write_simulation(nine_roofs_on_a_slope(density=1.0).placed("EPSG:28992"), "nine")
    >>> common_system([open_source(files["points"])]).code
    'EPSG:28992'
    """
    system = agree((source.path, source.system) for source in sources)
    warn_without_system(system, sources[0].path, len(sources))
    return system


def is_simulated(path: Path) -> bool:
    """True if a LAS file says that `eaves simulate` made it."""
    try:
        with path.open("rb") as file:
            head = file.read(90)
    except OSError:
        return False
    return head[:4] == b"LASF" and head[58:90].rstrip(b"\0") == b"eaves simulate"


def warn_without_system(system: CoordinateSystem, first: Path, count: int) -> None:
    """Say so, once for `count` files, when they have no coordinate system; simulated scenes need none."""
    if system == LOCAL_METRES and not is_simulated(first):
        log.warning(
            "%s has no coordinate system: a local plane in metres is assumed; if it is in feet, or has a "
            "place on Earth, pass crs= or --crs (--crs feet, us-feet or metres of a local plane)",
            first if count == 1 else f"{first} (as the other {count - 1})",
        )


def iter_chunks(
    source: Source,
    bounds: Bounds | None = None,
    chunk_points: int = CHUNK_POINTS,
    part: tuple[int, int] = WHOLE,
    copy: BinaryIO | None = None,
    fields: Sequence[str] = (),
) -> Iterator[Chunk]:
    """The points of a file in world metres, in its order, about `chunk_points` at a time.

    Withheld points and points without coordinates (NaN, or x = y = z = 0) are left out; positions count them.

    Parameters
    ----------
    source : Source
        The file (`open_source`).
    bounds : Bounds or None
        World metres, half-open: only the points inside are returned; of COPC only the nodes needed are read.
    chunk_points : int
        About how many points a chunk holds (> 0).
    part : (int, int)
        The k-th of n runs of the file's records, so that several processes share a file; of a text file the
        first run is the whole.
    copy : binary file or None
        Receives the records of a LAS or LAZ file, decompressed, for `write_classified`.
    fields : sequence of str
        Other fields of the points to read (`PointCloud.fields`).

    Returns
    -------
    iterator of Chunk
        The points; no chunk is empty of arrays that the file has.

    Raises
    ------
    InputError
        When the file is cut off or damaged, or lacks a field.

    Examples
    --------
    >>> from eaves.formats import iter_chunks, open_source
    >>> from eaves.simulate import nine_roofs_on_a_slope, write_simulation
    >>> files = write_simulation(nine_roofs_on_a_slope(density=1.0), "nine")
    >>> sum(len(chunk.xyz) for chunk in iter_chunks(open_source(files["points"]), chunk_points=5000))
    10404
    """
    check_fields(source, fields)
    unit, transformation = source.system.horizontal_unit_m, source.transformation
    rectangle = None
    if bounds is not None and transformation is not None:
        rectangle = transformation.stored_box(bounds)
    elif bounds is not None:
        rectangle = bounds.west / unit, bounds.south / unit, bounds.east / unit, bounds.north / unit
    lost = 0
    for chunk in _native_chunks(source.layout, rectangle, chunk_points, part, copy, fields):
        use = has_coordinates(chunk.xyz)
        source.to_metres(chunk.xyz)
        if transformation is not None:
            use &= has_coordinates(chunk.xyz)
        lost += len(chunk) - int(np.count_nonzero(use))
        if chunk.withheld is not None:
            use &= ~chunk.withheld
        if bounds is not None:
            use &= bounds.contains(chunk.xyz)
        picked = chunk if use.all() else chunk.take(use)
        if len(picked):
            yield picked
    if lost:
        log.warning(
            "%s: %d points without coordinates (NaN, all zero or out of this world) are left out",
            source.path,
            lost,
        )


def fields_of(source: Source) -> Sequence[str]:
    """Names of the fields that the points of a file have beside coordinates."""
    return tuple(readable_fields(source.layout)) if isinstance(source.layout, LasHeader) else ()


def check_fields(source: Source, fields: Sequence[str]) -> None:
    """Check that a file has fields of its points.

    Raises
    ------
    InputError
        When it lacks one.
    """
    known = fields_of(source) if fields else ()
    for name in fields:
        if name not in known:
            there = ", ".join(known) or "coordinates alone"
            raise InputError.about(
                source.path, f"its points have no field '{name}', but {there}", "give files that have it"
            )


def read(
    paths: str | Path | Sequence[str | Path] | Any,
    bounds: Bounds | Sequence[float] | None = None,
    crs: str | int | Any = None,
    fields: Sequence[str] = (),
    to_crs: str | None = None,
) -> PointCloud:
    """The points of one or several files as one cloud.

    Parameters
    ----------
    paths : str, Path or sequence of them, laspy.LasData, or array (N, 3)
        Files, folders or globs; they are read in the order of `find_inputs`. Or points in memory, an array in
        the units of `crs`.
    bounds : Bounds or (west, south, east, north) or None
        World metres; only the points inside are read.
    crs : str, int, pyproj.CRS or None
        Overrides the system that the files name (see `open_source`).
    fields : sequence of str
        Other fields of the points to read (`PointCloud.fields`): `intensity`, `nir`, …
    to_crs : str or None
        The projected system to transform to (see `open_source`); None: as the first file decides.

    Returns
    -------
    PointCloud
        Metres about a block corner; `point_id` counts through all files in order, left-out points included.

    Raises
    ------
    InputError
        When a file cannot be read or lacks a field, or files differ in units or system.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope, write_simulation
    >>> files = write_simulation(nine_roofs_on_a_slope(density=1.0), "nine")
    >>> len(eaves.read(files["points"]))
    10404
    """
    if not is_path(paths):
        with as_point_files(paths, crs) as path:
            return read(path, bounds, crs, fields, to_crs)
    bounds = None if bounds is None else Bounds(*bounds)
    crs, to_crs = (None if one is None else crs_text(one) for one in (crs, to_crs))
    files = find_inputs(paths)
    sources = [open_source(files[0], crs, to_crs)]
    sources += [open_source(path, crs, sources[0].target) for path in files[1:]]
    system = common_system(sources)
    for remark in sources[0].remarks:
        log.warning("%s", remark)
    total = sum(source.count for source in sources)
    try:
        xyz, point_id = np.empty((total, 3)), np.empty(total, np.int64)
        known = {name: np.empty(total, np.uint8) for name in FIELDS if any(name in s.fields for s in sources)}
        others = {name: np.empty(total) for name in fields}
    except MemoryError:
        raise InputError.about(
            sources[0].path,
            f"memory does not hold {total} points at once",
            "run eaves build, or pass bounds=",
        ) from None
    before = filled = 0
    for source in sources:
        for chunk in iter_chunks(source, bounds, fields=fields):
            place = slice(filled, filled := filled + len(chunk))
            xyz[place], point_id[place] = chunk.xyz, chunk.position + before
            for name, values in known.items():
                given = getattr(chunk, name)
                values[place] = MISSING[name] if given is None else given
            for name, other in others.items():
                other[place] = chunk.fields[name]
        before += source.count
    if total and not filled and bounds is None:
        raise InputError.about(
            sources[0].path, f"none of its {total} points has coordinates", "export the points again"
        )
    # what was left out frees its memory with the whole arrays only if it is much
    trim = slice(None) if filled > total // 2 else np.arange(filled)
    arrays: dict[str, Any] = {name: values[:filled][trim] for name, values in known.items()}
    arrays["fields"] = {name: values[:filled][trim] for name, values in others.items()}
    xyz, point_id = xyz[:filled][trim], point_id[:filled][trim]
    origin = Block.at(*xyz[:, :2].min(axis=0)).origin if filled else (0.0, 0.0)
    for first in range(0, filled, CHUNK_POINTS):  # in place, for a second copy is what memory runs out of
        piece = xyz[first : first + CHUNK_POINTS]
        piece[...] = snap(piece - np.array([*origin, 0.0]))
    return PointCloud(xyz=xyz, origin=origin, point_id=point_id, system=system, **arrays)


def has_coordinates(xyz: Points) -> Mask:
    """Mask (N,) of the points (N, 3) that have coordinates: not NaN, not all zero, which writers use for
    'none', and not beyond `FARTHEST`, as in damaged files.
    """
    near: Mask = np.abs(xyz[:, 2]) <= FARTHEST[2]  # false for NaN, too
    for axis in (0, 1):
        near &= np.abs(xyz[:, axis]) <= FARTHEST[axis]
    return np.asarray(near & ((xyz[:, 0] != 0) | (xyz[:, 1] != 0) | (xyz[:, 2] != 0)))


def _native_chunks(
    layout: LasHeader | TextLayout,
    rectangle: Rectangle | None,
    size: int,
    part: tuple[int, int] = WHOLE,
    copy: BinaryIO | None = None,
    fields: Sequence[str] = (),
) -> Iterator[Chunk]:
    """Chunks in the file's own units."""
    if isinstance(layout, TextLayout):
        return iter_text(layout, size) if part[0] == 0 else iter(())
    return iter_las(layout, rectangle, size, part, copy, fields)


def _open_las(header: LasHeader, crs: str | None, to_crs: str | None) -> Source:
    count, low, high = header.count, header.lowest, header.highest
    if not _box_is_likely(header):
        try:
            count, low, high = _measured(header)
        except InputError:  # of a damaged file the points before the damage are used, wherever they are
            if not header.extent_is_known:
                raise
    given = _Projection(header.projection, crs, to_crs, header, _middle(low, high))
    placed = _placed_at(given) if to_crs is None else _placed_alike(given)
    if placed is None:
        placed = _undeclared(header.path, low, high, min(map(abs, header.scales[:2])), to_crs)
    kind = "copc" if header.compressed and header.copc is not None else "laz" if header.compressed else "las"
    return _source(kind, count, low, high, placed, FIELDS, header)


def _box_is_likely(header: LasHeader) -> bool:
    """True if the extent of the points is known without reading them."""
    return not header.count or (header.extent_is_known and header.extent_is_likely)


Placed = tuple[Stated, CoordinateSystem, Transformation | None]
"""What is stated of a file's system, the system of its points as they are read, and the way to it."""


@dataclass(frozen=True)
class _Projection:
    """The facts that decide a file's system: its projection records, and what the caller gives."""

    records: tuple[tuple[str, int, bytes], ...]
    crs: str | None
    to_crs: str | None
    header: LasHeader = field(compare=False)
    middle: tuple[float, float] = field(compare=False)


def _placed_at(given: _Projection) -> Placed | None:
    """The system of a file; None where nobody states one."""
    return _placed(_declared(given), given.header.path, given.middle, given.crs, given.to_crs)


_placed_alike = lru_cache(maxsize=64)(_placed_at)
"""The same where the middle decides nothing: a million tiles of a country have the same records."""


@lru_cache(maxsize=64)
def _declared(given: _Projection) -> Stated:
    """The system that the caller gives, with the unit of heights that the file states where he gives none;
    else that of the file."""
    if given.crs is None:
        return given.header.system()
    named = _given(given.crs)
    if named.upright is not None:
        return named
    try:
        stated = given.header.system()
    except InputError:  # of what contradicts itself nothing is taken
        return named
    return replace(named, height_unit=stated.upright, heights_from=stated.origins[1])


def _given(crs: str) -> Stated:
    """The system that a caller names: a local plane in a unit of `LENGTHS`, or a registered one."""
    if crs in LENGTHS:
        return Stated(None, LENGTHS[crs], GIVEN, GIVEN)
    return Stated(parse_crs(crs), None, GIVEN)


def _placed(
    own: Stated, path: Path, middle: tuple[float, float], crs: str | None, to_crs: str | None
) -> Placed | None:
    if own.crs is None:
        return None if crs is None else (own, CoordinateSystem(None, LENGTHS[crs], LENGTHS[crs]), None)
    plane = plane_part(own.crs)
    target = target_of(plane, path, *middle, to_crs)
    if target is None:
        return own, system_of(own.crs, path, middle, own.height_unit), None
    upright = own.upright or (1.0 if plane.is_geographic else unit_of(plane))
    system = system_of(with_heights_of(target, unbound(own.crs)), path, middle, upright)
    way = Transformation(plane.to_wkt(), target.to_wkt(), system.horizontal_unit_m, system.vertical_unit_m)
    return own, system, way


def _middle(low: Corner, high: Corner) -> tuple[float, float]:
    """The middle of a box in plan."""
    return (low[0] + high[0]) / 2, (low[1] + high[1]) / 2


def _open_text(path: Path, crs: str | None, to_crs: str | None) -> Source:
    layout = read_text_layout(path)
    count, low, high = _measured(layout)
    placed = None if crs is None else _placed(_given(crs), path, _middle(low, high), crs, to_crs)
    placed = placed or _undeclared(path, low, high, 1.0, to_crs)
    return _source("text", count, low, high, placed, () if layout.label is None else FIELDS[2:], layout)


def _measured(layout: LasHeader | TextLayout) -> tuple[int, Corner, Corner]:
    """Count and corners of the points themselves, for files whose header is wrong; zeros without points."""
    count, low, high = 0, np.full(3, np.inf), np.full(3, -np.inf)
    for chunk in _native_chunks(layout, None, CHUNK_POINTS):
        count = int(chunk.position[-1]) + 1
        known = chunk.xyz[has_coordinates(chunk.xyz)]
        if len(known):
            low, high = np.minimum(low, known.min(axis=0)), np.maximum(high, known.max(axis=0))
    if not np.isfinite(low).all():
        low = high = np.zeros(3)
    return (
        count,
        (float(low[0]), float(low[1]), float(low[2])),
        (float(high[0]), float(high[1]), float(high[2])),
    )


def _source(
    kind: str,
    count: int,
    low: Corner,
    high: Corner,
    placed: Placed,
    fields: tuple[str, ...],
    layout: LasHeader | TextLayout,
) -> Source:
    own, system, transformation = placed
    unit, _, height = system.unit_m
    bounds = Bounds(low[0] * unit, low[1] * unit, high[0] * unit, high[1] * unit)
    return Source(
        layout.path,
        kind,
        count,
        bounds if transformation is None else transformation.box(low, high),
        (low[2] * height, high[2] * height),
        system,
        fields,
        layout,
        stored=Bounds(low[0], low[1], high[0], high[1]),
        own=own,
        transformation=transformation,
    )


def _undeclared(path: Path, low: Corner, high: Corner, step: float, to_crs: str | None) -> Placed:
    """The system of a file that names none: a local plane in metres; evident degrees are refused."""
    if are_degrees(low, high, step):
        centre = _middle(low, high)
        zone = zone_of(pyproj.CRS.from_epsg(4326), *centre)
        raise InputError.about(
            path,
            f"coordinates around {centre[0]:.4f}, {centre[1]:.4f} are degrees of a system that nobody states",
            f"pass it with crs= or --crs, for example EPSG:4326; points are transformed to {zone} then",
        )
    if to_crs not in (None, AS_STORED):
        raise InputError.about(path, "has no coordinate system to transform from", "pass it with --crs")
    return Stated(), LOCAL_METRES, None
