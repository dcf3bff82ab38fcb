"""Opening the page of a run that is there already, or the pages of two in one file, which turn together."""

from __future__ import annotations

import errno
import html
import json
import logging
import math
import re
import shutil
import tempfile
import webbrowser
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from itertools import pairwise
from pathlib import Path
from string import Template
from typing import Any, TypeAlias
from urllib.parse import unquote, urlsplit

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from eaves.formats import InputError, read_polygons
from eaves.formats.crs import describe_system, horizontal_crs
from eaves.formats.whole_files import atomic
from eaves.model import LODS, Bounds, Integers, Values
from eaves.model.summary import Summary
from eaves.report.contents import (
    BUILDINGS_SHOWN,
    POINTS_SHOWN,
    Contents,
    base_of,
    lay_image,
    middle_of,
    read_contents,
    read_terrain,
    system_of_folder,
    terrain_file,
)
from eaves.report.output import (
    as_millimetres,
    describe_terrain,
    iter_arrays,
    iter_data,
    iter_page,
    page_data,
    terrain_array,
    write_page,
)
from eaves.report.sample import Sample, classified_files, sample_points
from eaves.run.manifest import add_to_manifest, read_facts

log = logging.getLogger("eaves")

HOST = "127.0.0.1"
"""Nobody but this computer is served."""
PORT = 8017
KINDS = {".html": "text/html; charset=utf-8", ".json": "application/json"}
"""The types of all that a site is made of."""


def find_page(site: Path, address: str) -> Path | None:
    """The file of a site behind an address; None for all that is not of it, wherever it points."""
    name = unquote(urlsplit(address).path).lstrip("/") or "index.html"
    place = site.resolve()
    try:
        path = (place / name).resolve()
        return path if path.is_relative_to(place) and path.suffix in KINDS and path.is_file() else None
    except (OSError, ValueError):  # a name that no file can have
        return None


class Handler(BaseHTTPRequestHandler):
    """Answers for a site: GET and HEAD of what it holds, nothing else."""

    protocol_version = "HTTP/1.1"

    def __init__(self, *arguments: Any, site: Path) -> None:
        self.site = site
        super().__init__(*arguments)

    def do_GET(self) -> None:
        """Send what the address stands for."""
        self.answer(True)

    def do_HEAD(self) -> None:
        """Send its size and type only."""
        self.answer(False)

    def answer(self, with_body: bool) -> None:
        """Send a file of the site, or why not."""
        host = urlsplit(f"//{self.headers.get('Host', '')}").hostname
        if host not in (HOST, "localhost"):  # the name of another site that was pointed here
            self.send_error(HTTPStatus.FORBIDDEN)
            return
        page = find_page(self.site, self.path)
        if page is None:
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        content = page.read_bytes()
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", KINDS[page.suffix])
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Cache-Control", "no-cache")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.end_headers()
        if with_body:
            self.wfile.write(content)

    def log_message(self, format: str, *arguments: Any) -> None:
        """Say nothing of single requests."""


class Server(ThreadingHTTPServer):
    """One thread a request; a browser that goes away in the middle is no error."""

    daemon_threads = True

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Let go of a connection that broke."""


def open_server(site: Path | Callable[..., BaseHTTPRequestHandler], port: int = PORT) -> Server:
    """A server that listens on this computer only, of a site or with a handler; `port` 0 takes any free one.

    Raises
    ------
    ValueError
        When the port is in use or not allowed.
    """
    try:
        return Server((HOST, port), partial(Handler, site=site) if isinstance(site, Path) else site)
    except (OSError, OverflowError) as error:
        in_use = isinstance(error, OSError) and error.errno == errno.EADDRINUSE
        why = "is in use" if in_use else f"cannot be had ({error})"
        raise ValueError(f"--port {port}: {why}; give another, or 0 for any free one") from None


def serve_run(site: Path, port: int = PORT, show: bool = True, say: Callable[[str], object] = print) -> None:
    """Serve until Ctrl-C; `say` gets the address."""
    with open_server(site, port) as server:
        address = f"http://{HOST}:{server.server_address[1]}/"
        say(f"serving {site} at {address}, to this computer only; Ctrl-C ends it")
        if show:
            webbrowser.open(address)
        server.serve_forever()


BESIDE = "beside.html"


def open_report(
    folder: str | Path,
    show: bool = True,
    again: bool = False,
    around: str | None = None,
    basemap: str | Path | None = None,
) -> Path:
    """The report.html of a run's folder, opened in the browser if `show`; made when missing, older than the
    run, `again`, `around` a building of a large run that the page does not draw, or with an aerial image.

    Raises
    ------
    InputError
        When the folder holds no run, or the image is none of it.
    """
    folder = Path(folder)
    path, footprints = folder / "report.html", folder / "footprints.gpkg"
    refuse_no_run(folder)
    redraw = again or around is not None or basemap is not None
    if redraw or not path.exists() or path.stat().st_mtime < footprints.stat().st_mtime:
        written = write_page(read_contents(folder, around=around, basemap=basemap), describe_run(folder))
        add_to_manifest(folder, [written])
    return opened_page(path) if show else path


def opened_page(path: Path) -> Path:
    """A page, opened in the browser."""
    if not webbrowser.open(path.resolve().as_uri()):
        log.warning("no browser could be started; open %s", path)
    return path


def refuse_no_run(folder: Path) -> None:
    """Raise when a folder holds no run."""
    if not (folder / "footprints.gpkg").exists():
        raise InputError.about(folder, "holds no footprints.gpkg", "give the folder of a run of eaves build")


def describe_run(folder: Path) -> str:
    """The summary of a run from its run.json, as the run reported it."""
    run = read_facts(folder)
    if not run:
        return "the run left no run.json"
    return Summary(
        folder=folder,
        points=run.get("points", 0),
        found=run.get("found", 0),
        modelled=run.get("modelled", 0),
        by_lod=run.get("by_lod", {}),
        trust=run.get("trust", {}),
        failures=run.get("failures", {}),
        fallbacks=run.get("fallbacks", {}),
        seconds=run.get("stage_cpu_seconds", {}),
        elapsed=run.get("elapsed_seconds", 0.0),
        files=(),
        failed=tuple(run.get("incomplete", ())),
        run=run,
    ).as_text()


def open_beside(
    folder: str | Path, other: str | Path, show: bool = True, basemap: str | Path | None = None
) -> Path:
    """The pages of two runs side by side, in a file in the first one's folder, opened in the browser if
    `show`; each draws half as much as a page alone.

    Raises
    ------
    InputError
        When a folder holds no run, or the two are in different reference systems.
    """
    folders = Path(folder), Path(other)
    for run_folder in folders:
        refuse_no_run(run_folder)
    left, right = (
        read_contents(run_folder, points=POINTS_SHOWN // 2, buildings=BUILDINGS_SHOWN // 2, basemap=basemap)
        for run_folder in folders
    )
    refuse_other_system(left, right)
    path = folders[0] / BESIDE
    with atomic(path) as temporary:
        temporary.write_text(render_beside(left, right), encoding="utf-8")
    add_to_manifest(folders[0], [path])
    return opened_page(path) if show else path


def refuse_other_system(left: Contents, right: Contents) -> None:
    """Raise when two runs cannot be shown in one frame."""
    systems = horizontal_crs(left.system), horizontal_crs(right.system)
    if systems[0] != systems[1]:
        raise InputError.about(
            right.folder,
            f"is in {describe_system(right.system)} and {left.folder} in {describe_system(left.system)}",
            "build both in one system, or use eaves compare",
        )


def render_beside(left: Contents, right: Contents) -> str:
    """The page as text, with both pages inside."""
    place = files("eaves.report").joinpath("page")
    names = [contents.folder.resolve().name for contents in (left, right)]
    pages = [
        html.escape("".join(iter_page(contents, describe_run(contents.folder)))) for contents in (left, right)
    ]
    return Template(place.joinpath("beside.html").read_text("utf-8")).substitute(
        title=html.escape(" and ".join(names)),
        style=place.joinpath("style.css").read_text("utf-8"),
        script=place.joinpath("beside.js").read_text("utf-8"),
        left_name=html.escape(names[0]),
        right_name=html.escape(names[1]),
        left=pages[0],
        right=pages[1],
    )


SQUARE = 480.0
"""Side (m) of the squares, fixed to the world."""
SITE_POINTS = 6_000_000
"""More points are thinned over the whole run."""
SITE, CHUNKS = "site", "city"
FLAT = 0.2
"""Height (m) of the box of a building without a model."""
STEP = 0.1
"""The boxes' corners are rounded to this (m): nobody sees it from afar, and it halves the file."""
OPEN_FILES = 64
"""Models are dealt out to so many squares at a time."""
FEATURE_ID = re.compile(r'"id":\s*("(?:[^"\\]|\\.)*")')

Shape: TypeAlias = Polygon | MultiPolygon
Rows = list[dict[str, Any]]


def write_site(folder: str | Path, target: str | Path, basemap: str | Path | None = None) -> Path:
    """Write the page of a run and its squares into a folder for any web server; the path of the page.

    Raises
    ------
    InputError
        When the folder holds no run, `target` is it, or the image is none of it.
    """
    folder, target = Path(folder), Path(target)
    refuse_no_run(folder)
    if target.resolve() == folder.resolve():
        raise InputError.about(target, "is the folder of the run", "give another one to --site")
    polygons, _, rows, system = read_polygons(folder / "footprints.gpkg", layer="footprints")
    system = system_of_folder(folder, named=False) or system
    terrain, bounds = read_terrain(terrain_file(folder), system, None)
    sample = sample_points(classified_files(folder), system, SITE_POINTS, bounds)
    frame = Contents(
        folder=target,
        origin=middle_of(bounds, polygons, sample),
        base=base_of(terrain, sample),
        system=system,
        buildings=len(rows),
        basemap=None if basemap is None else lay_image(folder, basemap, system, bounds),
        run=read_facts(folder),
    )
    overview = frame.filled([], [], None, Sample.empty(), terrain, bounds)
    squares = squares_of(polygons)
    shutil.rmtree(target / CHUNKS, ignore_errors=True)
    (target / CHUNKS).mkdir(parents=True)
    lods = {0}
    with tempfile.TemporaryDirectory(dir=target) as workplace:
        square_models = split_models(folder / "buildings.city.jsonl", rows, squares, Path(workplace))
        square_points = split_points(sample, rows, squares)
        for number, (corner, members) in enumerate(squares.items()):
            part = frame.filled(
                [rows[k] for k in members],
                [polygons[k] for k in members],
                square_models[number],
                sample.take(square_points[number]),
                *read_terrain(terrain_file(folder), system, square_bounds(corner)),
            )
            lods.update(part.faces.lod.tolist())
            about = {"terrain": describe_terrain(part.terrain)}
            write_json(target / CHUNKS / f"{number}.json", about, square_arrays(part, members))
    write_json(
        target / CHUNKS / "boxes.json",
        {"buildings": len(rows)},
        box_arrays(overview, polygons, rows, squares),
    )
    data = page_data(replace(overview, others=rows)) | {
        "modelled": True,
        "city": {
            "folder": CHUNKS,
            "squares": [local_square(corner, len(members), frame) for corner, members in squares.items()],
        },
    }
    write_json(target / CHUNKS / "rows.json", data.pop("others"))
    labels = {
        "heading": f"{len(rows):,} buildings",
        "shown": f"{len(sample):,} of {sample.total:,} points; buildings far away are boxes",
    }
    text = describe_run(folder)
    with atomic(target / "index.html") as temporary, temporary.open("w", encoding="utf-8") as file:
        file.writelines(iter_page(overview, text, labels, data | {"others": None}, (), lods))
    return target / "index.html"


def open_site(folder: str | Path, again: bool = False, basemap: str | Path | None = None) -> Path:
    """The site in the folder of a run; made when missing, older than the run, `again` or with an image."""
    folder = Path(folder)
    refuse_no_run(folder)
    page = folder / SITE / "index.html"
    if again or basemap or not page.exists() or page.stat().st_mtime < modified(folder):
        write_site(folder, page.parent, basemap)
        add_to_manifest(folder, [page, *(page.parent / CHUNKS).iterdir()])
    return page.parent


def modified(folder: Path) -> float:
    """The time of a run's footprints."""
    return (folder / "footprints.gpkg").stat().st_mtime


def write_json(path: Path, data: dict[str, Any], arrays: Iterable[tuple[str, NDArray[Any]]] = ()) -> None:
    """Write data with arrays as the page embeds them."""
    with path.open("w", encoding="utf-8") as file:
        file.writelines(iter_data(data, arrays))


def squares_of(polygons: Sequence[Shape]) -> dict[tuple[int, int], list[int]]:
    """The numbers of the polygons whose middle lies in each square, by the squares' column and row."""
    squares: dict[tuple[int, int], list[int]] = defaultdict(list)
    for number, (x, y) in enumerate(shapely.get_coordinates(shapely.centroid(polygons))):
        squares[math.floor(x / SQUARE), math.floor(y / SQUARE)].append(number)
    return dict(sorted(squares.items()))


def square_bounds(corner: tuple[int, int]) -> Bounds:
    """World metres of a square."""
    column, row = corner
    return Bounds(column * SQUARE, row * SQUARE, (column + 1) * SQUARE, (row + 1) * SQUARE)


def local_square(corner: tuple[int, int], buildings: int, frame: Contents) -> list[float]:
    """West, south, east and north of a square about the origin, and its number of buildings."""
    local = square_bounds(corner).translated(-frame.origin[0], -frame.origin[1])
    return [local.west, local.south, local.east, local.north, buildings]


def split_models(
    models: Path, rows: Rows, squares: Mapping[tuple[int, int], list[int]], workplace: Path
) -> list[Path | None]:
    """The models of each square in a file of its own, or None where the run has none."""
    if not models.exists():
        return [None] * len(squares)
    square_of = {
        str(rows[k]["id"]): number for number, members in enumerate(squares.values()) for k in members
    }
    paths = [workplace / f"{number}.city.jsonl" for number in range(len(squares))]
    for first in range(0, len(paths), OPEN_FILES):
        with ExitStack() as stack:
            source = stack.enter_context(models.open(encoding="utf-8"))
            head = source.readline()
            batch = paths[first : first + OPEN_FILES]
            files = [stack.enter_context(path.open("w", encoding="utf-8")) for path in batch]
            for file in files:
                file.write(head)
            for line in source:
                named = FEATURE_ID.search(line)
                number = square_of.get(json.loads(named[1]), -1) - first if named else -1
                if 0 <= number < len(files):
                    files[number].write(line)
    return list(paths)


def split_points(sample: Sample, rows: Rows, squares: Mapping[tuple[int, int], list[int]]) -> list[Integers]:
    """The numbers of the points of each square: those of its buildings, and others that lie in it."""
    numbers = {corner: number for number, corner in enumerate(squares)}
    lowest = np.floor(sample.xyz[:, :2] / SQUARE).astype(np.int64)
    corners, place = np.unique(lowest, axis=0, return_inverse=True)
    square_of_corner = np.array([numbers.get((int(x), int(y)), -1) for x, y in corners], np.int64)
    square = square_of_corner[place.ravel()] if len(corners) else np.zeros(0, np.int64)
    most = max([int(row.get("number") or 0) for row in rows] + [int(sample.building.max(initial=0))])
    of_building = np.full(most + 1, -1, np.int64)
    for number, members in enumerate(squares.values()):
        of_building[[int(rows[k].get("number") or 0) for k in members]] = number
    of_building[0] = -1
    square = np.where(of_building[sample.building] >= 0, of_building[sample.building], square)
    order = np.argsort(square, kind="stable")
    ends = np.searchsorted(square[order], np.arange(len(squares) + 1))
    return [order[start:end] for start, end in pairwise(ends.tolist())]


def square_arrays(part: Contents, members: Sequence[int]) -> Iterator[tuple[str, NDArray[Any]]]:
    """The arrays of a square's own page, its buildings numbered from 1 among all."""
    numbers = np.array([0, *(k + 1 for k in members)], np.uint32)
    for name, values in iter_arrays(part):
        yield name, numbers[values] if name.endswith("_building") else values


def box_arrays(
    overview: Contents, polygons: Sequence[Shape], rows: Rows, squares: Mapping[tuple[int, int], list[int]]
) -> Iterator[tuple[str, NDArray[Any]]]:
    """Of every building the box around its outline, (B, 4, 2), its lowest and highest place (B, 2), its level
    of detail and its square; and the terrain."""
    around = shapely.minimum_rotated_rectangle(np.array(polygons, object))
    corners = np.zeros((len(polygons), 4, 2))
    square = np.zeros(len(polygons), np.uint16)
    for number, box in enumerate(around.tolist()):
        ring = shapely.get_coordinates(box)[:4]
        corners[number, : len(ring)] = ring - overview.origin
        corners[number, len(ring) :] = ring[-1] - overview.origin
    for number, members in enumerate(squares.values()):
        square[members] = number
    yield "box_xy", as_millimetres(np.round(corners / STEP) * STEP)
    yield "box_z", as_millimetres(np.round(box_heights(rows, overview.base) / STEP) * STEP)
    yield "box_lod", np.array([LODS.index(str(row.get("lod") or "0")) for row in rows], np.uint8)
    yield "box_square", square
    yield "terrain", terrain_array(overview.terrain.values)


def box_heights(rows: Rows, base: float) -> Values:
    """Lowest and highest place (B, 2) of buildings over `base` (m)."""
    ground = np.array([row.get("h_ground") or base for row in rows], np.float64) - base
    height = np.array([row.get("measuredHeight") or FLAT for row in rows], np.float64)
    return np.column_stack([ground, ground + np.maximum(height, FLAT)])
