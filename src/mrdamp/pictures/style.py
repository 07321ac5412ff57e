"""How pictures look: size, type, colours for light and dark, and the parts that all of them share.

Figures are 374 points wide, the width of a phone's page in CSS pixels, so type of 9 points stays 9 pixels
high there; wider screens show them larger.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache, wraps
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import matplotlib
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.textpath import TextToPath
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator
from numpy.typing import ArrayLike, NDArray

from mrdamp.errors import InputError

if TYPE_CHECKING:
    from matplotlib.typing import LineStyleType, RcKeyType

INK = "#1f2328"
MUTED = "#5f6873"
GRID = "#dde1e6"
REFERENCE = "#8a919b"  # what others are compared with

#: After Okabe and Ito's palette for all kinds of colour vision; yellow is left out and sky blue is darker,
#: as both are too pale on white.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#3a97d0", "#b08000")
DASHES: tuple[LineStyleType, ...] = (
    "-",
    (0, (5, 1.5)),
    (0, (2.5, 0.8)),
    (0, (6, 1.2, 1.5, 1.2)),
    (0, (1.2, 0.8)),
    (0, (8, 2)),
)
MARKERS = ("o", "s", "^", "D", "v", "P")
SIMULATED = COLOURS[1]

#: Light colour -> the one that takes its place on a dark page.
DARK: Mapping[str, str] = {
    INK: "#e6e9ed",
    MUTED: "#a3acb8",
    GRID: "#363d46",
    REFERENCE: "#7d8692",
    COLOURS[0]: "#4aa9e6",
    COLOURS[1]: "#f2843f",
    COLOURS[2]: "#2fc39b",
    COLOURS[3]: "#e29ac3",
    COLOURS[4]: "#86cdf5",
    COLOURS[5]: "#d9ab34",
}

WIDTH = 374 / 72  # inch

STYLE: dict[RcKeyType, Any] = {
    "axes.edgecolor": MUTED,
    "axes.facecolor": "none",
    "axes.grid": True,
    "axes.labelcolor": INK,
    "axes.labelsize": 9.5,
    "axes.linewidth": 0.7,
    "axes.axisbelow": True,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlecolor": INK,
    "axes.unicode_minus": True,
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same picture on every machine
    "font.size": 9.5,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "legend.fontsize": 9.5,
    "legend.frameon": False,
    "lines.linewidth": 1.3,
    "lines.solid_joinstyle": "round",
    "path.simplify": True,
    "path.simplify_threshold": 0.2,  # points
    "svg.fonttype": "path",
    "svg.hashsalt": "mrdamp",
    "text.color": INK,
    "text.parse_math": False,  # names are not formulas
    "xtick.color": MUTED,
    "xtick.labelcolor": INK,
    "xtick.labelsize": 9,
    "xtick.major.width": 0.7,
    "ytick.color": MUTED,
    "ytick.labelcolor": INK,
    "ytick.labelsize": 9,
    "ytick.major.width": 0.7,
}

P = ParamSpec("P")
R = TypeVar("R")


def styled(make: Callable[P, R]) -> Callable[P, R]:
    """The function with STYLE in force while it runs, and matplotlib's settings as they were afterwards."""

    @wraps(make)
    def inner(*args: P.args, **kwargs: P.kwargs) -> R:
        with matplotlib.rc_context(STYLE):
            return make(*args, **kwargs)

    return inner


def figure(height: float) -> Figure:
    """An empty figure of the common width; height in inch. It belongs to no window and to no global list."""
    return Figure(figsize=(WIDTH, height), layout=ConstrainedLayoutEngine(h_pad=0.045, w_pad=0.05))


def axes_grid(fig: Figure, rows: int, columns: int, **how: Any) -> list[list[Axes]]:
    """A grid of axes, row by row; how: as for matplotlib's `Figure.subplots`."""
    return [list(row) for row in fig.subplots(rows, columns, squeeze=False, **how)]


def legend(fig: Figure, handles: Sequence[Artist], labels: Sequence[str]) -> None:
    """Entries above the axes, in as many columns as the width takes; rows after the first add to the height."""
    short = [elide(label, 300) for label in labels]
    columns = len(short)
    while columns > 1 and _legend_width(short, columns) > 72 * WIDTH - 12:
        columns -= 1
    fig.set_figheight(fig.get_figheight() + 0.18 * (-(-len(short) // columns) - 1))
    fig.legend(
        handles, short, loc="outside upper center", ncols=columns,
        handlelength=1.8, handletextpad=0.5, columnspacing=1.4, borderpad=0.35, labelspacing=0.3,
    )  # fmt: skip


def line_legend(fig: Figure, looks: Mapping[str, Mapping[str, Any]]) -> None:
    """`legend` of lines by name; looks: as arguments of matplotlib's `Line2D`."""
    legend(fig, [Line2D([], [], **look) for look in looks.values()], list(looks))


def column(fig: Figure, rows: int, **how: Any) -> list[Axes]:
    """Axes under each other; how: as for `axes_grid`."""
    return [row[0] for row in axes_grid(fig, rows, 1, **how)]


def require_some(what: str, items: object, of: str) -> None:
    """InputError where a picture has nothing to show. what: its name; of: what to give."""
    if not items:
        raise InputError(f"picture: {what} has nothing to show; give at least one {of}")


def name_rows(axes: Sequence[Axes], names: Sequence[str], points: float) -> None:
    """Axes beside each other that share a row for each name, the first on top; points: that the names may take."""
    for ax in axes:
        ax.grid(False, axis="y")
        ax.tick_params(axis="y", length=0)
    axes[0].set_yticks(range(len(names)), [elide(name, points, 9) for name in names])
    axes[0].set_ylim(len(names) - 0.4, -0.6)


def row_title(left: Axes, right: Axes, name: str, note: str) -> None:
    """A name over the left end of a row of axes and a note over its right end; both may be the same axes."""
    taken = text_width(note, 9) + 12 if note else 0.0
    # Out of the layout, or a long name would push the axes apart; the blank title keeps the height free.
    left.set_title(elide(name, 318 - taken, 9, "bold"), fontsize=9).set_in_layout(False)
    right.set_title(note, loc="right", fontsize=9, fontweight="normal", color=MUTED).set_in_layout(False)
    right.set_title(" ", loc="center", fontsize=9)


def ticks(ax: Axes, x: int | None = None, y: int | None = None) -> None:
    """At most so many intervals on an axis."""
    for axis, count in ((ax.xaxis, x), (ax.yaxis, y)):
        if count is not None:
            axis.set_major_locator(MaxNLocator(count, min_n_ticks=min(3, count), steps=[1, 2, 2.5, 5, 10]))


def log_percent(ax: Axes) -> None:
    """A logarithmic ordinate of percent with plain numbers: a power of ten would be a formula."""
    ax.set_yscale("log")
    low, high = ax.get_ylim()
    subs = (1.0, 2.0, 5.0) if high > 10.0 * low else (1.0, 1.2, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0)
    ax.yaxis.set_major_locator(LogLocator(subs=subs, numticks=12))
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.yaxis.set_minor_locator(NullLocator())


def elide(text: str, points: float, size: float = 9.5, weight: str = "normal") -> str:
    """The text on one line at most so many points wide, its middle left out where it is wider."""
    text = " ".join(text.split())
    shown, left_out = text, 1
    while text_width(shown, size, weight) > points and left_out < len(text):
        left_out += 1
        head = (len(text) - left_out + 1) // 2
        shown = f"{text[:head]}…{text[head + left_out :]}"
    return shown


@lru_cache(maxsize=4096)
def text_width(text: str, size: float, weight: str = "normal") -> float:
    font = FontProperties(family="DejaVu Sans", weight=weight, size=size)
    return float(TextToPath().get_text_width_height_descent(text, font, ismath=False)[0])


def short(value: float) -> str:
    """A number with about three digits and no exponent, to write at the end of a bar."""
    size = abs(value)
    return f"{value:.0f}" if size >= 100 else f"{value:.1f}" if size >= 10 else f"{value:.2f}"


def _legend_width(labels: Sequence[str], columns: int) -> float:
    """Points; matplotlib fills column by column, the first ones with one more."""
    rows, longer = divmod(len(labels), columns)
    total, k = 0.0, 0
    for column in range(columns):
        count = rows + (column < longer)
        total += 9.5 * (1.8 + 0.5) + max(text_width(label, 9.5) for label in labels[k : k + count])
        k += count
    return total + 9.5 * 1.4 * (columns - 1)


def colours(names: Sequence[str]) -> dict[str, str]:
    """Colour by name: the first one, what the others are compared with, is grey."""
    return {name: REFERENCE if k == 0 else COLOURS[(k - 1) % len(COLOURS)] for k, name in enumerate(names)}


Array = NDArray[np.float64]
BINS = 400  # of a line over time: two points each, about what a screen resolves


def finite(what: str, values: ArrayLike, shape: tuple[int, ...] | None = None) -> Array:
    """The values as float64; shape None: one-dimensional, at least two values. Raises InputError."""
    array = np.asarray(values, dtype=np.float64)
    if (array.ndim != 1 or len(array) < 2) if shape is None else array.shape != shape:
        raise InputError(f"picture: {what} has shape {array.shape}; allowed: {shape or '(n,), n >= 2'}")
    if not np.isfinite(array).all():
        at = np.argwhere(~np.isfinite(array))[0][0]
        raise InputError(f"picture: {what} has a value that is not finite at sample {at}")
    return array


def time_axis(what: str, values: ArrayLike) -> Array:
    """Stamps (n,) s. Raises InputError where they do not increase."""
    array = finite(what, values)
    if not (np.diff(array) > 0).all():
        raise InputError(f"picture: {what} does not increase")
    return array


def mean_period(time: Array, x: Array) -> float:
    """Mean time between upward crossings of the mean, s; the whole duration where x hardly moves.

    Crossings smaller than a fifth of the standard deviation are noise and do not count.
    """
    y = x - x.mean()
    side = np.sign(np.where(np.abs(y) > 0.2 * y.std(), y, 0.0))
    side = side[side != 0]
    crossings = np.count_nonzero(np.diff(side))
    duration = float(time[-1] - time[0])
    return min(duration, 2 * duration / crossings) if crossings else duration


def busiest(time: Array, x: Array, periods: float, energy: Array | None = None) -> slice:
    """The part of a record that is so many mean periods of x long and holds most of the energy.

    energy: (n,) whose square is summed up, None: x less its mean.
    """
    n = len(time)
    length = periods * mean_period(time, x)
    count = min(n, max(2, round(length * (n - 1) / float(time[-1] - time[0])) + 1))
    signal = x - x.mean() if energy is None else energy
    total = np.concatenate([[0.0], np.cumsum(signal**2)])
    inside = total[count:] - total[:-count]
    # The first window that is as good as any: steady tests are then not shown by a chance of noise.
    start = int(np.argmax(inside >= 0.999 * inside.max()))
    return slice(start, start + count)


def thinned(part: slice, most: int) -> slice:
    """The slice with a step that leaves at most so many samples."""
    count = part.stop - part.start
    return slice(part.start, part.stop, max(1, -(-count // most)))


def outline(time: Array, x: Array, bins: int) -> tuple[Array, Array]:
    """Time and values of a line that looks the same: the least and the largest x of each of so many bins."""
    size = -(-len(x) // bins)
    if size <= 2:
        return time, x
    rows = np.pad(x, (0, -len(x) % size), mode="edge").reshape(-1, size)
    start = size * np.arange(len(rows))
    keep = np.unique(np.concatenate([[0, len(x) - 1], start + rows.argmin(1), start + rows.argmax(1)]))
    keep = keep[keep < len(x)]
    return time[keep], x[keep]


def staircase(time: Array, x: Array) -> tuple[Array, Array]:
    """The samples at which a zero-order-held signal changes, and the last one."""
    keep = np.r_[True, np.diff(x) != 0]
    keep[-1] = True
    return time[keep], x[keep]


def force_unit(*values: Array) -> tuple[float, str]:
    """Factor from N and name of the unit for forces of this size."""
    return (1e-3, "kN") if peak(*values) >= 1e4 else (1.0, "N")


def velocity_unit(*values: Array) -> tuple[float, str]:
    """Factor from m/s and name of the unit for velocities of this size."""
    return (1.0, "m/s") if peak(*values) >= 1.0 else (1e3, "mm/s")


def length_unit(*values: Array) -> tuple[float, str]:
    """Factor from m and name of the unit for motions of this size."""
    return (1e2, "cm") if peak(*values) >= 0.1 else (1e3, "mm")


def peak(*values: Array) -> float:
    """Largest magnitude, 0 for none."""
    return max((float(np.abs(v).max()) for v in values if v.size), default=0.0)


def padded(low: float, high: float) -> tuple[float, float]:
    """Limits of an axis that holds the range with a margin; never empty."""
    margin = 0.06 * (high - low) or 0.06 * max(abs(low), abs(high)) or 1.0
    return low - margin, high + margin


def check_series(data: Any, *fields: str) -> None:
    """Makes arrays of a dataclass' `time` (n,) and of its fields (n,), checked; `name` begins the line of an error."""
    time = time_axis(f"{data.name}: time", data.time)
    object.__setattr__(data, "time", time)
    for field in fields:
        object.__setattr__(data, field, finite(f"{data.name}: {field}", getattr(data, field), time.shape))
