"""HATCH_BUILD_HOOK_ENABLE_CUSTOM=1 has hatchling put the library of kernels into the wheel that it builds,
which is for all Pythons on a system."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class CompiledKernels(BuildHookInterface):
    """The library of kernels, made with the packages of this environment (`--no-isolation`)."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Make the library and name it to the builder; an editable install has none."""
        if version == "editable":
            return
        root = Path(self.root)
        self.folder = tempfile.TemporaryDirectory()
        subprocess.run(
            [sys.executable, root / "packaging" / "kernels.py", self.folder.name],
            env=os.environ | {"PYTHONPATH": str(root / "src")},
            check=True,
        )
        for file in Path(self.folder.name).iterdir():
            build_data["force_include"][str(file)] = f"eaves/{file.name}"
        system = self.build_config.builder.get_best_matching_tag().rpartition("-")[2]
        build_data |= {"pure_python": False, "tag": f"cp311-abi3-{system}"}

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove what is in the wheel by now."""
        if version != "editable":
            self.folder.cleanup()
