"""Sun, sky and shadows against published positions, closed forms and exact geometry."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
import shapely

from eaves.formats import InputError
from eaves.model import Raster
from eaves.solar.roofs import SolarRules, horizons, light_in_the_open, light_on_faces, lit_light, sky_shares
from eaves.solar.sun import (
    HOURS,
    ClearSky,
    Hours,
    clear_hours,
    clear_sky,
    days_since_2000,
    light_on_plane,
    read_epw,
    sun_position,
)
from tests.judges import judging_module

HALF, CELL = 200, 0.5
"""Half the side of a square of cells about (0, 0), and their side (m)."""


def field() -> Raster:
    """A level field at height 0."""
    return Raster(np.zeros((2 * HALF, 2 * HALF), np.float32), -HALF * CELL, HALF * CELL, CELL)


def tilted(slope: float, azimuth: float) -> np.ndarray:
    """The normal of a plane, degrees."""
    lean, turn = np.radians(slope), np.radians(azimuth)
    return np.array([np.sin(lean) * np.sin(turn), np.sin(lean) * np.cos(turn), np.cos(lean)])


def one_place(z: float) -> tuple[np.ndarray, int, np.ndarray]:
    return np.array([[0.25, 0.25, z]]), 1, np.zeros(3)


def test_sun_stands_where_the_solar_position_algorithm_has_it() -> None:
    """The example of Reda and Andreas, 2004: Golden, Colorado, 17 October 2003, 12:30:30 at UTC − 7."""
    moment = np.array([days_since_2000(datetime(2003, 10, 17, 19, 30, 30, tzinfo=UTC))])
    azimuth, elevation, distance = sun_position(moment, 39.742476, -105.1786)
    assert azimuth[0] == pytest.approx(194.34024, abs=0.02)
    assert 90.0 - elevation[0] == pytest.approx(50.11162, abs=0.02)
    assert distance[0] == pytest.approx(0.9965, abs=0.0003)


@pytest.mark.parametrize("latitude", [-33.0, 0.0, 52.0])
def test_noon_sun_is_as_high_as_the_seasons_make_it(latitude: float) -> None:
    days = days_since_2000(datetime(2023, 6, 21, tzinfo=UTC)) + np.arange(1440) / 1440.0
    _, elevation, _ = sun_position(days, latitude, 0.0)
    assert elevation.max() == pytest.approx(90.0 - abs(latitude - 23.436), abs=0.03)


def test_clear_sky_holds_its_bounds() -> None:
    elevation = np.array([-5.0, 5.0, 30.0, 90.0])
    extra = np.full(4, 1367.0)
    direct, diffuse = clear_sky(elevation, extra, 3.0, 0.0)
    assert direct[0] == diffuse[0] == 0.0 and (np.diff(direct) > 0.0).all() and direct[3] < 1000.0
    hazy, more = clear_sky(elevation, extra, 5.0, 0.0)
    assert (hazy[1:] < direct[1:]).all() and (more[2:] > diffuse[2:]).all()
    high, _ = clear_sky(elevation, extra, 3.0, 2000.0)
    assert (high[1:] > direct[1:]).all()
    level = direct * np.sin(np.radians(elevation)) + diffuse
    assert 950.0 < level[3] < 1150.0


@pytest.mark.parametrize("distance", [5.0, 20.0, 60.0])
@pytest.mark.parametrize("z", [0.0, 3.0])
def test_sun_is_hidden_by_a_wall_at_exactly_the_hours_geometry_says(distance: float, z: float) -> None:
    """A wall of 10 m, half a metre thick, runs east to west south of a place at height z."""
    dsm, height = field(), 10.0
    rows = dsm.north - (np.arange(2 * HALF) + 0.5) * CELL
    row = int(np.argmin(np.abs(rows - (0.25 - distance - 0.25))))
    dsm.values[row] = height
    near = 0.25 - (rows[row] + 0.5 * CELL)
    horizon = horizons(dsm, np.zeros(dsm.shape, np.int32), *one_place(z), 72, 300.0, 0.3)
    hours = clear_hours(52.0, 4.4, 3.0, 0.0)
    ahead = -np.cos(np.radians(hours.azimuth))  # towards the south
    aside = np.abs(hours.azimuth - 180.0) + 5.0  # of the next direction of the horizon
    ends = (aside < 85.0) & (np.tan(np.radians(np.minimum(aside, 85.0))) * (near + CELL) < HALF * CELL - 2)
    ends |= ahead < -0.1
    tangent = np.tan(np.radians(hours.elevation))
    shadow = np.where(ahead > 0.0, (height - z) * ahead, 0.0)
    surely_hidden = ends & (tangent < 0.995 * shadow / (near + CELL))
    surely_lit = ends & ((ahead < 0.0) | (tangent > 1.005 * shadow / near)) & (hours.elevation > 0.0)
    assert surely_hidden.sum() > 50 and surely_lit.sum() > 500
    for hour in np.flatnonzero(surely_hidden | surely_lit):
        one = slice(hour, hour + 1)
        lit = lit_light(horizon, hours.azimuth[one], hours.elevation[one], np.ones(1), hours.month[one]).sum()
        assert bool(lit) == bool(surely_lit[hour]), (hours.azimuth[hour], hours.elevation[hour])


@pytest.mark.parametrize("slope", [0.0, 20.0, 45.0, 80.0])
def test_open_plane_sees_its_share_of_the_sky(slope: float) -> None:
    shares = sky_shares(np.zeros((1, 72), np.float32), tilted(slope, 130.0))
    assert shares[0] == pytest.approx(0.5 * (1.0 + np.cos(np.radians(slope))), abs=1e-3)


def test_sky_above_a_long_wall_is_that_of_the_closed_form() -> None:
    """Before an endless wall a level place sees (1 + cos e) / 2 of the sky, e the wall's elevation."""
    turn = 2.0 * np.pi * np.arange(720) / 720
    horizon = np.maximum(1.5 * np.cos(turn), 0.0)[None].astype(np.float32)
    expected = 0.5 * (1.0 + np.cos(np.arctan(1.5)))
    assert sky_shares(horizon, np.array([0.0, 0.0, 1.0]))[0] == pytest.approx(expected, abs=1e-4)


def test_strides_over_low_ground_change_no_horizon() -> None:
    """Boxes of all heights; the slow walk looks at every cell."""
    rng = np.random.default_rng(7)
    dsm = field()
    for _ in range(60):
        row, column = rng.integers(0, 2 * HALF - 20, 2)
        dsm.values[row : row + rng.integers(1, 20), column : column + rng.integers(1, 20)] = rng.uniform(
            2, 30
        )
    dsm.values[5:9] = np.nan
    found = horizons(dsm, np.zeros(dsm.shape, np.int32), *one_place(1.0), 36, 90.0, 0.3)[0]
    for k, turn in enumerate(2.0 * np.pi * np.arange(36) / 36):
        away = np.arange(0.01, 90.0, 0.01)
        row, column = dsm.cell_of(0.25 + away[:, None] * [np.sin(turn), np.cos(turn)])
        inside = (row >= 0) & (column >= 0) & (row < 2 * HALF) & (column < 2 * HALF)
        row, column, away = row[inside], column[inside], away[inside]
        cell = row * 2 * HALF + column
        starts = np.flatnonzero(np.r_[True, np.diff(cell) != 0])
        ends = np.r_[starts[1:], len(cell)]
        best = 0.0
        for start, end in zip(starts[1:], ends[1:], strict=True):
            h = dsm.values[row[start], column[start]]
            if np.isfinite(h):
                best = max(best, float(h - 1.0) / (0.5 * (away[start] + away[end - 1] + 0.01)))
        assert found[k] == pytest.approx(best, rel=0.02, abs=1e-3)


def flat_face(
    z: float, west: float = -5.0, south: float = -3.0, size: tuple[float, float] = (10.0, 6.0)
) -> shapely.Polygon:
    box = shapely.box(west, south, west + size[0], south + size[1])
    return shapely.force_3d(shapely.orient_polygons(box), z)


def on_roof(
    dsm: Raster, z: float, west: float, south: float, size: tuple[float, float] = (10.0, 6.0)
) -> None:
    """Put a box of height z on the field."""
    column, row = round((west - dsm.west) / CELL), round((dsm.north - south - size[1]) / CELL)
    dsm.values[row : row + round(size[1] / CELL), column : column + round(size[0] / CELL)] = z


def test_roof_in_the_open_gets_the_light_of_the_open() -> None:
    dsm, rules = field(), SolarRules()
    on_roof(dsm, 8.0, -5.0, -3.0)
    hours = clear_hours(52.0, 4.4, 3.0, 0.0)
    light = light_on_faces([flat_face(8.0)], dsm, hours, 0.0, rules, 0.0, [0])[0]
    assert light.month == pytest.approx(light_in_the_open(hours, np.array([0.0, 0.0, 1.0]), rules), rel=2e-3)
    assert light.sky == pytest.approx(1.0, abs=1e-6) and light.covered == 0.0
    assert light.month.argmax() in (5, 6) and light.month.argmin() == 11
    level = np.bincount(hours.month, hours.level, 12) / 1000.0
    assert light.open_month == pytest.approx(level, rel=1e-3)


def test_usable_is_what_is_free_off_the_rim_and_large_enough() -> None:
    """10 × 6 m with a box of 1 × 1 × 1 m on it; rims of 0.3 m; cells of half a metre."""
    dsm = field()
    on_roof(dsm, 8.0, -5.0, -3.0)
    on_roof(dsm, 9.0, 0.0, 0.0, (1.0, 1.0))
    hours = clear_hours(52.0, 4.4, 3.0, 0.0)
    rules = SolarRules(suitable=0.0)
    light = light_on_faces([flat_face(8.0)], dsm, hours, 0.0, rules, 1.0, [0])[0]
    assert light.covered == pytest.approx(4 / 240)
    # the middles of the outermost cells lie 0.25 m from the rim: 18 × 10 cells are left, four of them covered
    assert light.usable_m2 == pytest.approx((18 * 10 - 4) * 0.25)
    strip = light_on_faces([flat_face(8.0, size=(10.0, 0.9))], dsm, hours, 0.0, rules, 1.0, [0])[0]
    assert strip.usable_m2 == 0.0
    dark = light_on_faces([flat_face(8.0)], dsm, hours, 0.0, SolarRules(suitable=1.0), 2000.0, [0])[0]
    assert dark.usable_m2 == 0.0


def test_tower_in_the_south_darkens_and_one_in_the_north_hardly() -> None:
    hours, rules = clear_hours(52.0, 4.4, 3.0, 0.0), SolarRules()
    years = {}
    for name, south in (("none", None), ("south", -25.0), ("north", 19.0)):
        dsm = field()
        on_roof(dsm, 8.0, -5.0, -3.0)
        if south is not None:
            on_roof(dsm, 30.0, -10.0, south, (20.0, 6.0))
        years[name] = light_on_faces([flat_face(8.0)], dsm, hours, 0.0, rules, 0.0, [0])[0].month.sum()
    assert years["south"] < 0.85 * years["none"] and 0.9 * years["none"] < years["north"] < years["none"]


def test_noise_of_the_own_face_casts_no_shadow_and_chimneys_do() -> None:
    hours, rules = clear_hours(52.0, 4.4, 3.0, 0.0), SolarRules()
    dsm = field()
    on_roof(dsm, 8.0, -5.0, -3.0)
    rough = Raster(dsm.values.copy(), dsm.west, dsm.north, dsm.cell)
    rough.values[rough.values > 0.0] += np.random.default_rng(1).uniform(-0.2, 0.2, 240).astype(np.float32)
    calm, noisy = (
        light_on_faces([flat_face(8.0)], one, hours, 0.0, rules, 0.0, [0])[0] for one in (dsm, rough)
    )
    assert noisy.month == pytest.approx(calm.month, rel=1e-9)
    on_roof(dsm, 10.0, -4.0, -2.0, (1.0, 1.0))
    chimney = light_on_faces([flat_face(8.0)], dsm, hours, 0.0, rules, 0.0, [0])[0]
    assert 0.85 * calm.month.sum() < chimney.month.sum() < 0.995 * calm.month.sum()


def test_south_gets_more_than_north__west_in_the_afternoon() -> None:
    hours, rules = clear_hours(52.0, 4.4, 3.0, 0.0), SolarRules()
    south, north, east, west = (
        light_in_the_open(hours, tilted(40.0, azimuth), rules).sum() for azimuth in (180, 0, 90, 270)
    )
    assert south > 1.5 * north and east == pytest.approx(west, rel=0.01)


def test_grid_north_is_turned_to_true_north() -> None:
    """What looks 10° east of grid south looks south where grid north lies 10° east of true north."""
    hours, rules = clear_hours(52.0, 4.4, 3.0, 0.0), SolarRules()
    dsm, months = field(), []
    for azimuth, convergence in ((180.0, 0.0), (170.0, 10.0)):
        normal = tilted(35.0, azimuth)
        a, b = -normal[:2] / normal[2]
        corners = [(x, y, a * x + b * y + 30.0) for x, y in ((-5, -3), (5, -3), (5, 3), (-5, 3))]
        face = shapely.Polygon(corners)
        months.append(light_on_faces([face], dsm, hours, convergence, rules, 0.0, [0])[0].month)
    assert months[0] == pytest.approx(months[1], rel=2e-3)


def test_weather_file_is_read_and_its_clock_is_heeded(tmp_path: Path) -> None:
    days = np.datetime64("2023-01-01") + np.arange(365)
    lines = ["LOCATION,Woodford,KY,USA,TMY3,724220,38.0,-84.6,-5.0,290.0", *["x"] * 7]
    for day in days.astype(str):
        _, month, number = day.split("-")
        for hour in range(1, 25):
            light = [800, 100] if 8 < hour <= 17 else [0, 0]
            told = [2009, int(month), int(number), hour, 0, "?", *[0] * 8, *light]
            lines.append(",".join(map(str, told)))
    path = tmp_path / "a.epw"
    path.write_text("\n".join(lines))
    weather = read_epw(path)
    assert (weather.place, weather.zone_h) == ("Woodford, KY, USA", -5.0)
    hours = weather.hours(38.0, -84.6)
    assert len(hours.month) == 365 * 9
    noon = hours.elevation[(hours.month == 5)].max()
    assert 74.0 < noon < 76.0  # the sun at its highest falls within the nine hours
    path.write_text("\n".join(lines[:-1]))
    with pytest.raises(InputError, match=f"has {HOURS - 1} hours"):
        read_epw(path)
    path.write_text("no weather")
    with pytest.raises(InputError, match="no EPW weather file"):
        read_epw(path)


@pytest.mark.parametrize("annual", [500.0, 985.0, 1600.0])
def test_clouds_bring_the_yearly_sum_of_a_place(annual: float) -> None:
    """Exactly the sum on the level; more clouds, a larger diffuse share, and no beam over a clear sky's."""
    hours, clear = ClearSky(annual=annual).hours(52.0, 4.4, 0.0), ClearSky().hours(52.0, 4.4, 0.0)
    assert hours.level.sum() == pytest.approx(1000.0 * annual)
    assert (hours.direct <= clear.direct).all() and (hours.diffuse >= 0.0).all()
    assert hours.diffuse.sum() / hours.level.sum() > clear.diffuse.sum() / clear.level.sum()


@pytest.mark.parametrize("annual", [300.0, 1900.0])
def test_sum_that_no_sky_gives_is_refused(annual: float) -> None:
    with pytest.raises(InputError, match=r"this place gets 433 .* to 1731"):
        ClearSky(annual=annual).hours(52.0, 4.4, 0.0)


def test_transposition_is_that_of_pvlib() -> None:
    """Unshaded planes by hour, and the sun's place, where pvlib is installed."""
    irradiance = judging_module("pvlib.irradiance")
    hours: Hours = clear_hours(52.0, 4.4, 3.0, 0.0)
    for slope, azimuth in ((0.0, 180.0), (35.0, 180.0), (45.0, 90.0), (60.0, 315.0), (20.0, 0.0)):
        normal = tilted(slope, azimuth)
        beam, sky, back = light_on_plane(hours, normal, 0.2)
        seen = 0.5 * (1.0 + normal[2])
        ours = beam + sky * seen + back * (1.0 - seen)
        theirs = irradiance.get_total_irradiance(
            *(slope, azimuth, 90.0 - hours.elevation, hours.azimuth),
            *(hours.direct, hours.level, hours.diffuse),
            dni_extra=hours.extra, albedo=0.2, model="haydavies",
        )["poa_global"]  # fmt: skip
        up = hours.elevation > 1.0
        assert ours[up] == pytest.approx(np.asarray(theirs)[up], abs=0.5)
        assert ours.sum() == pytest.approx(float(np.nansum(theirs)), rel=1e-3)
