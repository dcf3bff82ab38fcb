"""The operator's table: seconds of each change, and the review of a run gone through in the real page.

`python -m benchmarks.speed.operator OUT … [--first 50]`: each OUT is a run built with --keep, which stays as
it is. Buildings are changed one after another in a session, then the first of the review are gone
through in a browser by a script, mouse and keys: it does what the reason asks for, which is no judgement of a
person. Counted are keys, clicks and drags, and the seconds until the answer is there, and until it is drawn.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing
from functools import partial
from itertools import chain, pairwise
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
from tests.report.browser import Browser

from benchmarks.table import keep
from eaves.edit.actions import ActionError
from eaves.edit.server import Desk, DeskHandler
from eaves.edit.session import Session
from eaves.report import open_server

VERDICTS = ("finer roof",)


def copied(folder: Path, place: str) -> Path:
    """A copy of a run."""
    return Path(shutil.copytree(folder, Path(place) / folder.name))


def latencies(folder: Path, every: int) -> Iterator[dict[str, object]]:
    """Seconds of the server for one change of every n-th building, by verdict."""
    with tempfile.TemporaryDirectory() as place, closing(Session(copied(folder, place))) as session:
        desk = Desk(session)
        desk.warm()
        for verdict in VERDICTS:
            spent, cpu = list[float](), list[float]()
            for name in list(session.outlines)[::every]:
                began, worked = time.perf_counter(), time.process_time()
                try:
                    desk.act({"do": "state", "id": name, "verdict": verdict})
                except ActionError:
                    continue
                spent.append(time.perf_counter() - began)
                cpu.append(time.process_time() - worked)
            yield {
                "run": folder.name,
                "what": verdict,
                "changes": len(spent),
                "median (s)": round(float(np.median(spent)), 2),
                "95 % (s)": round(float(np.quantile(spent, 0.95)), 2),
                "slowest (s)": round(max(spent), 2),
                "CPU, median (s)": round(float(np.median(cpu)), 2),
                "CPU, slowest (s)": round(max(cpu), 2),
            }


class Hands:
    """Mouse and keys in a window with the table, counted."""

    def __init__(self, browser: Browser, desk: Desk, port: int) -> None:
        self.browser, self.desk = browser, desk
        self.count = self.waited = 0
        browser.call("POST", "/url", {"url": f"http://127.0.0.1:{port}/{desk.token}/"})
        self.until("return document.documentElement.dataset.table === 'yes'")

    def until(self, script: str) -> None:
        """Wait until a script returns what is true."""
        limit = time.monotonic() + 120
        while not self.browser.run(script):
            assert time.monotonic() < limit, script
            time.sleep(0.02)

    def press(self, key: str) -> None:
        """Press a key."""
        self.count += 1
        self.browser.press(key)

    def at(self, place: Any) -> tuple[float, float]:
        """Where a place [x, y] of the page is in the window."""
        x, y = place
        script = "const row = eaves.all[eaves.tools.chosen];"
        script += f"const at = eaves.tools.seen([{x}, {y}, row.h_eaves - {self.desk.contents.base}]);"
        left, top = self.browser.run(
            script
            + "const box = eaves.canvas.getBoundingClientRect(); return [box.left + at.x, box.top + at.y];"
        )
        return float(left), float(top)

    def sees(self, *places: Any) -> bool:
        """True if the scene shows places, beside its buttons."""
        script = "const box = eaves.canvas.getBoundingClientRect();"
        script += "return [box.left, box.top, box.right, box.bottom];"
        left, top, right, bottom = self.browser.run(script)
        seen = [self.at(place) for place in places]
        return all(left + 9 < x < right - 60 and top + 50 < y < bottom - 60 for x, y in seen)

    def done(self) -> None:
        """Wait until what was asked for is drawn."""
        self.until("return document.documentElement.dataset.busy === 'no'")


def review(folder: Path, first: int) -> Iterator[dict[str, object]]:
    """The first buildings of a run's review, gone through in the page."""
    with (
        tempfile.TemporaryDirectory() as place,
        closing(Session(copied(folder, place))) as session,
        Browser() as browser,
    ):
        desk = Desk(session)
        desk.warm()
        with open_server(partial(DeskHandler, desk=desk), 0) as server:
            Thread(target=server.serve_forever, daemon=True).start()
            hands = Hands(browser, desk, server.server_address[1])
            entries, done = list(queue(desk))[:first], []
            for entry in entries:
                hands.count = 0
                hands.press("j")
                browser.settle()
                before = len(session.own)
                what = correct(hands, entry)
                hands.done()
                made = len(session.own) > before
                seconds = [
                    float(browser.run(f"return document.documentElement.dataset.{name}"))
                    for name in ("answered", "seconds")
                ]
                done.append((what if made else f"{what}, refused", hands.count, *seconds))
            began = time.perf_counter()
            session.save()
            saved = time.perf_counter() - began
            server.shutdown()
    for what in sorted({one[0] for one in done}):
        some = [one for one in done if one[0] == what]
        hands_, answered, drawn = (np.array([one[k] for one in some], float) for k in (1, 2, 3))
        yield {
            "run": folder.name,
            "what": what,
            "changes": len(some),
            "keys, clicks and drags each": round(float(hands_.mean()), 1),
            "answered, median (s)": round(float(np.median(answered)), 2),
            "drawn, median (s)": round(float(np.median(drawn)), 2),
            "slowest (s)": round(float(drawn.max()), 2),
        }
    yield {
        "run": folder.name,
        "what": "all, and Save (s)",
        "changes": len(done),
        "keys, clicks and drags each": round(float(np.mean([one[1] for one in done])), 1),
        "slowest (s)": round(saved, 1),
    }


def queue(desk: Desk) -> list[dict[str, Any]]:
    """The queue as the page has it."""
    return list(desk.state()["queue"])


def correct(hands: Hands, entry: dict[str, Any]) -> str:
    """Do what the reason of an entry asks for; what was done."""
    reason = entry["reason"]
    if "container or vehicle" in reason:
        hands.press("\ue017")
        return "delete"
    inside = neighbour(hands, entry["id"]) if "party wall" in reason else None
    if inside is not None:
        hands.press("b")
    if inside is not None and hands.sees(inside):
        hands.count += 1
        hands.browser.click(*hands.at(inside))
        return "join"
    if "not supported" in reason or "off the roof" in reason or "no points" in reason:
        hands.press("w")
        hands.until("return document.querySelectorAll('#choices button').length === 3")
        hands.press("\ue007")
        return "one of three roofs"
    if "may go on there" in reason and entry["marks"]:
        hands.press("c")
        hands.browser.settle()
        lines = [np.array(line) for line in entry["marks"]]
        edges = [pair for line in lines for pair in pairwise(line)]
        one, two = max(edges, key=lambda pair: float(np.hypot(*(pair[1] - pair[0]))))
        outline = hands.desk.session.outlines[entry["id"]]
        normal = np.array([two[1] - one[1], one[0] - two[0]]) / np.hypot(*(two - one))
        middle, centre = (one + two) / 2, np.subtract(outline.centroid.coords[0], hands.desk.contents.origin)
        if normal @ (middle - centre) < 0:
            normal = -normal
        if not hands.sees(middle, middle + normal):
            hands.press("-")
        if hands.sees(middle, middle + normal):
            hands.count += 1
            hands.browser.drag(hands.at(middle), hands.at(middle + normal))
            return "edge dragged 1 m out"
    hands.press("y")
    return "right"


def neighbour(hands: Hands, name: str) -> Any:
    """A place of the page inside the building that shares most of a wall with another; None for none."""
    outlines = hands.desk.session.outlines
    if name not in outlines:
        return None
    own = outlines[name].buffer(0.1)
    others = [one for key, one in outlines.items() if key != name and one.intersects(own)]
    if not others:
        return None
    inside = max(others, key=lambda one: one.intersection(own).area).representative_point()
    return inside.x - hands.desk.contents.origin[0], inside.y - hands.desk.contents.origin[1]


def main() -> None:
    """Measure and keep the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", nargs="+", type=Path)
    parser.add_argument("--first", type=int, default=50)
    parser.add_argument("--every", type=int, default=1, help="every n-th building is changed by itself")
    given = parser.parse_args()
    rows = list[dict[str, object]]()
    for run in given.runs:
        for row in chain(latencies(run, given.every), review(run, given.first)):
            print(row, flush=True)
            rows.append(row)
    columns = dict.fromkeys(key for row in rows for key in row)
    rows = [{column: row.get(column) for column in columns} for row in rows]
    names = " ".join(run.name for run in given.runs)
    keep(
        "operator",
        "The operator's table",
        rows,
        f"python -m benchmarks.speed.operator {names}",
        __doc__ or "",
    )


if __name__ == "__main__":
    main()
