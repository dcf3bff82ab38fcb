"""A key cannot lie: what a step runs, takes and reads is in its key, and nothing else is."""

from __future__ import annotations

import ast
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

import eaves
from eaves.model import CoordinateSystem
from eaves.recipe.recipe import Recipe, make_recipe
from eaves.run.code import Sources, package_sources
from eaves.run.keys import POINTS, STEPS, Step, modules_of

PACKAGE = Path(eaves.__file__).parent
EVERY = (POINTS, *STEPS)
METRES = CoordinateSystem()


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A copy of the package whose code can be changed."""
    shutil.copytree(PACKAGE, tmp_path / "eaves", ignore=shutil.ignore_patterns("*.js*", "__pycache__"))
    return tmp_path / "eaves"


def modules_run(step: Step, recipe: Recipe) -> set[str]:
    """The modules that a step may run."""
    values = [getattr(recipe, name) for name in step.parameters]
    return package_sources().closure([step.module, *(name for value in values for name in modules_of(value))])


def keys_in(tree: Path, recipe: Recipe) -> dict[str, str]:
    """Step → its key with the code of a tree."""
    sources = Sources(tree)
    return {step.name: step.key(recipe, METRES, sources) for step in EVERY}


@pytest.mark.parametrize("step", EVERY, ids=lambda step: step.name)
def test_a_line_of_its_code_changes_the_key_of_a_step_and_of_those_that_run_it(
    step: Step, tree: Path
) -> None:
    recipe = make_recipe()
    before = keys_in(tree, recipe)
    file = tree.joinpath(*step.module.split(".")[1:]).with_suffix(".py")
    file.write_text(file.read_text(encoding="utf-8") + "\nANOTHER_LINE = 1\n", encoding="utf-8")
    after = keys_in(tree, recipe)
    changed = {name for name, key in after.items() if before[name] != key}
    assert changed == {one.name for one in EVERY if step.module in modules_run(one, recipe)}
    assert step.name in changed


@pytest.mark.parametrize(
    ("module", "method"),
    [("ground/adaptive_tin/method.py", {}), ("detect/normal_echo.py", {"detect": "normal_echo"})],
)
def test_the_code_of_a_method_is_in_the_keys_of_the_steps_that_are_given_it(
    module: str, method: dict[str, str], tree: Path
) -> None:
    with_method, without = make_recipe(method), make_recipe({"ground": "contours", "detect": "contours"})
    before = keys_in(tree, with_method), keys_in(tree, without)
    file = tree / module
    file.write_text(file.read_text(encoding="utf-8") + "\nANOTHER_LINE = 1\n", encoding="utf-8")
    after = keys_in(tree, with_method), keys_in(tree, without)
    step = "ground" if module.startswith("ground") else "blocks"
    assert before[0][step] != after[0][step]
    assert before[1] == after[1]


def test_comments_docstrings_and_formatting_change_no_key(tree: Path) -> None:
    recipe = make_recipe()
    before = keys_in(tree, recipe)
    for file in tree.rglob("*.py"):
        content = ast.unparse(ast.parse(file.read_text(encoding="utf-8")))
        file.write_text(f'"""Another docstring."""\n# a comment\n{content}\n', encoding="utf-8")
    assert keys_in(tree, recipe) == before


def test_a_digest_that_is_kept_is_that_of_the_file_as_it_stands(tree: Path, tmp_path: Path) -> None:
    table = tmp_path / "table.json"
    first = Sources(tree, table).digest(["eaves.blocks.block"])
    assert table.exists()
    assert Sources(tree, table).digest(["eaves.blocks.block"]) == first
    file = tree / "raster" / "surfaces.py"
    file.write_text(file.read_text(encoding="utf-8") + "\nANOTHER_LINE = 1\n", encoding="utf-8")
    assert Sources(tree, table).digest(["eaves.blocks.block"]) != first
    table.write_text("{")
    assert Sources(tree, table).digest(["eaves.blocks.block"]) != first


@pytest.mark.parametrize("step", EVERY, ids=lambda step: step.name)
def test_the_reference_system_is_in_the_key_of_every_step(step: Step) -> None:
    recipe = make_recipe()
    feet = replace(METRES, horizontal_unit_m=0.3048)
    assert step.key(recipe, METRES) != step.key(recipe, feet)
