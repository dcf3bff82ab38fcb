"""A measure counts by how much it tells apart in the scan at hand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from eaves.blocks.block import inputs_of_regions
from eaves.detect import detect_buildings
from eaves.detect.consensus import Consensus
from eaves.detect.consensus.evidence import count_signs, learned, nothing, separate
from eaves.model import Block, Scene
from eaves.raster.surfaces import make_scene
from eaves.recipe.recipe import make_recipe
from eaves.simulate.objects.exact import ExactScene
from eaves.simulate.standard import StandardScene
from tests.detect.made_scenes import MadeScene

MOST = Consensus().most_log_ratio


def two_groups(roof: float, crown: float, spread: float, count: int = 4000) -> tuple[np.ndarray, np.ndarray]:
    """Values of a measure on roofs and on crowns, and the probability of each to be a roof."""
    rng = np.random.default_rng(1)
    values = np.concatenate([rng.normal(roof, spread, count), rng.normal(crown, spread, count)])
    return values, np.repeat([1.0, 0.0], count)


def test_the_log_ratio_is_that_of_two_normal_distributions() -> None:
    found = separate(*two_groups(0.1, 0.6, 0.2))
    value = np.array([0.1, 0.35, 0.5])
    exact = ((value - 0.6) ** 2 - (value - 0.1) ** 2) / (2 * 0.2**2)
    assert found.log_ratio(value, MOST) == pytest.approx(exact, abs=0.15)
    assert found.power == pytest.approx(0.86, abs=0.02)


@pytest.mark.parametrize("value", [0.0, 0.3, 1.0])
def test_a_measure_that_is_alike_on_both_tells_nothing(value: float) -> None:
    silent = separate(*two_groups(0.3, 0.3, 0.1))
    assert abs(silent.log_ratio(np.array([value]), MOST)[0]) < 0.3
    assert silent.power < 0.01
    assert nothing().log_ratio(np.array([value]), MOST)[0] == 0.0


def test_a_measure_without_values_tells_nothing() -> None:
    assert separate(np.zeros(100), np.repeat([1.0, 0.0], 50)) == nothing()
    assert separate(np.ones(100), np.ones(100)) == nothing()


def test_a_measure_the_wrong_way_round_tells_nothing() -> None:
    assert separate(*two_groups(0.6, 0.1, 0.2)) == nothing()


def test_what_is_told_grows_smoothly_with_the_distance() -> None:
    told = [separate(*two_groups(0.1, 0.1 + far, 0.1)).power for far in (0.01, 0.03, 0.1, 0.3)]
    assert told == sorted(told)
    assert told[0] < 0.05 and told[-1] > 0.85


def test_no_measure_is_surer_than_fifty_to_one() -> None:
    values, roof = two_groups(0.0, 1.0, 0.01)
    assert np.abs(separate(values, roof).log_ratio(values, MOST)).max() == MOST


def town_iou(exact: ExactScene, share: float | None) -> float:
    """IoU of the consensus on a town of which a share of the pulses keep their several returns."""
    cloud, truth = exact.cloud, exact.truth_class == 6
    ground = np.where(exact.truth_class == 2, 2, 1).astype(np.uint8)
    cloud = cloud.with_(classification=ground)
    if share is None:
        cloud = cloud.with_(return_number=None, number_of_returns=None)
    else:
        number, returns = cloud.return_number, cloud.number_of_returns
        assert number is not None and returns is not None
        pulse = np.cumsum(number == 1)
        lost = np.random.default_rng(1).random(int(pulse.max()) + 1)[pulse] >= share
        keep = (number == 1) | ~lost
        cloud = cloud.with_(number_of_returns=np.where(lost, np.minimum(returns, 1), returns)).take(keep)
        truth = truth[keep]
    scene = make_scene(cloud, cloud.bounds)
    got = detect_buildings(scene, Consensus()).label > 0
    return float((got & truth).sum() / (got | truth).sum())


def test_few_echoes_do_no_harm() -> None:
    exact = StandardScene("few echoes", 7601, "suburb", "flat", 8.0, area_km2=0.01).make()
    whole = town_iou(exact, 1.0)
    assert whole > 0.9
    for share in (0.15, 0.05, 0.0, None):
        assert town_iou(exact, share) > whole - 0.02, share


def test_a_crag_that_goes_on_in_the_terrain_is_no_building() -> None:
    made = MadeScene(density=8.0)
    made.box(10.0, 10.0, 20.0, 20.0, 4.0, 1)
    scene, what = made.scene()
    xyz = scene.cloud.xyz.copy()
    x, y = xyz[:, 0], xyz[:, 1]
    # a ledge 4 m high whose back and sides slope down to the land
    ledge = np.minimum(np.clip((x - 30.0) * 10.0, 0.0, 4.0), np.clip((55.0 - x) * 0.3, 0.0, 4.0))
    ledge = np.minimum(ledge, np.clip(np.minimum(y - 20.0, 50.0 - y) * 0.6, 0.0, 4.0))
    xyz[:, 2] += np.where(what == 0, ledge, 0.0)
    # the ground filter took the top of the ledge for an object, and the terrain for level
    top = (what == 0) & (ledge > 2.5)
    classes = np.where(top, 1, scene.cloud.classification).astype(np.uint8)
    height = scene.height + np.where(what == 0, ledge, 0.0)
    cloud = scene.cloud.with_(xyz=xyz, classification=classes, ordered=False)
    found = detect_buildings(Scene(cloud, scene.dtm, scene.dsm, scene.spacing, height), Consensus())
    assert not (found.label[top] > 0).any()
    assert (found.label[what == 1] > 0).mean() > 0.95


def test_a_building_on_the_rim_of_the_data_is_a_doubt() -> None:
    made = MadeScene(density=8.0)
    made.box(0.0, 20.0, 12.0, 32.0, 5.0, 1)
    made.box(30.0, 30.0, 42.0, 42.0, 5.0, 2)
    scene, _ = made.scene()
    doubts = detect_buildings(scene, Consensus()).doubts
    assert [doubt.reason for doubt in doubts] == ["a building on the rim of the data"]
    assert doubts[0].x < 1.0 and 20.0 < doubts[0].y < 32.0
    assert doubts[0].stage == "detect"


def test_roofs_are_told_from_relief_and_crowns_by_what_smooth_places_show_beside_them() -> None:
    rng = np.random.default_rng(1)
    terrain, crowns = rng.normal(0.33, 0.1, 50_000), rng.normal(0.6, 0.12, 20_000)
    roofs = rng.normal(0.13, 0.06, 2_000)
    smooth = np.concatenate([roofs, terrain[:8_000], crowns[:4_000]])
    found = learned(count_signs(terrain, crowns, smooth), alike=49.0)
    assert found.roof == pytest.approx(0.13, abs=0.02)
    assert found.crown == pytest.approx((8 * 0.33 + 4 * 0.6) / 12, abs=0.03)
    assert found.trust > 0.9


def test_colours_tell_nothing_where_nothing_smooth_rises() -> None:
    rng = np.random.default_rng(2)
    terrain = rng.normal(0.33, 0.1, 50_000)
    assert learned(count_signs(terrain, terrain[:900], terrain[:20]), alike=49.0).power == 0.0


@pytest.mark.parametrize(("blur", "parted", "count"), [(0.0, False, 1), (2.0, True, 1), (2.0, False, 0)])
def test_where_walls_are_smoothed_and_colours_tell_nothing_shape_is_no_evidence(
    blur: float, parted: bool, count: int
) -> None:
    made = MadeScene(size=60.0)
    made.box(20.0, 20.0, 36.0, 34.0, 6.0, 1)
    scene, what = made.scene(returns=False)
    red = np.where((what == 1) & parted, 60_000.0, 20_000.0)
    fields = {"red": red, "green": np.full(len(red), 30_000.0), "blue": np.full(len(red), 20_000.0)}
    cloud = replace(scene.cloud, fields=fields)
    found = detect_buildings(replace(scene, cloud=cloud), Consensus().for_scan(blur, 0.0))
    assert found.count == count


def test_what_blocks_around_count_is_added_up_for_a_block_without_roofs() -> None:
    counts = [np.full((3, 150), number) for number in (1.0, 2.0)]
    found = [{"signs": counts[0]}, {}, {"signs": counts[1]}]
    blocks = [Block(column, 0, 240.0) for column in range(3)]
    window = cast("Any", SimpleNamespace(with_ground=lambda ground: None, file=np.zeros(0)))
    view = inputs_of_regions(
        blocks[1], window, {}, {}, {}, dict(zip(blocks, found, strict=True)), make_recipe()
    )
    assert (view.signs == 3.0).all()
