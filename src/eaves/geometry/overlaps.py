"""Polygons of two sets that stand for each other, by the area in common."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TypeVar

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

One = TypeVar("One")
Other = TypeVar("Other")

HALF = 0.5
"""Polygons are at one place that share this part of either."""


def half_shared(ones: Sequence[BaseGeometry], others: Sequence[BaseGeometry]) -> list[tuple[float, int, int]]:
    """Area (m²) in common, and the numbers in both sets, of polygons at one place."""
    first, second = np.array([*ones], object), np.array([*others], object)
    if not len(first) or not len(second):
        return []
    j, i = shapely.STRtree(first).query(second)
    least = np.minimum(shapely.area(first)[i], shapely.area(second)[j])
    low, high = np.split(np.stack([shapely.bounds(first)[i], shapely.bounds(second)[j]]), 2, axis=2)
    boxes = np.prod(np.maximum(high.min(axis=0) - low.max(axis=0), 0.0), axis=1)
    near = boxes >= HALF * least  # neighbours that touch are many, and to cut them takes long
    i, j, least = i[near], j[near], least[near]
    shared = shapely.area(shapely.intersection(first[i], second[j]))
    large = (shared > 0) & (shared >= HALF * least)
    return list(zip(shared[large].tolist(), i[large].tolist(), j[large].tolist(), strict=True))


def pair_off(
    ranked: Iterable[tuple[One, Other]], known: Mapping[One, Other] | None = None
) -> dict[One, Other]:
    """Pairs, the best first, of which each of either set is in one at most; beside those `known`."""
    pairs = dict(known or {})
    partners = set(pairs.values())
    for item, partner in ranked:
        if item not in pairs and partner not in partners:
            pairs[item] = partner
            partners.add(partner)
    return pairs
