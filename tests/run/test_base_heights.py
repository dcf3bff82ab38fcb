"""A building without ground beside it takes its base from the terrain model, and says so."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import shapely
from tests.conftest import build_files, write_laz

from eaves.formats import read_polygons
from eaves.formats.vectors.geopackage import Row, write_polygons
from eaves.simulate.objects.houses import ExactScene


def table(folder: Path) -> dict[str, tuple[str, float]]:
    """Source of the base and ground height of each building."""
    rows = read_polygons(folder / "footprints.gpkg", layer="footprints", keep_all=True)[2]
    return {row["id"]: (row["ground_source"], row["h_ground"]) for row in rows}


def test_a_footprint_without_ground_beside_it_stands_on_the_nearest_and_says_so(
    nine_roofs: ExactScene, tmp_path: Path
) -> None:
    shift = np.array([85000.0 - 85000.0 % 240, 447120.0, 0.0])
    xyz, bare = nine_roofs.cloud.xyz, np.zeros(len(nine_roofs.cloud), bool)
    for one in nine_roofs.buildings:
        bare |= shapely.contains_xy(one.footprint.buffer(2.6), xyz[:, 0], xyz[:, 1])
    bare &= nine_roofs.building == 0
    places = [shapely.transform(one.footprint, lambda xy: xy + shift[:2]) for one in nine_roofs.buildings]
    given = tmp_path / "given.gpkg"
    write_polygons(given, [Row(place, {"name": f"house {k}"}) for k, place in enumerate(places)])
    for name, kept in (("whole", np.ones(len(xyz), bool)), ("bare", ~bare)):
        write_laz(tmp_path / f"{name}.laz", xyz[kept] + shift)
        options = {"footprints": given, "id_field": "name", "outputs": ("footprints",)}
        build_files(tmp_path / f"{name}.laz", tmp_path / name, **options)  # type: ignore[arg-type]
    whole, without = table(tmp_path / "whole"), table(tmp_path / "bare")
    assert {source for source, _ in whole.values()} == {"measured"}
    # A roof without ground around it can pass for terrain: the footprint then fails, with its reason.
    modelled = {name for name, (source, _) in without.items() if source is not None}
    assert len(without) == 9
    assert len(modelled) >= 4
    assert {without[name][0] for name in modelled} == {"nearest ground"}
    assert all(abs(without[name][1] - whole[name][1]) < 0.5 for name in modelled)
