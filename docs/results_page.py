"""The list of tables on docs/results.md, gathered from benchmarks/results."""

from __future__ import annotations

import re
from pathlib import Path

DATED = re.compile(r"(\d{4}-\d{2}-\d{2})-(.+)\.md")
HEADING = "## Every table\n"
TOPICS = {
    "Ground": ("ground", "halls"),
    "Detection": ("detection", "unseen", "canopies"),
    "Outlines and units": ("outline", "unit", "draughtsman"),
    "Roofs": ("roof", "rotations", "superstructures", "towers"),
    "Models": ("models", "moments", "curved", "overhangs", "validity", "attributes", "trust"),
    "Published systems": ("sources",),
    "Time: changes and updates": ("change", "update"),
    "Speed and size": (
        "budget",
        "growth",
        "index",
        "read-speed",
        "start",
        "modules",
        "counts",
        "speed",
    ),
    "Robustness and other programs": (
        "readers",
        "faults",
        "hostile",
        "identical",
        "judges",
        "tools",
    ),
    "What each rule is worth": ("ablation", "half", "fewer"),
}
"""Topic → how the names of its tables begin; a table of no topic stands under `OTHER`."""
OTHER = "More"


def results_page(text: str, results: Path) -> str:
    """The page `text` with its list: the newest table of every kind, by topic, as links."""
    newest: dict[str, Path] = {}
    for path in sorted(results.glob("*.md")):
        if found := DATED.fullmatch(path.name):
            newest[found[2]] = path
    topics: dict[str, list[str]] = {topic: [] for topic in (*TOPICS, OTHER)}
    for kind, path in sorted(newest.items()):
        title = path.read_text(encoding="utf-8").splitlines()[0].lstrip("# ")
        topics[topic_of(kind)].append(f"[{title}](../benchmarks/results/{path.name})")
    lines = [f"**{topic}:** {' · '.join(links)}\n" for topic, links in topics.items() if links]
    return text.partition(HEADING)[0].rstrip() + "\n\n" + HEADING + "\n" + "\n".join(lines)


def topic_of(kind: str) -> str:
    """The topic of a kind of table."""
    return next((topic for topic, starts in TOPICS.items() if kind.startswith(starts)), OTHER)
