"""What is handed over where the final fit came to grief."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from mrdamp.diagnosis.fits import final as module
from mrdamp.diagnosis.fits.final import FinalFit, final_fit


def fit_of(name: str, causes: tuple[str, ...], cost: float) -> Any:
    return SimpleNamespace(
        name=name, cost=cost, converged=True, hypothesis=SimpleNamespace(causes=causes, coordinates=(0,))
    )


def settled_by(gaps: dict[str, float], monkeypatch: pytest.MonkeyPatch) -> tuple[str, list[str]]:
    """Name of the fit that is handed over, and those that were settled; gaps: on records left out, by name."""
    pair, other = ("backlash", "trapped_gas"), ("backlash",)
    fits = [
        fit_of("chosen", pair, 0.01),
        fit_of("smaller", other, 0.02),
        fit_of("second form", pair, 0.03),
        fit_of("third form", pair, 0.04),
    ]
    problem = SimpleNamespace(gaps=lambda residual: np.full(3, 0.2))
    search = SimpleNamespace(
        problem=problem, residual=None, inexact=False, ranked=lambda free: fits[2:] if free else fits[:2]
    )
    tried: list[str] = []

    def final(search: Any, found: Any, corrections: tuple[str, ...]) -> FinalFit:
        tried.append(found.name)
        return FinalFit(found, corrections, np.full(3, gaps[found.name]), cast(Any, problem))

    monkeypatch.setattr(module, "_with_full_step", final)
    monkeypatch.setattr(module, "refine", lambda search, chosen: (chosen, ()))
    return cast(Any, final_fit(cast(Any, search), fits[0]).fit).name, tried


def test_a_final_fit_that_is_better_than_nothing_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    assert settled_by({"chosen": 0.19}, monkeypatch) == ("chosen", ["chosen"])


def test_one_that_is_worse_gives_way_to_another_of_its_causes(monkeypatch: pytest.MonkeyPatch) -> None:
    found = settled_by({"chosen": 2.0, "second form": 0.5, "third form": 0.1}, monkeypatch)
    assert found == ("third form", ["chosen", "second form", "third form"])
    found = settled_by({"chosen": 2.0, "second form": 0.05, "third form": 0.01}, monkeypatch)
    assert found == ("second form", ["chosen", "second form"])  # good enough


def test_the_least_bad_is_kept_where_all_are_worse(monkeypatch: pytest.MonkeyPatch) -> None:
    assert settled_by({"chosen": 0.5, "second form": 0.9, "third form": 0.7}, monkeypatch)[0] == "chosen"


@pytest.mark.parametrize(("further", "kept"), [(0.005, "further"), (0.02, "chosen")])
def test_a_fit_that_was_still_moving_is_taken_on(
    further: float, kept: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    chosen = fit_of("chosen", ("backlash",), 0.01)
    chosen.converged, chosen.point = False, np.zeros(1)
    search = SimpleNamespace(
        problem=SimpleNamespace(gaps=lambda residual: np.full(3, 0.2)),
        residual=None,
        inexact=False,
        fitted=lambda hypothesis, start, *, most, stage: fit_of("further", ("backlash",), further),
    )
    monkeypatch.setattr(module, "refine", lambda search, chosen: (chosen, ()))
    monkeypatch.setattr(
        module, "_with_full_step", lambda _, f, c: FinalFit(f, c, np.zeros(3), cast(Any, None))
    )
    assert cast(Any, final_fit(cast(Any, search), chosen).fit).name == kept
