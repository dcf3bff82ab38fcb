"""Simulated scenes that the benchmarks use: some to develop on, some for judging only.

No default of any method is chosen on a judging scene. Their seeds begin at 9001 and are used nowhere else.
"""

from __future__ import annotations

from dataclasses import dataclass

from eaves.simulate.flight import Flight, Pattern
from eaves.simulate.objects.exact import ExactScene
from eaves.simulate.objects.streets import TownStyle
from eaves.simulate.objects.surfaces import TerrainKind
from eaves.simulate.scanner import scan_town
from eaves.simulate.town import simulate_town


@dataclass(frozen=True)
class StandardScene:
    """The parameters of a scene; `make` gives the same points every time.

    Parameters
    ----------
    name : str
        Title in tables.
    seed : int
        Of the town and the scan.
    style, terrain : str
        As in `simulate_town`.
    density : float
        Pulses per square metre (> 0).
    noise : float
        Standard deviation of a range (m).
    leaf_loss : float
        Loss of a pulse's energy per metre of crown (1/m).
    half_angle_deg : float
        Half the opening angle of the scanner (degrees).
    pattern : str
        As in `scan_town`.
    area_km2 : float
        Area of the town (km²).

    Examples
    --------
    >>> from eaves.simulate import DEVELOPMENT_SCENES
    >>> DEVELOPMENT_SCENES[0].name
    'suburb, flat, 10/m²'
    """

    name: str
    seed: int
    style: TownStyle
    terrain: TerrainKind
    density: float
    noise: float = 0.02
    leaf_loss: float = 2.5
    half_angle_deg: float = 20.0
    pattern: Pattern = "lines"
    area_km2: float = 0.04

    def make(self) -> ExactScene:
        """The scan, with the truth of every point."""
        town = simulate_town(
            self.area_km2, terrain=self.terrain, seed=self.seed, style=self.style, leaf_loss=self.leaf_loss
        )
        flight = Flight(half_angle_deg=self.half_angle_deg)
        return scan_town(town, self.density, self.noise, self.pattern, self.seed, flight=flight)


DEVELOPMENT_SCENES = (
    StandardScene("suburb, flat, 10/m²", 1, "suburb", "flat", 10.0),
    StandardScene("centre, slope, 15/m², out of leaf", 2, "centre", "slope", 15.0, leaf_loss=0.5),
    StandardScene("mixed, hilly, 4/m²", 3, "mixed", "hilly", 4.0, noise=0.03),
    StandardScene("mixed, terraced, 25/m²", 4, "mixed", "terraced", 25.0),
    StandardScene("suburb, hilly, 1.5/m²", 5, "suburb", "hilly", 1.5, noise=0.05, half_angle_deg=15.0),
)
"""Scenes for development and tuning."""

JUDGING_SCENES = (
    StandardScene("judging: centre, hilly, 8/m²", 9001, "centre", "hilly", 8.0, pattern="zigzag"),
    StandardScene("judging: suburb, terraced, 3/m²", 9002, "suburb", "terraced", 3.0, noise=0.03),
    StandardScene("judging: mixed, slope, 25/m²", 9003, "mixed", "slope", 25.0, pattern="ellipse"),
    StandardScene(
        "judging: centre, flat, 12/m², noisy, out of leaf", 9004, "centre", "flat", 12.0, 0.05, 0.5, 30.0
    ),
)
"""Scenes for judging only."""
