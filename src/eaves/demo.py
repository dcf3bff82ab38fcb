"""The demo: a scene whose every plane is known, built from its bare points, compared with the truth."""

from __future__ import annotations

import logging
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

log = logging.getLogger("eaves")
Progress = AbstractContextManager[Callable[[str, int, int], None]]
FOUND_SHARE = 0.5
"""A true face is found when one built face covers this share of it."""


def run_demo(folder: Path, progress: Progress) -> int:
    raise NotImplementedError
