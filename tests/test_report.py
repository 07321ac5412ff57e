"""The page of a report and that of the demo."""

from __future__ import annotations

import io
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import mujoco.viewer
import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from mrdamp import cli, models_xml, pictures, sets
from mrdamp.control import passive_on
from mrdamp.demo import UNCONTROLLED, accelerated
from mrdamp.envs.frame_xml import Clip, animate
from mrdamp.errors import InputError
from mrdamp.model import Model, effects_from
from mrdamp.motions import embedded_motion
from mrdamp.pictures import LoopData
from mrdamp.pictures.style import DARK
from mrdamp.report import Cell, Page
from mrdamp.report import page as report
from mrdamp.simulation.criteria import Criteria, evaluate
from mrdamp.simulation.stepping import FrameRun, run_frame
from mrdamp.structures import dyke1996
from refusals import refuses

VOID = {"meta", "img", "wbr", "br", "link"}
EVIL = "<script>alert(\"1\")</script> & 'x'"


class Parsed(HTMLParser):
    """Start tags with attributes, the text outside of style, and whether all elements are closed in order."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str]]] = []
        self.text = ""
        self.style = ""
        self._open: list[str] = []
        self.feed(html)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, {name: value or "" for name, value in attrs}))
        if tag not in VOID:
            self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert tag in VOID or self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self._open and self._open[-1] == "style":
            self.style += data
        else:
            self.text += data

    def all(self, tag: str) -> list[dict[str, str]]:
        return [attributes for name, attributes in self.tags if name == tag]


def picture(name: str = "sine") -> Figure:
    time = np.arange(0.0, 2.0, 0.002)
    x, v = 5e-3 * np.sin(15 * time), 75e-3 * np.cos(15 * time)
    force = 1e3 * np.tanh(50 * v)
    return pictures.loops([LoopData(name, time, x, v, 1 + 0 * x, force, 0.9 * force)], periods=8)


def full_page() -> Page:
    page = Page("A damper", "One sentence first.", "the last line")
    page.text("What", ["One paragraph with `mrdamp demo`.", "Another."])
    page.table(
        "Numbers",
        ["record", "half", "error, N"],
        [["a_b", "held out", 0.1], ["c", "fitted", 1234.5]],
        "Note.",
    )
    page.figure("Loops", picture(), "The caption.", "Two loops that\n almost agree.")
    page.figure("", picture("other"), "A second one.", "Again.")
    return page


@pytest.fixture
def with_dots(monkeypatch: pytest.MonkeyPatch) -> Page:
    """The page with a picture that is kept in pixels, as one of many points is."""
    page = full_page()
    monkeypatch.setattr(report, "PICTURE_LIMIT", 10_000)
    page.figure("Dots", picture(), "Many points.", "A cloud.")
    return page


def test_parts_stand_in_the_order_they_were_added() -> None:
    html = full_page().html()
    text = " ".join(Parsed(html).text.split())
    order = "One sentence|One paragraph|Another|1234|Note.|The caption.|A second one.|the last line".split(
        "|"
    )
    places = [text.index(part) for part in order]
    assert places == sorted(places)
    assert re.findall(r"<h([12])>([^<]*)<", html) == [
        ("1", "A damper"),
        *(("2", h) for h in ("What", "Numbers", "Loops")),
    ]
    assert html.count("<section") == 3
    assert len(html) < 250_000
    assert "<title>A damper</title>" in html
    assert "<code>mrdamp demo</code>" in html
    assert full_page().html() == html


def test_the_page_fetches_nothing(with_dots: Page) -> None:
    parsed = Parsed(with_dots.html())
    names = {tag for tag, _ in parsed.tags}
    assert not names & {"script", "link", "iframe", "object", "embed", "base", "audio", "video", "form"}
    ids = [attributes["id"] for _, attributes in parsed.tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    targets = 0
    for tag, attributes in parsed.tags:
        for name, value in attributes.items():
            assert not name.startswith("on"), (tag, name)
            if name in ("href", "xlink:href"):
                assert value.startswith("#"), (tag, value)
                assert value[1:] in ids
                targets += 1
            elif name in ("src", "srcset", "poster", "data", "action"):
                assert value.startswith("data:image/png;base64,"), (tag, name)
            elif not name.startswith("xmlns"):
                assert "//" not in value, (tag, name, value)
            for reference in re.findall(r"url\(([^)]*)\)", value):
                assert reference.startswith("#")
                assert reference[1:] in ids
                targets += 1
    assert targets > 100
    assert len(parsed.all("style")) == 1  # a picture's own would hold for the whole page
    assert "url(" not in parsed.style
    assert "@import" not in parsed.style
    policy = next(m["content"] for m in parsed.all("meta") if "http-equiv" in m)
    assert policy.startswith("default-src 'none'")


def test_every_picture_says_what_it_shows(with_dots: Page) -> None:
    parsed = Parsed(with_dots.html())
    described = [a["aria-label"] for a in parsed.all("div") if a.get("role") == "img"]
    assert described == ["Two loops that almost agree.", "Again."]
    assert len(parsed.all("svg")) == 2
    assert [a["alt"] for a in parsed.all("img")] == ["A cloud."]
    assert len(parsed.all("figure")) == len(parsed.all("figcaption")) == 3
    refuses(lambda: with_dots.figure("x", picture(), "The caption", "  "), "'The caption' has no alt text")


def test_phones_and_dark_pages_are_provided_for() -> None:
    html = full_page().html()
    parsed = Parsed(html)
    assert {"name": "viewport", "content": "width=device-width, initial-scale=1"} in parsed.all("meta")
    assert "prefers-color-scheme: dark" in parsed.style
    assert [a["class"] for a in parsed.all("div") if "class" in a] == ["scroll"]
    assert re.search(r"\.scroll \{[^}]*overflow-x: auto", parsed.style)
    body = html[html.index("<body>") :]
    for k, (light, dark) in enumerate(DARK.items()):
        assert light not in body
        assert parsed.style.index(f"--c{k}:{light};") < parsed.style.index(f"--c{k}:{dark};")
        assert parsed.style.index("prefers-color-scheme") < parsed.style.index(f"--c{k}:{dark};")
    assert "var(--c0)" in body


def test_names_are_text_and_never_markup() -> None:
    page = Page(EVIL, EVIL, EVIL)
    page.text(EVIL, [EVIL])
    page.table(EVIL, [EVIL, "b"], [[EVIL, EVIL]], EVIL)
    page.figure(EVIL, picture(EVIL), EVIL, EVIL)
    html = page.html()
    parsed = Parsed(html)
    assert not parsed.all("script")
    assert "<script" not in html
    assert parsed.text.count(EVIL) >= 10
    assert [a["aria-label"] for a in parsed.all("div") if a.get("role") == "img"] == [EVIL]


def test_numbers_are_short_and_flush_right_and_a_unit_stays_with_its_word() -> None:
    page = Page("t", "s")
    rows: list[list[Cell]] = [
        ["a_1", "held out", 0.12345, 12345.6, None, "3 %", 7],
        ["b", "fitted", 2.0, 0.1, "1.5 mm", "–", 12],
    ]
    page.table("T", ["name", "half", "x", "y", "z", "p", "n"], rows)
    html = page.html()
    cells = re.findall(r"<td( class=\"n\")?[^>]*>([^<]*)</td>", html)
    assert [text for _, text in cells] == [
        "held out", "0.123", "12346", "–", "3 %", "7", "fitted", "2.00", "0.100", "1.5 mm", "–", "12",
    ]  # fmt: skip
    assert [bool(right) for right, _ in cells] == [False, True, True, True, True, True] * 2
    assert '<th scope="row">a_<wbr>1</th>' in html
    assert html.count('<th scope="col"') == 7
    refuses(lambda: page.table("T", ["a", "b"], [["x"]]), "table 'T' has 2 columns and a row of 1")
    page = Page("t", "s")
    page.table("T", ["peak drift, mm", "RMS error (N)", "of all (see below)", "one, or the other"], [])
    heads = re.findall(r"<th scope=\"col\"[^>]*>([^<]*)<", page.html())
    assert heads == ["peak drift,\u00a0mm", "RMS error\u00a0(N)", "of all (see below)", "one, or the other"]


@pytest.fixture(scope="module")
def model() -> Model:
    found = sets.load("dyke1996_3kN")
    return Model(
        found.law, dict(found.parameters), effects_from(found.attributes()), rig="frame", structure=dyke1996()
    )


@pytest.fixture(scope="module")
def runs(model: Model) -> dict[str, FrameRun]:
    motion = embedded_motion().compressed(5.0)
    return {name: run_frame(model, motion, c) for name, c in ((UNCONTROLLED, None), ("on", passive_on(2.25)))}


def criteria(run: FrameRun) -> Criteria:
    return evaluate(dyke1996(), run.time, run.drift, run.acceleration, run.force, None, run.command, None)


def test_animation_moves_and_differs_from_its_still(model: Model, runs: dict[str, FrameRun]) -> None:
    clip = Clip(size=(60, 90), count=6, slower=5.0, rate=20.0)
    try:
        drawn = animate(model, list(runs.values()), list(runs), 2.25, clip)
    except InputError:
        pytest.skip("no renderer")
    with Image.open(io.BytesIO(drawn.moving)) as moving:
        assert getattr(moving, "n_frames", 1) == 6
        first = np.asarray(moving.convert("RGB"), dtype=float)
        moving.seek(3)
        later = np.asarray(moving.convert("RGB"), dtype=float)
    assert first.shape == (drawn.height, drawn.width, 3) == (116, 120, 3)
    left, right = (np.abs(first - later)[:90, part].mean() for part in (slice(0, 60), slice(60, 120)))
    assert left > 0.1  # the frame without a damper sways
    assert right > 0.0
    assert len(drawn.still) < len(drawn.moving)


def test_a_controller_that_accelerates_the_frame_gets_a_sentence(runs: dict[str, FrameRun]) -> None:
    found = {name: criteria(run) for name, run in runs.items()}
    free = float(found[UNCONTROLLED].peak_acceleration.max())
    assert accelerated({**found, "on": replace(found["on"], peak_acceleration=np.full(3, 0.5 * free))}) == []
    loud = replace(found["on"], peak_acceleration=np.array([1.5, 1.0, 1.0]) * free, switching_rate=80.0)
    (said,) = accelerated({**found, "on": loud})
    assert f"{1.5 * free:#.3g} m/s2 at floor 1, above the {free:#.3g} m/s2" in said
    assert "80 times a second" in said
    stiff = replace(
        found["on"], peak_acceleration=np.array([0.5, 1.0, 1.5]) * free, switching_rate=0.0,
        peak_drift=found[UNCONTROLLED].peak_drift * [0.2, 2.0, 1.0],
    )  # fmt: skip
    (said,) = accelerated({**found, "on": stiff})
    assert "storey 1 nearly rigid" in said


@pytest.mark.parametrize("name", ["frame3", "cable", "rig", "dyke1996_3kN"])
def test_the_viewer_is_given_a_file_with_a_camera_aimed_at_it(
    monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    seen: list[mujoco.MjModel] = []
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(
        mujoco.viewer, "launch_from_path", lambda path: seen.append(mujoco.MjModel.from_xml_path(path))
    )
    assert cli.main(["view", name]) == 0
    (model,) = seen
    camera = mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(model, camera)
    assert camera.elevation > -30  # from the side; MuJoCo's own is 45 degrees from above
    if name in models_xml.names():
        assert Path(models_xml.path(name, "scene.xml")).is_file()
