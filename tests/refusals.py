"""What must be refused, and how: one line that names the fault."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from mrdamp.errors import InputError


def refuses(call: Callable[[], Any], message: str) -> None:
    """The call raises InputError of one line in which the message is found."""
    with pytest.raises(InputError, match=message) as caught:
        call()
    assert "\n" not in str(caught.value)


def refusal_of(path: Path, read: Callable[[], Any]) -> str:
    """What a file is refused with: one line that names it."""
    with pytest.raises(InputError) as caught:
        read()
    text = str(caught.value)
    assert "\n" not in text
    assert path.name in text
    return text
