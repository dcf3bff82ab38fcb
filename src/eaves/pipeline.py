"""The flow from points to buildings, in two passes. Read this file first.

`block_pass` turns the points of one block into ground, rasters and regions; `building_pass` turns the
points of one building, however many blocks it covers, into a model or a Failure. `tiling` runs the first
over all blocks, joins regions across seams, and runs the second over all buildings.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import shapely
from numpy.typing import NDArray

from eaves.detect import Detector, detect_buildings
from eaves.geometry.neighbours import measure_spacing
from eaves.ground import GroundMethod, classify_ground
from eaves.methods import DEFAULTS, Method, make_method, method_class
from eaves.model import (
    Block,
    Boundary,
    Bounds,
    BuildingModel,
    Failure,
    Finding,
    Footprint,
    Labels,
    PointCloud,
    Points,
    Raster,
    Regions,
    Scene,
)
from eaves.model.cloud import BUILDING
from eaves.model.scene import WALL
from eaves.outline import OutlineMethod, regularise_outlines, trace_outline
from eaves.raster.surfaces import make_dsm, make_dtm
from eaves.reconstruct import Reconstructor, reconstruct_building
from eaves.roof import RoofMethod, segment_roof
from eaves.units import UnitMethod
from eaves.validate import validate_model

CELL = 0.5
"""Side of a raster cell (m)."""
SEAM = 1.5
"""Points this near (m) to a block's border are labelled by both blocks; shared labels join regions."""
CANDIDATE_HEIGHT = 1.0
"""Points lower than this (m) over the terrain belong to no roof."""


@dataclass(frozen=True)
class Recipe:
    """Which methods to use, with their parameters, and what to believe of the input."""

    ground: GroundMethod
    detect: Detector | None
    """None stops after the ground."""
    outline: OutlineMethod
    roof: RoofMethod
    reconstruct: Reconstructor
    units: UnitMethod | None = None
    """None leaves detected blocks whole."""
    use_classes: bool = False
    lod: str = "2.2"
    """The finest level of detail to keep; `0` stops at footprints."""

    @property
    def reach(self) -> float:
        """Width (m) of the surroundings a block is computed with: the largest of the methods'."""
        return max(self.ground.reach, self.scene_reach)

    @property
    def scene_reach(self) -> float:
        """Width (m) of the surroundings the detector sees: its reach, in whole 3 m (all cells' multiple)."""
        needed = max(self.detect.reach if self.detect else 0.0, 2 * SEAM)
        return float(np.ceil(needed / 3.0) * 3.0)


def make_recipe(
    names: Mapping[str, str | None] | None = None,
    parameters: Mapping[str, dict[str, object]] | None = None,
    *,
    published: bool = False,
    use_classes: bool = False,
    lod: str = "2.2",
) -> Recipe:
    """The recipe for the methods named by stage; a stage not named uses its default.

    A detector brings the ground filter of its own paper unless one is named. With `use_classes` buildings
    are the points of class 6 unless a detector is named. The name `off` for units leaves blocks whole.

    Examples
    --------
    >>> import eaves
    >>> recipe = eaves.make_recipe({"detect": "normal_echo"})
    >>> recipe.ground.name, recipe.detect.name, recipe.roof.name
    ('smooth_region', 'normal_echo', 'global_refinement')
    """
    chosen = {stage: name for stage, name in (names or {}).items() if name}
    if use_classes:
        chosen.setdefault("detect", "given_classes")
    detector = method_class("detect", chosen.get("detect", DEFAULTS["detect"]))
    chosen.setdefault("ground", getattr(detector, "ground_method", DEFAULTS["ground"]))
    made: dict[str, Method] = {
        stage: make_method(stage, chosen.get(stage), (parameters or {}).get(stage), published)
        for stage in DEFAULTS
        if (stage, chosen.get(stage)) != ("units", "off")
    }
    return Recipe(**made, use_classes=use_classes, lod=lod)  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class BlockResult:
    """What the block pass found out about the points in one block; arrays are (N,) and in canonical order."""

    block: Block
    xyz: Points
    point_id: NDArray[np.int64]
    classification: NDArray[np.uint8]
    label: Labels
    part: NDArray[np.uint8]
    height: NDArray[np.float32]
    score: NDArray[np.float64]
    """Of each label, (K,)."""
    dtm: Raster
    dsm: Raster
    spacing: float
    seam_id: NDArray[np.int64]
    seam_label: Labels
    """Labelled points within `SEAM` of the border, on both sides of it."""
    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def extent(self) -> Bounds:
        """World metres of the block's points; there is at least one."""
        return Bounds.of(self.xyz).moved(*self.block.origin)


@dataclass(frozen=True, eq=False)
class BuildingPoints:
    """One building before it is modelled: its points (N,) about its home block's origin, the terrain."""

    home: Block
    xyz: Points
    point_id: NDArray[np.int64]
    part: NDArray[np.uint8]
    terrain: Raster
    spacing: float
    score: float
    number: int
    """Number among the buildings of its home block: the seed of its random numbers."""
    given: Footprint | None = None
    block_id: str = ""
    """Of the detected block that the building is a unit of; empty for one that is a block of its own."""
    wall_certainty: float | None = None
    """Probability of the least sure party wall that was found on it, None where none was."""

    @property
    def roof_points(self) -> Points:
        """The points (M, 3) that are not on walls."""
        return np.asarray(self.xyz[self.part != WALL])


@dataclass(frozen=True, eq=False)
class BuildingResult:
    """A model, or the Failure (with its footprint), and the roof plane of every point (N,), 0 for none."""

    answer: BuildingModel | Failure
    point_id: NDArray[np.int64]
    plane: Labels
    seconds: dict[str, float] = field(default_factory=dict)

    @classmethod
    def broken(cls, building: BuildingPoints, error: Exception) -> BuildingResult:
        """What is left of a building whose pass raised: its place, its points, the error as the reason."""
        place = name_footprint(building.given or hull_of(building.xyz, building.spacing), building)
        failure = Failure("internal_error", f"{type(error).__name__}: {error}", "pipeline", place)
        return cls(failure, building.point_id, np.zeros(len(building.xyz), np.int32))

    @classmethod
    def without_points(cls, failure: Failure) -> BuildingResult:
        """A given footprint that no point belongs to."""
        return cls(failure, np.zeros(0, np.int64), np.zeros(0, np.int32))


def make_scene(cloud: PointCloud, bounds: Bounds, cell: float = CELL) -> Scene:
    """A classified cloud with its terrain, its surface and every point's height; `bounds` in local metres.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> cloud = truth.classified()
    >>> scene = eaves.make_scene(cloud, cloud.bounds)
    >>> bool(abs(scene.height[cloud.classification == 2]).max() < 0.5)
    True
    """
    dtm, dsm = make_dtm(cloud, bounds, cell), make_dsm(cloud, bounds, cell)
    return Scene(cloud, dtm, dsm, measure_spacing(cloud.xyz), cloud.xyz[:, 2] - dtm.at(cloud.xyz))


def block_pass(cloud: PointCloud, block: Block, recipe: Recipe) -> BlockResult:
    """Ground, rasters and regions of one block.

    `cloud` must hold the points of the block and of its surroundings up to `recipe.reach`, and no others:
    then the answer is the same whichever files or tiles they came from.
    """
    clock = Clock()
    cloud = cloud.about(block.origin).in_canonical_order()
    cloud = classify_ground(cloud, recipe.ground, use_classes=recipe.use_classes)
    clock.lap("ground")
    core = Bounds(0.0, 0.0, block.side, block.side)
    seen = core.grown(recipe.scene_reach)
    cloud = cloud.take(seen.contains(cloud.xyz))
    scene = make_scene(cloud, seen)
    clock.lap("rasters")
    nothing = Regions(np.zeros(len(cloud), np.int32))
    regions = detect_buildings(scene, recipe.detect) if recipe.detect else nothing
    clock.lap("detect")

    inside = core.contains(cloud.xyz)
    labelled = np.flatnonzero(regions.label > 0)
    place = cloud.xyz.take(labelled, axis=0)
    seam = labelled[core.grown(SEAM).contains(place) & ~core.grown(-SEAM).contains(place)]
    part = regions.part if regions.part is not None else np.zeros(len(cloud), np.uint8)
    assert cloud.classification is not None and cloud.point_id is not None
    return BlockResult(
        block=block,
        xyz=cloud.xyz[inside],
        point_id=cloud.point_id[inside],
        classification=cloud.classification[inside],
        label=regions.label[inside],
        part=part[inside],
        height=scene.height[inside].astype(np.float32),
        score=regions.score,
        dtm=crop(scene.dtm, core),
        dsm=crop(scene.dsm, core),
        spacing=scene.spacing,
        seam_id=cloud.point_id[seam],
        seam_label=regions.label[seam],
        seconds=clock.laps,
    )


def draw_footprints(buildings: Sequence[BuildingPoints], recipe: Recipe) -> list[Footprint | Failure]:
    """A footprint for each building that is not given one; those of one home block are regularised together,
    so that neighbours share their edges.
    """
    drawn: list[Footprint | Failure] = [
        building.given or Failure("no_outline", "the outline stage answered nothing", "outline")
        for building in buildings
    ]
    boundaries: dict[int, Boundary] = {}
    for number, building in enumerate(buildings):
        if building.given is None:
            boundary = trace_outline(building.roof_points, building.spacing, recipe.outline)
            if isinstance(boundary, Failure):
                drawn[number] = boundary
            else:
                boundaries[number] = boundary
    regular = regularise_outlines(list(boundaries.values()), recipe.outline)
    for number, footprint in zip(boundaries, regular, strict=True):
        drawn[number] = footprint
    return drawn


def building_pass(building: BuildingPoints, footprint: Footprint | Failure, recipe: Recipe) -> BuildingResult:
    """Roof planes and solids of one building with its footprint."""
    clock = Clock()
    roof = np.flatnonzero(building.part != WALL)
    points = building.roof_points
    plane = np.zeros(len(building.xyz), np.int32)
    if isinstance(footprint, Failure):
        blank = name_footprint(hull_of(building.xyz, building.spacing), building)
        return BuildingResult(
            Failure(footprint.code, footprint.reason, footprint.stage, blank),
            building.point_id,
            plane,
            clock.laps,
        )
    footprint = name_footprint(footprint, building)
    if recipe.lod == "0":
        model = BuildingModel(footprint, {}, attributes=unit_attributes(footprint, building))
        return BuildingResult(model, building.point_id, plane, clock.laps)

    rng = np.random.default_rng(
        [building.home.column & 0xFFFFFFFF, building.home.row & 0xFFFFFFFF, building.number]
    )
    planes = segment_roof(points, building.spacing, recipe.roof, rng=rng)
    for number, found in enumerate(planes, 1):
        plane[roof[found.members]] = number
    clock.lap("roof")

    base, terrain = heights_under(footprint, building.terrain)
    if not np.isfinite(base):
        answer: BuildingModel | Failure = Failure(
            "no_ground", "no terrain under the footprint", "reconstruct"
        )
    else:
        answer = reconstruct_building(points, footprint, planes, base, recipe.reconstruct)
    clock.lap("reconstruct")
    if isinstance(answer, BuildingModel):
        answer = keep_valid(answer, recipe.lod)
    clock.lap("validate")
    if isinstance(answer, Failure):
        answer = Failure(answer.code, answer.reason, answer.stage, footprint)
    else:
        facts = {"h_ground": terrain, **unit_attributes(footprint, building)}
        answer = answer.with_(attributes={**answer.attributes, **facts})
    return BuildingResult(answer, building.point_id, plane, clock.laps)


def unit_attributes(footprint: Footprint, building: BuildingPoints) -> dict[str, object]:
    """The block that the building is a unit of, itself where it is whole, and how sure its walls are."""
    return {"block_id": building.block_id or footprint.id, "wall_certainty": building.wall_certainty}


def hull_of(points: Points, spacing: float) -> Footprint:
    """The convex hull of points, widened by the spacing: the place of a building that has no outline."""
    return Footprint(
        shapely.MultiPoint(points[:, :2]).convex_hull.buffer(max(spacing, 0.1), join_style="mitre")
    )


def name_footprint(footprint: Footprint, building: BuildingPoints) -> Footprint:
    """The footprint with origin, score and, unless given one, the id of its representative point's cell."""
    home = building.home
    if footprint.id:
        return footprint.with_(origin=home.origin)
    point = footprint.polygon.representative_point()
    block = Block.at(point.x + home.origin[0], point.y + home.origin[1], home.side)
    column = int((point.x + home.origin[0] - block.origin[0]) / CELL)
    row = int((point.y + home.origin[1] - block.origin[1]) / CELL)
    name = f"b{block.column}_{block.row}_{column}_{row}"
    return footprint.with_(origin=home.origin, score=building.score, id=name)


def heights_under(footprint: Footprint, terrain: Raster) -> tuple[float, float]:
    """The lowest terrain height on the outline, and its 5th percentile (m); NaN where no terrain is known."""
    rim = shapely.segmentize(footprint.polygon, terrain.cell)
    heights = terrain.at(shapely.get_coordinates(rim))
    heights = heights[np.isfinite(heights)]
    if len(heights) == 0:
        return float("nan"), float("nan")
    return float(heights.min()), float(np.percentile(heights, 5))


def keep_valid(model: BuildingModel, finest: str) -> BuildingModel | Failure:
    """The model without the levels that are finer than asked for or not valid, and why they went."""
    wanted = {lod: solids for lod, solids in model.solids.items() if lod <= finest}
    bad: dict[str, Finding] = {}
    if validate_model(model.with_(solids=wanted)):
        for lod, solids in wanted.items():
            found = validate_model(model.with_(solids={lod: solids}))
            if found:
                bad[lod] = found[0]
    good = {lod: solids for lod, solids in wanted.items() if lod not in bad}
    reasons = "; ".join(f"LoD {lod}: {one.code} {one.name} {one.detail}" for lod, one in sorted(bad.items()))
    if not good:
        return Failure("invalid_solid", reasons or "no solid", "reconstruct")
    kept = model.with_(solids=good)
    attributes = {**model.attributes, "lod": kept.lod}
    if bad and max(bad) > kept.lod:
        attributes |= {"fallback_code": "invalid_solid", "fallback_reason": reasons}
    return kept.with_(attributes=attributes)


def building_classes(result: BlockResult, found: NDArray[np.int64]) -> NDArray[np.uint8]:
    """The classes of a block's points (N,) with 6 for those that belong to a building (`found` > 0)."""
    classes = result.classification.copy()
    classes[found > 0] = BUILDING
    return classes


def crop(raster: Raster, bounds: Bounds) -> Raster:
    """The cells of a raster inside `bounds`, which run along cell borders."""
    first_column = round((bounds.west - raster.west) / raster.cell)
    first_row = round((raster.north - bounds.north) / raster.cell)
    columns, rows = round(bounds.width / raster.cell), round(bounds.height / raster.cell)
    values = raster.values[first_row : first_row + rows, first_column : first_column + columns]
    return Raster(values.copy(), bounds.west, bounds.north, raster.cell)


class Clock:
    """Seconds spent between laps, by name."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.process_time()

    def lap(self, name: str) -> None:
        """Book the processor time (s) since the last lap under `name`."""
        now = time.process_time()
        self.laps[name] = self.laps.get(name, 0.0) + now - self._last
        self._last = now
