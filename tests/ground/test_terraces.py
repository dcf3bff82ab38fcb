"""Which wide pieces that an opening took are terrain after all."""

from __future__ import annotations

import numpy as np
import pytest

from eaves.ground.adaptive_tin import AdaptiveTin
from eaves.ground.toolkit.seeds import find_terraces
from eaves.model import Mask, Raster
from eaves.raster.interpolate import fill_linear

RULES = AdaptiveTin()
CELL = 1.8
"""Side (m) of cells that hold one point each at 0.3 points/m²."""
PIECE = np.s_[12:28, 12:18]


def surface(occupied: Mask, spur: bool) -> Raster:
    """A plateau of 3 m on level ground, known where `occupied` (H, W); a spur goes on to the west."""
    z = np.zeros(occupied.shape, np.float32)
    z[PIECE] = 3.0
    if spur:
        z[:, :12] = 3.0
    z[~occupied] = np.nan
    return fill_linear(Raster(z, 0.0, 0.0, CELL))


@pytest.mark.parametrize("share", [0.4, 0.65, 1.0])
def test_a_low_roof_steps_down_however_few_of_its_cells_hold_a_point(share: float) -> None:
    """Cells between a roof and the ground that hold no point were interpolated and make a wall a slope.

    Of a spur a sixth of the rim is level, of which few sides are seen in thin data: most draws suffice.
    """
    objects, spurs = np.zeros((40, 40), bool), 0
    objects[PIECE] = True
    for seed in range(20):
        occupied = np.random.default_rng(seed).random((40, 40)) < share
        assert not find_terraces(surface(occupied, False), objects, occupied, RULES)[occupied].any()
        found = find_terraces(surface(occupied, True), objects, occupied, RULES)
        spurs += int((found == objects)[occupied].all())
    assert spurs >= 10


@pytest.mark.parametrize(("side", "level_sides", "terrain"), [(6, 1, False), (6, 2, True), (40, 1, True)])
def test_of_a_small_piece_more_of_the_rim_must_be_level(side: int, level_sides: int, terrain: bool) -> None:
    """A square of 36 m² needs half of its rim, one of 1,600 m² less than a quarter."""
    z = np.zeros((60, 60), np.float32)
    objects = np.zeros((60, 60), bool)
    objects[10 : 10 + side, 10 : 10 + side] = True
    z[objects] = 3.0
    z[10 : 10 + side, :10] = 3.0
    if level_sides == 2:
        z[:10, 10 : 10 + side] = 3.0
    found = find_terraces(Raster(z, 0.0, 0.0, 1.0), objects, np.ones((60, 60), bool), RULES)
    assert (found == (objects & terrain)).all()
