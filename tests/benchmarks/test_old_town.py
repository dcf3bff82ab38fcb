"""Drawn old towns are the same for a seed, and know which of their ground is level."""

import numpy as np
from benchmarks.accuracy.old_town import simulate_old_town


def test_levels_of_an_old_town_are_level_and_its_scan_knows_them() -> None:
    old = simulate_old_town(0.0225, seed=5)
    assert {level.kind for level in old.levels} == {"terrace", "court"}
    again = simulate_old_town(0.0225, seed=5)
    np.testing.assert_array_equal(old.town.terrain.heights, again.town.terrain.heights)
    nodes = old.town.terrain.nodes().reshape(-1, 2)
    even = [np.ptp(old.town.terrain.at(nodes[level.contains(nodes)])) for level in old.levels]
    assert min(even) < 0.01 and len(old.town.buildings) > 5
