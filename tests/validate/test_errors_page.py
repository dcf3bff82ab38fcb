"""docs/errors.md lists every code there is."""

from __future__ import annotations

from pathlib import Path

from docs.code_tables import failure_stages

from eaves.methods import REGISTRY
from eaves.validate import RULES

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "errors.md").read_text(encoding="utf-8")


def test_every_finding_stands_on_the_page_with_its_rule() -> None:
    for code, (name, rule) in RULES.items():
        assert f"| {code} | {name} | {rule} |" in PAGE


def test_every_failure_code_stands_on_the_page_with_the_stages_that_there_are() -> None:
    stages = failure_stages()
    missing = {code for code in stages if f"| `{code}` | {', '.join(sorted(stages[code]))} |" not in PAGE}
    assert not missing, f"docs/errors.md lacks {sorted(missing)}; run make docs"
    assert set().union(*stages.values()) <= {*REGISTRY, "pipeline"}
