"""A method of another package: named, imported, held to contract and laws; its source is in the keys."""

from __future__ import annotations

import doctest
import importlib
import json
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator
from functools import partialmethod
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar

import jinja2
import numpy as np
import pytest
import shapely
from tests.cli.test_commands import eaves as run
from tests.conftest import build_files, but_first
from tests.test_documentation import DOCS
from tests.test_guides import write_methods

import eaves
from eaves.detect import Detector
from eaves.flow.corrected import EDITED
from eaves.flow.run import open_run
from eaves.flow.step import STEPS
from eaves.formats import InputError
from eaves.ground import GroundMethod
from eaves.methods import ContractError, ignore, installed_methods, method_class, parameter
from eaves.model import Boundary, PointCloud, Regions
from eaves.roof import RoofMethod
from eaves.simulate import nine_roofs_on_a_slope
from eaves.testing import check_method
from eaves.units.stage import Division
from eaves.upkeep.update import open_again

STAGES = {
    "ground": "LowestInCell",
    "detect": "HighAndDense",
    "outline": "Boxes",
    "units": "Halves",
    "roof": "OnePlane",
    "reconstruct": "MedianPrism",
}
PAGE = DOCS / "guides" / "own_method.md"


@pytest.fixture
def page_methods(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """The file of the page, in a folder of its own from which it is imported."""
    write_methods(tmp_path / "my_methods.py")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    yield importlib.import_module("my_methods")
    del sys.modules["my_methods"]


@pytest.mark.parametrize(("stage", "name"), [*STAGES.items(), ("detect", "NotGreen")])
def test_each_method_of_the_page_holds_the_laws(stage: str, name: str, page_methods: ModuleType) -> None:
    assert method_class(stage, f"my_methods:{name}").stage == stage
    check_method(getattr(page_methods, name))


def test_the_methods_of_the_page_find_and_model_the_nine_roofs(
    page_methods: ModuleType, nine_roofs_file: Path, tmp_path: Path
) -> None:
    names = {stage: f"my_methods:{name}" for stage, name in STAGES.items()}
    summary = build_files(nine_roofs_file, tmp_path / "out", outputs=("models",), jobs=2, **names)  # type: ignore[arg-type]
    assert (summary.found, summary.modelled, summary.by_lod) == (9, 9, {"1.2": 9})
    assert summary.run["methods"]["roof"]["method"] == "my_methods:OnePlane"


def test_the_examples_of_the_page_run(page_methods: ModuleType, one_roof_file: Path) -> None:
    shutil.copy(one_roof_file, "tile.laz")
    found = doctest.testfile(str(PAGE), module_relative=False)
    assert found.attempted >= 6 and found.failed == 0


@pytest.mark.slow
def test_the_command_imports_a_method_from_its_folder_in_two_processes(
    nine_roofs_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_methods(tmp_path / "my_methods.py")
    monkeypatch.chdir(tmp_path)
    words = ("--detect-method", "my_methods:HighAndDense", "--lod", "0", "--jobs", "2")
    done = run("build", nine_roofs_file, "-o", "out", *words)
    assert done.returncode == 0, done.stderr
    assert "9 buildings found" in done.stdout
    assert "the method my_methods:HighAndDense is imported" in done.stderr


class High(Detector):
    """Points high above the terrain, all one region."""

    name: ClassVar[str] = "high"

    def label(self, scene: Any, emit: Any = ignore) -> Any:
        return Regions((scene.height > 2.0).astype(np.int32))


class Nameless(High):
    name: ClassVar[Any] = None


class Idle(Detector):
    name: ClassVar[str] = "idle"


class Namesake(High):
    name: ClassVar[str] = "consensus"


NO_METHODS: dict[str, tuple[Any, str]] = {
    "no method": (
        "json:JSONDecoder",
        "detect method JSONDecoder must be a subclass of Detector; see eaves.det",
    ),
    "of another stage": ("eaves.roof:TinFaces", "cannot be imported"),
    "no such module": (
        "no_such:High",
        "'no_such:High' cannot be imported .ModuleNotFoundError: .*write module",
    ),
    "no such class": ("json:High", "cannot be imported .AttributeError"),
    "a method of roofs": (
        "eaves.published.maas_vosselman.tin_faces:TinFaces",
        "detect method TinFaces must be a subclass of Detec",
    ),
    "without a name": (
        Nameless(),
        'detect method Nameless has no name; give its class one: name = "nameless"',
    ),
    "without a function": (Idle(), "detect method Idle does not define label; see eaves.detect:Detector"),
    "with fields no stage gives": (
        type("Seeing", (eaves.Prism,), {"needs": ("nir",), "__annotations__": {"needs": ClassVar[Any]}})(),
        "needs nir, which only ground and detect methods are given",
    ),
    "by the name of ours": (
        Namesake(),
        "detect method Namesake has the name of another, 'consensus'; give it",
    ),
}


@pytest.mark.parametrize("case", NO_METHODS)
def test_what_is_no_method_is_refused_in_one_line(case: str) -> None:
    choice, words = NO_METHODS[case]
    with pytest.raises((ContractError, ValueError), match=words) as refusal:
        eaves.make_recipe({"reconstruct" if case.startswith("with fields") else "detect": choice})
    assert "\n" not in str(refusal.value)


class Returning(High):
    name: ClassVar[str] = "returning"
    returned: ClassVar[Callable[[int], Any]]

    def label(self, scene: Any, emit: Any = ignore) -> Any:
        return type(self).returned(len(scene.cloud))


WRONG: dict[str, tuple[Callable[[int], Any], str]] = {
    "an array": (
        lambda n: np.zeros(n, np.int32),
        r"must return Regions, not an array \(\d+,\) of int32; see",
    ),
    "too few": (
        lambda n: Regions(np.zeros(n - 1, np.int32)),
        r"label is an array \(\d+,\) of int32, not an a",
    ),
    "fractions": (lambda n: Regions(np.zeros(n)), r"of int32, not an array \(\d+,\) of float64"),
    "a short part": (lambda n: Regions(np.ones(n, np.int32), part=np.zeros(3, np.uint8)), "part is an array"),
    "a short score": (lambda n: Regions(np.full(n, 3, np.int32), np.ones(2)), "score of each of 3 regions"),
    "nothing": (lambda n: None, "must return Regions, not None"),
    "an exception": (lambda n: 1 / 0, r"ZeroDivisionError: division by zero \(detect method 'returning'\)"),
}


@pytest.mark.parametrize("case", but_first(WRONG, 2))
def test_a_broken_detector_ends_a_run_as_incomplete_with_method_and_block(
    case: str, one_roof_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    returned, words = WRONG[case]
    monkeypatch.setattr(Returning, "returned", staticmethod(returned), raising=False)
    with pytest.raises(eaves.IncompleteRunError, match=words) as raised:
        build_files(one_roof_file, tmp_path / "out", detect=Returning(), outputs=("mask",))
    assert raised.value.failed[0].startswith("regions of ")
    assert "detect method 'returning'" in raised.value.failed[0]


def given_back(method: Any, given: Any, *words: Any) -> Any:
    return given


def of_stage(contract: type[Any], **answers: Any) -> Any:
    """A method whose functions return what is given."""
    functions = {name: partialmethod(given_back, given) for name, given in answers.items()}
    members = {"name": "broken", "__annotations__": {"name": ClassVar[str]}, **functions}
    return type("Broken", (contract,), members)()


POINTS = np.random.default_rng(0).uniform(0.0, 10.0, (50, 3))
BOX = shapely.box(0, 0, 10, 10)
BOUNDARY = Boundary((np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]),), POINTS, 0.5)
OTHERS: dict[str, tuple[Callable[[], Any], str]] = {
    "ground": (
        lambda: eaves.classify_ground(PointCloud(POINTS), of_stage(GroundMethod, ground_mask=np.zeros(3))),
        r"ground method 'broken' must return an array \(50,\) of bool, not an array \(3,\) of float64",
    ),
    "trace": (
        lambda: eaves.trace_outline(POINTS, 0.5, of_stage(eaves.OutlineMethod, trace=BOX, regularise=[])),
        "outline method 'broken' must return a Boundary or a Failure, not a value of type Polygon",
    ),
    "regularise": (
        lambda: eaves.regularise_outlines([BOUNDARY], of_stage(eaves.OutlineMethod, trace=0, regularise=[])),
        "must return a list of 1 Polygons or Failures, one a boundary, not a list of 0 values",
    ),
    "units": (
        lambda: eaves.divide_block(
            POINTS, POINTS[:, 2], BOX, 0.5, of_stage(eaves.UnitMethod, divide=Division((BOX,), ()))
        ),
        "units method 'broken' must return a Division of at least a part, with a certainty of each",
    ),
    "roof": (
        lambda: eaves.segment_roof(POINTS, 0.5, of_stage(RoofMethod, planes=[1.0])),
        "roof method 'broken' must return a list of RoofPlanes, not a list of 1 float",
    ),
    "members": (
        lambda: eaves.segment_roof(
            POINTS, 0.5, of_stage(RoofMethod, planes=[eaves.RoofPlane((0, 0, 0), np.array([50]), 0.0)])
        ),
        "must return planes whose members are numbers of its 50 points",
    ),
    "reconstruct": (
        lambda: eaves.reconstruct_building(
            POINTS, eaves.Footprint(BOX), [], 0.0, of_stage(eaves.Reconstructor, model=[])
        ),
        "reconstruct method 'broken' must return a BuildingModel or a Failure, not a list of 0 values",
    ),
}


@pytest.mark.parametrize("case", OTHERS)
def test_every_stage_says_what_its_contract_allows(case: str) -> None:
    call, words = OTHERS[case]
    with pytest.raises(ContractError, match=words):
        call()


def test_a_broken_roof_ends_a_run_as_incomplete(one_roof_file: Path, tmp_path: Path) -> None:
    with pytest.raises(eaves.IncompleteRunError, match=r"buildings of .* roof method 'broken' must return"):
        build_files(one_roof_file, tmp_path / "out", roof=of_stage(RoofMethod, planes=3), outputs=("models",))


class ByOrder(High):
    name: ClassVar[str] = "by_order"

    def label(self, scene: Any, emit: Any = ignore) -> Any:
        return Regions((np.arange(len(scene.cloud)) % 2).astype(np.int32))


class ByPlace(High):
    name: ClassVar[str] = "by_place"

    def label(self, scene: Any, emit: Any = ignore) -> Any:
        return Regions((scene.height > 2.0 + scene.cloud.origin[0] / 1e5).astype(np.int32))


class Counting(High):
    name: ClassVar[str] = "counting"
    calls: ClassVar[list[int]] = []

    def label(self, scene: Any, emit: Any = ignore) -> Any:
        self.calls.append(1)
        return Regions((scene.height > 2.0 + 4.0 * (len(self.calls) % 2)).astype(np.int32))


class Writing(High):
    name: ClassVar[str] = "writing"

    def label(self, scene: Any, emit: Any = ignore) -> Any:
        scene.height[:] = np.maximum(scene.height, 0.0)
        return super().label(scene)


class Undeclared(High):
    name: ClassVar[str] = "undeclared"
    least: float = 2.0


class Unranged(High):
    name: ClassVar[str] = "unranged"
    least: float = parameter(2.0, "Height of the lowest roof.", unit="m")


class FewFails(High):
    name: ClassVar[str] = "few_fails"

    def label(self, scene: Any, emit: Any = ignore) -> Any:
        assert len(scene.cloud) > 3, "too few"
        return super().label(scene)


class Blind(High):
    name: ClassVar[str] = "blind"

    def label(self, scene: Any, emit: Any = ignore) -> Any:
        return Regions(np.zeros(len(scene.cloud), np.int32))


LAWLESS: dict[type[Detector], str] = {
    ByPlace: "points moved by whole blocks",
    Counting: "the same points give the same again",
    Writing: "it writes to nothing that it is given",
    Undeclared: "parameter 'least' has a sentence and a unit",
    Unranged: "parameter 'least' has a range",
    FewFails: r"points \(one\) raise nothing; they raised AssertionError: too few",
    Blind: "it finds something in the scene",
}


@pytest.mark.parametrize("cls", LAWLESS, ids=lambda cls: cls.name)
def test_a_broken_law_is_named(cls: type[Detector]) -> None:
    with pytest.raises(AssertionError, match=f"detect method '{cls.name}' breaks a law: {LAWLESS[cls]}"):
        check_method(cls)


def test_a_method_that_holds_the_laws_passes() -> None:
    check_method(High, nine_roofs_on_a_slope(density=2.0))


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The package that the template makes, installed in a folder: what pip writes of it."""
    template, made, site = DOCS / "method_template", tmp_path / "made", tmp_path / "site"
    context = {"cookiecutter": json.loads((template / "cookiecutter.json").read_text())}
    for path in template.rglob("*"):
        if path.is_file() and path.suffix != ".json":
            target = made / jinja2.Template(path.relative_to(template).as_posix()).render(context)
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(jinja2.Template(path.read_text(), keep_trailing_newline=True).render(context))
    project = tomllib.loads((made / "my_detector" / "pyproject.toml").read_text())["project"]
    shutil.copytree(made / "my_detector" / "src" / "my_detector", site / "my_detector")
    facts = site / "my_detector-0.1.0.dist-info"
    facts.mkdir()
    (facts / "METADATA").write_text(f"Name: {project['name']}\nVersion: {project['version']}\n")
    (group, points), *_ = project["entry-points"].items()
    lines = [f"{name} = {value}" for name, value in points.items()]
    (facts / "entry_points.txt").write_text("\n".join([f"[{group}]", *lines]))
    monkeypatch.setenv("PYTHONPATH", f"{site}:{Path(eaves.__file__).parents[1]}")
    monkeypatch.syspath_prepend(site)
    importlib.invalidate_caches()
    yield made / "my_detector"
    for name in [name for name in sys.modules if name.startswith("my_detector")]:
        del sys.modules[name]


@pytest.mark.slow
def test_the_template_becomes_a_package_whose_method_is_known_by_name(
    package: Path, nine_roofs_file: Path, tmp_path: Path
) -> None:
    assert installed_methods("detect") == {"high_and_dense": "my_detector:HighAndDense"}
    assert installed_methods("ground") == {}
    listed = run("methods", "detect").stdout
    assert "high_and_dense: Cells with many high points" in listed and "[my_detector:HighAndDense]" in listed
    done = run("build", nine_roofs_file, "-o", tmp_path / "out", "--detect-method", "high_and_dense")
    assert done.returncode == 0 and "9 buildings found" in done.stdout, done.stderr
    tests = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(package / "tests")]
    assert subprocess.run(tests, capture_output=True, cwd=tmp_path).returncode == 0


def test_a_package_that_cannot_be_imported_is_listed_with_the_reason(package: Path, tmp_path: Path) -> None:
    (tmp_path / "site" / "my_detector" / "__init__.py").write_text("import no_such_module\n")
    done = run("methods", "detect")
    assert done.returncode == 0
    assert "high_and_dense: 'my_detector:HighAndDense' cannot be imported (ModuleNotFoundError" in done.stdout
    assert "consensus (default)" in done.stdout


def test_a_command_that_cannot_be_imported_is_listed_with_the_reason(package: Path, tmp_path: Path) -> None:
    with (tmp_path / "site" / "my_detector-0.1.0.dist-info" / "entry_points.txt").open("a") as points:
        points.write("\n[eaves.commands]\nsurvey = no_such_module:survey\n")
    listed, asked = run("--help"), run("survey", tmp_path)
    assert listed.returncode == 0 and "validate" in listed.stdout
    assert "survey" in listed.stdout and "cannot be imported" in " ".join(listed.stdout.split())
    assert asked.returncode == 2 and "ModuleNotFoundError" in asked.stderr


def test_one_line_of_a_foreign_package_runs_its_step_and_those_that_follow_again(
    package: Path, one_roof_file: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "site" / "my_detector"
    (folder / "rules.py").write_text("LEAST = 1.0\n")
    module = folder / "__init__.py"
    module.write_text(module.read_text() + "\nfrom . import rules\n")
    options: dict[str, Any] = {"detect": "high_and_dense", "lod": "0", "keep": True}
    opened = open_run(one_roof_file, tmp_path / "out", **options)

    def keys() -> dict[str, str]:
        return {step.name: step.key(opened) for step in (*STEPS, EDITED)}

    before = keys()
    (folder / "rules.py").write_text("LEAST = 2.0\n")
    after = keys()
    assert {name for name in after if after[name] != before[name]} == {"regions", "signs"}


def test_all_of_this_package_is_in_the_key_of_a_foreign_method(
    page_methods: ModuleType, tmp_path: Path
) -> None:
    from eaves.run.keys import HOME, code_of_methods, kept_digest

    tree = tmp_path / "eaves"
    shutil.copytree(HOME, tree, ignore=shutil.ignore_patterns("*.js*", "__pycache__"))
    method = page_methods.HighAndDense()
    before = list(code_of_methods(method, tree))
    (tree / "solids" / "extrude.py").write_text("ANOTHER_LINE = 1\n")
    kept_digest.cache_clear()
    assert list(code_of_methods(method, tree)) != before


def test_a_file_imports_no_code(page_methods: ModuleType, one_roof_file: Path, tmp_path: Path) -> None:
    name = "my_methods:HighAndDense"
    build_files(one_roof_file, tmp_path / "out", detect=name, lod="0", keep=True)
    with pytest.raises(InputError, match=f"detect method is '{name}', code that .* add --method {name}"):
        open_again(tmp_path / "out")
    assert type(open_again(tmp_path / "out", methods=[name]).recipe.detect) is page_methods.HighAndDense
    done = run("update", tmp_path / "out")
    assert done.returncode == 2 and f"add --method {name}" in done.stderr and "\n" not in done.stderr.strip()
    done = run("update", tmp_path / "out", "--method", name)
    assert done.returncode == 0, done.stderr


def test_a_method_of_a_session_is_refused_where_others_must_know_it(
    one_roof_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    nowhere = type("Nowhere", (High,), {"__module__": "nowhere", "name": "nowhere"})()
    for options in ({"keep": True}, {"jobs": 2}, {"resume": True}):
        with pytest.raises(InputError, match="detect method Nowhere: has no source file, by which other"):
            open_run(one_roof_file, tmp_path / "out", detect=nowhere, **options)  # type: ignore[arg-type]
    assert build_files(one_roof_file, tmp_path / "out", detect=nowhere, lod="0", outputs=("mask",)).complete
