"""The page of a run of any size in a browser, from this computer."""

from __future__ import annotations

import errno
import webbrowser
from collections.abc import Callable
from functools import partial
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

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
