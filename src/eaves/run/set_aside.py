"""The work of a person in a run's folder: found before a run writes over it, moved aside, never deleted."""

from __future__ import annotations

import logging
import os
from collections.abc import Collection, Iterator, Sequence
from itertools import count
from pathlib import Path

from eaves.formats import InputError
from eaves.run.manifest import MANIFEST, changed_files, known_facts, read_manifest

log = logging.getLogger("eaves")

BEFORE = "before-"
"""Start of the name of a folder of what was moved aside."""
CHANGED, FOREIGN = "was changed since a run wrote it", "is of no run"
LISTED = 20
"""Maximum number of files that a line names."""


def work_of_persons(folder: Path, planned: Collection[str]) -> Iterator[tuple[Path, str]]:
    """What a person changed in a folder, and what bears a `planned` name of a run's files and no run wrote,
    each with the reason."""
    if not folder.is_dir():
        return
    names = set(known_facts(folder).get("written", {}))
    yield from ((path, CHANGED) for path in changed_files(folder))
    names |= {name.split("/")[0] for name in names}
    try:
        read_manifest(folder)
    except InputError:  # another program's run.json, where there is one
        planned = {*planned, MANIFEST}
    for name in sorted(set(planned) - names):
        if os.path.lexists(folder / name):
            yield folder / name, FOREIGN


def set_aside(folder: Path, paths: Sequence[Path]) -> None:
    """Move files and folders of a run's folder to `before-<n>` in it, with a line that says so."""
    if not paths:
        return
    place = next_place(folder)
    for path in paths:
        for file in (path, *(path.with_name(f"{path.name}{suffix}") for suffix in ("-wal", "-shm"))):
            if os.path.lexists(file):
                target = place / file.relative_to(folder)
                target.parent.mkdir(parents=True, exist_ok=True)
                file.rename(target)
    log.warning("%s: kept in %s: %s", folder, place.name, names_of_paths(folder, paths))


def next_place(folder: Path) -> Path:
    """The folder `before-<n>` of the next number."""
    return next(place for n in count(1) if not os.path.lexists(place := folder / f"{BEFORE}{n}"))


def names_of_paths(folder: Path, paths: Sequence[Path]) -> str:
    """Names of files of a folder in a line; of very many the first, and how many more there are."""
    names = [path.relative_to(folder).as_posix() for path in paths]
    more = f" and {len(names) - LISTED:,} more" if len(names) > LISTED else ""
    return ", ".join(names[:LISTED]) + more
