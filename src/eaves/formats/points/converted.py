"""PLY and E57 files, read by the libraries of these formats, and rasters of heights: kept as LAZ, which every
later step reads."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import laspy
import numpy as np

from eaves.formats.errors import INSTALL, InputError
from eaves.formats.inputs import is_raster
from eaves.formats.whole_files import atomic

REMARKS = ".remarks.json"
"""Suffix of the file beside a converted raster that holds what is to be said of it."""
STEP = 0.001
"""Resolution of the coordinates (units of the file)."""
NAMES = {
    "intensity": ("intensity", "scalar_intensity"),
    "classification": ("classification", "scalar_classification", "class", "label"),
    "return_number": ("return_number", "returnnumber", "scalar_return_number", "return_index"),
    "number_of_returns": ("number_of_returns", "numberofreturns", "scalar_number_of_returns", "return_count"),
}
"""Fields by the names that writers give them, in lower case."""

Columns = Mapping[str, np.ndarray]


def read_ply(path: Path) -> Columns:
    """The columns of the vertices."""
    from plyfile import PlyData

    vertices = PlyData.read(path)["vertex"].data
    return {name.lower(): np.asarray(vertices[name]) for name in vertices.dtype.names}


def read_e57(path: Path) -> Columns:
    """The columns of all scans, in the coordinates of the file."""
    from pye57 import E57

    with E57(str(path)) as file:
        scans = [
            file.read_scan(k, intensity=True, ignore_missing_fields=True) for k in range(file.scan_count)
        ]
    shared = set.intersection(*(set(scan) for scan in scans)) if scans else set()
    return {
        {"cartesianX": "x", "cartesianY": "y", "cartesianZ": "z"}.get(name, name.lower()): np.concatenate(
            [scan[name] for scan in scans]
        )
        for name in sorted(shared)
    }


READERS: dict[str, tuple[str, Callable[[Path], Columns]]] = {
    ".ply": ("ply", read_ply),
    ".e57": ("e57", read_e57),
}
"""The extra that brings the library, and the reader, by suffix."""


def remarks_on(made: str | Path) -> list[str]:
    """What was to be said of a raster when it was converted into a file; nothing of other files."""
    beside = Path(made).with_suffix(REMARKS)
    if Path(made).suffix != ".laz" or not beside.exists():
        return []
    return [str(remark) for remark in json.loads(beside.read_text(encoding="utf-8"))]


def is_converted(path: str | Path) -> bool:
    """True if a file is kept as LAZ before it is read, by its suffix."""
    return is_raster(path) or Path(path).suffix.lower() in READERS


def convert(path: Path, folder: Path, dtm: Path | None = None) -> Path:
    """The LAZ file, in a folder, of a PLY or E57 file, or of a raster of heights with or without the terrain;
    one that is there is used again.

    Raises
    ------
    InputError
        When the library is missing, or the file is damaged or has no points.
    """
    try:
        read = [path] if dtm is None or not is_raster(path) else [path, dtm]
        facts = [(str(one.resolve()), one.stat().st_size, one.stat().st_mtime_ns) for one in read]
        known = " ".join(f"{place} {size} {changed}" for place, size, changed in facts)
        made = folder / f"{path.stem}-{hashlib.sha256(known.encode()).hexdigest()[:16]}.laz"
        if made.exists():
            return made
    except OSError as error:
        raise InputError.about(
            path, f"cannot be read ({error.strerror or error})", "check the path"
        ) from None
    if is_raster(path):
        from eaves.formats.points.raster_cells import write_cells  # late: GDAL and scipy come with it

        made_here = [place for place in (folder, folder.parent) if not place.exists()]
        folder.mkdir(parents=True, exist_ok=True)
        try:
            with atomic(made) as temporary, atomic(made.with_suffix(REMARKS)) as beside:
                beside.write_text(json.dumps(write_cells(path, temporary, dtm)), encoding="utf-8")
        except InputError:  # nothing is left of what is refused
            with suppress(OSError):
                for place in made_here:
                    place.rmdir()
            raise
        return made
    extra, reader = READERS[path.suffix.lower()]
    try:
        columns = reader(path)
        xyz = np.column_stack([np.asarray(columns[axis], np.float64) for axis in "xyz"])
    except ModuleNotFoundError:
        raise InputError.about(
            path, f"is {extra.upper()}, which an extra reads", INSTALL.format(extra)
        ) from None
    except OSError as error:
        raise InputError.about(
            path, f"cannot be read ({error.strerror or error})", "check the path"
        ) from None
    except Exception as error:  # the libraries raise whatever their parts raise
        raise InputError.about(
            path, f"cannot be read as {extra.upper()} ({error})", "write it again, or as LAS"
        ) from None
    usable = np.isfinite(xyz).all(axis=1)
    if not usable.any():
        raise InputError.about(path, "has no points", "export the points again")
    folder.mkdir(parents=True, exist_ok=True)
    with atomic(made) as temporary, temporary.open("wb") as file:
        as_las(xyz[usable], {name: values[usable] for name, values in columns.items()}).write(
            file, do_compress=True
        )
    return made


def as_las(xyz: np.ndarray, columns: Columns) -> laspy.LasData:
    """The points (N, 3) as LAS 1.4, with the fields of `NAMES` that the columns have."""
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales, header.offsets = np.full(3, STEP), np.floor(xyz.min(axis=0))
    las = laspy.LasData(header)
    las.x, las.y, las.z = xyz.T
    for field, names in NAMES.items():
        found: Any = next((columns[name] for name in names if name in columns), None)
        if found is not None:
            most = {"intensity": 65535, "classification": 255}.get(field, 15)
            las[field] = np.clip(np.nan_to_num(found), 0, most).astype(np.uint16)
    return las
