"""The rules of the defaults that `benchmarks.accuracy.ablation` switches off, one by one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eaves.detect.consensus import classifier
from eaves.ground.adaptive_tin.densification import near_surface
from eaves.units.row_walls import evidence

NEVER, ALWAYS = 1e9, -1e9


@dataclass(frozen=True)
class Rule:
    """A group of numbers with one purpose, and what switches it off: parameters by stage, constants and
    functions by module."""

    name: str
    rooms: tuple[str, ...]
    numbers: int
    off: Mapping[str, Any]


def without_term(name: str, usual: float) -> Any:
    """The weights of the classifier in which a term always has its usual value."""
    made = {}
    for kind, shape in (("surface", classifier.SURFACE_SHAPE), ("cell", classifier.CELL_SHAPE)):
        weights = list(getattr(classifier.FITTED, kind))
        if name in shape:
            for first in (0, len(shape)):
                weights[first] += usual * weights[first + shape.index(name)]
                weights[first + shape.index(name)] = 0.0
        elif name in ("echoes", "penetration"):
            weights[2 * len(shape) + (name == "penetration")] = 0.0
        elif name == "by echoes":
            weights[len(shape) : 2 * len(shape)] = [0.0] * len(shape)
        made[kind] = tuple(weights)
    return replace(classifier.FITTED, **made)


def detect(name: str, numbers: int, off: Mapping[str, Any]) -> Rule:
    """A rule of the detector."""
    return Rule(f"detect: {name}", ("detect",), numbers, off)


def of(room: str, name: str, numbers: int, off: Mapping[str, Any]) -> Rule:
    """A rule of a stage."""
    return Rule(f"{room}: {name}", (room,), numbers, off)


def nowhere(evidence: Any, *_: Any) -> Any:
    """No cell, twice."""
    return np.zeros(evidence.shape, bool), np.zeros(evidence.shape, bool)


def no_decks(heights: Any, *_: Any) -> Any:
    """No deck."""
    return np.full(heights.shape, np.nan, np.float32), []


METHOD = "detect.consensus.method:"
TERMS = {"company": 0.5, "enclosed": 0.3, "rough": 0.2, "low": -0.3, "width": 0.5, "height": 0.7, "area": 1.0}
DETECT = (
    detect("vehicles", 5, {"detect.vehicle_height": 0.0}),
    detect("narrow parts", 1, {"detect.room": 0.0}),
    detect(
        "hidden roofs",
        0,
        {f"{METHOD}find_hidden_roofs": lambda evidence, xyz, *_: np.zeros(len(xyz), np.int32)},
    ),
    detect("voids", 5, {f"{METHOD}find_roof_voids": nowhere}),
    detect("even roofs", 2, {"detect.even_area": NEVER}),
    detect("attachment", 3, {"detect.max_attached": 1.0}),
    detect("small surfaces", 1, {"detect.small_surface": 0.0}),
    detect("windows of two cells", 1, {"detect.window_price": NEVER}),
    detect("windows on a line", 1, {"detect.window_width": 0.0}),
    detect("measured rounds", 1, {"detect.rounds": 1}),
    detect("echoes, all", 6, {"detect.rounds": 0}),
    detect("most log ratio", 1, {"detect.most_log_ratio": 50.0}),
    detect("the cut", 3, {"detect.smoothness": 0.0}),
    detect("walls", 2, {"detect.wall_below_plane": NEVER}),
    detect(
        "doubts, all",
        4,
        {f"{METHOD}{name}_doubts": (lambda *_: []) for name in ("region", "void")},
    ),
    *(
        detect(f"term {name}", 2, {"detect.consensus.classifier:FITTED": without_term(name, usual)})
        for name, usual in TERMS.items()
    ),
    *(
        detect(f"term {name}", 2, {"detect.consensus.classifier:FITTED": without_term(name, 0.0)})
        for name in ("echoes", "penetration", "by echoes")
    ),
)
WIRES, DECKS, GREEN = (
    "surroundings.wires:RULES.",
    "surroundings.decks:RULES.",
    "surroundings.vegetation:VegetationRules.",
)
RUN = (
    of("wires", "all", 10, {"surroundings.wires:find_wires": lambda cloud, *_: np.zeros(len(cloud), bool)}),
    of(
        "wires", "towers", 2, {"surroundings.wires:find_towers": lambda cloud, *_: np.zeros(len(cloud), bool)}
    ),
    of("wires", "few around", 1, {f"{WIRES}few": 10**9}),
    of("decks", "all", 8, {"surroundings.decks:find_decks": no_decks}),
    of("decks", "water", 2, {f"{DECKS}water_share": -1.0}),
    of("decks", "edges", 0, {"surroundings.decks:with_edges": lambda found, *_: found}),
    of("vegetation", "echoes", 1, {f"{GREEN}echoes": NEVER}),
    of("vegetation", "roughness", 1, {f"{GREEN}roughness": NEVER}),
)
TIN = "ground.adaptive_tin.method:"
SEEDS = "ground.toolkit.seeds:"
GROUND = (
    of("ground", "wide objects", 5, {f"{TIN}AdaptiveTin.find_wide_objects": lambda *_: None}),
    of("ground", "pits", 4, {"ground.toolkit.floor:without_pits": lambda heights, _: heights}),
    of("ground", "rims that go up", 1, {"ground.up_weight": 0.0}),
    of("ground", "rims to void", 1, {"ground.void_weight": 0.0}),
    of("ground", "rims level", 1, {"ground.level_weight": 0.0}),
    of(
        "ground",
        "outliers under the terrain",
        2,
        {"ground.toolkit.outliers:under_terrain": lambda _, _bounds, low, *_rest: low},
    ),
    of(
        "ground",
        "terraces",
        2,
        {f"{SEEDS}find_terraces": lambda _, objects, *_rest: objects & False},
    ),
    of("ground", "steep slopes go on less", 1, {"ground.terrace_steep": 0.0}),
    of("ground", "rim", 2, {f"{TIN}rim_points": lambda *_: np.zeros((0, 3))}),
    of(
        "ground",
        "outliers",
        6,
        {"ground.stage:find_outliers": lambda cloud: (np.zeros(len(cloud), bool),) * 2},
    ),
    of("ground", "mirror", 1, {"ground.steep": NEVER}),
    of("ground", "looks", 1, {"ground.looks": 1}),
    of("ground", "angle by spacing", 1, {"ground.angle_share": 0.0}),
    of("ground", "slant", 0, {f"{TIN}near_surface": lambda *given: near_surface(*given[:4], 0.0)}),
    of("ground", "tolerance by roughness", 2, {"ground.tolerance_least": 0.2, "ground.tolerance_most": 0.2}),
    of("ground", "rounds", 1, {"ground.rounds": 10**6}),
    of("ground", "distance", 1, {"ground.distance_share": NEVER}),
)
OUTLINE = (
    of(
        "outline",
        "shared edges",
        0,
        {"outline.global_fit.method:share_edges": lambda shapes, *_: list(shapes)},
    ),
    of("outline", "sparse parts", 1, {"outline.sparse": 1.0}),
    of("outline", "low parts", 5, {"outline.balcony": 0.0, "outline.low_drop": NEVER}),
    of("outline", "beam", 1, {"outline.spot": 0.0}),
    of("outline", "first frame cheaper", 1, {"outline.direction": 0.0}),
    of("outline", "points on no side", 1, {"outline.stray": NEVER}),
    of("outline", "shift of edges", 4, {"outline.strip_before": 1e-9, "outline.strip_behind": 1e-9}),
    of("outline", "walls beside", 2, {"outline.wall_beside": 0.0, "outline.least_beside": 0.0}),
    of("outline", "measured spacing", 2, {"outline.global_fit.method:wide_radius": lambda *_: 0.0}),
    of("outline", "share inside", 1, {"outline.share": 0.0}),
    of("outline", "blur", 1, {"outline.blur": 0.01}),
)
WEIGHTS = "units.row_walls.evidence:WEIGHTS"
UNITS = (
    of("units", "usual widths", 4, {"units.regular_gain": NEVER}),
    of("units", "smallest unit", 1, {"units.smallest_unit": 0.0}),
    of("units", "several", 8, {"units.row_walls.method:odds_of_several": lambda *_: 1.0}),
    of("units", "lean", 3, {"units.most_lean": 0.0}),
    of("units", "deeper rows", 1, {"units.most_deeper": NEVER}),
    of("units", "jogs of fronts", 2, {"units.jog": 0.0}),
    *(
        of("units", f"trait {name}", 1, {WEIGHTS: {**evidence.WEIGHTS, name: 0.0}})
        for name in ("ridge", "full valley")
    ),
)
FLAT = "reconstruct.arrangement:"
ROOF = (
    of("roof", "scan lines", 2, {"roof.global_refinement:on_lines": lambda *_: False}),
    of("roof", "planes in what is left", 1, {"roof.left_neighbours": 10**6}),
    of("roof", "price", 1, {"roof.price": 0.0}),
    of("roof", "relabelling", 5, {"roof.rounds": 0}),
    of("reconstruct", "height steps", 3, {"reconstruct.toolkit.plan_lines:step_lines": lambda *_: []}),
    of("reconstruct", "rectangles", 3, {"reconstruct.toolkit.plan_lines:rectangle": lambda *_: []}),
    of("reconstruct", "clutter levels", 4, {"reconstruct.clutter_points": 10**9}),
    of(
        "reconstruct",
        "corner prices",
        3,
        {"reconstruct.arrangement:settle_corners": lambda plan, labels, *_: (plan, labels)},
    ),
    of("reconstruct", "plane price", 2, {"reconstruct.plane_points": 0.0}),
    of("reconstruct", "gross residual", 1, {"reconstruct.gross_limit": 0.36}),
    of("roof", "crowns", 2, {"buildings.building:crown_points": lambda xyz, _: np.zeros(len(xyz), bool)}),
    of("reconstruct", "cheap meetings", 2, {"reconstruct.meeting_share": 1.0}),
    of("reconstruct", "extension", 1, {"reconstruct.extension": 0.0}),
    of("reconstruct", "superstructures", 13, {"reconstruct.superstructure_points": 10**9}),
    of(
        "reconstruct",
        "superstructures: beside",
        3,
        {"reconstruct.toolkit.superstructures:explained_beside": lambda *_: False},
    ),
    of(
        "reconstruct",
        "short edges",
        3,
        {"solids.extrude:merge_short_edges": lambda plan, labels, *_: (plan, labels)},
    ),
    of("reconstruct", "face quality", 4, {"figures.attributes:weakness": lambda record: None}),
)
RULES = (*DETECT, *RUN, *UNITS, *OUTLINE, *GROUND, *ROOF)
