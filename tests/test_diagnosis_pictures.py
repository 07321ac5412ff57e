"""What the pictures of a diagnosis say."""

from __future__ import annotations

import pytest

from mrdamp.pictures.diagnosis import added, waterfall


@pytest.mark.parametrize(
    ("names", "labels"),
    [
        (["nominal", "recalibrated", "+ a", "+ a + b"], ["nominal", "recalibrated", "+ a", "+ b"]),
        (["nominal", "+ a + b"], ["nominal", "+ a + b"]),  # a alone was not fitted
        (["nominal", "+ a", "+ ab + c"], ["nominal", "+ a", "+ ab + c"]),
        (["nominal"], ["nominal"]),
    ],
)
def test_a_bar_is_labelled_by_what_it_adds(names: list[str], labels: list[str]) -> None:
    assert added(names) == labels
    ax = waterfall([(name, 0.1, (0.08, 0.12)) for name in names], 0.01).axes[0]
    assert [t.get_text() for t in ax.get_yticklabels()] == labels
