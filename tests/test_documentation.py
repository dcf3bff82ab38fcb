"""The pages say what the code says, and their examples run."""

from __future__ import annotations

import doctest
import re
from pathlib import Path

import pytest
from docs.build import outdated

DOCS = Path(__file__).parent.parent / "docs"
LINK = re.compile(r"\]\((?!https?:)([^)#]+)")


def test_generated_pages_are_up_to_date() -> None:
    assert [path.as_posix() for path in outdated()] == [], "run make docs"


def test_examples_of_the_researchers_guide_run() -> None:
    found = doctest.testfile(str(DOCS / "guides" / "researcher.md"), module_relative=False)
    assert found.attempted > 10 and found.failed == 0


@pytest.mark.parametrize("page", sorted(DOCS.rglob("*.md")), ids=lambda path: path.stem)
def test_links_lead_somewhere(page: Path) -> None:
    for target in LINK.findall(page.read_text(encoding="utf-8")):
        assert (page.parent / target).exists(), target
