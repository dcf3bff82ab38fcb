"""The input points written back in their order, with our classes and labels: classified.laz."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from datetime import date
from io import BytesIO
from pathlib import Path
from typing import Any, Protocol

import laspy
import numpy as np
from laspy.point.dims import raise_if_version_not_compatible_with_fmt
from laspy.vlrs.vlrlist import VLRList
from numpy.typing import NDArray

from eaves.formats.crs import pyproj_crs
from eaves.formats.points.las import FIRST_LAYERED_FORMAT, iter_copied, iter_records
from eaves.formats.points.las_header import LasHeader
from eaves.formats.points.source import CHUNK_POINTS, Source, has_coordinates
from eaves.formats.points.text import iter_text
from eaves.formats.whole_files import atomic
from eaves.model import NOTHING_KNOWN, Provenance

log = logging.getLogger("eaves")
UNDATED = date(1, 1, 1)
"""Stands for a missing creation date: today's would make two runs differ."""
TEXT_SCALE = 0.001
"""Step (m) of coordinates that came as text."""
OWNER = "eaves"
"""Of our variable-length record."""
UNCHANGED = 255
"""In place of a class: the point was not used, keep the values of the file."""
SUPERSEDED = 254
"""In place of a class: a later scan has taken the point's place; it keeps its values, and is withheld."""


class Values(Protocol):
    """A value a record: an array, or what is read slice by slice like one."""

    @property
    def dtype(self) -> Any: ...

    def __len__(self) -> int: ...

    def __getitem__(self, place: slice, /) -> NDArray[Any]: ...


def write_classified(
    source: Source,
    path: str | Path,
    classification: Values,
    extra: Mapping[str, Values] | None = None,
    chunk_points: int = CHUNK_POINTS,
    sink: Callable[[int, NDArray[np.void]], None] | None = None,
    provenance: Provenance = NOTHING_KNOWN,
    copies: Sequence[str | Path] = (),
    used_only: bool = False,
) -> None:
    """Write the points of a file as LAZ: same records in the same order, classes replaced, dimensions added.

    Withheld points keep all their values, their class included. Text becomes LAS 1.4, point format 6.

    Parameters
    ----------
    source : Source
        The input file.
    path : str or Path
        The LAZ file to write; it appears when it is whole.
    classification : ndarray (count,) of uint8
        LAS class of every record of the file, `UNCHANGED` or `SUPERSEDED`; a memory-mapped array is read
        piece by piece.
    extra : mapping of str to ndarray (count,), or None
        Dimension name → values: `building_id`, `plane_id`, `part`. One that the input has is replaced.
    chunk_points : int
        Number of points in memory at a time (> 0).
    sink : callable or None
        Called with the position of the first of some records, and the records, as they are written.
    provenance : Provenance
        What a variable-length record of the file (owner `eaves`, number 1, JSON) then says.
    copies : sequence of str or Path
        Files with the input's records as `iter_chunks` copied them, one run after the other; where there are
        any, the input is not decompressed a second time.
    used_only : bool
        True if points whose class is `UNCHANGED` are left out.

    Raises
    ------
    InputError
        When the input cannot be read to its end or the output folder cannot be written.
    ValueError
        When an array's length is not the number of records.

    Examples
    --------
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> from eaves.formats import open_source, write_classified
    >>> from eaves.simulate import write_simulation
    >>> source = open_source(write_simulation(truth, "nine")["points"])
    >>> write_classified(source, "classified.laz", truth.truth_class, {"building_id": truth.building})
    """
    arrays = dict(extra or {})
    for name, values in {"classification": classification, **arrays}.items():
        if len(values) != source.count:
            raise ValueError(f"{name} has {len(values)} values, {source.path} has {source.count} points")
    if isinstance(source.layout, LasHeader):
        header, record = _las_header(source.layout, arrays)
        if source.transformation is not None:
            place_anew(header, source)
        pieces = las_pieces(source.layout, record, chunk_points, copies)
    else:
        header, pieces = _text_header(source), _text_pieces(source, chunk_points)
        _add_dimensions(header, arrays)
    name_system(header, source)
    header.vlrs = VLRList([vlr for vlr in header.vlrs if vlr.user_id != OWNER])
    if provenance:
        origins = json.dumps(provenance.members).encode()
        header.vlrs.append(laspy.VLR(OWNER, 1, "provenance", origins))
    written = 0
    with (
        atomic(path) as temporary,
        temporary.open("w+b") as file,
        laspy.LasWriter(file, header, do_compress=True, closefd=False) as writer,
    ):
        for first, records in pieces:
            part = slice(first, first + len(records))
            points = laspy.ScaleAwarePointRecord.zeros(len(records), header=header)
            for name in records.dtype.names or ():
                if name in points.array.dtype.names and name not in arrays:
                    points.array[name] = records[name]
            if source.transformation is not None and isinstance(source.layout, LasHeader):
                transform_records(points.array, header, source, source.layout)
            _set_classes(points, header, np.asarray(classification[part], np.uint8))
            for name, values in arrays.items():
                points.array[name] = values[part]
            if used_only:
                points = points[np.asarray(classification[part]) != UNCHANGED]
                first = written
            written += len(points)
            writer.write_points(points)
            if sink is not None:
                sink(first, points.array)
        if header.evlrs and header.version.minor >= 4:
            writer.write_evlrs(header.evlrs)


def name_system(header: laspy.LasHeader, source: Source) -> None:
    """Add the system that the run was given to the header of a file that states none. Point formats before 6
    hold those with a code alone."""
    crs = pyproj_crs(source.system)
    if crs is not None and not header.vlrs.get_by_id("LASF_Projection"):
        with suppress(RuntimeError):
            header.add_crs(crs)


def place_anew(header: laspy.LasHeader, source: Source) -> None:
    """Give a header the system to which the points are transformed, and steps of a millimetre in plan."""
    corner = np.array([source.bounds.west, source.bounds.south]) / source.system.horizontal_unit_m
    header.scales[:2] = TEXT_SCALE / source.system.horizontal_unit_m
    header.offsets[:2] = np.floor(corner)
    header._vlrs = VLRList([vlr for vlr in header.vlrs if vlr.user_id != "LASF_Projection"])
    if header.evlrs is not None:
        header.evlrs = VLRList([vlr for vlr in header.evlrs if vlr.user_id != "LASF_Projection"])


def transform_records(
    records: NDArray[np.void], header: laspy.LasHeader, source: Source, layout: LasHeader
) -> None:
    """The records of a file with their places in the system and the steps of a header; those without
    coordinates at its corner, withheld."""
    stored = np.column_stack([records[axis] for axis in "XYZ"]) * layout.scales + layout.offsets
    known = has_coordinates(stored)
    xyz = source.to_metres(stored) / source.system.unit_m
    known &= has_coordinates(xyz)
    steps = np.round((np.where(known[:, None], xyz, header.offsets) - header.offsets) / header.scales)
    steps = np.clip(steps, -(2**31), 2**31 - 1).astype(np.int32)
    records["X"], records["Y"], records["Z"] = steps.T
    if header.point_format.id >= FIRST_LAYERED_FORMAT:
        records["classification_flags"] |= np.where(known, 0, 4).astype(np.uint8)
    else:
        records["raw_classification"] |= np.where(known, 0, 128).astype(np.uint8)


def _las_header(layout: LasHeader, arrays: Mapping[str, Values]) -> tuple[laspy.LasHeader, np.dtype[np.void]]:
    """A header for the input's points with new dimensions, and how its own records are laid out.

    One that is damaged where reading points does not need it gives way to a new one.
    """
    try:
        header = copied_header(layout)
        record = header.point_format.dtype()
        if record.itemsize != layout.record_length:
            raise ValueError(f"its dimensions fill {record.itemsize} of {layout.record_length} bytes")
        _add_dimensions(header, arrays)
        raise_if_version_not_compatible_with_fmt(header.point_format.id, str(header.version))
        header.write_to(BytesIO())
    except Exception as error:  # laspy raises whatever its parts raise
        log.warning(
            "%s: its header cannot be copied (%s); the classified points have a new one, without its extra "
            "dimensions and records",
            layout.path,
            error,
        )
        header = _new_header(layout)
        record = header.point_format.dtype()
        _add_dimensions(header, arrays)
    return header, record


def copied_header(layout: LasHeader) -> laspy.LasHeader:
    """The input's header without what is true of the input alone: compression and octree."""
    with layout.path.open("rb") as file:
        header = laspy.LasHeader.read_from(file, read_evlrs=True)
    kept = [vlr for vlr in header.vlrs if vlr.user_id not in ("copc", "laszip encoded")]
    header._vlrs = VLRList(kept)
    if header.evlrs is not None:
        header.evlrs = VLRList([vlr for vlr in header.evlrs if vlr.user_id != "copc"])
    header.creation_date = header.creation_date or UNDATED
    return header


def _new_header(layout: LasHeader) -> laspy.LasHeader:
    """A header with the description of the input's points and their coordinate system."""
    version = "1.4" if layout.point_format >= FIRST_LAYERED_FORMAT else "1.2"
    header = laspy.LasHeader(version=version, point_format=layout.point_format)
    header.scales, header.offsets = np.array(layout.scales), np.array(layout.offsets)
    header.creation_date = UNDATED
    for owner, number, data in layout.records:
        if owner == "LASF_Projection":
            header.vlrs.append(laspy.VLR(owner, number, record_data=data))
    return header


def las_pieces(
    layout: LasHeader, record: np.dtype[np.void], size: int, copies: Sequence[str | Path] = ()
) -> Iterator[tuple[int, NDArray[np.void]]]:
    for first, records in iter_copied(layout, size, copies) or _numbered_pieces(iter_records(layout, size)):
        known = np.ascontiguousarray(records[:, : record.itemsize])
        yield first, known.reshape(-1).view(record)


def _numbered_pieces(
    pieces: Iterator[tuple[NDArray[np.int64], NDArray[np.uint8]]],
) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    for position, records in pieces:
        yield int(position[0]), records


def _text_header(source: Source) -> laspy.LasHeader:
    header = laspy.LasHeader(version="1.4", point_format=FIRST_LAYERED_FORMAT)
    unit, bounds = source.system.horizontal_unit_m, source.bounds
    header.scales = TEXT_SCALE / np.array(source.system.unit_m)
    header.offsets = np.floor([bounds.west / unit, bounds.south / unit, 0.0])
    header.creation_date = UNDATED
    crs = pyproj_crs(source.system)
    if crs is not None:
        header.add_crs(crs)
    return header


def _text_pieces(source: Source, size: int) -> Iterator[tuple[int, NDArray[np.void]]]:
    header = _text_header(source)
    assert not isinstance(source.layout, LasHeader)
    for chunk in iter_text(source.layout, size):
        records = np.zeros(len(chunk), header.point_format.dtype())
        # A line without coordinates keeps its place, so that labels fit, and is marked as not to be used.
        usable = has_coordinates(chunk.xyz)
        if source.transformation is not None:
            chunk.xyz[...] = source.to_metres(chunk.xyz) / source.system.unit_m
            usable &= has_coordinates(chunk.xyz)
        steps = np.round(
            (np.where(usable[:, None], chunk.xyz, header.offsets) - header.offsets) / header.scales
        )
        records["X"], records["Y"], records["Z"] = np.clip(steps, -(2**31), 2**31 - 1).T.astype(np.int32)
        records["bit_fields"] = 1 | 1 << 4
        records["classification_flags"] = np.where(usable, 0, 4)
        yield int(chunk.position[0]), records


def _add_dimensions(header: laspy.LasHeader, arrays: Mapping[str, Values]) -> None:
    present = set(header.point_format.extra_dimension_names)
    header.remove_extra_dims([name for name in arrays if name in present])
    header.add_extra_dims([laspy.ExtraBytesParams(name, values.dtype) for name, values in arrays.items()])


def _set_classes(
    points: laspy.ScaleAwarePointRecord, header: laspy.LasHeader, classes: NDArray[np.uint8]
) -> None:
    """Replace every class but those of withheld points (LAS 1.4, tables 8 and 16) and where `UNCHANGED`;
    withhold what is `SUPERSEDED`."""
    gone = classes == SUPERSEDED
    classes = np.where(gone, np.uint8(UNCHANGED), classes)
    if header.point_format.id >= FIRST_LAYERED_FORMAT:
        kept = ((points.array["classification_flags"] & 4) != 0) | (classes == UNCHANGED)
        points.array["classification"] = np.where(kept, points.array["classification"], classes)
        points.array["classification_flags"] |= np.where(gone, np.uint8(4), np.uint8(0))
    else:
        raw = points.array["raw_classification"]
        kept = ((raw & 128) != 0) | (classes == UNCHANGED)
        classes = np.where(kept, raw, (raw & 0xE0) | (classes & 31))
        points.array["raw_classification"] = np.where(gone, classes | 128, classes)
