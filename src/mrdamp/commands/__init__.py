"""Commands of `mrdamp`: modules with `add_to(commands)`. Here is what they share: arguments, outputs and progress."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from pathlib import Path, PosixPath
from typing import TYPE_CHECKING, Any, NoReturn

from mrdamp.errors import InputError
from mrdamp.files import SUFFIXES, unfit, write_atomic

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from mrdamp.records import RecordSet

Run = Callable[[argparse.Namespace], int]

#: What `--hold` may be, and what it means.
HOLD = {"yes": True, "no": False}


def seed(text: str) -> int:
    value = int(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"{value}; allowed: 0 or more")
    return value


class _Store(argparse._StoreAction):
    """What an option takes; a list that is given again goes on."""

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: Any, option: str | None = None
    ) -> None:
        before = getattr(namespace, self.dest, self.default)
        again = self.option_strings and self.nargs in ("+", "*") and before is not self.default
        super().__call__(parser, namespace, [*before, *values] if again else values, option)


class Parser(argparse.ArgumentParser):
    """Tells wrong arguments in one line, as everything else is told."""

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self.register("action", None, _Store)

    def error(self, message: str) -> NoReturn:
        """Ends with exit code 2."""
        raise InputError(f"{message}; see {self.prog} --help")


def add_command(commands: Any, name: str, run: Run, text: str, example: str) -> argparse.ArgumentParser:
    """Adds a command to the subparsers of an argparse parser; `run` takes what it parsed, its outputs checked."""
    return described(commands.add_parser(name, help=text), run, text, example)


def described(p: argparse.ArgumentParser, run: Run, text: str, example: str) -> argparse.ArgumentParser:
    def checked(a: argparse.Namespace) -> int:
        check_outputs(a)
        return run(a)

    p.description, p.epilog = text, f"example: {example}"
    p.formatter_class = argparse.RawDescriptionHelpFormatter
    p.set_defaults(run=checked)
    return p


_KINDS = (".svg", ".png", ".pdf")


class OutFile(PosixPath):
    """Type of an argument: a file to write, which `check_outputs` looks at before any work."""


class Picture(OutFile):
    """The same of a picture."""


class OutFolder(PosixPath):
    """The same of a folder; it is made where it is missing."""


def check_outputs(a: argparse.Namespace) -> None:
    """Raises InputError for an output of a command that would replace one of its inputs or cannot be written.

    Inputs are all other arguments that are files, and paths that are folders. A folder must hold no input.
    """
    given = [v for value in vars(a).values() for v in (value if isinstance(value, list) else [value])]
    outputs = [v for v in given if isinstance(v, OutFile | OutFolder)]
    rest = [v for v in given if not isinstance(v, OutFile | OutFolder)]
    inputs = [v for v in rest if isinstance(v, Path) and v.exists()]
    inputs += [Path(v) for v in rest if isinstance(v, str) and os.path.isfile(v)]
    for k, out in enumerate(outputs):
        for source in inputs:
            if _replaces(out, source.resolve()):
                raise InputError(f"{out}: it would replace or mix with the input {source}; give another path")
        if isinstance(out, OutFile) and out.resolve() in (other.resolve() for other in outputs[:k]):
            raise InputError(f"{out}: two outputs have this path; give another one")
        if isinstance(out, Picture) and out.suffix not in _KINDS:
            raise InputError(f"{out}: a picture is written as .svg, .png or .pdf")
        if reason := _unwritable(out):
            raise InputError(f"{out}: cannot be written: {reason}")


def check_written(written: Iterable[Path], inputs: Iterable[Path]) -> None:
    """Raises InputError for a file of an output folder that would replace an input, also through a link."""
    sources = {source.resolve(): source for source in inputs}
    for path in written:
        if source := sources.get(path.resolve()):
            raise InputError(f"{path}: it would replace the input {source}; give another folder")


def _replaces(out: Path, source: Path) -> bool:
    """Whether an output is a source, is a folder with it, or is what commands read in it."""
    real = out.resolve()
    if isinstance(out, OutFolder):
        return real in (source, source.parent) if source.is_file() else real == source
    read = real.name.lower().endswith((*SUFFIXES, "case.json"))
    return real == source or (read and real.is_file() and source in real.parents)


def _unwritable(out: Path) -> str:
    real = out.resolve()
    if isinstance(out, OutFile):
        if reason := unfit(real):
            return reason
        folder = real.parent
        if not folder.is_dir():
            return f"there is no folder {out.parent}"
    else:
        folder = next(where for where in (real, *real.parents) if where.exists())
        if not folder.is_dir():
            return f"{folder.name} is a file, no folder"
    try:
        with tempfile.TemporaryFile(dir=folder):
            return ""
    except OSError as error:
        return str(error.strerror)


def save_picture(fig: Figure, path: Path) -> None:
    """Writes a figure and prints where. Raises InputError."""
    write_atomic(path, lambda file: fig.savefig(file, dpi=150, format=path.suffix[1:]))
    print(f"picture: {path}")


@contextmanager
def silent_output() -> Iterator[None]:
    """What is printed meanwhile, by other people's code and its processes too, goes to the standard error."""
    sys.stdout.flush()
    kept = os.dup(1)
    os.dup2(2, 1)
    try:
        with redirect_stdout(sys.stderr):
            yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)


def show_progress(what: str, share: float) -> None:
    print(f"{100 * share:3.0f} %  {what}", file=sys.stderr, flush=True)


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
                show_progress(what, share)
                last = (what, share)

        yield plain
        return
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("", total=1.0)
        yield lambda what, share: bar.update(task, description=what, completed=share)


def add_records(p: argparse.ArgumentParser, more: str = "") -> None:
    """Adds the records, the effects fitted along, what follows the command, and the seed."""
    p.add_argument(
        "records",
        nargs="*",
        type=Path,
        help="record files, one folder, or a set of the package: embedded (default), self_sensing, foam",
    )
    about = f"effects fitted along, in place of the default offset (without a name: none){more}"
    p.add_argument("--extras", nargs="*", default=["offset"], help=about)
    p.add_argument(
        "--follows",
        nargs="+",
        metavar="NAME",
        help="coefficients that follow the command, such as c0 alpha; paper: the foam-damper paper's (default: all)",
    )
    p.add_argument("--seed", type=seed, default=0, help="of random numbers (default: %(default)s)")


def refuse_unused(a: argparse.Namespace, when: str, **usual: Any) -> None:
    """Raises InputError for an option that is given and would have no effect. usual: their defaults."""
    for name, value in usual.items():
        if getattr(a, name) != value:
            raise InputError(f"--{name.replace('_', '-')} {when}; leave it out")


def add_json(p: argparse.ArgumentParser) -> None:
    p.add_argument("--json", action="store_true", help="print JSON; text goes to stderr")


def add_jobs(p: argparse.ArgumentParser, *aliases: str, default: int | None = 1) -> None:
    """Adds `--jobs`; -1 and None are all cores."""
    usual = "all cores" if default in (-1, None) else default
    about = f"processes; the answer is the same (default: {usual})"
    p.add_argument("--jobs", *aliases, type=int, default=default, metavar="N", help=about)


def add_signals(p: argparse.ArgumentParser) -> None:
    p.add_argument(
        "--cutoff", type=float, help="Hz, zero-phase low-pass of the measured displacement (default: none)"
    )
    p.add_argument("--cutoff-force", action="store_true", help="the same low-pass for the force")
    p.add_argument("--zero-mean", action="store_true",
                   help="subtract the means; for records of whole cycles")


def as_recorded(a: argparse.Namespace) -> RecordSet:
    """The records of the parsed arguments as they are. Raises InputError."""
    from mrdamp.records import embedded, read_records

    paths = a.records
    return embedded() if not paths else read_records(paths[0] if len(paths) == 1 else list(paths))


def prepared(a: argparse.Namespace) -> bool:
    """Whether something is done to the measured signals before a fit."""
    return a.cutoff is not None or bool(a.zero_mean)


def read(a: argparse.Namespace) -> RecordSet:
    """The records of the parsed arguments, as they are fitted to. Raises InputError."""
    if a.cutoff_force and a.cutoff is None:
        raise InputError("--cutoff-force needs a --cutoff")
    records = as_recorded(a)
    for r in records.held_out:
        if r.lead:
            print(f"check: {r.label}: the only record: fitted up to {r.time[r.lead]:.4g} s, held out from there on")
    return records.smoothed(a.cutoff, force=a.cutoff_force, zero_mean=a.zero_mean) if prepared(a) else records


def follows(a: argparse.Namespace) -> Sequence[str] | None:
    """The coefficients that follow the command; None: all that can."""
    from mrdamp.identify.laws import PAPER_FOLLOWS

    return PAPER_FOLLOWS.get(a.law) if a.follows == ["paper"] else a.follows
