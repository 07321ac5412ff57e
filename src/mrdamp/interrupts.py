"""An interrupt while the modules of the command are being imported: one line and exit code 130, as later."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

_COMMAND = "mrdamp"


def _stop(*_: object) -> None:
    os.write(2, b"mrdamp: interrupted\n")
    os._exit(130)


def guard() -> None:
    """Called first of all, where this process is the command itself and no worker or program that imports it."""
    words = sys.orig_argv[1:3]
    called = words == ["-m", _COMMAND] or Path(words[0] if words else "").name == _COMMAND
    if called and signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # else it is ignored, and stays so
        signal.signal(signal.SIGINT, _stop)


def unguard() -> None:
    """An interrupt is a KeyboardInterrupt again."""
    if signal.getsignal(signal.SIGINT) is _stop:
        signal.signal(signal.SIGINT, signal.default_int_handler)


guard()
