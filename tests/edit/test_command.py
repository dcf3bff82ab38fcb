"""The command `eaves edit`: it serves, ends with Ctrl-C, and sums up what was edited."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from eaves.cli.app import make_app
from eaves.edit.actions import Session


def test_the_summary_says_which_reasons_led_to_edits(session: Session) -> None:
    name = next(iter(session.outlines))
    session.act({"do": "right", "id": name})
    told = CliRunner().invoke(make_app(), ["edit", str(session.folder), "--summary"])
    assert told.exit_code == 0 and "1 edit: right 1\n" in told.output, told.output


@pytest.mark.slow
def test_ctrl_c_ends_it_clean__and_every_edit_stays(out: Path) -> None:
    command = [sys.executable, "-m", "eaves", "edit", str(out), "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as table:
        assert table.stdout is not None
        assert "this computer only" in table.stdout.readline()
        table.send_signal(signal.SIGINT)
        _, errors = table.communicate(timeout=60)
    assert table.returncode == 130 and "Traceback" not in errors, errors
    assert list(out.glob(".eaves-lock*")) == list(out.glob(".eaves-edit*")) == []
