"""The eaves command: where it is, and a run of it with progress and cancel; of QGIS only the feedback."""

import os
import queue
import shlex
import shutil
import signal
import subprocess
import sys
import threading
from pathlib import Path

SETTING = "EAVES_COMMAND"
PROGRAM = "eaves.exe" if os.name == "nt" else "eaves"
PLACES = ("~/.local/bin", "~/.local/pipx/venvs/eaves/bin", "~/pipx/venvs/eaves/Scripts", "/opt/homebrew/bin")
"""Where pipx and others put programs; desktop programs often start without them on the PATH."""
SHARES = {
    "index": 2, "points": 8, "ground": 20, "regions": 23, "buildings": 40, "write": 7,
    "tiles": 95, "merge": 5,
}  # fmt: skip
"""Usual percentages of the steps in a run."""
AFTER = {"points": 2, "ground": 10, "regions": 30, "buildings": 53, "write": 93, "merge": 95}
"""Percentage that is done before a step."""
POLL_S = 0.2
PATIENCE_S = 20.0
"""A cancelled run gets this long to remove what is half-written."""


class CommandError(Exception):
    """The command is missing, or it ended with an error; the message says so in one line."""


def find_command(setting=""):
    """The words that start the command: from the environment, the setting, the PATH, the places of pipx.

    Raises CommandError when it is nowhere.
    """
    said = os.environ.get(SETTING) or setting
    if said:
        words = [said] if Path(said).exists() else shlex.split(said)
        if words and (Path(words[0]).exists() or shutil.which(words[0])):
            return words
        raise CommandError(f"{said}: there is no such command; correct the setting of the provider eaves")
    places = [str(Path(place).expanduser()) for place in PLACES]
    found = shutil.which(PROGRAM) or shutil.which(PROGRAM, path=os.pathsep.join(places))
    if found:
        return [found]
    raise CommandError(
        "the eaves command was not found; install it with 'pipx install eaves', or name it under Settings, "
        "Options, Processing, Providers, eaves"
    )


def own_environment():
    """The environment without what QGIS sets for its own Python."""
    return {
        name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "GDAL_", "PROJ_"))
    }


def percentage(line):
    """How much of the run is done after a line of progress, as `regions: 3 of 8, …`; None for other lines."""
    step, _, rest = line.partition(":")
    words = rest.replace(",", "").split()
    if step not in SHARES or len(words) < 3 or words[1] != "of" or not (words[0] + words[2]).isdigit():
        return None
    return AFTER.get(step, 0) + SHARES[step] * int(words[0]) / max(int(words[2]), 1)


def run_command(words, feedback):
    """Run the command to its end; its output goes to `feedback`, as do percentages and warnings.

    Raises CommandError when it ends with an error. A cancelled run ends as after Ctrl-C.
    """
    feedback.pushCommandInfo(shlex.join(words))
    group = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP} if os.name == "nt" else {}
    process = subprocess.Popen(
        words,
        env=own_environment(),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        encoding="utf-8",
        errors="replace",
        **group,
    )
    lines = queue.Queue()
    reader = threading.Thread(target=lambda: [lines.put(line) for line in process.stdout], daemon=True)
    reader.start()
    error, cancelled = "", False
    while reader.is_alive() or not lines.empty():
        if feedback.isCanceled() and not cancelled:
            cancelled = True
            stop(process)
        try:
            line = lines.get(timeout=POLL_S).rstrip()
        except queue.Empty:
            continue
        done = percentage(line)
        if done is not None:
            feedback.setProgress(done)
        if line.startswith("error:"):
            error = line.removeprefix("error:").strip()
        elif line.startswith(("WARNING:", "incomplete:")):
            feedback.pushWarning(line)
        else:
            feedback.pushConsoleInfo(line)
    status = process.wait()
    process.stdout.close()
    if status and not cancelled:
        if error or status != 1:
            raise CommandError(error or f"eaves ended with status {status}")
        feedback.pushWarning("the run is incomplete; see the lines above")
    return not cancelled


def stop(process):
    """End a run as Ctrl-C would, and by force when that takes too long."""
    process.send_signal(signal.CTRL_BREAK_EVENT if sys.platform == "win32" else signal.SIGINT)
    timer = threading.Timer(PATIENCE_S, process.kill)
    timer.daemon = True
    timer.start()
