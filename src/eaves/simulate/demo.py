"""The demo: a simulated town, built from its bare points, compared with its exact truth; or a real tile, an
open one of a fixed address, checked by its hash."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

import typer

from eaves import build
from eaves.evaluate import evaluate_files
from eaves.formats import InputError, Traffic, fetch
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


@dataclass(frozen=True)
class RealTile:
    """A file of points by its address, the hash of its bytes, its reference system and who is credited."""

    address: str
    sha256: str
    crs: str
    credit: str


SAINT_BARTHELEMY = RealTile(
    "https://raw.githubusercontent.com/IGNF/lidar-prod/2cb12d9ef5ac9f3a3ed08e8776453e167cd4f251/"
    "tests/files/St_Barth_RGAF09_UTM20N_IGN_1988_SB_subset_100m.laz",
    "d98b32d7c6bff8a99131e4260f935f69541399a9f18ff8c153739cf65762113b",
    "EPSG:5490",
    "IGN, LiDAR HD, Licence Ouverte Etalab 2.0",
)
"""A dense quarter under trees, 100 m wide, 249,120 points, 1 MB."""


def fetch_tile(tile: RealTile, folder: Path) -> Path:
    """The tile in a folder.

    Raises
    ------
    InputError
        When there is no network, or its bytes are others than they were.
    """
    path = fetch(tile.address, folder, None, None, Traffic())
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    if digest != tile.sha256:
        path.unlink()
        raise InputError(f"{tile.address}: its SHA-256 is {digest}, not {tile.sha256}; it was changed there")
    return path


def run_real(folder: Path, tile: RealTile = SAINT_BARTHELEMY) -> int | None:
    """Fetch the tile and build it; 0 when all is well, None where it cannot be had, and says why."""
    try:
        path = fetch_tile(tile, folder / "points")
    except InputError as error:
        typer.echo(f"no real tile: {error}\na simulated town takes its place")
        return None
    typer.echo(f"{path.name}: {tile.credit}")
    summary = build(path, folder / "built", crs=tile.crs)
    typer.echo(summary.as_text())
    return 0 if summary.complete else 1
