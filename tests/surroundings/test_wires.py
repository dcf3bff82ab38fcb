"""Wires hang in rows over empty air, and their masts stand under them; roofs and crowns do neither."""

from __future__ import annotations

import numpy as np
import pytest

from eaves.model import PointCloud
from eaves.model.cloud import GROUND, UNCLASSIFIED
from eaves.surroundings.wires import find_towers, find_wires

SPAN, MAST = 40.0, 14.0
WIRES, MASTS, CROWN, ROOF = 1, 2, 3, 4


@pytest.fixture(scope="module")
def street() -> tuple[PointCloud, np.ndarray]:
    """Three wires over two spans, their masts, a tree and a roof beside them; and what each point is of."""
    rng = np.random.default_rng(3)
    x = np.arange(0.0, 2 * SPAN, 0.4)
    sag = 0.02 * SPAN * 4.0 * (x % SPAN) / SPAN * (1.0 - (x % SPAN) / SPAN)
    wires = [np.column_stack([x, np.full(len(x), 20.0 + aside), MAST - sag]) for aside in (-2.0, 0.0, 2.0)]
    level = np.arange(0.3, MAST, 0.6)
    masts = [
        np.column_stack([np.full(len(level), east), np.full(len(level), 20.3), level])
        for east in (0.0, SPAN, 2 * SPAN)
    ]
    land = rng.uniform((-5.0, 0.0), (2 * SPAN + 5.0, 45.0), (40_000, 2))
    crown = rng.normal((60.0, 28.0, 6.0), (1.5, 1.5, 1.2), (800, 3))
    roof = np.column_stack([rng.uniform((10.0, 30.0), (45.0, 40.0), (4_000, 2)), np.full(4_000, 7.0)])
    groups = [np.column_stack([land, np.zeros(len(land))]), np.concatenate(wires), np.concatenate(masts)]
    groups += [crown, roof]
    what = np.concatenate([np.full(len(group), number) for number, group in enumerate(groups)])
    xyz = np.concatenate(groups) + rng.normal(0.0, 0.02, (len(what), 3))
    classes = np.where(what == 0, GROUND, UNCLASSIFIED).astype(np.uint8)
    return PointCloud.from_world(xyz, origin=(0.0, 0.0), classification=classes), what


def test_wires_and_masts_are_found_and_nothing_else(street: tuple[PointCloud, np.ndarray]) -> None:
    cloud, what = street
    wires = find_wires(cloud, cloud.xyz[:, 2], 0.3)
    assert wires[what == WIRES].mean() > 0.9
    assert wires[np.isin(what, (0, CROWN, ROOF))].sum() == 0
    towers = find_towers(cloud, wires, what == ROOF, cloud.xyz[:, 2])
    assert towers[what == MASTS].mean() > 0.6
    assert towers[np.isin(what, (0, CROWN, ROOF))].sum() == 0


def test_without_wires_and_in_sparse_scans_there_are_none(street: tuple[PointCloud, np.ndarray]) -> None:
    cloud, what = street
    without = cloud.take(np.flatnonzero(what != WIRES))
    none = find_wires(without, without.xyz[:, 2], 0.3)
    assert not none.any()
    assert not find_towers(without, none, none, without.xyz[:, 2]).any()
    assert not find_wires(cloud, cloud.xyz[:, 2], 0.9).any()
