"""Every page that a command writes, in a real browser: no error, every picture, a phone's width, nothing fetched.

A headless Chromium shows the page in frames of a page of the test's own, whose script looks at them.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from collections.abc import Callable
from html import unescape
from pathlib import Path

import pytest

from mrdamp.cli import main
from mrdamp.compare import dyke1996
from mrdamp.diagnosis.report.page import page as diagnosis_page
from mrdamp.diagnosis.report.result import Where
from mrdamp.model import Model
from mrdamp.motions import kanai_tajimi
from mrdamp.records import embedded
from test_diagnosis_report import NOMINAL, found

#: Names under which distributions and the makers install it.
NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
BROWSER = next((path for name in NAMES if (path := shutil.which(name))), None)
# No sandbox: in a container or as root it cannot be had, and the pages are our own.
OPTIONS = ("--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run",
           "--host-resolver-rules=MAP * ~NOTFOUND", "--virtual-time-budget=20000", "--dump-dom")  # fmt: skip
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None, reason="needs Chromium (Debian: apt install chromium)"),
]
PHONE, DESK = 390, 1200  # CSS pixels
STAGES = ("driver", "magnetics", "fluid", "mechanics", "mount", "sensor")
#: What is wrong with a page at each width. Pictures have type of 9 points: their scale is what makes it small.
LOOK = r"""<!doctype html><pre></pre><script>
const page = PAGE, widths = WIDTHS, listen = `<script>
  window.said = [];
  for (const kind of ["error", "warn"]) console[kind] = (...all) => said.push(all.join(" "));
  addEventListener("error", e => said.push(e.message || "missing: " + (e.target.src || e.target.href)), true);
  addEventListener("unhandledrejection", e => said.push(String(e.reason)));
<\/script>`;
async function look(width) {
  const frame = document.createElement("iframe");
  [frame.width, frame.height, frame.srcdoc] = [width, 900, page.replace("<head>", "<head>" + listen)];
  await new Promise(done => { frame.onload = done; document.body.append(frame); });
  const view = frame.contentWindow, doc = view.document, all = what => Array.from(doc.querySelectorAll(what));
  const wrong = (is, said) => { if (is) view.said.push(`${width} px: ${said}`); };
  for (const entry of view.performance.getEntriesByType("resource"))
    wrong(!entry.name.startsWith("data:"), "asks for " + entry.name);
  const sources = [...Array.from(doc.images, i => i.src), ...all("svg image").map(i => i.href.baseVal)];
  for (const source of sources) {
    const picture = new Image();
    picture.src = source;
    await picture.decode().catch(() => null);
    wrong(!picture.naturalWidth, "a picture is missing");
  }
  const drawn = all("figure svg");
  const empty = s => s.getBoundingClientRect().height < 20 || s.querySelectorAll("path").length < 3;
  wrong(drawn.some(empty), "one is empty");
  wrong(!drawn.length && !all("figure img").length, "no picture at all");
  wrong(doc.documentElement.scrollWidth > doc.documentElement.clientWidth, "wider than the screen");
  wrong(all("body *").some(e => !e.closest("svg") && parseFloat(view.getComputedStyle(e).fontSize) < 12 &&
    Array.from(e.childNodes).some(n => n.nodeType == 3 && n.data.trim())), "text below 12 px");
  wrong(drawn.some(s => s.getBoundingClientRect().width < 0.95 * s.viewBox.baseVal.width), "a picture too small");
  return view.said;
}
(async () => {
  const found = [];
  for (const width of widths) found.push(...await look(width));
  document.querySelector("pre").textContent = JSON.stringify(found);
})();
</script>"""


def faults(page: Path, folder: Path, widths: tuple[int, ...], dark: bool = False) -> list[str]:
    """What is wrong with a page at widths (CSS pixels)."""
    text = json.dumps(page.read_text(encoding="utf-8")).replace("</", r"<\/")
    (folder / "look.html").write_text(LOOK.replace("PAGE", text).replace("WIDTHS", str(list(widths))), encoding="utf-8")
    scheme = f"--blink-settings=preferredColorScheme={int(not dark)}"
    command = [str(BROWSER), *OPTIONS, scheme, f"--user-data-dir={folder}", (folder / "look.html").as_uri()]
    dumped = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120).stdout
    said = re.search(r"<pre>(.+?)</pre>", dumped, re.S)
    assert said, "the browser did not get to the end"
    complaints: list[str] = json.loads(unescape(said[1]))
    return complaints


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
def test_page_is_whole_and_fits_a_phone(name: str, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    page, profile = PAGES[name](tmp_path), tmp_path_factory.mktemp("profile")
    assert faults(page, profile, (DESK, PHONE)) == []
    assert faults(page, profile, (PHONE,), dark=True) == []
