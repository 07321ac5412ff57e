"""The page: one file that fetches nothing, says what its pictures show, and is never half written."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from mrdamp import pictures
from mrdamp.errors import InputError
from mrdamp.pictures import LoopData
from mrdamp.pictures.style import DARK
from mrdamp.report import Cell, Page
from mrdamp.report import page as report

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

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, {name: value or "" for name, value in attrs}))

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

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


def test_the_page_fetches_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    page = full_page()
    monkeypatch.setattr(report, "PICTURE_LIMIT", 10_000)
    page.figure("Dots", picture(), "Many points.", "A cloud.")
    parsed = Parsed(page.html())
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


def test_every_picture_says_what_it_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    page = full_page()
    monkeypatch.setattr(report, "PICTURE_LIMIT", 10_000)
    page.figure("Dots", picture(), "Many points.", "A cloud.")
    parsed = Parsed(page.html())
    described = [a["aria-label"] for a in parsed.all("div") if a.get("role") == "img"]
    assert described == ["Two loops that almost agree.", "Again."]
    assert len(parsed.all("svg")) == 2
    assert [a["alt"] for a in parsed.all("img")] == ["A cloud."]
    assert len(parsed.all("figure")) == len(parsed.all("figcaption")) == 3
    with pytest.raises(InputError, match="'The caption' has no alt text"):
        page.figure("x", picture(), "The caption", "  ")


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
    assert (
        next(a["aria-label"] for a in parsed.all("div") if "aria-label" in a and a.get("role") == "img")
        == EVIL
    )


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
    with pytest.raises(InputError, match="table 'T' has 2 columns and a row of 1"):
        page.table("T", ["a", "b"], [["x"]])
    page = Page("t", "s")
    page.table("T", ["peak drift, mm", "RMS error (N)", "of all (see below)", "one, or the other"], [])
    heads = re.findall(r"<th scope=\"col\"[^>]*>([^<]*)<", page.html())
    assert heads == ["peak drift,\u00a0mm", "RMS error\u00a0(N)", "of all (see below)", "one, or the other"]


def test_a_failure_leaves_the_old_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "index.html"
    full_page().write(target)
    old = target.read_text()
    assert old.startswith("<!doctype html>")
    assert old.rstrip().endswith("</html>")
    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", lambda *_: (_ for _ in ()).throw(OSError(28, "No space left on device")))
        with pytest.raises(InputError, match="cannot be written: No space left"):
            Page("new", "new").write(target)
    assert target.read_text() == old
    broken = Page("new", "new")
    broken.text("x", [1])  # type: ignore[list-item]
    broken._add("x", "figure", object())
    with pytest.raises(Exception, match="has no attribute"):
        broken.write(target)
    assert target.read_text() == old
    assert [path.name for path in tmp_path.iterdir()] == ["index.html"]
    with pytest.raises(InputError, match="cannot be written"):
        Page("new", "new").write(tmp_path / "missing" / "index.html")


def test_a_polyline_in_steps_is_the_same_line() -> None:
    points = np.cumsum(np.random.default_rng(3).normal(0, 3, (200, 2)), axis=0)
    path = "M {:.6f} {:.6f} \n".format(*points[0]) + "".join(f"L {x:.6f} {y:.6f} \n" for x, y in points[1:])
    short = report._short(path)
    assert len(short) < 0.6 * len(path)
    numbers = [float(n) for n in re.findall(r"-?(?:\d+\.?\d*|\.\d+)", short)]
    back = np.cumsum(np.reshape(numbers, (-1, 2)), axis=0)
    np.testing.assert_allclose(back, points, atol=0.0051)
    assert report._short("M 0 0 \nQ 1 2 3 4 \nz \n") == "M 0 0 Q 1 2 3 4 z"


@pytest.mark.slow
def test_pictures_leave_no_global_state() -> None:
    code = (
        "import sys, numpy as np, matplotlib\n"
        "from mrdamp.pictures.style import STYLE\n"
        "before = {key: matplotlib.rcParams[key] for key in STYLE}\n"
        "from mrdamp import pictures\n"
        "from mrdamp.report import Page\n"
        "page = Page('t', 's')\n"
        "page.figure('h', pictures.error_bars(['a'], [0.1], [True]), 'c', 'alt')\n"
        "page.html()\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
        "assert {key: matplotlib.rcParams[key] for key in STYLE} == before != STYLE\n"
    )
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
