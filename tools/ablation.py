"""Contribution of each rule of the verdict: `python tools/ablation.py OUT --bench NAME=CASES,LABELS.json ...`.

Every case is searched once. Its fits are then evaluated with all rules and once more with each rule left out,
so that a row of the table differs from the first by that rule alone. The checks that need the final fit are
evaluated too. Rules of the search (which fits are made) are not among them.
OUT/BENCH/CASE.json holds the answers of a case; an interrupted run is resumed. OUT/ablation.md is the table:
cases right, those with a cause named right, and those with a cause invented.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

from joblib import Parallel, delayed
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from mrdamp.blindtest.score import Row, row
from mrdamp.diagnosis import frame_run, run
from mrdamp.diagnosis.case.folder import read_case
from mrdamp.diagnosis.evidence import established, judgement, penalties, verdict
from mrdamp.diagnosis.fits import record_costs
from mrdamp.diagnosis.fits.final import heldout
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.fits.store import Store
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.diagnosis.run import searched
from mrdamp.diagnosis.searched import Searched
from mrdamp.errors import InputError
from mrdamp.files import write_atomic


@contextmanager
def constant(module: Any, name: str, value: Any) -> Iterator[None]:
    """A constant of a module, as it imported it, with another value."""
    with mock.patch.object(module, name, value):
        yield


@contextmanager
def attribute(search: Search, name: str, value: Any) -> Iterator[None]:
    """Something that a search has collected, with another value."""
    before = getattr(search, name)
    setattr(search, name, value)
    try:
        yield
    finally:
        setattr(search, name, before)


@contextmanager
def _both(one: Any, other: Any) -> Iterator[None]:
    with ExitStack() as stack:
        stack.enter_context(one)
        stack.enter_context(other)
        yield


@contextmanager
def _once(module: Any, name: str) -> Iterator[None]:
    """A function of a module that is computed once for the same arguments: most rules lead to the same fit."""
    plain = getattr(module, name)
    known: dict[tuple[Any, ...], tuple[Any, Any]] = {}

    def same(*args: Any, **kwargs: Any) -> Any:
        key = (*map(id, args), *((k, id(v)) for k, v in sorted(kwargs.items())), Search.inexact)
        if key not in known:
            known[key] = plain(*args, **kwargs), (args, kwargs)  # held, so that no id is used twice
        return known[key][0]

    with mock.patch.object(module, name, same):
        yield


def _own_costs(search: Search, fits: Sequence[Fit]) -> dict[int, float]:
    """Costs by id on the records that the fits were fitted to."""
    if not search.inexact:
        return {}
    return {id(f): record_costs.own_cost(search, f) for f in fits}


def _whole_records(problem: Problem, found: Fit) -> Any:
    """Costs (records,) with each record left out in turn."""
    return problem.costs(heldout(problem, found))


def _summed(search: Search, costs: Any) -> float:
    """The cost of all records together."""
    return float(costs.sum())


Rule = Callable[[Searched], Any]
#: What is left out, by name.
RULES: Mapping[str, Rule] = {
    "penalty of a cause that equals another one (`NOT_ITSELF`)": lambda s: constant(penalties, "NOT_ITSELF", 0.0),
    "full penalty of free parameters with an idle cause": lambda s: constant(penalties, "REDUCIBLE", -math.inf),
    "penalty on the change of nominal parameters (`MOVE_PENALTY`)": lambda s: constant(
        verdict, "MOVE_PENALTY", 0.0
    ),
    "penalty of free nominal parameters (`LAW_PENALTY`, `LOGIT_LAW`)": lambda s: _both(
        constant(verdict, "LAW_PENALTY", 0.0), constant(established, "LOGIT_LAW", 0.0)
    ),
    "penalty of a parameter (`NUMBER_PENALTY`, `LOGIT_NUMBER`)": lambda s: _both(
        constant(verdict, "NUMBER_PENALTY", 0.0), constant(established, "LOGIT_NUMBER", 0.0)
    ),
    "resolution by the noise floor (`FLOOR_RESOLUTION`)": lambda s: constant(verdict, "FLOOR_RESOLUTION", 0.0),
    "tests that do not repeat (`UNSTEADY`)": lambda s: attribute(s.search, "steady", True),
    "rivals outside the catalogue": lambda s: attribute(s.search, "rivals", []),
    "direct comparison of channels": lambda s: attribute(s.search, "direct", {}),
    "ties by nature (`TIED_BY_NATURE`)": lambda s: constant(established, "TIED_BY_NATURE", ()),
    "baseline records": lambda s: constant(judgement, "of_baseline", lambda *a: {}),
    "left-out records, with a wrong law": lambda s: constant(judgement, "left_out_costs", _own_costs),
    "halves of records left out, not whole ones": lambda s: constant(
        judgement, "leave_out_halves", _whole_records
    ),
    "an error variance of each record (`RECORD_VARIANCE`)": lambda s: _both(
        constant(judgement, "over_records", _summed), constant(record_costs, "over_records", _summed)
    ),
    "separate evidence for a wrong law (`INEXACT`)": lambda s: constant(Search, "inexact", False),
    "a cause that harms a regime (`REGIME_WORSE`)": lambda s: constant(judgement, "REGIME_WORSE", math.inf),
    "another law beside a cause of a law's form (`LAW_FORMS`)": lambda s: constant(
        frame_run, "LAW_FORMS", frozenset()
    ),
    "an answer that is worse than nominal on left-out records": lambda s: constant(
        run, "never_worse", lambda search, fits, final, decision: (final, decision)
    ),
}


#: Functions whose results most rules share.
_COSTLY = (
    (run, "final_fit"),
    (frame_run, "other_law"),
    (judgement, "heldout"),
    (judgement, "leave_out_halves"),
    (judgement, "left_out"),
    (judgement, "groupings"),
    (judgement, "regime_cost"),
    (judgement, "largest_increase"),
)


def answers(folder: Path, fits: Path) -> dict[str, Any]:
    """Verdict and causes (name, place) with all rules, and without each. fits: file of the search's fits, deleted at
    the end; an interrupted search is continued from it."""
    case = read_case(folder)
    with threadpool_limits(limits=1), ExitStack() as stack:
        for module, name in _COSTLY:
            stack.enter_context(_once(module, name))
        store = Store.of(fits, case)
        found = searched(case, 1, lambda what, share: None, None, store)
        out = {"nothing": _judged(found)}
        for name, rule in RULES.items():
            with rule(found):
                out[name] = _judged(found)
    store.remove()
    return out


def _judged(found: Searched) -> dict[str, Any]:
    fits, decision, *_ = run.concluded(found)
    terms = fits[decision.chosen.index].hypothesis.terms if decision.verdict == "effect" else ()
    likely = 1 - decision.unknown
    effects = [{"name": t.effect, "place": t.place, "probability": likely} for t in terms]
    return {"verdict": decision.verdict, "effects": effects}


def answer_one(bench: str, folder: Path, out: Path) -> str:
    """Writes a case's answers, unless they are there."""
    file = out / bench / f"{folder.name}.json"
    if file.exists():
        return ""
    begun = time.monotonic()
    file.parent.mkdir(parents=True, exist_ok=True)
    try:
        found = answers(folder, file.with_suffix(".fits"))
    except (InputError, ValueError, ArithmeticError) as error:
        return f"{bench}/{folder.name}: {error}"
    write_atomic(file, json.dumps(found, indent=1) + "\n")
    return f"{bench}/{folder.name}: {time.monotonic() - begun:.0f} s"


def rows(out: Path, benches: Mapping[str, tuple[Path, Path]]) -> dict[str, dict[str, list[Row]]]:
    """Rule -> bench -> scored answers."""
    scored: dict[str, dict[str, list[Row]]] = {}
    for bench, (_, labels) in benches.items():
        known = json.loads(labels.read_text(encoding="utf-8"))
        for file in sorted((out / bench).glob("*.json")):
            label = {"stages": [], **known[file.stem]}
            for rule, answer in json.loads(file.read_text(encoding="utf-8")).items():
                one = row(file.stem, label, answer, (math.nan, math.nan), math.nan)
                scored.setdefault(rule, {}).setdefault(bench, []).append(one)
    return scored


def table(scored: Mapping[str, Mapping[str, Sequence[Row]]], benches: Sequence[str]) -> str:
    """Markdown: for each removed rule the right answers of each bench, the causes named right and the cases with an
    invented cause; the numbers of cases are in the head."""
    lines: list[str] = []
    for rule, by_bench in scored.items():
        every = [r for b in benches for r in by_bench.get(b, ())]
        effects = [r for r in every if r.want == "effect"]
        groups = {b: by_bench.get(b, ()) for b in benches} | {"causes named": effects}
        cells = [sum(r.right for r in some) for some in groups.values()]
        if not lines:
            head = [f"{name} ({len(some)})" for name, some in groups.items()]
            head.append(f"cases with an invented cause ({len(every)})")
            lines = ["| removed rule | " + " | ".join(head) + " |", "|---|" + "--:|" * len(head)]
        lines.append(f"| {rule} | {' | '.join(map(str, cells))} | {sum(bool(r.invented) for r in every)} |")
    return "\n".join(lines) + "\n"


def main() -> int:
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("out", type=Path)
    p.add_argument("--bench", nargs="+", required=True, metavar="NAME=CASES,LABELS")
    p.add_argument("--jobs", type=int, default=1, help="cases at a time (default: %(default)s)")
    a = p.parse_args()
    benches = {}
    for text in a.bench:
        name, _, paths = text.partition("=")
        cases, _, labels = paths.partition(",")
        if not (Path(cases).is_dir() and Path(labels).is_file()):
            print(f"ablation: --bench {text}: NAME=FOLDER_OF_CASES,LABELS.json is needed", file=sys.stderr)
            return 2
        benches[name] = (Path(cases), Path(labels))
    tasks = [
        (name, case, a.out)
        for name, (cases, _) in benches.items()
        for case in sorted(cases.iterdir())
        if (case / "case.json").is_file()
    ]
    work = Parallel(n_jobs=a.jobs, return_as="generator_unordered")
    for done, line in enumerate(work(delayed(answer_one)(*task) for task in tasks), 1):
        print(f"{done}/{len(tasks)} {line}", flush=True)
    text = table(rows(a.out, benches), list(benches))
    write_atomic(a.out / "ablation.md", text)
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
