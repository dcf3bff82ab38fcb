"""What is published: recipe and site agree with the sources; wheel and sources install and run."""

from __future__ import annotations

import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
CONDA_NAMES = {"lazrs-python": "lazrs"}


def requirements() -> dict[str, str]:
    """Name → least version of what eaves needs."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    found = {"python": project["requires-python"].removeprefix(">=")}
    for line in project["dependencies"]:
        name, extra, least = re.fullmatch(r"([\w-]+)(?:\[(\w+)\])?>=([\d.]+)", line).groups()  # type: ignore[union-attr]
        found |= {name: least} | ({extra: ""} if extra else {})
    return found


def test_conda_recipe_asks_for_what_pip_asks_for() -> None:
    recipe = (ROOT / "packaging" / "conda" / "meta.yaml").read_text("utf-8")
    run = recipe.split("  run:\n")[1].split("\ntest:")[0]
    found = {}
    for name, least in re.findall(r"- ([\w-]+)(?: >=([\d.]+))?", run):
        found[CONDA_NAMES.get(name, name)] = least
    assert found == requirements()


def test_every_page_is_on_the_site() -> None:
    listed = set(re.findall(r"[\w/-]+\.md", (ROOT / "mkdocs.yml").read_text("utf-8")))
    pages = {path.relative_to(ROOT / "docs").as_posix() for path in (ROOT / "docs").rglob("*.md")}
    tutorials = {f"tutorials/{path.stem}.md" for path in (ROOT / "docs" / "tutorials").glob("*.ipynb")}
    assert listed == pages | tutorials


def test_lowest_versions_are_the_bounds_of_all_requirements__of_several_the_strictest() -> None:
    script = ROOT / "packaging" / "lowest.py"
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=True)
    lines = done.stdout.splitlines()
    asked = {(name, least) for name, least in requirements().items() if least and name != "python"}
    assert {f"{name}=={least}" for name, least in asked} <= set(lines) and len(lines) == len(set(lines))
    assert "trimesh==4.4" in lines  # of two extras that name it


def test_workflows_pin_their_actions_end_in_time_and_may_not_write() -> None:
    for path in (ROOT / ".github" / "workflows").glob("*.yml"):
        text = path.read_text("utf-8")
        assert not re.search(r"run: [^'\"|\n]*: ", text), f"{path.name}: a command with a colon wants quotes"
        used = re.findall(r"uses: (\S+)", text)
        assert used and all(re.fullmatch(r"[\w/-]+@[0-9a-f]{40}", action) for action in used), path.name
        assert text.count("timeout-minutes:") == text.count("runs-on:"), path.name
        assert "\npermissions:\n  contents: read\n" in text, path.name


def test_the_core_needs_no_plotting_library() -> None:
    script = (
        "import sys, importlib.abc\n"
        "class Missing(importlib.abc.MetaPathFinder):\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name.split('.')[0] in ('matplotlib', 'PIL', 'distributed', 'pandas'):\n"
        "            raise ImportError(name)\n"
        "sys.meta_path.insert(0, Missing())\n"
        "import eaves.pipeline, eaves.report.output, eaves.cli.app, eaves.exports.obj\n"
        "import eaves.flow.results\n"
        "eaves.build, eaves.read\n"
        "assert 'scipy.stats' not in sys.modules, 'half a second of every start, for one distribution'\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_wheel_and_source_install_in_a_clean_environment(tmp_path: Path) -> None:
    """Needs the package index; a tag on what is committed is the version."""
    clone = tmp_path / "clone"
    subprocess.run(["git", "clone", "--quiet", "--depth", "1", ROOT.as_uri(), clone], check=True)
    subprocess.run(["git", "-C", clone, "tag", "v9.8.7"], check=True)
    subprocess.run([sys.executable, "-m", "venv", tmp_path / "maker"], check=True)
    pip = [tmp_path / "maker" / "bin" / "python", "-m", "pip", "--quiet"]
    subprocess.run([*pip, "install", "build", "hatchling", "hatch-vcs"], check=True)
    command = [tmp_path / "maker" / "bin" / "python", "-m", "build", "--no-isolation", clone]
    subprocess.run(command, check=True, capture_output=True)
    wheel, source = clone / "dist" / "eaves-9.8.7-py3-none-any.whl", clone / "dist" / "eaves-9.8.7.tar.gz"
    names = zipfile.ZipFile(wheel).namelist()
    assert any(name.endswith("page/page.html") for name in names) and "eaves/__init__.pyi" in names
    assert not any(name.endswith((".nbi", ".nbc", ".pyc")) for name in names)
    with tarfile.open(source) as archive:
        assert any(name.endswith("qgis/eaves/forms.json") for name in archive.getnames())
    assert source.stat().st_size < 20e6
    subprocess.run([sys.executable, "-m", "venv", tmp_path / "clean"], check=True)
    subprocess.run([tmp_path / "clean" / "bin" / "pip", "--quiet", "install", wheel], check=True)
    done = subprocess.run([tmp_path / "clean" / "bin" / "eaves", "doctor"], capture_output=True, text=True)
    assert done.returncode == 0 and "9 of 9 buildings found" in done.stdout, done.stdout + done.stderr
    for folder in (tmp_path / "clean").rglob("site-packages"):
        size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
        assert size < 760e6
