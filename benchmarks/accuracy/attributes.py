"""What models say of themselves, on houses of which everything is known: type, heights, storeys, areas."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.table import keep
from eaves.figures.attributes import LEVEL_SLOPE_DEG, QUARTERS, quarter_of
from eaves.model import BuildingModel, Failure, Footprint
from eaves.outline import regularise_outlines, trace_outline
from eaves.reconstruct import reconstruct_building
from eaves.roof import segment_roof
from eaves.simulate.objects.exact import ExactBuilding, Mass
from eaves.simulate.objects.houses import STOREY, draw_detached, make_building

HOUSES, NOISE = 300, 0.03
"""Houses of each density; standard deviation of heights (m)."""
TYPES = {
    "flat": "flat",
    "flat with parapet": "flat",
    "shed": "shed",
    "gable": "gable",
    "asymmetric gable": "gable",
    "gambrel": "gable",
    "hip": "hip",
    "half-hip": "hip or gable",
    "mansard": "hip",
    "pyramid": "pyramid",
    "L-shape": "complex",
    "T-shape": "complex",
}
"""The roof type, or types, that each kind of drawn house may be called."""
LEVEL_DEG = 6.0
"""A shed flatter than this is a flat roof by definition."""


@dataclass(frozen=True, eq=False)
class DrawnHouse:
    """A house with its roof type, the heights (m) of its eaves and its ridge, its storeys, and its points."""

    truth: ExactBuilding
    kind: str
    eaves: float
    ridge: float
    storeys: int
    points: NDArray[np.float64]


def drawn_houses(density: float, seed: int) -> Iterator[DrawnHouse]:
    """Houses on level ground at height 0, with points at random."""
    for number in range(HOUSES):
        rng = np.random.default_rng([seed, number])
        design = draw_detached(rng)
        angle = float(rng.uniform(0.0, np.pi))
        masses = [mass.translated(angle, 0.0, 0.0, 0.0) for mass in design.masses]
        truth = make_building(masses, 1, 1, design.kind, 0.0, 0.0)
        west, south, east, north = truth.footprint.bounds
        count = int((east - west) * (north - south) * density)
        xy = rng.uniform((west, south), (east, north), (count, 2))
        z = np.stack([mass.height_at(xy) for mass in masses]).max(axis=0)
        points = np.column_stack([xy, z + rng.normal(0.0, NOISE, count)])[np.isfinite(z)]
        main = [mass for mass in design.masses if mass.part == "main"]
        corners = np.concatenate([np.asarray(mass.polygon.exterior.coords)[:-1] for mass in main[:1]])
        eaves = float(main[0].height_at(corners).min())
        ridge = highest_of(main[0])
        level = main[0].planes[0][1] < np.tan(np.radians(LEVEL_DEG))
        kind = "flat" if design.kind == "shed" and level else TYPES[design.kind]
        yield DrawnHouse(truth, kind, eaves, ridge, round((eaves - 0.35) / STOREY), points)


def highest_of(mass: Mass) -> float:
    """The highest place (m) of a mass: on its ridge, which a fine grid finds."""
    west, south, east, north = mass.polygon.bounds
    x, y = np.meshgrid(np.linspace(west, east, 201), np.linspace(south, north, 201))
    heights = mass.height_at(np.column_stack([x.ravel(), y.ravel()]))
    return float(heights[np.isfinite(heights)].max())


def modelled(house: DrawnHouse, density: float, traced: bool) -> BuildingModel | Failure:
    """The model of a house, on its true outline or on the one its points show."""
    footprint: Footprint | Failure = Footprint(house.truth.footprint)
    if traced:
        boundary = trace_outline(house.points, density**-0.5)
        if isinstance(boundary, Failure):
            return boundary
        footprint = regularise_outlines([boundary])[0]
        if isinstance(footprint, Failure):
            return footprint
    planes = segment_roof(house.points, density**-0.5)
    return reconstruct_building(house.points, footprint, planes, 0.0)


def area_error(house: DrawnHouse, model: BuildingModel) -> float:
    """The greatest difference of the roof area that looks to one quarter, as a share of the whole roof's."""
    true = dict.fromkeys(("flat", *QUARTERS), 0.0)
    for face in house.truth.faces:
        a, b, _ = face.coefficients
        slope = np.hypot(a, b)
        side = "flat"
        if np.degrees(np.arctan(slope)) >= LEVEL_SLOPE_DEG:
            side = quarter_of(float(np.degrees(np.arctan2(-a, -b))) % 360.0)
        true[side] += face.polygon.area * float(np.hypot(1.0, slope))
    found = {side: model.attributes[f"roof_area_{side}_m2"] for side in true}
    return max(abs(found[side] - true[side]) for side in true) / sum(true.values())


def attribute_row(density: float, traced: bool) -> dict[str, object]:
    """One line over all houses of a density."""
    wrong: Counter[str] = Counter()
    eaves, ridges, areas, storeys, count = [], [], [], 0, 0
    for house in drawn_houses(density, seed=11):
        count += 1
        model = modelled(house, density, traced)
        if isinstance(model, Failure):
            wrong["no model"] += 1
            continue
        told = model.attributes
        if told["roof_type"] not in house.kind:
            wrong[f"{house.truth.kind} as {told['roof_type']}"] += 1
        eaves.append(abs(told["h_eaves"] - house.eaves))
        ridges.append(abs(told["h_ridge"] - house.ridge))
        areas.append(area_error(house, model))
        storeys += told["storeysAboveGround"] == house.storeys
    return {
        "houses": f"{density:g}/m², outline {'traced' if traced else 'true'}",
        "count": count,
        "type right": round(1.0 - wrong.total() / count, 3),
        "eaves within .10 m": round(float(np.mean(np.array(eaves) <= 0.10)), 3),
        "eaves, 95 % (m)": round(float(np.percentile(eaves, 95)), 3),
        "ridge within .10 m": round(float(np.mean(np.array(ridges) <= 0.10)), 3),
        "ridge, 95 % (m)": round(float(np.percentile(ridges, 95)), 3),
        "storeys right": round(storeys / count, 3),
        "area of a quarter, 95 % (share)": round(float(np.percentile(areas, 95)), 3),
        "wrong types": ", ".join(f"{number} {name}" for name, number in wrong.most_common()),
    }


def main() -> None:
    """Write the table."""
    rows = [attribute_row(density, traced) for density in (10.0, 4.0) for traced in (False, True)]
    keep(
        "attributes",
        "What models say of themselves, on houses of which everything is known",
        rows,
        "python -m benchmarks.accuracy.attributes",
        "Half-hips may be called hips or gables; roofs flatter than 6° are flat by definition. Storeys are "
        "those of the drawn walls. The rules were written with houses of another seed in view.",
    )


if __name__ == "__main__":
    main()
