"""`eaves solar` over a run's folder: every roof face has its row, the buildings their sums, shadows fall."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pyogrio
import pyproj
import pytest
import rasterio

from eaves.cli.app import make_app
from eaves.formats import InputError, read_raster
from eaves.pipeline import build
from eaves.solar import folder as solar_folder
from eaves.solar.folder import IRRADIATION, convergence_of, measure_solar
from eaves.solar.sun import ClearSky


@pytest.fixture(scope="module")
def nine(nine_roofs_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("solar") / "out"
    assert build(nine_roofs_file, out).complete
    return out


def rows_of(path: Path, layer: str) -> list[dict[str, object]]:
    meta, _, _, columns = pyogrio.raw.read(path, layer=layer)
    return [dict(zip(meta["fields"], row, strict=True)) for row in zip(*columns, strict=True)]


def test_every_face_has_its_light_and_the_sums_agree(nine: Path) -> None:
    summary = measure_solar(nine, sky=ClearSky(annual=1050.0))
    roofs, buildings = rows_of(summary.path, "roofs"), rows_of(summary.path, "buildings")
    planes = rows_of(nine / "footprints.gpkg", "roof_planes")
    assert len(roofs) == len(planes) == summary.faces and len(buildings) == summary.buildings == 9
    for row in roofs:
        months = [row[f"light_{number:02d}_kwh_m2"] for number in range(1, 13)]
        assert sum(months) == pytest.approx(row["light_kwh_m2"], abs=0.2)  # type: ignore[type-var, arg-type]
        assert 0.0 <= row["shade_share"] < 0.5 and 0.5 < row["sky_share"] <= 1.0  # type: ignore[operator]
        assert 0.0 <= row["usable_m2"] <= row["area_m2"]  # type: ignore[operator]
    for name in ("light_kwh", "usable_m2", "pv_kwh"):
        total = sum(row[name] for row in roofs)  # type: ignore[misc]
        assert sum(row[name] for row in buildings) == pytest.approx(total, abs=2.0)  # type: ignore[misc, arg-type]
    pitched = [row for row in roofs if row["slope_deg"] > 20.0]  # type: ignore[operator]
    turn = np.radians([row["azimuth_deg"] for row in pitched])
    light = np.array([row["light_kwh_m2"] for row in pitched])
    assert light[np.cos(turn) < -0.7].mean() > 1.3 * light[np.cos(turn) > 0.7].mean()


@pytest.mark.slow
def test_squares_decide_no_light(nine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sky = ClearSky(annual=1050.0)
    roofs = rows_of(measure_solar(nine, sky=sky).path, "roofs")
    whole, _ = read_raster(nine / IRRADIATION)
    monkeypatch.setattr(solar_folder, "SQUARE", 35.0)
    again = rows_of(measure_solar(nine, sky=sky).path, "roofs")
    for one, other in zip(roofs, again, strict=True):
        assert one["light_kwh_m2"] == pytest.approx(other["light_kwh_m2"], rel=2e-3)
    pieces, _ = read_raster(nine / IRRADIATION)
    np.testing.assert_allclose(whole.values, pieces.values, rtol=2e-3)


def test_raster_has_the_light_of_the_faces_on_the_cells_of_the_surface(nine: Path) -> None:
    summary = measure_solar(nine, sky=ClearSky(annual=1050.0))
    raster, _ = read_raster(nine / IRRADIATION)
    surface, _ = read_raster(nine / "dsm.tif")
    assert (raster.shape, raster.west, raster.north) == (surface.shape, surface.west, surface.north)
    roofs = rows_of(summary.path, "roofs")
    slope = np.radians([row["slope_deg"] for row in roofs])
    plan = np.array([row["area_m2"] for row in roofs]) * np.cos(slope)
    light = np.array([row["light_kwh_m2"] for row in roofs])
    on_roofs = np.isfinite(raster.values)
    assert on_roofs.sum() * raster.cell**2 == pytest.approx(plan.sum(), rel=0.02)
    assert raster.values[on_roofs].mean() == pytest.approx((plan * light).sum() / plan.sum(), rel=0.02)


@pytest.mark.parametrize("annual", [None, 1050.0])
def test_sky_is_named_wherever_its_light_is__and_only_a_measured_one_yields(
    nine: Path, annual: float | None
) -> None:
    sky = ClearSky(annual=annual)
    summary = measure_solar(nine, sky=sky)
    for layer in ("roofs", "buildings"):
        assert {row["sky"] for row in rows_of(summary.path, layer)} == {sky.name}
        empty = [row["pv_kwh"] is None or np.isnan(row["pv_kwh"]) for row in rows_of(summary.path, layer)]  # type: ignore[arg-type]
        assert all(empty) if annual is None else not any(empty)
    assert ("no yield" in summary.as_text()) == (annual is None) == (summary.current_mwh is None)
    with closing(sqlite3.connect(summary.path)) as database:
        described = database.execute("SELECT description FROM gpkg_contents WHERE table_name = 'roofs'")
        styles = database.execute("SELECT styleQML, description FROM layer_styles").fetchall()
        assert sky.name in described.fetchone()[0]
    assert styles and all(sky.name in qml and sky.name in meaning for qml, meaning in styles)
    with rasterio.open(nine / IRRADIATION) as image:
        assert image.tags()["sky"] == sky.name


def test_grid_north_is_where_the_map_projection_has_it() -> None:
    """UTM 32, 50° north, 2° east of the middle: the convergence is 2° · sin 50°; on the middle it is 0."""
    utm = pyproj.CRS.from_epsg(32632)
    assert convergence_of(utm, 50.0, 11.0) == pytest.approx(2.0 * np.sin(np.radians(50.0)), abs=0.01)
    assert convergence_of(utm, 50.0, 9.0) == pytest.approx(0.0, abs=1e-4)
    assert convergence_of(utm, 50.0, 7.0) < -1.5


@pytest.mark.slow
def test_command_says_what_is_missing(nine: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(InputError, match="has no dsm"):
        measure_solar(tmp_path)
    make_app()(["solar", str(nine), "-q"], standalone_mode=False)
    make_app()(["solar", str(nine), "--latitude", "10"], standalone_mode=False)
    told = capsys.readouterr().out
    assert "roof faces of 9 buildings" in told and "clear sky all year, an upper bound" in told
    with pytest.raises(InputError, match="give one of them"):
        make_app()(["solar", str(nine), "--weather", "a.epw", "--annual", "1050"], standalone_mode=False)
    with pytest.raises(InputError, match="clear all year"):
        measure_solar(nine, sky=ClearSky(annual=2800.0))
