"""An operator's session: the edits of a run, undone and redone, each modelled again at once."""

from __future__ import annotations

import datetime
import threading
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from shapely import Polygon

from eaves.edit.actions import OF_ROOF, ROOF_FACE, ActionError, Table, edits_of, signed
from eaves.edit.review import Reviewed, read_queue
from eaves.flow import Edit
from eaves.upkeep import Trial, open_trial, update


@dataclass(frozen=True, eq=False)
class Change:
    """What came of an action: the buildings that are others now, None for those that went, and words."""

    buildings: dict[str, Any] = field(default_factory=dict)
    words: tuple[str, ...] = ()


class Session:
    """The edits of a run's folder, which it holds until it is closed.

    Every action is in the folder's file of edits before it is modelled; what another program writes there, or
    into the layer of footprints, is taken in by the next call.

    Parameters
    ----------
    folder : Path
        Folder of a run.
    jobs : int
        Processes.
    """

    def __init__(self, folder: Path, jobs: int = 1) -> None:
        self.folder, self.jobs = folder, jobs
        self.lock = threading.RLock()
        self.undone: list[list[Edit]] = []
        self.failed: frozenset[str] = frozenset()
        """What edits that give no model were last said to be."""
        self.day = datetime.date.today().isoformat()
        self.open()

    def open(self) -> None:
        """Hold the folder, and model what its edits say."""
        with ExitStack() as held:
            self.trial: Trial = held.enter_context(open_trial(self.folder, self.jobs))
            self.queue: list[Reviewed] = read_queue(self.folder)
            self.own = self.trial.kept()
            self.seen: Any = None
            self.fresh = self.take_in()
            self.held = held.pop_all()

    def close(self) -> None:
        """Let go of the folder."""
        self.held.close()

    @property
    def outlines(self) -> dict[str, Polygon]:
        """Id → outline (world metres) of all buildings as they are now."""
        return self.trial.outlines()

    @property
    def reviewed(self) -> dict[str, Edit]:
        """Id → the last edit of each building that was looked at."""
        return {edit.id: edit for edit in self.own if edit.action}

    def model(self) -> Change:
        """Model what all edits say now."""
        corrected = self.trial.correct([*self.own, *self.trial.from_layer()])
        self.seen = self.trial.state()
        changed, known = self.trial.changed(corrected.touched), self.failed
        self.failed = frozenset((*corrected.conflicts, *corrected.failed))
        return Change(changed, tuple(sorted(self.failed - known)))

    def take_in(self) -> Change:
        """What another program changed since the last call."""
        with self.lock:
            if self.seen == self.trial.state():
                return Change()
            self.own = self.trial.kept()
            return self.model()

    def act(self, action: object, origin: tuple[float, float] = (0.0, 0.0)) -> Change:
        """Carry out an action of the page, whose places count from an origin.

        Raises
        ------
        ActionError
            When it cannot be carried out, or a roof so stated is none; no edit is kept then.
        """
        with self.lock:
            before = self.take_in()
            edits = edits_of(action, Table(self.outlines, origin, self.trial.faces))
            reasons = {entry.id: entry.reason for entry in self.queue}
            edits = signed(edits, self.last_action + 1, self.day, reasons)
            undone, kept = self.undone, self.own
            self.undone = []
            change = self.with_edits([*self.own, *edits], before)
            if change.words and {edit.verdict for edit in edits} <= {ROOF_FACE, *OF_ROOF}:
                self.undone = undone
                self.with_edits(kept, before)
                raise ActionError("; ".join(change.words))
            return change

    @property
    def last_action(self) -> int:
        """The number of the last action; 0 for none."""
        return max((edit.action for edit in self.own), default=0)

    def with_edits(self, edits: Sequence[Edit], before: Change) -> Change:
        """Keep edits and model what they say; with what changed `before`."""
        earlier, self.own = self.own, self.trial.keep(edits)
        try:
            after = self.model()
        except BaseException:  # what cannot be modelled must not stay
            self.own = self.trial.keep(earlier)
            raise
        return Change({**before.buildings, **after.buildings}, after.words)

    def undo(self) -> Change:
        """Take back the last action."""
        with self.lock:
            before, last = self.take_in(), self.last_action
            if not last:
                raise ActionError("nothing to undo")
            self.undone.append([edit for edit in self.own if edit.action == last])
            return self.with_edits([edit for edit in self.own if edit.action != last], before)

    def redo(self) -> Change:
        """Carry out again what was taken back last."""
        with self.lock:
            before = self.take_in()
            if not self.undone:
                raise ActionError("nothing to redo")
            return self.with_edits([*self.own, *self.undone.pop()], before)

    def save(self) -> str:
        """Write all files of the run, as `eaves update` does; the words that it ends with."""
        with self.lock:
            self.held.close()
            try:
                return update(self.folder, jobs=self.jobs).as_text()
            finally:
                self.open()

    def tried(self, action: dict[str, Any], verdicts: Sequence[str]) -> dict[str, Any]:
        """Verdict → the building of an action as each of some verdicts would leave it; nothing is kept."""
        with self.lock:
            self.take_in()
            kept = self.own
            choices: dict[str, Any] = {}
            for verdict in verdicts:
                edits = edits_of({**action, "do": "state", "verdict": verdict}, Table(self.outlines))
                self.trial.correct([*kept, *edits, *self.trial.from_layer()])
                name = edits[0].id
                choices[verdict] = self.trial.buildings([name])[name]
            self.trial.correct([*kept, *self.trial.from_layer()])
            return choices
