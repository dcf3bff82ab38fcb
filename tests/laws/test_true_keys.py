"""A key cannot lie: what a step runs, takes and reads is in its key, and nothing else reaches it."""

from __future__ import annotations

import ast
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eaves
from eaves.buildings.building_file import found_buildings
from eaves.flow.corrected import EDITED, correct, outlines_in
from eaves.flow.edits import FLAT_ROOF, Edit
from eaves.flow.region import Region, ensure_points, open_region
from eaves.flow.run import Run, no_progress, open_run
from eaves.flow.step import SHOWN, SIGNS, STEPS, Input, Step, ensure, square_of
from eaves.methods import REGISTRY, methods_of, resolve_method
from eaves.model import Block
from eaves.pipeline import build_run, compute_buildings, end_run, hold_folder
from eaves.reconstruct.overhangs import OverhangRules
from eaves.run import keys
from eaves.run.keys import modules_of, path_of_method
from eaves.run.store import PartFile
from eaves.run.workers import Outcome, Workers

PACKAGE = Path(eaves.__file__).parent
SIDE = 60.0
ALL_STEPS = (*STEPS, EDITED)
by_name = pytest.mark.parametrize("step", ALL_STEPS, ids=lambda step: step.name)


@pytest.fixture(scope="module")
def kept(nine_roofs_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A run over several blocks that keeps its results."""
    folder = tmp_path_factory.mktemp("kept") / "out"
    run = replace(open_run(nine_roofs_file, folder, keep=True, outputs=("models",)), side=SIDE)
    with hold_folder(run) as workers:
        end_run(run, build_run(run, workers))
    Again(replace(run.with_options(resume=True))).edited()
    return replace(run.with_options(resume=True), generations=(7,))


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A copy of the package whose code can be changed."""
    shutil.copytree(PACKAGE, tmp_path / "eaves", ignore=shutil.ignore_patterns("*.js*", "__pycache__"))
    return tmp_path / "eaves"


def keys_in(tree: Path, run: Run) -> dict[str, str]:
    """Step → its key with the code of a tree."""
    keys.kept_digest.cache_clear()
    return {step.name: step.key(run, tree) for step in ALL_STEPS}


def add_line(file: Path) -> None:
    file.write_text(file.read_text(encoding="utf-8") + "\nANOTHER_LINE = 1\n", encoding="utf-8")


def changed(before: dict[str, str], after: dict[str, str]) -> set[str]:
    return {name for name, key in after.items() if before[name] != key}


@by_name
def test_a_line_of_its_code_changes_the_key_of_a_step_and_of_those_that_run_it(
    step: Step, kept: Run, tree: Path
) -> None:
    before, module = keys_in(tree, kept), step.run.__module__
    file = "/".join(module.split(".")[1:]) + ".py"
    add_line(tree / file)
    runs_it = {one.name for one in ALL_STEPS if covers(one.code, file)}
    assert changed(before, keys_in(tree, kept)) == runs_it
    assert step.name in runs_it


@pytest.mark.parametrize(
    "file",
    [
        *("formats/qgis/symbols.py", "formats/columns.py", "formats/vectors/geopackage.py"),
        *("formats/models/cityjson.py", "exports/glb.py", "report/pictures.py", "report/output.py"),
        *("cli/app.py", "flow/outputs.py", "pipeline.py", "published/ren_fcs/ground.py"),
    ],
)
def test_a_line_in_a_writer_a_style_a_picture_or_a_command_changes_no_key(
    file: str, kept: Run, tree: Path
) -> None:
    before = keys_in(tree, kept)
    add_line(tree / file)
    assert keys_in(tree, kept) == before


def covers(code: Iterable[str], file: str) -> bool:
    """Whether a file lies in some folders and files."""
    return any(file == place or file.startswith(f"{place}/") for place in code)


def imports_of(module: str) -> set[str]:
    """The modules of this package that one imports, but for those of types alone."""
    found, waiting = set[str](), [ast.parse(MODULES[module].read_text(encoding="utf-8"))]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.If) and getattr(node.test, "id", "") == "TYPE_CHECKING":
            continue
        waiting += list(ast.iter_child_nodes(node))  # type: ignore[arg-type]
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("eaves"):
            for alias in node.names:
                found |= origins(str(node.module), alias.name)
    return found & MODULES.keys()


def origins(package: str, name: str) -> set[str]:
    """The modules that an imported name may be, or be of."""
    stub = PACKAGE.joinpath(*package.split(".")[1:], "__init__.pyi")
    lazy = ast.parse(stub.read_text(encoding="utf-8")).body if stub.exists() else []
    homes = [node.module for node in lazy if isinstance(node, ast.ImportFrom) and named(node, name)]
    return {f"{package}.{name}", package, *(f"{package}.{home}" for home in homes)}


def named(node: ast.ImportFrom, name: str) -> bool:
    return any(alias.name == name for alias in node.names)


def name_of(file: Path) -> str:
    return ".".join(["eaves", *file.relative_to(PACKAGE).with_suffix("").parts]).removesuffix(".__init__")


MODULES = {name_of(file): file for file in PACKAGE.rglob("*.py")}
NO_RESULT = ("eaves.extensions", "eaves.formats")
"""What decides no result: the look-up of names; readers and writers, for what was read is in the keys."""


def reached(modules: Iterable[str]) -> set[str]:
    """All modules, first files of packages apart, that some import, directly or not."""
    found, waiting = set[str](), list(modules)
    while waiting:
        module = waiting.pop()
        if module not in found and module in MODULES:
            found.add(module)
            waiting += imports_of(module)
    return {one for one in found if MODULES[one].name != "__init__.py" and not one.startswith(NO_RESULT)}


def outside(modules: Iterable[str], code: Iterable[str]) -> list[str]:
    files = [MODULES[one].relative_to(PACKAGE).as_posix() for one in sorted(reached(modules))]
    return [file for file in files if not covers(code, file)]


@by_name
def test_a_step_runs_no_code_but_what_it_declares(step: Step) -> None:
    functions = [step.inputs_of, step.run, *(one.load for one in step.takes)]
    functions += [one.source.load for one in step.takes if one.source is not None]
    modules = {one.__module__ for one in functions if one is not None and one.__module__ in MODULES}
    assert outside(modules, step.code) == []
    assert all((PACKAGE / place).exists() for place in step.code)


STEP_OF = {"ground": "ground", "detect": "regions"}


@pytest.mark.parametrize(
    ("stage", "name"), [(stage, name) for stage in REGISTRY for name in methods_of(stage)]
)
def test_a_method_runs_no_code_but_its_own_and_what_its_step_declares(stage: str, name: str) -> None:
    method = resolve_method(stage, name)
    step = next(one for one in ALL_STEPS if one.name == STEP_OF.get(stage, "buildings"))
    modules = {one for one in modules_of(method) if one in MODULES}
    own = [path_of_method(module) for module in modules]
    assert outside(modules, [*step.code, *own]) == []


@pytest.mark.parametrize(
    ("module", "methods", "step"),
    [
        ("ground/adaptive_tin/method.py", {}, "ground"),
        ("published/xiao2014/normal_echo.py", {"detect": "normal_echo"}, "regions"),
        ("published/maas_vosselman/reconstruction.py", {"reconstruct": "maas_vosselman"}, "buildings"),
    ],
)
def test_the_code_of_a_method_is_in_the_keys_of_the_steps_that_are_given_it_alone(
    module: str, methods: dict[str, str], step: str, kept: Run, tree: Path
) -> None:
    given = replace(kept, recipe=eaves.make_recipe(methods))
    others = {"ground": "contours", "detect": "contours", "reconstruct": "prism"}
    without = replace(kept, recipe=eaves.make_recipe(others))
    before = keys_in(tree, given), keys_in(tree, without)
    add_line(tree / module)
    assert step in changed(before[0], keys_in(tree, given))
    assert not changed(before[1], keys_in(tree, without))


def test_a_detector_does_not_reach_the_ground_nor_a_roof_the_regions(kept: Run, tree: Path) -> None:
    before = keys_in(tree, kept)
    add_line(tree / "roof" / "global_refinement.py")
    assert changed(before, keys_in(tree, kept)) == {"buildings", "edited"}
    before = keys_in(tree, kept)
    add_line(tree / "detect" / "consensus" / "method.py")
    assert changed(before, keys_in(tree, kept)) == {"signs", "regions"}


def with_recipe(**fields: Any) -> Callable[[Run], Run]:
    return lambda run: replace(run, recipe=replace(run.recipe, **fields))


def with_method(stage: str, **parameters: Any) -> Callable[[Run], Run]:
    def change(run: Run) -> Run:
        method = getattr(run.recipe, stage).model_copy(update=parameters)
        return replace(run, recipe=replace(run.recipe, **{stage: method}))

    return change


CHANGES: dict[str, tuple[Callable[[Run], Run], set[str]]] = {
    "a number of the ground filter": (with_method("ground", angle=9.0), {"large", "ground"}),
    "a number of the detector": (with_method("detect", min_height=2.1), {"signs", "regions"}),
    "the outline": (with_recipe(outline=eaves.AlphaShape()), {"buildings"}),
    "the units, which want intensities": (with_recipe(units=None), {"points", "buildings"}),
    "the roof": (with_recipe(roof=eaves.RegionGrowing()), {"buildings", "edited"}),
    "the reconstruction": (with_recipe(reconstruct=eaves.Prism()), {"buildings", "edited"}),
    "the level": (with_recipe(lod="1.2"), {"buildings", "edited"}),
    "overhangs": (with_recipe(lod="2.3"), {"regions", "buildings", "edited"}),
    "limits of overhangs": (
        with_recipe(overhangs=replace(OverhangRules(), **{next(iter(vars(OverhangRules()))): 0.123})),
        {"buildings", "edited"},
    ),
    "the classes of the files": (
        with_recipe(use_classes=True),
        {"large", "decks", "ground", "signs", "regions"},
    ),
    "the numbers of the ground": (with_recipe(ground_classes=(2, 8)), {"ground"}),
    "vegetation": (with_recipe(vegetation=None), {"signs", "regions"}),
    "water, wires and bridges": (with_recipe(others=False), {"signs", "regions"}),
    "small buildings": (with_recipe(smallest=(0.0, 0.0)), {"regions"}),
    "snapping": (lambda run: run.with_options(snap_footprints=True), {"buildings"}),
    "later scans": (lambda run: replace(run, generations=(3,)), {"superseded"}),
    "an output": (lambda run: run.with_options(outputs=("footprints",)), set()),
}


@pytest.mark.parametrize("name", CHANGES)
def test_a_parameter_changes_the_keys_of_the_steps_that_read_it_alone(name: str, kept: Run) -> None:
    change, expected = CHANGES[name]
    other = change(kept)
    assert {step.name for step in ALL_STEPS if step.key(kept) != step.key(other)} == expected


@by_name
def test_the_reference_system_is_in_the_key_of_every_step(step: Step, kept: Run) -> None:
    feet = replace(kept.index, system=replace(kept.index.system, horizontal_unit_m=0.3048))
    assert step.key(kept) != step.key(replace(kept, index=feet))


@by_name
def test_a_function_is_given_the_parameters_that_its_step_declares_and_no_others(
    step: Step, kept: Run
) -> None:
    assert set(vars(step.parameters(kept))) == {"system", *step.reads}


class Recorder(Workers):
    """Workers that note which units of which steps they compute."""

    def __init__(self) -> None:
        super().__init__()
        self.units: dict[str, set[Block]] = {}

    def run(self, work: Any, tasks: Sequence[Any]) -> Iterator[Outcome]:
        if isinstance(work, partial) and hasattr(work.func, "step"):
            homes = {square_of(unit) for unit, _ in tasks}
            self.units.setdefault(work.func.step.name, set()).update(homes)
        return super().run(work, tasks)


@dataclass
class Again:
    """A kept run that is opened again, and the units that it computes."""

    run: Run
    workers: Recorder = field(default_factory=Recorder)

    def opened(self) -> Region:
        region = open_region(self.run, self.workers, no_progress)
        ensure_points(region)
        return region

    def edited(self) -> None:
        self.computed(self.opened())

    def computed(self, region: Region) -> dict[str, set[Block]]:
        """Units of each step, the edits among them: every roof is said to be flat."""
        compute_buildings(region)
        outlines = outlines_in(found_buildings(region.store), SIDE)
        correct(region, [Edit(FLAT_ROOF, outline, name) for name, outline in outlines.items()])
        ensure(region, SHOWN, region.blocks)
        assert not region.failed
        return {name: units for name, units in self.workers.units.items() if units}


@pytest.fixture
def again(kept: Run, tmp_path: Path) -> Again:
    shutil.copytree(kept.folder, tmp_path / "out")
    return Again(replace(kept, folder=tmp_path / "out", generations=()))


def test_nothing_changed_nothing_is_computed(again: Again) -> None:
    assert again.computed(again.opened()) == {}


INPUTS = [(step, one) for step in ALL_STEPS[4:] for one in step.takes if SIGNS not in (step, one.source)]
"""Points of later scans, of dense and of smoothed ones, and colours have tests of their own (change, run,
raster, detect)."""


def reaches(one: Input, run: Run, unit: Block, square: Block) -> bool:
    """Whether an input of a unit reaches a square."""
    recipe = run.recipe
    widths = {
        "wide_buffer": 600.0,
        "ground.buffer": recipe.ground.buffer,
        "scene_buffer": recipe.scene_buffer,
    }
    near = unit.bounds.buffered(one.rings * SIDE if one.reach is None else widths[one.reach])
    west, south, east, north = vars(square.bounds).values()
    return near.west < east and west < near.east and near.south < north and south < near.north


@pytest.mark.parametrize(("step", "one"), INPUTS, ids=lambda value: getattr(value, "name", ""))
def test_a_changed_input_is_looked_at_by_the_units_that_it_reaches_and_by_no_others(
    step: Step, one: Input, again: Again
) -> None:
    region = again.opened()
    store = region.store
    if one.source is None:
        square = region.blocks[0]
        region.points_keys = {**region.points_keys, square.name: "another"}
    else:
        square = store.units(one.source.name, one.source.side or SIDE)[0]
        mark = store.mark(one.source.name, square)
        assert mark is not None
        arrays = {**PartFile(store.path(one.source.name, square)), "another": np.zeros(1)}
        store.save(one.source.name, square, arrays, mark.read, mark.taken, mark.step)
    units = set(store.units(step.name, step.side or SIDE))
    computed = again.computed(region)
    same = [other for other in step.takes if other.source is one.source]
    expected = {unit for unit in units if any(reaches(other, again.run, unit, square) for other in same)}
    if step.name in ("buildings", "edited"):  # of blocks around all that their buildings lie in
        assert expected <= computed.get(step.name, set())
    else:
        assert computed[step.name] == expected
    if one.source is not None:
        assert one.source.name not in computed
