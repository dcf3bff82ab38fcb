"""The table's server: one page and its calls, for the page of this address alone, whatever is sent."""

from __future__ import annotations

import http.client
import json
from collections.abc import Iterator
from functools import partial
from threading import Thread
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from eaves.edit.actions import TOOLS, Session
from eaves.edit.server import LARGEST, Desk, DeskHandler
from eaves.report import open_server


@pytest.fixture
def table(session: Session) -> Iterator[Caller]:
    """A desk that is served."""
    desk = Desk(session)
    with open_server(partial(DeskHandler, desk=desk), 0) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield Caller(desk, server.server_address[1])
        server.shutdown()


class Caller:
    """Calls of a page, or of what pretends to be one."""

    def __init__(self, desk: Desk, port: int) -> None:
        self.desk, self.port = desk, port

    def ask(
        self, name: str, body: bytes = b"null", method: str = "POST", **headers: str
    ) -> tuple[int, bytes]:
        """Status and content of an answer."""
        given = {"Origin": f"http://127.0.0.1:{self.port}", "Content-Type": "application/json"}
        given |= {key.replace("_", "-"): value for key, value in headers.items()}
        line = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        line.request(method, f"/{self.desk.token}/{name}", body, {k: v for k, v in given.items() if v})
        answer = line.getresponse()
        content = answer.read()
        line.close()
        return answer.status, content

    def call(self, name: str, words: Any = None) -> dict[str, Any]:
        """The answer of a call that succeeds."""
        status, content = self.ask(name, json.dumps(words).encode())
        assert status == 200, content
        return dict(json.loads(content))


def test_the_page_is_sent_and_a_building_edited__drawn_and_undone(table: Caller) -> None:
    status, page = table.ask("", method="GET")
    assert status == 200 and b'"edit":{"plans":' in page
    opened = table.call("state")
    assert (opened["undo"], opened["gone"], opened["changed"]) == (False, [], [])
    name = next(iter(table.desk.session.outlines))
    changed = table.call("act", {"do": "state", "id": name, "verdict": "flat roof"})
    (one,) = changed["changed"]
    assert (one["row"]["id"], one["row"]["trust"], changed["undo"]) == (name, "manual", True)
    assert {"triangle_xyz", "edge_xyz", "outline_xyz"} <= one["arrays"].keys()
    assert [each["row"]["id"] for each in table.call("state")["changed"]] == [name]
    assert len(table.call("choices", {"id": name})["choices"]) == 3
    assert table.call("act", {"do": "delete", "id": name})["gone"] == [name]
    assert [each["row"]["id"] for each in table.call("undo")["changed"]] == [name]
    assert table.call("look")["changed"] == []
    assert "1 buildings modelled" in table.call("save")["saved"]


@pytest.mark.parametrize(
    ("status", "headers"),
    [
        (403, {"Host": "evil.example"}),
        (403, {"Origin": "http://evil.example"}),
        (403, {"Origin": ""}),
        (415, {"Content_Type": "text/plain"}),
        (413, {"Content_Length": str(LARGEST + 1)}),
        (411, {"Content_Length": "many"}),
    ],
)
def test_another_page_is_refused(table: Caller, status: int, headers: dict[str, str]) -> None:
    assert table.ask("undo", **headers)[0] == status


def test_an_address_without_the_token_is_none__nor_is_any_file(table: Caller) -> None:
    token, table.desk.token = table.desk.token, "guessed"
    line = partial(table.ask, method="GET")
    assert line("")[0] == 200
    table.desk.token = token + "x"
    for name in ("../run.json", "edits.gpkg", "%2e%2e/run.json", "state"):
        assert line(name)[0] == 404
    assert table.ask("no-such-call")[0] == 404


JUNK = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=9),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4),
    max_leaves=12,
)


@settings(
    max_examples=60,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(st.data())
def test_whatever_is_sent_gives_one_clear_line__and_writes_nothing(
    table: Caller, data: st.DataObject
) -> None:
    keys = st.sampled_from(
        ("id", "ids", "plan", "line", "moves", "at", "to", "rise", "verdict", "value", "do")
    )
    action = data.draw(st.fixed_dictionaries({"do": st.sampled_from(sorted(TOOLS))}))
    action |= data.draw(st.dictionaries(keys, JUNK, max_size=4))
    if data.draw(st.booleans()):
        action["id"] = next(iter(table.desk.session.outlines))
    if action.get("do") in ("delete", "right") or action.get("verdict") in ("flat roof",):
        action.pop("id", None)  # the one action that this would be
    body = json.dumps(action).encode() if data.draw(st.booleans()) else data.draw(st.binary(max_size=60))
    status, content = table.ask("act", body)
    assert status in (400, 422), content
    error = json.loads(content)["error"]
    assert error and "\n" not in error and "Traceback" not in error
    assert not (table.desk.session.folder / "edits.gpkg").exists()
