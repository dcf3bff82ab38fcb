"""How fast models are validated: simulated towns, and a real one when EAVES_DATA is set.

Run `EAVES_DATA=... python -m benchmarks.speed.validate`.
"""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path

from benchmarks.table import keep
from eaves.formats import read_cityjson, write_cityjson
from eaves.simulate.town import simulate_town
from eaves.validate import validate_file

COMMAND = "python -m benchmarks.speed.validate"
AREAS_KM2 = (0.09, 0.5)


def measure(name: str, path: Path) -> dict[str, object]:
    """One row: the second of two runs, so that kernels are loaded."""
    objects = read_cityjson(path).values()
    faces = sum(
        len(shell)
        for item in objects
        for geometry in item.geometries
        for solid in geometry.solids
        for shell in solid
    )
    validate_file(path)
    wall, processor = time.perf_counter(), time.process_time()
    findings = validate_file(path)
    processor, wall = time.process_time() - processor, time.perf_counter() - wall
    return {
        "models": name,
        "city objects": len(objects),
        "polygons": faces,
        "invalid": len({finding.building for finding in findings}),
        "seconds": wall,
        "CPU seconds": processor,
        "CPU ms per object": 1000 * processor / max(1, len(objects)),
    }


def main() -> None:
    """Print and keep the table."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for area in AREAS_KM2:
            town = simulate_town(area, seed=1)
            path = Path(folder) / "town.city.json"
            write_cityjson(path, [building.model(town.origin) for building in town.buildings], town.system)
            rows.append(measure(f"simulated town, {area:g} km²", path))
    if "EAVES_DATA" in os.environ:
        path = Path(os.environ["EAVES_DATA"]) / "towns" / "delfshaven.city.json"
        rows.append(measure("Rotterdam Delfshaven (MultiSurface)", path))
    keep("validate-speed", "Validation of models, rings to solids", rows, COMMAND)


if __name__ == "__main__":
    main()
