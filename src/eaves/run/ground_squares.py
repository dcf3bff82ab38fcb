"""The ground pass: classes of the ground stage, found in squares fixed to the world.

A block may have any size, and what its ground is must not follow from it: the spacing, the roughness and the
way the terrain goes on at a rim are measured in what a filter sees. So a filter always sees a square of
`GROUND_SQUARE` with its buffer, and a block takes the classes of the squares that it meets.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from eaves.ground import classify_ground
from eaves.model import Block, Bounds, PointCloud
from eaves.model.cloud import GROUND, UNCLASSIFIED
from eaves.run.clock import Clock
from eaves.run.recipe import Recipe
from eaves.run.store import GroundPiece, Store
from eaves.run.wide import load_wide
from eaves.run.world_squares import GROUND_SQUARE, WIDE_SQUARE, around_squares

Numbers = NDArray[np.int64]


def seen_from(bounds: Bounds, recipe: Recipe) -> Bounds:
    """World metres of the points that decide the ground within `bounds`."""
    near = around_squares(bounds, GROUND_SQUARE).buffered(recipe.ground.buffer)
    if not recipe.sees_wide:
        return near
    return around_squares(near, WIDE_SQUARE).buffered(recipe.ground.wide_buffer)


def group_squares(squares: Sequence[Block], side: float) -> list[list[Block]]:
    """The squares that are loaded at once: those with their corner in one block of a side (m)."""
    groups: dict[Block, list[Block]] = {}
    for square in squares:
        groups.setdefault(Block.at(*square.origin, side) if side > GROUND_SQUARE else square, []).append(
            square
        )
    return list(groups.values())


def classify_squares(squares: Sequence[Block], store: Store, recipe: Recipe, side: float) -> None:
    """The ground stage for the points in some squares, kept in the store; `side` is that of the blocks."""
    reach = recipe.ground.buffer
    seen = squares[0].bounds.buffered(reach)
    for square in squares[1:]:
        seen = seen.union(square.bounds.buffered(reach))
    cloud, pieces = store.load_points(seen, squares[0].origin, side)
    cloud = cloud.with_(point_id=None)
    ends = np.cumsum([0, *(len(piece.which) for piece in pieces)])
    for row in sorted({square.row for square in squares}):
        line = [square for square in squares if square.row == row]
        low, high = line[0].bounds.south - reach, line[0].bounds.north + reach
        strip = points_in(cloud, Bounds(seen.west, low, seen.east, high)) if len(squares) > 1 else None
        for square in line:
            clock = Clock()
            near = np.arange(len(cloud))
            if len(squares) > 1:
                near = points_in(cloud, square.bounds.buffered(reach), strip)
            some = cloud if len(near) == len(cloud) else cloud.take(near)
            inside, classes, part = classify_square(some, square, store, recipe)
            inner, first = near[inside], np.searchsorted(near[inside], ends)
            ground = [
                GroundPiece(
                    piece.block,
                    piece.which[inner[start:end] - offset],
                    classes[start:end],
                    None if part is None else part[start:end],
                )
                for piece, offset, start, end in zip(pieces, ends[:-1], first[:-1], first[1:], strict=True)
                if end > start
            ]
            clock.lap("ground")
            store.save_ground(square, ground, {"seconds": clock.laps["ground"]})


def classify_square(
    cloud: PointCloud, square: Block, store: Store, recipe: Recipe
) -> tuple[Numbers, NDArray[np.uint8], NDArray[np.uint8] | None]:
    """Numbers (K,) of the points in the square, their classes, and the parts the filter found on the way.

    `cloud` holds the points of the square and of its surroundings up to the method's buffer, and no others.
    """
    cloud = cloud.about(square.origin)
    if recipe.use_classes:
        cloud = with_ground_classes(cloud, recipe.ground_classes)
    wide = load_wide(store, square.bounds.buffered(recipe.ground.buffer)) if recipe.sees_wide else None
    inside = np.flatnonzero(Bounds(0.0, 0.0, square.side, square.side).contains(cloud.xyz))
    if len(inside) == 0:
        return inside, np.zeros(0, np.uint8), None
    found = classify_ground(cloud, recipe.ground, use_classes=recipe.use_classes, wide=wide)
    assert found.classification is not None
    return inside, found.classification[inside], None if found.part is None else found.part[inside]


def points_in(cloud: PointCloud, bounds: Bounds, among: Numbers | None = None) -> Numbers:
    """Numbers (K,) of the points within `bounds`, world metres, out of some (M,)."""
    local = bounds.translated(-cloud.origin[0], -cloud.origin[1])
    if among is None:
        return np.flatnonzero(local.contains(cloud.xyz))
    return np.asarray(among[local.contains(cloud.xyz[among])])


def with_ground_classes(cloud: PointCloud, numbers: tuple[int, ...]) -> PointCloud:
    """The cloud whose file means ground by these classes: they become 2, and a 2 that is none of them 1."""
    given = cloud.classification
    if given is None or numbers == (GROUND,):
        return cloud
    classes = np.where(given == GROUND, np.uint8(UNCLASSIFIED), given)
    classes[np.isin(given, numbers)] = GROUND
    return cloud.with_(classification=classes)
