"""The lowest versions that pyproject.toml promises, as constraints: `packaging/lowest.py > lowest.txt`.

CI builds with them: `pip install --constraint lowest.txt …`.
"""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import Any

PROJECT = Path(__file__).parent.parent / "pyproject.toml"
BOUND = re.compile(r"([A-Za-z0-9_.-]+)(?:\[[^]]*\])?>=([0-9.]+)")


def lowest(project: dict[str, Any]) -> Iterator[str]:
    """`name==version` of each requirement, of the strictest where several extras name it, by name.

    Raises
    ------
    ValueError
        When a requirement has no lower bound.
    """
    wanted: Iterable[str] = chain(project["dependencies"], *project["optional-dependencies"].values())
    bounds: dict[str, str] = {}
    for requirement in wanted:
        if not (found := BOUND.fullmatch(requirement)):
            raise ValueError(f"{requirement} has no lower bound; write name>=version")
        name, version = found.groups()
        bounds[name] = max(bounds.get(name, "0"), version, key=lambda one: [int(n) for n in one.split(".")])
    yield from (f"{name}=={version}" for name, version in sorted(bounds.items()))


if __name__ == "__main__":
    sys.stdout.writelines(
        f"{line}\n" for line in lowest(tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"])
    )
