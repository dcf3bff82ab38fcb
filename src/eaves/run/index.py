"""The headers of all inputs, in some 150 bytes a file: a country is a million of them."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from eaves.formats import InputError, Source, open_source
from eaves.formats.crs import agree
from eaves.formats.crs_check import refuse_conflict, refuse_numbers
from eaves.formats.points.las import iter_records
from eaves.formats.points.las_header import LasHeader
from eaves.formats.points.plausible import likely_systems, why_not_metres
from eaves.formats.points.source import FIELDS, is_simulated, warn_without_system
from eaves.formats.statements import Stated, describe_reference
from eaves.formats.transformation import AS_STORED
from eaves.model import LOCAL_METRES, Bounds, CoordinateSystem, Mask

log = logging.getLogger("eaves")

ENTRY = np.dtype(
    [("count", "<i8"), ("box", "<f8", 4), ("fields", "u1"), ("mark", "u1", 16), ("path_end", "<i8")]
)
"""Records, west-south-east-north (world metres), bits of `FIELDS`, fingerprint, end of the path's bytes."""
RECORD_BYTES = 1 << 26
"""Bytes of records that are kept in memory from a look at the scan until its points are read."""
LISTED_INPUTS = 1000
"""Maximum number of inputs named one by one in run.json; of more, their number and common hash are."""


@dataclass(frozen=True, eq=False)
class Index:
    """The inputs of a run, in their order; arrays are (F,)."""

    entries: NDArray[np.void]
    paths: bytes
    """All paths in UTF-8, one behind the other."""
    system: CoordinateSystem
    crs: str | None
    to_crs: str
    """The system to which points are transformed as they are read, or `none`."""
    kept: dict[int, Source]
    """Those that had to be read to be opened (text, wrong_boxes headers), by number."""

    def __len__(self) -> int:
        return len(self.entries)

    @property
    def starts(self) -> NDArray[np.int64]:
        """The id of each file's first point."""
        return np.asarray(np.cumsum(self.entries["count"]) - self.entries["count"])

    @property
    def points(self) -> int:
        """Records in all files."""
        return int(self.entries["count"].sum())

    def count(self, number: int) -> int:
        """Records in one file."""
        return int(self.entries["count"][number])

    def has_field(self, name: str) -> bool:
        """True if any file carries a field of `FIELDS`."""
        return bool((self.entries["fields"] >> FIELDS.index(name) & 1).any())

    def path(self, number: int) -> Path:
        """The path of one file."""
        start = int(self.entries["path_end"][number - 1]) if number else 0
        text = self.paths[start : int(self.entries["path_end"][number])]
        return Path(text.decode("utf-8", "surrogateescape"))

    def mark(self, number: int) -> bytes:
        """The fingerprint that one file had when it was indexed."""
        return bytes(self.entries["mark"][number].tobytes())

    def source(self, number: int) -> Source:
        """One file, opened again.

        Raises
        ------
        InputError
            When it cannot be, or is no longer what the index knows.
        """
        count = self.count(number)
        return self.kept.get(number) or open_unchanged(self.path(number), self.crs, count, self.to_crs)

    def bounds(self, number: int) -> Bounds:
        """The place of one file's points by its header."""
        return Bounds(*map(float, self.entries["box"][number]))

    @cached_property
    def extent(self) -> Bounds:
        """The place of all points by the headers."""
        boxes = self.entries["box"][self.entries["count"] > 0]
        if not len(boxes):
            return self.bounds(0)
        return Bounds(*boxes[:, :2].min(axis=0).tolist(), *boxes[:, 2:].max(axis=0).tolist())

    @cached_property
    def own(self) -> Stated:
        """What the first file states of its system."""
        return self.source(0).own

    @cached_property
    def reference(self) -> dict[str, str]:
        """The system of the results and the units of the first file, with who states them."""
        return describe_reference(self.own, self.system)

    def area_of_stored(self, bounds: Bounds) -> BaseGeometry | None:
        """The area (world metres) of bounds in the system that files are transformed from; None where they
        are not, or no file meets it."""
        way = self.source(0).transformation if self.to_crs != AS_STORED else None
        if way is None:
            return None
        area = way.area(bounds)
        known = not area.is_empty and np.isfinite(area.bounds).all()
        return area if known and self.meeting(Bounds(*area.bounds)).any() else None

    def spans_blocks(self, side: float, bounds: Bounds | None = None) -> bool:
        """True if the headers say that points, within the bounds, lie in several blocks of `side` (m)."""
        west, south, east, north = self.entries["box"].T
        low, high = np.array([west.min(), south.min()]), np.array([east.max(), north.max()])
        if bounds is not None:  # which hold no point of their east and north sides
            low = np.maximum(low, [bounds.west, bounds.south])
            high = np.minimum(high, np.nextafter([bounds.east, bounds.north], -np.inf))
        return bool((np.floor(low / side) != np.floor(high / side)).any())

    def meeting(self, bounds: Bounds) -> Mask:
        """Mask (F,) of the files that say that they have points within `bounds`."""
        order, sorted_west, widest = self._by_west
        first, last = np.searchsorted(sorted_west, [bounds.west - widest, bounds.east])
        candidates = order[
            first:last
        ]  # a country's files are asked for tile by tile: look at a strip of them
        west, south, east, north = self.entries["box"][candidates].T
        meets = (west < bounds.east) & (east >= bounds.west)
        mask = np.zeros(len(self), bool)
        mask[candidates] = meets & (south < bounds.north) & (north >= bounds.south)
        return mask

    @cached_property
    def _by_west(self) -> tuple[NDArray[np.int64], NDArray[np.float64], float]:
        """The files' numbers (F,) by western border, these borders, and more than the width of the widest."""
        west, _, east, _ = self.entries["box"].T
        order = np.argsort(west, kind="stable")
        return order, west[order], float((east - west).max(initial=0.0)) + 1.0

    def subset(self, numbers: NDArray[np.int64]) -> Index:
        """The index of some files (rising numbers)."""
        entries, names = self.entries[numbers].copy(), bytearray()
        for k, number in enumerate(numbers):
            names += str(self.path(int(number))).encode("utf-8", "surrogateescape")
            entries["path_end"][k] = len(names)
        sources = {k: self.kept[int(n)] for k, n in enumerate(numbers) if int(n) in self.kept}
        return replace(self, entries=entries, paths=bytes(names), kept=sources)

    def with_boxes(self, boxes: Mapping[int, Bounds]) -> Index:
        """The index with the boxes of some files, by number, widened to hold others."""
        entries = self.entries.copy()
        for number, box in boxes.items():
            bounds = self.bounds(number).union(box)
            entries["box"][number] = bounds.west, bounds.south, bounds.east, bounds.north
        return replace(self, entries=entries)

    def with_records(self) -> Index:
        """The index with the records of compressed files, decompressed once for all that reads them, where
        they take little memory. Files that are damaged are left to the run."""
        kept, room = dict(self.kept), RECORD_BYTES
        for number in range(len(self)):
            with suppress(InputError):
                header = (source := self.source(number)).layout
                size = header.count * header.record_length if isinstance(header, LasHeader) else 0
                if isinstance(header, LasHeader) and header.compressed and 0 < size <= room:
                    room -= size
                    ((_, records),) = iter_records(header, header.count)  # all in one piece
                    kept[number] = replace(source, layout=replace(header, decompressed=records))
        return replace(self, kept=kept)

    def without_records(self) -> Index:
        """The index without the records of compressed files."""
        bare = {
            number: replace(source, layout=replace(source.layout, decompressed=None))
            for number, source in self.kept.items()
            if isinstance(source.layout, LasHeader) and source.layout.decompressed is not None
        }
        return replace(self, kept={**self.kept, **bare})

    def describe(self) -> dict[str, Any]:
        """The inputs as JSON: how many, and their common hash; each with its own where they are few."""
        digest = hashlib.sha256(self.entries.tobytes() + self.paths)
        facts: dict[str, Any] = {"files": len(self), "inputs_sha256": digest.hexdigest()}
        if len(self) <= LISTED_INPUTS:
            facts["inputs"] = [
                {
                    "path": str(self.path(number)),
                    "points": int(self.entries["count"][number]),
                    "fingerprint": self.entries["mark"][number].tobytes().hex(),
                }
                for number in range(len(self))
            ]
        return facts


def index_inputs(
    paths: Sequence[str | Path],
    crs: str | None,
    failed: list[str],
    tell: Callable[[int, int], None] = lambda done, total: None,
    crs_force: bool = False,
    to_crs: str | None = None,
    remarks: list[str] | None = None,
) -> Index:
    """The index of all files that can be opened; why others cannot is noted in `failed`. The first decides to
    which system all are transformed, unless `to_crs` does. What is to be said of systems comes to `remarks`.

    Raises
    ------
    InputError
        When none can be opened, or units or systems differ, or `crs` is not what a file says or its numbers
        cannot be what its system says and there is no `crs_force`.
    """
    entries, names, sources = np.zeros(len(paths), ENTRY), bytearray(), dict[int, Source]()
    systems: dict[CoordinateSystem, Path] = {}
    number, told = 0, list[str]()
    for path, source in open_all(paths, crs, to_crs, failed, crs_force):
        if not number:
            to_crs, told = source.target if to_crs is None else to_crs, source.remarks
        names += str(path).encode("utf-8", "surrogateescape")
        bits = sum(1 << bit for bit, name in enumerate(FIELDS) if name in source.fields)
        mark = np.frombuffer(source.mark, np.uint8)
        entries[number] = source.count, list(source.bounds), bits, mark, len(names)
        if source.measured:
            sources[number] = source
        systems.setdefault(source.system, Path(path))
        number += 1
        if number % 1000 == 0:
            tell(number, len(paths))
    if not number:
        raise InputError(failed[0])
    system = agree((path, system) for system, path in systems.items())
    index = Index(entries[:number].copy(), bytes(names), system, crs, to_crs or AS_STORED, sources)
    if remarks is not None:
        remarks += told
    if system == LOCAL_METRES and crs is None and not crs_force:
        refuse_feet(index)
    warn_without_system(system, index.path(0), number)
    wrong_boxes = [source.path for source in sources.values() if source.has_wrong_bbox]
    if wrong_boxes:
        log.warning(
            "%d files state a bounding box that is not that of their points (the first: %s); the points were "
            "read to find it",
            len(wrong_boxes),
            wrong_boxes[0],
        )
    return index


def open_all(
    paths: Sequence[str | Path], crs: str | None, to_crs: str | None, failed: list[str], crs_force: bool
) -> Iterator[tuple[str | Path, Source]]:
    """The files that can be opened, the first of which decides to which system all are transformed, unless
    `to_crs` does; why others cannot is noted in `failed`.

    Raises
    ------
    InputError
        When the only one cannot, or `crs` is not what a file says (`refuse_system`).
    """
    for path in paths:
        try:
            source = open_counted(path, crs, to_crs)
        except InputError as error:
            if len(paths) == 1:
                raise
            failed.append(str(error))
            log.error("%s", error)
            continue
        if not crs_force:
            refuse_system(source, crs)
        to_crs = source.target if to_crs is None else to_crs
        yield path, source


def open_unchanged(path: Path, crs: str | None, count: int, to_crs: str | None = None) -> Source:
    """A file with the number of records that the index knows.

    Raises
    ------
    InputError
        When it cannot be opened, or has another.
    """
    source = open_source(path, crs, to_crs)
    if source.count != count:
        raise InputError.about(path, "changed while the run was reading it", "run again")
    return source


def open_counted(path: str | Path, crs: str | None, to_crs: str | None = None) -> Source:
    """A file; points that its header does not count are used, with a warning."""
    source = open_source(path, crs, to_crs)
    count = source.layout.stated if isinstance(source.layout, LasHeader) else None
    if count is not None:
        log.warning("%s: the header counts %d points, %d are there and used", path, count, source.count)
    return source


def refuse_feet(index: Index) -> None:
    """Check that the coordinates of inputs without a system can be metres; the largest input is looked at.

    Raises
    ------
    InputError
        When they cannot.
    """
    source = index.source(int(index.entries["count"].argmax()))
    if not isinstance(source.layout, LasHeader) or is_simulated(source.path):
        return
    try:
        reason = why_not_metres(source.layout)
    except InputError:  # of a damaged file; reading it will say so
        return
    if reason is None:
        return
    box = source.bounds
    systems = likely_systems((box.west + box.east) / 2, (box.south + box.north) / 2)
    fitting = f" (in feet, the place fits {', '.join(systems)})" if systems else ""
    raise InputError.about(
        source.path,
        f"has no coordinate system, and its points {reason}: they are in feet",
        f"pass their system with --crs{fitting}, or --crs feet or us-feet; --crs metres if they are metres",
    )


def refuse_system(source: Source, crs: str | None) -> None:
    """Check that a file's system, the caller's and its numbers agree.

    Raises
    ------
    InputError
        When they do not.
    """
    if source.count == 0:
        return
    system = source.system
    if source.transformation is not None:
        system = CoordinateSystem(source.transformation.source)
    if crs is not None:
        refuse_conflict(source.path, crs, own_system(source), source.stored)
    refuse_numbers(source.path, system, source.stored)


def own_system(source: Source) -> pyproj.CRS | None:
    """The system that a file states; None where it states none that can be read."""
    if not isinstance(source.layout, LasHeader):
        return None
    try:
        return source.layout.system().whole
    except InputError:
        return None
