"""Hook of mkdocs: the tables of benchmarks/results are pages of the site, and links to them lead there."""

from pathlib import Path

from mkdocs.structure.files import File

TABLES = "benchmarks/results/"


def on_files(files, config):
    root = Path(config.config_file_path).parent
    for path in sorted((root / TABLES).glob("*.md")):
        place = path.relative_to(root).as_posix()
        files.append(File(place, str(root), config.site_dir, config.use_directory_urls))
    return files


def on_page_markdown(markdown, page, config, files):
    return markdown.replace("../" + TABLES, TABLES)
