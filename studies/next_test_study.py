"""Does the proposed test resolve what the records leave open? `python -m studies.next_test_study -o out/next_test`.

Makes cases on the reference rig (`studies.blindtest`, which shares no code with the simulator), cut down to their sines
at constant command, and diagnoses them. Where the cause is left open, that rig runs the proposed test and tests drawn
at random from the same family, of the same length and within the same limits. After each of them the
causes that were left open are fitted again, to the old records and the new one. Finished cases are kept in OUT and
the same command continues there.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.interpolate import CubicSpline
from scipy.stats import binomtest

from mrdamp.commands import save_picture
from mrdamp.diagnosis.case.folder import Case, read_case
from mrdamp.diagnosis.damper_run import judge
from mrdamp.diagnosis.evidence.ties import tie_classes
from mrdamp.diagnosis.evidence.verdict import Scored, by_causes
from mrdamp.diagnosis.fits.limits import Limits
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.hypotheses.terms import Term
from mrdamp.diagnosis.problem.damper import DamperRig
from mrdamp.diagnosis.problem.designs import columns, drawn
from mrdamp.diagnosis.problem.make import make_rig
from mrdamp.diagnosis.problem.noise import channel_noise, floors, trust
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.diagnosis.report.result import Diagnosis
from mrdamp.diagnosis.run import diagnose
from mrdamp.files import write_atomic
from mrdamp.pictures.style import COLOURS, REFERENCE, axes_grid, figure, legend, styled
from studies.blindtest import causes, damper_case, dampers, excitation, recorder
from studies.blindtest.bench import Truth, damper_channels, nominal_damper
from studies.blindtest.excitation import GRID_HZ, Excitation
from studies.blindtest.rig import Array, BlownUp
from studies.blindtest.scale import Sized
from studies.blindtest.sizing import Task, pooled, relative, size_for

#: The gap that a cause opens on tests with a changing command.
_GAP = 0.15
_TELLING = ("sine_random",)
#: One cause at a time: a narrow search does, and is quick.
_LIMITS = Limits(singles=6, forms=2, depth=1, polished=2, base=10)
#: A cause at least this probable, other than the likeliest, is left open.
_OPEN = 0.02
_NEED_REFERENCE = ("sensor_gain", "sensor_offset")
_STRIDE = 2
#: nats beyond which a margin counts no more, and a probability as small; noises that count as none.
_MOST, _TINY, _LEAST = 30.0, 1e-15, 0.05


@dataclass(frozen=True)
class Outcome:
    """After a test: the verdict in short; resolved: the cause is named, alone, and nothing is tied; margin: nats
    (log of odds) between the cause and the likeliest other answer; behind: what the best fit without the cause leaves
    more than the best one with it, RMS over the noise."""

    answer: str
    resolved: bool
    margin: float
    behind: float


@dataclass(frozen=True)
class Row:
    """A case: its cause, what was answered before, what was left open, and what came after each test."""

    case: str
    cause: str
    before: str
    signal: str
    left_open: tuple[str, ...]
    start: Outcome
    proposed: Outcome
    random: tuple[Outcome, ...]

    @classmethod
    def of(cls, kept: Mapping[str, object]) -> Row:
        """From a kept file."""
        data = dict(kept)
        for name in ("start", "proposed"):
            data[name] = Outcome(**data[name])  # type: ignore[arg-type]
        data["random"] = tuple(Outcome(**o) for o in data["random"])  # type: ignore[attr-defined]
        return cls(**{**data, "left_open": tuple(data["left_open"])})  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class Narrowed(DamperRig):
    """A rig whose catalogue is what was left open."""

    causes: frozenset[str] = frozenset()

    @cached_property
    def terms(self) -> tuple[Term, ...]:
        return tuple(t for t in super().terms if t.cause in self.causes)


def answer(found: Diagnosis) -> str:
    """The verdict in short, with what is tied."""
    named = " + ".join(e.effect for e in found.effects) or found.verdict
    ties = [", ".join(t) for t in found.indistinguishable]
    return f"{named} (tied: {'; '.join(ties)})" if ties else named


def resolved(found: Diagnosis, cause: str) -> bool:
    """True where the cause is named, alone, and nothing is tied."""
    return [e.effect for e in found.effects] == [cause] and not found.indistinguishable


def left_open(found: Diagnosis) -> frozenset[str]:
    """Causes that the records neither name alone nor rule out: likely ones, tied ones, unseen ones."""
    likeliest = max(found.probabilities.values(), default=1.0)
    likely = {c for c, p in found.probabilities.items() if p > _OPEN * likeliest}
    return frozenset(
        likely | {c for t in found.indistinguishable for c in t} | {u["effect"] for u in found.unseen}
    )


def outcome(case: Case, open_causes: frozenset[str], cause: str) -> Outcome:
    """The records of a case, explained by what was left open."""
    rig = Narrowed(case.model, case.records, causes=open_causes)
    noise, _ = channel_noise(case, rig)
    plain = Problem(rig, stride=_STRIDE, coarse=True)
    floor = floors(plain, noise, {})
    problem = Problem(rig, stride=_STRIDE, coarse=True, trust=trust(plain, floor))
    search = Search(problem, problem.cost(floor), replace(_LIMITS, singles=len(open_causes)))
    search.run()
    fits, decision = judge(search)
    chosen = fits[decision.chosen.index]
    scored = [Scored(f.hypothesis.causes, bool(f.hypothesis.nominal), f.cost, 0) for f in fits]
    sets = by_causes(scored, decision.probabilities)
    ties = tie_classes(search, chosen, sets) if decision.verdict == "effect" else ()
    own = sets.get((cause,), 0.0)
    other = max((p for c, p in sets.items() if c != (cause,)), default=0.0)
    with_it, without = (
        min((f.cost for f in fits if (cause in f.hypothesis.causes) is wanted), default=search.nominal_cost)
        for wanted in (True, False)
    )
    return Outcome(
        " + ".join(chosen.hypothesis.causes) if decision.verdict == "effect" else decision.verdict,
        decision.verdict == "effect" and chosen.hypothesis.causes == (cause,) and not ties,
        float(np.clip(np.log(max(own, _TINY)) - np.log(max(other, _TINY)), -_MOST, _MOST)),
        float(np.sqrt(max(without - with_it, 0.0) / search.floor)),
    )


def played(columns: Mapping[str, Array]) -> Excitation:
    """A proposed test as the rig's machine runs it."""
    time = columns["time_s"]
    t = np.arange(round(time[-1] * GRID_HZ) + 1) / GRID_HZ
    command = columns["command"][np.searchsorted(time, t + 1e-9, side="right") - 1]
    return Excitation("test", CubicSpline(time, columns["displacement_m"])(t), command)


def run(folder: Path, name: str, cause: str, seed: np.random.SeedSequence, count: int) -> Row | None:
    """One case from draw to row, with so many tests at random; None if the sines resolve it. Raises BlownUp where
    its numbers are too stiff for the rig."""
    rng = np.random.default_rng(seed)
    task = Task(name, "damper", cause)
    device = dampers.draw(rng, mounted=task.mounted)
    plain = Truth(device.numbers, filtered=False)
    whole = excitation.damper_tests(rng, device.machine, long=False)
    most_different, sines = ([t for t in whole if t.kind in kinds] for kinds in (_TELLING, ("sine",)))
    scale = damper_case.measure(device, most_different)
    noise = recorder.damper_noise(rng, scale.force, scale.command)
    sized = causes.draw(rng, cause, scale).sized
    truth = plain.having(sized(_size(plain, sized, most_different)))
    names = ["displacement_m", "command", "force_N"]
    names += ["reference_force_N"] if cause in _NEED_REFERENCE else []

    def recorded(test: Excitation) -> dict[str, Array]:
        clean = damper_channels(truth, test, rng)
        return {n: noise[n].onto(clean[n], rng) if n in noise else clean[n] for n in names}

    limits = {"command_min": 0.0, "command_max": device.machine.command}
    nominal = {"law": device.law, "parameters": device.parameters | limits}
    records = {f"{k}_sine.csv": recorded(test) for k, test in enumerate(sines, 1)}
    records["4_repeat.csv"] = recorded(sines[-1])
    recorder.write_case(folder / "before", "damper", nominal, records)
    case = read_case(folder / "before")
    before = diagnose(case, limits=_LIMITS)
    if resolved(before, cause) or before.next_signal is None:
        return None
    open_causes, envelope = left_open(before), make_rig(case).envelope

    def after(kind: str, test: Mapping[str, Array]) -> Outcome:
        more = {"3_test.csv": recorded(played(test))}
        recorder.write_case(folder / kind, "damper", nominal, dict(sorted((records | more).items())))
        return outcome(read_case(folder / kind), open_causes, cause)

    others = [columns(drawn(rng, envelope).signal(envelope), envelope) for _ in range(count)]
    return Row(
        name,
        cause,
        answer(before),
        str(before.next_experiment["signal"]),
        tuple(sorted(open_causes)),
        outcome(case, open_causes, cause),
        after("proposed", before.next_signal),
        tuple(after(f"random_{k}", test) for k, test in enumerate(others, 1)),
    )


def _size(plain: Truth, sized: Sized, tests: list[Excitation]) -> float:
    """The cause's size at which it opens the gap."""
    still = np.random.default_rng(0)

    def gap(size: float) -> float:
        truth = plain.having(sized(size))
        pairs = [
            (nominal_damper(plain.numbers, truth, t), damper_channels(truth, t, still)["force_N"])
            for t in tests
        ]
        return pooled([relative(*pair) for pair in pairs])

    return size_for(gap, _GAP)


def at_least(chances: Sequence[Array], total: int) -> float:
    """Probability that independent numbers add up to at least a total. chances: of 0, 1, 2 ... for each of them."""
    sums = np.ones(1)
    for chance in chances:
        sums = np.convolve(sums, chance)
    return float(sums[total:].sum())


def table(rows: Sequence[Row]) -> str:
    """The rows, and what they come to.

    Were the proposed test like one at random, any of a case's tests could have been it: its place among them by the
    margin would be anywhere, and it would have resolved the case as often as all of them did on average.
    """
    after = ("with the proposed test", "with random tests, resolved")
    head = ("cause", "before", *after, "margin, nats", "distance, noises")
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    for r in rows:
        done = sum(o.resolved for o in r.random)
        margins, behind = (np.median([getattr(o, k) for o in r.random]) for k in ("margin", "behind"))
        lines.append(
            f"| {r.cause} | {r.before} | {'resolved' if r.proposed.resolved else r.proposed.answer} "
            f"| {done} of {len(r.random)} | {r.proposed.margin:.1f}, {margins:.1f} "
            f"| {r.proposed.behind:.2f}, {behind:.2f} |"
        )
    ours = [r.proposed.resolved for r in rows]
    theirs = [o.resolved for r in rows for o in r.random]
    lines.append("")
    for kind, marks in (("proposed", ours), ("random", theirs)):
        low, high = binomtest(sum(marks), len(marks)).proportion_ci(method="wilson")
        share = f"{np.mean(marks):.2f} ({low:.2f} to {high:.2f}, Wilson)"
        lines.append(f"{kind}: {sum(marks)} of {len(marks)} resolved, {share}.")
    shares = [np.mean([r.proposed.resolved, *(o.resolved for o in r.random)]) for r in rows]
    p = at_least([np.array([1 - s, s]) for s in shares], sum(ours))
    below = [sum(o.margin < r.proposed.margin for o in r.random) for r in rows]
    level = [sum(o.margin == r.proposed.margin for o in r.random) for r in rows]
    uniform = [np.full(len(r.random) + 1, 1 / (len(r.random) + 1)) for r in rows]
    ranks = at_least(uniform, sum(below))
    lines.append(f"So many resolved by chance among a case's tests: p = {p:.2g}.")
    lines.append(
        f"Random tests with a smaller margin: {sum(below)} of {len(theirs)} ({sum(level)} the same; by chance "
        f"p = {ranks:.2g})."
    )
    ratios = np.log([
        max(r.proposed.behind, _LEAST) / max(float(np.median([o.behind for o in r.random])), _LEAST) for r in rows
    ])  # fmt: skip
    rng = np.random.default_rng(0)
    means = ratios[rng.integers(0, len(ratios), (4000, len(ratios)))].mean(axis=1)
    low, high = np.exp(np.percentile(means, [2.5, 97.5]))
    lines.append(
        f"Separation, proposed over the median random one: {np.exp(ratios.mean()):.2f} ({low:.2f} to {high:.2f}, 95 %, "
        "geometric mean, cases drawn again)."
    )
    return "\n".join(lines)


@styled
def picture(rows: Sequence[Row]) -> Figure:
    """The margin of the cause after each test, a line a case."""
    fig = figure(0.9 + 0.24 * len(rows))
    ax = axes_grid(fig, 1, 1)[0][0]
    for k, r in enumerate(rows):
        y = np.full(len(r.random), float(k))
        ax.plot([o.margin for o in r.random], y, "o", color=REFERENCE, markersize=4.5, alpha=0.8)
        ax.plot(r.proposed.margin, k, "D", color=COLOURS[0], markersize=6)
    ax.axvline(0, color="black", linewidth=0.7)
    ax.set_yticks(range(len(rows)), [r.cause for r in rows])
    ax.invert_yaxis()
    ax.set_xlabel("log odds of the true cause, nats")
    marks = [
        Line2D([], [], color=COLOURS[0], marker="D", linestyle=""),
        Line2D([], [], color=REFERENCE, marker="o", linestyle=""),
    ]
    legend(fig, marks, ["after the proposed test", "after a random test"])
    return fig


def main() -> int:
    p = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    p.add_argument("-o", "--out", type=Path, required=True)
    p.add_argument("--seed", type=int, default=1)
    p.add_argument("--rounds", type=int, default=1, help="cases of each effect (default: %(default)s)")
    p.add_argument("--random", type=int, default=5, help="random tests a case (default: %(default)s)")
    p.add_argument(
        "--effects", nargs="+", default=list(causes.EFFECTS), help="what the rigs have (default: all)"
    )
    a = p.parse_args()
    effects = [e for _ in range(a.rounds) for e in a.effects]
    seeds = np.random.SeedSequence(a.seed).spawn(len(effects))
    rows, resolved_before = [], 0
    for k, (cause, seed) in enumerate(zip(effects, seeds, strict=True), 1):
        name = f"case_{k:02d}"
        kept = a.out / f"{name}.json"
        if not kept.is_file():
            try:
                row = run(a.out / name, name, cause, seed, a.random)
            except BlownUp as error:
                print(f"{name} {cause}: left out ({error})", file=sys.stderr)
                continue
            write_atomic(kept, json.dumps(row and asdict(row)) + "\n")
        data = json.loads(kept.read_text(encoding="utf-8"))
        resolved_before += data is None
        rows += [Row.of(data)] if data is not None else []
        outcome = "resolved by the sines" if data is None else f"{rows[-1].before} -> {rows[-1].proposed}"
        print(f"{k}/{len(effects)} {cause}: {outcome}", file=sys.stderr, flush=True)
    print(f"{len(rows)} cases left open by sines at constant command, {resolved_before} resolved.\n")
    if rows:
        print(table(rows))
        save_picture(picture(rows), a.out / "next_test.png")
    return 0


if __name__ == "__main__":
    sys.exit(main())
