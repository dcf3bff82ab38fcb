"""A scan before the run: the figures that a surveyor asks of a delivery, and what may go wrong with them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eaves.blocks.points import ENOUGH_PER_M2
from eaves.figures.rows import BuildingRow
from eaves.formats import InputError
from eaves.formats.crs import name_units
from eaves.formats.points.plausible import STRETCHED
from eaves.formats.points.sample import Sample, read_sample
from eaves.formats.statements import UNSTATED
from eaves.geometry.planes import group_percentiles
from eaves.model import LOCAL_METRES, Points, Values
from eaves.raster.blur import (
    BESIDE,
    WIDTH,
    group_cells,
    measure_blur,
    measure_roughness,
    neighbour_pairs,
    number_squares,
    number_values,
)
from eaves.run.index import Index
from eaves.run.memory import DENSE, LEAST

LOOKED_AT, PIECES = 1_000_000, 20
"""Points of a scan that are looked at; of a larger one so many runs of records, evenly spread."""
CELL = 24.0
"""Side (m) of the cells whose lowest points stand for the ground. No ground falls by more within its cell."""
FLOOR = 5.0
"""Percentile of the heights of a cell that is its floor: noise lies below, and little else."""
AT_ZERO, MOST = 0.3, 0.9
"""Floors within so much (m) of zero, in such a share of the cells, are heights above ground."""
VOID_SPACINGS = 4.0
"""A void is a cell without points whose side is four times the spacing (USGS Lidar Base Specification)."""
STRIP_CELL, FLAT, FEWEST = 2.0, 0.05, 30
"""Strips are compared in cells (m) where the heights of both spread by less (m). A shift, of strips as of
epochs, takes so many differences or more."""
STRIPS_AGREE, SPARSE = 0.08, 2.0
"""The largest difference of strips (m) and the least density (points/m²) of USGS quality level 2."""
PIECE_AREA, PIECES_APART = 2_000.0, 3
"""A scan of so many pieces or more, half of its area in those under this (m²), is clipped."""
START_S, POINT_S, ROOF_POINT_S = 2.0, 4.8e-6, 110e-6
"""Processor time (s) of a run: its processes and report, each point, and what each point on a possible roof
adds, as far as it counts there (`ENOUGH_PER_M2`). Rates of a core of 2026."""
SPREAD = 3.0
"""A run takes a third to three times what is so estimated: of eleven surveys seven took .7 to 1.7 times as
long; row houses and sparse points take longer, crags, which look like roofs, less."""
SMOOTH_M = 0.06
"""Roughness (m) of laser scans is less."""
BLUR_STEP = 0.05
"""The blur is stated in steps of so much (m)."""
PITCHED_DEG, STEEP_DEG = 10.0, 50.0
"""Slopes from which a face is pitched, and from which it is steeper than most roofs are anywhere: in feet
over a plane in metres one of 20° has 50°, and one of 35° has 66°."""
STEEP, HIGH_M = 0.25, 8.0
"""Share of the pitched area that is so steep, and median height (m) of eaves: both at once are feet. Surveys
in metres have shares of 0 to .1 or lower eaves; two of Kentucky, heights left in feet, .28 and .72, 10 m."""
FEWEST_FACES = 3
"""Pitched faces that are evidence."""
NO_RETURNS, SINGLE, LAST, FIRST, SPLIT = "none", "single", "last only", "first only", "all"


@dataclass(frozen=True)
class ScanFacts:
    """The figures of a scan, which `eaves info`, `--dry-run` and run.json state alike. Metres throughout.

    Parameters
    ----------
    files, points, looked_at : int
        Files, records in them, and points that the figures are taken from: all, or runs evenly spread.
    system, units : str or None
        The reference system and its units.
    reference : dict of str to str
        System and units of plane and heights, with who states them.
    density, spacing : float
        Points/m² of the area that has points (of the headers' boxes where not all were read); m.
    returns : str
        `none`, `single`, `last only`, `first only` or `all`.
    split_share : float
        Share of the pulses with several returns.
    intensity, pulses : bool
        True if intensities are stored; if times, angles or numbers of strips are, as scanners write.
    classes : dict of str to int
        Points looked at by their class in the files.
    strips : int
        Numbers of point sources.
    strip_offset : float or None
        Largest median difference of the heights of two strips on flat places (m).
    void_share : float or None
        Share of the area inside the scan without points; None where not all points were read.
    below : int
        Points farther below the floor of their cell of 24 m than its side.
    deepest : float
        The deepest of them (m below the floor).
    at_zero : float
        Share of the cells whose floor is at 0.
    pieces : int
        Parts of the area that do not touch; half the area is in those of at most `piece_m2`.
    roughness : float or None
        Fifth percentile of the RMSE (m) across the planes of squares of 3 m; None for too few points.
    blur : float
        Standard deviation (m) by which walls are smoothed in a scan without pulses; 0 where no house loses by
        it; None where walls are sharp.
    colours : bool
        True if the points have colours.
    height_ratio : float or None
        How many times as far apart in height the echoes of a pulse lie as its angle lets them (median).
    cpu_s, memory_mb : float, int
        Processor time (s) of a build with all outputs; memory (MB) of each process.
    """

    files: int
    points: int
    looked_at: int
    system: str | None
    units: str
    reference: dict[str, str]
    density: float
    spacing: float
    returns: str
    split_share: float
    intensity: bool
    pulses: bool
    classes: dict[str, int]
    strips: int
    strip_offset: float | None
    void_share: float | None
    below: int
    deepest: float
    at_zero: float
    pieces: int | None
    piece_m2: float | None
    height_ratio: float | None
    cpu_s: float
    memory_mb: int
    roughness: float | None
    blur: float | None
    colours: bool

    @property
    def of_images(self) -> bool:
        """True if nothing in the records is of pulses, as of points matched in images."""
        return of_images(self.returns, self.pulses)

    @property
    def rough(self) -> float:
        """Roughness (m) beyond that of laser scans, of a scan that may be of images."""
        return max(0.0, (self.roughness or 0.0) - SMOOTH_M) if self.of_images else 0.0

    @property
    def whole(self) -> bool:
        """True if all points were looked at."""
        return self.looked_at == self.points

    @property
    def likely_feet(self) -> str | None:
        """The line on heights whose unit nobody states, where the echoes of pulses say that it is another one
        than it was taken for."""
        if UNSTATED not in self.reference["heights"] or (self.height_ratio or 0.0) < STRETCHED:
            return None
        return (
            f"heights: nobody states their unit, and they are likely feet: echoes of a pulse lie "
            f"{self.height_ratio:.1f} times as far apart in height as its angle lets them; if they are, pass "
            "a system that says so, as --crs 26918+6360, of the plane and of heights in feet"
        )

    def remarks(self) -> list[str]:
        """Remarks on what the scan cannot show, or what may go wrong: a plain line each."""
        witness = "and colours" if self.colours and self.of_images else "alone"
        shape = f"crowns and roofs are separated by shape {witness}"
        blur = self.blur or 0.0
        wall = WIDTH * blur
        sharpened = (
            f"heights are sharpened for all that follows; houses narrower than {wall:.0f} m lose height or "
            "are lost, and relief may be taken for houses"
            if self.colours
            else "without colours nothing tells houses from relief, and most will be lost; export colours"
        )
        checks = [
            (
                self.of_images,
                "no pulses (no returns, times, angles or strips), as from image matching: ground under trees "
                f"is not seen, and {shape}",
            ),
            (
                blur > 0.0,
                f"walls are smoothed over {wall:.1f} m (standard deviation {blur:.2f} m): {sharpened}",
            ),
            (
                self.rough > 0.0,
                f"flat places are rough by {self.roughness or 0:.2f} m, more than {SMOOTH_M} m: rougher "
                "surfaces are taken for roofs, and so may be crowns",
            ),
            (self.returns == NO_RETURNS and self.pulses, f"no return numbers: {shape}"),
            (self.returns == SINGLE and self.pulses, f"0 % of pulses split: {shape}"),
            (self.returns == LAST, "last returns only: tops of crowns and edges of roofs are missing"),
            (
                self.returns == FIRST,
                "first returns only: ground under trees is missing, and may be taken too high",
            ),
            (
                self.at_zero >= MOST,
                f"the ground is at 0 in {self.at_zero:.0%} of the area: heights above ground, or flat land "
                "at sea level; if the first, heights of the results are no elevations",
            ),
            (
                self.below > 0,
                f"{self.below:,} points more than {CELL:g} m below the ground, down to {self.deepest:.0f} m: "
                "noise, which the ground filter leaves out",
            ),
            (self.likely_feet is not None, str(self.likely_feet)),
            (not self.intensity, "no intensities: roofs that reflect otherwise do not show party walls"),
            (
                self.strips == 1 and self.pulses,
                "one strip: a wall is seen from one side at most, and no overlap shows how heights repeat",
            ),
            (
                (self.strip_offset or 0) > STRIPS_AGREE,
                f"strips differ by {self.strip_offset or 0:.2f} m, more than {STRIPS_AGREE} m (USGS quality "
                "level 2): roofs in their overlap are doubled; adjust the strips first",
            ),
            (
                0 < self.density < SPARSE,
                f"{self.density:.2g} points/m², fewer than {SPARSE:g} (USGS quality level 2): small roofs "
                "and dormers are not resolved",
            ),
            (
                (self.pieces or 0) >= PIECES_APART and (self.piece_m2 or 0) < PIECE_AREA,
                f"{self.pieces} separate pieces, half the area in those below {self.piece_m2 or 0:.0f} m², "
                "as clipped to footprints: without ground beside them, heights of buildings are uncertain",
            ),
        ]
        return [text for said, text in checks if said]

    def as_json(self) -> dict[str, Any]:
        """The figures and the remarks, as JSON."""
        return {**asdict(self), "remarks": self.remarks()}

    def as_text(self) -> str:
        """The figures as a table, then the remarks."""
        extent = "all" if self.whole else f"{self.looked_at:,} in {PIECES} evenly spread runs"
        classes = ", ".join(f"{name}: {count:,}" for name, count in self.classes.items())
        offset = "not measured" if self.strip_offset is None else f"{self.strip_offset:.3f} m at most"
        void = "not measured" if self.void_share is None else f"{self.void_share:.1%} of the area"
        rows = {
            "files": f"{self.files:,}",
            "points": f"{self.points:,}",
            "looked at": extent,
            "system": f"{self.system or 'none'}, {self.units}",
            "plane in": self.reference["plane"],
            "heights in": self.reference["heights"],
            "density": f"{self.density:.2f} points/m²",
            "spacing": f"{self.spacing:.2f} m",
            "returns": self.returns,
            "split pulses": f"{self.split_share:.1%}",
            "roughness": "not measured" if self.roughness is None else f"{self.roughness:.3f} m",
            "walls": f"smoothed by {self.blur:.2f} m" if self.blur else "not smoothed",
            "colours": "yes" if self.colours else "no",
            "intensity": "yes" if self.intensity else "no",
            "classes": classes or "none",
            "strips": f"{self.strips}",
            "strip offsets": offset,
            "voids": void,
            "far below": f"{self.below:,} points",
            "processor time": f"about {self.cpu_s:.0f} s ({self.cpu_s / SPREAD:.0f} to "
            f"{self.cpu_s * SPREAD:.0f} s), shared by the processes",
            "memory": f"{self.memory_mb:,} MB for each process",
        }
        table = [f"{name:<16}{value}" for name, value in rows.items()]
        return "\n".join([*table, *(f"note: {text}" for text in self.remarks())])


def scan_facts(index: Index) -> ScanFacts:
    """The figures of the inputs, from all of their points or from runs of records evenly spread over them.

    Parameters
    ----------
    index : Index
        The inputs.

    Returns
    -------
    ScanFacts
        The figures; they follow from the inputs alone.
    """
    sample = _take_sample(index)
    complete = sample.read == index.points
    west, south, east, north = index.entries["box"][index.entries["count"] > 0].T
    area: float = ((east - west) * (north - south)).sum()
    void = pieces = piece = None
    below, deepest, at_zero, roofs = 0, 0.0, 0.0, 0.0
    returns, rough, blur = _kind_of_returns(sample), None, None
    if len(sample.xyz):
        rough = _rounded(measure_roughness(sample.xyz))
        if of_images(returns, sample.pulses):
            blur = _rounded(measure_blur(sample.xyz), BLUR_STEP)
        cover = _cover(sample.xyz)
        below, deepest, at_zero, roofs = _heights(sample.xyz, cover[0])
        if complete:
            area, void, pieces, piece = cover
    density = index.points / area if area > 0 else 0.0
    counted = min(1.0, ENOUGH_PER_M2 / density) if density else 1.0
    first = sample.number <= 1
    split = float((sample.of[first] > 1).mean()) if first.any() and sample.of.any() else 0.0
    classes, counts = np.unique(sample.classes, return_counts=True)
    return ScanFacts(
        files=len(index),
        points=index.points,
        looked_at=sample.read,
        system=None if index.system == LOCAL_METRES else index.system.code or "unnamed",
        units=name_units(index.system)["geometry"],
        reference=index.reference,
        density=round(density, 3),
        spacing=round(density**-0.5, 3) if density else 0.0,
        returns=returns,
        split_share=round(split, 4),
        intensity=sample.intensity,
        pulses=sample.pulses,
        classes={str(number): int(many) for number, many in zip(classes, counts, strict=True)},
        strips=len(np.unique(sample.strip)),
        strip_offset=_strip_offset(sample),
        void_share=void,
        below=below,
        deepest=deepest,
        at_zero=at_zero,
        pieces=pieces,
        piece_m2=piece,
        height_ratio=round(float(np.median(sample.ratios)), 2) if len(sample.ratios) >= FEWEST else None,
        cpu_s=round(START_S + index.points * (POINT_S + roofs * counted * ROOF_POINT_S), 1),
        memory_mb=round((1.0 + density / DENSE) * LEAST / 2e6),
        roughness=rough,
        blur=blur,
        colours=sample.colours,
    )


def of_images(returns: str, pulses: bool) -> bool:
    """True if records with such returns, with times, angles or strips (`pulses`), may be of images."""
    return returns in (NO_RETURNS, SINGLE) and not pulses


def _rounded(value: float, step: float = 0.001) -> float | None:
    """A value (m) in whole steps; None for NaN."""
    return None if np.isnan(value) else round(round(value / step) * step, 3)


def feet_remark(rows: Iterable[BuildingRow]) -> str | None:
    """The line on heights that are likely in feet, None where nothing speaks for it.

    Parameters
    ----------
    rows : iterable of BuildingRow
        All buildings.

    Returns
    -------
    str or None
        What was measured, in metres as heights were taken, and the remedy.
    """
    faces, eaves = [], []
    for row in rows:
        faces += [(values["slope_deg"], values["projected_m2"]) for _, values in row.faces]
        level, ground = row.values.get("h_eaves"), row.values.get("h_ground")
        if level is not None and ground is not None:
            eaves.append(level - ground)
    slope, area = np.array(faces, float).reshape(-1, 2).T
    pitched = slope > PITCHED_DEG
    if pitched.sum() < FEWEST_FACES or not eaves:
        return None
    share = float(area[slope > STEEP_DEG].sum() / area[pitched].sum())
    high = float(np.median(eaves))
    if share < STEEP or high < HIGH_M:
        return None
    return (
        f"heights: nobody states their unit, they were taken as metres, and are likely feet: {share:.0%} of "
        f"the pitched roofs are steeper than {STEEP_DEG:g}°, eaves are {high:.1f} m high (median); if they "
        "are feet, pass a system that says so, as --crs 26918+6360, of the plane and of heights in feet"
    )


def _kind_of_returns(sample: Sample) -> str:
    """Description of the returns that the scan has of its pulses."""
    if not sample.of.any() or not sample.number.any():
        return NO_RETURNS
    if (sample.of <= 1).all():
        return SINGLE
    several = sample.of > 1
    if (sample.number[several] == sample.of[several]).all():
        return LAST
    return FIRST if (sample.number[several] == 1).all() else SPLIT


def _take_sample(index: Index) -> Sample:
    """The records of all inputs, or of runs evenly spread over them; what is damaged is left to the run."""
    size = LOOKED_AT // PIECES
    everything = index.points <= LOOKED_AT
    places = np.arange(PIECES) * (index.points // PIECES)
    numbers = np.searchsorted(index.starts, places, side="right") - 1
    runs = [(n, (0, 1)) for n in range(len(index))] if everything else []
    for number, place in zip(numbers, places, strict=True) if not everything else ():
        n = max(1, -(-index.count(int(number)) // size))
        k = min(n - 1, (int(place) - int(index.starts[number])) * n // max(index.count(int(number)), 1))
        runs.append((int(number), (k, n)))
    parts: list[Sample] = []
    for number, part in dict.fromkeys(runs):
        try:
            parts += read_sample(index.source(number), part, size)
        except InputError:
            continue
    if not parts:
        none = np.zeros(0, np.uint8)
        nothing = np.zeros((0, 3)), none, none, none, np.zeros(0, np.uint16), np.zeros(0)
        return Sample(*nothing, intensity=False, pulses=False, colours=False, read=0)
    joined = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in ("xyz", "number", "of", "classes", "strip", "ratios")
    }
    return Sample(
        **joined,
        intensity=any(part.intensity for part in parts),
        pulses=any(part.pulses for part in parts),
        colours=any(part.colours for part in parts),
        read=sum(part.read for part in parts),
    )


def _cells(xyz: Points, side: float) -> tuple[NDArray[np.int64], int]:
    """The number of the cell of each point (N,), among those with points, and how many there are."""
    number, count = number_squares(xyz[:, :2] - _limits(xyz)[0], side)
    return number, len(count)


def _limits(xyz: Points) -> tuple[Values, Values]:
    """The south-west and the north-east corner (2,) of the box of points (N, 3)."""
    east, north = xyz[:, 0], xyz[:, 1]
    return np.array([east.min(), north.min()]), np.array([east.max(), north.max()])


def _heights(xyz: Points, area: float) -> tuple[int, float, float, float]:
    """Points far below the floors of their cells, by how much the deepest, the share of floors at 0, and that
    of points on possible roofs: in cells as of voids that see no ground and rise by less than their side."""
    cell, count = _cells(xyz, CELL)
    floor = group_percentiles(xyz[:, 2], cell, count, FLOOR)
    height = xyz[:, 2] - floor[cell]
    side = VOID_SPACINGS * (area / len(xyz)) ** 0.5
    small, many = _cells(xyz, side)
    low, high = np.full(many, np.inf), np.full(many, -np.inf)
    np.minimum.at(low, small, height)
    np.maximum.at(high, small, height)
    roof = (low > STRIP_CELL) & (high - low < side)
    return (
        int((height < -CELL).sum()),
        round(float(max(-height.min(), 0.0)), 1),
        round(float((np.abs(floor) <= AT_ZERO).mean()), 3),
        float(roof[small].mean()),
    )


def _strip_offset(sample: Sample) -> float | None:
    """The largest median difference (m) of two strips, where the single returns of both are flat."""
    single = sample.of <= 1
    xyz, strip = sample.xyz[single], sample.strip[single].astype(np.int64)
    if not len(xyz) or (strip == strip[0]).all():
        return None
    cell, _ = _cells(xyz, STRIP_CELL)
    key, group, many = np.unique(cell << 16 | strip, return_inverse=True, return_counts=True)
    height = xyz[:, 2] - xyz[0, 2]
    mean = np.bincount(group, height) / many
    spread = np.sqrt(np.maximum(np.bincount(group, height**2) / many - mean**2, 0))
    flat = (many >= 3) & (spread <= FLAT)
    key, mean = key[flat], mean[flat]
    beside = np.flatnonzero(key[1:] >> 16 == key[:-1] >> 16)
    pair = (key[beside] & 65535) << 16 | key[beside + 1] & 65535
    _, which, many = np.unique(pair, return_inverse=True, return_counts=True)
    median = group_percentiles(mean[beside + 1] - mean[beside], which.ravel(), len(many), 50.0)
    compared = np.abs(median[many >= FEWEST])
    return round(float(compared.max()), 3) if len(compared) else None


def _without_gaps(place: NDArray[np.int64]) -> NDArray[np.int64]:
    """Cells (N, 2) with one empty column or row in place of all that have no cell between two others: pieces
    and the holes in them are the same, and tiles far apart take no memory for what lies between."""
    columns = []
    for axis in (0, 1):
        used, number, _ = number_values(place[:, axis])
        columns.append(np.cumsum(np.minimum(np.diff(used, prepend=used[:1]), 2))[number])
    return np.column_stack(columns)


def _cover(xyz: Points) -> tuple[float, float, int, float]:
    """The area with points (m²), the share of voids within it, its separate pieces, and the area (m²) that a
    place in them lies in (median over places)."""
    low, high = _limits(xyz)
    # of surveys in pieces the box says nothing of the spacing: the cells that have points do
    area = min(float(np.prod(high - low)), _cells(xyz, CELL)[1] * CELL**2)
    side = max(VOID_SPACINGS * (area / len(xyz)) ** 0.5, 1.0)
    place = _without_gaps(np.floor((xyz[:, :2] - low) / side).astype(np.int64))
    occupied = np.zeros(place.max(axis=0) + 1, bool)
    occupied[place[:, 0], place[:, 1]] = True
    labels, pieces = group_cells(occupied, *neighbour_pairs(occupied))
    sizes = np.sort(np.bincount(labels.ravel())[1:]) * side**2
    empty = np.pad(~occupied, 1, constant_values=True)
    outside, _ = group_cells(empty, *neighbour_pairs(empty, BESIDE))
    filled = empty.size - int((outside == 1).sum())  # what the group of the first cell, a corner, leaves
    middle = float(sizes[np.searchsorted(np.cumsum(sizes), sizes.sum() / 2)])
    area = float(occupied.sum()) * side**2
    return area, round(1 - float(occupied.sum()) / filled, 4), pieces, middle
