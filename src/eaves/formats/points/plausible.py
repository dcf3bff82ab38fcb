"""Plausibility of coordinates whose unit nobody states as metres: extent, flight speed, echoes of a pulse."""

from __future__ import annotations

import numpy as np
import pyproj
from numpy.typing import NDArray
from pyproj.database import query_crs_info
from pyproj.enums import PJType
from pyproj.exceptions import ProjError

from eaves.formats.points.las import iter_records, returns_and_class
from eaves.formats.points.las_header import LasHeader
from eaves.model import Points, Values

FASTEST = 120.0
"""No survey is flown so fast (m/s): aeroplanes scan at 45 to 85, helicopters and drones slower. Feet a second
are 150 to 280 for an aeroplane."""
BLIND = 6.0
"""No scanner is blind for so long (m) behind a return: modern ones for 0.4 to 1, those of 2000 for 4."""
FOOT = 0.3048
"""Metres; what is too much in feet, too, says nothing."""
LOOKED_AT = 300_000
"""Points that are looked at."""
PASS_GAP = 1.0
"""Seconds without a point between two passes."""
FEWEST = 100
"""Points of a pass, and pairs of returns, that are evidence."""
LINEAR = 0.9
"""Share of the variance of time that the place explains along one straight pass."""
TIME_AT = {1: 20, 3: 20, 4: 20, 5: 20, 6: 22, 7: 22, 8: 22, 9: 22, 10: 22}
"""Byte of the GPS time in a record by point format (LAS 1.4, section 2.6)."""
OBLIQUE_DEG, DROP = 5.0, 2.0
"""Angle of a pulse, which many files keep in whole degrees, and distance (m) of two of its echoes in height
from which they lie clearly beside each other."""
STRETCHED = FOOT**-0.5
"""Times that echoes may lie as far apart in height as the angle of their pulse lets them: half-way, as a
factor, between 1 of heights in metres, which they do not exceed, and 3.28 of heights in feet."""
DEGREE_EXTENT, DEGREE_RELIEF, DEGREE_SCALE = 0.5, 20.0, 1e-6
"""Data without a system are in degrees when they fit ±180 and ±90, span less than 0.5 and are either 20 times
higher than wide (a tile of 0.01° has metres of relief) or stored in steps under 1e-6 (0.1 m in degrees)."""
Corner = tuple[float, float, float]
"""A corner of the box of the points, as they are stored."""


def are_degrees(low: Corner, high: Corner, step: float) -> bool:
    """True if the coordinates of a file that names no system are evidently degrees.

    Parameters
    ----------
    low, high : tuple of float
        Corners of the points' box, in the units of the file.
    step : float
        Step in which the file stores coordinates in plan; 1 where it stores decimals.

    Returns
    -------
    bool
        False where nothing decides.
    """
    width, relief = max(high[0] - low[0], high[1] - low[1]), high[2] - low[2]
    fits = max(abs(low[0]), abs(high[0])) <= 180 and max(abs(low[1]), abs(high[1])) <= 90
    return fits and 0 < width < DEGREE_EXTENT and (relief > DEGREE_RELIEF * width or step < DEGREE_SCALE)


def why_not_metres(header: LasHeader) -> str | None:
    """The reason why the coordinates of a file cannot be metres, in words; None where nothing says so.

    Nothing is concluded from what stands on the ground, for towers are as wide in metres as houses in feet:
    only the flight and the scanner count, which are alike everywhere. Along a straight pass time is a plane
    over the place, whose slope is one over the speed.

    Parameters
    ----------
    header : LasHeader
        The file; about its first 300,000 points are read.

    Returns
    -------
    str or None
        What was measured, and what it would be in metres.
    """
    _, records = next(iter_records(header, LOOKED_AT), (None, None))
    if records is None:
        return None
    stored = np.ascontiguousarray(records[:, :12]).view("<i4")
    xyz = stored * np.array(header.scales)
    if header.point_format in TIME_AT:
        start = TIME_AT[header.point_format]
        speed = flying_speed(xyz, np.ascontiguousarray(records[:, start : start + 8]).view("<f8")[:, 0])
        if speed is not None and FASTEST < speed <= FASTEST / FOOT:
            return f"were scanned at {speed:.0f} units a second, faster in metres than any survey is flown"
    gap = return_gap(xyz, *returns_and_class(header.point_format, records)[:2])
    if gap is not None and BLIND < gap <= BLIND / FOOT:
        return (
            f"have returns of one pulse no nearer than {gap:.1f} units, farther in metres than any scanner's"
        )
    return None


def flying_speed(xyz: Points, time: Values) -> float | None:
    """The median speed (units of length a second) of the straight passes over points (N, 3); None of none.

    Parameters
    ----------
    xyz : ndarray (N, 3)
        Places.
    time : ndarray (N,)
        GPS time (s).

    Returns
    -------
    float or None
        The speed.
    """
    known = np.flatnonzero(np.isfinite(time))
    order = known[np.argsort(time[known], kind="stable")]
    speeds = []
    for points in np.split(order, np.flatnonzero(np.diff(time[order]) > PASS_GAP) + 1):
        if len(points) < FEWEST:
            continue
        place = xyz[points, :2] - xyz[points, :2].mean(axis=0)
        seconds = time[points] - time[points].mean()
        slope = np.linalg.lstsq(place, seconds, rcond=None)[0]
        left, steep = seconds - place @ slope, float(np.hypot(*slope))
        if steep > 0 and left @ left <= (1 - LINEAR) * (seconds @ seconds):
            speeds.append(1 / steep)
    return float(np.median(speeds)) if speeds else None


def return_gap(xyz: Points, number: NDArray[np.integer], of: NDArray[np.integer]) -> float | None:
    """The distance (units of length) that all but 2 % of the neighbouring returns of a pulse keep.

    Parameters
    ----------
    xyz : ndarray (N, 3)
        Points in the order of the file.
    number, of : ndarray (N,)
        Number of the return, and of returns of its pulse.

    Returns
    -------
    float or None
        The distance; None where the file does not keep the returns of a pulse together.
    """
    step = np.abs(np.diff(number.astype(np.int64)))
    way = np.diff(xyz, axis=0)
    steep = np.hypot(way[:, 0], way[:, 1]) < np.abs(way[:, 2])
    pairs = (step == 1) & (of[1:] == of[:-1]) & (of[1:] > 1) & steep
    return float(np.percentile(np.linalg.norm(way[pairs], axis=1), 2)) if pairs.sum() >= FEWEST else None


def height_ratios(
    xyz: Points, time: Values, angle: Values, number: NDArray[np.integer], of: NDArray[np.integer]
) -> Values:
    """How many times as far apart in height the echoes of pulses lie as the pulses' angles let them.

    An echo lies beside the one before it by its depth times the tangent of the pulse's angle, and by more
    where the scanner looks ahead: the ratio is 1 or less, for any land and all that stands on it, unless
    heights are in another unit than the plane.

    Parameters
    ----------
    xyz : ndarray (N, 3)
        Points of pulses of several returns (m, as their units are taken).
    time, angle : ndarray (N,)
        GPS time (s) and angle of the pulse (degrees off the nadir).
    number, of : ndarray (N,)
        Number of the return, and of returns of its pulse.

    Returns
    -------
    ndarray (K,)
        The ratio of each pair of echoes of a slanting pulse.
    """
    slant = np.flatnonzero(np.abs(angle) > OBLIQUE_DEG)
    order = slant[np.lexsort((number[slant], time[slant]))]
    first, second = order[:-1], order[1:]
    pairs = (time[first] == time[second]) & (of[first] == of[second]) & (number[first] + 1 == number[second])
    way = xyz[first[pairs]] - xyz[second[pairs]]
    aside, tangent = np.hypot(way[:, 0], way[:, 1]), np.tan(np.radians(np.abs(angle[first[pairs]])))
    clear = (way[:, 2] > DROP) & (aside > 0)
    return np.asarray((way[:, 2] * tangent)[clear] / aside[clear])


def likely_systems(x: float, y: float) -> list[str]:
    """Up to three registered zones in feet in whose area the place lies, that nearest its middle first.

    Parameters
    ----------
    x, y : float
        The middle of the data, in its own units.

    Returns
    -------
    list of str
        `EPSG:2994 (NAD83(HARN) / Oregon GIC Lambert (ft))`.
    """
    found: dict[str, tuple[float, str]] = {}
    for info in query_crs_info("EPSG", PJType.PROJECTED_CRS):
        area = info.area_of_use
        if "(ft" not in info.name or area is None:
            continue
        crs = pyproj.CRS.from_epsg(int(info.code))
        try:
            way = pyproj.Transformer.from_crs(crs, crs.geodetic_crs, always_xy=True)
        except ProjError:
            continue
        longitude, latitude = way.transform(x, y)
        east, north = (area.west + area.east) / 2, (area.south + area.north) / 2
        off = np.array(
            [(longitude - east) / (area.east - area.west), (latitude - north) / (area.north - area.south)]
        )
        if (np.abs(off) <= 0.5).all():
            zone = info.name.split(" / ")[-1]  # the same for each datum
            found.setdefault(zone, (float(np.hypot(*off)), f"EPSG:{info.code} ({info.name})"))
    return [name for _, name in sorted(found.values())[:3]]
