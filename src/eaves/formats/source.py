"""Where points come from: finding input files, opening them, reading their points in world metres."""

from __future__ import annotations

import glob
import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pyproj
from numpy.typing import NDArray

from eaves.formats.chunk import Chunk
from eaves.formats.crs import agree, degrees_remedy, parse_crs, system_of
from eaves.formats.errors import InputError
from eaves.formats.las import iter_las
from eaves.formats.las_header import LasHeader, is_las, read_las_header
from eaves.formats.text import TextLayout, iter_text, read_text_layout
from eaves.model import Bounds, CoordinateSystem, Mask, PointCloud, Points
from eaves.model.coordinates import LOCAL_METRES

Corner = tuple[float, float, float]
FIELDS = ("return_number", "number_of_returns", "classification")

log = logging.getLogger("eaves")

LAS_SUFFIXES = (".las", ".laz")
TEXT_SUFFIXES = (".txt", ".xyz", ".csv", ".asc")
CHUNK_POINTS = 300_000
DEGREE_EXTENT, DEGREE_RELIEF, DEGREE_SCALE = 0.5, 20.0, 1e-6
"""Data without a system are in degrees when they fit ±180 and ±90, span less than 0.5 and are either 20 times
higher than wide (a tile of 0.01° has metres of relief) or stored in steps under 1e-6 (0.1 m in degrees)."""


@dataclass(frozen=True)
class Source:
    """One input file: what its header says. Picklable, so that workers can open it again."""

    path: Path
    kind: str
    """`las`, `laz`, `copc` or `text`."""
    count: int
    """Records in the file, withheld ones included."""
    bounds: Bounds
    """World metres, closed on all sides."""
    heights: tuple[float, float]
    """Lowest and highest point, metres."""
    system: CoordinateSystem
    fields: tuple[str, ...]
    """Which of `return_number`, `number_of_returns`, `classification` the points carry."""
    layout: LasHeader | TextLayout = field(repr=False, compare=False)


def find_inputs(paths: str | Path | Sequence[str | Path]) -> list[Path]:
    """The point files that files, folders and globs name, each once, sorted.

    A folder gives its LAS, LAZ and COPC files, or its text files when it has none of them.

    Raises
    ------
    InputError
        For a path that gives no file.
    """
    found: dict[Path, Path] = {}
    for given in [paths] if isinstance(paths, str | Path) else paths:
        path = Path(given)
        if path.is_dir():
            names = sorted(entry for entry in path.iterdir() if entry.is_file() and entry.name[0] != ".")
            files = [name for name in names if name.suffix.lower() in LAS_SUFFIXES]
            files = files or [name for name in names if name.suffix.lower() in TEXT_SUFFIXES]
        elif path.exists():
            files = [path]
        else:
            files = [Path(name) for name in glob.glob(str(given), recursive=True) if Path(name).is_file()]
        if not files:
            rule = "has no point files" if path.is_dir() else "does not exist"
            raise InputError.about(
                given, rule, "give a LAS, LAZ, COPC or text file, a folder of them, or a glob"
            )
        found.update((file.resolve(), file) for file in files)
    if not found:
        raise InputError("no input given; give a LAS, LAZ, COPC or text file, a folder of them, or a glob")
    return sorted(found.values(), key=lambda file: str(file.resolve()))


def open_source(path: str | Path, crs: str | None = None) -> Source:
    """What a file holds, from its header alone (a text file has none: its points are read once).

    Parameters
    ----------
    path
        LAS, LAZ, COPC or text `x y z [label]`.
    crs
        EPSG code, compound code (`28992+5709`), or a file with WKT or PROJJSON; it overrides the file's own.

    Raises
    ------
    InputError
        When the file is missing, empty, cut off, damaged, in degrees, or its header lies.
    """
    path = Path(path)
    try:
        if path.stat().st_size == 0:
            raise InputError.about(path, "is empty (0 bytes)", "copy or download it again")
        if is_las(path):
            return _open_las(path, crs)
        if path.suffix.lower() in LAS_SUFFIXES:
            read_las_header(path)
        return _open_text(path, crs)
    except OSError as error:
        raise InputError.about(
            path, f"cannot be read ({error.strerror or error})", "check the path and its permissions"
        ) from None


def common_system(sources: Sequence[Source]) -> CoordinateSystem:
    """The coordinate system all files share; warns once when there is none.

    Raises
    ------
    InputError
        When units or systems differ.
    """
    system = agree((source.path, source.system) for source in sources)
    if system.wkt is None:
        log.warning(
            "%s has no coordinate system: a local plane in metres is assumed; if it is in feet, or has a "
            "place on Earth, pass crs= or --crs",
            sources[0].path if len(sources) == 1 else f"{sources[0].path} (as the other {len(sources) - 1})",
        )
    return system


def iter_chunks(
    source: Source, bounds: Bounds | None = None, chunk_points: int = CHUNK_POINTS
) -> Iterator[Chunk]:
    """The points of a file in world metres, in its order, about `chunk_points` at a time.

    Withheld points and points without coordinates (NaN, or x = y = z = 0) are left out; positions count them.
    With `bounds` (world metres, half-open) only the points inside come; of COPC only the nodes needed are
    read.
    """
    units = np.array(source.system.unit_m)
    unit = source.system.horizontal_unit_m
    rectangle = None
    if bounds is not None:
        rectangle = bounds.west / unit, bounds.south / unit, bounds.east / unit, bounds.north / unit
    lost = 0
    for chunk in _native_chunks(source.layout, rectangle, chunk_points):
        use = has_coordinates(chunk.xyz)
        lost += len(chunk) - int(np.count_nonzero(use))
        if chunk.withheld is not None:
            use &= ~chunk.withheld
        if (units != 1.0).any():
            chunk.xyz[...] *= units
        if bounds is not None:
            use &= bounds.contains(chunk.xyz)
        picked = chunk if use.all() else chunk.take(use)
        if len(picked):
            yield picked
    if lost:
        log.warning("%s: %d points without coordinates (NaN or all zero) are left out", source.path, lost)


def read(
    paths: str | Path | Sequence[str | Path], bounds: Bounds | None = None, crs: str | None = None
) -> PointCloud:
    """The points of one or several files as one cloud.

    Parameters
    ----------
    paths
        Files, folders or globs; they are read in the order of `find_inputs`.
    bounds
        World metres; only the points inside are read.
    crs
        Overrides what the files say (see `open_source`).

    Returns
    -------
    PointCloud
        Metres about a block corner; `point_id` counts through all files in order, left-out points included.

    Raises
    ------
    InputError
        When a file cannot be read, or files differ in units or system.
    """
    sources = [open_source(path, crs) for path in find_inputs(paths)]
    system = common_system(sources)
    chunks: list[Chunk] = []
    starts: list[int] = []
    before = 0
    for source in sources:
        for chunk in iter_chunks(source, bounds):
            chunks.append(chunk)
            starts.append(before)
        before += source.count
    total = sum(map(len, chunks))
    if before and not total and bounds is None:
        raise InputError.about(
            sources[0].path, f"none of its {before} points has coordinates", "export the points again"
        )
    return PointCloud.from_world(
        np.concatenate([chunk.xyz for chunk in chunks]) if chunks else np.zeros((0, 3)),
        return_number=_joined([chunk.return_number for chunk in chunks], chunks, 1),
        number_of_returns=_joined([chunk.number_of_returns for chunk in chunks], chunks, 1),
        classification=_joined([chunk.classification for chunk in chunks], chunks, 0),
        point_id=np.concatenate([chunk.position + start for chunk, start in zip(chunks, starts, strict=True)])
        if chunks
        else np.zeros(0, np.int64),
        system=system,
    )


def has_coordinates(xyz: Points) -> Mask:
    """Which points (N, 3) have coordinates: finite, and not all zero, which is how writers say 'none'."""
    finite: Mask = np.isfinite(xyz[:, 0]) & np.isfinite(xyz[:, 1]) & np.isfinite(xyz[:, 2])
    return np.asarray(finite & ((xyz[:, 0] != 0) | (xyz[:, 1] != 0) | (xyz[:, 2] != 0)))


def _joined(
    arrays: list[NDArray[np.uint8] | None], chunks: list[Chunk], missing: int
) -> NDArray[np.uint8] | None:
    """One array of the chunks' arrays; `missing` stands in for files that lack the field; None if all do."""
    if all(array is None for array in arrays):
        return None
    return np.concatenate(
        [
            np.full(len(chunk), missing, np.uint8) if array is None else array
            for array, chunk in zip(arrays, chunks, strict=True)
        ]
    )


def _native_chunks(
    layout: LasHeader | TextLayout, rectangle: tuple[float, float, float, float] | None, size: int
) -> Iterator[Chunk]:
    """Chunks in the file's own units."""
    if isinstance(layout, TextLayout):
        return iter_text(layout, size)
    return iter_las(layout, rectangle, size)


def _open_las(path: Path, crs: str | None) -> Source:
    header = read_las_header(path)
    count, low, high = header.count, header.lowest, header.highest
    if not header.extent_is_known:
        count, low, high = _measured(header)
    declared, vertical_unit = (parse_crs(crs), None) if crs else header.crs()
    system = _system(path, declared, vertical_unit, low, high, min(map(abs, header.scales[:2])))
    kind = "copc" if header.compressed and header.copc is not None else "laz" if header.compressed else "las"
    return _source(kind, count, low, high, system, FIELDS, header)


def _open_text(path: Path, crs: str | None) -> Source:
    layout = read_text_layout(path)
    count, low, high = _measured(layout)
    system = _system(path, parse_crs(crs) if crs else None, None, low, high, 1.0)
    return _source("text", count, low, high, system, () if layout.label is None else FIELDS[2:], layout)


def _measured(layout: LasHeader | TextLayout) -> tuple[int, Corner, Corner]:
    """Count and corners of the points themselves, for files that do not tell or lie; zeros when there are
    none."""
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
    system: CoordinateSystem,
    fields: tuple[str, ...],
    layout: LasHeader | TextLayout,
) -> Source:
    unit, _, height = system.unit_m
    bounds = Bounds(low[0] * unit, low[1] * unit, high[0] * unit, high[1] * unit)
    return Source(
        layout.path, kind, count, bounds, (low[2] * height, high[2] * height), system, fields, layout
    )


def _system(
    path: Path, crs: pyproj.CRS | None, vertical_unit: float | None, low: Corner, high: Corner, step: float
) -> CoordinateSystem:
    """The file's system; degrees, declared or evident, are refused."""
    centre = (low[0] + high[0]) / 2, (low[1] + high[1]) / 2
    if crs is not None:
        return system_of(crs, path, centre, vertical_unit)
    width, relief = max(high[0] - low[0], high[1] - low[1]), high[2] - low[2]
    fits = max(abs(low[0]), abs(high[0])) <= 180 and max(abs(low[1]), abs(high[1])) <= 90
    if fits and 0 < width < DEGREE_EXTENT and (relief > DEGREE_RELIEF * width or step < DEGREE_SCALE):
        raise InputError.about(
            path, f"coordinates around {centre[0]:.4f}, {centre[1]:.4f} are degrees", degrees_remedy(*centre)
        )
    return LOCAL_METRES
