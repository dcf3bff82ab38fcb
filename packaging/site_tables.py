"""Hook of mkdocs: tables of benchmarks/results and tutorials are pages of the site, and links lead there."""

import json
import sys
from pathlib import Path

from mkdocs.structure.files import File

TABLES = "benchmarks/results/"


def on_files(files, config):
    root = Path(config.config_file_path).parent
    for path in sorted((root / TABLES).glob("*.md")):
        place = path.relative_to(root).as_posix()
        files.append(File(place, str(root), config.site_dir, config.use_directory_urls))
    sys.path.insert(0, str(root))
    from docs.notebooks import FOLDER, page_of

    for path in sorted(FOLDER.glob("*.ipynb")):
        page = page_of(json.loads(path.read_text(encoding="utf-8")))
        files.append(File.generated(config, f"tutorials/{path.stem}.md", content=page))
    return files


def on_page_markdown(markdown, page, config, files):
    return markdown.replace("../" + TABLES, TABLES).replace(".ipynb)", ".md)")
