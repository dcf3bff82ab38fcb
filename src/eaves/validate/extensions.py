"""Files that define extensions of CityJSON (section 8 of the standard)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from eaves.formats import InputError
from eaves.validate.cityjson_schema import EXTENSION, SHAPES
from eaves.validate.schema import Schema, breaks


def named(reference: str) -> Schema | bool:
    """What a name of CityJSON's schemas stands for: the last part of a `$ref`.

    Raises
    ------
    ValueError
        When there is none.
    """
    name = reference.rpartition("/")[2]
    if name not in SHAPES:
        raise ValueError(f"{reference!r} is no part of CityJSON's schemas")
    return SHAPES[name]


@dataclass(frozen=True)
class Extension:
    """What a file says an extension adds.

    Parameters
    ----------
    path : Path
        The file.
    document : mapping
        What it holds, checked.
    """

    path: Path
    document: Mapping[str, Any]

    @property
    def name(self) -> str:
        """Its name, by which files declare it."""
        return str(self.document["name"])

    def added(self, part: str) -> Mapping[str, Any]:
        """What it adds to a part (`extraCityObjects`, `extraAttributes/Building`): schemas by name."""
        found: Any = self.document
        for step in part.split("/"):
            found = found.get(step, {})
        return dict(found)

    def named(self, reference: str) -> Schema | bool:
        """What a `$ref` of the file stands for: a part of itself or of CityJSON's schemas."""
        if not reference.startswith("#/"):
            return named(reference)
        found: Any = self.document
        for step in reference[2:].split("/"):
            found = found.get(step.replace("~1", "/").replace("~0", "~")) if isinstance(found, dict) else None
        if not isinstance(found, dict | bool):
            raise ValueError(f"{reference!r} names nothing in {self.path}")
        return found


def read_extension(path: str | Path) -> Extension:
    """The extension that a file defines.

    Raises
    ------
    InputError
        When it cannot be read, or is no definition of an extension.
    """
    remedy = "give the file that defines the extension (CityJSONExtension)"
    try:
        document = json.loads(Path(path).read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise InputError.about(path, f"cannot be read ({error.strerror})", "check the path") from None
    except (ValueError, RecursionError) as error:
        raise InputError.about(path, f"is not JSON ({error})", remedy) from None
    for broken in breaks(document, EXTENSION, named):
        raise InputError.about(path, f"defines no extension: {broken}", remedy)
    return Extension(Path(path), document)
