"""Position of the sun, and the radiation of a clear sky or a weather file.

Angles are degrees; azimuths are clockwise from true north.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from typing import ClassVar

import numpy as np

from eaves.formats import InputError
from eaves.model import Integers, Values

SOLAR_CONSTANT = 1367.0
"""W/m², of [rigollier2000]."""
YEAR = 2023
"""The year whose hours stand for any: a common one, in the middle of the leap cycle."""
HOURS = 8760
MONTHS = 12
LEAST_SINE = 0.01745
"""The circumsolar share is not blown up where the sun is lower than a degree, as in [haydavies1980]."""


@dataclass(frozen=True, eq=False)
class Hours:
    """The hours (H,) of a year with sun: where it stands in the middle of each, and what comes.

    `direct` is the beam normal to the sun, `diffuse` the sky's light on a level plane, `extra` the beam
    outside the atmosphere (W/m²).
    """

    month: Integers
    """From 0."""
    azimuth: Values
    elevation: Values
    direct: Values
    diffuse: Values
    extra: Values

    @property
    def level(self) -> Values:
        """The light on a level plane in the open (W/m²)."""
        return np.asarray(self.direct * np.sin(np.radians(self.elevation)) + self.diffuse)


def sun_position(days: Values, latitude: float, longitude: float) -> tuple[Values, Values, Values]:
    """Azimuth and elevation (N,) of the sun, with refraction, and its distance (astronomical units).

    The Astronomical Almanac's formulas as [michalsky1988] gives them, true to 0.01° from 1950 to 2050.

    Parameters
    ----------
    days : ndarray (N,)
        Days of universal time since noon of 1 January 2000.
    latitude, longitude : float
        The place, degrees, north and east positive.

    Examples
    --------
    >>> import numpy as np
    >>> from eaves.solar.sun import days_since_2000, sun_position
    >>> from datetime import datetime, UTC
    >>> noon = days_since_2000(datetime(2023, 6, 21, 12, tzinfo=UTC))
    >>> azimuth, elevation, _ = sun_position(np.array([noon]), 0.0, 0.0)
    >>> round(float(elevation[0]), 1)
    66.6
    """
    anomaly = np.radians((357.528 + 0.9856003 * days) % 360.0)
    mean = 280.460 + 0.9856474 * days
    ecliptic = np.radians((mean + 1.915 * np.sin(anomaly) + 0.020 * np.sin(2.0 * anomaly)) % 360.0)
    tilt = np.radians(23.439 - 0.0000004 * days)
    ascension = np.arctan2(np.cos(tilt) * np.sin(ecliptic), np.cos(ecliptic))
    declination = np.arcsin(np.sin(tilt) * np.sin(ecliptic))
    hour = (days - np.floor(days)) * 24.0 + 12.0
    sidereal = 6.697375 + 0.0657098242 * days + hour
    angle = np.radians((sidereal * 15.0 + longitude) % 360.0) - ascension
    north = np.radians(latitude)
    sine = np.sin(declination) * np.sin(north) + np.cos(declination) * np.cos(north) * np.cos(angle)
    elevation = np.degrees(np.arcsin(np.clip(sine, -1.0, 1.0)))
    east = -np.cos(declination) * np.sin(angle)
    ahead = np.sin(declination) * np.cos(north) - np.cos(declination) * np.sin(north) * np.cos(angle)
    azimuth = np.degrees(np.arctan2(east, ahead)) % 360.0
    distance = 1.00014 - 0.01671 * np.cos(anomaly) - 0.00014 * np.cos(2.0 * anomaly)
    return azimuth, elevation + refraction(elevation), distance


def refraction(elevation: Values) -> Values:
    """Refraction (degrees): apparent minus true elevation of the sun, [michalsky1988]."""
    high = np.maximum(elevation, -0.56)
    bent = 3.51561 * (0.1594 + 0.0196 * high + 0.00002 * high**2) / (1.0 + 0.505 * high + 0.0845 * high**2)
    return np.asarray(np.where(elevation > -0.56, bent, 0.56))


def days_since_2000(moment: datetime) -> float:
    """Days of universal time since noon of 1 January 2000."""
    return (moment - datetime(2000, 1, 1, 12, tzinfo=UTC)) / timedelta(days=1)


def clear_sky(elevation: Values, extra: Values, turbidity: float, height: float) -> tuple[Values, Values]:
    """Direct (normal) and diffuse (level) light (W/m²) of a clear sky, [rigollier2000].

    Parameters
    ----------
    elevation : ndarray (N,)
        Of the sun (degrees).
    extra : ndarray (N,)
        Beam outside the atmosphere (W/m²).
    turbidity : float
        Linke's, for air mass 2: 2 is clean mountain air, 3 the countryside, 5 a city's haze.
    height : float
        Of the place above the sea (m).
    """
    above = np.maximum(elevation, 0.0)
    sine = np.sin(np.radians(above))
    pressure = np.exp(-height / 8434.5)
    mass = pressure / (sine + 0.50572 * (above + 6.07995) ** -1.6364)
    thin = 1.0 / (6.6296 + 1.7513 * mass - 0.1202 * mass**2 + 0.0065 * mass**3 - 0.00013 * mass**4)
    depth = np.where(mass <= 20.0, thin, 1.0 / (10.4 + 0.718 * mass))
    direct = extra * np.exp(-0.8662 * turbidity * mass * depth)
    transmitted = -0.015843 + 0.030543 * turbidity + 0.0003797 * turbidity**2
    a0 = 0.26463 - 0.061581 * turbidity + 0.0031408 * turbidity**2
    a0 = max(a0, 0.002 / transmitted)
    a1 = 2.0402 + 0.018945 * turbidity - 0.011161 * turbidity**2
    a2 = -1.3025 + 0.039231 * turbidity + 0.0085079 * turbidity**2
    diffuse = extra * transmitted * (a0 + a1 * sine + a2 * sine**2)
    up = elevation > 0.0
    return np.where(up, direct, 0.0), np.where(up, np.maximum(diffuse, 0.0), 0.0)


def clear_hours(latitude: float, longitude: float, turbidity: float, height: float) -> Hours:
    """The hours of a year under a clear sky: an upper bound of what comes."""
    return kept_hours(0.0, latitude, longitude, partial(clear_sky, turbidity=turbidity, height=height))


OVERCAST = 0.25
"""Share of a clear sky's light that comes through an overcast one, all of it diffuse [kasten1980]."""


def clouded_hours(clear: Hours, annual: float) -> Hours:
    """The hours of a place that gets `annual` kWh/m² a year on the level: each is clear for the same share of
    its time, and overcast for the rest.

    Raises
    ------
    InputError
        When a clear sky gives less, or an overcast one more.
    """
    most = float(clear.level.sum()) / 1000.0
    if not OVERCAST * most <= annual <= most:
        raise InputError(
            f"--annual {annual:g} kWh/m²: this place gets {OVERCAST * most:.0f} (overcast all year) to "
            f"{most:.0f} (clear all year); give the sum of a year on the level"
        )
    share = (annual / most - OVERCAST) / (1.0 - OVERCAST)
    diffuse = share * clear.diffuse + (1.0 - share) * OVERCAST * clear.level
    return replace(clear, direct=share * clear.direct, diffuse=diffuse)


@dataclass(frozen=True)
class ClearSky:
    """A sky that is clear all year, or for the share of every hour that gives a place its yearly sum."""

    turbidity: float = 3.0
    """Linke's: 2 is mountain air, 3 the countryside of the middle latitudes, 5 a city's haze
    [rigollier2000]."""
    annual: float | None = None
    """kWh/m² a year on the level, of the place; None for clear all year."""

    @property
    def measured(self) -> bool:
        """True if its light is that of the place, so that yields follow from it."""
        return self.annual is not None

    @property
    def name(self) -> str:
        """The sky in words."""
        if self.annual is None:
            return "clear sky all year, an upper bound"
        return f"{self.annual:,.0f} kWh/m² a year on the level"

    def hours(self, latitude: float, longitude: float, height: float) -> Hours:
        """The hours of a place, `height` (m) above the sea."""
        clear = clear_hours(latitude, longitude, self.turbidity, height)
        return clear if self.annual is None else clouded_hours(clear, self.annual)


def hours_of_year(zone_h: float) -> Values:
    """Days since noon of 1 January 2000, in universal time, of the middle of every hour of a year by a clock
    that is `zone_h` hours ahead."""
    start = days_since_2000(datetime(YEAR, 1, 1, tzinfo=UTC))
    return np.asarray(start + (np.arange(HOURS) + 0.5 - zone_h) / 24.0, np.float64)


def month_of_hours() -> Integers:
    """The month, from 0, of every hour of a common year."""
    days = np.datetime64(f"{YEAR}-01-01") + np.arange(HOURS // 24)
    months = days.astype("datetime64[M]").astype(np.int64) % MONTHS
    return np.repeat(months, 24)


def kept_hours(
    zone_h: float,
    latitude: float,
    longitude: float,
    light: Callable[[Values, Values], tuple[Values, Values]],
) -> Hours:
    """Those hours of a year at a place in which anything comes, by a clock that is `zone_h` hours ahead.

    `light` gives the direct and the diffuse light (W/m²) by the sun's elevation and the beam outside the
    atmosphere; what is reported while the sun is down is the sky's."""
    azimuth, elevation, distance = sun_position(hours_of_year(zone_h), latitude, longitude)
    extra = SOLAR_CONSTANT / distance**2
    direct, diffuse = light(elevation, extra)
    bright = (diffuse > 0.0) | ((direct > 0.0) & (elevation > 0.0))
    up = np.where(elevation > 0.0, direct, 0.0)
    month = month_of_hours()[bright]
    return Hours(month, azimuth[bright], elevation[bright], up[bright], diffuse[bright], extra[bright])


@dataclass(frozen=True, eq=False)
class Weather:
    """The hours of a year in order, as an EPW file has them: light direct (normal) and diffuse (W/m²)."""

    direct: Values
    diffuse: Values
    zone_h: float
    """Hours by which its clock is ahead of universal time."""
    place: str
    measured: ClassVar[bool] = True

    @property
    def name(self) -> str:
        """The sky in words."""
        return f"weather of {self.place}"

    def hours(self, latitude: float, longitude: float, height: float = 0.0) -> Hours:
        """With the sun where it stands at a place; the light holds its `height` already."""
        return kept_hours(self.zone_h, latitude, longitude, lambda *_: (self.direct, self.diffuse))


HEADER_LINES, DIRECT, DIFFUSE = 8, 14, 15
"""Of an EPW file: lines before the hours, columns of the light (EnergyPlus, Auxiliary Programs, 2.9)."""


def read_epw(path: Path) -> Weather:
    """The hours of an EPW weather file; 29 February is left out.

    Raises
    ------
    InputError
        When it is none, or has not every hour of a year.
    """
    remedy = "give an EnergyPlus weather file (.epw) of one year by hours"
    try:
        lines = path.read_text(encoding="latin-1").splitlines()
        place = lines[0].split(",")
        if place[0].strip().upper() != "LOCATION":
            raise ValueError
        rows = [line.split(",") for line in lines[HEADER_LINES:] if line.strip()]
        hours = [row for row in rows if (int(row[1]), int(row[2])) != (2, 29)]
        light = np.array([[float(row[DIRECT]), float(row[DIFFUSE])] for row in hours])
        zone = float(place[8])
    except (OSError, ValueError, IndexError):
        raise InputError.about(path, "is no EPW weather file", remedy) from None
    if len(light) != HOURS:
        raise InputError.about(path, f"has {len(light)} hours, and a year has {HOURS}", remedy)
    if not np.isfinite(light).all() or (light < 0.0).any() or (light > SOLAR_CONSTANT).any():
        raise InputError.about(path, "has hours without direct or diffuse light", remedy)
    named = [word.strip() for word in place[1:4] if word.strip(" -")]
    return Weather(light[:, 0], light[:, 1], zone, ", ".join(named))


def light_on_plane(hours: Hours, normal: Values, albedo: float) -> tuple[Values, Values, Values]:
    """Light (W/m²) on a plane in every hour, after [haydavies1980], in three parts.

    First the beam and the share of the diffuse light that comes from around the sun, which anything before
    the sun takes away; then what comes from the whole sky if all of it were seen; then what comes from
    the ground if it were all that is seen.

    Parameters
    ----------
    hours : Hours
        Sun and sky.
    normal : ndarray (3,)
        Of the plane, upwards, unit, east, north (true) and up.
    albedo : float
        Share of the light that the ground throws back.
    """
    azimuth, elevation = np.radians(hours.azimuth), np.radians(hours.elevation)
    cosine = np.cos(elevation) * (normal[0] * np.sin(azimuth) + normal[1] * np.cos(azimuth))
    cosine = np.where(hours.elevation > 0.0, np.maximum(cosine + normal[2] * np.sin(elevation), 0.0), 0.0)
    clearness = np.where(hours.direct > 0.0, hours.direct / hours.extra, 0.0)
    around = hours.diffuse * clearness * cosine / np.maximum(np.sin(elevation), LEAST_SINE)
    sky = hours.diffuse * (1.0 - clearness)
    return hours.direct * cosine + around, sky, albedo * hours.level
