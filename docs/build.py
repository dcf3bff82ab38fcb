"""Writes the generated pages: `make docs`, or `python -m docs.build`; `--check` lists what is out of date.

docs/reference/ is made from the registry, the docstrings and references.bib, the classes in
docs/conventions.md and the stages in docs/errors.md from the code, the list of tables in docs/results.md and
the figures of docs/sources from benchmarks/results, the galleries in docs/README.md from docs/gallery.
All else under docs/ is written by hand. Pictures: `python -m docs.pictures`.
"""

from __future__ import annotations

import sys
from pathlib import Path

from docs.api_page import api_pages
from docs.code_tables import conventions_page, errors_page
from docs.columns_page import columns_page
from docs.method_pages import method_index, method_page
from docs.results_page import results_page
from docs.source_pages import source_page
from docs.steps_page import steps_page

from eaves.methods import REGISTRY, methods_of
from eaves.recipe.recipe import sources

DOCS = Path(__file__).parent
RESULTS = DOCS.parent / "benchmarks" / "results"


def reference_pages() -> dict[Path, str]:
    """File (under docs/) → text of every page that the code alone decides."""
    pages = {
        Path("columns.md"): columns_page(),
        Path("develop/steps.md"): steps_page(),
        Path("reference/methods/README.md"): method_index(),
        **{Path("reference/api") / name: text for name, text in api_pages().items()},
    }
    for name, page in (("conventions.md", conventions_page), ("errors.md", errors_page)):
        pages[Path(name)] = page((DOCS / name).read_text(encoding="utf-8"))
    for name in ("README", *sources()):
        path = Path(f"sources/{name}.md")
        pages[path] = source_page((DOCS / path).read_text(encoding="utf-8"), name, RESULTS)
    for stage, names in ((stage, methods_of(stage)) for stage in REGISTRY):
        for name in names:
            pages[Path(f"reference/methods/{stage}-{name}.md")] = method_page(stage, name, DOCS)
    return pages


def outdated() -> list[Path]:
    """Pages that differ from the code, and pages of methods that are gone."""
    pages = reference_pages()
    wrong = [path for path, text in pages.items() if read(DOCS / path) != text]
    there = {path.relative_to(DOCS) for path in (DOCS / "reference").rglob("*.md")}
    return sorted([*wrong, *(there - set(pages))])


def read(path: Path) -> str | None:
    """The text of a file, None where there is none."""
    return path.read_text(encoding="utf-8") if path.exists() else None


def index_page() -> str:
    """docs/README.md with its list of galleries: the title of every page in docs/gallery."""
    text = (DOCS / "README.md").read_text(encoding="utf-8")
    before, _, rest = text.partition("## Galleries\n")
    after = rest[rest.index("`make docs`") :]
    pages = sorted((DOCS / "gallery").glob("*.md"))
    titles = [page.read_text(encoding="utf-8").splitlines()[0].lstrip("# ") for page in pages]
    links = [f"- [{title}](gallery/{page.name})" for title, page in zip(titles, pages, strict=True)]
    return f"{before}## Galleries\n" + "\n".join(links) + f"\n\n{after}"


def main() -> int:
    """Write the pages, or check them."""
    if "--check" in sys.argv[1:]:
        wrong = outdated()
        sys.stdout.writelines(f"docs/{path.as_posix()} is out of date; run make docs\n" for path in wrong)
        return int(bool(wrong))
    pages = reference_pages() | {Path("README.md"): index_page()}
    pages[Path("results.md")] = results_page((DOCS / "results.md").read_text(encoding="utf-8"), RESULTS)
    for path in outdated():
        if path not in pages:
            (DOCS / path).unlink()
    for path, text in pages.items():
        (DOCS / path).parent.mkdir(parents=True, exist_ok=True)
        (DOCS / path).write_text(text, encoding="utf-8", newline="\n")
    sys.stdout.write(f"{len(pages)} pages written\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
