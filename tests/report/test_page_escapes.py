"""What a map calls its buildings cannot become part of the page's script."""

from __future__ import annotations

import json

import pytest

from eaves.report.output import as_json


@pytest.mark.parametrize("name", ["<!--<script>", "</script>", "<SCRIPT", "a\u2028b", "]]>", "<!--"])
def test_no_id_ends_or_swallows_the_script(name: str) -> None:
    text = as_json({"rows": [{"id": name}]})
    assert "<" not in text
    assert json.loads(text)["rows"][0]["id"] == name
