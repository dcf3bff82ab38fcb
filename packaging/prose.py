"""How the pages read: `python packaging/prose.py`, a line of `make lint` and a hook of pre-commit.

Phrases to read twice are refused in pages, help and messages; sentences of guides are short on average, and
two pages are read in minutes.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
GUIDES = sorted((DOCS / "guides").glob("*.md"))
BANNED = (
    *("out come", "not as they were", "not as it was", "by the very word", "astray", "foretell", "trodden"),
    *("goes home", "is told", "are told", "told by", "gone astray", "how they fare", "come out of it"),
    *("is of no run", "are no more", "which is no more", "gave way", "mend the file"),
)
"""Calques and riddles: what a reader has to read twice."""
WORDS_OF_A_SENTENCE = 18
"""Of a guide, on average."""
WORDS_OF_PAGES = {"README.md": 650, "docs/results.md": 1500}


def text_of(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def words_of_sentences(text: str) -> list[int]:
    """The words of each sentence, without code blocks, tables and headings; code counts as a word."""
    text = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    text = re.sub(r"!\[[^\]]*\]\([^)]*\)|\]\([^)]*\)", "", re.sub(r"`[^`\n]*`", "code", text))
    blocks = re.split(r"\n\s*\n|\n(?=[-*] |\d+\. |#|\|)", text)
    prose = [block.strip() for block in blocks if not block.strip().startswith(("#", "|"))]
    sentences = [one for block in prose for one in re.split(r"(?<=[.!?])[\"*)\]]*\s+(?=[A-Z`\[*(])", block)]
    return [count for one in sentences if (count := len(re.findall(r"[\w'’-]+", one))) > 2]


def faults() -> Iterator[str]:
    """A line for each fault."""
    pages = [ROOT / "README.md", *sorted(DOCS.glob("*.md")), *GUIDES]
    for path in [*pages, *sorted((ROOT / "src" / "eaves").rglob("*.py"))]:
        words = " ".join(text_of(path).lower().split())
        for phrase in re.findall(rf"\b(?:{'|'.join(BANNED)})\b", words):
            yield f"{path.relative_to(ROOT)}: '{phrase}' has to be read twice"
    for path in (ROOT / "README.md", DOCS / "start.md", *GUIDES):
        counts = words_of_sentences(text_of(path))
        if (mean := sum(counts) / len(counts)) > WORDS_OF_A_SENTENCE:
            yield f"{path.relative_to(ROOT)}: sentences of {mean:.1f} words, at most {WORDS_OF_A_SENTENCE}"
    for name, most in WORDS_OF_PAGES.items():
        words = len(re.sub(r"\]\((?!https?:)[^)#\s]+", "", text_of(ROOT / name)).split())
        if words > most:
            yield f"{name}: {words} words, at most {most}"


def main() -> int:
    """Print the faults; 1 if there is one."""
    found = list(faults())
    sys.stdout.writelines(f"{line}\n" for line in found)
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
