"""Whether a value of JSON is as a JSON schema (draft 7) says: the library jsonschema, in short phrases."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from jsonschema import Draft7Validator
from jsonschema.exceptions import SchemaError, UnknownType
from referencing import Registry, Resource
from referencing.exceptions import Unresolvable
from referencing.jsonschema import DRAFT7

Schema = Mapping[str, Any]
LONGEST = 40
"""Characters of a value in a message: no more than a line holds."""


def registry_of(shapes: Schema) -> Registry[Any]:
    """A registry in which the fragment of any address names one of the `shapes`: `x.schema.json#/Solid`."""
    whole = {**shapes, "definitions": shapes}
    return Registry(  # type: ignore[call-arg] # an attrs class
        retrieve=lambda address: Resource.from_contents(whole, default_specification=DRAFT7)
    )


def breaks(value: Any, schema: Schema | bool, registry: Registry[Any] | None = None) -> Iterator[str]:
    """The breaks of a schema by a value, a phrase each that begins with the place.

    Parameters
    ----------
    value : object
        What `json` reads.
    schema : mapping or bool
        The schema; true allows all, false nothing.
    registry : Registry or None
        Documents that a `$ref` may name (`registry_of`).

    Raises
    ------
    ValueError
        When the schema leads round in a circle, names what does not exist, or is none.
    """
    validator = Draft7Validator(schema, registry=Registry() if registry is None else registry)
    try:
        for error in validator.iter_errors(value):
            place = "".join(
                f"[{step}]" if isinstance(step, int) else f".{step}" for step in error.absolute_path
            )
            text = repr(error.instance)
            shown = text if len(text) < LONGEST else f"{text[: LONGEST - 4]}…"
            yield f"{place.lstrip('.') or 'it'}: {error.message.replace(text, shown)}"
    except RecursionError:
        raise ValueError("a schema refers to itself without end") from None
    except (Unresolvable, SchemaError, UnknownType, TypeError, re.error) as error:
        raise ValueError(f"the schema cannot be followed: {str(error).splitlines()[0]}") from None
