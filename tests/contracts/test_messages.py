"""Refusals name keywords to one who calls a function, and options to one who types a command."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from tests.cli.test_commands import eaves as command

import eaves
from eaves.run.options import in_python

CALLS = {
    "a level": {"lod": 3},
    "bounds": {"bounds": (1, 2, 3)},
    "no map": {"id_field": "id"},
    "an output": {"outputs": "foot"},
    "a format": {"formats": "xyz"},
    "memory": {"memory": "much"},
    "classes": {"classes": "two"},
    "a keyword": {"lods": "1.2"},
    "a switch": {"use_classes": "perhaps"},
}


@pytest.mark.parametrize("case", CALLS)
def test_a_refused_keyword_is_one_sentence_without_a_flag(
    case: str, nine_roofs_file: Path, tmp_path: Path
) -> None:
    with pytest.raises((TypeError, ValueError)) as caught:
        eaves.build(nine_roofs_file, tmp_path / "out", **CALLS[case])
    said = str(caught.value)
    assert "--" not in said and "\n" not in said and next(iter(CALLS[case])) in said
    assert not (tmp_path / "out").exists()


def test_a_refused_option_is_named_as_it_is_typed(nine_roofs_file: Path, tmp_path: Path) -> None:
    done = command("build", str(nine_roofs_file), "-o", str(tmp_path / "out"), "--bounds", "1,2,3")
    assert done.returncode == 2 and "error: --bounds 1,2,3: not four numbers" in done.stderr


@pytest.mark.parametrize(
    ("typed", "called"),
    [
        ("--lod 3: unknown", "lod=3: unknown"),
        ("add --footprints, or leave it out", "add footprints=, or leave it out"),
        ("run again with --resume", "run again with resume=True"),
        ("give another -o, or --overwrite", "give another out, or overwrite=True"),
        ("pass the right one with crs= or --crs", "pass the right one with crs="),
        ("say so with --crs-force", "say so with crs_force=True"),
    ],
)
def test_an_option_is_a_keyword_in_python(typed: str, called: str) -> None:
    assert in_python(typed) == called and not re.search(r"(?<!\w)-", called)
