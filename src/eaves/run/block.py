"""The block pass: ground, rasters and regions of one block."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from eaves.detect import detect_buildings
from eaves.ground import classify_ground
from eaves.ground.toolkit.wide_objects import WideObjects
from eaves.model import Block, Bounds, Mask, PointCloud, Raster, Regions
from eaves.model.cloud import BRIDGE_DECK, GROUND, UNCLASSIFIED
from eaves.model.doubt import Doubt
from eaves.model.results import BlockResult
from eaves.raster.surfaces import scene_of
from eaves.run.clock import Clock
from eaves.run.decks import Decks, wet_or_bridged
from eaves.run.recipe import SEAM, Recipe
from eaves.run.vegetation import vegetation_classes


def block_pass(
    cloud: PointCloud,
    block: Block,
    recipe: Recipe,
    wide: WideObjects | None = None,
    decks: Sequence[Decks] = (),
) -> BlockResult:
    """Ground, rasters and regions of one block.

    `cloud` must hold the points of the block and of its surroundings up to `recipe.buffer`, and no others:
    then the result does not depend on the files or tiles they came from. `wide` is what a look at more than
    them has found; by default it is looked for in the cloud. `decks` are those of bridges: ground to
    stand on for the detector, and no terrain.
    """
    clock = Clock()
    cloud = cloud.about(block.origin).in_canonical_order()
    if recipe.use_classes:
        cloud = with_ground_classes(cloud, recipe.ground_classes)
    cloud = classify_ground(cloud, recipe.ground, use_classes=recipe.use_classes, wide=wide)
    clock.lap("ground")
    core = Bounds(0.0, 0.0, block.side, block.side)
    seen = core.buffered(recipe.scene_buffer)
    cloud = cloud.take(seen.contains(cloud.xyz))
    beneath = None if wide is None else wide.terrain_beneath(seen, block.origin)
    other = wet_or_bridged(cloud, decks)
    on_deck = other == BRIDGE_DECK
    cloud = with_classes(cloud, other)
    scene = scene_of(cloud, seen, beneath=beneath)
    clock.lap("rasters")
    nothing = Regions(np.zeros(len(cloud), np.int32))
    trodden = scene
    if on_deck.any() and recipe.detect:
        trodden = scene_of(
            with_classes(cloud, np.where(on_deck, np.uint8(GROUND), np.uint8(0))), seen, beneath=beneath
        )
    regions = detect_buildings(trodden, recipe.detect) if recipe.detect else nothing
    clock.lap("detect")

    inside = core.contains(cloud.xyz)
    labelled = np.flatnonzero(regions.label > 0)
    place = cloud.xyz.take(labelled, axis=0)
    seam = labelled[core.buffered(SEAM).contains(place) & ~core.buffered(-SEAM).contains(place)]
    part = regions.part if regions.part is not None else np.zeros(len(cloud), np.uint8)
    vegetation = np.zeros(len(cloud), np.uint8)
    if recipe.marks_vegetation and recipe.vegetation is not None:
        vegetation = vegetation_classes(cloud, regions.label, regions.part, trodden.height, recipe.vegetation)
    assert cloud.classification is not None and cloud.point_id is not None
    return BlockResult(
        block=block,
        xyz=cloud.xyz[inside],
        point_id=cloud.point_id[inside],
        classification=cloud.classification[inside],
        label=regions.label[inside],
        part=part[inside],
        not_last=not_last(cloud)[inside],
        vegetation=vegetation[inside],
        height=scene.height[inside].astype(np.float32),
        score=regions.score,
        dtm=crop(scene.dtm, core),
        dsm=crop(scene.dsm, core),
        spacing=scene.spacing,
        seam_id=cloud.point_id[seam],
        seam_label=regions.label[seam],
        doubts=(
            *(doubt.translated(*block.origin) for doubt in regions.doubts if holds(core, doubt)),
            *(() if wide is None else wide.doubts_in(block.bounds)),
            *(doubt for one in decks for doubt in one.cropped(block.bounds).doubts),
        ),
        seconds=clock.laps,
    )


def with_classes(cloud: PointCloud, classes: NDArray[np.uint8]) -> PointCloud:
    """The cloud with the classes (N,) given that are not 0, but for noise."""
    assert cloud.classification is not None
    given = (classes > 0) & ~cloud.noise
    return (
        cloud.with_(classification=np.where(given, classes, cloud.classification)) if given.any() else cloud
    )


def with_ground_classes(cloud: PointCloud, numbers: tuple[int, ...]) -> PointCloud:
    """The cloud whose file means ground by these classes: they become 2, and a 2 that is none of them 1."""
    given = cloud.classification
    if given is None or numbers == (GROUND,):
        return cloud
    classes = np.where(given == GROUND, np.uint8(UNCLASSIFIED), given)
    classes[np.isin(given, numbers)] = GROUND
    return cloud.with_(classification=classes)


def holds(bounds: Bounds, doubt: Doubt) -> bool:
    """Whether a doubt lies within bounds: of neighbouring blocks only one has it."""
    return bool(bounds.contains(np.array([[doubt.x, doubt.y]]))[0])


def not_last(cloud: PointCloud) -> Mask:
    """The points (N,) whose pulses came back once more from below; none where the scan does not say."""
    if cloud.return_number is None or cloud.number_of_returns is None:
        return np.zeros(len(cloud), bool)
    return np.asarray(cloud.return_number < cloud.number_of_returns)


def crop(raster: Raster, bounds: Bounds) -> Raster:
    """The cells of a raster inside `bounds`, which run along cell borders."""
    first_column = round((bounds.west - raster.west) / raster.cell)
    first_row = round((raster.north - bounds.north) / raster.cell)
    columns, rows = round(bounds.width / raster.cell), round(bounds.height / raster.cell)
    values = raster.values[first_row : first_row + rows, first_column : first_column + columns]
    return Raster(values.copy(), bounds.west, bounds.north, raster.cell)
