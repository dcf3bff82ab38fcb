"""The pages say what the code says, and their examples run."""

from __future__ import annotations

import doctest
import inspect
import re
from importlib import import_module
from pathlib import Path

import pytest
from docs.api_page import SECTIONS
from docs.build import outdated

DOCS = Path(__file__).parent.parent / "docs"
LINK = re.compile(r"\]\((?!https?:)([^)#]+)")


VERBS = [
    (module, name)
    for module in SECTIONS.values()
    for name in sorted(import_module(module).__all__)
    if inspect.isfunction(getattr(import_module(module), name))
]


@pytest.mark.filterwarnings("ignore:'crs' was not provided")
@pytest.mark.parametrize(("module", "name"), VERBS, ids=lambda word: str(word))
def test_the_example_of_a_verb_runs(
    module: str, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In an empty folder, as a reader would try it."""
    monkeypatch.chdir(tmp_path)
    found = doctest.DocTestFinder(recurse=False).find(getattr(import_module(module), name), name, globs={})
    assert found and found[0].examples, f"{module}.{name} has no example"
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE)
    told: list[str] = []
    assert runner.run(found[0], out=told.append).failed == 0, "".join(told)


def test_generated_pages_are_up_to_date() -> None:
    assert [path.as_posix() for path in outdated()] == [], "run make docs"


def test_examples_of_the_researchers_guide_run() -> None:
    found = doctest.testfile(str(DOCS / "guides" / "researcher.md"), module_relative=False)
    assert found.attempted > 10 and found.failed == 0


@pytest.mark.parametrize("page", sorted(DOCS.rglob("*.md")), ids=lambda path: path.stem)
def test_links_lead_somewhere(page: Path) -> None:
    for target in LINK.findall(page.read_text(encoding="utf-8")):
        assert (page.parent / target).exists(), target
