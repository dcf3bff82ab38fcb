"""What a user's editor sees: types, signatures, names."""

from __future__ import annotations

import inspect
import json
import os
import pydoc
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import eaves
from eaves.methods import REGISTRY, methods_of
from eaves.run.options import DEFAULT_OPTIONS, RunOptions

SCRIPT = """
import numpy as np
from typing_extensions import assert_type

import eaves
from eaves.formats import write_cityjson
from eaves.model import BuildingModel, Failure, Raster

cloud = eaves.classify_ground(eaves.read("tile.laz"), {"method": "adaptive_tin", "seed_cell": 30.0})
scene = eaves.make_scene(cloud, cloud.bounds)
assert_type(scene.dtm, Raster)
regions = eaves.detect_buildings(scene, eaves.Consensus(min_height=2.5))
points = cloud.xyz[regions.mask_of(1)]
boundary = eaves.trace_outline(points, scene.spacing)
if not isinstance(boundary, Failure):
    footprint = eaves.regularise_outlines([boundary], "ransac_lines")[0]
    if not isinstance(footprint, Failure):
        planes = eaves.segment_roof(points, scene.spacing, rng=np.random.default_rng(1))
        model = eaves.reconstruct_building(points, footprint, planes, ground=0.0)
        assert_type(model, BuildingModel | Failure)
        write_cityjson("one.city.json", [model], cloud.system)
results = eaves.build("tile.laz", "out", jobs=2, footprints="map.gpkg", detect="consensus")
assert_type(results.found, int)
eaves.build("tile.laz", "out", jobs="two")
eaves.detect_buildings(points)
eaves.Consensus(min_hight=2.5)
"""


@pytest.mark.slow
def test_a_user_script_is_checked_in_full(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(SCRIPT, encoding="utf-8")
    source = Path(eaves.__file__).parent
    assert (source / "py.typed").exists()
    command = [sys.executable, "-m", "mypy", "--strict", "--config-file", os.devnull, str(script)]
    command += ["--follow-imports", "silent", "--ignore-missing-imports", "--cache-dir", str(tmp_path)]
    environment = {**os.environ, "MYPYPATH": str(source.parent)}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=300)
    lines = SCRIPT.splitlines()
    wrong = {lines[int(n) - 1] for n in re.findall(r"script\.py:(\d+): error", done.stdout)}
    assert wrong == set(lines[-3:]), done.stdout + done.stderr


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("pyright") is None, reason="pyright is not installed")
def test_pyright_accepts_the_code_of_the_guides(tmp_path: Path) -> None:
    source = Path(eaves.__file__).parents[1]
    for page in ("python", "researcher"):
        text = (source.parent / "docs" / "guides" / f"{page}.md").read_text(encoding="utf-8")
        blocks = [one for one in re.findall(r"^```python\n(.*?)^```", text, re.M | re.S) if ">>>" not in one]
        (tmp_path / f"{page}.py").write_text("\n".join(blocks), encoding="utf-8")
    settings = {"extraPaths": [str(source)], "typeCheckingMode": "basic"}
    (tmp_path / "pyrightconfig.json").write_text(json.dumps(settings), encoding="utf-8")
    command = ["pyright", "--pythonpath", sys.executable, "--project", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout


def test_build_shows_its_keywords_and_their_defaults() -> None:
    signature = inspect.signature(eaves.build)
    assert set(RunOptions.__annotations__) < set(signature.parameters)
    assert signature.parameters["jobs"].default == DEFAULT_OPTIONS["jobs"]
    assert signature.parameters["footprints"].default is None
    assert signature.parameters["footprints"].kind is inspect.Parameter.KEYWORD_ONLY
    assert "jobs: int = 1" in str(signature).replace("'", "")


def test_help_of_the_first_door_fits_on_a_screen() -> None:
    lines = pydoc.render_doc(eaves.find_buildings, renderer=pydoc.plaintext).splitlines()
    assert sum(1 + len(line) // 120 for line in lines) <= 50


def test_dir_lists_functions_methods_and_data_types() -> None:
    stub = (Path(eaves.__file__).parent / "__init__.pyi").read_text(encoding="utf-8")
    listed = set(re.findall(r"import \w+ as (\w+)", stub))
    assert listed <= set(dir(eaves))
    assert {"build", "classify_ground", "AdaptiveTin", "PointCloud"} <= set(dir(eaves))
    methods = {place.split(":")[1] for stage in REGISTRY for place in methods_of(stage).values()}
    assert methods <= listed
    assert all(getattr(eaves, name).__name__.split(".")[-1] == name for name in listed)
