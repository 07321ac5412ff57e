"""Every page that a command writes, in a real browser: no error, every picture, a phone's width, nothing fetched.

A headless Chromium over its DevTools protocol (https://chromedevtools.github.io/devtools-protocol/).
"""

from __future__ import annotations

import json
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from websockets.sync.client import ClientConnection, connect

from mrdamp.cli import main
from mrdamp.compare import dyke1996
from mrdamp.diagnosis.report.page import page as diagnosis_page
from mrdamp.diagnosis.report.result import Where
from mrdamp.model import Model
from mrdamp.motions import kanai_tajimi
from mrdamp.records import embedded
from test_diagnosis_changes import NOMINAL, found

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


pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(executable() is None, reason="needs Chromium (Debian: apt install chromium)"),
]
PHONE, DESK = 390, 1200  # CSS pixels
STAGES = ("driver", "magnetics", "fluid", "mechanics", "mount", "sensor")


@pytest.fixture(scope="module")
def tab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Tab]:
    with browser(tmp_path_factory.mktemp("profile")) as found:
        yield found


def faults(tab: Tab, page: Path, width: int, dark: bool = False) -> list[str]:
    """What is wrong with a page at a width."""
    tab.open(page.as_uri(), width, dark=dark)
    found = tab.complaints()
    found += [
        f"asks for {url}" for url in tab.requests() if url != page.as_uri() and not url.startswith("data:")
    ]
    missing = tab.evaluate("""Promise.all([
        ...Array.from(document.images, i => i.src),
        ...Array.from(document.querySelectorAll("svg image"), i => i.href.baseVal),
    ].map(source => {
        const picture = new Image();
        picture.src = source;
        return picture.decode().then(() => picture.naturalWidth > 0 ? 0 : 1, () => 1);
    })).then(all => all.reduce((a, b) => a + b, 0))""")
    empty = tab.evaluate("""Array.from(document.querySelectorAll("figure svg")).filter(svg =>
        svg.getBoundingClientRect().height < 20 || svg.querySelectorAll("path").length < 3).length""")
    if missing or empty:
        found.append(f"{missing} pictures missing, {empty} empty")
    if not tab.evaluate("document.querySelectorAll('figure svg, figure img').length"):
        found.append("no picture at all")
    wide = tab.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")
    if wide > 0:
        found.append(f"{wide} px wider than the screen")
    # Pictures have type of 9 points: their scale is what makes it small.
    small = tab.evaluate("""Array.from(document.querySelectorAll("body *")).filter(e => !e.closest("svg") &&
        Array.from(e.childNodes).some(n => n.nodeType == 3 && n.data.trim()) &&
        parseFloat(getComputedStyle(e).fontSize) < 12).length""")
    scale = tab.evaluate("""Math.min(1, ...Array.from(document.querySelectorAll("figure svg"), svg =>
        svg.getBoundingClientRect().width / svg.viewBox.baseVal.width))""")
    if small or scale < 0.95:
        found.append(f"{small} texts below 12 px, pictures at {scale:.2f} of their size")
    return found


# --- the pages ------------------------------------------------------------------------------
def demo_page(folder: Path) -> Path:
    records = embedded()
    for half, chosen in (("train", records.train[1:4]), ("validation", records.validation[:2])):
        (folder / "set" / half).mkdir(parents=True)
        for r in chosen:
            r.part(0.0, 2.0).save(folder / "set" / half / f"{r.name}.csv")
    assert main(["demo", "--data", str(folder / "set"), "--law", "bouc_wen", "-o", str(folder)]) == 0
    return folder / "index.html"


def network_page(folder: Path) -> Path:
    call = ["identify", "--law", "narx", "--hidden", "4", "--lags", "1", "--initialisations", "1"]
    call += "--protocol varying --record sine_5.0Hz_2.5mm_random_current --counts 1200:600:500".split()
    assert main([*call, "--page", str(folder / "index.html"), "-o", str(folder / "model.json")]) == 0
    return folder / "index.html"


def comparison_page(folder: Path) -> Path:
    kanai_tajimi(1, duration=6.0, rise=1.0, plateau=2.0, decay=1.0).save(folder / "quake.csv")
    call = ["compare", "frame", "--controllers", "passive-off", "passive-on", "c=constant:value=0.5"]
    call += ["--motions", str(folder / "quake.csv"), "--amplitudes", "0.5", "1", "--jobs", "1"]
    assert main([*call, "-o", str(folder / "compared")]) == 0
    return folder / "compared" / "index.html"


def published_page(folder: Path) -> Path:
    motion = kanai_tajimi(1, duration=6.0, rise=1.0, plateau=2.0, decay=1.0)
    dyke1996.page(dyke1996.table(motion), motion).write(folder / "index.html")
    return folder / "index.html"


def inverse_page(folder: Path) -> Path:
    parameters = {"c0a": 400.0, "c0b": 150.0, "fya": 50.0, "fyb": 600.0, "v_ref": 0.01}
    model = str(folder.parent / f"{folder.name}.json")
    Model("bingham", {**parameters, "command_min": 0.0, "command_max": 2.0}, name="bingham").write(model)
    call = ["inverse", model, "--plant", model, "--no-network", "--seconds", "2", "-o", str(folder)]
    assert main(call) == 0
    return folder / "index.html"


def diagnosed_page(folder: Path) -> Path:
    records = embedded().validation[:4]
    where = Where({s: float(s == "driver") for s in STAGES}, {r.name: 0.25 for r in records})
    diagnosis_page(found(where=where), NOMINAL, records).write(folder / "index.html")
    return folder / "index.html"


PAGES: dict[str, Callable[[Path], Path]] = {
    "demo": demo_page,
    "identify --law narx": network_page,
    "compare": comparison_page,
    "compare --preset dyke1996": published_page,
    "inverse": inverse_page,
    "diagnose": diagnosed_page,
}


@pytest.mark.parametrize("name", PAGES)
def test_page_is_whole_and_fits_a_phone(name: str, tab: Tab, tmp_path: Path) -> None:
    page = PAGES[name](tmp_path)
    assert faults(tab, page, DESK) == []
    assert faults(tab, page, PHONE) == []
    assert faults(tab, page, PHONE, dark=True) == []
