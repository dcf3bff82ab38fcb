"""The QGIS plug-in: forms up to date, the command runs and stops, QGIS without a screen runs the tools."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import threading
import time
import zipfile
from configparser import ConfigParser
from importlib import util
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from tests.judges import need_judge

from eaves.flow.step import STEPS

ROOT = Path(__file__).parents[2]
QGIS = "qgis_process.bin"


def load(path: Path) -> ModuleType:
    """A module of the plug-in, which is no package of ours."""
    spec = util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    module = util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


commands = load(ROOT / "qgis" / "eaves" / "commands.py")
package = load(ROOT / "qgis" / "package.py")


class Feedback:
    """What QGIS hands to a tool."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.done = 0.0
        self.cancelled = False

    def isCanceled(self) -> bool:
        return self.cancelled

    def setProgress(self, done: float) -> None:
        self.done = done

    def pushConsoleInfo(self, line: str) -> None:
        self.lines.append(line)

    pushCommandInfo = pushWarning = pushConsoleInfo


def program(folder: Path, text: str) -> list[str]:
    (folder / "program.py").write_text(text)
    return [sys.executable, str(folder / "program.py")]


def test_forms_are_those_of_the_commands_and_the_registry() -> None:
    text = (ROOT / "qgis" / "eaves" / "forms.json").read_text("utf-8")
    assert text == package.as_text(package.make_forms()), "run: python -m qgis.package"


def test_zip_holds_one_folder_and_is_the_same_every_time(tmp_path: Path) -> None:
    first = package.write_plugin(tmp_path).read_bytes()
    assert package.write_plugin(tmp_path).read_bytes() == first
    names = zipfile.ZipFile(package.write_plugin(tmp_path)).namelist()
    assert {name.split("/")[0] for name in names} == {"eaves"}
    assert {"eaves/metadata.txt", "eaves/__init__.py", "eaves/forms.json", "eaves/LICENSE"} <= set(names)


def test_metadata_has_all_that_the_plugin_site_asks_for(tmp_path: Path) -> None:
    path = package.write_plugin(tmp_path, "https://example.org/eaves", "eaves@example.org")
    parser = ConfigParser()
    parser.read_string(zipfile.ZipFile(path).read("eaves/metadata.txt").decode())
    facts = parser["general"]
    asked = ("name", "description", "version", "qgisMinimumVersion", "author", "email", "about")
    assert all(facts[name] for name in asked) and path.stem == f"eaves-qgis-{facts['version']}"
    assert facts["tracker"] == "https://example.org/eaves/issues"
    assert facts["repository"] == facts["homepage"] == "https://example.org/eaves"


@pytest.mark.parametrize(
    ("line", "expected"),
    [("points: 5 of 10, about 2 min left", 6.0), ("regions: 1,000 of 2,000", 41.5), ("write: 5 of 5", 100.0),
     ("LoD 2.2: 2 of 3", None), ("WARNING: blocks", None)],
)  # fmt: skip
def test_progress_is_read_from_lines(line: str, expected: float | None) -> None:
    assert commands.percentage(line) == expected


def test_every_step_that_a_run_shows_moves_the_progress() -> None:
    assert {step.name for step in STEPS if step.shown} <= commands.SHARES.keys()


def test_missing_command_says_how_to_install(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("EAVES_COMMAND", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(commands, "PLACES", ())
    with pytest.raises(commands.CommandError, match="pipx install eaves"):
        commands.find_command()
    with pytest.raises(commands.CommandError, match="no such command"):
        commands.find_command("/nowhere/eaves")


def test_error_of_the_command_is_the_error_of_the_tool(tmp_path: Path) -> None:
    words = program(tmp_path, "import sys; print('error: no points'); sys.exit(2)")
    with pytest.raises(commands.CommandError, match=r"^no points$"):
        commands.run_command(words, Feedback())


def test_cancel_stops_the_command_as_ctrl_c_does(tmp_path: Path) -> None:
    script = (
        "import signal, sys, time\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "try:\n    print('regions: 1 of 2', flush=True)\n    time.sleep(60)\n"
        "except KeyboardInterrupt:\n    print('clean', flush=True); sys.exit(130)\n"
    )
    feedback = Feedback()

    def cancel_once_it_runs() -> None:
        while feedback.done == 0.0:
            time.sleep(0.05)
        feedback.cancelled = True

    threading.Thread(target=cancel_once_it_runs, daemon=True).start()
    start = time.monotonic()
    assert commands.run_command(program(tmp_path, script), feedback) is False
    assert time.monotonic() - start < 50 and "clean" in feedback.lines and feedback.done == 41.5


@pytest.fixture(scope="module")
def qgis_process(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Runs a tool of the packaged plug-in in QGIS, and gives its results."""
    need_judge("QGIS", shutil.which(QGIS))
    folder = tmp_path_factory.mktemp("qgis")
    plugins = folder / "profiles" / "default" / "python" / "plugins"
    plugins.mkdir(parents=True)
    with zipfile.ZipFile(package.write_plugin(folder)) as archive:
        archive.extractall(plugins)
    command = folder / "eaves"
    command.write_text(f'#!/bin/sh\nPYTHONPATH={ROOT / "src"} exec {sys.executable} -m eaves "$@"\n')
    command.chmod(0o755)
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    # QGIS takes the Python that is found first: that of the system, not of this environment
    environment |= {"QT_QPA_PLATFORM": "offscreen", "XDG_RUNTIME_DIR": str(folder), "PATH": os.defpath}
    environment |= {"QGIS_CUSTOM_CONFIG_PATH": str(folder), "EAVES_COMMAND": str(command)}

    def run(*words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run([QGIS, *words], env=environment, capture_output=True, text=True, timeout=300)

    run("plugins", "enable", "eaves")
    return run


@pytest.mark.slow
def test_qgis_builds_and_hands_layers_on(qgis_process: Any, nine_roofs_file: Path, tmp_path: Path) -> None:
    from eaves.formats import read_polygons

    done = qgis_process(
        "run", "--json", "eaves:build", "--", f"INPUT={nine_roofs_file}", f"OUTPUT={tmp_path / 'out'}",
        f"FOOTPRINTS={tmp_path / 'kept.gpkg'}", "ROOF_PLANES=TEMPORARY_OUTPUT", "jobs=1",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    results = json.loads(done.stdout[done.stdout.index("{") :])["results"]
    assert Path(results["DTM"]).exists() and Path(results["PROJECT"]).name == "buildings.qgz"
    kept, _, rows, _ = read_polygons(tmp_path / "kept.gpkg")
    whole, _, expected, _ = read_polygons(tmp_path / "out" / "footprints.gpkg")
    assert len(kept) == len(whole) == 9
    assert [row["id"] for row in rows] == [row["id"] for row in expected]


@pytest.mark.slow
def test_parameters_of_a_method_reach_the_run(
    qgis_process: Any, nine_roofs_file: Path, tmp_path: Path
) -> None:
    done = qgis_process(
        "run", "eaves:ground_adaptive_tin", "--", f"INPUT={nine_roofs_file}", f"OUTPUT={tmp_path / 'out'}",
        "parameter_angle=9", "jobs=1",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    method = json.loads((tmp_path / "out" / "run.json").read_text())["methods"]["ground"]
    assert method["method"] == "adaptive_tin" and method["angle"] == 9.0


@pytest.mark.slow
def test_wrong_input_is_one_line_in_qgis(qgis_process: Any, tmp_path: Path) -> None:
    done = qgis_process(
        "run", "eaves:build", "--", f"INPUT={tmp_path / 'no.laz'}", f"OUTPUT={tmp_path / 'o'}"
    )
    assert done.returncode != 0 and "no.laz" in done.stderr + done.stdout


@pytest.mark.slow
def test_tools_on_results_take_the_folder_of_a_run(
    qgis_process: Any, nine_roofs_file: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    build = qgis_process("run", "eaves:build", "--", f"INPUT={nine_roofs_file}", f"OUTPUT={out}", "jobs=1")
    assert build.returncode == 0, build.stderr
    words = {
        "validate": [f"file={out}"],
        "export": [f"folder={out}", "contours=0.5", "formats=glb"],
        "solar": [f"folder={out}"],
        "compare": [f"old={out}", f"new={tmp_path / 'later'}", f"OUTPUT={tmp_path / 'change'}"],
    }
    shutil.copytree(out, tmp_path / "later")
    for name, given in words.items():
        done = qgis_process("run", f"eaves:{name}", "--", *given)
        assert done.returncode == 0, done.stderr
    made = [
        out / "contours.gpkg",
        out / "buildings.glb",
        out / "solar.gpkg",
        tmp_path / "change" / "changes.gpkg",
    ]
    assert all(path.exists() for path in made)
    broken = qgis_process("run", "eaves:validate", "--", f"file={tmp_path / 'nothing'}")
    assert broken.returncode != 0
