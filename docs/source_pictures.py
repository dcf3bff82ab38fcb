"""The pictures of the pages of sources, as `eaves build --steps` makes them of the run that each names.

Run `EAVES_DATA=... python -m docs.source_pictures [NAME...]`.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

from eaves.recipe.recipe import sources

FOLDER = Path(__file__).parent / "images" / "sources"
SCAN = "vaihingen/strip10.las"
"""A street of gables with ground all around, of the scan that three of the papers used (DGPF)."""
COLOURS = 64


def draw_source(name: str, path: Path) -> None:
    """The steps of a source in the block with most of the scan, which sees the points around it, too."""
    with tempfile.TemporaryDirectory() as out:
        words = ["build", SCAN, "-o", out, "--source", name, "--steps", "--outputs", "footprints", "--quiet"]
        subprocess.run([sys.executable, "-m", "eaves", *words], check=True, cwd=os.environ["EAVES_DATA"])
        picture = max(Path(out, "steps").glob("*.png"), key=lambda one: one.name)  # the eastern of two
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.open(picture).convert("RGB").quantize(COLOURS).save(path, optimize=True)


def main() -> None:
    """Draw the sources asked for, or all."""
    for name in sys.argv[1:] or sources():
        path = FOLDER / f"{name}.png"
        draw_source(name, path)
        sys.stdout.write(f"{path.name} {path.stat().st_size // 1000} kB\n")


if __name__ == "__main__":
    main()
