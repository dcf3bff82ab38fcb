"""What a run costs before it has done anything: imports, the smallest build, the first build of a new user.

usage: python -m benchmarks.speed.start [TREE]      (needs EAVES_DATA)

Beside another checkout, TREE, in turns, if one is named. The first builds run a copy of the package with
nothing in numba's cache: with the library of kernels that a wheel brings, if there is one (`make kernels`),
and without it.
"""

from __future__ import annotations

import compileall
import os
import shutil
import sys
import tempfile
from pathlib import Path

from benchmarks.speed.budget import GIVEN, HERE, run_alone
from benchmarks.table import keep

TURNS = 2
DELFT = ["-m", "eaves", "build", "{data}/delft/ahn3.laz", *GIVEN, "-o", "{out}", "--quiet", "--jobs", "1"]
SMALLEST = [*DELFT, "--bounds", "84850,447500,84900,447550"]
"""20 buildings on 50 m by 50 m, all outputs."""
RUNS = {
    "import eaves": ["-c", "import eaves"],
    "eaves --help": ["-m", "eaves", "--help"],
    "smallest build": SMALLEST,
    "smallest build, roofer's outputs": [*SMALLEST, "--outputs", "footprints,models"],
    "delft, footprints given": DELFT,
}


def measure(package: Path, words: list[str], data: Path, cache: Path | None = None) -> tuple[float, float]:
    """Processor time (s) and peak memory (MB) of a process."""
    environment = {**os.environ, "PYTHONPATH": str(package)}
    if cache:
        environment["NUMBA_CACHE_DIR"] = str(cache)
    with tempfile.TemporaryDirectory() as out:
        named = (word.format(data=data, out=Path(out) / "out") for word in words)
        return run_alone([sys.executable, *named], environment, quiet=True)


def measure_first(package: Path, data: Path, library: bool) -> tuple[float, float]:
    """The first small build of a package that was just installed."""
    left_out = shutil.ignore_patterns("__pycache__", *([] if library else ["compiled.*"]))
    with tempfile.TemporaryDirectory() as folder:
        shutil.copytree(package / "eaves", Path(folder) / "eaves", ignore=left_out)
        compileall.compile_dir(folder, quiet=1)  # as pip does
        return measure(Path(folder), SMALLEST, data, Path(folder) / "cache")


def main() -> None:
    """Measure each run some times, the trees in turns, and keep the least time of each."""
    data = Path(os.environ["EAVES_DATA"])
    trees = {"": HERE / "src"} | ({" there": Path(sys.argv[1]).resolve() / "src"} if sys.argv[1:] else {})
    taken: dict[str, dict[str, list[tuple[float, float]]]] = {}
    for package in trees.values():
        measure(package, DELFT, data)  # compiles what is not compiled yet
    for name, words in RUNS.items():
        for _ in range(TURNS):
            for which, package in trees.items():
                taken.setdefault(name, {}).setdefault(which, []).append(measure(package, words, data))
        print(name, taken[name], flush=True)
    for library in [True, False] if any((HERE / "src" / "eaves").glob("compiled.*")) else [False]:
        name = f"first build, {'kernels of the wheel' if library else 'nothing compiled'}"
        taken[name] = {"": [measure_first(HERE / "src", data, library)]}
    rows = []
    for name, by_tree in taken.items():
        row: dict[str, object] = {"run": name}
        for which in trees:
            some = by_tree.get(which)
            row[f"CPU s{which}"] = round(min(seconds for seconds, _ in some), 2) if some else None
            row[f"peak MB{which}"] = round(max(mb for _, mb in some)) if some else None
        rows.append(row)
    keep(
        "start",
        "What a run costs before it has done anything",
        rows,
        "python -m benchmarks.speed.start [TREE]",
    )


if __name__ == "__main__":
    main()
