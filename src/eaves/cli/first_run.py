"""The first run from the sources compiles what a wheel brings compiled; a second core can do half of that."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

DENSITY = 6.0
"""Points a square metre of the scene that is modelled: enough for dormers, few enough to take no time."""


LOOPS = 104
"""Compiled loops that the default methods call with the sorts of arguments of most data: about that many."""
POLL_S = 5.0


def compiled_pieces() -> int:
    """The number of loops that numba keeps compiled for eaves: none before the first run."""
    import eaves

    place = os.environ.get("NUMBA_CACHE_DIR") or Path(eaves.__file__).parent
    return sum(1 for _ in Path(place).rglob("*.nbc"))


@contextmanager
def compilation_shown(wanted: bool, show: Callable[[str, int, int], None]) -> Iterator[None]:
    """If it is wanted, progress shows how many loops are compiled, by this process and the one beside it."""
    ended = threading.Event()

    def watch() -> None:
        while not ended.wait(POLL_S) and (done := compiled_pieces()) < LOOPS:
            show("compiling", done, LOOPS)

    watcher = threading.Thread(target=watch, daemon=True)
    if wanted:
        watcher.start()
    try:
        yield
    finally:
        ended.set()


@contextmanager
def compiling_beside(wanted: bool) -> Iterator[None]:
    """If it is wanted, another process compiles what a run needs last, while this one begins with the rest.

    Each finds in numba's cache what the other has done. It ends with the context, wherever it has come to.
    """
    if not wanted:
        yield
        return
    words, nowhere = [sys.executable, "-m", "eaves.cli.first_run"], subprocess.DEVNULL
    with subprocess.Popen(words, stdin=nowhere, stdout=nowhere, stderr=nowhere) as process:
        try:
            yield
        finally:
            process.terminate()


def model_houses() -> None:
    """Model nine small houses and check the models, the last steps first: that compiles what it calls."""
    import eaves
    from eaves.model import Boundary, BuildingModel, Footprint
    from eaves.simulate import nine_roofs_on_a_slope
    from eaves.validate.models import find_invalid

    truth = nine_roofs_on_a_slope(density=DENSITY, noise=0.02)
    find_invalid([house.model() for house in truth.buildings])
    spacing = DENSITY**-0.5
    for number, house in enumerate(truth.buildings, 1):
        points = truth.cloud.xyz[truth.building == number]
        planes = eaves.segment_roof(points, spacing)
        model = eaves.reconstruct_building(points, Footprint(house.footprint), planes, house.base)
        if isinstance(model, BuildingModel):
            find_invalid([model])
    for number in range(1, len(truth.buildings) + 1):
        outline = eaves.trace_outline(truth.cloud.xyz[truth.building == number], spacing)
        if isinstance(outline, Boundary):
            eaves.regularise_outlines([outline])


if __name__ == "__main__":
    model_houses()
