"""Pictures: the numbers that are drawn, in the unit on the axis. The page of a report."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from mrdamp import pictures
from mrdamp.pictures import LoopData, style
from mrdamp.report import Page
from mrdamp.report import page as report
from refusals import refuses

TIME = np.arange(0.0, 4.0, 0.002)


def loop(name: str = "sine_2.5Hz_5mm", **changes: Any) -> LoopData:
    """5 mm at 2.5 Hz, 1000 N, simulated 10 % too small."""
    w = 2 * np.pi * 2.5
    x, v = 5e-3 * np.sin(w * TIME), 5e-3 * w * np.cos(w * TIME)
    force = 1000.0 * np.tanh(60 * v)
    given = {"displacement": x, "velocity": v, "measured": force, "simulated": 0.9 * force}
    return LoopData(name, **{"time": TIME, "command": np.ones_like(x), **given, **changes})


def lines(ax: Axes) -> list[np.ndarray]:
    return [np.asarray(line.get_xydata()) for line in ax.lines if len(np.atleast_1d(line.get_xdata())) > 2]


def bars(ax: Axes) -> list[float]:
    return [p.get_width() for p in ax.patches if isinstance(p, Rectangle) and p.get_height() > 0.5]


def test_loops_show_force_over_displacement_and_velocity() -> None:
    fig = pictures.loops([loop()])
    left, right = fig.axes
    assert left.get_xlabel() == "displacement, mm"
    assert right.get_xlabel() == "velocity, mm/s"
    assert left.get_ylabel() == "force, N"
    for ax, peak in ((left, 5.0), (right, 5.0 * 2 * np.pi * 2.5)):
        simulated, measured = lines(ax)
        np.testing.assert_allclose(np.abs(measured[:, 0]).max(), peak, rtol=1e-3)
        np.testing.assert_allclose(np.abs(measured[:, 1]).max(), 1000 * np.tanh(60 * 0.0785398), rtol=1e-3)
        np.testing.assert_allclose(simulated[:, 1], 0.9 * measured[:, 1])
    simulated_line, measured_line = left.lines
    assert measured_line.get_color() == style.INK
    assert measured_line.get_linewidth() < 1 < simulated_line.get_linewidth()


def test_units_follow_the_size() -> None:
    big = loop(measured=2e5 * np.sin(TIME), displacement=0.3 * np.sin(TIME), velocity=2 * np.cos(TIME))
    left, right = pictures.loops([big]).axes
    assert (left.get_xlabel(), left.get_ylabel()) == ("displacement, cm", "force, kN")
    assert right.get_xlabel() == "velocity, m/s"
    measured = lines(left)[1]
    assert np.abs(measured[:, 0]).max() == pytest.approx(30, rel=1e-2)
    assert np.abs(measured[:, 1]).max() == pytest.approx(200, rel=1e-2)
    assert np.abs(lines(right)[1][:, 0]).max() == pytest.approx(2, rel=1e-2)


def test_error_bars_put_the_held_out_first() -> None:
    names, errors = ["a", "b", "a", "d"], [0.1, 0.2, 0.3, 0.4]  # two records of one name are two bars
    fig = pictures.error_bars(names, errors, [False, True, False, True])
    ax = fig.axes[0]
    assert [text.get_text() for text in ax.get_yticklabels()] == ["b", "d", "a", "a"]
    np.testing.assert_allclose(bars(ax), [0.2, 0.4, 0.1, 0.3])
    drawn = [to_hex(p.get_facecolor()) for p in ax.patches]
    assert drawn == [style.COLOURS[0]] * 2 + [style.REFERENCE] * 2
    place = [p.get_y() for p in ax.patches if isinstance(p, Rectangle)]
    assert place == sorted(place)
    assert ax.yaxis_inverted()
    assert [text.get_text() for text in fig.axes[1].get_yticklabels()] == ["0.200", "0.400", "0.100", "0.300"]


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
    return pictures.loops([loop(name)], periods=8)


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
