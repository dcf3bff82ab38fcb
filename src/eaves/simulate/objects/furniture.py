"""Street furniture: cars, fences, power lines, bridges."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from eaves.model.cloud import BRIDGE_DECK, UNCLASSIFIED, WIRE, WIRE_TOWER
from eaves.simulate.objects.surfaces import UP, ScannedSurfaces, curtain, curtains, fan, upright_box
from eaves.simulate.objects.terrain import Corridor, Terrain


def park_car(x: float, y: float, ground: float, angle: float, rng: np.random.Generator) -> ScannedSurfaces:
    """A car, or one time in eight a van: a body and a cabin."""
    if rng.random() < 0.125:
        return ScannedSurfaces.of(upright_box(x, y, ground + 0.3, (5.5, 2.0, 2.1), angle), UNCLASSIFIED)
    length, height = rng.uniform(3.8, 4.9), rng.uniform(1.4, 1.65)
    body = upright_box(x, y, ground + 0.2, (length, 1.8, 0.65), angle)
    cabin = upright_box(x, y, ground + 0.8, (0.55 * length, 1.6, height - 0.8), angle)
    return ScannedSurfaces.of([*body, *cabin], UNCLASSIFIED)


def put_fence(
    start: NDArray[np.float64], end: NDArray[np.float64], terrain: Terrain, rng: np.random.Generator
) -> ScannedSurfaces:
    """A thin fence or garden wall of 0.9 to 2 m along a segment; it follows the ground in steps of 2 m."""
    length = float(np.hypot(*(end - start)))
    plan = start + np.linspace(0.0, 1.0, max(2, int(length / 2.0) + 1))[:, None] * (end - start)
    low = np.column_stack([plan, terrain.at(plan) - 0.2])
    high = low + (0.2 + rng.uniform(0.9, 2.0)) * UP
    return ScannedSurfaces.of(curtains(low, high), UNCLASSIFIED)


def hang_power_line(
    start: NDArray[np.float64], end: NDArray[np.float64], terrain: Terrain, rng: np.random.Generator
) -> ScannedSurfaces:
    """Masts every 60 m or so, 16 to 26 m high, and three wires between them that sag by 2 %."""
    length = float(np.hypot(*(end - start)))
    spans = max(1, round(length / 60.0))
    feet = start + np.linspace(0.0, 1.0, spans + 1)[:, None] * (end - start)
    ground, height = terrain.at(feet), rng.uniform(16.0, 26.0)
    along = (end - start) / length
    left = np.array([-along[1], along[0]])
    angle = float(np.arctan2(along[1], along[0]))
    masts = []
    for foot, level in zip(feet, ground, strict=True):
        masts += upright_box(foot[0], foot[1], level - 0.5, (0.5, 0.5, height + 0.5), angle)
        masts += upright_box(foot[0], foot[1], level + height - 0.3, (0.3, 5.0, 0.3), angle)
    wires = []
    share = np.linspace(0.0, 1.0, 13)
    for aside in (-2.4, 0.0, 2.4):
        for k in range(spans):
            ends = np.column_stack([feet[k : k + 2] + aside * left, ground[k : k + 2] + height])
            line = ends[0] + share[:, None] * (ends[1] - ends[0])
            line[:, 2] -= 0.02 * (length / spans) * 4 * share * (1 - share)
            wires += [_ribbon(line[m], line[m + 1], left, 0.04) for m in range(len(share) - 1)]
    return ScannedSurfaces.join([ScannedSurfaces.of(masts, WIRE_TOWER), ScannedSurfaces.of(wires, WIRE)])


def _ribbon(
    p: NDArray[np.float64], q: NDArray[np.float64], left: NDArray[np.float64], half: float
) -> NDArray[np.float64]:
    """A level strip about a segment: as much of a beam as a wire throws back, without its upright side."""
    side = np.array([*left, 0.0]) * half
    return fan(np.stack([p - side, q - side, q + side, p + side]))


def span_bridge(x: float, y: float, corridor: Corridor, terrain: Terrain) -> ScannedSurfaces:
    """A bridge 8 m wide across a canal, its axis through (x, y), its deck joining the ground of the banks."""
    across = np.array([-np.sin(corridor.angle), np.cos(corridor.angle)])
    along = np.array([across[1], -across[0]])
    offset = float((np.array([x, y]) - [corridor.x, corridor.y]) @ across)
    middle = np.array([x, y]) - offset * across
    plan = [middle + (corridor.reach + 1.0) * side * across for side in (-1.0, 1.0)]
    level = terrain.at(np.stack(plan)) + 0.15
    crown = float(level.max()) + 0.4
    stations = [
        (plan[0], level[0]),
        (middle - 3 * across, crown),
        (middle + 3 * across, crown),
        (plan[1], level[1]),
    ]
    pieces = []
    for (p, low), (q, high) in pairwise(stations):
        corners = ((p, low, -4), (q, high, -4), (q, high, 4), (p, low, 4))
        deck = np.stack([[*(end + aside * along), level_there] for end, level_there, aside in corners])
        pieces.append(fan(deck))
        for a, b in ((0, 1), (3, 2)):
            rail = deck[[a, b]]
            pieces.append(curtain(rail, rail + UP))
    return ScannedSurfaces.of(pieces, BRIDGE_DECK)
