"""The pages agree with the code, and their examples run."""

from __future__ import annotations

import doctest
import re
import shlex
import shutil
from pathlib import Path

import pytest
import typer
from docs.build import outdated

from eaves.cli.app import make_app
from eaves.pipeline import build
from eaves.recipe.sources import SOURCES
from tests.contracts.test_public_docstrings import PUBLIC

DOCS = Path(__file__).parent.parent / "docs"
LINK = re.compile(r"\]\((?!https?:)([^)#]+)")
EXAMPLES = {name: thing for name, thing in PUBLIC.items() if ">>>" in (thing.__doc__ or "")}


@pytest.mark.filterwarnings("ignore:'crs' was not provided")
@pytest.mark.parametrize("name", EXAMPLES)
def test_the_example_of_a_public_name_runs(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In an empty folder, as a reader would try it."""
    monkeypatch.chdir(tmp_path)
    found = doctest.DocTestFinder(recurse=False).find(EXAMPLES[name], name, globs={})
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE)
    output: list[str] = []
    assert runner.run(found[0], out=output.append).failed == 0, "".join(output)


def test_generated_pages_are_up_to_date() -> None:
    assert [path.as_posix() for path in outdated()] == [], "run make docs"


def test_examples_of_the_researchers_guide_run() -> None:
    found = doctest.testfile(str(DOCS / "guides" / "researcher.md"), module_relative=False)
    assert found.attempted > 10 and found.failed == 0


def test_the_readmes_python_writes_what_a_build_writes(
    nine_roofs_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copy(nine_roofs_file, "tile.laz")
    build("tile.laz", "out", outputs=("models",))
    lines = (DOCS.parent / "README.md").read_text(encoding="utf-8").split("```python\n")[1].split("```")[0]
    exec(lines, {})
    assert Path("buildings.city.jsonl").read_bytes() == Path("out/buildings.city.jsonl").read_bytes()


@pytest.mark.parametrize("page", sorted(DOCS.rglob("*.md")), ids=lambda path: path.stem)
def test_linked_files_exist(page: Path) -> None:
    for target in LINK.findall(page.read_text(encoding="utf-8")):
        assert (page.parent / target).exists(), target


COMMAND = re.compile(r"^(?:\.venv/bin/)?(eaves [^\n]*)$", re.MULTILINE)
PAGES = [
    DOCS.parent / "README.md",
    DOCS / "start.md",
    DOCS / "scale.md",
    *sorted((DOCS / "guides").glob("*.md")),
]


def commands_of(page: Path) -> list[str]:
    """The `eaves …` lines of a page's code blocks, without their comments."""
    blocks = re.findall(r"^```\w*\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    joined = "\n".join(blocks).replace("\\\n", " ")
    return [line.split("  #")[0].split(" #")[0].strip() for line in COMMAND.findall(joined)]


@pytest.mark.parametrize("line", sorted({line for page in PAGES for line in commands_of(page)}))
def test_a_command_as_printed_is_one_that_is_understood(line: str) -> None:
    """Every option exists and every value is of its kind; nothing is computed."""
    name, *words = shlex.split(line)[1:]
    group = typer.main.get_command(make_app())
    command = group.commands[name]  # type: ignore[attr-defined]
    with command.make_context(name, words) as context:
        assert not context.args, f"left over: {context.args}"


@pytest.mark.parametrize("source", SOURCES)
def test_each_step_of_a_source_names_the_function_that_does_it(source: str) -> None:
    page = DOCS / "sources" / f"{source}.md"
    table = page.read_text(encoding="utf-8").split("where in the code |")[1].split("\n\n")[0].splitlines()[2:]
    assert len(table) > 4
    for row in table:
        named = re.findall(r"\[(\w+)\]\(([^)]+\.py)\)", row.rsplit(" | ", 1)[1])
        assert named, row
        for name, place in named:
            code = (page.parent / place).read_text(encoding="utf-8")
            assert re.search(rf"^ *(def|class) {name}\b", code, re.MULTILINE), f"{name} is not in {place}"
