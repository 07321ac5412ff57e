"""What `mrdamp identify --json` and `mrdamp table1 --json` print: the figures of the text, for a program to read.

Errors: `rmse_N`, and `nrmse` over the standard deviation of the force. A figure that is not finite is null.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext, redirect_stdout
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mrdamp.identify import Fit, RecordError
    from mrdamp.identify.by_command import ByCommand
    from mrdamp.identify.comparison import Table1
    from mrdamp.identify.intervals import ChannelFinding, Interval
    from mrdamp.narx import FitNarx
    from mrdamp.narx.error_bars import Sufficiency
    from mrdamp.narx.prune import Pruned
    from mrdamp.narx.select import Choice, Trial


def reporting(report: Callable[[argparse.Namespace], Mapping[str, Any]]) -> Callable[[argparse.Namespace], int]:
    """A command that makes a report: `--json` prints that without NaN or Infinity, which the standard excludes, and
    what is said on the way goes to stderr then."""

    def run(a: argparse.Namespace) -> int:
        with redirect_stdout(sys.stderr) if a.json else nullcontext():
            found = report(a)
        if a.json:
            print(json.dumps(_finite(found), indent=1, allow_nan=False))
        return 0

    return run


def of_fit(
    fit: Fit,
    left: Sequence[ChannelFinding],
    intervals: Sequence[Interval] = (),
    compared: Mapping[str, Fit] | None = None,
) -> dict[str, Any]:
    """Of a law's fit. compared: fits by dependence on the command, where they were compared."""
    out = _law(fit) | {
        "effects_left_out": list(fit.left_out),
        "left_in_records": [
            _of(c, "record", offset_N="offset", offset_error_N="offset_error", force_delay_s="delay",
                force_delay_error_s="delay_error")
            for c in left
        ],
    }  # fmt: skip
    if compared:
        out["dependences"] = {
            name: {"free_numbers": len(one.space.coordinates) if one.space else None}
            | _of(one, fitted_nrmse="train_nrmse", held_out_nrmse="held_out_nrmse")
            for name, one in compared.items()
        }
    if intervals:
        out["intervals"] = [
            {"parameter": i.name, **_of(i, "value", "low", "high", "unit"), "not_identifiable": i.word or None}
            for i in intervals
        ]
    return out


def of_by_command(found: ByCommand) -> dict[str, Any]:
    """Of values at each constant command with lines through them."""
    from mrdamp.identify import pooled

    return _law(found.fit) | {
        "by_command": [
            {"command": u, "attributes": dict(model.attributes), **_errors(errors, pooled(errors))}
            for u, model, errors in found.at
        ],
        "lines": [line._asdict() for line in found.lines],
    }


def of_network(
    fit: FitNarx, found: Sufficiency, choice: Choice | None, pruned: Pruned | None
) -> dict[str, Any]:
    """Of a network: both errors by record, its stages, and what was chosen and pruned."""
    net = fit.network
    out: dict[str, Any] = {
        "law": "narx",
        "topology": net.topology,
        "weights": len(net.theta),
        "effective_weights": fit.posterior.gamma,
        "sample_time_s": net.sample_time,
        "stages": [
            _of(s, "name", "gamma", free_run_nrmse="free_run", one_step_nrmse="one_step") for s in fit.stages
        ],
        "sufficient": found.suffice,
        "sufficiency": found.why,
    }
    for k, half in enumerate(("train", "validation", "test")):
        out[half] = {
            way: _errors(getattr(judged, half), judged.pooled[k])
            for way, judged in (("free_run", fit.free_run), ("one_step", fit.one_step))
        }
    if choice:
        out["choice"] = {
            "by": choice.by,
            "chosen": choice.candidate._asdict(),
            **{step: [_trial(t) for t in getattr(choice, step)] for step in ("inputs", "lags", "units")},
        }
    if pruned:
        out["pruned"] = {
            "topology": pruned.smallest.topology,
            "weights": pruned.smallest.nonzero,
            "course": [
                _of(s, "weights", "inputs", "units", free_run_nrmse="free_run", one_step_nrmse="one_step")
                for s in pruned.steps
            ],
        }
    return out


def of_table(table: Table1) -> dict[str, Any]:
    """Of the foam-damper paper's Table 1; E_x and E_v in its cm."""
    return {
        "held_out": [record.name for record in table.records],
        "rows": [
            {"model": row.model} | asdict(row.norms) | {"nrmse": row.nrmse, "paper": row.paper and asdict(row.paper)}
            for row in table.rows
        ],
    }


def _law(fit: Fit) -> dict[str, Any]:
    return {
        "law": fit.model.law,
        "attributes": dict(fit.model.attributes),
        "fitted": _errors(fit.train, fit.train_nrmse),
        "held_out": _errors(fit.held_out, fit.held_out_nrmse),
    }


def _errors(errors: Sequence[RecordError], pooled: float) -> dict[str, Any]:
    return {"nrmse": pooled, "records": [_of(e, "record", rmse_N="rmse") | _of(e, "nrmse") for e in errors]}


def _trial(t: Trial) -> dict[str, Any]:
    return t.candidate._asdict() | {
        **_of(t, "weights", "gamma"),
        "train": _of(t, free_run_nrmse="train_free", one_step_nrmse="train_one"),
        "validation": _of(t, free_run_nrmse="validation_free", one_step_nrmse="validation_one"),
        "validation_range": {"free_run_nrmse": t.span("free_run"), "one_step_nrmse": t.span("one_step")},
    }


def _of(item: object, *names: str, **others: str) -> dict[str, Any]:
    """Attributes of an item by their names. others: key -> attribute."""
    return {key: getattr(item, name) for key, name in (*zip(names, names, strict=True), *others.items())}


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return value
