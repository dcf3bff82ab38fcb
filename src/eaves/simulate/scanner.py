"""The airborne scan of a town, with the truth of every point: rays traced, echoes separated."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eaves.kernels import kernel
from eaves.model import (
    HIGH_NOISE,
    LOW_NOISE,
    UNCLASSIFIED,
    Integers,
    Labels,
    Mask,
    PointCloud,
    Points,
    Values,
)
from eaves.simulate.flight import Flight, Pattern, Pulses, fly
from eaves.simulate.objects.exact import ExactScene
from eaves.simulate.objects.surfaces import CONE, ELLIPSOID
from eaves.simulate.ray_grid import TERRAIN_LABEL, TOUCH, WATER_LABEL, RayGrid
from eaves.simulate.town import Town

MAX_ECHOES = 6
"""Echoes kept of one pulse; AHN3 holds up to 5, IGN LiDAR HD up to 6."""

LEAF_STEP = 0.25
"""Step (m) at which the loss in leaves is summed."""

CLUMP = 1.0
"""Side (m) of the clumps of leaves; some are empty, so crowns have gaps that every strip sees alike."""

FILLED_CLUMPS = 0.35
"""Share of the clumps that hold leaves."""

WATER_MIRROR = 0.9975
"""Cosine of the angle from the vertical (4°) up to which still water sends a pulse back; beyond, nothing."""

BIN = 0.05
"""Length of a range bin (m) in which partial reflections are gathered; their mean range stays exact."""

BINS = 8192
"""Range bins of one pulse, 400 m; what lies deeper is gathered in the last."""


@dataclass(frozen=True)
class Receiver:
    """Separation of echoes by the scanner.

    `dead_zone` is the shortest distance (m, along the beam) between two echoes: what returns within it of an
    echo's first light is part of it. `threshold` is the least share of the pulse's energy that makes an echo.
    """

    dead_zone: float = 0.7
    threshold: float = 0.08


Beam = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Rays that stand for a pulse: offsets (K, 2) in beam radii across the axis, shares of energy (K,)."""

PENCIL: Beam = (np.zeros((1, 2)), np.ones(1))
"""One ray without width."""


def gaussian_beam() -> Beam:
    """Seven rays: the axis, and six at 0.6 of the 1/e² radius; shares follow the Gaussian profile."""
    turn = np.arange(6) * np.pi / 3
    offsets = np.concatenate([np.zeros((1, 2)), 0.6 * np.column_stack([np.cos(turn), np.sin(turn)])])
    return offsets, np.array([0.28, *[0.12] * 6])


def trace_pulses(
    grid: RayGrid,
    origins: NDArray[np.float64],
    directions: NDArray[np.float64],
    divergence: float,
    beam: Beam,
    receiver: Receiver,
    seed: int,
) -> tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.int32]]:
    """Ranges (P, 6) of the echoes of each pulse, rows of the label table (P, 6), and how many echoes (P,).

    `origins` and unit `directions` are (P, 3); the beam's radius at range r is r · divergence / 2. Nothing
    is random: `seed` only picks which clumps of leaves are full.
    """
    count = len(origins)
    ranges, labels = np.zeros((count, MAX_ECHOES)), np.zeros((count, MAX_ECHOES), np.int32)
    echoes = np.zeros(count, np.int32)
    terrain = grid.terrain
    trace_kernel(
        np.ascontiguousarray(origins),
        directions,
        beam[0] * divergence / 2,
        beam[1],
        terrain.heights,
        terrain.water,
        terrain.west,
        terrain.south,
        terrain.cell,
        grid.tops,
        grid.lowest,
        grid.highest,
        grid.triangles,
        grid.label,
        grid.starts,
        grid.members,
        grid.foliage.bodies,
        grid.foliage.shape,
        grid.leaf_label,
        grid.leaf_starts,
        grid.leaf_members,
        receiver.dead_zone,
        receiver.threshold,
        seed,
        ranges,
        labels,
        echoes,
    )
    return ranges, labels, echoes


@kernel
def fullness_kernel(x: float, y: float, z: float, seed: int) -> float:
    """Density of leaves in the clump at a point: 0, or 0.5 to 1.5 times 1 / the share that is filled."""
    mixed = np.uint64(np.int64(np.floor(x / CLUMP)) & 0x1FFFFF)
    mixed |= np.uint64(np.int64(np.floor(y / CLUMP)) & 0x1FFFFF) << np.uint64(21)
    mixed |= np.uint64(np.int64(np.floor(z / CLUMP)) & 0x1FFFFF) << np.uint64(42)
    mixed ^= np.uint64(seed) * np.uint64(0x9E3779B97F4A7C15)
    mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    mixed ^= mixed >> np.uint64(31)
    share = float(mixed >> np.uint64(11)) / 9007199254740992.0
    if share >= FILLED_CLUMPS:
        return 0.0
    return (0.5 + share / FILLED_CLUMPS) / FILLED_CLUMPS


@kernel
def inside_leaves_kernel(bodies: Values, k: int, shape: int, x: float, y: float, z: float) -> bool:
    """True if a point is inside body number k of the leaves."""
    dx, dy, w = x - bodies[k, 0], y - bodies[k, 1], (z - bodies[k, 2]) / bodies[k, 5]
    if w < -1.0 or w > 1.0:
        return False
    u, v = (
        (dx * bodies[k, 6] + dy * bodies[k, 7]) / bodies[k, 3],
        (dy * bodies[k, 6] - dx * bodies[k, 7]) / bodies[k, 4],
    )
    if shape == ELLIPSOID:
        return u * u + v * v + w * w <= 1.0
    if shape == CONE:
        wide = 0.5 * (1.0 - w)
        return u * u + v * v <= wide * wide
    return abs(u) <= 1.0 and abs(v) <= 1.0


@kernel
def trace_kernel(
    origins: Points, directions: Points, offsets: Values, energies: Values, heights: Values, water: Mask,
    west: float, south: float, cell: float, tops: Values, lowest: Values, highest: Values,
    triangles: Values, label: Labels, starts: Integers, members: Labels, bodies: Values, shapes: Labels,
    leaf_label: Labels, leaf_starts: Integers, leaf_members: Labels, dead_zone: float, threshold: float,
    seed: int, ranges: Values, labels: Labels, echoes: Labels,
) -> None:  # fmt: skip
    """Trace every ray of every pulse through the grid, gather what returns, and cut it into echoes."""
    columns, rows = water.shape
    amount, moment, largest = np.zeros(BINS), np.zeros(BINS), np.zeros(BINS)
    source = np.zeros(BINS, np.int32)
    for p in range(origins.shape[0]):
        ox, oy, oz = origins[p, 0], origins[p, 1], origins[p, 2]
        ax, ay, az = directions[p, 0], directions[p, 1], directions[p, 2]
        # two directions across the beam; the axis is never level
        length = np.sqrt(ax * ax + az * az)
        ux, uy, uz = -az / length, 0.0, ax / length
        vx, vy, vz = ay * uz - az * uy, az * ux - ax * uz, ax * uy - ay * ux
        base = max(0.0, (highest + 0.5 - oz) / az) - 1.0
        first_bin, last_bin = BINS, -1
        for ray in range(offsets.shape[0]):
            du, dv = offsets[ray, 0], offsets[ray, 1]
            dx, dy, dz = ax + du * ux + dv * vx, ay + du * uy + dv * vy, az + du * uz + dv * vz
            energy = energies[ray]
            enter = max(0.0, (highest + 0.5 - oz) / dz)
            leave = (lowest - 0.5 - oz) / dz
            gx, gy = (ox + enter * dx - west) / cell, (oy + enter * dy - south) / cell
            i, j = int(np.floor(gx)), int(np.floor(gy))
            step_i, step_j = 1 if dx > 0 else -1, 1 if dy > 0 else -1
            slow_x = abs(cell / dx) if abs(dx) > 1e-12 else 1e30
            slow_y = abs(cell / dy) if abs(dy) > 1e-12 else 1e30
            next_x = enter + ((i + 1 - gx) if dx > 0 else (gx - i)) * slow_x
            next_y = enter + ((j + 1 - gy) if dy > 0 else (gy - j)) * slow_y
            here = enter
            while here < leave and energy > 0.0:
                until = min(next_x, next_y, leave)
                if 0 <= i < columns and 0 <= j < rows and oz + until * dz <= tops[i, j] + 1e-9:
                    square = i * rows + j
                    hit, hit_label, hit_cos = 1e30, -1, 1.0
                    # terrain: two triangles
                    x0, y0 = west + i * cell, south + j * cell
                    fx, fy = (ox - x0) / cell, (oy - y0) / cell
                    z00, z10, z01, z11 = (
                        heights[i, j],
                        heights[i + 1, j],
                        heights[i, j + 1],
                        heights[i + 1, j + 1],
                    )
                    for half in range(2):
                        if half == 0:
                            sx, sy = z10 - z00, z11 - z10
                        else:
                            sx, sy = z11 - z01, z01 - z00
                        fall = dz - (sx * dx + sy * dy) / cell
                        if fall < 0.0:
                            t = (z00 + sx * fx + sy * fy - oz) / fall
                            qx, qy = fx + t * dx / cell, fy + t * dy / cell
                            side = qx - qy if half == 0 else qy - qx
                            inside = -1e-9 <= qx <= 1.0 + 1e-9 and -1e-9 <= qy <= 1.0 + 1e-9
                            if inside and side >= -1e-9 and t < hit:
                                hit = t
                                hit_label = WATER_LABEL if water[i, j] else TERRAIN_LABEL
                                hit_cos = -fall / np.sqrt(1.0 + (sx * sx + sy * sy) / (cell * cell))
                    for m in range(starts[square], starts[square + 1]):
                        k = members[m]
                        e1x, e1y, e1z = triangles[k, 3], triangles[k, 4], triangles[k, 5]
                        e2x, e2y, e2z = triangles[k, 6], triangles[k, 7], triangles[k, 8]
                        px, py, pz = dy * e2z - dz * e2y, dz * e2x - dx * e2z, dx * e2y - dy * e2x
                        det = e1x * px + e1y * py + e1z * pz
                        if abs(det) < 1e-12:
                            continue
                        tx, ty, tz = ox - triangles[k, 0], oy - triangles[k, 1], oz - triangles[k, 2]
                        u = (tx * px + ty * py + tz * pz) / det
                        if u < -1e-9 or u > 1.0 + 1e-9:
                            continue
                        qx, qy, qz = ty * e1z - tz * e1y, tz * e1x - tx * e1z, tx * e1y - ty * e1x
                        v = (dx * qx + dy * qy + dz * qz) / det
                        if v < -1e-9 or u + v > 1.0 + 1e-9:
                            continue
                        t = (e2x * qx + e2y * qy + e2z * qz) / det
                        if 0.0 < t < hit:
                            nx, ny, nz = e1y * e2z - e1z * e2y, e1z * e2x - e1x * e2z, e1x * e2y - e1y * e2x
                            hit, hit_label = t, label[k]
                            hit_cos = abs(det) / np.sqrt(nx * nx + ny * ny + nz * nz)
                    end = min(until, hit)
                    if leaf_starts[square + 1] > leaf_starts[square]:
                        crown_low, crown_high = 1e30, -1e30
                        for m in range(leaf_starts[square], leaf_starts[square + 1]):
                            k = leaf_members[m]
                            crown_low = min(crown_low, bodies[k, 2] - bodies[k, 5])
                            crown_high = max(crown_high, bodies[k, 2] + bodies[k, 5])
                        begin = max(here, (crown_high - oz) / dz)
                        under = min(end, (crown_low - oz) / dz)
                        t = (np.floor(begin / LEAF_STEP) + 0.5) * LEAF_STEP
                        if t < begin:
                            t += LEAF_STEP
                        while t < under and energy > 0.0:
                            x, y, z = ox + t * dx, oy + t * dy, oz + t * dz
                            loss, kind = 0.0, -1
                            for m in range(leaf_starts[square], leaf_starts[square + 1]):
                                k = leaf_members[m]
                                if inside_leaves_kernel(bodies, k, shapes[k], x, y, z):
                                    loss = max(loss, bodies[k, 8])
                                    kind = leaf_label[k]
                            if kind >= 0:
                                full = fullness_kernel(x, y, z, seed)
                                lost = 0.0
                                if full > 0.0:
                                    lost = energy * (1.0 - np.exp(-loss * full * LEAF_STEP))
                                if lost > 1e-3:
                                    place = gather_kernel(
                                        t, lost, kind, base, amount, moment, largest, source
                                    )
                                    first_bin, last_bin = min(first_bin, place), max(last_bin, place)
                                energy = energy - lost if energy - lost > 2e-3 else 0.0
                            t += LEAF_STEP
                    if hit <= until + TOUCH:
                        if hit_label == WATER_LABEL and -az < WATER_MIRROR:
                            energy = 0.0
                        if energy > 0.0:
                            place = gather_kernel(
                                hit, energy * hit_cos, hit_label, base, amount, moment, largest, source
                            )
                            first_bin, last_bin = min(first_bin, place), max(last_bin, place)
                        energy = 0.0
                if next_x < next_y:
                    here, i = next_x, i + step_i
                    next_x += slow_x
                else:
                    here, j = next_y, j + step_j
                    next_y += slow_y
        echoes[p] = cut_echoes_kernel(
            amount, moment, largest, source, first_bin, last_bin, dead_zone, threshold, ranges[p], labels[p]
        )
        amount[first_bin : last_bin + 1] = 0.0
        moment[first_bin : last_bin + 1] = 0.0
        largest[first_bin : last_bin + 1] = 0.0


@kernel
def gather_kernel(
    t: float,
    energy: float,
    label: int,
    base: float,
    amount: Values,
    moment: Values,
    largest: Values,
    source: Labels,
) -> int:
    """Add a reflection to its range bin and return its number; a bin keeps its largest source."""
    place = min(max(int((t - base) / BIN), 0), BINS - 1)
    amount[place] += energy
    moment[place] += energy * t
    if source[place] == label and largest[place] > 0.0:
        largest[place] += energy
    elif energy > largest[place]:
        largest[place], source[place] = energy, label
    return place


@kernel
def cut_echoes_kernel(
    amount: Values, moment: Values, largest: Values, source: Labels, first_bin: int, last_bin: int,
    dead_zone: float, threshold: float, ranges: Values, labels: Labels,
) -> int:  # fmt: skip
    """Write the echoes of one pulse to `ranges` and `labels`; returns how many there are."""
    count, first = 0, first_bin
    while first <= last_bin and count < ranges.shape[0]:
        if amount[first] == 0.0:
            first += 1
            continue
        end = moment[first] / amount[first] + dead_zone
        last, total, weighted = first, 0.0, 0.0
        while last <= last_bin and (amount[last] == 0.0 or moment[last] / amount[last] < end):
            total += amount[last]
            weighted += moment[last]
            last += 1
        if total >= threshold:
            best, label = 0.0, source[first]
            for k in range(first, last):
                share = 0.0
                for m in range(first, last):
                    if source[m] == source[k]:
                        share += largest[m]
                if largest[k] > 0.0 and share > best:
                    best, label = share, source[k]
            ranges[count], labels[count] = weighted / total, label
            count, first = count + 1, last
        else:
            first += 1
    return count


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
