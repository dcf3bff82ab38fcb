"""How any input is hurt: bytes anywhere, words of a text, and the place it should be in."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path

Mutate = Callable[[bytes, random.Random], bytes]
STRANGE = ("1e400", "-1e308", "NaN", "null", "[]", "{}", '""', "9" * 20, "-1", "true", "", ",")
"""What texts get in place of a word."""
HEAD_BYTES = 900
"""Headers, records and the first chunk's beginning, where damage does most."""
INTERESTING = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF)
ODD_SHARE = 0.03
"""So many inputs are not a hurt file but none, a folder, another kind of file, or twice the file."""


def hurt_bytes(data: bytes, chance: random.Random) -> bytes:
    """One to six places changed, cut, repeated, blanked or swapped; every other time near the beginning."""
    changed = bytearray(data)
    reach = min(len(changed), HEAD_BYTES) if chance.random() < 0.5 else len(changed)
    for _ in range(chance.choice((1, 1, 1, 2, 4, 6))):
        if not changed:
            break
        place, act = chance.randrange(min(reach, len(changed))), chance.random()
        if act < 0.35:
            changed[place] = chance.randrange(256)
        elif act < 0.5:
            changed[place] ^= 1 << chance.randrange(8)
        elif act < 0.7:
            width = chance.choice((1, 2, 4, 8))
            value = chance.choice(INTERESTING) & ((1 << 8 * width) - 1)
            changed[place : place + width] = value.to_bytes(width, "little")
        elif act < 0.78:
            del changed[place:]
        elif act < 0.86:
            source = chance.randrange(len(changed))
            changed[place:place] = changed[source : source + chance.randrange(1, 200)]
        elif act < 0.93:
            changed[place : place + chance.randrange(1, 200)] = bytes(chance.randrange(1, 200))
        else:
            source = chance.randrange(len(changed))
            part = bytes(changed[source : source + 64])
            changed[place : place + len(part)] = part
    return bytes(changed)


def hurt_words(data: bytes, chance: random.Random) -> bytes:
    """Numbers, names and brackets of a text exchanged for others; one time in four, bytes."""
    if chance.random() < 0.25:
        return hurt_bytes(data, chance)
    text = data.decode("utf-8", "replace")
    for _ in range(chance.choice((1, 1, 2, 3))):
        places = [at for at, letter in enumerate(text) if letter in ',:[]{}"\n ']
        if len(places) < 2:
            break
        at = chance.randrange(len(places) - 1)
        first, last = places[at], places[min(at + chance.choice((1, 1, 2)), len(places) - 1)]
        text = text[: first + 1] + chance.choice(STRANGE) + text[last:]
    return text.encode("utf-8")


def either(share: float, one: Mutate, other: Mutate) -> Mutate:
    """The first way of hurting in so large a share of the inputs, the second in the others."""
    return lambda data, chance: (one if chance.random() < share else other)(data, chance)


def put_hurt(path: Path, data: bytes, mutate: Mutate, others: list[Path], chance: random.Random) -> None:
    """Write a hurt input to `path`; now and then something that no mutation of the file gives."""
    if chance.random() >= ODD_SHARE:
        path.write_bytes(mutate(data, chance))
        return
    act = chance.randrange(6)
    if act == 0:
        path.write_bytes(b"")
    elif act == 1:
        path.mkdir()
        (path / path.name).write_bytes(data[: chance.choice((0, 100, len(data)))])
    elif act == 2:
        path.symlink_to(path.with_name("nothing"))
    elif act == 3:
        path.write_bytes(chance.choice(others).read_bytes())
    elif act == 4:
        path.write_bytes(data + data)
    else:
        path.write_bytes(chance.randbytes(chance.choice((1, 226, 4096, 100_000))))
