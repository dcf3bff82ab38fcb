"""Asks pip for a binary wheel of every dependency, for every platform and Python that users have."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import tomllib
from itertools import product
from pathlib import Path

PLATFORMS = {
    "Linux x86-64": [
        "manylinux_2_28_x86_64",
        "manylinux_2_27_x86_64",
        "manylinux2014_x86_64",
        "manylinux_2_17_x86_64",
    ],
    "macOS arm64": ["macosx_14_0_arm64", "macosx_13_0_arm64", "macosx_12_0_arm64", "macosx_11_0_arm64"],
    "Windows x86-64": ["win_amd64"],
}
PYTHONS = ("3.11", "3.12", "3.13")


def wheels_there(platform: str, python: str, packages: list[str]) -> str:
    """Empty when pip finds wheels of all packages, else the last line of its complaint."""
    tags = [flag for tag in PLATFORMS[platform] for flag in ("--platform", tag)]
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "pip", "install", "--dry-run", "--quiet", "--target", folder]
        command += ["--only-binary", ":all:", "--python-version", python, *tags, *packages]
        done = subprocess.run(command, capture_output=True, text=True)
    complaints = [line for line in done.stderr.splitlines() if line.startswith("ERROR")]
    return "" if done.returncode == 0 else (complaints or done.stderr.splitlines() or ["failed"])[-1]


def main() -> int:
    project = tomllib.loads(Path("pyproject.toml").read_text(encoding="utf-8"))["project"]
    packages = [*project["dependencies"], *project["optional-dependencies"]["cluster"]]
    missing = 0
    for platform, python in product(PLATFORMS, PYTHONS):
        complaint = wheels_there(platform, python, packages)
        missing += bool(complaint)
        print(f"{platform}, Python {python}: {complaint or 'wheels for everything'}", flush=True)
    return 1 if missing else 0


if __name__ == "__main__":
    sys.exit(main())
