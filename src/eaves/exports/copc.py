"""Points as COPC (Cloud Optimized Point Cloud 1.0): LAZ of which every chunk is a node of an octree."""

from __future__ import annotations

import logging
import struct
from copy import deepcopy
from pathlib import Path

import laspy
import lazrs
import numpy as np
from laspy.header import Version
from laspy.vlrs.vlrlist import VLRList
from numpy.typing import NDArray

from eaves.formats import (
    CHUNK_POINTS,
    ENTRY,
    FIRST_LAYERED_FORMAT,
    Format,
    InputError,
    LasHeader,
    atomic,
    copied_header,
    las_pieces,
    open_source,
    pyproj_crs,
)
from eaves.model import CoordinateSystem, Integers

log = logging.getLogger("eaves")
NODE_POINTS = 50_000
"""A cube of more points is split: LASzip's usual chunk, below which compression suffers. PDAL and Untwine
take twice as many; a small area then needs more bytes."""
GRID_BITS = 6
"""A cube that is split keeps one point of each of its 64³ cells for views from afar. With the 128³ of others
the coarse nodes, which every area needs, are four times as large."""
LEVELS = 21
"""Of the octree at most: three times so many bits name a cell in 64 bits."""
NODES_AT_ONCE = 32
"""Nodes that are compressed side by side; memory for their points is needed."""
ANGLE_STEP = 0.006
"""Degrees of a scan angle's step in point formats from 6 on; one degree before (LAS 1.4, table 15)."""
Cells = NDArray[np.uint64]


def write_copc(points: str | Path, path: str | Path, system: CoordinateSystem | None = None) -> int:
    """Write the points of a LAS or LAZ file as COPC, with all their values.

    Point formats before 6 become 6, or 7 with colours; waveforms are left out, with a warning. The points of
    a node stand in the order of the input. It takes some 60 bytes of memory a point, and the decompressed
    records on the disk.

    Parameters
    ----------
    points : str or Path
        The LAS or LAZ file.
    path : str or Path
        The file to write, `*.copc.laz`; it appears when it is whole.
    system : CoordinateSystem or None
        That of a file that states none, as point formats before 6 cannot state every one.

    Returns
    -------
    int
        The number of points. Of a file without points nothing is written, with a warning.

    Raises
    ------
    InputError
        When the file is no LAS or is damaged, or the folder cannot be written.

    References
    ----------
    COPC specification 1.0 (https://copc.io).
    """
    source = open_source(points)
    layout = source.layout
    if not isinstance(layout, LasHeader):
        raise InputError.about(source.path, "is no LAS", "give a LAS or LAZ file")
    if not source.count:
        log.warning("%s: has no points, so there is no COPC of it", source.path)
        return 0
    old = copied_header(layout)
    header = converted_header(old)
    crs = pyproj_crs(source.system) or (None if system is None else pyproj_crs(system))
    if crs is not None and not header.vlrs.get("WktCoordinateSystemVlr"):
        header.add_crs(crs)
    if "wavepacket_index" in old.point_format.dimension_names:
        log.warning("%s: its waveforms have no place in COPC; they are left out", source.path)
    with atomic(path) as temporary:
        plain = temporary.with_suffix(".records")
        with plain.open("wb") as file:
            for _, records in las_pieces(layout, old.point_format.dtype(), CHUNK_POINTS):
                piece = converted_points(records, old.point_format, header.point_format)
                header.grow(piece)
                file.write(piece.array.tobytes())
        stored = np.memmap(plain, header.point_format.dtype(), "r")
        _write_nodes(temporary, header, stored)
        del stored  # a file that is mapped cannot be removed everywhere
    return source.count


def converted_header(old: laspy.LasHeader) -> laspy.LasHeader:
    """The header of the same points in format 6, 7 or 8 of LAS 1.4, without counts and bounds."""
    names = set(old.point_format.dimension_names)
    form = laspy.PointFormat(8 if "nir" in names else 7 if "red" in names else 6)
    form.dimensions.extend(old.point_format.extra_dimensions)
    header = deepcopy(old)
    header.set_version_and_point_format(Version(1, 4), form)
    header.partial_reset()
    header.extra_header_bytes = header.extra_vlr_bytes = b""
    header.start_of_waveform_data_packet_record = 0
    header.global_encoding.wkt = True
    evlrs = header.evlrs or VLRList()
    header.vlrs.extend(evlrs.extract("WktCoordinateSystemVlr"))
    header.evlrs = evlrs
    return header


def converted_points(
    records: NDArray[np.void], old: laspy.PointFormat, form: laspy.PointFormat
) -> laspy.PackedPointRecord:
    """Records in another point format, their extra dimensions bit by bit."""
    given = laspy.PackedPointRecord(records, old)
    if old.id == form.id:
        return given
    points = laspy.PackedPointRecord.from_point_record(given, form)
    for name in form.extra_dimension_names:
        points.array[name] = records[name]
    if old.id < FIRST_LAYERED_FORMAT:
        points.array["scan_angle"] = np.round(records["scan_angle_rank"] / ANGLE_STEP)
    return points


def _write_nodes(path: Path, header: laspy.LasHeader, records: NDArray[np.void]) -> None:
    """The file itself: header, nodes from coarse to fine as chunks, and the hierarchy."""
    side = max(float((header.maxs - header.mins).max()), float(header.scales.max()))
    node = find_nodes(interleave(cells_of(records, header, side)))
    order = np.argsort(node, kind="stable")
    node = node[order]
    first, counts = runs(node)
    level = (np.frexp(node[first].astype(np.float64))[1] - 1) // 3
    cells = cells_of(records[order[first]], header, side) >> (LEVELS - level).astype(np.uint32)

    laszip = lazrs.LazVlr.new_for_compression(
        header.point_format.id, header.point_format.num_extra_bytes, use_variable_size_chunks=True
    )
    info = laspy.VLR("copc", 1, "COPC info", bytes(160))
    header.vlrs.insert(0, info)
    header.vlrs.append(laspy.VLR("laszip encoded", 22204, "", bytes(laszip.record_data())))
    header.set_compressed(True)
    with path.open("w+b") as file:
        header.write_to(file)
        compressor = lazrs.ParLasZipCompressor(file, laszip)
        compressor.reserve_offset_to_chunk_table()
        nodes = np.split(order, first[1:])
        for start in range(0, len(nodes), NODES_AT_ONCE):
            some = nodes[start : start + NODES_AT_ONCE]
            compressor.compress_chunks([records[one].view(np.uint8) for one in some])
        compressor.done()
        header.start_of_first_evlr = file.seek(0, 2)
        file.seek(header.offset_to_point_data)
        lengths = np.array(lazrs.read_chunk_table(file, laszip))[:, 1]

        entries = np.zeros(len(first), ENTRY)
        entries["level"], entries["cell"], entries["points"] = level, cells.T, counts
        entries["offset"] = header.offset_to_point_data + 8 + np.cumsum(lengths) - lengths
        entries["length"] = lengths
        header.evlrs.insert(0, laspy.VLR("copc", 1000, "COPC hierarchy", entries.tobytes()))
        header.number_of_evlrs = len(header.evlrs)
        file.seek(header.start_of_first_evlr)
        header.evlrs.write_to(file, as_extended=True)
        place, times = header.start_of_first_evlr + 60, records["gps_time"]
        values = (
            *(header.mins + side / 2),
            side / 2,
            side / 2**GRID_BITS,
            place,
            entries.nbytes,
            times.min(),
            times.max(),
        )
        info.record_data = struct.pack("<5d2Q2d88x", *values)
        file.seek(0)
        header.write_to(file, ensure_same_size=True)


def cells_of(records: NDArray[np.void], header: laspy.LasHeader, side: float) -> NDArray[np.uint32]:
    """Columns, rows and layers (3, N) of points in the finest cells of a cube that begins where they do."""
    grid = np.empty((3, len(records)), np.uint32)
    for axis, name in enumerate("XYZ"):
        cell = records[name] * header.scales[axis] + (header.offsets[axis] - header.mins[axis])
        cell *= 2**LEVELS / side
        np.clip(cell, 0, 2**LEVELS - 1, out=grid[axis], casting="unsafe")
    return grid


def interleave(grid: NDArray[np.uint32]) -> Cells:
    """The numbers of cells on the Z-order curve (N,), from columns, rows and layers (3, N) below 2^21."""
    code = np.zeros(grid.shape[1], np.uint64)
    for axis, values in enumerate(grid):
        spread = values.astype(np.uint64)
        for shift, mask in SPREAD:
            spread = (spread | spread << np.uint64(shift)) & np.uint64(mask)
        code |= spread << np.uint64(axis)
    return code


SPREAD = (
    (32, 0x1F00000000FFFF),
    (16, 0x1F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)
"""Shifts and masks that put two empty bits between those of a number of 21 bits."""


def find_nodes(code: Cells) -> Cells:
    """The node of each point (N,): a one and behind it the first bits of its cell, three for each level.

    From the root on, a cube of at most `NODE_POINTS` points that no coarser node has taken keeps them all; of
    a larger one the point in the middle of the curve's run through each cell of the grid stays.
    """
    order = np.argsort(code, kind="stable")
    code, node = code[order], np.empty(len(order), np.uint64)
    level = 0
    while len(order):
        first, counts = runs(code >> np.uint64(3 * max(LEVELS - level - GRID_BITS, 0)))
        middle = first + counts // 2
        cube = code >> np.uint64(3 * (LEVELS - level))
        first, counts = runs(cube)
        stays = np.repeat((counts <= NODE_POINTS) | (level == LEVELS), counts)
        stays[middle] = True
        node[order[stays]] = cube[stays] | np.uint64(1 << 3 * level)
        order, code, level = order[~stays], code[~stays], level + 1
    return node


def runs(values: Cells) -> tuple[Integers, Integers]:
    """First places and lengths of the runs of equal values."""
    first = np.flatnonzero(np.concatenate([[True], values[1:] != values[:-1]]))
    return first, np.diff(first, append=len(values))


FORMAT = Format({"points": (".copc.laz", write_copc)}, point_bytes=60)
