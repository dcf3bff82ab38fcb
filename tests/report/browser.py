"""A headless Chromium driven through the WebDriver protocol with nothing but the standard library."""

from __future__ import annotations

import base64
import json
import shutil
import subprocess
import time
import urllib.request
from pathlib import Path
from types import TracebackType
from typing import Any

FLAGS = (
    "--headless",
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--hide-scrollbars",
    "--force-device-scale-factor=1",
)
"""Software drawing, so that the tests see the same picture on every machine."""


def missing() -> str:
    """Why there is no browser to test in; empty when there is one."""
    driver = shutil.which("chromedriver")
    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    return "" if driver and chromium else "neither chromium nor chromedriver is installed"


class Browser:
    """One window; `errors()` are the console's errors since the last call."""

    def __init__(self, width: int = 1400, height: int = 900, dark: bool = False) -> None:
        self.driver = subprocess.Popen(
            ["chromedriver", "--port=0"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        assert self.driver.stdout is not None
        port = ""
        for line in self.driver.stdout:
            if "on port" in line and "started" in line:
                port = line.rstrip().rstrip(".").rsplit(" ", 1)[1]
                break
        self.base = f"http://127.0.0.1:{port}"
        flags = [*FLAGS, f"--window-size={width},{height}"]
        if dark:
            flags.append("--force-dark-mode")
        wanted = {
            "browserName": "chrome",
            "goog:chromeOptions": {"args": flags},
            "goog:loggingPrefs": {"browser": "ALL"},
        }
        session = self.call("POST", "/session", {"capabilities": {"alwaysMatch": wanted}})
        self.base += f"/session/{session['sessionId']}"
        if width < 500:  # no window is narrower
            shape = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
            command = {"cmd": "Emulation.setDeviceMetricsOverride", "params": shape}
            self.call("POST", "/goog/cdp/execute", command)

    def __enter__(self) -> Browser:
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        try:
            self.call("DELETE", "")
        finally:
            self.driver.terminate()
            self.driver.wait(10)
            if self.driver.stdout is not None:
                self.driver.stdout.close()

    def call(self, method: str, path: str, body: dict[str, Any] | None = None) -> Any:
        """The value of a WebDriver command's answer."""
        data = None if method in ("GET", "DELETE") else json.dumps(body or {}).encode()
        request = urllib.request.Request(
            self.base + path, data, {"Content-Type": "application/json"}, method=method
        )
        with urllib.request.urlopen(request, timeout=120) as answer:
            return json.load(answer)["value"]

    def open(self, page: Path, state: str = "") -> None:
        """Load a page from disk and wait until it is drawn."""
        self.call("POST", "/url", {"url": "about:blank"})
        self.call("POST", "/url", {"url": f"{page.resolve().as_uri()}#{state}"})
        limit = time.monotonic() + 60
        while self.run("return document.documentElement.dataset.ready") is None:
            assert time.monotonic() < limit, f"the page does not get ready: {self.errors()}"
            time.sleep(0.1)
        self.settle()

    def settle(self) -> None:
        """Wait until what was asked for is painted whole."""
        limit = time.monotonic() + 60
        while self.run("return document.documentElement.dataset.still") == "no":
            assert time.monotonic() < limit, f"the page does not come to rest: {self.errors()}"
            time.sleep(0.02)

    def run_async(self, script: str) -> Any:
        """What a script hands to its last argument, a function."""
        return self.call("POST", "/execute/async", {"script": script, "args": []})

    def run(self, script: str) -> Any:
        """What a script returns."""
        return self.call("POST", "/execute/sync", {"script": script, "args": []})

    def click(self, x: float, y: float) -> None:
        """Press and release the left button at a place of the window."""
        self._point(
            [
                {"type": "pointerMove", "x": round(x), "y": round(y)},
                {"type": "pointerDown", "button": 0},
                {"type": "pointerUp", "button": 0},
            ]
        )

    def drag(self, start: tuple[float, float], end: tuple[float, float], kind: str = "mouse") -> None:
        """Move the pointer with the left button held, or a finger."""
        self._point(
            [
                {"type": "pointerMove", "x": round(start[0]), "y": round(start[1])},
                {"type": "pointerDown", "button": 0},
                {"type": "pointerMove", "x": round(end[0]), "y": round(end[1]), "duration": 50},
                {"type": "pointerUp", "button": 0},
            ],
            kind,
        )

    def tap(self, x: float, y: float) -> None:
        """Touch a place of the window."""
        self.drag((x, y), (x, y), "touch")

    def press(self, *keys: str) -> None:
        """Type keys where the focus is."""
        steps = [{"type": kind, "value": key} for key in keys for kind in ("keyDown", "keyUp")]
        self.call("POST", "/actions", {"actions": [{"type": "key", "id": "keys", "actions": steps}]})
        self.settle()

    def _point(self, steps: list[dict[str, Any]], kind: str = "mouse") -> None:
        pointer = {"type": "pointer", "id": kind, "parameters": {"pointerType": kind}, "actions": steps}
        self.call("POST", "/actions", {"actions": [pointer]})
        self.settle()

    def errors(self) -> list[str]:
        """Messages of the console that are errors."""
        log = self.call("POST", "/se/log", {"type": "browser"})
        return [entry["message"] for entry in log if entry["level"] == "SEVERE"]

    def picture(self, path: Path) -> Path:
        """A screenshot of the window."""
        path.write_bytes(base64.b64decode(self.call("GET", "/screenshot")))
        return path
