"""How LAS, LAZ and COPC files are hurt by one who knows them: extreme fields, cuts at borders."""

from __future__ import annotations

import random
import struct
from dataclasses import dataclass

WHOLE_NUMBERS = (0, 1, 2, 7, 19, 255, 1000, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**63, 2**64 - 1)
REALS = (0.0, -0.0, 5e-324, 1e-300, 1e-9, 1.0, -1.0, 180.0, 1e6, 1e9, 1e18, 1e300, -1e300)
NOT_REALS = (float("nan"), float("inf"), float("-inf"))
HEADER = (
    *(("<B", place) for place in (24, 25, 104)),
    *(("<H", place) for place in (6, 94, 105)),
    *(("<I", place) for place in (96, 100, 107, 111, 115)),
    *(("<d", place) for place in range(131, 227, 8)),
)
"""Version, format and its flags; encoding, header and record length; offset to points, records, counts;
scales, offsets and box (LAS 1.2, table 3)."""
HEADER_OF_4 = (("<Q", 227), ("<Q", 235), ("<I", 243), ("<Q", 247), ("<Q", 255))
"""Waveforms, extended records and their number, points, points of the first return (LAS 1.4, table 3)."""
LASZIP = (*(("<H", place) for place in (0, 2, 32, 34, 36, 38)), ("<I", 4), ("<I", 12), ("<q", 16), ("<q", 24))
COPC = (*(("<d", 8 * k) for k in range(5)), ("<Q", 40), ("<Q", 48), ("<d", 56), ("<d", 64))
HIERARCHY_ENTRY = (*(("<i", 4 * k) for k in range(4)), ("<Q", 16), ("<i", 24), ("<i", 28))

Field = tuple[str, int]
"""Its form and its place."""


@dataclass(frozen=True)
class Anatomy:
    """Where the fields of a whole file are, and the borders between its parts."""

    fields: tuple[tuple[Field, ...], ...]
    """By part, so that the few fields of a small one are hurt as often as the many of another."""
    borders: tuple[int, ...]


def hurt_points(data: bytes, chance: random.Random) -> bytes:
    """A file cut at or beside a border, or with one to three fields that lie."""
    anatomy, changed = dissect(data), bytearray(data)
    if chance.random() < 0.2:
        place = chance.choice(anatomy.borders) + chance.choice((-1, 0, 0, 1))
        return data[: max(0, place)]
    for _ in range(chance.choice((1, 1, 2, 3))):
        form, place = chance.choice(chance.choice(anatomy.fields))
        if place + struct.calcsize(form) <= len(changed):
            struct.pack_into(form, changed, place, lie(form, changed, place, chance))
    return bytes(changed)


def lie(form: str, data: bytearray, place: int, chance: random.Random) -> float:
    """Another value for a field: an extreme, or one near its own."""
    own = struct.unpack_from(form, data, place)[0]
    if form == "<d":
        near = (own + 1, own - 1, -own, own * 1000, own / 1000)
        return float(chance.choice((*REALS, *NOT_REALS, *near)))
    bits = 8 * struct.calcsize(form)
    value = chance.choice((*WHOLE_NUMBERS, own + 1, own - 1, 2 * own, own // 2, len(data), -1)) % (1 << bits)
    return value - (1 << bits) if form in ("<i", "<q") and value >> (bits - 1) else value


def dissect(data: bytes) -> Anatomy:
    """The anatomy of a whole LAS, LAZ or COPC file."""
    header, points, number = struct.unpack_from("<HII", data, 94)
    minor, compressed = data[25], bool(data[104] & 0xC0)
    fields: list[tuple[Field, ...]] = [HEADER, HEADER] + ([HEADER_OF_4] if minor >= 4 else [])
    borders, start = [4, 100, 226, 227, header], header
    for _ in range(number):
        owner, length = (
            data[start + 2 : start + 18].rstrip(b"\0"),
            struct.unpack_from("<H", data, start + 20)[0],
        )
        inside = start + 54
        fields.append((("<B", start + 2), ("<H", start + 18), ("<H", start + 20)))
        known = {b"laszip encoded": LASZIP, b"copc": COPC}.get(owner)
        within = known or tuple(("<H", place) for place in range(0, min(length, 64) - 1, 2))
        fields.append(tuple((form, inside + place) for form, place in within))
        borders += [start, inside, inside + length // 2, inside + length]
        if owner == b"copc":
            page, size = struct.unpack_from("<QQ", data, inside + 40)
            entries = [page + 32 * k for k in range(size // 32)]
            fields.append(
                tuple((form, entry + place) for entry in entries for form, place in HIERARCHY_ENTRY)
            )
            borders += [page, page + size // 2, page + size]
        start = inside + length
    record = struct.unpack_from("<H", data, 105)[0]
    borders += [points, points + 8, points + record, (points + len(data)) // 2, len(data)]
    if compressed:
        table = struct.unpack_from("<q", data, points)[0]
        fields += [
            (("<q", points),),
            (("<I", table), ("<I", table + 4), ("<I", table + 8), ("<B", table + 12)),
        ]
        layers = points + 8 + record
        fields.append(tuple(("<I", layers + 4 * k) for k in range(10)))
        borders += [table, table + 4, table + 8, layers, layers + 4]
    else:
        some = [points + record * k for k in range(0, (len(data) - points) // record, 50)]
        fields.append(
            tuple((form, at + place) for at in some for form, place in (("<i", 0), ("<i", 4), ("<i", 8)))
        )
    return Anatomy(tuple(part for part in fields if part), tuple(borders))
