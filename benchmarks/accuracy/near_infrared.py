"""Detection with near infrared and without, on coloured towns: python -m benchmarks.accuracy.near_infrared.

The detector is `NotGreen` of the page *Your own method*, as it is printed there.
"""

from __future__ import annotations

import re
import sys
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.table import keep
from eaves.evaluate import evaluate_files
from eaves.pipeline import build
from eaves.simulate import coloured, scan_town, simulate_town, write_simulation

PAGE = Path(__file__).parents[2] / "docs" / "guides" / "own_method.md"
METHODS = {"consensus": "consensus", "the same without green points": "page_methods:NotGreen"}
SEEDS, DENSITIES, TREES = (31, 32), (2.0, 8.0), (1.0, 4.0)
COMMAND = "python -m benchmarks.accuracy.near_infrared"
NOTE = (
    "Towns of 0.04 km2 with colours by the kind of surface (`eaves simulate --colours`): three of a hundred "
    "roofs are planted, and as green as a lawn. No survey here has a near infrared that is not 0."
)
COLUMNS = ("area, completeness", "area, correctness", "area, quality")


def write_page_methods(folder: Path) -> None:
    """Write the Python of the page as a module, which can be imported from then on."""
    blocks = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    (folder / "page_methods.py").write_text("\n\n".join(blocks), encoding="utf-8")
    sys.path.append(str(folder))


def main() -> None:
    """Detect the buildings of drawn towns by both, and keep the table."""
    rows: list[dict[str, object]] = []
    with TemporaryDirectory() as name:
        folder = Path(name)
        write_page_methods(folder)
        for density, trees, seed in product(DENSITIES, TREES, SEEDS):
            town = simulate_town(area_km2=0.04, trees=trees, seed=seed)
            scene = coloured(scan_town(town, density=density, seed=seed), seed)
            files = write_simulation(scene, folder / "town")
            for words, method in METHODS.items():
                run = build(
                    files["points"],
                    folder / "out",
                    detect=method,
                    lod="0",
                    outputs=("footprints",),
                    overwrite=True,
                )
                outlines = run.folder / "footprints.gpkg"
                figures = evaluate_files("detection", outlines, files["vectors"]).figures
                row: dict[str, object] = {
                    "points a m2": density,
                    "trees": trees,
                    "seed": seed,
                    "detector": words,
                }
                rows.append(row | {one: round(figures[one], 4) for one in COLUMNS} | {"found": run.found})
    keep("near-infrared", "Near infrared", rows, COMMAND, NOTE)


if __name__ == "__main__":
    main()
