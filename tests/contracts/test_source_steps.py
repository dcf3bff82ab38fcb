"""Every step of a published system does something on real data: without it the answer is another."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from eaves.detect import detect_buildings
from eaves.formats import read
from eaves.ground import classify_ground
from eaves.methods import resolve_method
from eaves.model import PointCloud, Scene
from eaves.raster.surfaces import make_scene
from eaves.recipe.recipe import sources

STEPS = [(source.name, *step) for source in sources().values() for step in source.steps]
NEEDS_DATA = pytest.mark.skipif("EAVES_DATA" not in os.environ, reason="EAVES_DATA names no folder of data")
SETS = (
    "delft/ahn3.laz",
    "ign_urban/test_data_77050_627760_LA93_IGN69.laz",
    "misc/lidR_Topography.laz",
    "ign_urban/test_data_77050_627755_LA93_IGN69.laz",
)
"""Houses in rows; houses among vegetation; a wooded hill without any; houses that the rim cuts."""
CANNOT_ACT = {
    ("xiao2014", "mean density"): "where echoes and small regions have left, crowns are as dense as roofs",
}
"""Steps that change nothing on any set, and why."""


@cache
def cloud_of(name: str) -> PointCloud:
    return read(Path(os.environ["EAVES_DATA"]) / name).with_(classification=None).in_canonical_order()


@cache
def scene_of(name: str, ground: str) -> Scene:
    cloud = classify_ground(cloud_of(name), resolve_method("ground", ground))  # type: ignore[arg-type]
    return make_scene(cloud, cloud.bounds)


@cache
def answer_of(name: str, source: str) -> NDArray[np.bool_]:
    methods = sources()[source].methods
    detector = resolve_method("detect", methods["detect"])
    return np.asarray(detect_buildings(scene_of(name, methods["ground"]), detector).label > 0)  # type: ignore[arg-type]


def without(name: str, source: str, stage: str, off: dict[str, Any]) -> NDArray[np.bool_]:
    """Which points are building when one step is left out."""
    methods = sources()[source].methods
    scene = scene_of(name, methods["ground"])
    if stage == "ground":
        cloud = classify_ground(
            cloud_of(name), resolve_method("ground", {"method": methods["ground"], **off})
        )  # type: ignore[arg-type]
        scene, off = make_scene(cloud, cloud.bounds), {}
    detector = resolve_method("detect", {"method": methods["detect"], **off})
    return np.asarray(detect_buildings(scene, detector).label > 0)  # type: ignore[arg-type]


@NEEDS_DATA
@pytest.mark.slow
@pytest.mark.parametrize(("source", "stage", "step", "off"), STEPS)
def test_a_step_changes_the_answer_on_a_real_set(
    source: str, stage: str, step: str, off: dict[str, Any]
) -> None:
    changed = 0
    for name in SETS:
        changed = max(changed, int((without(name, source, stage, off) != answer_of(name, source)).sum()))
        if changed > 20:
            break
    if (source, step) in CANNOT_ACT:
        assert changed <= 100, "it acts after all: say so"
    else:
        assert changed > 20
