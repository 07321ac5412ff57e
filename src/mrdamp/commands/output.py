"""What commands share: progress, and pictures written to a file."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from mrdamp.errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_KINDS = (".svg", ".png", ".pdf")


def check_picture(path: Path | None) -> None:
    """Raises InputError for a suffix that no picture has, before any work is done."""
    if path is not None and path.suffix not in _KINDS:
        raise InputError(f"{path}: a picture is written as .svg, .png or .pdf")


def check_file(path: Path) -> None:
    """Raises InputError for a file that cannot be written at its path, before any work is done."""
    if not path.parent.is_dir():
        raise InputError(f"{path}: cannot be written: there is no folder {path.parent}")
    if path.is_dir():
        raise InputError(f"{path}: cannot be written: it is a folder")


def save_picture(fig: Figure, path: Path) -> None:
    """Writes a figure and prints where. Raises InputError."""
    check_picture(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        fig.savefig(path, dpi=150)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error}") from None
    print(f"picture: {path}")


@contextmanager
def progress_bar() -> Iterator[Callable[[str, float], None]]:
    """A bar on a terminal; elsewhere a line for each new step, and for each tenth of the whole."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
    )
    if not console.is_terminal:
        last = ("", 0.0)

        def plain(what: str, share: float) -> None:
            nonlocal last
            if what != last[0] or share >= last[1] + 0.1:
                print(f"{100 * share:3.0f} %  {what}", file=sys.stderr, flush=True)
                last = (what, share)

        yield plain
        return
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("", total=1.0)
        yield lambda what, share: bar.update(task, description=what, completed=share)
