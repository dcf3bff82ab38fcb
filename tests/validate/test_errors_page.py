"""docs/errors.md lists every code there is."""

from __future__ import annotations

import re
from pathlib import Path

from eaves.validate import RULES

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "errors.md").read_text(encoding="utf-8")


def test_every_finding_stands_on_the_page_with_its_rule() -> None:
    for code, (name, rule) in RULES.items():
        assert f"| {code} | {name} | {rule} |" in PAGE


def test_every_failure_code_stands_on_the_page() -> None:
    sources = "\n".join(path.read_text(encoding="utf-8") for path in sorted((ROOT / "src").rglob("*.py")))
    codes = set(re.findall(r'\bFailure\(\s*"([a-z_]+)"', sources))
    missing = {code for code in codes if f"| `{code}` |" not in PAGE}
    assert not missing, f"docs/errors.md lacks {sorted(missing)}"
