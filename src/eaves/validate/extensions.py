"""Files that define extensions of CityJSON (section 8 of the standard)."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from referencing import Resource
from referencing.jsonschema import DRAFT7

from eaves.formats import InputError
from eaves.validate.cityjson_schema import EXTENSION, SCHEMAS, breaks

OWN = "urn:extension"
"""Address of an extension's own file among the schemas."""


@dataclass(frozen=True)
class Extension:
    """The additions of an extension, as a file declares them.

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
        """Its additions to a part (`extraCityObjects`, `extraAttributes/Building`): schemas by name."""
        found: Any = self.document
        for step in part.split("/"):
            found = found.get(step, {})
        return dict(found)

    def breaks(self, value: Any, part: str, added: str) -> Iterator[str]:
        """The breaks, by a value, of the schema that it adds to a part under a name."""
        place = "/".join(step.replace("~", "~0").replace("/", "~1") for step in (*part.split("/"), added))
        known = SCHEMAS.with_resource(
            OWN, Resource.from_contents(dict(self.document), default_specification=DRAFT7)
        )
        return breaks(value, {"$ref": f"{OWN}#/{place}"}, known)


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
    for broken in breaks(document, EXTENSION, SCHEMAS):
        raise InputError.about(path, f"defines no extension: {broken}", remedy)
    return Extension(Path(path), document)
