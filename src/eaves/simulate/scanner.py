"""The airborne scan of a town, with the truth of every point."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eaves.model import PointCloud
from eaves.model.cloud import HIGH_NOISE, LOW_NOISE, UNCLASSIFIED
from eaves.simulate.flight import Flight, Pattern, Pulses, fly
from eaves.simulate.objects.exact import ExactScene
from eaves.simulate.pulses import PENCIL, Beam, Receiver, gaussian_beam, trace_pulses
from eaves.simulate.ray_grid import RayGrid
from eaves.simulate.town import Town


@dataclass(frozen=True)
class Scanner:
    """The errors and the resolution of the instrument.

    Parameters
    ----------
    divergence : float
        Full 1/e² angle of the beam (radians): 0.4 mrad at 1000 m lights a disc of 0.4 m.
    noise : float
        Standard deviation (m) of a range.
    strip_offset : float
        Standard deviation (m) of the height of a whole strip.
    outliers : float
        Share of points that are gross errors, half of them low (0.5 to 15 m under ground), half high (15 to
        80 m above it).
    receiver : Receiver
        Separation of echoes by the scanner.

    Examples
    --------
    >>> from eaves.simulate import Scanner
    >>> Scanner(noise=0.05).divergence
    0.0004
    """

    divergence: float = 4e-4
    noise: float = 0.02
    strip_offset: float = 0.02
    outliers: float = 2e-5
    receiver: Receiver = field(default_factory=Receiver)


Echoes = tuple[NDArray[Any], ...]
"""Of E points: place (E, 3), number and count of the echo, row of the label table, strip, time (s)."""


def scan_town(
    town: Town,
    density: float = 10.0,
    noise: float = 0.02,
    pattern: Pattern = "lines",
    seed: int = 0,
    *,
    flight: Flight | None = None,
    scanner: Scanner | None = None,
) -> ExactScene:
    """The cloud of a town, in the order it was measured, and the truth of each point.

    Parameters
    ----------
    town : Town
        The town that is scanned.
    density : float
        Pulses per square metre (> 0), mean over the town, all strips together.
    noise : float
        Standard deviation of a range (m, ≥ 0); it replaces the scanner's own.
    pattern : str
        `lines`, `zigzag`, `ellipse`, or `random`: straight down at random places, one return, nothing hidden.
    seed : int
        The same seed gives the same points.
    flight : Flight or None
        The survey; None is `Flight()`.
    scanner : Scanner or None
        The instrument; None is `Scanner()`.

    Returns
    -------
    ExactScene
        The points with their truth.

    Raises
    ------
    ValueError
        When `density` is not above 0, or `noise` is below 0.

    Examples
    --------
    >>> from eaves.simulate import scan_town, simulate_town
    >>> scene = scan_town(simulate_town(0.01, seed=3), density=1.0, seed=3)
    >>> len(scene.cloud) == len(scene.truth_class) == len(scene.building)
    True
    """
    if not density > 0:
        raise ValueError(f"density must be above 0 points per m², not {density}")
    if not noise >= 0:
        raise ValueError(f"noise must be at least 0 m, not {noise}")
    survey, device = flight or Flight(), scanner or Scanner()
    grid = town.ray_grid()
    beam = PENCIL if pattern == "random" else gaussian_beam()
    level = float(np.median(town.terrain.heights))
    nothing = np.zeros((0, 3)), *(np.zeros(0, kind) for kind in ("u1", "u1", "i4", "u2", "f8"))
    parts: list[Echoes] = [nothing]
    for batch, pulses in enumerate(fly(survey, town.bounds, level, grid.highest, density, pattern, seed)):
        parts.append(_listen(grid, pulses, beam, device, noise, pattern == "random", seed, batch))
    return _assemble(town, grid, parts, device, seed)


def _listen(
    grid: RayGrid,
    pulses: Pulses,
    beam: Beam,
    device: Scanner,
    noise: float,
    first_only: bool,
    seed: int,
    batch: int,
) -> Echoes:
    """The echoes of a batch of pulses, as points on the axis of the beam."""
    rng = np.random.default_rng([seed, 21, batch])
    shift = np.random.default_rng([seed, 22, pulses.strip]).normal(0.0, device.strip_offset)
    ranges, labels, echoes = trace_pulses(
        grid, pulses.origins, pulses.directions, device.divergence, beam, device.receiver, seed
    )
    if first_only:
        echoes = np.minimum(echoes, 1)
    pulse = np.repeat(np.arange(len(echoes)), echoes)
    number = np.arange(len(pulse)) - np.repeat(np.cumsum(echoes) - echoes, echoes)
    measured = ranges[pulse, number] + rng.normal(0.0, noise, len(pulse))
    xyz = pulses.origins[pulse] + measured[:, None] * pulses.directions[pulse]
    xyz[:, 2] += 0.0 if first_only else shift
    return (
        xyz,
        (number + 1).astype(np.uint8),
        echoes[pulse].astype(np.uint8),
        labels[pulse, number],
        np.full(len(pulse), pulses.strip, np.uint16),
        pulses.time_s[pulse],
    )


def _assemble(town: Town, grid: RayGrid, parts: list[Echoes], device: Scanner, seed: int) -> ExactScene:
    """The scene of all echoes over the town's bounds; a few points become outliers."""

    joined = [np.concatenate(columns) for columns in zip(*parts, strict=True)]
    inside = np.flatnonzero(town.bounds.contains(joined[0]))
    xyz, number, count, row, strip, time_s = (column[inside] for column in joined)
    label = grid.labels[row]
    truth_class, building, plane = label[:, 0].astype(np.uint8), label[:, 1].copy(), label[:, 2].copy()
    rng = np.random.default_rng([seed, 23])
    wrong = rng.permutation(len(xyz))[: round(device.outliers * len(xyz))]
    low, high = wrong[::2], wrong[1::2]
    ground = town.terrain.at(xyz[wrong])
    depth, rise = -rng.uniform(0.5, 15.0, len(wrong)), rng.uniform(15.0, 80.0, len(wrong))
    xyz[wrong, 2] = ground + np.where(np.arange(len(wrong)) % 2, rise, depth)
    truth_class[low], truth_class[high] = LOW_NOISE, HIGH_NOISE
    building[wrong], plane[wrong] = 0, 0
    cloud = PointCloud.from_world(
        xyz + np.array([*town.origin, 0.0]),
        town.origin,
        return_number=number,
        number_of_returns=count,
        classification=np.full(len(xyz), UNCLASSIFIED, np.uint8),
        point_id=np.arange(len(xyz)),
        system=town.system,
    )
    return ExactScene(
        cloud,
        truth_class,
        building.astype(np.int32),
        plane.astype(np.int32),
        town.buildings,
        strip,
        time_s,
    )
