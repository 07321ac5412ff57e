"""How far trainings in other processes are: each leaves its share in a file, and who started them reads those."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from mrdamp.train.run import Progress

_FILE = "progress.txt"
_EVERY = 1.0  # s, between two looks, and between two writings


@dataclass
class Left:
    """A `Progress` that leaves the share in the folder, once a second at most."""

    folder: Path
    _last: float = field(default=-1e9, init=False)

    def __call__(self, what: str, share: float) -> None:
        if time.monotonic() - self._last >= _EVERY and self.folder.is_dir():
            self._last = time.monotonic()
            (self.folder / _FILE).write_text(f"{share:.4f}\n")


def share(folder: Path) -> float:
    """Of the training in a folder: 0 before its first word, 1 when it is done."""
    if (folder / "training.json").is_file():
        return 1.0
    try:
        return float((folder / _FILE).read_text())
    except (OSError, ValueError):  # not yet, or just being written
        return 0.0


@contextmanager
def watched(folders: Sequence[Path], progress: Progress | None) -> Iterator[None]:
    """Meanwhile, progress reports every second how many of the trainings are done, in tenths."""
    stop = threading.Event()

    def look() -> None:
        while not stop.wait(_EVERY):
            tell(folders, progress)

    thread = threading.Thread(target=look, daemon=True)
    if progress is not None:
        thread.start()
    try:
        yield
    finally:
        stop.set()
        if progress is not None:
            thread.join()
            tell(folders, progress)


def tell(folders: Sequence[Path], progress: Progress | None) -> None:
    """Says how many of the trainings in these folders are done."""
    done = sum(map(share, folders))
    if progress is not None:
        progress(f"train: {done:.1f} of {len(folders)} trainings", done / len(folders))
