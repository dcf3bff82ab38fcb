"""The schemas of CityGML and all that they import, for the test that judges by them: `schemas.py FOLDER`.

Files lie as on schemas.opengis.net, those of other hosts in a folder each; addresses in them become relative.
"""

from __future__ import annotations

import os
import re
import sys
import urllib.request
from pathlib import Path
from urllib.parse import urljoin, urlsplit

HOST = "https://schemas.opengis.net/"
FIRST = (
    *(
        f"citygml/{name}.xsd"
        for name in ("2.0/cityGMLBase", "building/2.0/building", "generics/2.0/generics")
    ),
    *(f"citygml/3.0/{name}.xsd" for name in ("core", "building", "construction", "generics")),
)
LOCATION = re.compile(r'schemaLocation="([^"\s]+)"')


def place_of(address: str) -> Path:
    """Where in the folder the file of an address lies."""
    parts = urlsplit(address)
    path = Path(parts.path.lstrip("/"))
    return path if parts.hostname == urlsplit(HOST).hostname else Path(parts.hostname or "file") / path


def fetch(folder: Path, first: list[str]) -> int:
    """Write the files of some addresses and of all that they name; how many there are."""
    waiting, known = list(first), set[str]()
    while waiting:
        address = re.sub("^http:", "https:", waiting.pop())
        if address in known:
            continue
        known.add(address)
        with urllib.request.urlopen(address, timeout=60) as answer:
            text = answer.read().decode("utf-8")
        place = place_of(address)

        def relative(match: re.Match[str], address: str = address, place: Path = place) -> str:
            target = re.sub("^http:", "https:", urljoin(address, match[1]))
            waiting.append(target)
            return f'schemaLocation="{Path(os.path.relpath(place_of(target), place.parent)).as_posix()}"'

        text = LOCATION.sub(relative, text)
        (folder / place).parent.mkdir(parents=True, exist_ok=True)
        (folder / place).write_text(text, encoding="utf-8")
    return len(known)


if __name__ == "__main__":
    sys.stdout.write(f"{fetch(Path(sys.argv[1]), [HOST + path for path in FIRST])} schemas\n")
