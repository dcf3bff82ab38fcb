"""What `eaves simulate` does: the words checked, the town drawn or read, scanned and written."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_args

from eaves.simulate import scan_town, simulate_town, town_of_model, write_simulation
from eaves.simulate.flight import Pattern
from eaves.simulate.streets import TownStyle
from eaves.simulate.terrain import TerrainKind

CHOICES = {"pattern": get_args(Pattern), "terrain": get_args(TerrainKind), "style": get_args(TownStyle)}
"""The values of each option."""


def run_simulation(
    out: Path, town: Mapping[str, Any], scan: Mapping[str, Any], seed: int = 0, crs: str | None = None
) -> str:
    """Write a town and its scan to the folder `out`; one line with its contents.

    `town` holds the arguments of `simulate_town`, and `model`: a CityJSON file to scan instead, or None.
    `scan` holds those of `scan_town`; the pattern `scan` is another word for `lines`.
    """
    scan = {**scan, "pattern": "lines" if scan["pattern"] == "scan" else scan["pattern"]}
    for name, choices in CHOICES.items():
        value = {**town, **scan}[name]
        if value not in choices:
            raise ValueError(f"--{name} {value}: unknown; choose one of: {', '.join(choices)}")
    model = town["model"]
    if model is not None:
        drawn = town_of_model(model, trees=town["trees"], seed=seed, crs=crs)
    else:
        drawn = simulate_town(**{name: value for name, value in town.items() if name != "model"}, seed=seed)
    scene = scan_town(drawn, **scan, seed=seed)
    if crs is not None and model is None:
        scene = scene.placed(crs)
    settings = {**town, **scan, "seed": seed, "model": None if model is None else model.name}
    settings["noise_m"] = settings.pop("noise")
    files = write_simulation(scene, out, settings)
    return f"{len(scene.cloud):,} points, {len(scene.buildings)} buildings; {files['points']}"
