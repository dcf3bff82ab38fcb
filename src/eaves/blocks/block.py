"""The block pass: rasters and regions of one block."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eaves.blocks.block_file import block_arrays
from eaves.blocks.ground import large_objects
from eaves.detect import detect_buildings
from eaves.ground.toolkit.doubts import doubts_within
from eaves.ground.toolkit.floor import COARSEST_M
from eaves.ground.toolkit.wide_objects import Patch
from eaves.model import (
    BRIDGE_DECK,
    GROUND,
    HIGH_NOISE,
    SEAM,
    WIRE,
    WIRE_TOWER,
    Block,
    Bounds,
    Doubt,
    Mask,
    PointCloud,
    Points,
    Raster,
    Regions,
    Scene,
)
from eaves.model.results import BlockResult
from eaves.raster.surfaces import scene_of, two_scenes
from eaves.run.clock import Clock
from eaves.run.points import PointWindow
from eaves.surroundings.decks import Decks, wet_or_bridged
from eaves.surroundings.vegetation import vegetation_classes
from eaves.surroundings.wires import find_towers, find_wires

if TYPE_CHECKING:
    from eaves.recipe.recipe import Recipe


def block_pass(
    cloud: PointCloud,
    block: Block,
    recipe: Recipe,
    beneath: Points | None = None,
    doubts: Sequence[Doubt] = (),
    decks: Sequence[Decks] = (),
) -> BlockResult:
    """Rasters and regions of one block.

    `cloud` bears the classes of the ground stage. It must hold the points of the block and of its
    surroundings up to `recipe.scene_buffer`, and no others: then the result does not depend on the files or
    tiles they came from. `beneath` is the terrain (K, 3) beneath large objects, where these were looked for,
    and `doubts` are those about them. `decks` are those of bridges: ground to stand on for the detector, and
    no terrain.
    """
    clock = Clock()
    core = Bounds(0.0, 0.0, block.side, block.side)
    window = core.buffered(recipe.scene_buffer)
    scene, on_decks, wires = see_block(cloud, block, recipe, beneath, decks)
    cloud = scene.cloud
    clock.lap("rasters")
    regions, (area, height) = Regions(np.zeros(len(cloud), np.int32)), recipe.smallest
    if recipe.detect is not None:
        regions = detect_buildings(on_decks, recipe.detect, min_area=area, min_height=height)
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
        dtm=crop(scene.dtm, window.buffered(-recipe.scene_buffer)),
        dsm=crop(scene.dsm, window.buffered(-recipe.scene_buffer)),
        spacing=scene.spacing,
        seam_id=cloud.point_id[seam],
        seam_label=regions.label[seam],
        doubts=(
            *(doubt.translated(*block.origin) for doubt in regions.doubts if holds(core, doubt)),
            *doubts_within(cloud, block.bounds),
            *doubts,
            *(doubt for deck in decks for doubt in deck.cropped(block.bounds).doubts),
        ),
        seconds=clock.laps,
        keeps_low=recipe.keeps_low,
    )


@dataclass(frozen=True, eq=False)
class BlockView:
    """All that decides the rasters and regions of a block: its points with those around, with classes; the
    file (K,) of each of those inside, where there are several; the terrain (M, 3) beneath large objects,
    their doubts in the block, and decks near it."""

    block: Block
    cloud: PointCloud
    file: NDArray[Any]
    beneath: Points | None
    doubts: tuple[Doubt, ...]
    decks: tuple[Decks, ...]


def see_regions(
    block: Block,
    points: PointWindow,
    ground: Mapping[Block, Mapping[str, NDArray[np.uint8]]],
    large: Mapping[Block, tuple[Patch, ...]],
    decks: Mapping[Block, tuple[Decks, ...]],
    parameters: Any,
) -> BlockView:
    """View of a block from which its rasters and regions are computed."""
    window = block.bounds.buffered(parameters.scene_buffer)
    beneath, doubts = None, tuple[Doubt, ...]()
    if parameters.sees_wide:
        objects = large_objects(large)
        beneath = objects.terrain_beneath(window.translated(-block.origin[0], -block.origin[1]), block.origin)
        doubts = objects.doubts_in(block.bounds)
    cropped_decks = tuple(
        deck.cropped(window.buffered(COARSEST_M)) for square in decks for deck in decks[square]
    )
    return BlockView(block, points.with_ground(ground), points.file, beneath, doubts, cropped_decks)


def find_regions(view: BlockView, parameters: Any) -> dict[str, NDArray[Any]]:
    """Rasters and regions of a block, as `BlockFile` reads them."""
    result = block_pass(view.cloud, view.block, parameters, view.beneath, view.doubts, view.decks)
    return block_arrays(result) | {"from_file": view.file}


def see_block(
    cloud: PointCloud,
    block: Block,
    recipe: Recipe,
    beneath: Points | None = None,
    decks: Sequence[Decks] = (),
) -> tuple[Scene, Scene, Mask]:
    """The scene of a block; the one that the detector sees, on the decks of bridges and without wires; the
    points (N,) of wires.

    The arguments are those of `block_pass`.
    """
    cloud = cloud.about(block.origin).in_canonical_order()
    window = Bounds(0.0, 0.0, block.side, block.side).buffered(recipe.scene_buffer)
    wet = wet_or_bridged(cloud, decks)
    on_deck = wet == BRIDGE_DECK
    cloud = with_classes(cloud, wet)
    if on_deck.any() and recipe.detect:
        stood = with_classes(cloud, np.where(on_deck, np.uint8(GROUND), np.uint8(0)))
        scene, on_decks = two_scenes(cloud, stood, window, beneath=beneath)
    else:
        scene = on_decks = scene_of(cloud, window, beneath=beneath)
    wires = np.zeros(len(cloud), bool)
    if recipe.marks_others:
        wires = find_wires(cloud, scene.height, scene.spacing)
        hidden = with_classes(on_decks.cloud, np.where(wires, np.uint8(HIGH_NOISE), np.uint8(0)))
        on_decks = replace(on_decks, cloud=hidden)
    return scene, on_decks, wires


def with_classes(cloud: PointCloud, classes: NDArray[np.uint8]) -> PointCloud:
    """The cloud with the classes (N,) given that are not 0, but for noise."""
    assert cloud.classification is not None
    labelled = (classes > 0) & ~cloud.noise
    return (
        cloud.with_(classification=np.where(labelled, classes, cloud.classification))
        if labelled.any()
        else cloud
    )


def holds(bounds: Bounds, doubt: Doubt) -> bool:
    """True if a doubt lies within bounds: of neighbouring blocks only one has it."""
    return bool(bounds.contains(np.array([[doubt.x, doubt.y]]))[0])


def crop(raster: Raster, bounds: Bounds) -> Raster:
    """The cells of a raster inside `bounds`, which run along cell borders."""
    first_column = round((bounds.west - raster.west) / raster.cell)
    first_row = round((raster.north - bounds.north) / raster.cell)
    columns, rows = round(bounds.width / raster.cell), round(bounds.height / raster.cell)
    values = raster.values[first_row : first_row + rows, first_column : first_column + columns]
    return Raster(values.copy(), bounds.west, bounds.north, raster.cell)
