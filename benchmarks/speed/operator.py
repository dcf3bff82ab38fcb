"""The operator's table: seconds of each change, and the first of a run's review corrected in the real page.

`python -m benchmarks.speed.operator OUT=TRUTH … [--first 50] [--alike 20]`: each OUT is a run built with
--keep, which stays as it is, each TRUTH a map of houses or a file of an operator's marks (GeoPackage, in the
run's system). Buildings are changed one after another in a session. Then a script goes through the first of
the review in a browser, with mouse and keys. What is right of an outline the map or the marks decide
(`operator_truth`); of a roof that the review names, the RMSE of its points: a roof with more faces stays
where that is less by a tenth. Where neither says anything, it goes on. Counted are keys, clicks and drags,
and the seconds until what was asked for is drawn. In the end the same edits are made by the tools of QGIS
and `eaves update` (`operator_qgis`).
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import pyogrio
from tests.report.browser import Browser

from benchmarks.speed.operator_qgis import done_alike, kept_changes, steps
from benchmarks.speed.operator_truth import LEAST_GAIN, UNKNOWN, Goal, Map, Marks, edge_moves, iou
from benchmarks.table import as_markdown, keep
from eaves.edit.actions import ActionError, Session
from eaves.edit.server import Desk, DeskHandler
from eaves.report import open_server, read_contents

VERDICTS = ("finer roof",)
DELETE, ALT = "\ue017", "\ue00a"
MOST_CHANGES = 8
"""Changes of one outline, at most."""
OF_ROOF = ("off the roof", "m of the roof", "not supported")
"""Words of reasons that are about a roof."""


def copied(folder: Path, place: str | Path) -> Path:
    """A copy of a run."""
    shutil.rmtree(Path(place) / folder.name, ignore_errors=True)
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


@dataclass(eq=False)
class Made:
    """A building that was gone through: its id, what was done, and its number of actions; for each change the
    seconds of the clock until the answer and until it is drawn, and of the server's processor."""

    id: str
    done: list[str] = field(default_factory=list)
    actions: int = 0
    waits: list[tuple[float, float, float]] = field(default_factory=list)


class Hands:
    """Mouse and keys in a window with the table, counted."""

    def __init__(self, browser: Browser, desk: Desk, address: str) -> None:
        self.browser, self.desk, self.made = browser, desk, Made("")
        browser.call("POST", "/url", {"url": address})
        self.until("return document.documentElement.dataset.table === 'yes'")

    def until(self, script: str) -> None:
        """Wait until a script returns what is true."""
        limit = time.monotonic() + 120
        while not self.browser.run(script):
            assert time.monotonic() < limit, script
            time.sleep(0.02)

    @property
    def chosen(self) -> str:
        """The id of the building that is chosen."""
        return str(self.browser.run("return document.documentElement.dataset.chosen"))

    def press(self, *keys: str) -> None:
        """Press keys one after another."""
        self.made.actions += len(keys)
        self.browser.press(*keys)

    def at(self, place: Any) -> tuple[float, float]:
        """Where a place of the world is in the window, at the eaves of the chosen building."""
        x, y = np.subtract(place, self.desk.contents.origin).tolist()
        base = self.desk.contents.base
        script = f"""const row = eaves.all[eaves.tools.chosen], z = (row.h_eaves ?? {base}) - {base};
            const at = eaves.tools.seen([{x}, {y}, z]), box = eaves.canvas.getBoundingClientRect();
            return [box.left + at.x, box.top + at.y];"""
        left, top = self.browser.run(script)
        return float(left), float(top)

    def sees(self, *places: Any) -> bool:
        """True if the scene shows places, beside its buttons."""
        script = "const box = eaves.canvas.getBoundingClientRect();"
        script += "return [box.left, box.top, box.right, box.bottom];"
        left, top, right, bottom = self.browser.run(script)
        seen = [self.at(place) for place in places]
        return all(left + 9 < x < right - 60 and top + 50 < y < bottom - 60 for x, y in seen)

    def bring(self, *places: Any) -> bool:
        """Zoom out until places are in sight; False where they stay out of it."""
        for _ in range(8):
            if self.sees(*places):
                return True
            self.press("-")
        return False

    def click(self, place: Any) -> None:
        """Click on a place of the world."""
        self.made.actions += 1
        self.browser.click(*self.at(place))

    def drag(self, start: Any, end: Any) -> None:
        """Drag from a place of the world to another while Alt is held: nothing is joined to what is near."""
        self.made.actions += 2
        (x, y), (u, v) = (map(round, self.at(place)) for place in (start, end))
        pause = {"type": "pause"}
        keys = [
            {"type": "keyDown", "value": ALT},
            pause,
            pause,
            pause,
            pause,
            {"type": "keyUp", "value": ALT},
        ]
        way = [
            {"type": "pointerMove", "x": x, "y": y},
            {"type": "pointerDown", "button": 0},
            {"type": "pointerMove", "x": u, "y": v, "duration": 50},
            {"type": "pointerUp", "button": 0},
        ]
        mouse = {"type": "pointer", "id": "mouse", "parameters": {"pointerType": "mouse"}}
        sources = [{"type": "key", "id": "keys", "actions": keys}, {**mouse, "actions": [pause, *way, pause]}]
        self.browser.call("POST", "/actions", {"actions": sources})

    def change(self, what: str, act: Callable[[], None]) -> bool:
        """Do what changes a building, and wait for it; True if it was carried out."""
        before, began = self.state, time.process_time()
        self.browser.run("delete document.documentElement.dataset.seconds")
        act()
        self.until("return document.documentElement.dataset.busy === 'no'")
        self.browser.settle()
        carried_out = self.state != before
        self.made.done.append(what if carried_out else f"{what}, refused")
        if carried_out:
            answered, drawn = (
                float(self.browser.run(f"return document.documentElement.dataset.{name} ?? 0"))
                for name in ("answered", "seconds")
            )
            self.made.waits.append((answered, drawn, time.process_time() - began))
        return carried_out

    @property
    def state(self) -> tuple[int, int]:
        """The number of edits that are kept, and of those that can be done again."""
        return len(self.desk.session.own), len(self.desk.session.undone)


def review(folder: Path, truth: Map | Marks, first: int, place: Path) -> tuple[list[Made], float, list[Any]]:
    """The first buildings of a run's review corrected in the page of a copy in a place, the seconds of Save,
    and the edits."""
    copy = copied(folder, place)
    with closing(Session(copy)) as session, Browser() as browser:
        desk, made = Desk(session), list[Made]()
        desk.warm()
        with open_server(partial(DeskHandler, desk=desk), 0) as server:
            Thread(target=server.serve_forever, daemon=True).start()
            hands = Hands(browser, desk, f"http://127.0.0.1:{server.server_address[1]}/{desk.token}/")
            wanted = {entry.id for entry in session.queue[:first]}
            while len(made) < len(wanted):
                hands.made = Made("")
                if not made or made[-1].done[-1:] != ["right"]:
                    hands.press("j")
                hands.made.id = hands.chosen
                if hands.made.id not in wanted or hands.made.id in {one.id for one in made}:
                    break
                correct(hands, truth, next(one.reason for one in session.queue if one.id == hands.made.id))
                made.append(hands.made)
                print(hands.made, flush=True)
            server.shutdown()
        edits, began = list(session.own), time.perf_counter()
        session.save()
        return made, time.perf_counter() - began, edits


def correct(hands: Hands, truth: Map | Marks, reason: str) -> None:
    """Correct the building that is chosen as far as is known what is right of it."""
    name, session = hands.made.id, hands.desk.session
    known, refused = False, False
    for _ in range(MOST_CHANGES):
        goal = truth.goal(name, session.outlines) if name in session.outlines else UNKNOWN
        known |= goal is not UNKNOWN
        if refused or goal.act in ("unknown", "right"):
            break
        if goal.act == "delete":
            hands.change("delete", lambda: hands.press(DELETE))
            return
        refused = not draw(hands, name, goal)
    of_roof = any(words in reason for words in OF_ROOF)
    if of_roof and name in session.outlines:
        before = rmse(session, name)
        if hands.change("finer roof", lambda: hands.press("3")) and not rmse(session, name) < 0.9 * before:
            hands.change("undone", lambda: hands.press("u"))
    if known and name in session.outlines and truth.goal(name, session.outlines).act == "right":
        hands.change("right", lambda: hands.press("y"))


def draw(hands: Hands, name: str, goal: Goal) -> bool:
    """Change an outline by one tool; True if it was carried out."""
    if goal.act == "split":
        hands.press("v")
        hands.browser.settle()
        ends = [goal.line.mean(axis=0) + 0.55 * (end - goal.line.mean(axis=0)) for end in goal.line]
        if not hands.bring(*ends):
            return False
        hands.click(ends[0])
        return hands.change("split", lambda: hands.click(ends[1]))
    if goal.act == "join":
        inside = hands.desk.session.outlines[goal.other].representative_point().coords[0]
        hands.press("b")
        hands.browser.settle()
        return hands.bring(inside) and hands.change("join", lambda: hands.click(inside))
    own = hands.desk.session.outlines[name]
    gain, start, end = max(edge_moves(own, goal.shape), key=lambda move: move[0], default=(0.0, None, None))
    if gain < iou(own, goal.shape) + LEAST_GAIN:
        return False
    if hands.browser.run("return document.querySelector('[data-tool=corners]').ariaPressed") != "true":
        hands.press("c")
        hands.browser.settle()
    return hands.bring(start, end) and hands.change("edge moved", lambda: hands.drag(start, end))


def rmse(session: Session, name: str) -> float:
    """The RMSE (m) of the points of a building about its roof."""
    saved = session.trial.buildings([name])[name]
    return float("inf") if saved is None else float(saved.row.values.get("rmse_m") or "inf")


def rows_of(run: str, made: list[Made], saved: float) -> Iterator[dict[str, object]]:
    """A row of the table for each kind of what was done, and for all."""
    kinds = sorted({what for one in made for what in set(one.done)} | {"nothing known"})
    for kind in [*kinds, "all"]:
        some = [one for one in made if kind in ("all", *(one.done or ["nothing known"]))]
        waits = np.array([wait for one in some for wait in one.waits])
        row: dict[str, object] = {"run": run, "what": kind, "buildings": len(some)}
        row["actions a building"] = round(float(np.mean([one.actions for one in some])), 1) if some else None
        if len(waits):
            row |= {
                "changes": len(waits),
                "waited a change, median (s)": round(float(np.median(waits[:, 1])), 2),
            }
            row |= {"slowest (s)": round(float(waits[:, 1].max()), 2)}
            row |= {"CPU of the server, median (s)": round(float(np.median(waits[:, 2])), 2)}
            row |= {"CPU, slowest (s)": round(float(waits[:, 2].max()), 2)}
        yield row
    yield {"run": run, "what": "Save", "actions a building": 1, "slowest (s)": round(saved, 1)}


def read_truth(path: Path, folder: Path) -> Map | Marks:
    """A map, or marks in the unit of a run."""
    if "kind" not in pyogrio.read_info(path)["fields"]:
        return Map.read(path)
    return Marks.read(path, read_contents(folder).system.horizontal_unit_m)


def main() -> None:
    """Measure and keep the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", nargs="+", help="OUT=TRUTH")
    parser.add_argument("--first", type=int, default=50)
    parser.add_argument("--every", type=int, default=8, help="every n-th building is changed by itself")
    parser.add_argument("--alike", type=int, default=20, help="so many are done by QGIS and update, too")
    parser.add_argument("--place", type=Path, help="folder for the copies, which stay there")
    given = parser.parse_args()
    rows, alike, alone = list[dict[str, object]](), list[dict[str, object]](), list[dict[str, object]]()
    with ExitStack() as stack:
        place = given.place or Path(stack.enter_context(tempfile.TemporaryDirectory()))
        for word in given.runs:
            folder, truth = map(Path, word.split("="))
            alone += latencies(folder, given.every)
            made, saved, edits = review(folder, read_truth(truth, folder), given.first, place / "table")
            rows += rows_of(folder.name, made, saved)
            chosen = [one for one in made if kept_changes(one.done)][: given.alike]
            corrected = place / "table" / folder.name
            alike += done_alike(folder, corrected, edits, chosen, place / "qgis")
    note = "\n\n".join(
        [
            "Those that changed, at most twenty a run, at the table, and by QGIS's tools and `eaves update`:",
            as_markdown(alike),
            "The steps in QGIS that were counted:",
            as_markdown(steps()),
            "One change of every n-th building by a session alone, without a browser:",
            as_markdown(alone),
            __doc__ or "",
        ]
    )
    names = " ".join(given.runs)
    keep(
        "operator", "The operator's table", whole(rows), f"python -m benchmarks.speed.operator {names}", note
    )


def whole(rows: list[dict[str, object]]) -> list[dict[str, object]]:
    """The rows, each with all columns."""
    columns = dict.fromkeys(key for row in rows for key in row)
    return [{column: row.get(column) for column in columns} for row in rows]


if __name__ == "__main__":
    main()
