"""A scan of one block in memory, step by step: what a run takes from its store between the stages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eaves.blocks.block import BlockScenes, block_result
from eaves.blocks.block_file import BlockFile, block_arrays
from eaves.blocks.ground import (
    Surroundings,
    find_floor,
    find_large,
    find_square_decks,
    inputs_of_decks,
    inputs_of_floors,
    inputs_of_large,
    objects_around,
    surroundings_of,
)
from eaves.blocks.points import find_thinned
from eaves.buildings.gather import MARGIN, Gatherer, Seam, join_regions, select_roof
from eaves.buildings.owned import (
    failure_in_place,
    keep_valid,
    name_footprint,
    no_ground,
    with_facts,
    with_overhangs,
)
from eaves.formats.points.las import TIME_PLACE, moments_of
from eaves.formats.points.source import MISSING
from eaves.ground.toolkit.wide_objects import Patch
from eaves.model import GRID_STEP, Block, BuildingModel, Failure, Footprint, PointCloud, Regions
from eaves.model.block import BLOCK_SIDE, WIDE_SQUARE, squares_of
from eaves.model.checks import check_lengths, check_type
from eaves.model.results import BuildingPoints
from eaves.raster.surfaces import heights_under
from eaves.run.store import RECORD, record_of
from eaves.surroundings.decks import Decks

if TYPE_CHECKING:
    from eaves.recipe.recipe import Recipe

TIMED = 1
"""A format of LAS points with times, at the first of `TIME_PLACE`."""


def prepare_points(cloud: PointCloud) -> PointCloud:
    """The points of a scan of one block as a run takes them: of a dense scan one stands for its neighbours,
    of copies one.

    Parameters
    ----------
    cloud : PointCloud
        N points in the order of their file, all in one block of 240 m of the world's grid. Two at one place
        are copies of each other unless `fields` has a `gps_time` (s) that differs.

    Returns
    -------
    PointCloud
        At most N points that have coordinates, about the corner of their block, in canonical order, each with
        a `point_id`.

    Raises
    ------
    TypeError
        When `cloud` is no PointCloud.
    ValueError
        When no point has coordinates, or several blocks have points.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> cloud = nine_roofs_on_a_slope(density=4.0).cloud
    >>> len(eaves.prepare_points(cloud)) == len(cloud)
    True
    """
    check_type(cloud, PointCloud, "cloud", "use eaves.read(path) or PointCloud.from_world(xyz)")
    cloud = cloud[np.isfinite(cloud.xyz).all(axis=1)]
    if not len(cloud):
        raise ValueError("the cloud has no points with coordinates; check the area that was read")
    cells = np.unique(np.floor(np.rint(cloud.world[:, :2] / GRID_STEP) * GRID_STEP / BLOCK_SIDE), axis=0)
    if len(cells) > 1:
        raise ValueError(
            f"points lie in {len(cells)} blocks of {BLOCK_SIDE:g} m; give those of one, or use "
            "eaves.find_buildings, which joins blocks"
        )
    block = Block(*map(int, cells[0]))
    cloud = cloud.about(block.origin)
    if cloud.point_id is None:
        cloud = cloud.with_(point_id=np.arange(len(cloud)))
    order = cloud.canonical_order()
    records = records_of(cloud.with_(point_id=np.arange(len(cloud)))).take(order)
    thinned = find_thinned((block, [records]), None)
    chosen = thinned["records"].view(RECORD)["point_id"] if thinned else order
    return replace(cloud.take(chosen), ordered=True)


def find_surroundings(cloud: PointCloud, recipe: Recipe) -> Surroundings:
    """The large objects over the terrain and the decks of bridges in the points of one block.

    Parameters
    ----------
    cloud : PointCloud
        Points of one block as `prepare_points` gives them, before their ground is classified.
    recipe : Recipe
        The methods.

    Returns
    -------
    Surroundings
        `large` is for `classify_ground`, the whole for `make_scenes`.

    Raises
    ------
    TypeError
        When `cloud` is no PointCloud.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> cloud = eaves.prepare_points(nine_roofs_on_a_slope(density=1.0).cloud)
    >>> eaves.find_surroundings(cloud, eaves.make_recipe()).block.name
    '10_20'
    """
    check_type(cloud, PointCloud, "cloud", "use prepare_points(eaves.read(path))")
    block = Block.at(*cloud.origin)
    points = {block: (records_of(cloud), cloud.classification is not None)}
    floor = find_floor(inputs_of_floors(block, points, None), None)
    large, decks = dict[Block, tuple[Patch, ...]](), dict[Block, tuple[Decks, ...]]()

    def near(found: Mapping[Block, Any], reach: float) -> dict[Block, Any]:
        squares = squares_of(block.bounds.buffered(reach), WIDE_SQUARE)
        return {square: found[square] for square in squares if square in found}

    reaches = recipe.ground.buffer, recipe.scene_buffer
    for square in squares_of(block.bounds.buffered(max(reaches)), WIDE_SQUARE) if recipe.sees_wide else ():
        seen = block in squares_of(square.bounds.buffered(recipe.wide_buffer), block.side)
        floors = {block: floor} if seen else {}
        large[square] = find_large(inputs_of_large(square, floors, recipe), recipe)
        if recipe.sees_decks:
            decks[square] = find_square_decks(inputs_of_decks(square, floors, large, recipe), recipe)
    wide = objects_around(block, near(large, reaches[0]), recipe) if recipe.sees_wide else None
    around = surroundings_of(block, near(large, reaches[1]), near(decks, reaches[1]), recipe)
    return replace(around, large=wide)


def gather_buildings(scenes: BlockScenes, regions: Regions, recipe: Recipe) -> list[BuildingPoints]:
    """The buildings of a block, joined from its regions, with all that decides their outlines and models.

    Parameters
    ----------
    scenes : BlockScenes
        What `make_scenes` made of the block's N points.
    regions : Regions
        The labels (N,) of `detect_buildings`, or of a detector of your own.
    recipe : Recipe
        The methods.

    Returns
    -------
    list of BuildingPoints
        One for each building, in the order of a run: its points (M, 3) about the block's corner, the terrain
        around, the ground seen beside it, and the high points that are no building's.

    Raises
    ------
    ValueError
        When there are other labels than points.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> recipe = eaves.make_recipe()
    >>> cloud = eaves.prepare_points(nine_roofs_on_a_slope(density=1.0).cloud)
    >>> around = eaves.find_surroundings(cloud, recipe)
    >>> scenes = eaves.make_scenes(eaves.classify_ground(cloud, wide=around.large), around, recipe)
    >>> len(eaves.gather_buildings(scenes, eaves.detect_buildings(scenes.seen), recipe))
    9
    """
    block, cloud = scenes.block, scenes.scene.cloud
    check_lengths(len(cloud), {"regions.label": regions.label})
    arrays = block_arrays(block_result(scenes, regions, recipe)) | {"from_file": np.zeros(0, np.uint8)}
    records = records_of(cloud)
    file = BlockFile(arrays, block, lambda _: records)
    gatherer = Gatherer({block: file}, around=MARGIN if recipe.keeps_low else None)
    plans = [plan for owned in join_regions([Seam.read(file)]) for plan in owned.buildings]
    gathered = (gatherer.gather(block, plan) for plan in plans)
    return [building for building in gathered if isinstance(building, BuildingPoints)]


def place_footprint(footprint: Footprint | Failure, building: BuildingPoints) -> Footprint | Failure:
    """The footprint of a building with its place in the world, its id and its score.

    Parameters
    ----------
    footprint : Footprint or Failure
        One of `divide_buildings`.
    building : BuildingPoints
        That with the points in it.

    Returns
    -------
    Footprint or Failure
        A Failure `no_ground` where no terrain is known under it; one that is given, with the place of the
        points.

    Raises
    ------
    AttributeError
        When one is of another type.

    Examples
    --------
    >>> import eaves
    >>> pairs = zip([], [])                              # buildings and footprints of divide_buildings
    >>> [eaves.place_footprint(footprint, building) for building, footprint in pairs]
    []
    """
    if isinstance(footprint, Failure):
        return failure_in_place(footprint, building)
    named = name_footprint(footprint, building)
    base, _ = heights_under(named, building.terrain, building.ground_nearest)
    return named if np.isfinite(base) else no_ground(named)


def complete_model(
    outcome: BuildingModel | Failure,
    footprint: Footprint | Failure,
    building: BuildingPoints,
    recipe: Recipe,
    unit_m: float = 1.0,
) -> BuildingModel | Failure:
    """The model of a building as a run leaves it: with its valid levels and all that is known of it.

    Parameters
    ----------
    outcome : BuildingModel or Failure
        What `reconstruct_building` gave.
    footprint : Footprint or Failure
        What `place_footprint` gave.
    building : BuildingPoints
        One of `divide_buildings`.
    recipe : Recipe
        The methods.
    unit_m : float
        Unit (m) that models are written in, in which the limits of validators hold:
        `cloud.system.horizontal_unit_m`.

    Returns
    -------
    BuildingModel or Failure
        The levels that are valid and no finer than the recipe asks for, LoD 2.3 where it does, with the
        figures from which trust follows: ground beside it, its outline, its party walls.

    Raises
    ------
    AttributeError
        When an argument is of another type.

    Examples
    --------
    >>> import eaves
    >>> failure = eaves.Failure("no_area", "the outline encloses no area", "outline")
    >>> eaves.complete_model(failure, failure, None, eaves.make_recipe()).code
    'no_area'
    """
    if isinstance(footprint, Failure):
        return footprint
    base, terrain = heights_under(footprint, building.terrain, building.ground_nearest)
    finished = with_overhangs(outcome, building.xyz[select_roof(building)], base, building, recipe)
    if isinstance(finished, BuildingModel):
        finished = keep_valid(finished, recipe.lod, unit_m)
    return with_facts(finished, outcome, terrain, footprint, building, recipe)


def records_of(cloud: PointCloud) -> NDArray[Any]:
    """The points of a cloud about its block's corner as a store keeps them, with the fields that methods may
    want."""
    wanted = [name for name in ("intensity",) if name in cloud.fields]
    records = np.zeros(len(cloud), record_of(wanted))
    for name in wanted:
        records["fields"][name] = cloud.fields[name]
    records["xyz"] = np.rint(cloud.xyz / GRID_STEP)
    for name, missing in {**MISSING, "point_id": np.arange(len(cloud))}.items():
        given = getattr(cloud, name)
        records[name] = missing if given is None else given
    if "gps_time" in cloud.fields:
        bits = np.zeros((len(cloud), TIME_PLACE[0] + 8), np.uint8)
        bits[:, TIME_PLACE[0] :] = cloud.fields["gps_time"].astype("<f8").view(np.uint8).reshape(-1, 8)
        records["moment"] = moments_of(TIMED, bits)
    return records
