"""A headless Chromium that is driven by its DevTools protocol: it opens a page, moves the mouse and takes pictures."""

from __future__ import annotations

import base64
import json
import os
import shutil
import subprocess
import time
import urllib.request
from pathlib import Path
from typing import Any

from websockets.sync.client import connect

#: Programs that do, and how long they may take to begin, and to answer [s].
NAMES, PATIENCE = ("chromium", "chromium-browser", "google-chrome"), 200.0
WIDTH, HEIGHT = 1280, 800


def program() -> str | None:
    """The path of a Chromium; None where there is none."""
    return next(filter(None, map(shutil.which, NAMES)), None)


class Browser:
    """A browser with one page. It renders by the processor: pictures take seconds."""

    def __init__(self, folder: Path, address: str) -> None:
        """folder : for its profile."""
        root = ["--no-sandbox"] if os.geteuid() == 0 else []
        command = [
            str(program()), "--headless=new", *root, "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
            "--remote-debugging-port=0", f"--user-data-dir={folder}", f"--window-size={WIDTH},{HEIGHT}", "about:blank",
        ]  # fmt: skip
        self._process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self._number = 0
        port_file = folder / "DevToolsActivePort"
        self._until(lambda: port_file.is_file() and port_file.read_text().count("\n") > 0)
        with urllib.request.urlopen(f"http://127.0.0.1:{port_file.read_text().split()[0]}/json") as answer:
            (page,) = (one for one in json.load(answer) if one["type"] == "page")
        self._socket = connect(page["webSocketDebuggerUrl"], max_size=None)
        self._do("Emulation.setDeviceMetricsOverride", width=WIDTH, height=HEIGHT, deviceScaleFactor=1, mobile=False)
        self._do("Page.navigate", url=address)

    def text(self) -> str:
        """What stands on the page: nothing, as long as there is none."""
        return self._value("document.body?.innerText ?? ''")

    def click(self, label: str) -> None:
        """Click the button with a label, where there is one yet."""
        box = f"[...document.querySelectorAll('button, label')].find(one => one.innerText.trim() == '{label}')"
        place = self._value(f"(r => r && [r.x + r.width / 2, r.y + r.height / 2])({box}?.getBoundingClientRect())")
        if place is not None:
            self._mouse("mousePressed", *place)
            self._mouse("mouseReleased", *place)

    def canvas(self) -> tuple[float, float, float, float]:
        """Left, top, width and height of the picture in space [pixels]."""
        box = "document.querySelector('canvas').getBoundingClientRect()"
        return self._value(f"(r => [r.x, r.y, r.width, r.height])({box})")

    def hover(self, x: float, y: float) -> None:
        """Move the mouse with no button pressed."""
        self._do("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)

    def press(self, x: float, y: float) -> None:
        """Press the left button."""
        self._mouse("mousePressed", x, y)

    def move(self, x: float, y: float) -> None:
        """Move the mouse with the left button pressed."""
        self._mouse("mouseMoved", x, y)

    def release(self, x: float, y: float) -> None:
        """Let go of the left button."""
        self._mouse("mouseReleased", x, y)

    def picture(self, path: Path) -> None:
        """Write what is seen as a PNG."""
        path.write_bytes(base64.b64decode(self._do("Page.captureScreenshot", format="png")["data"]))

    def close(self) -> None:
        """End it."""
        self._process.terminate()
        self._process.wait()

    def _mouse(self, kind: str, x: float, y: float) -> None:
        pressed = 0 if kind == "mouseReleased" else 1
        self._do("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=pressed, clickCount=1)

    def _value(self, expression: str) -> Any:
        answer = self._do("Runtime.evaluate", expression=expression, returnByValue=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def _do(self, method: str, **values: Any) -> dict[str, Any]:
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": values}))
        while (answer := json.loads(self._socket.recv(PATIENCE))).get("id") != self._number:
            pass
        return answer["result"]

    def _until(self, condition: Any) -> None:
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end, "the browser does not begin"
            time.sleep(0.05)
