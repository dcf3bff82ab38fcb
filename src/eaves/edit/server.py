"""The table in a browser of this computer: one page and a few calls, all behind a secret address."""

from __future__ import annotations

import json
import secrets
import threading
import webbrowser
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from http import HTTPStatus
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from eaves.edit.actions import ActionError, Change, Session
from eaves.edit.review import drawn, page_of, picture_of, plan_of, queue_of, script_of
from eaves.report import HOST, Handler, open_server, read_contents

LARGEST = 1_000_000
"""Bytes of a call: the outline of a hall takes a thousandth of it."""
CHOICES = ("coarser roof", "roof of points", "finer roof")
JSON, HTML, SCRIPT = "application/json", "text/html; charset=utf-8", "text/javascript"


class Refused(Exception):
    """A request that is not answered: its status, and why."""

    def __init__(self, status: HTTPStatus, reason: str) -> None:
        super().__init__(reason)
        self.status = status


class Desk:
    """A session and its page: what each call of the page does."""

    def __init__(self, session: Session) -> None:
        self.session, self.token = session, secrets.token_urlsafe(32)
        self.contents = read_contents(session.folder)
        self.changed = set(session.fresh.buildings)
        """Ids of the buildings that are not as the page was made of."""

    def warm(self) -> None:
        """Model a building once, so that nobody waits for what a first one takes longer."""
        names = [entry.id for entry in self.session.queue if entry.id in self.session.outlines]
        with suppress(ValueError):
            self.choices({"id": next(iter(names or self.session.outlines), None)})

    def page(self) -> bytes:
        """The page as the run's files show it, with the plans of its buildings."""
        origin = self.contents.origin
        rows = zip(self.contents.rows, self.contents.polygons, strict=True)
        plans = {str(row["id"]): plan_of(shape, (0.0, 0.0)) for row, shape in rows}
        return page_of(self.contents, {"plans": plans, "origin": origin})

    def state(self, _: Any = None) -> dict[str, Any]:
        """All that the page needs when it opens: the queue, and the buildings that unsaved edits changed."""
        session = self.session
        with session.lock:
            change = session.take_in()
            buildings = session.trial.buildings(self.changed | change.buildings.keys())
            queue = queue_of(session.queue, self.contents, session.outlines, session.reviewed)
            return {"queue": list(queue), **self.answer(Change(buildings, change.words))}

    def answer(self, change: Change) -> dict[str, Any]:
        """What a change draws, and what can be undone."""
        session = self.session
        self.changed |= change.buildings.keys()
        return {
            **drawn(self.contents, change.buildings, session.folder),
            "words": list(change.words),
            "undo": session.last_action > 0,
            "redo": bool(session.undone),
            "edits": len(session.own),
            "reviewed": {name: edit.verdict for name, edit in session.reviewed.items()},
        }

    def act(self, words: Any) -> dict[str, Any]:
        """Carry out an action."""
        return self.answer(self.session.act(words, self.contents.origin))

    def undo(self, _: Any) -> dict[str, Any]:
        """Take back the last action."""
        return self.answer(self.session.undo())

    def redo(self, _: Any) -> dict[str, Any]:
        """Carry it out again."""
        return self.answer(self.session.redo())

    def look(self, _: Any) -> dict[str, Any]:
        """What another program changed."""
        return self.answer(self.session.take_in())

    def choices(self, words: Any) -> dict[str, Any]:
        """Three roofs to choose from, as pictures."""
        if not isinstance(words, dict):
            raise ActionError("an action is a JSON object")
        tried = self.session.tried({"id": words.get("id")}, CHOICES)
        return {"choices": {verdict: picture_of(saved) for verdict, saved in tried.items()}}

    def save(self, _: Any) -> dict[str, Any]:
        """Write the files of the run; the page is to be loaded again."""
        words = self.session.save()
        self.contents = read_contents(self.session.folder)
        self.changed = set(self.session.fresh.buildings)
        return {"saved": words}

    @property
    def calls(self) -> dict[str, Callable[[Any], dict[str, Any]]]:
        """The calls by their names."""
        named = (self.state, self.act, self.undo, self.redo, self.look, self.choices, self.save)
        return {call.__name__: call for call in named}


class DeskHandler(Handler):
    """Answers for a desk: GET of its page and scripts, POST of its calls, to a page of this address alone."""

    def __init__(self, *arguments: Any, desk: Desk) -> None:
        self.desk = desk
        super().__init__(*arguments, site=Path())

    def answer(self, with_body: bool) -> None:
        """Send the page."""
        try:
            name = self.called()
            script = script_of(name)
            if name and script is None:
                raise Refused(HTTPStatus.NOT_FOUND, "nothing is here")
            self.send(script or self.desk.page(), SCRIPT if script else HTML, with_body)
        except Refused as refusal:
            self.refuse(refusal)

    def do_POST(self) -> None:
        """Carry out a call; what cannot be carried out is said in one line."""
        try:
            call, words = self.desk.calls.get(self.called()), self.words()
            if call is None:
                raise Refused(HTTPStatus.NOT_FOUND, "there is no such call")
            answer = call(words)
        except Refused as refusal:
            self.refuse(refusal)
        except ValueError as error:
            self.refuse(Refused(HTTPStatus.UNPROCESSABLE_ENTITY, str(error)))
        else:
            self.send(json.dumps(answer, default=str).encode(), JSON, True)

    def called(self) -> str:
        """The name of what is asked for.

        Raises
        ------
        Refused
            When the host is another, or the address has not the token.
        """
        port = self.connection.getsockname()[1]
        hosts = {f"{host}:{port}" for host in (HOST, "localhost")}
        if self.headers.get("Host", "") not in hosts:
            raise Refused(HTTPStatus.FORBIDDEN, "another host")
        _, token, name = (*urlsplit(self.path).path.split("/", 2), "", "")[:3]
        if not secrets.compare_digest(token.encode(), self.desk.token.encode()):
            raise Refused(HTTPStatus.NOT_FOUND, "nothing is here")
        origin = self.headers.get("Origin")
        if self.command == "POST" and origin not in {f"http://{host}" for host in hosts}:
            raise Refused(HTTPStatus.FORBIDDEN, "another origin")
        return name

    def words(self) -> Any:
        """The JSON of a call.

        Raises
        ------
        Refused
            When it is another type, too large or no JSON.
        """
        if self.headers.get_content_type() != JSON:
            raise Refused(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, f"a call is {JSON}")
        size = self.headers.get("Content-Length", "")
        if not size.isascii() or not size.isdigit():
            raise Refused(HTTPStatus.LENGTH_REQUIRED, "a call says its length")
        if int(size) > LARGEST:
            raise Refused(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"a call has at most {LARGEST:,} bytes")
        try:
            return json.loads(self.rfile.read(int(size)))
        except (ValueError, RecursionError):
            raise Refused(HTTPStatus.BAD_REQUEST, "the call is no JSON") from None

    def refuse(self, refusal: Refused) -> None:
        """Send why nothing is done."""
        self.close_connection = True
        self.send(json.dumps({"error": str(refusal)}).encode(), JSON, True, refusal.status)

    def send(self, content: bytes, kind: str, with_body: bool, status: HTTPStatus = HTTPStatus.OK) -> None:
        """Send content of a kind."""
        self.send_response(status)
        headers = {"Content-Type": kind, "Content-Length": str(len(content)), "Cache-Control": "no-store"}
        headers |= {"X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer"}
        for name, value in {**headers, "X-Frame-Options": "DENY"}.items():
            self.send_header(name, value)
        self.end_headers()
        if with_body:
            self.wfile.write(content)


def serve_desk(desk: Desk, port: int, show: bool, say: Callable[[str], object]) -> None:
    """Serve until Ctrl-C; `say` gets the address."""
    with open_server(partial(DeskHandler, desk=desk), port) as server:
        address = f"http://{HOST}:{server.server_address[1]}/{desk.token}/"
        say(f"{desk.session.folder} can be edited at {address}, from this computer only; Ctrl-C ends it")
        threading.Thread(target=desk.warm, daemon=True).start()
        if show:
            webbrowser.open(address)
        server.serve_forever()
