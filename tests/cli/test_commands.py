"""The command line as a user meets it: outputs, exit statuses, one line for a mistake."""

from __future__ import annotations

import io
import json
import logging
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import numpy as np
import pyogrio
import pytest
import shapely
import typer
from tests.conftest import write_laz

from eaves.cli import app as cli
from eaves.cli.runs import read_settings
from eaves.formats import read_cityjson, read_raster

FORMATS = "cityjson,citygml,obj,dxf,geojson,fgb,kml,copc"

OUTPUTS = {
    *("footprints.gpkg", "review.csv", "buildings.city.jsonl", "buildings.qgz", "classified.laz"),
    *("mask.tif", "ndsm.tif", "dtm.tif", "dsm.tif", "report.html", "run.json"),
}


def started(*words: str | Path) -> subprocess.CompletedProcess[str]:
    """A command in a process of its own, as a shell starts it."""
    return subprocess.run(
        [sys.executable, "-m", "eaves.cli.app", *map(str, words)], capture_output=True, text=True, timeout=300
    )


def eaves(*words: str | Path) -> subprocess.CompletedProcess[str]:
    """A command in this process, which has everything imported."""
    told, said, arguments = io.StringIO(), io.StringIO(), sys.argv
    log = logging.getLogger("eaves")
    handlers, level = list(log.handlers), log.level
    sys.argv = ["eaves", *map(str, words)]
    try:
        with redirect_stdout(told), redirect_stderr(said), pytest.raises(SystemExit) as end:
            cli.main()
    finally:
        sys.argv, log.handlers[:] = arguments, handlers
        log.setLevel(level)
    return subprocess.CompletedProcess(words, int(end.value.code or 0), told.getvalue(), said.getvalue())


def one_line(done: subprocess.CompletedProcess[str]) -> str:
    """The one line a mistake gets; fails on anything longer."""
    lines = [line for line in done.stderr.splitlines() if not line.startswith(("WARNING", "INFO"))]
    assert len(lines) == 1, done.stderr
    return lines[0]


@pytest.fixture(scope="module")
def built(nine_roofs_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("out")
    done = started("build", nine_roofs_file, "-o", out, "--jobs", "1")
    assert done.returncode == 0, done.stderr
    return out


@pytest.fixture(scope="module")
def again(nine_roofs_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same by two processes, with further formats."""
    out = tmp_path_factory.mktemp("again")
    done = started("build", nine_roofs_file, "-o", out, "--jobs", "2", "--formats", FORMATS)
    assert done.returncode == 0, done.stderr
    return out


def test_build_writes_every_output_and_nothing_else(built: Path) -> None:
    assert {path.name for path in built.iterdir()} == OUTPUTS


def test_heights_over_the_terrain_are_those_of_both_rasters(built: Path) -> None:
    over, surface, terrain = (read_raster(built / f"{name}.tif")[0] for name in ("ndsm", "dsm", "dtm"))
    np.testing.assert_allclose(over.values, surface.values - terrain.values, atol=1e-4)


def test_found_is_modelled_plus_failed(built: Path) -> None:
    run = json.loads((built / "run.json").read_text())
    assert run["found"] == run["modelled"] + run["failed"] == 9
    assert sum(run["by_lod"].values()) == run["modelled"]


def test_the_written_models_are_valid(built: Path) -> None:
    foreign = built / ".eaves-work"
    foreign.mkdir()
    (foreign / "buildings.city.jsonl").write_text("no model of the run")
    missing = eaves("validate", built / "none")
    assert missing.returncode == 2 and "does not exist" in missing.stderr
    done = eaves("validate", built)
    shutil.rmtree(foreign)
    assert done.returncode == 0 and "valid, whole" in done.stdout, done.stdout


def test_help_imports_nothing_that_computes() -> None:
    heavy = "numpy", "pydantic", "scipy", "shapely"
    script = (
        "import sys; from eaves.cli.app import main; sys.argv = ['eaves', '--help']\n"
        "try: main()\n"
        f"except SystemExit: print([name for name in {heavy} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.stdout.splitlines()[-1] == "[]", done.stdout + done.stderr


@pytest.mark.parametrize(
    ("module", "heavy"),
    [
        ("eaves.flow.advice", ("scipy.ndimage", "scipy.spatial", "rasterio", "pyogrio")),
        ("eaves.exports.run", ("scipy", "rasterio", "laspy", "pyogrio")),
    ],
)
def test_a_scan_is_described_and_models_exported_without_what_only_runs_need(
    module: str, heavy: tuple[str, ...]
) -> None:
    script = f"import sys, {module}; print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.stdout.splitlines()[-1] == "[]", done.stdout + done.stderr


def test_methods_are_listed_with_their_papers() -> None:
    done = eaves("methods", "ground")
    assert "adaptive_tin (default)" in done.stdout
    assert "axelsson2000" in done.stdout


@pytest.mark.parametrize(
    ("name", "content", "word"),
    [
        ("empty.laz", b"", "empty"),
        ("cut.laz", b"LASF" + b"\0" * 100, "cut.laz"),
        ("not.laz", b"this is no point cloud, however long it may be " * 20, "not.laz"),
        ("words.txt", b"one two three\nfour five six\n", "words.txt"),
    ],
)
def test_a_bad_file_gets_one_line_and_status_2(tmp_path: Path, name: str, content: bytes, word: str) -> None:
    (tmp_path / name).write_bytes(content)
    done = eaves("build", tmp_path / name, "-o", tmp_path / "out")
    assert done.returncode == 2
    assert word in one_line(done)
    assert not (tmp_path / "out" / "run.json").exists()


@pytest.mark.parametrize(
    "words",
    [
        ["build", "no-such-file.laz", "-o", "OUT"],
        ["build", "FILE", "-o", "OUT", "--detect-method", "magic"],
        ["build", "FILE", "-o", "OUT", "--config", "no-such.toml"],
        ["build", "FILE", "-o", "OUT", "--set", "detect.height=2"],
        ["build", "FILE", "-o", "OUT", "--bounds", "1,2,3"],
        ["build", "FILE", "-o", "OUT", "--bounds", "nan,0,1,1"],
        ["build", "FILE", "-o", "OUT", "--bounds", "0,0,inf,1"],
        ["build", "FILE", "-o", "OUT", "--memory", "1M"],
        ["build", "FILE", "-o", "OUT", "--crs", "EPSG:4326"],
        ["build", "FILE", "-o", "OUT", "--crs", "EPSG:999999"],
        ["build", "FILE", "-o", "OUT", "--lod", "9"],
        ["build", "FILE", "-o", "OUT", "--footprints", "no-such.gpkg"],
        ["build", "FILE", "-o", "BELOW"],
        ["build", "FILE", "-o", "OUT", "--jobs", "-3"],
        ["build", "FILE"],
    ],
    ids=lambda words: " ".join(words[-2:]),
)
def test_misuse_gets_one_line_and_status_2(words: list[str], nine_roofs_file: Path, tmp_path: Path) -> None:
    places = {"FILE": nine_roofs_file, "OUT": tmp_path / "out", "BELOW": nine_roofs_file / "below-a-file"}
    done = eaves(*[places.get(word, word) for word in words])
    assert done.returncode == 2, done.stdout + done.stderr
    assert one_line(done).startswith("error: ")


def test_a_process_leaves_with_the_status_and_the_line() -> None:
    done = started("methods", "cooking")
    assert done.returncode == 2
    assert one_line(done).startswith("error: ")


def test_a_parameter_set_on_the_command_line_is_a_table_by_stage() -> None:
    words = ["detect.min_height=2.5", "detect.method=contours", "units.method=off"]
    houses = ["reconstruct.houses.ground_plan=false", "reconstruct.houses.tolerance=0.4"]
    assert read_settings(houses) == {"reconstruct": {"houses": {"ground_plan": False, "tolerance": 0.4}}}
    assert read_settings(words) == {
        "detect": {"min_height": 2.5, "method": "contours"},
        "units": {"method": "off"},
    }
    for wrong in ("detect.min_height", "min_height=2", "cooking.heat=3"):
        with pytest.raises(ValueError, match=r"write STAGE\.PARAMETER=VALUE"):
            read_settings([wrong])


def test_the_help_of_build_has_few_options_before_those_of_experts() -> None:
    text = eaves("build", "--help").stdout
    before, expert = text.split("\nExpert:\n")
    for heading in ("Input:", "Methods:", "Output:", "Run:"):
        assert heading in before
    assert len(re.findall(r"^  (?:-\w, )?--", before, re.MULTILINE)) <= 15
    assert "--set" in before and "--classes" in expert
    assert "\n    eaves build tile.laz -o out\n" in before  # an example a line


def test_an_unknown_parameter_is_named(nine_roofs_file: Path, tmp_path: Path) -> None:
    (tmp_path / "c.toml").write_text("[ground]\nseed_sell = 3\n")
    done = eaves("build", nine_roofs_file, "-o", tmp_path / "out", "--config", tmp_path / "c.toml")
    assert done.returncode == 2
    assert "seed_sell" in one_line(done)


@pytest.mark.parametrize(
    ("words", "status", "xyz"),
    [
        ((), 1, np.array([[85000.0, 447000.0, 1.0]])),
        (("--bounds", "0,0,9,9", "--allow-empty"), 0, np.array([[85000.0, 447000.0, 1.0]])),
        ((), 0, np.random.default_rng(0).random((4000, 3)) * [40, 40, 0.02] + [85000, 447000, 1]),
    ],
)
def test_points_without_buildings_give_valid_empty_outputs__and_a_reason_where_none_is_used(
    words: tuple[str, ...], status: int, xyz: np.ndarray, tmp_path: Path
) -> None:
    write_laz(tmp_path / "points.laz", xyz)
    done = eaves("build", tmp_path / "points.laz", "-o", tmp_path / "out", "--jobs", "1", *words)
    assert done.returncode == status, done.stderr
    assert ("empty: none of 1 points is used" in done.stderr) == bool(status)
    there = {path.name for path in (tmp_path / "out").iterdir()}
    assert there == OUTPUTS - ({"classified.laz"} if "--bounds" in words else set())
    assert json.loads((tmp_path / "out" / "run.json").read_text())["found"] == 0
    assert eaves("validate", tmp_path / "out" / "buildings.city.jsonl").returncode == 0


def test_points_that_none_can_use_are_refused(tmp_path: Path) -> None:
    write_laz(tmp_path / "points.laz", np.zeros((50, 3)))
    done = eaves("build", tmp_path / "points.laz", "-o", tmp_path / "out", "--jobs", "1", "-q")
    assert done.returncode == 2
    assert "none of 50 points can be used" in one_line(done)


def test_ground_writes_one_file(nine_roofs_file: Path, tmp_path: Path) -> None:
    import laspy

    done = eaves("ground", nine_roofs_file, "-o", tmp_path / "ground.laz")
    assert done.returncode == 0, done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["ground.laz"]
    before, after = laspy.read(nine_roofs_file), laspy.read(tmp_path / "ground.laz")
    assert np.array_equal(before.X, after.X)
    assert set(np.unique(after.classification)) <= {1, 2, 7, 18}
    assert (np.asarray(after.classification) == 2).mean() > 0.3


@pytest.mark.slow
def test_a_corrupt_file_among_good_ones_leaves_the_rest(nine_roofs_file: Path, tmp_path: Path) -> None:
    tiles = tmp_path / "tiles"
    tiles.mkdir()
    whole = nine_roofs_file.read_bytes()
    (tiles / "good.laz").write_bytes(whole)
    (tiles / "cut.laz").write_bytes(whole[: len(whole) // 2])
    done = eaves("build", tiles, "-o", tmp_path / "out", "--jobs", "1")
    assert done.returncode == 1
    assert "incomplete" in done.stderr and "cut.laz" in done.stderr
    run = json.loads((tmp_path / "out" / "run.json").read_text())
    assert run["found"] == 9
    assert run["points"] < 1.99 * eaves_points(nine_roofs_file)  # what was not read is not counted


def eaves_points(path: Path) -> int:
    from eaves.formats import open_source

    return open_source(path).count


@pytest.mark.slow
def test_formats_of_a_finished_run_are_those_of_a_build_with_them(
    built: Path, again: Path, tmp_path: Path
) -> None:
    later = tmp_path / "later"
    shutil.copytree(built, later)
    done = eaves("export", later, "--formats", FORMATS)
    assert done.returncode == 0, done.stderr
    assert {path.name for path in again.iterdir()} == {path.name for path in later.iterdir()}
    assert eaves("validate", later).returncode == 0  # the manifest knows them
    for name in ("footprints.geojson", "classified.copc.laz"):
        assert (later / name).read_bytes() == (again / name).read_bytes()
    first, second = (read_cityjson(folder / "buildings.city.json") for folder in (later, again))
    assert first.keys() == second.keys()
    for name, one in first.items():
        other = second[name]
        assert one.attributes == other.attributes
        for a, b in zip(one.geometries, other.geometries, strict=True):
            assert (a.lod, a.type) == (b.lod, b.type)
            for solid, twin in zip(one.as_solids(a), other.as_solids(b), strict=True):
                np.testing.assert_allclose(solid.vertices, twin.vertices, atol=1e-6)
                assert [face.rings for face in solid.faces] == [face.rings for face in twin.faces]
    assert eaves("export", later, "--contours", "0.5").returncode == 0
    lines = pyogrio.read_dataframe(later / "contours.gpkg", layer="contours")
    terrain, _ = read_raster(later / "dtm.tif")
    for height, line in zip(lines.height_m, lines.geometry, strict=True):
        row, column = terrain.cell_of(shapely.get_coordinates(line))
        assert np.abs(np.median(terrain.values[row, column]) - height) < 0.1
    assert set(np.diff(np.unique(lines.height_m)).round(3)) == {0.5}
    assert "unknown format" in one_line(eaves("export", later, "--formats", "nothing"))
    assert "need a --picture" in one_line(eaves("export", later, "--formats", "obj", "-o", "elsewhere"))
    shutil.rmtree(later)
    assert "the folder of a run" in one_line(eaves("export", later, "--formats", "obj"))


@pytest.mark.slow
def test_a_second_run_gives_the_same_bytes(built: Path, again: Path) -> None:
    for name in ("buildings.city.jsonl", "mask.tif", "dtm.tif", "classified.laz"):
        assert (built / name).read_bytes() == (again / name).read_bytes(), name


@pytest.mark.slow
def test_a_town_has_the_style_and_the_clutter_asked_for(tmp_path: Path) -> None:
    asked = ("--area", "0.01", "--density", "1", "--seed", "3")
    for name, more in (("centre", ("--style", "centre")), ("bare", ("--style", "centre", "--no-clutter"))):
        done = eaves("simulate", "-o", tmp_path / name, *asked, *more)
        assert done.returncode == 0, done.stderr
        told = json.loads((tmp_path / name / "simulation.json").read_text())
        assert (told["style"], told["clutter"]) == ("centre", name == "centre")
    points = [(tmp_path / name / "points.laz").read_bytes() for name in ("centre", "bare")]
    assert points[0] != points[1]
    done = eaves("simulate", "-o", tmp_path / "no", "--style", "hamlet")
    assert done.returncode == 2
    assert "--style hamlet" in one_line(done) and "suburb" in done.stderr


def test_models_are_judged_over_given_footprints_at_a_given_level(built: Path, nine_roofs_file: Path) -> None:
    words = ("models", built / "buildings.city.jsonl", built / "classified.laz")
    done = eaves("evaluate", *words, "--footprints", built / "footprints.gpkg", "--lod", "1.2")
    assert done.returncode == 0, done.stderr
    finest = eaves("evaluate", *words)
    assert done.stdout != finest.stdout and "LoD 1.2" in done.stdout
    done = eaves("evaluate", "ground", built / "classified.laz", nine_roofs_file, "--lod", "1.2")
    assert done.returncode == 2 and "lod is for models only" in one_line(done)


def swallow_interrupt() -> None:
    """A library that makes an error of its own of an interrupt."""
    try:
        signal.raise_signal(signal.SIGINT)
    except KeyboardInterrupt:
        raise RuntimeError("failed to call write") from None


def end_too_early() -> None:
    """A file's end, of which the command line's library makes an abort."""
    try:
        raise EOFError("No data left in file")
    except EOFError as error:
        raise typer.Abort from error


def fill_memory() -> None:
    raise MemoryError("Unable to allocate 8 TB")


@pytest.mark.parametrize(
    ("ends", "status", "line"),
    [
        (swallow_interrupt, 130, r"interrupted:"),
        (lambda: signal.raise_signal(signal.SIGTERM), 143, r"terminated:"),
        (end_too_early, 1, r".*No data left in file"),
        (fill_memory, 1, r".*memory ran out \(Unable to allocate 8 TB\)"),
    ],
)
def test_what_ends_a_command_is_named_with_its_status(
    ends: Callable[[], None], status: int, line: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cli, "make_app", lambda _: lambda **_: ends())
    done = eaves("build")
    assert done.returncode == status and re.match(line, done.stderr)


def test_only_the_outputs_asked_for_are_written_and_the_time_is_shown(
    nine_roofs_file: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    done = eaves("build", nine_roofs_file, "-o", out, "-q", "--outputs", "footprints,rasters", "--profile")
    assert done.returncode == 0
    there = {path.name for path in out.iterdir()}
    unwanted = {"buildings.city.jsonl", "mask.tif", "classified.laz", "report.html"}
    assert there == OUTPUTS - unwanted
    assert "write rasters" in done.stderr and "write models" not in done.stderr
    kept = json.loads((out / "run.json").read_text("utf-8"))
    assert set(kept["step_wall_seconds"]) == {"points", "regions", "buildings", "write"}


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["--outputs", "models,paper"], "paper: unknown output"),
        (["--outputs", "report"], "add footprints"),
        (["--outputs", "footprints", "--formats", "obj"], "add models"),
    ],
)
def test_outputs_that_cannot_be_are_refused(
    words: list[str], reason: str, nine_roofs_file: Path, tmp_path: Path
) -> None:
    done = eaves("build", nine_roofs_file, "-o", tmp_path / "out", *words)
    assert done.returncode == 2
    assert reason in one_line(done)
    assert not (tmp_path / "out").exists()
