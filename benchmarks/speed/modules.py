"""How many modules of the package one run goes through: imported, and with a function that ran.

usage: python -m benchmarks.speed.modules [FILE…]       (by default EAVES_DATA/misc/delft_small.laz)
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from pathlib import Path
from types import FrameType
from typing import Any

from benchmarks.table import keep

SOURCES = Path(__file__).parents[2] / "src/eaves"


def count_modules(file: Path) -> tuple[set[str], set[str]]:
    """The modules that building a file imports, and those of which it runs a function, in this process."""
    ran: set[str] = set()

    def note(frame: FrameType, event: str, _: Any) -> None:
        if event == "call" and frame.f_code.co_name != "<module>":
            ran.add(frame.f_globals.get("__name__", ""))

    from eaves.cli import app

    with tempfile.TemporaryDirectory() as folder:
        sys.argv = ["eaves", "build", str(file), "-o", str(Path(folder) / "out"), "--jobs", "1", "--quiet"]
        sys.setprofile(note)
        try:
            app.main()
        except SystemExit as end:
            if end.code:
                raise
        finally:
            sys.setprofile(None)
    imported = {name for name in sys.modules if name.partition(".")[0] == "eaves"}
    return imported, ran & imported


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    default = Path(os.environ.get("EAVES_DATA", "")) / "misc/delft_small.laz"
    parser.add_argument("files", nargs="*", type=Path, default=[default])
    rows = []
    for file in parser.parse_args().files:
        imported, ran = count_modules(file)
        modules = sum(1 for _ in SOURCES.rglob("*.py"))
        rows.append({"data": file.stem, "modules": modules, "imported": len(imported), "ran": len(ran)})
        print(rows[-1])
    keep("modules", "Modules that a run goes through", rows, "python -m benchmarks.speed.modules")


if __name__ == "__main__":
    main()
