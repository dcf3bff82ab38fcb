"""The scripts in the package are those of the modules in page/src."""

from __future__ import annotations

import hashlib
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCES, PACKAGE = ROOT / "page" / "src", ROOT / "src" / "eaves"
BUNDLES = ("report/page/page.js", "report/page/beside.js", "edit/page/edit.js")


def test_the_first_line_of_a_bundle_names_the_sources_it_is_of() -> None:
    digest = hashlib.sha256()
    for name in sorted(path.relative_to(SOURCES).as_posix() for path in SOURCES.rglob("*.js")):
        digest.update((SOURCES / name).read_text("utf-8").encode())
    for name in BUNDLES:
        first = (PACKAGE / name).read_text("utf-8").partition("\n")[0]
        assert first.endswith(digest.hexdigest()[:16]), f"{name} is of other sources: run make page"


@pytest.mark.skipif(
    not (shutil.which("node") and (ROOT / "page" / "node_modules").exists()),
    reason="node or page/node_modules is missing",
)
def test_the_sources_make_the_same_bundle(tmp_path: Path) -> None:
    subprocess.run(["node", ROOT / "page" / "build.js", tmp_path], check=True)
    for name in BUNDLES:
        assert (tmp_path / name).read_bytes() == (PACKAGE / name).read_bytes()
