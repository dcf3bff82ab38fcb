"""A town at two times, with the exact list of what was built, raised, taken down or left as it was."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely import Polygon
from shapely.affinity import affine_transform

from eaves.formats import Row, atomic, undated, write_polygons
from eaves.model import Bounds
from eaves.model.checks import check_positive
from eaves.model.cloud import snap
from eaves.simulate.flight import Flight, Pattern
from eaves.simulate.objects.exact import ExactBuilding, ExactScene, Mass
from eaves.simulate.objects.houses import make_building
from eaves.simulate.objects.streets import TownStyle, draw_block
from eaves.simulate.objects.surfaces import TerrainKind
from eaves.simulate.scanner import Scanner, scan_town
from eaves.simulate.town import APART, RIM, BuildingSite, Town, lay_site, put_extras

CHANGES = ("new", "demolished", "raised", "lowered", "extended", "partly demolished", "roof replaced")
"""The changes that a building can undergo, beside `unchanged`."""

SMALLEST_M2 = 10.0
"""A smaller building is left as it is (m²)."""

IN_LEAF, OUT_OF_LEAF = 2.5, 0.6
"""Loss of a pulse's energy per metre of crown (1/m) in summer and in winter."""

LOWEST_WALL = 2.1
"""No change leaves walls lower than this (m) over the ground beside them."""

REPLACED_M2, REPLACED_M = 25.0, 0.5
"""Smallest building (m²) whose roof is replaced, and least mean height difference (m) of the new roof."""

OVERLAP = 0.3
"""Distance (m) by which an annex extends under the roof it is built to, so that both are one building."""

CARS_KEPT = 0.5
"""Share of the parking places that are taken at one time."""

Masses = tuple[Mass, ...]


@dataclass(frozen=True, eq=False)
class Change:
    """The exact change of one building.

    Parameters
    ----------
    id : str
        The building's, the same at both times.
    change : str
        `unchanged`, or one of `CHANGES`.
    old, new : Polygon or None
        Outline of the eaves (local m); None while there is no building.
    height_m : float
        Mean rise (m) of the roof over the outline common to both.
    area_m2, volume_m3 : float
        Growth of outline and volume.

    Examples
    --------
    >>> from eaves.simulate import simulate_epochs
    >>> {change.change for change in simulate_epochs(0.01, seed=3, changed=0.0).changes}
    {'unchanged'}
    """

    id: str
    change: str
    old: Polygon | None
    new: Polygon | None
    height_m: float
    area_m2: float
    volume_m3: float


@dataclass(frozen=True, eq=False)
class Epochs:
    """A town at two times, and what became of each of its buildings.

    Parameters
    ----------
    old, new : Town
        The town before and after.
    changes : tuple of Change
        One a building of either.

    Examples
    --------
    >>> from eaves.simulate import simulate_epochs
    >>> epochs = simulate_epochs(0.01, seed=3)
    >>> len(epochs.changes) >= max(len(epochs.old.buildings), len(epochs.new.buildings))
    True
    """

    old: Town
    new: Town
    changes: tuple[Change, ...]


def simulate_epochs(
    area_km2: float = 0.09,
    terrain: TerrainKind = "flat",
    trees: float = 1.0,
    seed: int = 0,
    *,
    style: TownStyle = "mixed",
    clutter: bool = True,
    changed: float = 0.25,
    leaf_loss: tuple[float, float] = (IN_LEAF, OUT_OF_LEAF),
) -> Epochs:
    """A town at two times: the first in leaf, the second out of leaf, other cars in the streets.

    Parameters
    ----------
    area_km2 : float
        Area of the square (km²), at least 0.01.
    terrain : str
        `flat`, `slope`, `hilly` or `terraced`.
    trees : float
        Share of the trees of an ordinary town (≥ 0).
    seed : int
        The same seed gives the same towns.
    style : str
        `suburb`, `centre` or `mixed`.
    clutter : bool
        True if buildings have vents, skylights, solar panels and balconies.
    changed : float
        Share of the buildings of 10 m² and more that change (0 to 1); the kinds of change take turns. Raised
        and lowered roofs lie 0.5 to 3.2 m higher or lower, annexes have 4 m² and more.
    leaf_loss : tuple of float
        Loss of a pulse's energy per metre of crown (1/m) at the two times.

    Returns
    -------
    Epochs
        Both towns and the list of changes; `scan_town` makes points of each.

    Raises
    ------
    ValueError
        When the area is under 0.01 km², or `changed` not between 0 and 1.

    Examples
    --------
    >>> from eaves.simulate import simulate_epochs
    >>> epochs = simulate_epochs(0.01, seed=3, changed=1.0)
    >>> "demolished" in {change.change for change in epochs.changes}
    True
    """
    if not 0.0 <= changed <= 1.0:
        raise ValueError(f"changed must be a share between 0 and 1, not {changed}")
    site, plots, corridor = lay_site(area_km2, None, terrain, seed, style)
    for number, plot in enumerate(plots):
        uncut = bool(site.bounds.buffered(-RIM).contains(plot.corners()).all())
        draw_block(plot, style, uncut, True, np.random.default_rng([seed, 34, number]))
        for placement in plot.placements:
            site.build(placement)
    pairs = _draw_changes(site, changed, np.random.default_rng([seed, 51]))
    extras = put_extras(site.bounds, site.terrain, corridor, np.random.default_rng([seed, 36]))
    towns = []
    for epoch in (0, 1):
        epoch_site = BuildingSite(site.bounds, site.terrain)
        for _, pair in pairs:
            building = pair[epoch]
            if building is not None:
                epoch_site.add(_renumbered(building, epoch_site.faces + 1))
        for number, plot in enumerate(plots):
            parked = np.random.default_rng([seed, 52, epoch, number]).random(len(plot.cars)) < CARS_KEPT
            cars = [car for car, here in zip(plot.cars, parked, strict=True) if here]
            rng = np.random.default_rng([seed, 35, number])
            epoch_site.furnish(replace(plot, cars=cars), trees, leaf_loss[epoch], rng)
        if clutter:
            epoch_site.install(seed)
        towns.append(epoch_site.finish(extras))
    return Epochs(towns[0], towns[1], tuple(_told(change, *pair) for change, pair in pairs))


Pair = tuple[ExactBuilding | None, ExactBuilding | None]
"""One building at both times."""


def _draw_changes(site: BuildingSite, share: float, rng: np.random.Generator) -> list[tuple[str, Pair]]:
    """The buildings of a site at both times; a change that a building has no room for becomes another."""
    large = [k for k, building in enumerate(site.buildings) if building.footprint.area >= SMALLEST_M2]
    chosen = rng.permutation(large)[: round(share * len(large))].tolist()
    planned = {k: CHANGES[turn % len(CHANGES)] for turn, k in enumerate(chosen)}
    pairs = []
    for k, building in enumerate(site.buildings):
        change = planned.get(k, "unchanged")
        changed = None
        if change in ("extended", "partly demolished"):
            changed = _extended(site, k, rng)
            change = change if changed else "raised"
        if change == "roof replaced":
            changed = _with_other_roof(site, k, rng)
            change = change if changed else "raised"
        if change in ("raised", "lowered"):
            way = rng.uniform(0.5, 1.2) if rng.random() < 0.5 else rng.uniform(2.4, 3.2)
            lower = _shifted_roof(site, k, -way) if change == "lowered" else None
            changed = lower or _shifted_roof(site, k, way)
            change = "lowered" if lower else "raised"
        swapped: dict[str, Pair] = {
            "new": (None, building),
            "demolished": (building, None),
            "partly demolished": (changed, building),
            "unchanged": (building, building),
        }
        pairs.append((change, swapped.get(change, (building, changed))))
    return pairs


def _made(site: BuildingSite, k: int, masses: Masses) -> ExactBuilding | None:
    """A building of a site with other masses; None where they make no closed solid, or stand in another."""
    was = site.buildings[k]
    try:
        building = make_building(
            masses, was.number, was.faces[0].number, was.kind, was.base, site.overhangs[k]
        )
        building.solid()
    except ValueError:
        return None
    return building


def _shifted_roof(site: BuildingSite, k: int, way: float) -> ExactBuilding | None:
    """A building with its roof higher by `way` (m)."""
    masses = tuple(mass.translated(0.0, 0.0, 0.0, way) for mass in site.masses[k])
    building = _made(site, k, masses)
    if building is None or (
        way < 0 and _lowest_eaves(building) - site.floor_of(building.footprint) < LOWEST_WALL
    ):
        return None
    return building


def _lowest_eaves(building: ExactBuilding) -> float:
    heights = [face.height_at(shapely.get_coordinates(face.polygon)).min() for face in building.faces]
    return float(min(heights))


def _extended(site: BuildingSite, k: int, rng: np.random.Generator) -> ExactBuilding | None:
    """A building with a flat annex of 4 m² or more at one of its walls; None where there is no room."""
    was = site.buildings[k]
    corners = shapely.get_coordinates(was.footprint.exterior)
    lengths = np.hypot(*np.diff(corners, axis=0).T)
    for edge in rng.permutation(np.flatnonzero(lengths >= 2.4)):
        start, end = corners[edge], corners[edge + 1]
        along = (end - start) / lengths[edge]
        outwards = np.array([along[1], -along[0]])
        width = rng.uniform(2.0, min(float(lengths[edge]) - 0.2, 8.0))
        depth = max(rng.uniform(2.0, 5.0), 4.0 / width)
        first = start + along * rng.uniform(0.0, lengths[edge] - width)
        inner, outer = first - OVERLAP * outwards, first + depth * outwards
        plan = Polygon([inner, outer, outer + width * along, inner + width * along])
        if not site.area.contains(shapely.get_coordinates(plan)).all():
            continue
        neighbours = [n for n in site.near(Bounds(*plan.bounds).buffered(APART)) if n != k]
        beyond = [n for n in neighbours if shapely.intersects(site.outlines[n], plan)]
        level = site.floor_of(plan) + rng.uniform(2.5, 3.4)
        if beyond or level > _lowest_eaves(was) + 1.0:
            continue
        building = _made(site, k, (*site.masses[k], Mass(plan, ((0.0, 0.0, level),), "annex")))
        if building is not None and building.footprint.area - was.footprint.area >= 4.0:
            site.outlines[k] = building.footprint
            site.locate(k)
            return building
    return None


def _with_other_roof(site: BuildingSite, k: int, rng: np.random.Generator) -> ExactBuilding | None:
    """A building with a gable in place of a flat roof, or a flat roof in place of any other, at the old one's
    mean height; None where old and new are much alike."""
    was = site.buildings[k]
    if was.footprint.area < REPLACED_M2:
        return None
    plan = was.footprint
    areas = np.array([face.polygon.area for face in was.faces])
    flat = np.array([np.hypot(*face.coefficients[:2]) < 0.05 for face in was.faces])
    places, old = _roof_heights(was)
    if areas[flat].sum() > 0.5 * areas.sum():
        ring = shapely.get_coordinates(shapely.minimum_rotated_rectangle(plan))[:4]
        sides = np.diff(ring[:3], axis=0)
        across = sides[int(np.argmin(np.hypot(*sides.T)))]
        width = float(np.hypot(*across))
        slope = rng.uniform(0.5, 0.9) * min(1.0, 10.0 / width)
        a, b = slope * across / width
        x, y = ring.mean(axis=0)
        rise, fall = (a, b, -a * x - b * y), (-a, -b, a * x + b * y)
        new = np.minimum(*(places @ np.array(plane[:2]) + plane[2] for plane in (rise, fall)))
        lift = old.mean() - new.mean()
        planes = tuple((p[0], p[1], p[2] + lift) for p in (rise, fall))
        new = new + lift
    else:
        planes = ((0.0, 0.0, float(old.mean())),)
        new = np.full(len(old), old.mean())
    if np.abs(new - old).mean() < REPLACED_M or new.min() - site.floor_of(plan) < LOWEST_WALL:
        return None
    return _made(site, k, (Mass(plan, planes),))


def _roof_heights(building: ExactBuilding, step: float = 0.5) -> tuple[np.ndarray, np.ndarray]:
    """Places (N, 2) on a grid over a building and the roof's heights (N,) there."""
    west, south, east, north = building.footprint.bounds
    x, y = np.meshgrid(np.arange(west + step / 2, east, step), np.arange(south + step / 2, north, step))
    places, heights = [np.zeros((0, 2))], [np.zeros(0)]
    for face in building.faces:
        inside = shapely.contains_xy(face.polygon, x.ravel(), y.ravel())
        here = np.column_stack([x.ravel()[inside], y.ravel()[inside]])
        places.append(here)
        heights.append(face.height_at(here))
    return np.concatenate(places), np.concatenate(heights)


def _renumbered(building: ExactBuilding, first: int) -> ExactBuilding:
    """A building with its faces numbered from `first`."""
    faces = tuple(replace(face, number=first + order) for order, face in enumerate(building.faces))
    return replace(building, faces=faces)


def _told(change: str, old: ExactBuilding | None, new: ExactBuilding | None) -> Change:
    """The change of a building in figures."""
    building = old or new
    assert building is not None
    size = [(0.0, 0.0) if b is None else (b.footprint.area, _volume(b)) for b in (old, new)]
    higher = 0.0
    if old is not None and new is not None and old is not new:
        common = shapely.intersection(old.footprint, new.footprint)
        higher = (_volume(new, common) - _volume(old, common)) / common.area
    return Change(
        building.id,
        change,
        None if old is None else old.footprint,
        None if new is None else new.footprint,
        round(higher, 3),
        round(size[1][0] - size[0][0], 3),
        round(size[1][1] - size[0][1], 3),
    )


def _volume(building: ExactBuilding, within: Polygon | None = None) -> float:
    """Volume (m³) between the roof and the base: of a plane over a polygon, its height at the centroid."""
    total = 0.0
    for face in building.faces:
        over = face.polygon if within is None else shapely.intersection(face.polygon, within)
        if over.area > 0:
            height = face.height_at(shapely.get_coordinates(shapely.centroid(over)))[0]
            total += over.area * (float(height) - building.base)
    return total


@dataclass(frozen=True)
class Survey:
    """One flight over a town, with what sets it apart from another.

    Parameters
    ----------
    density : float
        Pulses per square metre (> 0).
    noise : float
        Standard deviation of a range (m).
    pattern : str
        `lines`, `zigzag`, `ellipse` or `random`.
    flight : Flight
        Height, opening angle, overlap, heading.
    scanner : Scanner
        Beam, errors of strips.
    shift : tuple of float
        Error of the whole survey's position (m): east, north, up.

    Examples
    --------
    >>> from eaves.simulate import Survey
    >>> Survey(density=4.0, shift=(0.0, 0.0, 0.1)).shift[2]
    0.1
    """

    density: float = 10.0
    noise: float = 0.02
    pattern: Pattern = "lines"
    flight: Flight = Flight()  # noqa: RUF009 (frozen)
    scanner: Scanner = Scanner()  # noqa: RUF009 (frozen)
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def scan(self, town: Town, seed: int = 0) -> ExactScene:
        """The scan of a town: same seed, same points.

        Parameters
        ----------
        town : Town
            What is scanned.
        seed : int
            Of places and errors.

        Returns
        -------
        ExactScene
            The points with their truth, shifted by the survey's error.

        Examples
        --------
        >>> from eaves.simulate import Survey, simulate_town
        >>> len(Survey(density=1.0).scan(simulate_town(0.01, seed=3)).cloud) > 5000
        True
        """
        scene = scan_town(
            town, self.density, self.noise, self.pattern, seed, flight=self.flight, scanner=self.scanner
        )
        moved = snap(scene.cloud.xyz + np.array(self.shift))
        return replace(scene, cloud=scene.cloud.with_(xyz=moved))


def later_survey(density: float = 10.0, noise: float = 0.02) -> Survey:
    """A survey by another scanner than the default: lower, narrower, across, zigzag, half as much noise
    again, strips off by 3 cm, the whole off by 6, 5 and 10 cm.

    Parameters
    ----------
    density : float
        Pulses per square metre (> 0).
    noise : float
        Standard deviation of a range of the first survey (m).

    Returns
    -------
    Survey
        Of the second time.

    Raises
    ------
    TypeError, ValueError
        When `density` is no number above 0.

    Examples
    --------
    >>> from eaves.simulate import later_survey
    >>> later_survey(4.0).pattern
    'zigzag'
    """
    check_positive(density, "density", "points per m²")
    return Survey(
        density,
        1.5 * noise,
        "zigzag",
        Flight(height=700.0, half_angle_deg=15.0, heading_deg=100.0),
        Scanner(divergence=5e-4, strip_offset=0.03),
        (0.06, -0.05, 0.10),
    )


def write_changes(
    changes: Sequence[Change], scene: ExactScene, folder: str | Path, settings: dict[str, Any] | None = None
) -> dict[str, Path]:
    """Write what became of each building: changes.gpkg (where it stands, or stood) and changes.json.

    Parameters
    ----------
    changes : sequence of Change
        The changes.
    scene : ExactScene
        Either scan: it gives the place in the world and the system.
    folder : str or Path
        Made when missing.
    settings : dict or None
        The parameters the town was made with, for changes.json.

    Returns
    -------
    dict of str to Path
        The files: `layer`, `table`.

    Raises
    ------
    InputError
        When the folder cannot be written.

    Examples
    --------
    >>> from eaves.simulate import Survey, simulate_epochs, write_changes
    >>> epochs = simulate_epochs(0.01, seed=3)
    >>> files = write_changes(epochs.changes, Survey(density=1.0).scan(epochs.old), "town")
    >>> files["layer"].name
    'changes.gpkg'
    """
    paths = {"layer": Path(folder) / "changes.gpkg", "table": Path(folder) / "changes.json"}
    x, y = scene.cloud.origin
    rows, listed = [], []
    for change in changes:
        place = change.new or change.old
        assert place is not None
        values = {
            "id": change.id,
            "change": change.change,
            "height_m": change.height_m,
            "area_m2": change.area_m2,
            "volume_m3": change.volume_m3,
        }
        listed.append(values)
        rows.append(Row(affine_transform(place, [1, 0, 0, 1, x, y]), values))
    with undated():
        write_polygons(paths["layer"], rows, scene.cloud.system, "changes")
    counts = {kind: sum(change.change == kind for change in changes) for kind in ("unchanged", *CHANGES)}
    with atomic(paths["table"]) as temporary:
        about = {"settings": settings or {}, "counts": counts, "buildings": listed}
        temporary.write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")
    return paths
