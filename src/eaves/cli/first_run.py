"""The first run from the sources compiles what a wheel brings compiled; a second core can do half of that."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

DENSITY = 6.0
"""Points a square metre of the scene that is modelled: enough for dormers, few enough to take no time."""


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
