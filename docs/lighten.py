"""Pictures at the weight that a page needs: `python -m docs.lighten [PICTURE …]`, all of docs without a name.

A picture is at most as wide as a page shows it, in a palette; one that would not lose a tenth stays as it is.
"""

from __future__ import annotations

import io
import sys
from pathlib import Path

from PIL import Image

DOCS = Path(__file__).parent
WIDTH = 960
"""Pixels of the text of a page on a screen."""
COLOURS = 64
"""What a plot or a rendering has without bands that show."""


def light(path: Path) -> bytes:
    """The picture as a PNG of few colours, no wider than a page."""
    with Image.open(path) as picture:
        image = Image.alpha_composite(Image.new("RGBA", picture.size, "white"), picture.convert("RGBA"))
    image = image.convert("RGB")
    if image.width > WIDTH:
        size = WIDTH, round(image.height * WIDTH / image.width)
        image = image.resize(size, Image.Resampling.LANCZOS)
    written = io.BytesIO()
    image.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(
        written, "PNG", optimize=True
    )
    return written.getvalue()


def main() -> None:
    """Write the pictures that become lighter."""
    paths = [Path(word) for word in sys.argv[1:]] or sorted(DOCS.rglob("*.png"))
    before = sum(path.stat().st_size for path in paths)
    for path in paths:
        if len(small := light(path)) < 0.9 * path.stat().st_size:
            path.write_bytes(small)
    now = sum(path.stat().st_size for path in paths)
    sys.stdout.write(f"{len(paths)} pictures, {before // 1000:,} kB before, {now // 1000:,} kB now\n")


if __name__ == "__main__":
    main()
