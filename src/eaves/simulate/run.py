"""The command `eaves simulate`: the words checked, the town drawn or read, scanned and written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, get_args

from eaves.simulate import (
    Survey,
    coloured,
    later_survey,
    scan_town,
    simulate_epochs,
    simulate_town,
    town_of_model,
    write_changes,
    write_simulation,
)
from eaves.simulate.flight import Pattern
from eaves.simulate.objects.streets import TownStyle
from eaves.simulate.objects.surfaces import TerrainKind

CHOICES = {"pattern": get_args(Pattern), "terrain": get_args(TerrainKind), "style": get_args(TownStyle)}
"""The values of each option."""


def run_simulation(
    out: Path,
    town: Mapping[str, Any],
    scan: Mapping[str, Any],
    seed: int = 0,
    crs: str | None = None,
    colours: bool = False,
) -> str:
    """Write a town and its scan to the folder `out`, its points with or without `colours`; one line with its
    contents.

    `town` holds the arguments of `simulate_town`, and `model`: a CityJSON file to scan instead, or None.
    `scan` holds those of `scan_town`; the pattern `scan` is another word for `lines`.
    """
    scan = checked_words(town, scan)
    model = town["model"]
    if model is not None:
        drawn = town_of_model(model, trees=town["trees"], seed=seed, crs=crs)
    else:
        drawn = simulate_town(**{name: value for name, value in town.items() if name != "model"}, seed=seed)
    scene = scan_town(drawn, **scan, seed=seed)
    if crs is not None and model is None:
        scene = scene.placed(crs)
    scene = coloured(scene, seed) if colours else scene
    settings = {**town, **scan, "seed": seed, "model": None if model is None else model.name}
    settings["noise_m"] = settings.pop("noise")
    files = write_simulation(scene, out, settings)
    return f"{len(scene.cloud):,} points, {len(scene.buildings)} buildings; {files['points']}"


def checked_words(town: Mapping[str, Any], scan: Mapping[str, Any]) -> dict[str, Any]:
    """The arguments of the scan, when all words are known; ValueError names one that is not."""
    scan = {**scan, "pattern": "lines" if scan["pattern"] == "scan" else scan["pattern"]}
    for name, choices in CHOICES.items():
        value = {**town, **scan}[name]
        if value not in choices:
            raise ValueError(f"--{name} {value}: unknown; choose one of: {', '.join(choices)}")
    return scan


def run_epochs(
    out: Path,
    town: Mapping[str, Any],
    scan: Mapping[str, Any],
    changed: float,
    new_density: float,
    seed: int = 0,
    crs: str | None = None,
) -> str:
    """Write a town at two times to the folders `old` and `new`, with what became of each building."""
    scan = checked_words(town, scan)
    for name in ("model", "buildings"):
        if town[name] is not None:
            raise ValueError(f"--{name}: a town at two times is drawn, on all its plots; leave it out")
    drawn = {name: value for name, value in town.items() if name not in ("model", "buildings")}
    epochs = simulate_epochs(**drawn, seed=seed, changed=changed)
    surveys = Survey(**scan), later_survey(new_density, scan["noise"])
    reports = []
    for name, survey, there, own in zip(
        ("old", "new"), surveys, (epochs.old, epochs.new), (seed, seed + NEXT_SEED), strict=True
    ):
        scene = survey.scan(there, own)
        scene = scene if crs is None else scene.placed(crs)
        settings = {**drawn, "epoch": name, "changed": changed, "seed": seed, "survey": asdict(survey)}
        files = write_simulation(scene, out / name, settings)
        reports.append(f"{len(scene.cloud):,} points, {len(scene.buildings)} buildings; {files['points']}")
    files = write_changes(epochs.changes, scene, out, {**drawn, "changed": changed, "seed": seed})
    return "\n".join([*reports, f"what changed: {files['layer']}"])


NEXT_SEED = 1_000_003
"""The second flight is not the first one again."""
