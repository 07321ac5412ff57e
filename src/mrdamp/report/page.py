"""One self-contained HTML page: text, tables and pictures, no outside resource and no script."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from importlib import resources
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import jinja2
import matplotlib
from markupsafe import Markup, escape
from matplotlib.figure import Figure
from PIL import Image

from mrdamp.errors import InputError
from mrdamp.files import write_atomic
from mrdamp.pictures.style import DARK, STYLE

if TYPE_CHECKING:
    from mrdamp.envs.frame_xml import Animation

#: A picture above this many bytes as SVG goes into the page as PNG, with as many dots as stay below it.
PICTURE_LIMIT = 220_000
_PNG_DPI = (200, 150, 110, 75)
#: A number with or without a unit, a dash, or nothing: columns of these are set flush right.
_NUMBER = re.compile(r"([-+−±]?\d[\d.,]*(e[-+]?\d+)?( ?[%‰]| \S{1,5})?|[-–—])?", re.IGNORECASE)

Cell = str | float | int | None


@dataclass(frozen=True)
class _Picture:
    svg: Markup  # empty where it is too large
    png: str  # data URI, empty where there is an SVG
    width: int  # points
    height: int
    caption: str
    alt: str
    still: str = ""  # data URI of a picture for readers who turned motion off
    photo: bool = False  # keeps its colours on a dark page


@dataclass(frozen=True)
class _Table:
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    numeric: tuple[bool, ...]
    note: str


@dataclass
class _Section:
    heading: str
    anchor: str
    blocks: list[tuple[str, object]] = field(default_factory=list)


class Page:
    """A page that grows from top to bottom.

    title: of the page and of the browser's tab. summary: one sentence, shown first. footer: the last line.
    Every text is plain; `code` between backticks is set as code, all else is escaped. A heading opens a
    section; with an empty one the block joins the section above.
    """

    def __init__(self, title: str, summary: str, footer: str = "") -> None:
        self.title = title
        self.summary = summary
        self.footer = footer
        self._sections: list[_Section] = []
        self._pictures = 0

    def text(self, heading: str, paragraphs: Sequence[str] | str) -> None:
        self._add(heading, "text", (paragraphs,) if isinstance(paragraphs, str) else tuple(paragraphs))

    def table(
        self, heading: str, columns: Sequence[str], rows: Sequence[Sequence[Cell]], note: str = ""
    ) -> None:
        """A table; the first column names the rows. Numbers are shown with three digits, None as a dash.

        Raises InputError where a row is not as long as `columns`.
        """
        texts = tuple(tuple(_cell(value) for value in row) for row in rows)
        for row in texts:
            if len(row) != len(columns):
                raise InputError(
                    f"page: table '{heading}' has {len(columns)} columns and a row of {len(row)}: {row}"
                )
        numeric = tuple(
            k > 0 and all(_NUMBER.fullmatch(row[k]) for row in texts) for k in range(len(columns))
        )
        self._add(heading, "table", _Table(tuple(columns), texts, numeric, note))

    def figure(self, heading: str, fig: Figure, caption: str, alt: str) -> None:
        """A picture with its caption; alt: description for readers who cannot see it.

        Raises InputError where alt is empty.
        """
        self._pictures += 1
        width, height = (round(72 * inch) for inch in fig.get_size_inches())
        with matplotlib.rc_context(STYLE):
            svg = _svg(fig, f"p{self._pictures}")
            png = _png(fig) if len(svg) > PICTURE_LIMIT else ""
        self._show(heading, _Picture(Markup() if png else svg, png, width, height, caption, alt))

    def animation(self, heading: str, drawn: Animation, caption: str, alt: str) -> None:
        """An animated picture; readers who turned motion off get its first one. alt: as in `figure`."""
        moving, still = (
            f"data:image/webp;base64,{base64.b64encode(data).decode('ascii')}"
            for data in (drawn.moving, drawn.still)
        )
        picture = _Picture(Markup(), moving, drawn.width, drawn.height, caption, alt, still, photo=True)
        self._show(heading, picture)

    def html(self) -> str:
        environment = jinja2.Environment(
            autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
        )
        environment.filters |= {"code": _code, "prose": _prose, "breaks": _breaks, "unit": _unit}
        template = (resources.files("mrdamp.report") / "templates" / "page.html").read_text(encoding="utf-8")
        return environment.from_string(template).render(
            title=self.title,
            summary=self.summary,
            footer=self.footer,
            sections=self._sections,
            day=Markup("".join(f"--c{k}:{light};" for k, light in enumerate(DARK))),
            night=Markup("".join(f"--c{k}:{dark};" for k, dark in enumerate(DARK.values()))),
        )

    def write(self, path: Path | str) -> None:
        """Write the page in one go: either all of it is there or the old file stays.

        Raises InputError where the folder is missing or cannot be written.
        """
        write_atomic(Path(path), self.html())

    def _show(self, heading: str, picture: _Picture) -> None:
        if not picture.alt.strip():
            raise InputError(f"page: the picture '{picture.caption}' has no alt text")
        self._add(heading, "figure", replace(picture, alt=" ".join(picture.alt.split())))

    def _add(self, heading: str, kind: str, block: object) -> None:
        if heading or not self._sections:
            self._sections.append(_Section(heading, f"s{len(self._sections) + 1}"))
        self._sections[-1].blocks.append((kind, block))


def _svg(fig: Figure, name: str) -> Markup:
    """A figure as an SVG element whose ids begin with name and whose colours follow the page's."""
    stream = io.BytesIO()
    fig.savefig(stream, format="svg", facecolor="none")
    text = stream.getvalue().decode("utf-8")
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>|<!--.*?-->|<style.*?</style>", "", text, flags=re.DOTALL)
    text = re.sub(r' d="([^"]*)"', lambda m: f' d="{_short(m[1])}"', text)
    text = re.sub(r'(?<= )(id="|xlink:href="#|[a-z-]+="url\(#)', rf"\1{name}-", text)
    text = re.sub(r"\n\s*", "\n", text)
    for k, light in enumerate(DARK):
        text = text.replace(light, f"var(--c{k})")
    return Markup(text)


def _png(fig: Figure) -> str:
    """A figure as the data URI of a PNG, with as many dots as stay below PICTURE_LIMIT."""
    fig.set_layout_engine("none")  # stays as laid out for the SVG, which takes most of the time
    for dpi in _PNG_DPI:
        raw, stream = io.BytesIO(), io.BytesIO()
        fig.savefig(raw, format="png", dpi=dpi, facecolor="none")
        # Few colours in lines and letters: a palette of 128 makes a third of the size.
        Image.open(raw).quantize(128, Image.Quantize.FASTOCTREE).save(stream, "png", optimize=True)
        if stream.tell() <= PICTURE_LIMIT:
            break
    return f"data:image/png;base64,{base64.b64encode(stream.getvalue()).decode('ascii')}"


def _short(path: str) -> str:
    """A polyline in steps of a hundredth of a point, each from the point before; other paths as they are."""
    if not re.fullmatch(r"M \S+ \S+\s+(L \S+ \S+\s*)+(z\s*)?", path):
        return " ".join(path.split())
    numbers = re.findall(r"[ML] (\S+) (\S+)", path)
    points = [(round(100 * float(x)), round(100 * float(y))) for x, y in numbers]
    steps = [(x1 - x0, y1 - y0) for (x0, y0), (x1, y1) in pairwise(points)]
    start = f"M{points[0][0] / 100:g} {points[0][1] / 100:g}l"
    rest = " ".join(f"{x / 100:g} {y / 100:g}" for x, y in steps if x or y) or "0 0"
    rest = re.sub(r"(?<!\d)0\.", ".", rest).replace(" -", "-")
    return start + rest + ("z" if path.rstrip().endswith("z") else "")


def _cell(value: Cell) -> str:
    if value is None:
        return "–"
    if isinstance(value, float):
        # 1234 rather than 1.23e+03, and 0.10 rather than 0.1
        return f"{value:.0f}" if 100 <= abs(value) < 1e6 else f"{value:#.3g}"
    return str(value)


def _breaks(html: Markup) -> Markup:
    """Lets a long file name go on in the next line after an underscore."""
    return Markup(str(html).replace("_", "_<wbr>"))


def _unit(text: str) -> str:
    """A column's head with its unit kept in one line with the last word."""
    return re.sub(r"(?<=,) (?=\S{1,6}$)| (?=\(\S{1,6}\)$)", "\u00a0", text)


def _code(text: str) -> Markup:
    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(text))))


def _prose(text: str) -> Markup:
    """A sentence: code as such, and a number kept in one line with its per cent."""
    return _code(re.sub(r"(?<=\d) (?=%)", "\u00a0", str(text)))
