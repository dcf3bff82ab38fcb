"""The tools' geometry, tested by node."""

import shutil
import subprocess
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[2] / "page" / "tests"


@pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")
def test_snapping_splitting_and_undo() -> None:
    command = ["node", "--test", str(TESTS / "geometry.test.js")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stdout
