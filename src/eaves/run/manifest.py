"""Manifest of the files of a run: by it a rerun removes its own old files only, and anyone can check them.

What a person changed or added since is found by it before a run writes over it: moved aside, never deleted.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import sqlite3
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from datetime import datetime
from getpass import getuser
from itertools import count
from pathlib import Path, PurePosixPath
from platform import node
from typing import Any

from filelock import FileLock, Timeout

import eaves
from eaves.formats import InputError
from eaves.formats.whole_files import atomic, clear_leftovers

log = logging.getLogger("eaves")

LOCK = ".eaves-lock"


@contextmanager
def lock_folder(folder: Path, name: str = LOCK, wait: float = 0.0) -> Iterator[None]:
    """Hold an output folder, which exists, for this process until the block ends.

    The system holds the lock and frees it with the process, however that ends: a file that a killed run left
    is no lock.

    Parameters
    ----------
    folder
        The output folder.
    name
        The lock file's name.
    wait
        Seconds in which whoever holds it may end.

    Raises
    ------
    InputError
        When another run, or another thread of this one, holds the folder.

    Examples
    --------
    >>> from pathlib import Path
    >>> from eaves.run.manifest import lock_folder
    >>> with lock_folder(Path(".")):
    ...     Path(".eaves-lock").exists()
    True
    """
    lock, note = FileLock(folder / name, timeout=wait), folder / f"{name}-by"
    try:
        lock.acquire()
    except Timeout:
        by = ""
        with suppress(OSError):
            by = f" ({note.read_text(encoding='utf-8')})"
        raise InputError.about(
            folder,
            f"another run is writing here and holds {name}{by}",
            "wait for it, or choose another folder",
        ) from None
    try:
        with suppress(OSError, KeyError):  # a system may not know who we are
            since = f"{datetime.now():%H:%M}"
            note.write_text(
                f"{getuser()} on {node()}, process {os.getpid()}, since {since}", encoding="utf-8"
            )
        yield
    finally:
        with suppress(OSError):  # while it is held, so that no other run has just taken it
            note.unlink()
            (folder / name).unlink()
        lock.release()


ADDING_S = 10.0
"""Seconds for which files of a finished run wait while others are added to its manifest: far more than that
takes."""
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
    """Write down files made after the run, where it has a manifest that no other run is writing."""
    if (folder / MANIFEST).exists():
        entries = {name: whole_entry(folder / name) for name in names_of(folder, files)}
        with lock_folder(folder, wait=ADDING_S):
            content = read_manifest(folder)
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


FORMAT_TABLES = ("gpkg_", "rtree_", "sqlite_")
"""Starts of the names of tables that are the format's, which programs change that only show a layer."""
ROWS_AT_A_TIME = 1000
DIGITS = 8
"""Of a column's checksum: it tells a change from none, and is no proof."""

Tables = Mapping[str, Mapping[str, Any]]
"""Table → `rows`, their number, and `columns`: name → checksum of its values."""


def tables_of(path: Path) -> Tables:
    """The layers and tables of a GeoPackage; none of a file that is no database."""
    try:
        with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)) as database:
            names = database.execute("SELECT name FROM sqlite_master WHERE type = 'table' ORDER BY name")
            return {
                name: table_of(database, name)
                for (name,) in names.fetchall()
                if not name.startswith(FORMAT_TABLES)
            }
    except sqlite3.Error:
        return {}


def table_of(database: sqlite3.Connection, name: str) -> dict[str, Any]:
    """Rows and columns of a table, piece by piece."""
    cursor = database.execute('SELECT * FROM "{}"'.format(name.replace('"', '""')))
    sums, rows = {column[0]: hashlib.sha256() for column in cursor.description}, 0
    while piece := cursor.fetchmany(ROWS_AT_A_TIME):
        rows += len(piece)
        for total, values in zip(sums.values(), zip(*piece, strict=True), strict=True):
            total.update(repr(values).encode())
    return {"rows": rows, "columns": {column: total.hexdigest()[:DIGITS] for column, total in sums.items()}}


def changes_between(before: Tables, now: Tables) -> Iterator[str]:
    """What is another in some tables: tables, columns, rows or values."""
    yield from (f"{name} is new" for name in sorted(now.keys() - before.keys()))
    yield from (f"{name} is gone" for name in sorted(before.keys() - now.keys()))
    for name in sorted(before.keys() & now.keys()):
        old, new = before[name]["columns"], now[name]["columns"]
        yield from (f"{name}.{column} is new" for column in sorted(new.keys() - old.keys()))
        yield from (f"{name}.{column} is gone" for column in sorted(old.keys() - new.keys()))
        if before[name]["rows"] != now[name]["rows"]:
            yield f"{name} has {now[name]['rows']:,} rows, not {before[name]['rows']:,}"
        else:
            differing = sorted(column for column in old.keys() & new.keys() if old[column] != new[column])
            yield from (f"{name}.{column} has other values" for column in differing)


BEFORE = "before-"
"""Start of the name of a folder of what was moved aside."""
CHANGED, FOREIGN = "was changed since a run wrote it", "was not written by eaves"
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
