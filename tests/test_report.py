"""The page of a report."""

from __future__ import annotations

import re
from html.parser import HTMLParser

import numpy as np
import pytest
from matplotlib.figure import Figure

from mrdamp import pictures
from mrdamp.pictures import LoopData
from mrdamp.report import Page
from mrdamp.report import page as report
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
