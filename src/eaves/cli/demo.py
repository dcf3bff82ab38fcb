"""The demo: a simulated town, built from its bare points, compared with its exact truth."""

from __future__ import annotations

import logging
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import typer

from eaves.evaluate import evaluate_files
from eaves.report.build import build
from eaves.simulate import scan_town, simulate_town, write_simulation
from eaves.validate import validate_file

Progress = AbstractContextManager[Callable[[str, int, int], None]]

AREA_KM2, DENSITY, NOISE, SEED = 0.04, 10.0, 0.03, 7
"""A quarter with some dozen buildings on hilly ground, scanned as AHN3 is."""
MEASURES = {
    "ground": ("total error", "kappa"),
    "detection": (
        "area, completeness",
        "area, correctness",
        "area, quality",
        "objects over 10 m², completeness",
        "objects over 10 m², correctness",
    ),
    "footprints": ("mean IoU of pairs", "RMS of outlines (m)"),
    "planes": ("planes, completeness", "planes, correctness", "RMS in height (m)"),
    "models": ("median distance (m)", "within 0.1 m", "within 0.5 m", "models at LoD 2.2", "invalid models"),
}
"""The figures printed of each evaluation; the rest is in the folder `evaluation`."""


def run_demo(folder: Path, progress: Progress) -> int:
    """Simulate, build, evaluate, validate; prints the accuracy and the report's place. 0 when all is well."""
    truth, out = folder / "truth", folder / "built"
    typer.echo(f"simulating {AREA_KM2} km² at {DENSITY:g} points/m², noise {100 * NOISE:g} cm …")
    with progress as show:
        town = simulate_town(AREA_KM2, terrain="hilly", seed=SEED)
        files = write_simulation(scan_town(town, DENSITY, NOISE, seed=SEED), truth)
        typer.echo("building from the bare points (their true classes are not used) …")
        summary = build(files["points"], out, progress=show)
    typer.echo(summary.as_text())

    typer.echo("\naccuracy against the exact truth (all figures: " + str(folder / "evaluation") + ")")
    logger = logging.getLogger("eaves")
    level = logger.level
    logger.setLevel(logging.ERROR)  # the town has no place on Earth, as intended
    results = {
        "ground": (out / "classified.laz", files["points"]),
        "detection": (out / "footprints.gpkg", files["vectors"]),
        "footprints": (out / "footprints.gpkg", files["vectors"]),
        "planes": (out / "buildings.city.jsonl", files["models"]),
        "models": (out / "buildings.city.jsonl", files["models"]),
    }
    for what, (result, reference) in results.items():
        evaluation = dict(evaluate_files(what, result, reference, folder / "evaluation").table())
        for name in MEASURES[what]:
            typer.echo(f"  {what:<11} {name:<34} {evaluation.get(name, '–')}")
    logger.setLevel(level)
    findings = validate_file(out / "buildings.city.jsonl")
    typer.echo(f"\nvalidity: {len(findings)} findings in {summary.modelled} models")
    typer.echo(f"report: {out / 'report.html'}")
    return 0 if summary.complete and not findings else 1
