"""The closed solution of source 5 beside the fit, in its own chain: on plans, in rows of like houses, drawn.

Run `EAVES_DATA=... python -m benchmarks.accuracy.moments_chain [--groups]`.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from benchmarks.accuracy.moments import NOISE, Truth, errors, scan
from benchmarks.accuracy.moments_rows import ROWS, row_houses
from benchmarks.accuracy.roof import delft_roofs
from benchmarks.table import keep
from eaves.geometry.rings import as_polygon
from eaves.model import Failure, Footprint, Points
from eaves.published.maas_vosselman.moments import Moments
from eaves.published.maas_vosselman.moments.building import ParametricBuilding, rectangle_around
from eaves.published.maas_vosselman.reconstruction import MaasVosselman, Primitive, cut_plan
from eaves.reconstruct.toolkit.evidence import seen_roof

COMMAND = "python -m benchmarks.accuracy.moments_chain"
SQUARE = 1.2
"""A plan of less length over width is a square to its moments."""
SEEDS = range(5)
HOUSES = 40
"""Drawn houses of each kind and seed."""
SIZES = "length m", "width m", "eaves m", "ridge m"
Row = dict[str, object]


def chain(plan_given: bool, closed_only: bool) -> MaasVosselman:
    """The chain's reconstructor in one of its four modes."""
    return MaasVosselman(houses=Moments(ground_plan=plan_given, closed_only=closed_only))


def primitives_of_delft(data: Path) -> Iterator[tuple[int, Polygon, Points]]:
    """Number of the footprint, piece and roof points of every primitive of every plan."""
    for number, (plan, own) in enumerate(delft_roofs(data)):
        origin = np.floor(own.mean(axis=0)) * [1.0, 1.0, 0.0]
        local = as_polygon(shapely.transform(plan, lambda xy, shift=origin[:2]: xy - shift))
        assert local is not None
        seen = seen_roof(own - origin, Footprint(local))
        if not isinstance(seen, Failure):
            for piece in cut_plan(local, 0.9, 6.0)[0]:
                yield number, piece, (own - origin)[seen[1]]


def differences(fit: ParametricBuilding) -> list[float]:
    """Closed solution against fit: axis (degrees, a flat roof's to 90), eaves, ridge (m), slope (degrees)."""
    turn = 90.0 if "flat" in (fit.roof, fit.closed.roof) else 180.0
    axis = np.degrees(fit.closed.orientation - fit.orientation)
    return [
        abs((axis + turn / 2.0) % turn - turn / 2.0),
        abs(fit.closed.eaves - fit.eaves),
        abs(fit.closed.ridge - fit.ridge),
        float(np.degrees(abs(fit.closed.slope - fit.slope))),
    ]


def beside_rows(data: Path) -> Iterator[Row]:
    """Closed solution and fit over every primitive of Delft, with and without the plan."""
    pieces = list(primitives_of_delft(data))
    for plan_given in (True, False):
        pairs: list[tuple[Primitive, Primitive]] = []
        for _, piece, roof in pieces:
            fit, closed = (chain(plan_given, only).shape(piece, roof, True) for only in (False, True))
            pairs.append((fit, closed))
        fitted = [(f, c) for f, c in pairs if f.house is not None]
        oblong = [
            (f, c)
            for f, c in fitted
            if (box := rectangle_around(f.piece)) and box.length >= SQUARE * box.width
        ]
        both = [(f, c) for f, c in oblong if c.house is not None]
        for name, group in (("all", fitted), ("no squares", oblong), ("no squares, closed is a house", both)):
            off = np.array([differences(f.house) for f, _ in group if f.house is not None])
            yield {
                "plan": "given" if plan_given else "not used",
                "houses": name,
                "primitives": len(pieces),
                "by the fit": len(group),
                "by the closed solution": sum(c.house is not None for _, c in group),
                "axis within 5°": round(float((off[:, 0] <= 5.0).mean()), 3),
                "eaves within 0.3 m": round(float((off[:, 1] <= 0.3).mean()), 3),
                **{
                    f"{label}, median / ninth decile": f"{np.median(one):.2f} / {np.quantile(one, 0.9):.2f}"
                    for label, one in zip(("axis °", "eaves m", "ridge m", "slope °"), off.T, strict=True)
                },
            }


def group_rows(data: Path) -> Iterator[Row]:
    """Deviation within groups of like houses: the experiment of the article."""
    largest: dict[int, tuple[Polygon, Points]] = {}
    for number, piece, roof in primitives_of_delft(data):
        if number not in largest or piece.area > largest[number][0].area:
            largest[number] = piece, roof[shapely.contains_xy(piece, roof[:, :2])]
    faces = {house.number: house.points[house.roof] for _, houses in row_houses(data) for house in houses}
    for name, numbers in ROWS.items():
        for part, points in (
            ("largest primitive", {k: largest[k][1] for k in numbers}),
            ("two main faces", faces),
        ):
            for stage in ("closed", "fit"):
                method = Moments(closed_only=stage == "closed")
                houses = [method.house_of(points[k], largest[k][0], False) for k in numbers if k in points]
                found = [one for one in houses if isinstance(one, ParametricBuilding)]
                values = np.array(
                    [[*measures(one), axis] for one, axis in zip(found, axes_of(found), strict=True)]
                )
                spread = np.std(values, axis=0, ddof=1)
                columns = (*SIZES, "slope °", "axis °")
                row: Row = {"group": name, "points of the": part, "stage": stage, "houses": len(values)}
                yield row | dict(zip(columns, map(float, spread), strict=True))


def axes_of(houses: list[ParametricBuilding]) -> list[float]:
    """Axes (°) of houses of one row about their mean direction, -45 to 45: a square has two."""
    angles = np.array([house.orientation for house in houses])
    mean = np.angle(np.exp(4j * angles).mean()) / 4.0
    quarter = np.pi / 2.0
    return [float(one) for one in np.degrees((angles - mean + quarter / 2.0) % quarter - quarter / 2.0)]


def measures(house: ParametricBuilding) -> list[float]:
    """Length, width, eaves, ridge (m), slope (degrees)."""
    return [house.length, house.width, house.eaves, house.ridge, float(np.degrees(house.slope))]


def drawn_points(kind: str, truth: Truth, rng: np.random.Generator) -> Points:
    """Points (N, 3) on a drawn gable with a dormer or an asymmetry, far from the origin."""
    points = scan(truth, 5.0, "random", rng)
    cosine, sine = np.cos(truth.orientation), np.sin(truth.orientation)
    u, v = points[:, 0] * cosine + points[:, 1] * sine, points[:, 1] * cosine - points[:, 0] * sine
    if kind == "dormer of 2.4 m by 2 m":
        dormer = (np.abs(u - 1.0) < 1.2) & (v > 0.2 * truth.width) & (v < 0.2 * truth.width + 2.0)
        points[dormer, 2] = truth.rise + NOISE * rng.standard_normal(int(dormer.sum()))
    if kind == "ridge 0.5 m off the middle":
        height = truth.tangent * (truth.width / 2.0 - np.abs(v - 0.5))
        points[:, 2] += height - truth.height_at(u, v)
    return points + [310.0, 170.0, 0.0]


def drawn_rows() -> Iterator[Row]:
    """Plain, dormered and asymmetric gables of which everything is known, by the chain, over five seeds."""
    for kind in ("plain gable", "dormer of 2.4 m by 2 m", "ridge 0.5 m off the middle"):
        for stage in ("closed", "fit"):
            means, modelled, parts = [], [], []
            for seed in SEEDS:
                off = []
                for number in range(HOUSES):
                    rng = np.random.default_rng([19, seed, number])
                    width = rng.uniform(7.0, 10.0)
                    sizes = (width * rng.uniform(1.3, 2.2), width, rng.uniform(0.5, 1.0))
                    truth = Truth("gable", *sizes, rng.uniform(0.0, np.pi))
                    points = drawn_points(kind, truth, rng)
                    box = shapely.box(-truth.length / 2, -width / 2, truth.length / 2, width / 2)
                    turned = shapely.affinity.rotate(box, truth.orientation, (0, 0), use_radians=True)
                    plan = shapely.affinity.translate(turned, 310.0, 170.0)
                    shape = chain(False, stage == "closed").shape(plan, points, False)
                    modelled.append(shape.house is not None)
                    if shape.house is not None:
                        parts.append(len(shape.parts))
                        off.append(np.abs(errors(truth, shape.house)))
                means.append(np.mean(off, axis=0) if off else np.full(6, np.nan))
            table: NDArray[np.float64] = np.array(means)
            yield {
                "roof": kind,
                "stage": stage,
                "modelled": round(float(np.mean(modelled)), 3),
                "parts a house": round(float(np.mean(parts)), 2) if parts else None,
                **{
                    name: f"{np.mean(one):.3f} ± {np.std(one, ddof=1):.3f}"
                    for name, one in zip(
                        ("length m", "width m", "eaves m", "ridge m", "axis °", "slope °"),
                        table.T,
                        strict=True,
                    )
                },
            }


def main() -> None:
    """Print and keep the three tables."""
    data = Path(os.environ["EAVES_DATA"])
    keep(
        "moments-groups",
        "Groups of like houses",
        list(group_rows(data)),
        COMMAND,
        "The groups are those of moments-rows; of each house all roof points of the largest primitive of its "
        "plan, or those of the two largest planes that face each other; sizes and axis from the points; axes "
        "about the mean of the row, of squares too. The plans of terraces differ by annexes under the same "
        "roof, which the faces leave out. The article reports 0.1 to 0.2 m and 1 to 2°.",
    )
    if "--groups" in sys.argv:
        return
    keep(
        "moments-chain",
        "Closed solution beside fit",
        list(beside_rows(data)),
        COMMAND,
        "Every primitive of the 92 plans whose fit is a standard house; absolute differences of the closed "
        "solution from the fit. *Plan given*: axes, place and sizes are the plan's. *No squares*: length "
        f"over width of at least {SQUARE}. The axis of a flat roof counts to 90°, of others to 180°.",
    )
    keep(
        "moments-drawn",
        "Drawn gables",
        list(drawn_rows()),
        COMMAND,
        f"Mean absolute errors of {HOUSES} houses at 5 points/m² and {NOISE} m of noise, mean and standard "
        f"deviation over {len(SEEDS)} drawn seeds; axis and sizes from the points.",
    )


if __name__ == "__main__":
    main()
