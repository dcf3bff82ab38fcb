"""The 3D Tiles of a run in a browser: from this computer, or as a folder for any web server.

The viewer is the folder `tiles`: our page, and three.js with 3d-tiles-renderer in one file of 0.7 MB, so that
nothing is asked of another server. Only tiles in sight are loaded: a run may be of any size.
"""

from __future__ import annotations

import errno
import gzip
import json
import shutil
import webbrowser
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import numpy as np
from numpy.typing import NDArray

from eaves.formats import InputError, iter_cityjson, write_3dtiles
from eaves.formats.atomic import atomic
from eaves.formats.crs import describe_system
from eaves.formats.models.cityjson_read import read_models
from eaves.formats.models.tiles3d import Earth
from eaves.model import LOCAL_METRES, Bounds, BuildingModel, CoordinateSystem, Points
from eaves.model.columns import COLUMNS
from eaves.report.contents import lay_image, read_terrain, system_of_folder
from eaves.report.page_file import MILLIMETRES, UNKNOWN_HEIGHT, packed_array
from eaves.run.manifest import add_to_manifest, read_facts

HOST = "127.0.0.1"
"""Nobody but this computer is served."""
PORT = 8017
TILES = "3dtiles"
PAGE = "report.html"
IMAGE = "basemap.jpg"
KINDS = {
    ".css": "text/css; charset=utf-8",
    ".glb": "model/gltf-binary",
    ".html": "text/html; charset=utf-8",
    ".jpg": "image/jpeg",
    ".js": "text/javascript; charset=utf-8",
    ".json": "application/json",
    ".txt": "text/plain; charset=utf-8",
}
"""The types of all that is served."""
VIEWER = {
    "tiles": ("index.html", "viewer.js", "three-tiles.js.gz", "three-tiles.LICENSE.txt"),
    "page": ("style.css", "arrays.js", "colours.js"),
}
"""Folder of this package → its files that the viewer is made of."""


@dataclass(frozen=True)
class TileSite:
    """The files served of a run: files made in memory, by name, and of its folder the tiles and the page."""

    folder: Path
    made: dict[str, bytes]

    def find(self, address: str) -> bytes | Path | None:
        """The file behind an address; None for all that is not of the site, wherever it points."""
        name = unquote(urlsplit(address).path).lstrip("/") or "index.html"
        if name in self.made:
            return self.made[name]
        place = self.folder.resolve()
        try:
            path = (place / name).resolve()
            inside = path == place / PAGE or path.is_relative_to(place / TILES)
            return path if inside and path.is_file() else None
        except (OSError, ValueError):  # a name that no file can have
            return None


def make_site(folder: str | Path, basemap: str | Path | None = None) -> TileSite:
    """The site of a run's folder, with an aerial image; its tiles are made when they are missing.

    Raises
    ------
    InputError
        When the folder holds no models of a run, or the image is none of it.
    """
    folder = Path(folder)
    system = system_of_folder(folder)
    pages = {}
    for place, names in VIEWER.items():
        for name in names:
            content = files("eaves.report").joinpath(place, name).read_bytes()
            packed = name.endswith(".gz")
            pages[name.removesuffix(".gz")] = gzip.decompress(content) if packed else content
    system = make_tiles(folder, system)
    pages["about.json"] = as_bytes(about_run(folder, system))
    heights, bounds = read_terrain(folder / "dtm.tif", system, None)
    image = None if basemap is None else lay_image(folder, basemap, system, bounds)
    if image is not None:
        pages[IMAGE] = image.jpeg
    ground = describe_ground(heights, bounds, system)
    pages["ground.json"] = as_bytes(ground | {"image": IMAGE if image else ""})
    return TileSite(folder, pages)


def as_bytes(value: Any) -> bytes:
    """Compact JSON."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False).encode("utf-8")


def make_tiles(folder: Path, system: CoordinateSystem | None) -> CoordinateSystem:
    """Write the 3D Tiles of a run that has none, or older ones than its models; the system of its models."""
    models, tileset = folder / "buildings.city.jsonl", folder / TILES / "tileset.json"
    if not models.exists():
        if tileset.exists():
            return system or LOCAL_METRES
        raise InputError.about(folder, f"holds neither {models.name} nor {TILES}", "give the folder of a run")
    first = next(iter_cityjson(models), None)
    tile_system = system or (first.system if first else LOCAL_METRES)
    if not tileset.exists() or tileset.stat().st_mtime < models.stat().st_mtime:
        solid = (model for model in read_models(models) if isinstance(model, BuildingModel))
        by_square = sorted(solid, key=lambda model: (model.footprint.origin, model.footprint.id))
        write_3dtiles(tileset.parent, by_square, tile_system)
        add_to_manifest(folder, [tileset])
    return tile_system


def about_run(folder: Path, system: CoordinateSystem) -> dict[str, Any]:
    """The facts of the run that the viewer shows."""
    run = read_facts(folder)
    names = [Path(entry["path"]).name for entry in run.get("inputs", ())]
    title = f"{names[0]}{f' and {len(names) - 1} more' if len(names) > 1 else ''}" if names else folder.name
    buildings, modelled = run.get("found", 0), run.get("modelled", 0)
    return {
        "title": f"{title}: buildings by eaves",
        "headline": f"{buildings:,} buildings, {modelled:,} with a model; {describe_system(system)}",
        "buildings": modelled,
        "columns": {name: [column.label, column.meaning] for name, column in COLUMNS.items()},
        "page": PAGE if (folder / PAGE).exists() else "",
    }


def describe_ground(
    heights: NDArray[np.float32], bounds: Bounds | None, system: CoordinateSystem
) -> dict[str, Any]:
    """The terrain where the tiles have it: a grid of places, row 0 north, in millimetres from `centre`."""
    rows, columns = heights.shape
    finite = np.isfinite(heights)
    if bounds is None or not finite.any():
        return {"rows": 0, "columns": 0, "centre": [0, 0, 0], "xyz": packed_array(np.zeros(0, np.int32))}
    x = bounds.west + (np.arange(columns) + 0.5) * bounds.width / columns
    y = bounds.north - (np.arange(rows) + 0.5) * bounds.height / rows
    world = np.column_stack([np.tile(x, rows), np.repeat(y, columns), np.nan_to_num(heights).ravel()])
    places = placed(Earth(system), world)
    centre = places[finite.ravel()].mean(axis=0)
    steps = np.rint((places - centre) * MILLIMETRES)
    steps[~finite.ravel()] = UNKNOWN_HEIGHT
    xyz = packed_array(steps.astype(np.int32))
    return {"rows": rows, "columns": columns, "centre": centre.tolist(), "xyz": xyz}


def placed(earth: Earth, world: Points) -> Points:
    """World metres (N, 3) in the tileset's coordinates."""
    return earth.geocentric(world) if earth.known else world


def write_site(site: TileSite, target: str | Path) -> Path:
    """Write the site into a folder for any web server; the path of its first page.

    Raises
    ------
    InputError
        When the folder cannot be written, or is that of the run.
    """
    target = Path(target)
    if target.resolve() == site.folder.resolve():
        raise InputError.about(target, "is the folder of the run", "give another one to --site")
    for name, content in site.made.items():
        with atomic(target / name) as temporary:
            temporary.write_bytes(content)
    shutil.rmtree(target / TILES, ignore_errors=True)
    shutil.copytree(site.folder / TILES, target / TILES)
    if (site.folder / PAGE).exists():
        shutil.copyfile(site.folder / PAGE, target / PAGE)
    return target / "index.html"


class Handler(BaseHTTPRequestHandler):
    """Answers for a site: GET and HEAD of what it holds, nothing else."""

    protocol_version = "HTTP/1.1"

    def __init__(self, *arguments: Any, site: TileSite) -> None:
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
        page = self.site.find(self.path)
        if page is None:
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        name = page.name if isinstance(page, Path) else urlsplit(self.path).path or "/"
        content = page.read_bytes() if isinstance(page, Path) else page
        self.send_response(HTTPStatus.OK)
        suffix = ".html" if name.endswith("/") else Path(name).suffix
        self.send_header("Content-Type", KINDS.get(suffix, "application/octet-stream"))
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


def open_server(site: TileSite, port: int = PORT) -> Server:
    """A server that listens on this computer only; `port` 0 takes any free one.

    Raises
    ------
    ValueError
        When the port is in use or not allowed.
    """
    try:
        return Server((HOST, port), partial(Handler, site=site))
    except (OSError, OverflowError) as error:
        in_use = isinstance(error, OSError) and error.errno == errno.EADDRINUSE
        why = "is in use" if in_use else f"cannot be had ({error})"
        raise ValueError(f"--port {port}: {why}; give another, or 0 for any free one") from None


def serve_run(
    site: TileSite, port: int = PORT, show: bool = True, say: Callable[[str], object] = print
) -> None:
    """Serve until Ctrl-C; `say` gets the address."""
    with open_server(site, port) as server:
        address = f"http://{HOST}:{server.server_address[1]}/"
        say(f"serving {site.folder} at {address}, to this computer only; Ctrl-C ends it")
        if show:
            webbrowser.open(address)
        server.serve_forever()
