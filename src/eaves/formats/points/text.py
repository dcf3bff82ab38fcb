"""Points of text files: x y z [label] on every line."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from shlex import quote
from typing import TextIO

import numpy as np

from eaves.formats.errors import InputError
from eaves.formats.points.chunk import Chunk

LONGEST_LINE = 4096
SEPARATORS = (";", ",", "\t", None)
LABEL_NAMES = ("label", "class", "classification")
LABELLED_COLUMNS = 4
"""Without names, the fourth column is a label only when it is the last: of x y z r g b it is a colour."""


@dataclass(frozen=True)
class TextLayout:
    """Layout of a file's lines: separator, columns of x, y, z and of the label, lines before the first
    point."""

    path: Path
    separator: str | None
    columns: tuple[int, int, int]
    label: int | None
    skip: int


UNPACK = {b"PK\x03\x04": "unzip -j {} -d tiles", b"\x1f\x8b": "gunzip -k {}"}
"""Archives by their first bytes, and the command that unpacks one."""


def read_text_layout(path: Path) -> TextLayout:
    """The layout, from the first line of numbers and the line of names before it.

    Raises
    ------
    InputError
        When there is no line of at least three numbers.
    """
    with path.open("rb") as packed:
        head = packed.read(4)
    for mark, command in UNPACK.items():
        if head.startswith(mark):
            command = "tar -xzf {}" if ".tar" in path.suffixes or path.suffix == ".tgz" else command
            raise InputError.about(
                path, "is an archive", f"unpack it and give the files: {command.format(quote(str(path)))}"
            )
    names: list[str] = []
    try:
        with path.open(encoding="utf-8-sig") as file:
            for number, line in enumerate(_split_lines(file, path)):
                content = line.split("#")[0].strip()
                separator = next(mark for mark in SEPARATORS if mark is None or mark in content)
                words = [word.strip().strip('"') for word in content.split(separator)] if content else []
                if len(words) >= 3 and all(_is_decimal(word) for word in words[:3]):
                    return _text_layout(path, separator, [name.lower() for name in names], len(words), number)
                if words and names:
                    break
                names = words or names
    except UnicodeDecodeError:
        raise InputError.about(
            path, "is neither LAS nor text", "give LAS, LAZ, COPC or lines of x y z"
        ) from None
    raise InputError.about(path, "has no line of three numbers", "give lines of x y z or x y z label")


def iter_text(layout: TextLayout, size: int) -> Iterator[Chunk]:
    """Chunks of `size` points in the file's order; NaN where a line has it.

    Raises
    ------
    InputError
        At the first line that is not numbers.
    """
    columns = layout.columns if layout.label is None else (*layout.columns, layout.label)
    first, line_number = 0, layout.skip
    with layout.path.open(encoding="utf-8-sig") as file:
        lines = _split_lines(file, layout.path)
        for _ in islice(lines, layout.skip):
            pass
        while batch := list(islice(lines, size)):
            used = [line for line in batch if line.strip() and not line.lstrip().startswith("#")]
            if used:
                values = _parsed_numbers(layout, used, columns, line_number)
                label = None
                if layout.label is not None:
                    label = np.clip(np.nan_to_num(values[:, 3]), 0, 255).astype(np.uint8)
                position = np.arange(first, first + len(values))
                yield Chunk(np.ascontiguousarray(values[:, :3]), position, classification=label)
                first += len(values)
            line_number += len(batch)


def _parsed_numbers(
    layout: TextLayout, lines: list[str], columns: tuple[int, ...], before: int
) -> np.ndarray:
    try:
        return np.loadtxt(lines, delimiter=layout.separator, usecols=columns, ndmin=2, comments="#")
    except ValueError as error:
        raise InputError.about(
            layout.path, f"after line {before}: {error}", "every line must be numbers: x y z [label]"
        ) from None


def _text_layout(path: Path, separator: str | None, names: list[str], width: int, skip: int) -> TextLayout:
    if {"x", "y", "z"} <= set(names):
        label = next((names.index(name) for name in LABEL_NAMES if name in names), None)
        return TextLayout(
            path, separator, (names.index("x"), names.index("y"), names.index("z")), label, skip
        )
    return TextLayout(path, separator, (0, 1, 2), 3 if width == LABELLED_COLUMNS else None, skip)


def _split_lines(file: TextIO, path: Path) -> Iterator[str]:
    while line := file.readline(LONGEST_LINE):
        if len(line) == LONGEST_LINE:
            raise InputError.about(
                path, f"has a line of more than {LONGEST_LINE} characters", "give lines of x y z"
            )
        yield line


def _is_decimal(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
