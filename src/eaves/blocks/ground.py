"""Ground of a block by the ground stage, and what is wider than a block: large raised objects and decks of
bridges, in squares fixed to the world."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eaves.ground import classify_ground
from eaves.ground.stage import numbers_within
from eaves.ground.toolkit.floor import COARSEST_M, Floor
from eaves.ground.toolkit.wide_objects import Patch, WideObjects
from eaves.methods import Emit, ignore
from eaves.model import (
    GRID_STEP,
    GROUND,
    NOISE_CLASSES,
    UNCLASSIFIED,
    Block,
    Bounds,
    Doubt,
    Mask,
    PointCloud,
    Points,
)
from eaves.model.block import extremes, within
from eaves.run.memory import Clock
from eaves.run.points import PointWindow
from eaves.run.store import SECONDS, STARTS, Records
from eaves.surroundings.decks import RULES, Decks, decks_of, look_around

if TYPE_CHECKING:
    from eaves.recipe.recipe import Recipe

EMPTY_RIM = 24 * COARSEST_M
"""Margin (m) around the data that is looked at, as far as decks are followed: more, being empty, changes
nothing."""
DECK_REACH = 4.0 * RULES.widest + COARSEST_M
"""Distance (m) from a square within which large objects decide its decks."""

BlockPoints = tuple[Block, NDArray[np.int32]]


@dataclass(frozen=True, eq=False)
class SquareFloor:
    """A square and the floor of its surroundings, None where no point lies in them."""

    square: Block
    floor: Floor | None


def inputs_of_floors(
    block: Block, points: Mapping[Block, tuple[Records, bool]], parameters: object
) -> BlockPoints:
    """A block with its points (N,), in quanta about its corner; what the file calls noise stays out."""
    records, classified = points[block]
    if classified:
        chosen = np.flatnonzero(~np.isin(records["classification"], NOISE_CLASSES))
        records = records if len(chosen) == len(records) else records.take(chosen)
    return block, records["xyz"]


def find_floor(view: BlockPoints, parameters: object) -> Floor:
    """The floor of a block's points."""
    block, quanta = view
    floor = Floor.empty(stored_extent(quanta, block) or Bounds(*block.origin, *block.origin))
    floor.add(quanta, 1.0, [round(value / GRID_STEP) for value in block.origin])
    return floor


def inputs_of_large(square: Block, floors: Mapping[Block, Floor], parameters: Recipe) -> SquareFloor:
    """A square and the floor of its surroundings, of the floors of the blocks there."""
    pieces = list(floors.values())
    if not pieces:
        return SquareFloor(square, None)
    extent = reduce(Bounds.union, (piece.bounds for piece in pieces))
    window = square.bounds.buffered(parameters.wide_buffer)
    floor = Floor.empty(within(window, extent.buffered(EMPTY_RIM)))  # cost follows the data's area
    for piece in pieces:
        floor.merge(piece)
    return SquareFloor(square, floor)


def find_large(view: SquareFloor, parameters: Recipe) -> tuple[Patch, ...]:
    """Patch of the large objects over the terrain in a square and around it, as far as decks need; empty for
    none."""
    patch = None if view.floor is None else parameters.ground.find_wide_objects(view.floor)
    return () if patch is None else (patch.cropped(view.square.bounds.buffered(DECK_REACH)),)


def inputs_of_decks(
    square: Block, floors: Mapping[Block, Floor], large: Mapping[Block, tuple[Patch, ...]], parameters: Recipe
) -> tuple[Block, tuple[Decks, Mask] | None]:
    """A square and all that decides the decks in it."""
    floor = inputs_of_large(square, floors, parameters).floor
    raised = next(iter(large[square]), None)
    return square, None if floor is None else look_around(floor, square.bounds, raised)


def find_square_decks(view: tuple[Block, tuple[Decks, Mask] | None], parameters: object) -> tuple[Decks, ...]:
    """The decks of bridges in a square."""
    square, around = view
    return () if around is None else (decks_of(*around, square.bounds),)


def large_objects(large: Mapping[Block, tuple[Patch, ...]]) -> WideObjects:
    """The large objects over the terrain in some squares."""
    patches = (patch.cropped(square.bounds) for square in large for patch in large[square])
    return WideObjects(tuple(patches))


def objects_around(block: Block, large: Mapping[Block, tuple[Patch, ...]], recipe: Recipe) -> WideObjects:
    """The large objects that the ground filter sees in a block."""
    bounds = block.bounds.buffered(recipe.ground.buffer)
    patches = large_objects(large).patches
    return WideObjects(tuple(patch.cropped(bounds.buffered(patch.cell)) for patch in patches))


@dataclass(frozen=True, eq=False)
class Surroundings:
    """What is wider than a block, as far as it is seen in it.

    Parameters
    ----------
    block : Block
        The block.
    large : WideObjects or None
        Large objects over the terrain for the ground filter; None where none are looked for.
    beneath : ndarray (K, 3) or None
        The terrain beneath them, about the block's corner.
    doubts : tuple of Doubt
        Those about them, in world metres.
    decks : tuple of Decks
        Of bridges: ground to stand on for the detector, and no terrain.

    Examples
    --------
    >>> import eaves
    >>> eaves.Surroundings(eaves.Block(0, 0)).decks
    ()
    """

    block: Block
    large: WideObjects | None = None
    beneath: Points | None = None
    doubts: tuple[Doubt, ...] = ()
    decks: tuple[Decks, ...] = ()


def surroundings_of(
    block: Block,
    large: Mapping[Block, tuple[Patch, ...]],
    decks: Mapping[Block, tuple[Decks, ...]],
    recipe: Recipe,
) -> Surroundings:
    """What the detector's surroundings of a block show of the large objects and decks of some squares."""
    window = block.bounds.buffered(recipe.scene_buffer)
    beneath, doubts = None, tuple[Doubt, ...]()
    if recipe.sees_wide:
        objects = large_objects(large)
        beneath = objects.terrain_beneath(window.translated(-block.origin[0], -block.origin[1]), block.origin)
        doubts = objects.doubts_in(block.bounds)
    cropped = (deck.cropped(window.buffered(COARSEST_M)) for square in decks for deck in decks[square])
    return Surroundings(block, None, beneath, doubts, tuple(cropped))


def stored_extent(quanta: NDArray[np.int32], block: Block) -> Bounds | None:
    """World metres (half-open) of points (N, 3) in quanta about a block's corner; None for no points."""
    if len(quanta) == 0:
        return None
    low, high = extremes(quanta[:, :2])
    return Bounds(*map(float, (*low * GRID_STEP, *(high + 1) * GRID_STEP))).translated(*block.origin)


@dataclass(frozen=True, eq=False)
class GroundView:
    """All that decides the ground of a block: its points with those around, the numbers (K,) in its files of
    those inside, and the large objects near them."""

    block: Block
    cloud: PointCloud
    number: NDArray[np.int32]
    large: WideObjects | None


def inputs_of_ground(
    block: Block, points: PointWindow, large: Mapping[Block, tuple[Patch, ...]], parameters: Recipe
) -> GroundView:
    """View of a block from which its ground is computed."""
    objects = objects_around(block, large, parameters) if parameters.sees_wide else None
    return GroundView(block, points.cloud, points.inside, objects)


def classify_block(view: GroundView, parameters: Recipe) -> dict[str, NDArray[Any]]:
    """Classes and, where the filter finds them, parts of a block's points, in the order of its files."""
    clock = Clock()
    core = Bounds(0.0, 0.0, view.block.side, view.block.side)
    arrays: dict[str, NDArray[Any]] = {STARTS: np.array(0)}

    def count(name: str, value: Any) -> None:
        if name == parameters.ground.start:
            arrays[STARTS] = np.array(len(value))

    results = classify_inside(view.cloud, core, view.large, parameters, count)
    for name, values in zip(("class", "part"), results, strict=True):
        if values is not None:
            arrays[name] = np.empty_like(values)
            arrays[name][view.number] = values
    clock.lap("ground")
    return arrays | {SECONDS: np.array(clock.laps["ground"])}


def classify_inside(
    cloud: PointCloud, core: Bounds, wide: WideObjects | None, recipe: Recipe, emit: Emit = ignore
) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    """The classes of the points (K,) inside a block, and the parts the filter found on the way."""
    inside = numbers_within(core, cloud.xyz)
    if recipe.use_classes:
        cloud = with_ground_classes(cloud, recipe.ground_classes)
    if len(inside) == 0:
        return np.zeros(0, np.uint8), None
    debug = emit if recipe.ground.start else None
    classified = classify_ground(
        cloud, recipe.ground, use_classes=recipe.use_classes, wide=wide, core=core, debug=debug
    )
    assert classified.classification is not None
    return classified.classification[inside], None if classified.part is None else classified.part[inside]


def with_ground_classes(cloud: PointCloud, numbers: tuple[int, ...]) -> PointCloud:
    """The cloud whose file means ground by these classes: they become 2, and a 2 that is none of them 1."""
    classes_of_file = cloud.classification
    if classes_of_file is None or numbers == (GROUND,):
        return cloud
    classes = np.where(classes_of_file == GROUND, np.uint8(UNCLASSIFIED), classes_of_file)
    classes[np.isin(classes_of_file, numbers)] = GROUND
    return cloud.with_(classification=classes)
