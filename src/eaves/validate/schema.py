"""Whether a value of JSON is as a JSON schema (draft 7) says: as far as CityJSON and extensions use it."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from typing import Any

Schema = Mapping[str, Any]
KINDS: dict[str, tuple[type, ...]] = {
    "object": (dict,),
    "array": (list,),
    "string": (str,),
    "boolean": (bool,),
    "null": (type(None),),
    "integer": (int,),
    "number": (int, float),
}
UNKNOWN = frozenset(
    [
        *("if", "then", "else", "dependencies", "contains", "propertyNames", "additionalItems", "multipleOf"),
        *("$dynamicRef", "$recursiveRef", "unevaluatedProperties", "prefixItems", "dependentSchemas"),
    ]
)
"""Words of JSON schema that are not followed here: a schema that uses one is refused."""
DEEPEST = 200
"""References followed within each other: more of them lead round in a circle."""
Named = Callable[[str], Schema | bool]
"""What the name behind `$ref` stands for."""


def breaks(value: Any, schema: Schema | bool, named: Named, where: str = "", depth: int = 0) -> Iterator[str]:
    """What of a value its schema does not allow, a phrase each, that begins with the place.

    Parameters
    ----------
    value : object
        What `json` reads.
    schema : mapping or bool
        The schema; true allows all, false nothing.
    named : callable
        Gives the schema that a `$ref` names.
    where : str
        Place of the value, as the phrases write it.
    depth : int
        References followed so far.

    Raises
    ------
    ValueError
        When the schema leads round in a circle or uses a word of `UNKNOWN`.
    """
    if isinstance(schema, bool):
        if not schema:
            yield f"{where or 'it'} must not be there"
        return
    if depth > DEEPEST:
        raise ValueError("a schema refers to itself without end")
    if strange := UNKNOWN & schema.keys():
        raise ValueError(f"{min(strange)!r} of JSON schema is not known here")
    if "$ref" in schema:  # what stands beside it counts for nothing (draft 7, section 8.3)
        yield from breaks(value, named(str(schema["$ref"])), named, where, depth + 1)
        return
    kinds = schema.get("type")
    if kinds is not None:
        wanted = [kinds] if isinstance(kinds, str) else list(kinds)
        if not any(is_kind(value, kind) for kind in wanted):
            yield f"{where or 'it'} is no {' or '.join(wanted)}"
            return
    if "const" in schema and not same(value, schema["const"]):
        yield f"{where or 'it'} is not {schema['const']!r}"
    if "enum" in schema and not any(same(value, one) for one in schema["enum"]):
        yield f"{where or 'it'} is {shown(value)}, not one of {', '.join(map(repr, schema['enum']))}"
    if isinstance(value, dict):
        yield from breaks_of_object(value, schema, named, where, depth)
    elif isinstance(value, list):
        yield from breaks_of_list(value, schema, named, where, depth)
    elif isinstance(value, str):
        yield from breaks_of_text(value, schema, where)
    elif is_kind(value, "number"):
        yield from breaks_of_number(value, schema, where)
    yield from breaks_of_choice(value, schema, named, where, depth)


def is_kind(value: Any, kind: str) -> bool:
    """Whether a value is of one of JSON's kinds; true and false are no numbers, 1.0 is an integer."""
    if kind in ("integer", "number") and isinstance(value, bool):
        return False
    whole = kind == "integer" and isinstance(value, float) and value.is_integer()
    return whole or isinstance(value, KINDS.get(kind, ()))


def same(one: Any, other: Any) -> bool:
    """Whether two values are equal in JSON, where true is not 1."""
    return bool(one == other) and isinstance(one, bool) == isinstance(other, bool)


def shown(value: Any) -> str:
    """A value in a message: not longer than a line holds."""
    text = repr(value)
    return text if len(text) < 40 else f"{text[:36]}…"


def place(where: str, key: str | int) -> str:
    """The place of a member."""
    return f"{where}[{key}]" if isinstance(key, int) else f"{where}.{key}" if where else key


def breaks_of_object(
    value: dict[str, Any], schema: Schema, named: Named, where: str, depth: int
) -> Iterator[str]:
    """What of its members an object's schema does not allow."""
    for name in schema.get("required", ()):
        if name not in value:
            yield f"{where or 'it'} has no {name}"
    known, patterns = schema.get("properties", {}), schema.get("patternProperties", {})
    others = schema.get("additionalProperties", True)
    for name, member in value.items():
        mine = [known[name]] if name in known else []
        mine += [one for pattern, one in patterns.items() if compiled(pattern).search(name)]
        if not mine and others is False:
            yield f"{where or 'it'} has a member {shown(name)}, which is not known"
        for one in mine or ([] if isinstance(others, bool) else [others]):
            yield from breaks(member, one, named, place(where, name), depth)
    if not schema.get("minProperties", 0) <= len(value) <= schema.get("maxProperties", len(value)):
        yield f"{where or 'it'} has {len(value)} members"


def breaks_of_list(value: list[Any], schema: Schema, named: Named, where: str, depth: int) -> Iterator[str]:
    """What of its items a list's schema does not allow."""
    if not schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", len(value)):
        yield f"{where or 'it'} has {len(value)} items"
    if schema.get("uniqueItems") and len({repr(one) for one in value}) < len(value):
        yield f"{where or 'it'} has equal items"
    items = schema.get("items")
    if isinstance(items, list):
        for number, (item, one) in enumerate(zip(value, items, strict=False)):
            yield from breaks(item, one, named, place(where, number), depth)
    elif items is not None:
        plain = (
            KINDS.get(items.get("type")) if len(items) == 1 and isinstance(items.get("type"), str) else None
        )
        if plain is not None and all(type(item) in plain for item in value):
            return  # as nearly all lists of numbers are
        for number, item in enumerate(value):
            yield from breaks(item, items, named, place(where, number), depth)


def breaks_of_text(value: str, schema: Schema, where: str) -> Iterator[str]:
    """What a text's schema does not allow."""
    if "pattern" in schema and not compiled(schema["pattern"]).search(value):
        yield f"{where or 'it'} is {shown(value)}, not of the form {schema['pattern']}"
    if not schema.get("minLength", 0) <= len(value) <= schema.get("maxLength", len(value)):
        yield f"{where or 'it'} has {len(value)} characters"


def breaks_of_number(value: float, schema: Schema, where: str) -> Iterator[str]:
    """What a number's schema does not allow."""
    low, high = schema.get("minimum", value), schema.get("maximum", value)
    over, under = schema.get("exclusiveMinimum"), schema.get("exclusiveMaximum")
    if (
        not low <= value <= high
        or (over is not None and value <= over)
        or (under is not None and value >= under)
    ):
        yield f"{where or 'it'} is {shown(value)}, out of its range"


def breaks_of_choice(value: Any, schema: Schema, named: Named, where: str, depth: int) -> Iterator[str]:
    """What the combined schemas do not allow."""
    for one in schema.get("allOf", ()):
        yield from breaks(value, one, named, where, depth + 1)
    for word, least, most in (("anyOf", 1, None), ("oneOf", 1, 1)):
        if word in schema:
            count = sum(not any(breaks(value, one, named, where, depth + 1)) for one in schema[word])
            if count < least or (most is not None and count > most):
                yield f"{where or 'it'} is none of the {len(schema[word])} things it may be"
    if "not" in schema and not any(breaks(value, schema["not"], named, where, depth + 1)):
        yield f"{where or 'it'} is what it must not be, or must not be there"


@lru_cache(maxsize=256)
def compiled(pattern: str) -> re.Pattern[str]:
    """A pattern, compiled; ValueError for one that is none."""
    try:
        return re.compile(pattern)
    except re.error as error:
        raise ValueError(f"{pattern!r} is no pattern: {error}") from None
