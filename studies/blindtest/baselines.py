"""Simpler methods, scored on the same cases with the same figures as the diagnosis.

They share the diagnosis's simulator, catalogue and fits, without its evidence and verdict:

- `nominal only` changes nothing;
- `recalibration only` fits the nominal parameters and names nothing;
- `greedy` adds the effect that reduces the error on the records most, as long as it decreases;
- `no re-tuning` does the same with fixed nominal parameters;
- `sparse regression` fits the residual by functions of motion and command (`sparse.py`).

None of them can report a cause outside the catalogue, and none states probabilities.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import joblib
import numpy as np

from mrdamp.diagnosis.case.folder import Case, read_case
from mrdamp.diagnosis.fits.least_squares import Fit, fit
from mrdamp.diagnosis.fits.limits import Limits
from mrdamp.diagnosis.fits.screening import screen
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.problem.make import make_rig
from mrdamp.diagnosis.problem.noise import channel_noise, floors
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.errors import InputError
from mrdamp.files import write_atomic
from mrdamp.model import Model
from studies.blindtest import score, sparse
from studies.blindtest.run import Folders, predicted
from studies.blindtest.score import Row

Progress = Callable[[str, float], None]
#: Answer (as diagnosis.json) and simulated channels for a test's inputs.
Answer = tuple[dict[str, Any], score.Predict]
Method = Callable[[Case], Answer]

#: Least relative reduction of the sum of squares for another effect; at most three effects.
_WORTH, _MOST = 0.1, 3
#: Number of best terms of a screening that are fitted in each round.
_TRIED = 4
#: Largest multiple of the noise floor that counts as no gap.
_NO_GAP = 1.5
_SAMPLES = 10_000


def nominal_only(case: Case) -> Answer:
    """The unchanged nominal simulator."""
    return _answer("none", []), _predict(case.model)


def recalibration_only(case: Case) -> Answer:
    """Fits the nominal parameters."""
    search = _search(case)
    if _no_gap(search):
        return nominal_only(case)
    return _answer("parameters", []), _predict(search.problem.rig.model(search.base.settings))


def greedy(case: Case) -> Answer:
    """Adds the effects that reduce the error on the records most, with free nominal parameters."""
    search = _search(case)
    return _forward(case, search, search.base)


def no_retuning(case: Case) -> Answer:
    """The same with fixed nominal parameters."""
    search = _search(case)
    return _forward(case, search, search.fits[False, frozenset()])


def sparse_regression(case: Case) -> Answer:
    """Adds a sparse sum of functions of motion and command to the simulator (pysindy's STLSQ)."""
    if case.model.rig != "damper":
        raise InputError("sparse regression is for the rig damper alone")
    found = sparse.regress(case)
    if not found.effect:
        return nominal_only(case)[0], found.predict
    return _answer("effect", [(found.effect, None)]), found.predict


def _forward(case: Case, search: Search, start: Fit) -> Answer:
    """Forward selection by the error on the records of the fit."""
    if _no_gap(search):
        return nominal_only(case)
    held = search.fits[False, frozenset()]
    best, free = start, bool(start.hypothesis.nominal)
    for _ in range(_MOST):
        taken = set(best.hypothesis.causes)
        terms = [t for t in search.problem.rig.terms if t.cause not in taken]
        # A recalibration at its bounds can hide an effect: effects are screened with nominal and with fitted
        # parameters.
        starting_fits = [best, held] if best is search.base else [best]
        promising = {p.term.name: (p.term, p.start) for f in starting_fits for p in screen(search, f, terms)[:_TRIED]}
        tries = []
        for term, k in promising.values():
            hypothesis, point = search.start_from(best, term, k)
            known = best.jacobian if free else None
            tries.append(fit(search.problem, hypothesis, point, most=8, known=known, frozen=free))
        found = min(tries, key=lambda f: f.cost, default=best)
        if found.cost > (1 - _WORTH) * best.cost:
            break
        best = found
    effects = [(t.effect, t.place) for t in best.hypothesis.terms]
    verdict = "effect" if effects else "parameters" if free else "none"
    return _answer(verdict, effects), _predict(search.problem.rig.model(best.settings))


def _search(case: Case) -> Search:
    """Fits of the nominal simulator and its recalibration."""
    rig = make_rig(case)
    total = sum(r.n for r in case.records) * len(rig.channels)
    problem = Problem(rig, stride=max(1, round(total / _SAMPLES)), coarse=True)
    floor = floors(problem, channel_noise(case, rig)[0], {})
    return Search(problem, float(np.sum(floor**2)) / len(rig.channels), Limits())


def _no_gap(search: Search) -> bool:
    return search.nominal_cost < _NO_GAP**2 * search.floor


def _predict(model: Model) -> score.Predict:
    return lambda inputs: predicted(model, inputs)


def _answer(verdict: str, effects: Sequence[tuple[str, int | None]]) -> dict[str, Any]:
    return {"verdict": verdict, "effects": [{"name": n, "place": p, "probability": 1.0} for n, p in effects]}


METHODS: Mapping[str, Method] = {
    "nominal only": nominal_only,
    "recalibration only": recalibration_only,
    "greedy, by error on the records": greedy,
    "greedy without re-tuning": no_retuning,
    "sparse regression of the residual": sparse_regression,
}


def run_all(out: Folders, jobs: int, progress: Progress) -> dict[str, list[Row]]:
    """Rows of every method on the opened cases of a blind test; finished cases are not repeated."""
    labels: dict[str, Any] = json.loads((out.root / "labels.json").read_text())
    names = [name for name in METHODS if name != "sparse regression of the residual" or sparse.available()]
    tasks = [(method, case) for method in names for case in labels]
    work = joblib.Parallel(n_jobs=jobs, return_as="generator")
    rows: dict[str, list[Row]] = {}
    done = work(joblib.delayed(_one)(out, method, case, labels[case]) for method, case in tasks)
    for number, ((method, _), row) in enumerate(zip(tasks, done, strict=True), 1):
        if row is not None:
            rows.setdefault(method, []).append(row)
        progress(f"baselines {number}/{len(tasks)}", number / len(tasks))
    return rows


def _one(out: Folders, method: str, name: str, label: Mapping[str, Any]) -> Row | None:
    """The row of a method on a case; None if the method does not apply to the rig."""
    if method == "sparse regression of the residual" and label["rig"] != "damper":
        return None
    kept = out.root / "baselines" / method.replace(" ", "_").replace(",", "") / f"{name}.json"
    if kept.is_file():
        held = json.loads(kept.read_text())
        return score.row(name, label, held["answer"], (held["before"], held["after"]), held["seconds"])
    start = time.monotonic()
    try:
        answer, predict = METHODS[method](read_case(out.cases / name))
        seconds = time.monotonic() - start
        before, after = score.gaps(out.tests / f"{name}.npz", predict)
    except (InputError, ValueError, np.linalg.LinAlgError) as error:
        return score.failed(name, label, "failed", time.monotonic() - start, str(error))
    kept.parent.mkdir(parents=True, exist_ok=True)
    held = {"answer": answer, "before": before, "after": after, "seconds": round(seconds, 2)}
    write_atomic(kept, json.dumps(held) + "\n")
    return score.row(name, label, answer, (before, after), seconds)
