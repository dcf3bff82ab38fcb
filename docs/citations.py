"""Citations in words, from references.bib."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

BIBLIOGRAPHY = Path(__file__).parent.parent / "references.bib"
VALUE = re.compile(r"(\w+)\s*=\s*\{((?:[^{}]|\{(?:[^{}]|\{[^{}]*\})*\})*)\}")


@cache
def entries() -> dict[str, dict[str, str]]:
    """Key → field → value of every entry."""
    pieces = re.split(r"^@\w+\{", BIBLIOGRAPHY.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    found = {}
    for piece in pieces:
        key, _, rest = piece.partition(",")
        fields = {name.lower(): re.sub(r"[{}]", "", value) for name, value in VALUE.findall(rest)}
        found[key.strip()] = {
            name: " ".join(value.replace("--", "–").split()) for name, value in fields.items()
        }
    return found


def citation(key: str) -> str:
    """An entry as one line: authors, year, title, where, link."""
    fields = entries()[key]
    authors = fields.get("author", fields.get("organization", "")).replace(" and ", "; ")
    homes = ("journal", "booktitle", "howpublished", "publisher")
    where = next((fields[name] for name in homes if name in fields), "")
    volume = fields.get("volume", "") + (f"({fields['number']})" if "number" in fields else "")
    pages = f"pp. {fields['pages']}" if "pages" in fields else ""
    place = ", ".join(part for part in (where, volume, pages) if part)
    link = f"https://doi.org/{fields['doi']}" if "doi" in fields else fields.get("url", "")
    parts = [" ".join(part for part in (authors, f"({fields['year']})" if "year" in fields else "") if part)]
    parts += [fields.get("title", ""), place, link]
    return f"*{key}*: " + ". ".join(part for part in parts if part)
