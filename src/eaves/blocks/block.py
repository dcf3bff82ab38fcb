"""The block pass: rasters and regions of one block."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from eaves.blocks.block_file import save_block
from eaves.blocks.wide import load_decks, load_wide
from eaves.detect import detect_buildings
from eaves.ground.toolkit.doubts import doubts_within
from eaves.ground.toolkit.floor import COARSEST_M
from eaves.ground.toolkit.wide_objects import WideObjects
from eaves.model import Block, Bounds, Mask, PointCloud, Raster, Regions
from eaves.model.block import SEAM
from eaves.model.cloud import BRIDGE_DECK, GROUND, HIGH_NOISE, WIRE, WIRE_TOWER
from eaves.model.doubt import Doubt
from eaves.model.results import BlockResult
from eaves.model.scene import Scene
from eaves.raster.surfaces import scene_of, two_scenes
from eaves.run.clock import Clock
from eaves.run.keys import BLOCKS
from eaves.run.keys import GROUND as GROUND_STEP
from eaves.run.store import SECONDS, Store, Task
from eaves.surroundings.decks import Decks, wet_or_bridged
from eaves.surroundings.vegetation import vegetation_classes
from eaves.surroundings.wires import find_towers, find_wires

if TYPE_CHECKING:
    from eaves.recipe.recipe import Recipe


def block_pass(
    cloud: PointCloud,
    block: Block,
    recipe: Recipe,
    wide: WideObjects | None = None,
    decks: Sequence[Decks] = (),
) -> BlockResult:
    """Rasters and regions of one block.

    `cloud` bears the classes of the ground stage. It must hold the points of the block and of its
    surroundings up to `recipe.scene_buffer`, and no others: then the result does not depend on the files or
    tiles they came from. `wide` is what stands over the terrain, where that was looked for. `decks` are
    those of bridges: ground to stand on for the detector, and no terrain.
    """
    clock = Clock()
    core = Bounds(0.0, 0.0, block.side, block.side)
    seen = core.buffered(recipe.scene_buffer)
    scene, on_decks, wires = see_block(cloud, block, recipe, wide, decks)
    cloud = scene.cloud
    clock.lap("rasters")
    nothing = Regions(np.zeros(len(cloud), np.int32))
    regions = detect_buildings(on_decks, recipe.detect) if recipe.detect else nothing
    clock.lap("detect")

    inside = np.flatnonzero(core.contains(cloud.xyz))
    labelled = np.flatnonzero(regions.label > 0)
    place = cloud.xyz.take(labelled, axis=0)
    seam = labelled[core.buffered(SEAM).contains(place) & ~core.buffered(-SEAM).contains(place)]
    part = regions.part if regions.part is not None else np.zeros(len(cloud), np.uint8)
    vegetation = np.zeros(len(cloud), np.uint8)
    if recipe.marks_vegetation and recipe.vegetation is not None:
        vegetation = vegetation_classes(
            cloud, regions.label, regions.part, on_decks.height, recipe.vegetation
        )
    vegetation[wires] = WIRE
    vegetation[find_towers(cloud, wires, regions.label > 0, on_decks.height)] = WIRE_TOWER
    assert cloud.classification is not None and cloud.point_id is not None
    return BlockResult(
        block=block,
        xyz=cloud.xyz.take(inside, axis=0),
        point_id=cloud.point_id[inside],
        classification=cloud.classification[inside],
        label=regions.label[inside],
        part=part[inside],
        vegetation=vegetation[inside],
        height=scene.height[inside].astype(np.float32),
        score=np.round(regions.score, 3),
        dtm=crop(scene.dtm, seen.buffered(-recipe.scene_buffer)),
        dsm=crop(scene.dsm, seen.buffered(-recipe.scene_buffer)),
        spacing=scene.spacing,
        seam_id=cloud.point_id[seam],
        seam_label=regions.label[seam],
        doubts=(
            *(doubt.translated(*block.origin) for doubt in regions.doubts if holds(core, doubt)),
            *doubts_within(cloud, block.bounds),
            *(() if wide is None else wide.doubts_in(block.bounds)),
            *(doubt for one in decks for doubt in one.cropped(block.bounds).doubts),
        ),
        seconds=clock.laps,
        keeps_low=recipe.keeps_low,
    )


def keep_block(task: Task, store: Store, recipe: Recipe) -> None:
    """The block pass for one block, kept in the store."""
    block = task.unit
    cloud, wide, decks, number = load_block(block, store, recipe)
    seen = block.bounds.buffered(recipe.scene_buffer)
    beneath: list[object] = [one.cropped(seen.buffered(COARSEST_M)) for one in decks]
    if wide is not None:
        local = seen.translated(-block.origin[0], -block.origin[1])
        beneath += [wide.terrain_beneath(local, block.origin), wide.doubts_in(block.bounds)]
    taken = store.key_of(BLOCKS.key(recipe, store.system), cloud, beneath)
    if store.recalls(BLOCKS, block, task.read, taken):
        return
    result = block_pass(cloud, block, recipe, wide, decks)
    result.seconds["ground"] = float(store.array(GROUND_STEP, block, SECONDS))
    save_block(store, result, number, task.read, taken)


def load_block(
    block: Block, store: Store, recipe: Recipe
) -> tuple[PointCloud, WideObjects | None, tuple[Decks, ...], NDArray[np.int32]]:
    """The points, the wide objects and the decks that `block_pass` takes, from the store, and the numbers of
    the block's points in its files."""
    seen = block.bounds.buffered(recipe.scene_buffer)
    wide = load_wide(store, seen) if recipe.sees_wide else None
    decks = load_decks(store, seen) if recipe.sees_wide and recipe.marks_others else ()
    cloud, number = store.load_points(block, recipe.scene_buffer, classified=True)
    return cloud, wide, decks, number


def see_block(
    cloud: PointCloud,
    block: Block,
    recipe: Recipe,
    wide: WideObjects | None = None,
    decks: Sequence[Decks] = (),
) -> tuple[Scene, Scene, Mask]:
    """The scene of a block; the one that the detector sees, on the decks of bridges and without wires; the
    points (N,) of wires.

    The arguments are those of `block_pass`.
    """
    cloud = cloud.about(block.origin).in_canonical_order()
    seen = Bounds(0.0, 0.0, block.side, block.side).buffered(recipe.scene_buffer)
    beneath = None if wide is None else wide.terrain_beneath(seen, block.origin)
    other = wet_or_bridged(cloud, decks)
    on_deck = other == BRIDGE_DECK
    cloud = with_classes(cloud, other)
    if on_deck.any() and recipe.detect:
        stood = with_classes(cloud, np.where(on_deck, np.uint8(GROUND), np.uint8(0)))
        scene, on_decks = two_scenes(cloud, stood, seen, beneath=beneath)
    else:
        scene = on_decks = scene_of(cloud, seen, beneath=beneath)
    wires = np.zeros(len(cloud), bool)
    if recipe.marks_others:
        wires = find_wires(cloud, scene.height, scene.spacing)
        hidden = with_classes(on_decks.cloud, np.where(wires, np.uint8(HIGH_NOISE), np.uint8(0)))
        on_decks = replace(on_decks, cloud=hidden)
    return scene, on_decks, wires


def with_classes(cloud: PointCloud, classes: NDArray[np.uint8]) -> PointCloud:
    """The cloud with the classes (N,) given that are not 0, but for noise."""
    assert cloud.classification is not None
    given = (classes > 0) & ~cloud.noise
    return (
        cloud.with_(classification=np.where(given, classes, cloud.classification)) if given.any() else cloud
    )


def holds(bounds: Bounds, doubt: Doubt) -> bool:
    """Whether a doubt lies within bounds: of neighbouring blocks only one has it."""
    return bool(bounds.contains(np.array([[doubt.x, doubt.y]]))[0])


def crop(raster: Raster, bounds: Bounds) -> Raster:
    """The cells of a raster inside `bounds`, which run along cell borders."""
    first_column = round((bounds.west - raster.west) / raster.cell)
    first_row = round((raster.north - bounds.north) / raster.cell)
    columns, rows = round(bounds.width / raster.cell), round(bounds.height / raster.cell)
    values = raster.values[first_row : first_row + rows, first_column : first_column + columns]
    return Raster(values.copy(), bounds.west, bounds.north, raster.cell)
