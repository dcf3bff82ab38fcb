"""Buildings that new points only confirm: their outlines and roofs differ nowhere by as much as a change."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy import ndimage
from shapely import Polygon

from eaves.change.measure import TOLERANCE
from eaves.change.verdict import ChangeRules
from eaves.geometry.components import connected_groups_kernel, members
from eaves.geometry.face_table import FaceTable
from eaves.geometry.inside import edges_of, points_in_polygons
from eaves.geometry.overlaps import half_shared
from eaves.geometry.roof_fit import RoofFaces, highest_faces
from eaves.model import BuildingModel, Mask, Points, Values
from eaves.model.building import ROOF_SURFACE

SAMPLE_M = 0.5
"""Roofs are compared at places so far apart (m): a few of them lie in the smallest change."""


def overlapping_groups(
    earlier: Sequence[Polygon], fresh: Sequence[Polygon], blocks: Sequence[str]
) -> Iterator[tuple[list[int], list[int]]]:
    """Numbers of the earlier and of the fresh outlines that have half of either in common, or their detected
    block (one name for each outline, the earlier ones first; "" for none), directly or by others."""
    pairs = [(j, len(earlier) + k) for _, j, k in half_shared(earlier, fresh)]
    first: dict[str, int] = {}
    for number, block in enumerate(blocks):
        if block:
            pairs.append((first.setdefault(block, number), number))
    one, other = np.reshape(np.array(pairs, np.int64), (-1, 2)).T
    group = connected_groups_kernel(one, other, len(earlier) + len(fresh))
    for numbers in members(group, int(group.max(initial=-1)) + 1):
        old = numbers < len(earlier)
        yield numbers[old].tolist(), (numbers[~old] - len(earlier)).tolist()


def is_confirmed(earlier: Sequence[BuildingModel], fresh: Sequence[BuildingModel]) -> bool:
    """True if the models of one group of buildings differ nowhere by as much as `eaves compare` would list.

    Parameters
    ----------
    earlier, fresh : sequence of BuildingModel
        All models of the group, before and now.

    Returns
    -------
    bool
        False where a patch as wide and large as the smallest change lies under the roofs of one of both
        alone, or the roofs over it are farther apart than the tolerance of a comparison. Where walls inside
        the group stand does not count.
    """
    rules = ChangeRules()
    places, shape = samples_over([*earlier, *fresh])
    (old, old_height), (new, new_height) = (roofs_at(models, places) for models in (earlier, fresh))
    with np.errstate(invalid="ignore"):
        differs = (old != new) | (np.abs(old_height - new_height) > TOLERANCE)
    width = int(np.ceil(rules.narrowest / SAMPLE_M))
    patches, _ = ndimage.label(ndimage.binary_opening(differs.reshape(shape), np.ones((width, width))))
    largest = np.bincount(patches.ravel())[1:].max(initial=0)
    return bool(largest * SAMPLE_M**2 < rules.smallest_m2)


def samples_over(models: Sequence[BuildingModel]) -> tuple[Points, tuple[int, int]]:
    """Places (N, 2; world metres) over the outlines of models, row by row, and how many rows and columns."""
    boxes = np.array(
        [model.footprint.polygon.bounds + np.tile(model.footprint.origin, 2) for model in models]
    )
    low = np.floor(boxes[:, :2].min(axis=0) / SAMPLE_M) * SAMPLE_M - SAMPLE_M
    size = np.ceil((boxes[:, 2:].max(axis=0) - low) / SAMPLE_M).astype(int) + 1
    x, y = (low[axis] + (np.arange(size[axis]) + 0.5) * SAMPLE_M for axis in (0, 1))
    east, north = np.meshgrid(x, y)
    return np.column_stack([east.ravel(), north.ravel()]), (len(y), len(x))


def roofs_at(models: Sequence[BuildingModel], places: Points) -> tuple[Mask, Values]:
    """Which places (N, 2; world metres) lie in an outline, and the height of the roof there (N,), NaN where
    there is none."""
    inside, heights = np.zeros(len(places), bool), np.full(len(places), np.nan)
    for model in models:
        local = places - model.footprint.origin
        within, _ = points_in_polygons(local, *edges_of(np.array([model.footprint.polygon], object)), 1)
        inside[within] = True
        faces = RoofFaces.of(FaceTable.of_solids(model.solids.get(model.lod, ()), ROOF_SURFACE))
        if len(faces.polygons):
            _, height = highest_faces(local[within], *edges_of(faces.polygons), faces.coefficients)
            heights[within] = np.fmax(heights[within], height)
    return inside, heights
