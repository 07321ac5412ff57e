"""A headless Chromium over its DevTools protocol (https://chromedevtools.github.io/devtools-protocol/)."""

from __future__ import annotations

import base64
import json
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from websockets.sync.client import ClientConnection, connect

#: Names under which distributions and the makers install it.
NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
_START, _REPLY, _LOAD = 30.0, 60.0, 30.0  # s


def executable() -> str | None:
    """The browser's path, None where none is installed."""
    return next((path for name in NAMES if (path := shutil.which(name))), None)


class Tab:
    """One tab: what it was told to do and all that it reported since it was opened."""

    def __init__(self, connection: ClientConnection) -> None:
        self._connection = connection
        self._calls = 0
        self.events: list[dict[str, Any]] = []
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: object) -> dict[str, Any]:
        """A command's result; raises RuntimeError where the browser refuses it."""
        self._calls += 1
        self._connection.send(json.dumps({"id": self._calls, "method": method, "params": parameters}))
        while True:
            message = json.loads(self._connection.recv(timeout=_REPLY))
            if message.get("id") != self._calls:
                self.events.append(message)
            elif "error" in message:
                raise RuntimeError(f"{method}: {message['error']['message']}")
            else:
                result: dict[str, Any] = message["result"]
                return result

    def open(self, url: str, width: int, height: int = 900, dark: bool = False) -> None:
        """Loads a page at a width in CSS pixels (a phone's below 600), and waits for its load event."""
        phone = width < 600
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=phone,
        )
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])
        self.events.clear()
        self.call("Page.navigate", url=url)
        deadline = time.monotonic() + _LOAD
        while not self.reported("Page.loadEventFired"):
            self.events.append(json.loads(self._connection.recv(timeout=deadline - time.monotonic())))
        self.evaluate("1")  # what was reported up to now has come in

    def evaluate(self, expression: str) -> Any:
        """A script's value in the page, or what it promises; raises RuntimeError where it throws."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            raise RuntimeError(answer["exceptionDetails"]["text"])
        return answer["result"].get("value")

    def reported(self, method: str) -> list[dict[str, Any]]:
        """Parameters of the events of one kind."""
        return [event["params"] for event in self.events if event["method"] == method]

    def complaints(self) -> list[str]:
        """Exceptions, the console's errors and warnings, and the browser's own (a refused or missing resource)."""
        thrown = [e["exceptionDetails"]["text"] for e in self.reported("Runtime.exceptionThrown")]
        said = [(e["type"], str(e["args"])) for e in self.reported("Runtime.consoleAPICalled")]
        said += [(e["entry"]["level"], e["entry"]["text"]) for e in self.reported("Log.entryAdded")]
        return thrown + [text for level, text in said if level in ("error", "warning")]

    def requests(self) -> list[str]:
        """Every address asked for."""
        return [event["request"]["url"] for event in self.reported("Network.requestWillBeSent")]

    def screenshot(self, path: Path) -> None:
        """The whole page as PNG."""
        size = self.call("Page.getLayoutMetrics")["cssContentSize"]
        clip = {"x": 0, "y": 0, "width": size["width"], "height": size["height"], "scale": 1}
        picture = self.call("Page.captureScreenshot", clip=clip, captureBeyondViewport=True)
        path.write_bytes(base64.b64decode(picture["data"]))


@contextmanager
def browser(profile: Path) -> Iterator[Tab]:
    """A running browser with one tab; it ends with the block. profile: an empty folder."""
    path = executable()
    assert path is not None
    # No sandbox: in a container or as root it cannot be had, and the pages are our own.
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run"]
    options += ["--disable-background-networking", "--remote-debugging-port=0", f"--user-data-dir={profile}"]
    process = subprocess.Popen(
        [path, *options, "about:blank"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        port = _port(process, profile / "DevToolsActivePort")
        with connect(f"ws://127.0.0.1:{port[0]}{port[1]}", max_size=None, proxy=None) as whole:
            whole.send(
                json.dumps({"id": 1, "method": "Target.createTarget", "params": {"url": "about:blank"}})
            )
            while (message := json.loads(whole.recv(timeout=_REPLY))).get("id") != 1:
                pass
            target = message["result"]["targetId"]
            with connect(
                f"ws://127.0.0.1:{port[0]}/devtools/page/{target}", max_size=None, proxy=None
            ) as tab:
                yield Tab(tab)
    finally:
        process.terminate()
        process.wait(timeout=_START)


def _port(process: subprocess.Popen[bytes], told: Path) -> tuple[str, str]:
    """The port and the browser's address, which it writes into its profile once it listens."""
    deadline = time.monotonic() + _START
    while time.monotonic() < deadline and process.poll() is None:
        lines = told.read_text().split() if told.exists() else []
        if len(lines) == 2:
            return lines[0], lines[1]
        time.sleep(0.05)
    raise RuntimeError(f"the browser did not start (exit code {process.poll()})")
