"""What things show by themselves are pictures, and what notebooks' libraries get is exact."""

from __future__ import annotations

import io
import sys
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
import shapely
from PIL import Image

import eaves
from eaves.formats.crs import parse_crs, system_of
from eaves.model import BuildingModel, Failure, Footprint, PointCloud, Scene
from eaves.report.pictures import cloud_picture, picture_of, png_bytes, raster_picture
from eaves.simulate.objects.houses import ExactScene

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def scene(nine_roofs: ExactScene) -> Scene:
    cloud = nine_roofs.classified()
    return eaves.make_scene(cloud, cloud.bounds)


def dots_of(png: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(png)))


def test_png_holds_the_image_dot_by_dot() -> None:
    image = np.random.default_rng(1).integers(0, 256, (5, 7, 3)).astype(np.uint8)
    assert (dots_of(png_bytes(image)) == image).all()


def test_north_is_up_and_roofs_are_red(nine_roofs: ExactScene) -> None:
    xyz = np.array([[0.0, 0.0, 1.0], [9.0, 9.0, 5.0], [0.0, 9.0, 1.0], [9.0, 0.0, 1.0]])
    image = cloud_picture(xyz, np.array([2, 6, 2, 2], np.uint8))
    top_right, low_left = image[0, -1].astype(int), image[-1, 0].astype(int)
    assert top_right[0] > top_right[2] + 60 and abs(low_left - top_right).sum() > 60
    cloud = nine_roofs.classified()
    assert max(cloud_picture(cloud.xyz, None).shape[:2]) <= 361
    assert (cloud_picture(np.full((3, 3), np.nan), None) == 255).all()


def test_no_data_is_white_and_slopes_are_shaded() -> None:
    heights = np.tile(np.abs(np.arange(40.0) - 20.0), (40, 1)).astype(np.float32)
    heights[:5, :5] = np.nan
    image = raster_picture(heights, 0.5)
    assert (image[:5, :5] == 255).all()
    assert abs(image[30, 10].astype(int) - image[30, 30].astype(int)).sum() > 20


def test_each_thing_shows_a_picture_and_its_figures(scene: Scene, nine_roofs: ExactScene) -> None:
    model = nine_roofs.buildings[0].model()
    shown = {
        "PointCloud": (scene.cloud, f"{len(scene.cloud):,}"),
        "Raster": (scene.dtm, "of 0.5 m"),
        "Scene": (scene, "of them ground"),
        "Footprint": (model.footprint, f"{model.footprint.polygon.area:,.1f} m²"),
        "BuildingModel": (model, "level of detail"),
    }
    for title, (thing, figure) in shown.items():
        told = thing._repr_html_()
        assert f"<b>{title}</b>" in told and figure in told
        assert "data:image/png" in told or "<path d=" in told
    assert picture_of(scene.cloud).ndim == picture_of(scene).ndim == 3
    assert "PointCloud" in PointCloud(np.zeros((0, 3)))._repr_html_()
    assert "&lt;b&gt;" in model.footprint.with_(id="<b>")._repr_html_()


def test_solid_shows_the_faces_that_look_at_us(nine_roofs: ExactScene) -> None:
    box = next(one.model() for one in nine_roofs.buildings if len(one.model().solids["2.2"][0].faces) == 6)
    root = ElementTree.fromstring(picture_of(box))
    assert 2 <= len(root.findall(f"{SVG}path")) <= 3  # of a roof, four walls and the ground
    empty = BuildingModel(box.footprint, {})
    assert len(ElementTree.fromstring(picture_of(empty)).findall(f"{SVG}path")) == 1


def test_geopandas_gets_outlines_in_the_systems_unit(nine_roofs: ExactScene) -> None:
    pytest.importorskip("geopandas")
    feet = system_of(parse_crs("EPSG:3089"), "test", (5e6, 3.8e6))
    footprint = Footprint(shapely.box(0, 0, 10, 8), (1000.0, 2000.0), "shed", attributes={"use": "barn"})
    failure = Failure("no_plane", "too rough", "reconstruct", footprint.with_(id="b"))
    table = eaves.to_geopandas([footprint, failure, Failure("x", "without outline")], feet)
    assert list(table["id"]) == ["shed", "b"] and table["failure_code"].iloc[1] == "no_plane"
    assert table.area.iloc[0] == pytest.approx(80.0 / feet.horizontal_unit_m**2) and table.crs is not None
    models = [one.model(nine_roofs.cloud.origin) for one in nine_roofs.buildings]
    assert set(eaves.to_geopandas(models)["lod"]) == {"2.2"}


def test_trimesh_is_closed_and_has_the_volume(nine_roofs: ExactScene) -> None:
    pytest.importorskip("trimesh")
    from eaves.figures.attributes import measure_volume

    for building in nine_roofs.buildings:
        model = building.model()
        mesh = eaves.to_trimesh(model)
        assert mesh.is_watertight
        assert mesh.volume == pytest.approx(measure_volume(model.solids["2.2"][0]), rel=1e-5)
    with pytest.raises(ValueError, match="no solids"):
        eaves.to_trimesh(BuildingModel(model.footprint, {}))


@pytest.mark.parametrize(("name", "library"), [("to_geopandas", "geopandas"), ("to_trimesh", "trimesh")])
def test_a_missing_library_is_one_line_with_the_remedy(
    name: str, library: str, nine_roofs: ExactScene, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(ImportError, match=rf"^{library} is not installed; pip install '.*'$"):
        getattr(eaves, name)(nine_roofs.buildings[0].model())
