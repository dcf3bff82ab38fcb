"""A share of a run's classified points, read piece by piece: what the page and the pictures draw."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import laspy
import lazrs
import numpy as np
from numpy.typing import NDArray

from eaves.formats import InputError, open_source
from eaves.formats.inputs import is_classified
from eaves.formats.points.las import NEEDED, returns_and_class
from eaves.formats.points.las_header import LasHeader
from eaves.formats.points.laz import decompress, read_chunk_table
from eaves.formats.points.source import CHUNK_POINTS, has_coordinates
from eaves.model import Bounds, CoordinateSystem, Integers, Mask, Points, Values

POINTS_READ = 12_000_000
"""Of more points than this only evenly spread pieces of the files are decompressed: some 6 s of work."""
BUILDING_SHARE = 0.7
"""Of the points drawn, the share that buildings may take before their points are thinned."""
SELECTION = NEEDED | lazrs.SELECTIVE_DECOMPRESS_ALL_EXTRA_BYTES
ARRAYS = ("xyz", "classification", "building", "plane", "part")
"""Of a sample."""
EXTRA: dict[str, Any] = {"building_id": np.int32, "plane_id": np.int32, "part": np.uint8}
"""Dimensions a run adds to its points; zero where a file has none."""


@dataclass(frozen=True, eq=False)
class Sample:
    """N of a run's points, in the files' order; arrays are (N,), `xyz` (N, 3) in world metres.

    `building` is the building's number, `plane` the roof plane's; 0 for none. `total` counts the points of
    the files, `on_buildings` those of buildings among them (about, where not all were read).
    """

    xyz: Points
    classification: NDArray[np.uint8]
    building: NDArray[np.int32]
    plane: NDArray[np.int32]
    part: NDArray[np.uint8]
    total: int = field(kw_only=True)
    on_buildings: int = field(default=0, kw_only=True)

    @classmethod
    def empty(cls) -> Sample:
        """No points."""
        nothing = (np.zeros(0, dtype) for dtype in (np.uint8, *EXTRA.values()))
        return cls(np.zeros((0, 3)), *nothing, total=0)

    def __len__(self) -> int:
        return len(self.xyz)

    def with_(self, **changes: Any) -> Sample:
        """A copy with some fields replaced."""
        return replace(self, **changes)

    def take(self, which: Mask | Integers) -> Sample:
        """The points where a mask (N,) is true, or of these numbers."""
        return self.with_(**{name: getattr(self, name)[which] for name in ARRAYS})


@dataclass(frozen=True)
class Thinning:
    """Of every n-th piece of the files, the shares of the points of buildings and of the others to take."""

    every: int
    on_roofs: float
    others: float

    @classmethod
    def of(cls, candidates: int, limit: int | None, expected: int) -> Thinning:
        """The thinning that leaves about `limit` of so many points, those on buildings expected."""
        if limit is None:
            return cls(1, 1.0, 1.0)
        every = max(1, -(-candidates // POINTS_READ))
        if candidates <= limit:
            return cls(every, 1.0, 1.0)
        on_roofs = max(min(expected, candidates), 1)
        share = min(1.0, max(BUILDING_SHARE * limit / on_roofs, limit / candidates))
        return cls(every, share, max(0.0, limit - share * on_roofs) / max(candidates - on_roofs, 1))

    def keeps(self, position: Integers, building: NDArray[np.int32]) -> Mask:
        """Mask (N,) of the points to take, by their places in their file and their buildings' numbers."""
        share = np.where(building > 0, self.on_roofs, self.others)
        return np.asarray(scattered(position) < self.every * share)


class PointSample:
    """Takes the sample of all points while a run writes them, so that they need not be decompressed again.

    Parameters
    ----------
    limit
        As in `sample_points`.
    buildings
        Of a run with more buildings than these nothing is taken: not all points will be asked for.
    """

    def __init__(self, limit: int, buildings: int) -> None:
        self._limit, self._buildings = limit, buildings
        self._thinning: Thinning | None = None
        self._kept: dict[Path, list[NDArray[np.void]]] = {}
        self._counts: dict[Path, int] = {}
        self.on_buildings = 0

    def start(self, points: int, buildings: int, on_buildings: int) -> None:
        """Settle what is taken: of so many points, some on buildings."""
        thinning = Thinning.of(points, self._limit, on_buildings)
        if buildings <= self._buildings and thinning.every == 1:
            self._thinning = thinning

    def write(self, path: Path, first: int, records: NDArray[np.void]) -> None:
        """Take some of the records of a file, of which so many came before."""
        if self._thinning is None:
            return
        number = _extra(records, "building_id")
        keep = self._thinning.keeps(np.arange(first, first + len(records)), number)
        self._kept.setdefault(path, []).append(records[keep])
        self._counts[path] = self._counts.get(path, 0) + len(records)
        self.on_buildings += int(np.count_nonzero(number))

    def take_from(self, other: PointSample) -> None:
        """Become another."""
        self.__dict__.update(other.__dict__)

    def pieces(self, layouts: Sequence[LasHeader], thinning: Thinning) -> list[list[NDArray[np.void]]] | None:
        """The records taken of each file; None when these are other files, or not thinned so."""
        counts = {layout.path: layout.count for layout in layouts if layout.count}
        if self._thinning != thinning or self._counts != counts:
            return None
        return [self._kept.get(layout.path, []) for layout in layouts]


def classified_files(folder: Path) -> list[Path]:
    """The classified points of a run, in the order of their names."""
    return sorted(path for path in folder.glob("classified*.laz") if is_classified(path.name))


def sample_points(
    files: Sequence[Path],
    system: CoordinateSystem,
    limit: int | None = None,
    bounds: Bounds | None = None,
    building: int | None = None,
    expected: int = 0,
    received: PointSample | None = None,
) -> Sample:
    """About `limit` points of the files (all for None), spread evenly; what is taken follows from a point's
    position in its file alone.

    Parameters
    ----------
    files
        Classified LAZ files of one run.
    system
        The run's, whose units the files are in; a file without a system of its own does not name it.
    bounds
        World metres; only points inside are taken.
    building
        Only the points of the building of this number are taken.
    expected
        Number of points of the buildings, as far as known: they are thinned less than the others.
    received
        What was taken when the files were written; where it is the same, the files are not read again.
    """
    layouts = [_las_layout(path) for path in files]
    total = sum(layout.count for layout in layouts)
    crossing = [layout for layout in layouts if bounds is None or _crosses(layout, bounds, system)]
    candidates = sum(layout.count for layout in crossing)
    thinning = Thinning.of(candidates, limit, expected)
    pieces = [Sample.empty()]
    on_buildings = 0
    unfiltered = bounds is None and building is None
    batches = received.pieces(crossing, thinning) if received is not None and unfiltered else None
    if received is not None and batches is not None:
        on_buildings, crossing = received.on_buildings, []
        for layout, batch in zip(layouts, batches, strict=True):
            pieces += [_decoded(records, layout, system, bounds) for records in batch]
    for layout in crossing:
        for position, records in _records(layout, thinning.every):
            number = _extra(records, "building_id")
            on_buildings += thinning.every * int(np.count_nonzero(number))
            keep = thinning.keeps(position, number)
            if building is not None:
                keep &= number == building
            pieces.append(_decoded(records[keep], layout, system, bounds))
    joined = {name: np.concatenate([getattr(piece, name) for piece in pieces]) for name in ARRAYS}
    return Sample(**joined, total=total, on_buildings=on_buildings)


def _las_layout(path: Path) -> LasHeader:
    layout = open_source(path).layout
    if not isinstance(layout, LasHeader):
        raise InputError.about(path, "is no LAZ file", "give the folder of a run of eaves build")
    return layout


def _crosses(layout: LasHeader, bounds: Bounds, system: CoordinateSystem) -> bool:
    west, south, _ = np.array(layout.lowest) * system.unit_m
    east, north, _ = np.array(layout.highest) * system.unit_m
    return bool(west < bounds.east and east >= bounds.west and south < bounds.north and north >= bounds.south)


def _records(layout: LasHeader, every: int) -> Iterator[tuple[Integers, NDArray[np.void]]]:
    """Positions and point records of every n-th compressed chunk."""
    if not layout.count:
        return
    with layout.path.open("rb") as file:
        record = laspy.LasHeader.read_from(file).point_format.dtype()
        table = read_chunk_table(file, layout)
        which = np.arange(0, len(table.points), every)
        for position, data in decompress(file, layout, table, which, SELECTION, CHUNK_POINTS):
            yield position, data.reshape(-1).view(record)


def _extra(records: NDArray[np.void], name: str) -> NDArray[Any]:
    present = name in (records.dtype.names or ())
    return np.asarray(records[name], EXTRA[name]) if present else np.zeros(len(records), EXTRA[name])


def scattered(position: Integers) -> Values:
    """A number in 0 to 1 for every position (N,), without a pattern that could beat with scan lines
    (splitmix64)."""
    mixed = position.astype(np.uint64) + np.uint64(0x9E3779B97F4A7C15)
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        mixed = (mixed ^ (mixed >> np.uint64(shift))) * np.uint64(factor)
    return np.asarray((mixed >> np.uint64(11)).astype(np.float64) / 2.0**53)


def _decoded(
    records: NDArray[np.void], layout: LasHeader, system: CoordinateSystem, bounds: Bounds | None
) -> Sample:
    """The points inside `bounds` in world metres, without those that are withheld or have no coordinates."""
    xyz = np.stack([records[axis] for axis in "XYZ"], axis=1) * np.array(layout.scales)
    xyz += np.array(layout.offsets)
    _, _, classes, withheld = returns_and_class(
        layout.point_format, records.view(np.uint8).reshape(len(records), records.itemsize)
    )
    extra = (_extra(records, name) for name in EXTRA)
    usable = has_coordinates(xyz) & ~withheld
    xyz = xyz * system.unit_m
    if bounds is not None:
        usable &= bounds.contains(xyz)
    return Sample(xyz, classes, *extra, total=0).take(usable)
