"""The pages agree with the code, and their examples run."""

from __future__ import annotations

import doctest
import re
import shlex
import shutil
from pathlib import Path

import laspy
import numpy as np
import pytest
import typer
from docs.build import outdated
from docs.source_pages import newest, rows_of, source_page
from pyproj import CRS

from eaves.cli.app import make_app
from eaves.recipe.recipe import sources
from tests.conftest import build_files, but_first
from tests.contracts.test_public_docstrings import PUBLIC

DOCS = Path(__file__).parent.parent / "docs"
LINK = re.compile(r"\]\((?!https?:)([^)#\s]+)")
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


def test_examples_of_the_researchers_guide_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    found = doctest.testfile(str(DOCS / "guides" / "researcher.md"), module_relative=False)
    assert found.attempted > 10 and found.failed == 0


@pytest.mark.parametrize("guide", but_first(["analyst", "agency", "change", "researcher", "solar"]))
def test_the_loop_of_a_guide_names_every_building(
    guide: str, nine_roofs_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (DOCS / "guides" / f"{guide}.md").read_text(encoding="utf-8")
    loop = text.split("## Building by building")[1].split("```python")[1].split("```")[0]
    exec(loop.replace("tile.laz", nine_roofs_file.as_posix()), {})
    assert len([line for line in capsys.readouterr().out.splitlines() if line.startswith("b")]) == 9


@pytest.mark.slow
def test_the_python_of_the_start_writes_what_a_build_writes(
    nine_roofs_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copy(nine_roofs_file, "tile.laz")
    build_files("tile.laz", "out", outputs=("models",))
    lines = (DOCS / "start.md").read_text(encoding="utf-8").split("```python\n")[1].split("```")[0]
    exec(lines, {})
    assert Path("buildings.city.jsonl").read_bytes() == Path("out/buildings.city.jsonl").read_bytes()


@pytest.mark.slow
def test_the_examples_of_the_guide_in_python_run(
    nine_roofs_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    las = laspy.read(nine_roofs_file)
    las.header.add_crs(CRS.from_epsg(28992))
    las.write("tile.laz")
    names: dict[str, object] = {}
    for lines in (DOCS / "guides" / "python.md").read_text(encoding="utf-8").split("```python\n")[1:]:
        exec(lines.split("```")[0], names)
    assert len(names["found"]) == len(names["again"]) == 9 and names["score"].mean_iou == 1.0  # type: ignore[arg-type, attr-defined]


@pytest.mark.parametrize("page", sorted(DOCS.rglob("*.md")), ids=lambda path: path.stem)
def test_linked_files_exist(page: Path) -> None:
    for target in LINK.findall(page.read_text(encoding="utf-8")):
        assert (page.parent / target).exists(), target


def figures_of(text: str) -> set[float]:
    """The decimals of a text, and its whole numbers from 100 on."""
    found = re.findall(r"(?<![\w.,-])\d*\.?\d+(?!\.?\d|-)", text.replace(",", " "))
    return {float(one) for one in found if "." in one or float(one) >= 100}


def test_every_figure_of_the_results_stands_in_a_table_that_its_section_links() -> None:
    page = DOCS / "results.md"
    for section in page.read_text(encoding="utf-8").split("\n## ")[1:]:
        tables = [page.parent / target for target in LINK.findall(section)]
        there = figures_of(" ".join(table.read_text(encoding="utf-8") for table in tables))
        assert figures_of(re.sub(LINK, "", section)) <= there, section.splitlines()[0]


def test_figures_of_the_readme_are_those_of_the_results() -> None:
    good = (
        (DOCS.parent / "README.md")
        .read_text(encoding="utf-8")
        .split("## How good it is")[1]
        .split("\n## ")[0]
    )
    assert figures_of(good) <= figures_of((DOCS / "results.md").read_text(encoding="utf-8"))


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


PAGES_OF_SOURCES = ["README", *sources()]
NO_FIGURE = (
    r"<!-- (?:figures|steps) -->.*?<!-- end -->|^## Steps$.*?^## ",  # made from tables; the paper's numbers
    r'"[^"]*"|`[^`]*`|^#.*?$',  # what the paper says, parameters and commands, headings
    r"!?\[[^\]]*\]\([^)]*\)",  # links: a figure among them is one of the cell that its title names
    r"\b(?:19|20)\d\d\b|\b\dD\b|LoD \d\.\d",
)
"""What is no figure of ours on the page of a source."""


@pytest.mark.parametrize("name", PAGES_OF_SOURCES)
def test_every_figure_of_a_source_is_that_of_the_cell_it_names(name: str) -> None:
    """No number stands alone, and each is made from its table as it is."""
    page = (DOCS / "sources" / f"{name}.md").read_text(encoding="utf-8")
    results = DOCS.parent / "benchmarks" / "results"
    assert source_page(page, name, results) == page
    for words in NO_FIGURE:
        page = re.sub(words, " ", page, flags=re.DOTALL | re.MULTILINE)
    assert re.findall(r"\S*\d\S*", page) == []


def test_a_figure_that_is_no_cell_is_refused__and_one_of_another_value_is_replaced(tmp_path: Path) -> None:
    table = "# Rows\n\n| data | chain | IoU |\n|---|---|---|\n| delft | one | 0.7513 |\n"
    (tmp_path / "2026-01-01-sources.md").write_text(table)
    figure = '[{}](../2026-01-01-sources.md "delft · {} · IoU")'
    assert source_page(figure.format(".74", "one"), "one", tmp_path) == figure.format("0.751", "one")
    with pytest.raises(ValueError, match="no cell 'delft · two · IoU'"):
        source_page(figure.format("0.751", "two"), "one", tmp_path)


@pytest.mark.parametrize("source", sources())
def test_most_steps_of_a_source_do_good(source: str) -> None:
    """A step may do harm when its paper has it; its page has all of them with their figures."""
    table = rows_of(newest(DOCS.parent / "benchmarks" / "results", "sources-ablation"))
    whole, *steps = [row for row in table if row["source"] == source]
    sets = ("delft", "ign_urban")
    gains = np.array([[float(step[name]) - float(whole[name]) for name in sets] for step in steps])
    assert np.median(gains.mean(axis=1)) <= 0.0


SHAPE = ["Steps", "Deviations", "Pictures", "Figures", "What each step is worth", "Claims", "Misses"]


@pytest.mark.parametrize("source", sources())
def test_the_pages_of_sources_are_of_one_shape(source: str) -> None:
    page = (DOCS / "sources" / f"{source}.md").read_text(encoding="utf-8")
    assert re.findall(r"^## (.*)$", page, re.MULTILINE) == SHAPE
    assert page.count("<!-- end -->") == 2


@pytest.mark.parametrize("source", sources())
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
