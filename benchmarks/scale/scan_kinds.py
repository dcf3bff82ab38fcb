"""Scans of other kinds, each made of one drawn scan: what a run says of it, and what it reaches.

usage: python -m benchmarks.scale.scan_kinds [--hectares 4] [--density 6] [--seed 5]

Wrong is the area of buildings found where none is, as a share of the true area; `high, wrong` counts
buildings of high trust that touch none.
"""

from __future__ import annotations

import argparse
import logging
import tempfile
from pathlib import Path

import geopandas
import laspy
from tests.run.test_advice import KINDS

import eaves
from benchmarks.table import keep
from eaves.flow.advice import scan_facts
from eaves.run.index import index_inputs
from eaves.simulate import scan_town, simulate_town, write_simulation

DRONE, DRONE_KM2 = 150.0, 0.01
"""Points/m² and area of a scan by a drone."""


def row_of(kind: str, files: dict[str, Path], folder: Path) -> dict[str, object]:
    """What a run says of a kind and what it reaches against the true footprints."""
    las, truth = laspy.read(files["points"]), files["vectors"]
    if kind in KINDS:
        KINDS[kind][0](las)
    path = folder / f"{kind.replace(' ', '_')}.laz"
    las.write(path)
    eaves.build(path, folder / kind, crs="metres", outputs=("footprints", "models"), jobs=1)
    known = geopandas.read_file(truth, layer="footprints").geometry
    found = geopandas.read_file(folder / kind / "footprints.gpkg", layer="footprints")
    true_area, made_area = known.union_all(), found.geometry.union_all()
    high = found[found["trust"] == "high"]
    return {
        "kind": kind,
        "points": len(las.points),
        "found": len(found),
        "true": len(known),
        "area found": made_area.intersection(true_area).area / true_area.area,
        "wrong": made_area.difference(true_area).area / true_area.area,
        "high": len(high),
        "high, wrong": int((~high.intersects(true_area)).sum()),
        "said": "; ".join(scan_facts(index_inputs([path], "metres", [])).remarks()) or None,
    }


def main() -> None:
    """Run every kind and keep the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--hectares", type=float, default=4.0)
    parser.add_argument("--density", type=float, default=6.0)
    parser.add_argument("--seed", type=int, default=5)
    given = parser.parse_args()
    logging.disable()
    town = simulate_town(given.hectares / 100, seed=given.seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = write_simulation(scan_town(town, density=given.density, seed=given.seed), folder / "drawn")
        rows = [row_of(kind, files, folder) for kind in KINDS]
        low = scan_town(simulate_town(DRONE_KM2, seed=given.seed), DRONE, 0.03, "zigzag", seed=given.seed)
        rows.append(row_of(f"drone, {DRONE:g} points per m²", write_simulation(low, folder / "low"), folder))
    keep("scan-kinds", "Scans of other kinds", rows, "python -m benchmarks.scale.scan_kinds")


if __name__ == "__main__":
    main()
