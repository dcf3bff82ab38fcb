"""The classes that are written, and those that a file's own numbers stand for."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import pytest
from tests.conftest import build_files

from eaves.model import PointCloud
from eaves.recipe.recipe import make_recipe
from eaves.simulate import nine_roofs_on_a_slope, write_simulation
from eaves.surroundings.wires import VegetationRules, vegetation_classes


def classes_of(folder: Path) -> np.ndarray:
    return np.asarray(laspy.read(folder / "classified.laz").classification)


def cloud_of(xyz: np.ndarray, several: np.ndarray, origin: tuple[float, float] = (0.0, 0.0)) -> PointCloud:
    return PointCloud(
        xyz=xyz - [*origin, 0.0],
        origin=origin,
        number_of_returns=np.where(several, 2, 1).astype(np.uint8),
        return_number=np.ones(len(xyz), np.uint8),
        classification=np.ones(len(xyz), np.uint8),
    )


def test_crowns_are_vegetation_by_height_and_level_single_returns_are_not() -> None:
    rng = np.random.default_rng(1)
    crown, car, lawn = (rng.uniform(0.0, 8.0, (400, 3)) + [20.0 * k, 0.0, 0.0] for k in range(3))
    car[:, 2], lawn[:, 2] = 1.5, 0.4
    xyz = np.round(np.concatenate([crown, car, lawn]), 4)
    several = np.arange(len(xyz)) >= 800  # the crown shows by its roughness, the lawn by its echoes
    nothing = np.zeros(len(xyz), np.int32)
    found = vegetation_classes(cloud_of(xyz, several), nothing, None, xyz[:, 2], VegetationRules())
    height = crown[:, 2]
    assert (found[:400] == np.where(height <= 0.5, 3, np.where(height <= 2.0, 4, 5))).all()
    assert (found[400:800] == 0).all()
    assert (found[800:] == 3).all()
    labelled = vegetation_classes(cloud_of(xyz, several), nothing + 1, None, xyz[:, 2], VegetationRules())
    assert (labelled == 0).all()


def test_vegetation_is_the_same_about_any_origin_and_in_any_order() -> None:
    rng = np.random.default_rng(2)
    xyz = np.round(rng.uniform(0.0, 30.0, (900, 3)) * [1.0, 1.0, 0.02], 4)
    several = rng.random(900) < 0.3
    nothing, order = np.zeros(900, np.int32), rng.permutation(900)
    first = vegetation_classes(cloud_of(xyz, several), nothing, None, xyz[:, 2], VegetationRules())
    moved = cloud_of(xyz[order], several[order], (-61.0, 183.0))
    assert 0 < (first > 0).sum() < 900
    again = vegetation_classes(moved, nothing, None, xyz[order, 2], VegetationRules())
    assert (again == first[order]).all()


@pytest.mark.slow
def test_classes_2_and_6_are_the_same_with_and_without_vegetation(tmp_path: Path) -> None:
    path = write_simulation(nine_roofs_on_a_slope(density=4.0), tmp_path)["points"]
    las = laspy.read(path)
    rng = np.random.default_rng(3)
    crown = rng.uniform(-2.0, 2.0, (300, 3)) + [las.x.min() + 4.0, las.y.min() + 4.0, las.z.max()]
    bare = len(las.points)
    more = laspy.LasData(las.header)
    more.points = laspy.ScaleAwarePointRecord(
        np.concatenate([las.points.array, las.points.array[:300]]),
        las.point_format,
        las.header.scales,
        las.header.offsets,
    )
    for name, values in zip("xyz", crown.T, strict=True):
        whole = np.array(more[name])
        whole[bare:] = values
        setattr(more, name, whole)
    more.write(tmp_path / "crown.laz")
    build_files(tmp_path / "crown.laz", tmp_path / "all", lod="0")
    build_files(tmp_path / "crown.laz", tmp_path / "two", lod="0", classes=(2, 6))
    whole, two = classes_of(tmp_path / "all"), classes_of(tmp_path / "two")
    assert set(np.unique(two)) <= {1, 2, 6, 7, 18}
    assert (whole[bare:] == 5).mean() > 0.8
    vegetation = np.isin(whole, (3, 4, 5))
    assert (two[vegetation] == 1).all()
    assert (whole[~vegetation] == two[~vegetation]).all()
    assert (whole == 6).sum() > 1000


@pytest.mark.slow
def test_a_file_may_number_its_classes_as_it_likes(tmp_path: Path) -> None:
    truth = nine_roofs_on_a_slope(density=4.0)
    path = write_simulation(truth, tmp_path)["points"]
    las = laspy.read(path)
    las.classification = truth.truth_class
    las.write(tmp_path / "usual.laz")
    own = np.asarray(truth.truth_class).copy()
    own[truth.truth_class == 2] = np.where(np.arange((own == 2).sum()) % 2, 8, 11)
    own[truth.truth_class == 6] = 40
    las.classification = own
    las.write(tmp_path / "own.laz")
    usual = build_files(tmp_path / "usual.laz", tmp_path / "a", lod="0", use_classes=True)
    options = dict(building_classes=(40,), ground_classes=(8, 11))
    renamed = build_files(tmp_path / "own.laz", tmp_path / "b", lod="0", use_classes=True, **options)
    assert renamed.found == usual.found == 9
    assert (classes_of(tmp_path / "a") == classes_of(tmp_path / "b")).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"ground_classes": (2, 8)}, "add --use-classes"),
        ({"use_classes": True, "ground_classes": (6,)}, "both ground and building"),
        ({"use_classes": True, "building_classes": (7,)}, "noise"),
        ({"use_classes": True, "building_classes": (300,)}, "from 0 to 255"),
        (
            {"use_classes": True, "building_classes": (6,), "methods": {"detect": "xiao2014"}},
            "leave --detect",
        ),
        ({"classes": (2, 9)}, "write 2,6, 2,3,4,5,6 or 2,3,4,5,6,9,14,15,17"),
    ],
)
def test_numbers_that_make_no_sense_are_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make_recipe(**options)  # type: ignore[arg-type]
