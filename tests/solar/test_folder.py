"""`eaves solar` over a run's folder: every roof face has its row, the buildings their sums, shadows fall."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyogrio
import pyproj
import pytest

from eaves.cli.app import make_app
from eaves.formats import InputError
from eaves.report.build import build
from eaves.solar import folder as solar_folder
from eaves.solar.folder import convergence_of, measure_solar


@pytest.fixture(scope="module")
def nine(nine_roofs_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("solar") / "out"
    assert build(nine_roofs_file, out).complete
    return out


def rows_of(path: Path, layer: str) -> list[dict[str, object]]:
    meta, _, _, columns = pyogrio.raw.read(path, layer=layer)
    return [dict(zip(meta["fields"], row, strict=True)) for row in zip(*columns, strict=True)]


def test_every_face_has_its_light_and_the_sums_agree(nine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    summary = measure_solar(nine)
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
    monkeypatch.setattr(solar_folder, "SQUARE", 35.0)  # squares decide no result
    again = rows_of(measure_solar(nine).path, "roofs")
    for one, other in zip(roofs, again, strict=True):
        assert one["light_kwh_m2"] == pytest.approx(other["light_kwh_m2"], rel=2e-3)


def test_grid_north_is_where_the_map_projection_has_it() -> None:
    """UTM 32, 50° north, 2° east of the middle: the convergence is 2° · sin 50°; on the middle it is 0."""
    utm = pyproj.CRS.from_epsg(32632)
    assert convergence_of(utm, 50.0, 11.0) == pytest.approx(2.0 * np.sin(np.radians(50.0)), abs=0.01)
    assert convergence_of(utm, 50.0, 9.0) == pytest.approx(0.0, abs=1e-4)
    assert convergence_of(utm, 50.0, 7.0) < -1.5


def test_command_says_what_is_missing(nine: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(InputError, match="has no dsm"):
        measure_solar(tmp_path)
    make_app()(["solar", str(nine), "-q"], standalone_mode=False)
    make_app()(["solar", str(nine), "--latitude", "10"], standalone_mode=False)
    told = capsys.readouterr().out
    assert "roof faces of 9 buildings" in told and "clear sky all year, an upper bound" in told
