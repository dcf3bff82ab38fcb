"""Cells of ground alone among objects: those on walls and in holes go, those in courtyards stay."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from eaves.ground.adaptive_tin import AdaptiveTin
from eaves.ground.toolkit.islands import find_islands, others_kernel
from eaves.model import Raster

RULES = AdaptiveTin()


def islands_at(height: float, roof: float, cells: int = 1) -> list[list[int]]:
    """What is found in a roof with a gap of some cells, on terrain that rises by 0.1."""
    rows, columns = np.indices((24, 24))
    z = 0.1 * columns.astype(np.float32)
    objects = (np.abs(rows - 12) <= 4) & (np.abs(columns - 12) <= 4)
    z[objects] += roof
    objects[12, 12 : 12 + cells] = False
    z[12, 12 : 12 + cells] = 1.2 + height
    slope = np.full(z.shape, 0.1, np.float32)
    found = find_islands(Raster(z, 0.0, 24.0, 1.0), slope, ~objects, np.ones(z.shape, bool), RULES)
    return np.argwhere(found).tolist()


def test_echo_from_inside_a_building_goes() -> None:
    assert islands_at(1.5, 7.0) == [[12, 12]]


def test_hole_under_a_building_goes() -> None:
    assert islands_at(-6.0, 7.0) == [[12, 12]]


def test_ground_between_roofs_or_crowns_stays() -> None:
    assert islands_at(0.2, 7.0) == []


def test_rise_with_nothing_high_beside_it_stays() -> None:
    assert islands_at(1.5, 2.0) == []


def test_wide_gap_stays_whatever_its_height() -> None:
    assert islands_at(1.5, 7.0, cells=4) == []


def test_others_are_the_nearest_cells_of_other_islands__ties_by_number() -> None:
    ground = np.random.default_rng(5).random((40, 50)) < 0.08
    island = np.asarray(ndimage.label(ground, np.ones((3, 3)))[0], np.int32)
    rows, columns = np.nonzero(ground)
    found = others_kernel(island, rows, columns, 12)
    number = rows * 50 + columns
    for i in range(len(rows)):
        other = island[rows, columns] != island[rows[i], columns[i]]
        away = (rows - rows[i]) ** 2 + (columns - columns[i]) ** 2
        assert found[i].tolist() == number[other][np.lexsort((number[other], away[other]))][:12].tolist()
