"""Blocks drawn at random of which the truth is known: rows of houses, and single buildings of many wings.

Detached houses have garages, cross gables, wings of one storey, porches and chimneys, as American suburbs
have; large buildings are factories of several heights, halls, churches, slabs and schools. None of either is
to be divided.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon, box

from eaves.simulate.objects.exact import Mass
from eaves.simulate.objects.houses import (
    Masses,
    chimney,
    draw_church,
    draw_hall,
    draw_slab,
    flat,
    gable,
    hip,
    shed,
    shifted_masses,
)

DEPTH, SLOPE, NOISE = 9.0, 0.8, 0.03
"""Of the rows (m; rise per metre; m)."""
STOREY = 2.9
"""Height of a storey (m)."""
SORTS = ("eaves and ridge", "ridge", "depth", "fire walls", "no sign")
"""What tells two neighbours of a row apart: by 0.3 m, or a wall 0.3 m over the roof."""


@dataclass(frozen=True, eq=False)
class DrawnBlock:
    """Points (N, 3) on a block, its outline, and the mean distance (m) of the points."""

    points: NDArray[np.float64]
    outline: Polygon
    spacing: float


def drawn_row(
    sort: str, density: float, rng: np.random.Generator
) -> tuple[NDArray[np.float64], list[Polygon]]:
    """Points (N, 3) and houses of a row of four to nine gables of 5 to 7 m that differ by 0.3 m."""
    count, width = int(rng.integers(4, 10)), float(rng.uniform(5.0, 7.0))
    turn = 0.3 * (np.arange(count) % 2)
    push = turn if sort == "depth" else np.zeros(count)
    houses = [box(k * width, -push[k], (k + 1) * width, DEPTH + push[k]) for k in range(count)]
    total = int(count * width * (DEPTH + 0.6) * density)
    xy = np.column_stack([rng.uniform(0.0, count * width, total), rng.uniform(-0.3, DEPTH + 0.3, total)])
    house = np.minimum((xy[:, 0] / width).astype(np.int64), count - 1)
    inside = (xy[:, 1] >= -push[house]) & (xy[:, 1] <= DEPTH + push[house])
    xy, house = xy[inside], house[inside]
    run = np.minimum(xy[:, 1], DEPTH - xy[:, 1])
    steeper = 0.3 / (0.5 * DEPTH) * (house % 2) if sort == "ridge" else 0.0
    z = 6.0 + (turn[house] if sort == "eaves and ridge" else 0.0) + (SLOPE + steeper) * run
    if sort == "fire walls":
        z[np.abs(xy[:, 0] - np.round(xy[:, 0] / width) * width) < 0.2] += 0.3
    return np.column_stack([xy, z + rng.normal(0.0, NOISE, len(xy))]), houses


def detached_house(rng: np.random.Generator) -> Masses:
    """A gable or hip of one or two storeys with a garage, a cross gable, a lower wing, a porch, a chimney."""
    length, width = float(rng.uniform(11.0, 18.0)), float(rng.uniform(7.5, 12.0))
    length, width = max(length, width), min(length, width)
    slope, two = float(rng.uniform(0.35, 1.0)), rng.random() < 0.5
    eaves = rng.uniform(2.6, 3.2) + STOREY * two
    hipped = rng.random() < 0.5
    main = hip(length, width, slope, slope * rng.uniform(0.8, 1.4)) if hipped else gable(length, width, slope)
    masses = shifted_masses(main, 0.0, 0.0, eaves)
    if rng.random() < 0.75:
        span, end = float(rng.uniform(5.8, 7.5)), rng.choice([-1, 1])
        place = end * (length - span) / 2 + rng.uniform(-1.5, 1.5) * (rng.random() < 0.5)
        low = eaves - STOREY * (two and rng.random() < 0.5)
        masses += cross_wing(width / 2 + rng.uniform(1.0, 7.0), span, slope, place, low, rng)
    if rng.random() < 0.5:
        span, place = float(rng.uniform(3.0, 5.5)), rng.uniform(-0.35, 0.35) * length
        masses += cross_wing(width / 2 + rng.uniform(0.5, 2.5), span, slope, place, eaves, rng)
    if rng.random() < 0.4:
        long, deep, end = rng.uniform(4.0, 8.0), width * rng.uniform(0.55, 0.95), rng.choice([-1, 1])
        lower = STOREY if two and rng.random() < 0.6 else rng.choice([0.0, rng.uniform(0.3, 1.2)])
        aside = rng.uniform(-1.0, 1.0) * (width - deep) / 2
        masses += shifted_masses(gable(long, deep, slope), end * (length + long) / 2, aside, eaves - lower)
    if rng.random() < 0.4:
        porch = shed(rng.uniform(3.0, 7.0), 3.0, 0.15)
        masses += shifted_masses(porch, rng.uniform(-0.3, 0.3) * length, -width / 2 - 1.4, 2.4)
    if rng.random() < 0.4:
        x, y = rng.uniform(-0.3, 0.3) * length, rng.uniform(-0.2, 0.2) * width
        masses += (chimney(x, y, eaves + slope * width / 2 + 0.7, 0.9),)
    return masses


def cross_wing(
    long: float, span: float, slope: float, place: float, eaves: float, rng: np.random.Generator
) -> Masses:
    """A gable or a hip across the main ridge, from it out to `long` (m), on either side."""
    whole = hip(2.0 * long, span, slope) if rng.random() < 0.5 else gable(2.0 * long, span, slope)
    half = Mass(box(0.0, -span / 2, long, span / 2), whole[0].planes)
    return shifted_masses((half,), place, 0.0, eaves, rng.choice([-1, 1]) * np.pi / 2)


def large_building(rng: np.random.Generator) -> Masses:
    """A factory of several heights, a hall, a church, a slab of flats or a school with wings."""
    kind = int(rng.integers(6))
    if kind < 2:
        return factory(rng)
    if kind == 2:
        return draw_hall(rng.uniform(25.0, 80.0), rng.uniform(15.0, 40.0), rng).masses
    if kind == 3:
        return draw_church(rng).masses
    if kind == 4:
        return draw_slab(60.0, rng).masses
    masses = shifted_masses(
        gable(rng.uniform(30.0, 60.0), rng.uniform(10.0, 14.0), rng.uniform(0.2, 0.6)), 0, 0, 6.0
    )
    for _ in range(int(rng.integers(1, 4))):
        side = gable(rng.uniform(15.0, 30.0), rng.uniform(8.0, 12.0), rng.uniform(0.2, 0.6))
        x, y = rng.uniform(-20.0, 20.0), rng.choice([-1, 1]) * rng.uniform(8.0, 14.0)
        masses += shifted_masses(side, x, y, rng.uniform(3.0, 8.0), np.pi / 2)
    return masses


def factory(rng: np.random.Generator) -> Masses:
    """A hall with one to five parts of other heights at its sides and up to three on its roof."""
    length, width, height = rng.uniform(25.0, 90.0), rng.uniform(18.0, 50.0), rng.uniform(6.0, 12.0)
    hall = flat(length, width) if rng.random() < 0.5 else gable(length, width, rng.uniform(0.05, 0.2))
    masses = shifted_masses(hall, 0.0, 0.0, height)
    for _ in range(int(rng.integers(1, 6))):
        long, wide = rng.uniform(8.0, 35.0), rng.uniform(8.0, 25.0)
        along, end = rng.uniform(-0.4, 0.4), rng.choice([-1, 1])
        over, out = along * length, end * ((width + wide) / 2 - 1.0)
        if rng.random() < 0.5:
            over, out = end * ((length + long) / 2 - 1.0), along * width
        other = float(rng.choice([0.0, -rng.uniform(0.3, 4.0), rng.uniform(0.3, 4.0)]))
        part = flat(long, wide) if rng.random() < 0.6 else gable(long, wide, rng.uniform(0.1, 0.5))
        masses += shifted_masses(part, over, out, max(height + other, 3.0))
    for _ in range(int(rng.integers(0, 4))):
        part = flat(rng.uniform(3.0, 15.0), rng.uniform(3.0, 15.0))
        place = rng.uniform(-0.3, 0.3, 2) * (length, width)
        masses += shifted_masses(part, float(place[0]), float(place[1]), height + rng.uniform(0.5, 3.0))
    return masses


def scanned(masses: Masses, density: float, rng: np.random.Generator) -> DrawnBlock | None:
    """Points at random on the roofs of masses, turned by any angle; None where they do not hang together."""
    outline = shapely.union_all([shapely.buffer(mass.polygon, 0.02, join_style="mitre") for mass in masses])
    if outline.geom_type != "Polygon":
        return None
    west, south, east, north = outline.bounds
    count = int((east - west) * (north - south) * density)
    xy = rng.uniform((west, south), (east, north), (count, 2))
    z = np.stack([mass.height_at(xy) for mass in masses]).max(axis=0)
    points = np.column_stack([xy, z + rng.normal(0.0, NOISE, count)])[np.isfinite(z)]
    angle = rng.uniform(0.0, np.pi)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    points[:, :2] = points[:, :2] @ turn
    whole = shapely.transform(Polygon(outline.exterior), lambda xy: xy @ turn)
    return DrawnBlock(points, whole, density**-0.5)


def single_buildings(
    draw: Callable[[np.random.Generator], Masses], density: float, count: int, seed: int
) -> Iterator[DrawnBlock]:
    """At most `count` buildings of one kind, scanned."""
    for number in range(count):
        rng = np.random.default_rng([number, seed, int(10 * density)])
        block = scanned(draw(rng), density, rng)
        if block is not None:
            yield block
