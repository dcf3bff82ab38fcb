"""The command `eaves compare`: scans built if they are not yet, epochs compared, files and page written."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path

from eaves.change.compare import compare
from eaves.change.output import as_text, write_comparison
from eaves.change.page import write_change_page
from eaves.flow import claim
from eaves.formats import InputError, report_full_disk
from eaves.pipeline import build
from eaves.run import MANIFEST, RunOptions, begin_manifest, end_manifest, lock_folder

log = logging.getLogger("eaves")
WANTED = ("footprints", "models", "rasters", "classified")
"""The outputs of a scan that is built first."""


def run_comparison(
    old: Path, new: Path, out: Path, crs: str | None, jobs: int, progress: Callable[[str, int, int], None]
) -> tuple[str, bool]:
    """Compare and write; the closing lines, and whether everything that was built first is whole."""
    for path in (old, new):
        if not path.exists():
            raise InputError.about(path, "does not exist", "give the folder of a run, or a scan")
    if old.resolve() == new.resolve():
        raise InputError.about(old, "is given as both epochs", "give two")
    if out.resolve() in (old.resolve(), new.resolve()):
        raise InputError.about(out, "is the folder of an epoch", "choose another with -o")
    claim(out)
    whole = True
    folders = []
    for name, path in (("old", old), ("new", new)):
        folder = path
        if not (path / MANIFEST).exists():
            log.info("%s: is a scan and is built first, into %s", path, out / name)
            options = RunOptions(crs=crs, jobs=jobs, outputs=WANTED, resume=True)
            summary = build(path, out / name, progress=progress, allow_failures=True, **options)
            whole &= summary.complete
            folder = out / name
        folders.append(folder)
    with lock_folder(out), report_full_disk(out):
        comparison = compare(folders[0], folders[1], out, progress)
        begin_manifest(out)
        paths = write_comparison(comparison, out)
        paths.append(write_change_page(comparison, out))
        end_manifest(out, paths, whole, command="compare")
    return f"{as_text(comparison)}\npage: {paths[-1]}", whole
