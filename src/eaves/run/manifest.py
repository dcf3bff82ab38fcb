"""Manifest of the files of a run: by it a rerun removes its own old files only, and anyone can check them."""

from __future__ import annotations

import hashlib
import json
import logging
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any

import eaves
from eaves.formats import InputError
from eaves.formats.atomic import atomic, clear_leftovers
from eaves.run.tables import tables_of

log = logging.getLogger("eaves")

MANIFEST = "run.json"
"""Its members `complete` and `written` are the manifest; all others are the facts of the run."""
Entry = dict[str, Any]
"""`size` in bytes, `sha256`, of some files `content` and `tables`, and the time it was `modified` (ns); empty
for a file that a run is about to write or has not finished."""
SQLITE_HEADER = 100
"""Bytes, by the file format."""


def begin_manifest(
    folder: Path,
    facts: Mapping[str, Any] | None = None,
    files: Sequence[Path] = (),
    planned: Iterable[str] = (),
) -> None:
    """Say that a run writes here, its facts, the `files` that it has written, and the names `planned` of
    others: until it ends, what an earlier one left is no result, and whatever happens, a run after this one
    knows the files as ours."""
    entries: dict[str, Entry] = {name: {} for name in planned}
    entries |= {name: whole_entry(folder / name) for name in names_of(folder, files)}
    write_manifest(folder, facts or {}, {**known_files(folder), **entries}, False)


def end_manifest(folder: Path, files: Sequence[Path], complete: bool = True, **facts: Any) -> None:
    """Remove what earlier runs wrote and this one did not, and what any left that was killed; write down
    every file of this one.

    A file that somebody has changed since is left where it is, with a warning. `facts` come to those noted.
    """
    clear_leftovers([*files, folder / MANIFEST])
    names = names_of(folder, files)
    earlier = known_files(folder)
    for name in sorted(earlier.keys() - set(names)):
        remove_own(folder / name, earlier[name])
    entries = {name: current_entry(folder / name, earlier.get(name)) for name in names}
    write_manifest(folder, {**read_facts(folder), **facts}, entries, complete)


def add_to_manifest(folder: Path, files: Sequence[Path]) -> None:
    """Write down files made after the run, where it has a manifest."""
    if (folder / MANIFEST).exists():
        content = read_manifest(folder)
        entries = {name: whole_entry(folder / name) for name in names_of(folder, files)}
        write_manifest(folder, read_facts(folder), content["written"] | entries, content["complete"])


def names_of(folder: Path, files: Sequence[Path]) -> list[str]:
    """Files by their path from the folder, with `/`; of a tileset all that lies beside it."""
    paths: list[Path] = []
    for path in files:
        beside = path.parent.rglob("*") if path.name == "tileset.json" else [path]
        paths += [file for file in beside if file.is_file()]
    return sorted({path.relative_to(folder).as_posix() for path in paths} - {MANIFEST})


def entry_of(path: Path) -> Entry:
    """Size and checksum of a file; of a GeoPackage also that of all that follows the header of SQLite, which
    a program changes that only shows the file."""
    with path.open("rb") as file:
        entry = {"size": path.stat().st_size, "sha256": hashlib.file_digest(file, "sha256").hexdigest()}
        entry["modified"] = path.stat().st_mtime_ns
        if path.suffix == ".gpkg":
            file.seek(SQLITE_HEADER)
            entry["content"] = hashlib.file_digest(file, "sha256").hexdigest()
        return entry


def current_entry(path: Path, entry: Entry | None) -> Entry:
    """The entry of a file as it is: the one that is there, where size and time say that it holds."""
    status = path.stat()
    if entry and (entry["size"], entry.get("modified")) == (status.st_size, status.st_mtime_ns):
        return entry
    return whole_entry(path)


def whole_entry(path: Path) -> Entry:
    """The entry of a file; of a GeoPackage with its `tables`."""
    tables = {"tables": tables_of(path)} if path.suffix == ".gpkg" else {}
    return {**entry_of(path), **tables}


def is_changed(path: Path, entry: Entry) -> bool:
    """True if what bears a name differs from its entry."""
    log_of_changes = path.with_name(f"{path.name}-wal")  # of a GeoPackage that is open elsewhere
    if not path.is_file() or path.stat().st_size != entry["size"]:
        return True
    if log_of_changes.exists() and log_of_changes.stat().st_size:
        return True
    if path.stat().st_mtime_ns == entry.get("modified"):
        return False
    now, mark = entry_of(path), "content" if "content" in entry else "sha256"
    return bool(now.get(mark) != entry[mark])


def changed_files(folder: Path) -> Iterator[Path]:
    """The files that runs wrote into a folder and somebody changed since."""
    for name, entry in sorted(known_files(folder).items()):
        path = folder / name
        if entry and os.path.lexists(path) and is_changed(path, entry):
            yield path


def remove_own(path: Path, entry: Entry) -> None:
    """Remove a file that a run wrote, if nobody has changed it; its folder, when it is then empty."""
    if not path.is_file():
        return
    if entry and is_changed(path, entry):
        log.warning("%s: an earlier run wrote it and it was changed since; it is left there", path)
        return
    path.unlink()
    folder = path.parent
    while not (folder / MANIFEST).exists() and not any(folder.iterdir()):
        folder.rmdir()
        folder = folder.parent


def read_manifest(folder: Path) -> dict[str, Any]:
    """The contents of a folder's manifest.

    Raises
    ------
    InputError
        When there is none, or it is damaged.
    """
    content = read_words(folder)
    path, files = folder / MANIFEST, content.get("written")
    if not content:
        raise InputError.about(folder, f"holds no {MANIFEST}", "give the folder of a run")
    if files is None:
        raise InputError.about(path, "is of a version of eaves that listed no files in it", "build again")
    if not isinstance(files, dict) or not all(map(is_inside_folder, files)):
        raise InputError.about(path, "is damaged: it lists no files of this folder", "run again")
    if not all(isinstance(entry, dict) for entry in files.values()):
        raise InputError.about(path, "is damaged: its entries say nothing of the files", "run again")
    return {"complete": False, **content}


def read_facts(folder: Path) -> dict[str, Any]:
    """Facts that a run recorded of itself: run.json without its manifest; empty where there is none."""
    return {name: fact for name, fact in read_words(folder).items() if name not in ("complete", "written")}


def read_words(folder: Path) -> dict[str, Any]:
    """All of run.json; nothing where there is none."""
    path = folder / MANIFEST
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    except (ValueError, RecursionError):
        content = None
    if not isinstance(content, dict):
        raise InputError.about(path, "is damaged", "run again")
    return content


def files_of_run(folder: Path, name: str) -> list[Path]:
    """The files of a name that a run wrote into a folder, by its manifest.

    Raises
    ------
    InputError
        When the folder holds no run's results.
    """
    names = sorted(read_manifest(folder)["written"])
    return [folder / written for written in names if PurePosixPath(written).name == name]


def is_inside_folder(name: str) -> bool:
    """True if a name cannot lead out of the folder."""
    parts = PurePosixPath(name).parts
    return bool(parts) and ".." not in parts and not name.startswith("/") and not set(name) & set("\\:\0")


def known_files(folder: Path) -> dict[str, Entry]:
    """The files that earlier runs wrote here; none, with a warning, when the manifest is damaged."""
    return dict(known_facts(folder).get("written", {}))


def known_facts(folder: Path) -> dict[str, Any]:
    """Facts that earlier runs recorded here; empty, with a warning, when the manifest is damaged."""
    try:
        return read_manifest(folder) if (folder / MANIFEST).exists() else {}
    except InputError as error:
        log.warning("%s; what earlier runs left is not removed", error)
        return {}


def write_manifest(
    folder: Path, facts: Mapping[str, Any], files: Mapping[str, Entry], complete: bool
) -> None:
    """Write run.json, whole or not at all."""
    content = {"version": eaves.__version__, **facts, "complete": complete, "written": files}
    with atomic(folder / MANIFEST) as temporary:
        temporary.write_text(json.dumps(content, indent=2, allow_nan=False), encoding="utf-8")


def check_folder(folder: str | Path) -> list[str]:
    """The defects of the results in a folder, a line each; none for a whole run's.

    Checked are that the run ended and left nothing out, and that each file it wrote is there with the size
    and the checksum it had. Files that no run wrote are no matter.

    Raises
    ------
    InputError
        When the folder holds no run's results.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope, write_simulation
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> results = eaves.build(write_simulation(truth, "nine")["points"], "out", jobs=1)
    >>> from eaves.run.manifest import check_folder
    >>> check_folder("out")
    []
    """
    folder = Path(folder)
    content = read_manifest(folder)
    wrong = []
    if content.get("complete") is not True:
        wrong.append(
            f"{folder / MANIFEST}: the run did not end, or left something out; run again with --resume"
        )
    for name, entry in content["written"].items():
        path = folder / name
        if not path.is_file():
            wrong.append(f"{path}: is missing")
        elif not entry:
            wrong.append(f"{path}: belongs to a run that did not end")
        elif path.stat().st_size != entry.get("size"):
            wrong.append(f"{path}: has {path.stat().st_size} bytes, the run wrote {entry.get('size')}")
        elif entry_of(path)["sha256"] != entry.get("sha256"):
            wrong.append(f"{path}: is not what the run wrote")
    return wrong
