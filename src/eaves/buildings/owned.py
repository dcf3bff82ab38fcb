"""The buildings of one owner block: gathered, outlined together, divided, and modelled one by one, each
with its outline facts, roof planes and valid solids."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from eaves.blocks.block_file import BlockFile
from eaves.buildings.building_file import SavedBuilding, building_arrays
from eaves.buildings.gather import (
    MARGIN,
    Gatherer,
    OwnedBuildings,
    building_keys,
    cells_of,
    draw_blocks,
    is_seen_beside,
    random_numbers_of,
    select_roof,
)
from eaves.figures.attributes import measure_again
from eaves.figures.rows import CELLS, NO_ROOF
from eaves.footprints.addresses import divide_buildings
from eaves.geometry.rings import PLANARITY, SNAP
from eaves.methods import ContractError, MethodChoice, check_returned, naming, resolve_method
from eaves.model import (
    OVERHANGS,
    Block,
    Boundary,
    Bounds,
    BuildingModel,
    Failure,
    Finding,
    Footprint,
    Points,
    RoofPlane,
)
from eaves.model.checks import error_line, is_array
from eaves.model.cloud import canonical_order
from eaves.model.results import BuildingPoints, BuildingResult
from eaves.model.scene import WALL
from eaves.outline import OutlineMethod, regularise_outlines, trace_outline
from eaves.raster.surfaces import CELL, heights_under
from eaves.reconstruct import add_overhangs, reconstruct_building
from eaves.reconstruct.stage import FALLBACK, BlockPart
from eaves.roof import RoofMethod, segment_roof
from eaves.run.memory import Clock
from eaves.validate import Tolerances, validate_model
from eaves.validate.models import find_invalid

if TYPE_CHECKING:
    from eaves.model import CoordinateSystem
    from eaves.recipe.recipe import Recipe

    class BuildingParameters(Recipe):
        """The part of a recipe that these steps declare, with the system and an option."""

        system: CoordinateSystem
        snap_footprints: bool


log = logging.getLogger("eaves")


@dataclass(frozen=True)
class RoofOfPoints:
    """A roof as its points show it, from a base (m) that is measured where it is None, and as the `part` of a
    block that was drawn as one; what a person states of a roof is a class under this one
    (`eaves.buildings.edited`)."""

    base: float | None = None
    part: BlockPart | None = field(default=None, kw_only=True)

    @property
    def holds(self) -> bool:
        """True if the roof is one whatever its points look like."""
        return False

    def planes(
        self, points: Points, spacing: float, method: RoofMethod, rng: np.random.Generator
    ) -> list[RoofPlane]:
        """The planes of the roof's points (N, 3) with their spacing (m)."""
        if self.part is not None:
            return self.part.planes
        return segment_roof(points, spacing, method, rng=rng)

    def model(
        self,
        points: Points,
        footprint: Footprint,
        planes: list[RoofPlane],
        base: float,
        method: MethodChoice,
    ) -> tuple[BuildingModel | Failure, Points]:
        """The model over a base (m), and the points that it is of."""
        return reconstruct_building(points, footprint, planes, base, method, part=self.part), points


@dataclass(frozen=True, eq=False)
class GatheredBuildings:
    """All that decides the buildings of one owner block."""

    owner: Block
    buildings: tuple[BuildingPoints | Failure, ...]
    addresses: tuple[Footprint, ...]


def inputs_of_buildings(
    plan: OwnedBuildings, regions: Mapping[Block, BlockFile], points: object, parameters: BuildingParameters
) -> GatheredBuildings:
    """View of the buildings of an owner block from which they are computed: their points and surroundings."""
    gatherer = Gatherer(regions, around=MARGIN if parameters.keeps_low else None)
    if parameters.snap_footprints:
        plan = gatherer.snapped(plan)
    owner = plan.owner_block
    gathered = tuple(gatherer.gather(owner, building) for building in plan.buildings)
    return GatheredBuildings(owner, gathered, plan.addresses)


def model_buildings(
    view: GatheredBuildings, earlier: Sequence[SavedBuilding] | None, parameters: BuildingParameters
) -> dict[str, NDArray[Any]]:
    """Outlines, units, roofs and solids of the buildings of an owner block, as the arrays of their file.

    A building that follows from the same as one of an `earlier` result is taken over from it.
    """
    unit_m = parameters.system.horizontal_unit_m
    before = {building.key: building for building in earlier or () if building.key}
    failures = [building for building in view.buildings if isinstance(building, Failure)]
    detected = [building for building in view.buildings if not isinstance(building, Failure)]
    clock = Clock()
    buildings, traced = trace_buildings(detected, parameters.outline)
    footprints = draw_outlines(traced, parameters.outline)
    clock.lap("outline")
    units = parameters.units or "off"
    buildings, footprints = divide_buildings(buildings, footprints, units, view.addresses)
    clock.lap("units")
    keys = building_keys(buildings, footprints)
    todo = [number for number, key in enumerate(keys) if key not in before]
    known = {number for number, key in enumerate(keys) if key in before}
    roofs = [RoofOfPoints(part=part) for part in draw_blocks(buildings, footprints, parameters, known)]
    houses = list(zip(buildings, footprints, roofs, strict=True))
    clock.lap("roof")
    results: dict[int, BuildingResult | SavedBuilding] = {number: before[keys[number]] for number in known}
    models = [try_building(*houses[n], parameters, unit_m, check=False) for n in todo]
    results |= dict(zip(todo, models, strict=True))
    checking = Clock()
    for place in recheck(models, parameters, unit_m):
        number = todo[place]
        results[number] = try_building(*houses[number], parameters, unit_m)
    checking.lap("validate")
    ordered = [*map(BuildingResult.without_points, failures), *(results[n] for n in range(len(keys)))]
    if ordered and isinstance(ordered[0], BuildingResult):
        spent = ordered[0].seconds
        for name, seconds in [*clock.laps.items(), *checking.laps.items()]:
            spent[name] = spent.get(name, 0.0) + seconds
    return building_arrays(ordered, [*[""] * len(failures), *keys])


def try_building(
    building: BuildingPoints,
    footprint: Footprint | Failure,
    roof: RoofOfPoints,
    recipe: Recipe,
    unit_m: float,
    check: bool = True,
) -> BuildingResult:
    """The answer of `building_pass` for all points, or what is left of a building where it raises: one must
    not take the others of its block with it."""
    try:
        return building_pass(building, footprint, roof, recipe, unit_m, check)
    except ContractError:  # of a method that returns this no building can be right
        raise
    except Exception as error:
        log.warning("a building of block %s failed: %s", building.owner_block.name, error_line(error))
        log.debug("traceback", exc_info=True)
        return broken_result(building, error)


def recheck(results: list[BuildingResult], recipe: Recipe, unit_m: float) -> Iterable[int]:
    """The numbers of unchecked results to be made again with a check; all where one of them breaks it."""
    try:
        return find_doubtful(results, recipe.lod, unit_m)
    except Exception:  # as in try_building
        log.debug("traceback", exc_info=True)
        return range(len(results))


OBJECTS = "2.2"
"""The first level of detail with objects on the roof."""

BEND_DEG, FAR_M = 20.0, 1.0
"""A corner turns by more, a curve by less; ground farther off (m) does not show where a building ends."""

LEAST_PIERCED, LEAST_SOLID, MOST_GROUND = 0.25, 0.5, 0.25
"""Shares of points that let the pulse through, of those that end it on a plane, and of the plan in which
ground is seen: of 197 roofs under given outlines no more than 0.29, no less than 0.67, no more than 0.19; of
drawn crowns 0.4, 0.48 and 0.42 are the least telling."""

MEASURED, INTERPOLATED, NEAREST = "measured", "interpolated", "nearest ground"
"""Sources of the height of a base; the column `ground_source` says it."""


def divide_parts(building: BuildingPoints, outline: OutlineMethod) -> list[BuildingPoints]:
    """A building for each part that has an outline of its own; walls are of the nearest."""
    roof = np.flatnonzero(building.part != WALL)
    if building.given is not None or not len(roof):
        return [building]
    roof = roof[canonical_order(building.xyz[roof])]
    with naming(outline):
        number = outline.parts(building.xyz[roof], building.spacing)
    is_valid = is_array(number, len(roof), "iu")
    check_returned(outline, is_valid, f"as parts an array ({len(roof)},) of int32", number)
    if not number.any():
        return [building]
    nearest = cKDTree(building.xyz[roof, :2]).query(building.xyz[:, :2])[1]
    return [building.take(number[nearest] == k) for k in range(int(number.max()) + 1)]


def trace_buildings(
    buildings: Sequence[BuildingPoints], method: MethodChoice = None
) -> tuple[list[BuildingPoints], list[Boundary | Footprint | Failure]]:
    """The parts of buildings that have an outline each, and the boundary of each part's points.

    Parameters
    ----------
    buildings : sequence of BuildingPoints
        Those of `gather_buildings`.
    method : OutlineMethod, str, mapping or None
        The method, its name, or its parameters; None is `GlobalFit()`.

    Returns
    -------
    (list of BuildingPoints, list of Boundary, Footprint or Failure)
        The parts in the order of their buildings, and for each what `draw_outlines` takes: its footprint
        where it is given one.

    Raises
    ------
    ValueError
        When no method or parameter has that name.

    Examples
    --------
    >>> import eaves
    >>> eaves.trace_buildings([])
    ([], [])
    """
    outline = resolve_method("outline", method)
    assert isinstance(outline, OutlineMethod)
    traced = list[tuple[BuildingPoints, Boundary | Footprint | Failure]]()
    for building in buildings:
        try:
            parts = divide_parts(building, outline)
            traced += [(part, part.given or trace_part(part, outline)) for part in parts]
        except ContractError:
            raise
        except Exception as error:  # as in try_building: the others must not go with it
            log.debug("traceback", exc_info=True)
            traced.append((building, Failure("internal_error", error_line(error), "outline")))
    return [part for part, _ in traced], [boundary for _, boundary in traced]


def trace_part(part: BuildingPoints, outline: OutlineMethod) -> Boundary | Failure:
    """The boundary of the points of a building that has no footprint."""
    return trace_outline(
        part.roof_points,
        part.spacing,
        outline,
        not_last=part.roof_not_last,
        ground=None if part.ground_seen is None else cells_of(part.ground_seen),
        others=part.others,
    )


def draw_outlines(
    traced: Sequence[Boundary | Footprint | Failure], method: MethodChoice = None
) -> list[Footprint | Failure]:
    """The footprints of a block's boundaries, regularised together, so that neighbours share their edges; one
    by one where one of them breaks the others.

    Parameters
    ----------
    traced : sequence of Boundary, Footprint or Failure
        Those of `trace_buildings`; what is no boundary is the result itself.
    method : OutlineMethod, str, mapping or None
        The method, its name, or its parameters; None is `GlobalFit()`.

    Returns
    -------
    list of Footprint or Failure
        One for each, in their order.

    Raises
    ------
    ValueError
        When no method or parameter has that name.

    Examples
    --------
    >>> import eaves
    >>> eaves.draw_outlines([])
    []
    """
    outline = resolve_method("outline", method)
    boundaries = [one for one in traced if isinstance(one, Boundary)]
    try:
        regular = iter(regularise_outlines(boundaries, outline))
    except ContractError:
        raise
    except Exception as error:  # as in try_building
        if len(traced) == 1:
            log.debug("traceback", exc_info=True)
            return [Failure("internal_error", error_line(error), "outline")]
        return [draw_outlines([one], outline)[0] for one in traced]
    return [next(regular) if isinstance(one, Boundary) else one for one in traced]


def building_pass(
    building: BuildingPoints,
    footprint: Footprint | Failure,
    known: RoofOfPoints,
    recipe: Recipe,
    unit_m: float = 1.0,
    check: bool = True,
) -> BuildingResult:
    """Roof planes and solids of one building with its footprint; `unit_m` is the unit they are written in.

    What is `known` of the roof, as what a person states, holds whatever its points look like. Without `check`
    the model may have levels that are not valid, or not asked for.
    """
    clock = Clock()
    roof = select_roof(building)
    points = building.xyz[roof]
    plane = np.zeros(len(building.xyz), np.int32)
    if isinstance(footprint, Failure):
        return BuildingResult(failure_in_place(footprint, building), building.point_id, plane, clock.laps)
    footprint = name_footprint(footprint, building)
    if recipe.lod == "0":
        model = BuildingModel(footprint, {}, attributes=unit_attributes(footprint, building))
        return BuildingResult(model, building.point_id, plane, clock.laps)

    planes = known.planes(points, building.spacing, recipe.roof, random_numbers_of(points))
    for number, segment in enumerate(planes, 1):
        plane[roof[segment.members]] = number
    clock.lap("roof")

    doubt = "" if known.holds or recipe.from_raster else lacks_roof(building, roof, planes)
    base, terrain = heights_under(footprint, building.terrain, building.ground_nearest)
    if known.base is not None:
        base = terrain = known.base
    if not np.isfinite(base):
        outcome: BuildingModel | Failure = no_ground(footprint)
    else:
        method = FALLBACK if doubt else recipe.reconstruct
        outcome, points = known.model(points, footprint, planes, base, method)
        if doubt and isinstance(outcome, BuildingModel):
            why = {"fallback_code": NO_ROOF, "fallback_reason": doubt}
            outcome = outcome.with_(attributes={**outcome.attributes, **why})
    finished = with_overhangs(outcome, points, base, building, recipe)
    clock.lap("reconstruct")
    if isinstance(finished, BuildingModel) and check:
        finished = keep_valid(finished, recipe.lod, unit_m)
    clock.lap("validate")
    finished = with_facts(finished, outcome, terrain, footprint, building, recipe)
    return BuildingResult(finished, building.point_id, plane, clock.laps)


def failure_in_place(failure: Failure, building: BuildingPoints) -> Failure:
    """The failure of a building that has no outline, with the place of its points."""
    blank = name_footprint(hull_of(building.xyz, building.spacing), building)
    return Failure(failure.code, failure.reason, failure.stage, blank)


def no_ground(footprint: Footprint) -> Failure:
    """The failure of a building under which no terrain is known."""
    return Failure("no_ground", "no terrain under the footprint", "reconstruct", footprint)


def with_overhangs(
    outcome: BuildingModel | Failure, points: Points, base: float, building: BuildingPoints, recipe: Recipe
) -> BuildingModel | Failure:
    """A model over its `base` with LoD 2.3, where that is asked for; `points` are those of the roof."""
    if isinstance(outcome, Failure) or recipe.lod != OVERHANGS:
        return outcome
    around = points if building.around is None else building.around
    terrain_below = building.terrain.at(around)
    over_ground = around[:, 2] - np.where(np.isfinite(terrain_below), terrain_below, base)
    return add_overhangs(outcome, around, over_ground, recipe.overhangs)


def with_facts(
    outcome: BuildingModel | Failure,
    described: BuildingModel | Failure,
    terrain: float,
    footprint: Footprint,
    building: BuildingPoints,
    recipe: Recipe,
) -> BuildingModel | Failure:
    """What is left of a building that was `described`, with the facts of its outline and the ground; at
    `terrain` (m) it meets the ground."""
    if isinstance(outcome, Failure):
        return Failure(outcome.code, outcome.reason, outcome.stage, footprint)
    if isinstance(described, BuildingModel) and outcome.lod != described.lod:
        outcome = measure_again(outcome)
    facts = {"h_ground": terrain, **unit_attributes(footprint, building)}
    facts |= {"ground_source": CELLS} if recipe.from_raster else ground_facts(footprint, building)
    if building.given is None:
        facts |= outline_facts(footprint, building)
    return outcome.with_(attributes={**outcome.attributes, **facts})


def lacks_roof(building: BuildingPoints, roof: NDArray[np.int64], planes: Sequence[RoofPlane]) -> str:
    """Why the points `roof` (M,) under a given outline are none of a roof, in words; empty where they may be
    one, and where the outline follows from what was found to be a building.

    A roof ends the pulses that meet it: most of its points are the last of their pulse and lie on its planes,
    and no ground is seen under it.
    """
    if building.given is None:
        return ""
    outline, seen = building.given.polygon, building.ground_seen
    under = None if seen is None else cells_of(seen)
    if under is not None and shapely.contains_xy(outline, *under.T).any():
        inner = outline.buffer(-CELL)
        count = np.count_nonzero(shapely.contains_xy(inner, *under.T))
        share = CELL**2 * count / inner.area if count else 0.0
        if share > MOST_GROUND:
            return f"ground was seen in {min(share, 1.0):.0%} of it"
    if building.not_last is None or not len(roof):
        return ""
    ends = ~building.not_last[roof]
    on_plane = np.zeros(len(roof), bool)
    for plane in planes:
        on_plane[plane.members] = True
    solid = float(np.mean(on_plane & ends))
    if np.mean(~ends) <= LEAST_PIERCED or solid >= LEAST_SOLID:
        return ""
    return f"{np.mean(~ends):.0%} of its points let the pulse through, {solid:.0%} end it on a plane: leaves"


def unit_attributes(footprint: Footprint, building: BuildingPoints) -> dict[str, object]:
    """The block that the building is a unit of, itself where it is whole, and how sure its walls are."""
    block = footprint if building.block is None else name_footprint(building.block, building)
    return {"block_id": block.id, "wall_certainty": building.wall_certainty}


def hull_of(points: Points, spacing: float) -> Footprint:
    """The convex hull of points, widened by the spacing: the place of a building that has no outline."""
    return Footprint(
        shapely.MultiPoint(points[:, :2]).convex_hull.buffer(max(spacing, 0.1), join_style="mitre")
    )


def name_footprint(footprint: Footprint, building: BuildingPoints) -> Footprint:
    """The footprint with origin, score and, unless given one, the id of its representative point's cell."""
    owner = building.owner_block
    if footprint.id:
        return footprint.with_(origin=owner.origin)
    point = footprint.polygon.representative_point()
    block = Block.at(point.x + owner.origin[0], point.y + owner.origin[1], owner.side)
    column = int((point.x + owner.origin[0] - block.origin[0]) / CELL)
    row = int((point.y + owner.origin[1] - block.origin[1]) / CELL)
    name = f"b{block.column}_{block.row}_{column}_{row}"
    return footprint.with_(origin=owner.origin, score=building.score, id=name)


def ground_facts(footprint: Footprint, building: BuildingPoints) -> dict[str, object]:
    """Source of the height of the base: `measured` where ground was seen beside the outline, else
    `interpolated` by the terrain model; for a given footprint from the nearest ground, at a distance (m)."""
    if building.ground_seen is None:
        return {}
    if building.ground_nearest is not None:
        distance = shapely.distance(footprint.polygon, shapely.points(building.ground_nearest[:, :2])).min()
        return {"ground_source": NEAREST, "ground_distance_m": round(float(distance), 1)}
    beside = building.ground_beside
    if beside is None:
        beside = is_seen_beside(footprint.polygon, building.ground_seen)
    return {"ground_source": MEASURED if beside else INTERPOLATED}


def outline_facts(footprint: Footprint, building: BuildingPoints) -> dict[str, object]:
    """Figures of an outline that was not given: its corners, sides of the least rectangle around it, the
    share of that, or of the least circle, that it fills, the agreement of the outline of its block, and its
    share, but for walls to other units, without ground within `FAR_M`, and without anything there."""
    polygon = footprint.polygon
    rectangle = polygon.minimum_rotated_rectangle
    around = min(rectangle.area, shapely.minimum_bounding_circle(polygon).area)
    sides = np.hypot(*np.diff(shapely.get_coordinates(rectangle)[:3], axis=0).T)
    facts: dict[str, object] = {
        "width_m": round(float(sides.min()), 2),
        "length_m": round(float(sides.max()), 2),
        "corners": sum(map(corner_count, shapely.get_rings(polygon))),
        "box_share": round(float(polygon.area / around), 3),
    }
    block = footprint if building.block is None else building.block
    if block.agreement is not None:
        facts["outline_agreement"] = round(block.agreement, 3)
    if building.ground_seen is not None:
        outline = block.polygon
        rim = shapely.get_coordinates(shapely.segmentize(polygon, CELL))
        rim = rim[shapely.distance(shapely.points(rim), outline.boundary) <= 0.5 * CELL]
        ground = cells_of(building.ground_seen)
        ground = ground[Bounds(*polygon.bounds).buffered(FAR_M + CELL).contains(ground)]
        shapely.prepare(outline)
        ground = ground[~shapely.contains_xy(outline, ground)]
        away = np.full(len(rim), np.inf)
        for name, shown in (("hidden_share", ground), ("blank_share", building.others)):
            if shown is not None and len(shown):
                away = np.minimum(away, cKDTree(shown[:, :2]).query(rim)[0])
            facts[name] = round(float(np.mean(away > FAR_M + 0.5 * CELL)), 3) if len(rim) else 0.0
    return facts


def corner_count(ring: shapely.LinearRing) -> int:
    """The corners of a ring that turn by more than a curve does; at least those of a rectangle."""
    side = np.diff(shapely.get_coordinates(ring), axis=0)
    angle = np.arctan2(side[:, 1], side[:, 0])
    turn = np.abs(np.mod(angle - np.roll(angle, 1) + np.pi, 2.0 * np.pi) - np.pi)
    return max(int((turn > np.radians(BEND_DEG)).sum()), 4)


def keep_valid(model: BuildingModel, finest: str, unit_m: float = 1.0) -> BuildingModel | Failure:
    """The model without the levels and objects that are finer than asked for or not valid, and why they went.

    Other validators take their limits in the unit of the file: in feet they are a third of those in metres.
    """
    limits = limits_in(unit_m)
    levels = {lod: solids for lod, solids in model.solids.items() if lod <= finest}
    bad: dict[str, Finding] = {}
    bare = model.with_(solids=levels, installations=())
    if validate_model(different_levels(bare), limits):
        for lod, solids in levels.items():
            findings = validate_model(bare.with_(solids={lod: solids}), limits)
            if findings:
                bad[lod] = findings[0]
    good = {lod: solids for lod, solids in levels.items() if lod not in bad}
    reasons = "; ".join(
        f"LoD {lod}: {finding.code} {finding.name} {finding.detail}" for lod, finding in sorted(bad.items())
    )
    if not good:
        return Failure("invalid_solid", reasons or "no solid", "reconstruct")
    sound = bare.with_(solids=good)
    attributes = {**model.attributes, "lod": sound.lod}
    if bad and max(bad) > sound.lod:
        attributes |= {"fallback_code": "invalid_solid", "fallback_reason": reasons}
    if sound.lod >= OBJECTS:
        roof = sound.with_(solids={sound.lod: good[sound.lod]})
        for installation in model.installations:
            more = roof.with_(installations=(*roof.installations, installation))
            roof = roof if validate_model(more, limits) else more
        attributes |= {"installation_count": len(roof.installations)} if model.installations else {}
        sound = sound.with_(installations=roof.installations)
    return sound.with_(attributes=attributes)


def limits_in(unit_m: float) -> Tolerances:
    """The tolerances for models that are written in a unit (m)."""
    return Tolerances(snap=SNAP * min(1.0, unit_m), planarity=PLANARITY * min(1.0, unit_m))


def different_levels(model: BuildingModel) -> BuildingModel:
    """The model with one level of those that are the same solids."""
    different = {
        tuple(
            part.tobytes()
            for solid in solids
            for part in (solid.vertices, solid.corners, solid.ring_sizes, solid.ring_counts)
        ): lod
        for lod, solids in model.solids.items()
    }
    return model.with_(solids={lod: model.solids[lod] for lod in different.values()})


def find_doubtful(results: Sequence[BuildingResult], finest: str, unit_m: float) -> list[int]:
    """The numbers of results of `building_pass` without `check` that it would have changed: those with no
    level, and with levels that are not valid, or finer than asked for."""
    models = [
        (number, result.outcome)
        for number, result in enumerate(results)
        if isinstance(result.outcome, BuildingModel)
    ]
    odd = {number for number, model in models if not model.solids or max(model.solids) > finest}
    solid_models = [(number, model) for number, model in models if number not in odd]
    bad = find_invalid([different_levels(model) for _, model in solid_models], limits_in(unit_m))
    return sorted(odd | {solid_models[place][0] for place in bad})


def broken_result(building: BuildingPoints, error: Exception) -> BuildingResult:
    """The rest of a building whose pass raised: its place, its points, the error as the reason."""
    place = name_footprint(building.given or hull_of(building.xyz, building.spacing), building)
    failure = Failure("internal_error", error_line(error), "pipeline", place)
    return BuildingResult(failure, building.point_id, np.zeros(len(building.xyz), np.int32))
