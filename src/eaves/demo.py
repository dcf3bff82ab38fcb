"""The demo: a scene whose every plane is known, built from its bare points, compared with the truth."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np
import shapely

from eaves.formats import read_cityjson, write_points
from eaves.geometry.planes import fit_plane
from eaves.simulate.roofs import ExactScene, nine_roofs_on_a_slope
from eaves.validate import validate_file
from eaves.viewer.build import build

Progress = AbstractContextManager[Callable[[str, int, int], None]]


def run_demo(folder: Path, progress: Progress) -> int:
    """Write the scene, build it, print planes found and their error; 0 when every model is valid."""
    raise NotImplementedError
