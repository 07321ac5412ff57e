"""Fixtures of several files."""

from __future__ import annotations

from collections.abc import Iterator

import pytest


@pytest.fixture(scope="module")
def few_validation_motions() -> Iterator[None]:
    """Two motions in place of the many that a training on the frame is judged on."""
    from mrdamp.envs.training_loads import validation_motions

    few = validation_motions(1, (0.5, 1.5))
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("mrdamp.envs.frame.validation_motions", lambda: few)
        yield
