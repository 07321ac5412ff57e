"""Does the proposed test settle what the records leave open? `python tools/next_test_study.py -o out/next_test`.

Makes cases on the reference rig (`mrdamp.blindtest`, which shares no code with the simulator), cut down to their sines
at constant command, diagnoses them, runs the proposed test on that rig, and beside it a test drawn at random from the
same family, of the same length and within the same limits; then diagnoses again with either one added. A case counts
where the first diagnosis leaves its cause open. Finished cases are kept in OUT and the same command goes on there.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.stats import binomtest

from mrdamp.blindtest import causes, damper_case, dampers, excitation, recorder
from mrdamp.blindtest.bench import Truth, damper_channels, nominal_damper
from mrdamp.blindtest.excitation import GRID_HZ, Excitation
from mrdamp.blindtest.rig import Array, BlownUp
from mrdamp.blindtest.sizing import Task, pooled, relative, size_for
from mrdamp.diagnosis.case import read_case
from mrdamp.diagnosis.experiment import drawn
from mrdamp.diagnosis.result import Diagnosis
from mrdamp.diagnosis.run import diagnose, make_rig
from mrdamp.diagnosis.search import Limits
from mrdamp.files import write_atomic

#: The gap that a cause opens on tests with a changing command.
_GAP = 0.15
_TELLING = ("sine_random",)
#: One cause at a time: a narrow search does, and is quick.
_LIMITS = Limits(singles=6, forms=2, depth=1, polished=2, base=10)
_NEED_REFERENCE = ("sensor_gain", "sensor_offset")


@dataclass(frozen=True)
class Row:
    """A case: its cause, what was answered before and with either test, and whether that is the cause alone."""

    case: str
    cause: str
    before: str
    proposed: str
    random: str
    signal: str
    open: bool
    settled_by_proposed: bool
    settled_by_random: bool


def answer(found: Diagnosis) -> str:
    """The verdict in short, with what is tied."""
    named = " + ".join(e.effect for e in found.effects) or found.verdict
    ties = [", ".join(t) for t in found.indistinguishable]
    return f"{named} (tied: {'; '.join(ties)})" if ties else named


def settled(found: Diagnosis, cause: str) -> bool:
    """True where the cause is named, alone, and nothing is tied."""
    return [e.effect for e in found.effects] == [cause] and not found.indistinguishable


def played(columns: Mapping[str, Array]) -> Excitation:
    """A proposed test as the rig's machine runs it."""
    time = columns["time_s"]
    t = np.arange(round(time[-1] * GRID_HZ) + 1) / GRID_HZ
    command = columns["command"][np.searchsorted(time, t + 1e-9, side="right") - 1]
    return Excitation("test", CubicSpline(time, columns["displacement_m"])(t), command)


def run(folder: Path, name: str, cause: str, seed: np.random.SeedSequence) -> Row:
    """One case from draw to row. Raises BlownUp where its numbers are too stiff for the rig."""
    rng = np.random.default_rng(seed)
    task = Task(name, "damper", cause)
    device = dampers.draw(rng, mounted=task.mounted)
    plain = Truth(device.numbers, filtered=False)
    whole = excitation.damper_tests(rng, device.machine, long=False)
    telling, sines = ([t for t in whole if t.kind in kinds] for kinds in (_TELLING, ("sine",)))
    scale = damper_case.measure(device, telling)
    noise = recorder.damper_noise(rng, scale.force, scale.command)
    sized = causes.draw(rng, cause, scale).sized
    truth = plain.having(sized(_size(plain, sized, telling)))
    names = [
        "displacement_m",
        "command",
        "force_N",
        *(["reference_force_N"] if cause in _NEED_REFERENCE else []),
    ]

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
    if settled(before, cause):
        found = answer(before)
        return Row(name, cause, found, found, found, str(before.next_experiment["signal"]), False, True, True)
    envelope = make_rig(case).envelope
    tests = {"proposed": before.next_signal}
    at_random = drawn(rng, envelope).signal(envelope)
    t = envelope.sample_time * np.arange(len(at_random.motion))
    tests["random"] = {"time_s": t, "displacement_m": at_random.motion, "command": at_random.command}
    after = {}
    for kind, columns in tests.items():
        if columns is None:
            after[kind] = before
            continue
        more = {"3_test.csv": recorded(played(columns))}
        recorder.write_case(folder / kind, "damper", nominal, dict(sorted((records | more).items())))
        after[kind] = diagnose(read_case(folder / kind), limits=_LIMITS)
    return Row(
        name,
        cause,
        answer(before),
        answer(after["proposed"]),
        answer(after["random"]),
        str(before.next_experiment["signal"]),
        True,
        settled(after["proposed"], cause),
        settled(after["random"], cause),
    )


def _size(plain: Truth, sized: causes.Sized, tests: list[Excitation]) -> float:
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


def table(rows: list[Row]) -> str:
    """The rows of the cases that were open, and what they come to."""
    shown = [r for r in rows if r.open]
    lines = ["| cause | before | with the proposed test | with a random test |", "|---|---|---|---|"]
    for r in shown:
        pairs = ((r.settled_by_proposed, r.proposed), (r.settled_by_random, r.random))
        marks = ("settled" if done else told for done, told in pairs)
        lines.append(f"| {r.cause} | {r.before} | {' | '.join(marks)} |")
    counts = [sum(getattr(r, k) for r in shown) for k in ("settled_by_proposed", "settled_by_random")]
    ours = sum(r.settled_by_proposed and not r.settled_by_random for r in shown)
    theirs = sum(r.settled_by_random and not r.settled_by_proposed for r in shown)
    lines.append(f"\n{len(rows)} cases, {len(shown)} left open by constant-current sines.")
    for kind, count in zip(("proposed", "random"), counts, strict=True):
        low, high = binomtest(count, len(shown)).proportion_ci(method="wilson") if shown else (0.0, 1.0)
        lines.append(
            f"{kind} test: {count} of {len(shown)} settled (95 %: {100 * low:.0f} to {100 * high:.0f} %)."
        )
    chance = binomtest(ours, ours + theirs).pvalue if ours + theirs else 1.0
    alone = f"Settled by the proposed test alone {ours}, by the random one alone {theirs}"
    lines.append(f"{alone} (sign test p = {chance:.2g}).")
    return "\n".join(lines)


def main() -> int:
    p = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    p.add_argument("-o", "--out", type=Path, required=True)
    p.add_argument("--seed", type=int, default=1)
    p.add_argument("--rounds", type=int, default=1, help="cases of each effect (default: %(default)s)")
    p.add_argument(
        "--effects", nargs="+", default=list(causes.EFFECTS), help="what the rigs have (default: all)"
    )
    a = p.parse_args()
    effects = [e for _ in range(a.rounds) for e in a.effects]
    seeds = np.random.SeedSequence(a.seed).spawn(len(effects))
    rows = []
    for k, (cause, seed) in enumerate(zip(effects, seeds, strict=True), 1):
        name = f"case_{k:02d}"
        kept = a.out / f"{name}.json"
        if not kept.is_file():
            try:
                row = run(a.out / name, name, cause, seed)
            except BlownUp as error:
                print(f"{name} {cause}: left out ({error})", file=sys.stderr)
                continue
            write_atomic(kept, json.dumps(asdict(row)) + "\n")
        rows.append(Row(**json.loads(kept.read_text(encoding="utf-8"))))
        r = rows[-1]
        print(
            f"{k}/{len(effects)} {r.cause}: {r.before} -> {r.proposed} | {r.random}",
            file=sys.stderr,
            flush=True,
        )
    print(table(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
