"""The block pass: rasters and regions of one block."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eaves.blocks.block_file import block_arrays
from eaves.blocks.ground import Surroundings, surroundings_of
from eaves.detect import detect_buildings
from eaves.ground.toolkit.floor import doubts_within
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
    Raster,
    Regions,
    Scene,
)
from eaves.model.checks import check_type
from eaves.model.results import BlockResult
from eaves.raster.surfaces import scene_of, two_scenes
from eaves.run.memory import Clock
from eaves.run.points import PointWindow
from eaves.surroundings.decks import Decks, wet_or_bridged
from eaves.surroundings.wires import find_towers, find_wires, vegetation_classes

if TYPE_CHECKING:
    from eaves.recipe.recipe import Recipe


class BlockScenes(NamedTuple):
    """The points of a block over its terrain, once as they are and once as the detector sees them.

    Parameters
    ----------
    block : Block
        The block.
    scene : Scene
        The points with water, decks of bridges and what lies beneath large objects.
    seen : Scene
        The same points as a detector sees them: on the decks of bridges, and without wires.
    wires : ndarray (N,) of bool
        The points of wires.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> recipe = eaves.make_recipe()
    >>> cloud = eaves.prepare_points(nine_roofs_on_a_slope(density=1.0).cloud)
    >>> around = eaves.find_surroundings(cloud, recipe)
    >>> int(eaves.make_scenes(eaves.classify_ground(cloud), around, recipe).wires.sum())
    0
    """

    block: Block
    scene: Scene
    seen: Scene
    wires: Mask


def block_pass(
    cloud: PointCloud,
    around: Surroundings,
    recipe: Recipe,
    signs: NDArray[np.float64] | None = None,
    classes_only: bool = False,
    known: Mapping[str, NDArray[Any]] | None = None,
) -> BlockResult:
    """Rasters and regions of one block; with `classes_only` neither. Scenes are `known` where the detector
    counted in them.

    `cloud` bears the classes of the ground stage. It must hold the points of the block and of its
    surroundings up to `recipe.scene_buffer`, and no others: then the result does not depend on the files or
    tiles they came from. `signs` are those that the detector counted around it.
    """
    clock = Clock()
    if known is not None:
        scenes = known_scenes(cloud, around.block, known)
    else:
        scenes = points_alone(cloud, around.block) if classes_only else make_scenes(cloud, around, recipe)
    cloud, height = scenes.scene.cloud, scenes.seen.height
    clock.lap("rasters")
    regions, (least_area, least_height) = Regions(np.zeros(len(cloud), np.int32)), recipe.smallest
    if recipe.detect is not None:
        regions = detect_buildings(
            replace(scenes.seen, signs=signs), recipe.detect, min_area=least_area, min_height=least_height
        )
    clock.lap("detect")
    vegetation = np.zeros(len(cloud), np.uint8)
    if recipe.marks_vegetation and recipe.vegetation is not None:
        vegetation = vegetation_classes(cloud, regions.label, regions.part, height, recipe.vegetation)
    vegetation[scenes.wires] = WIRE
    vegetation[find_towers(cloud, scenes.wires, regions.label > 0, height)] = WIRE_TOWER
    result = block_result(scenes, regions, recipe, vegetation)
    core, bounds = Bounds(0.0, 0.0, around.block.side, around.block.side), around.block.bounds
    doubts = (
        *(doubt.translated(*around.block.origin) for doubt in regions.doubts if holds(core, doubt)),
        *doubts_within(cloud, bounds),
        *around.doubts,
        *(doubt for deck in around.decks for doubt in deck.cropped(bounds).doubts),
    )
    return replace(result, doubts=doubts, seconds=clock.laps)


def block_result(
    scenes: BlockScenes, regions: Regions, recipe: Recipe, vegetation: NDArray[np.uint8] | None = None
) -> BlockResult:
    """What a block keeps of its scenes and the regions that were detected in them, without doubts."""
    block, cloud = scenes.block, scenes.scene.cloud
    core = Bounds(0.0, 0.0, block.side, block.side)
    window = core.buffered(recipe.scene_buffer)
    inside = np.flatnonzero(core.contains(cloud.xyz))
    labelled = np.flatnonzero(regions.label > 0)
    place = cloud.xyz.take(labelled, axis=0)
    seam = labelled[core.buffered(SEAM).contains(place) & ~core.buffered(-SEAM).contains(place)]
    nothing = np.zeros(len(cloud), np.uint8)
    part = nothing if regions.part is None else regions.part
    assert cloud.classification is not None and cloud.point_id is not None
    return BlockResult(
        block=block,
        xyz=cloud.xyz.take(inside, axis=0),
        point_id=cloud.point_id[inside],
        classification=cloud.classification[inside],
        label=regions.label[inside],
        part=part[inside],
        vegetation=(nothing if vegetation is None else vegetation)[inside],
        height=scenes.scene.height[inside].astype(np.float32),
        score=np.round(regions.score, 3),
        dtm=crop(scenes.scene.dtm, window.buffered(-recipe.scene_buffer)),
        dsm=crop(scenes.scene.dsm, window.buffered(-recipe.scene_buffer)),
        spacing=scenes.scene.spacing,
        seam_id=cloud.point_id[seam],
        seam_label=regions.label[seam],
        keeps_low=recipe.keeps_low,
    )


@dataclass(frozen=True, eq=False)
class BlockView:
    """All that decides the rasters and regions of a block: its points with those around, with classes; the
    file (K,) of each of those inside, where there are several; what is wider than the block; what the
    detector counted around it, if anything, and the scenes in which it did."""

    cloud: PointCloud
    file: NDArray[Any]
    around: Surroundings
    signs: NDArray[np.float64] | None = None
    scenes: Mapping[str, NDArray[Any]] | None = None


def inputs_of_regions(
    block: Block,
    points: PointWindow,
    ground: Mapping[Block, Mapping[str, NDArray[np.uint8]]],
    large: Mapping[Block, tuple[Patch, ...]],
    decks: Mapping[Block, tuple[Decks, ...]],
    signs: Mapping[Block, Mapping[str, NDArray[np.float64]]],
    parameters: Recipe,
) -> BlockView:
    """View of a block from which its rasters and regions are computed."""
    around = surroundings_of(block, large, decks, parameters)
    counted = [found["signs"] for found in signs.values() if "signs" in found]
    return BlockView(
        points.with_ground(ground),
        points.file,
        around,
        np.sum(counted, axis=0) if counted else None,
        dict(signs[block]) if block in signs else None,
    )


def inputs_of_signs(
    block: Block,
    points: PointWindow,
    ground: Mapping[Block, Mapping[str, NDArray[np.uint8]]],
    large: Mapping[Block, tuple[Patch, ...]],
    decks: Mapping[Block, tuple[Decks, ...]],
    parameters: Recipe,
) -> BlockView:
    """View of a block in which the detector counts signs."""
    return inputs_of_regions(block, points, ground, large, decks, {}, parameters)


def find_signs(view: BlockView, parameters: Recipe) -> dict[str, NDArray[Any]]:
    """What the detector counts in a block, if anything, and the scenes in which it does."""
    assert parameters.detect is not None
    scenes = make_scenes(view.cloud, view.around, parameters)
    counted = parameters.detect.count_signs(scenes.seen)
    return arrays_of_scenes(scenes) | ({} if counted is None else {"signs": counted})


def find_regions(view: BlockView, parameters: Any) -> dict[str, NDArray[Any]]:
    """Rasters and regions of a block, as `BlockFile` reads them."""
    only, known = parameters.classes_only, view.scenes
    result = block_pass(view.cloud, view.around, parameters, view.signs, only, known)
    return block_arrays(result) | {"from_file": view.file}


def make_scenes(cloud: PointCloud, around: Surroundings, recipe: Recipe) -> BlockScenes:
    """The scene of a block, and the one that the detector sees: on the decks of bridges and without wires.

    Parameters
    ----------
    cloud : PointCloud
        The N points of a block and of what surrounds it, with the classes of `classify_ground` and ids.
    around : Surroundings
        What `find_surroundings` found.
    recipe : Recipe
        The methods.

    Returns
    -------
    BlockScenes
        `seen` is for `detect_buildings`, the whole for `gather_buildings`.

    Raises
    ------
    TypeError
        When `cloud` is no PointCloud.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> recipe = eaves.make_recipe()
    >>> cloud = eaves.prepare_points(nine_roofs_on_a_slope(density=1.0).cloud)
    >>> around = eaves.find_surroundings(cloud, recipe)
    >>> scenes = eaves.make_scenes(eaves.classify_ground(cloud, wide=around.large), around, recipe)
    >>> int(eaves.detect_buildings(scenes.seen).label.max())
    9
    """
    check_type(cloud, PointCloud, "cloud", "use prepare_points(eaves.read(path))")
    block = around.block
    cloud = cloud.about(block.origin).in_canonical_order()
    window = Bounds(0.0, 0.0, block.side, block.side).buffered(recipe.scene_buffer)
    wet = wet_or_bridged(cloud, around.decks)
    on_deck = wet == BRIDGE_DECK
    cloud = with_classes(cloud, wet)
    if on_deck.any() and recipe.detect:
        stood = with_classes(cloud, np.where(on_deck, np.uint8(GROUND), np.uint8(0)))
        scene, seen = two_scenes(cloud, stood, window, beneath=around.beneath)
    else:
        scene = seen = scene_of(cloud, window, beneath=around.beneath)
    wires = np.zeros(len(cloud), bool)
    if recipe.marks_others:
        wires = find_wires(cloud, scene.height, scene.spacing)
        hidden = with_classes(seen.cloud, np.where(wires, np.uint8(HIGH_NOISE), np.uint8(0)))
        seen = replace(seen, cloud=hidden)
    return BlockScenes(block, scene, seen, wires)


def arrays_of_scenes(scenes: BlockScenes) -> dict[str, NDArray[Any]]:
    """What `known_scenes` does not get from the points, as arrays."""
    scene, seen = scenes.scene, scenes.seen
    classes = np.stack([np.asarray(one.cloud.classification) for one in (scene, seen)])
    rasters = np.stack(
        [scene.dtm.values, scene.dsm.values, seen.dtm.values][: 2 + (seen.dtm is not scene.dtm)]
    )
    place = np.array([scene.dtm.west, scene.dtm.north, scene.dtm.cell, scene.spacing])
    return {"classes": classes, "rasters": rasters, "place": place, "wires": scenes.wires}


def known_scenes(cloud: PointCloud, block: Block, known: Mapping[str, NDArray[Any]]) -> BlockScenes:
    """The scenes of which `arrays_of_scenes` made arrays, of the same points."""
    *place, spacing = known["place"].tolist()
    dtm, dsm, *richer = (Raster(values, *place) for values in known["rasters"])
    cloud = cloud.about(block.origin).in_canonical_order()
    clouds = [cloud.with_(classification=classes) for classes in known["classes"]]
    scene = Scene(clouds[0], dtm, dsm, spacing, cloud.xyz[:, 2] - dtm.at(cloud.xyz))
    seen = replace(scene, cloud=clouds[1])
    for raster in richer:
        seen = replace(seen, dtm=raster, height=cloud.xyz[:, 2] - raster.at(cloud.xyz))
    return BlockScenes(block, scene, seen, known["wires"])


def points_alone(cloud: PointCloud, block: Block) -> BlockScenes:
    """The points of a block without rasters, where nothing is asked for but their classes."""
    cloud = cloud.about(block.origin).in_canonical_order()
    blank = Raster(np.full((1, 1), np.nan), 0.0, block.side, block.side)
    scene = Scene(cloud, blank, blank, np.nan, np.zeros(len(cloud)))
    return BlockScenes(block, scene, scene, np.zeros(len(cloud), bool))


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
