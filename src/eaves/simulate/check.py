"""The check of an installation: a small scene of known houses, built."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

TEST_DENSITY = 8.0
"""Points a square metre of the town that is built."""


def check_installation() -> tuple[bool, str]:
    """True if nine houses are found and modelled from their simulated points, and a line that says so."""
    from eaves.pipeline import build
    from eaves.simulate import nine_roofs_on_a_slope, write_simulation
    from eaves.validate import validate_file

    started = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="eaves-doctor-") as folder:
        scene = nine_roofs_on_a_slope(density=TEST_DENSITY, noise=0.02, seed=1)
        files = write_simulation(scene, Path(folder) / "scene")
        summary = build(files["points"], Path(folder) / "out", jobs=1, outputs=("footprints", "models"))
        findings = validate_file(Path(folder) / "out" / "buildings.city.jsonl")
    wanted = len(scene.buildings)
    good = summary.found == summary.modelled == wanted and not findings
    return good, (
        f"self-test: {summary.found} of {wanted} buildings found, {summary.modelled} modelled, "
        f"{len(findings)} defects, {time.perf_counter() - started:.0f} s: {'good' if good else 'NOT GOOD'}"
    )
