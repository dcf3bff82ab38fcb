"""Connected groups, against scipy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from eaves.geometry.inside import connected_groups_kernel


@pytest.mark.parametrize("edges", [0, 1, 30, 60, 200])
def test_groups_are_numbered_by_their_first_nodes(edges: int) -> None:
    one, other = np.random.default_rng(edges).integers(0, 60, (2, edges))
    group = connected_groups_kernel(one, other, 60)
    _, expected = connected_components(coo_matrix((np.ones(edges), (one, other)), shape=(60, 60)), False)
    assert group.tolist() == expected.tolist()
    first = np.unique(group, return_index=True)[1]
    assert np.all(np.diff(first) > 0)


def test_no_nodes_have_no_groups() -> None:
    none = np.zeros(0, np.int64)
    assert len(connected_groups_kernel(none, none, 0)) == 0
