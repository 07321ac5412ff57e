"""Makes a bench of spiked measured records: `python -m studies.spike_bench OUT [--cases 45] [--seed 1] ...`.

A known effect is put exactly into records of real dampers; the simulator was identified on the untouched records, so
that its law is not the rig's. With --bent it was identified on the records that have the effect. Writes
OUT/cases/NAME/ (case.json and records), OUT/labels.json and OUT/tests/NAME.npz,
in the layout of shared/cases/spikes_open. Of a label: `also`, effects that the rig has anyway; `gap`, what the nominal
simulator leaves of the tests; `base`, the same without the effect; `size`, the effect's parameters as put in.
Identifications are kept in OUT/../spike_models (or --models), one for each set and law.

The data are looked for in ../shared/data, or in the folder MRDAMP_DATA; they are not to be passed on from here.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mrdamp.diagnosis.injection.forms import FORMS
from mrdamp.diagnosis.injection.inject import Injection, refusal, residual, strength_of, widened
from mrdamp.files import write_atomic
from mrdamp.identify import identify
from mrdamp.model import Model
from mrdamp.records import Record, RecordSet, embedded, read_records

ROOT = Path(__file__).resolve().parents[1]
LAWS = ("bouc_wen", "modified_bouc_wen", "hyperbolic_tangent")
#: Gap with the effect over the gap without it, between which sizes are drawn.
LEAST, MOST = 1.2, 3.0
#: Factor by which the tests' gap must grow, to distinguish a simulator without the effect from one with it.
SHOWN = 1.1
#: Samples at the start of a test that do not count (as in the scorer of the cases).
SKIP = 50
#: Of a set's records, in a case that has not all of them.
_PART = 0.6
#: Not drawn: the sensor's offset is the simulator's own preload over again, whose number is free in any case.
NOT_DRAWN = ("sensor_offset",)
#: Order in which two effects are put in: forces on the rod, the command that the coil needs, the readings.
STAGES = ("fluid", "mechanics", "mount", "magnetics", "driver", "sensor")
_EXACT_AGAIN = 20  # draws before a slot is given up


@dataclass(frozen=True)
class Rig:
    """A measured set: its folder, effects that it has anyway, effects identified along, and the sampling kept.

    every: of so many samples one is kept. tests: validation records of a case, by the start of their names; empty: all
    of them. sweep: s, the part that is taken of a swept sine."""

    also: tuple[str, ...]
    extras: tuple[str, ...] = ("offset",)
    every: int = 1
    tests: tuple[str, ...] = ()
    sweep: tuple[float, float] | None = None


RIGS = {
    "nees": Rig(("channel_shift", "driver_lag", "command_delay"), ("offset", "driver_lag"), every=3),
    "utfsm": Rig(("shear_thinning", "trapped_gas"), sweep=(4.0, 8.0)),  # 2.5 to 5 Hz; trained up to 3 Hz
    "utfpr": Rig(
        ("shear_thinning", "gas_spring"),
        tests=("0.87V_ensaio2", "0.87V_ensaio6", "0V_ensaio1", "0V_ensaio4a", "1.98V", "3.21V_ensaio.A.4"),
    ),
    "embedded": Rig(
        # Its fluid and housing give way by 1.2 to 2.2 MN/m in series with the flow (tools/make_embedded.py).
        (
            "driver_lag",
            "command_delay",
            "saturation",
            "shear_thinning",
            "seal_friction",
            "gas_spring",
            "mount_compliance",
        )
    ),
}


def records_of(name: str) -> RecordSet:
    """The set, at the sampling that its cases have."""
    rig = RIGS[name]
    folder = Path(os.environ.get("MRDAMP_DATA", ROOT.parent / "shared" / "data"))
    found = embedded() if name == "embedded" else read_records(folder / name)
    kept = [r for r in found.validation if not rig.tests or r.name.startswith(rig.tests)]
    if rig.sweep:
        kept = [r.part(*rig.sweep) if r.name.startswith("chirp") else r for r in kept]
    halves = [
        tuple(r.resample(rig.every * r.sample_time) if rig.every > 1 else r for r in half)
        for half in (found.train, kept)
    ]
    return RecordSet(name, *(tuple(map(_plain, half)) for half in halves))


def _plain(record: Record) -> Record:
    """Without derivatives of the motion, which an injected effect would have to change too; numbers as a file has
    them, so that a prediction from the file is the one that the gap was taken of."""
    kept = ("time_s", "displacement_m", "command", "force_N", "reference_force_N")
    return Record(
        record.name, None, record.sample_time, {n: record.channels[n] for n in kept if n in record.channels}
    )


def nominal(folder: Path, name: str, law: str, records: RecordSet) -> Model:
    """The simulator of a set in a law, identified on its untouched train records; kept in a file."""
    path = folder / f"{name}_{law}.json"
    if not path.exists():
        begun = time.monotonic()
        folder.mkdir(parents=True, exist_ok=True)
        identified(name, law, records.train).write(path)
        print(f"identified {name} {law}: {time.monotonic() - begun:.0f} s", flush=True)
    return Model.read(path)


def identified(name: str, law: str, records: Sequence[Record]) -> Model:
    """A law identified on records of a set."""
    return identify(law, records, extras=RIGS[name].extras, dependence="quadratic", threads=1).model


def test_gap(model: Model, tests: Sequence[Record]) -> float:
    """Root of the mean over the tests of squared relative RMS errors, as in the labels of spikes_open."""
    total = 0.0
    for r in tests:
        force = r.channel("force_N")[SKIP:]
        total += float(np.mean(residual(model, r)[SKIP:] ** 2) / np.mean(force**2))
    return float(np.sqrt(total / len(tests)))


@dataclass(frozen=True, eq=False)
class Made:
    """A case: its simulator, records, baseline records, tests, and its label."""

    model: Model
    records: tuple[Record, ...]
    baseline: tuple[Record, ...]
    tests: tuple[Record, ...]
    label: dict[str, Any]


def make(
    name: str,
    effects: Sequence[str],
    model: Model,
    records: RecordSet,
    part: str,
    rng: np.random.Generator,
    bent: bool = False,
) -> Made | None:
    """One case, with none, one or two effects, each sized alone. part: `all`, `part` of the records, or `baseline`: the
    others come along without the effects. bent: the law is identified again with the effects in its records."""
    chosen, others = _split(records.train, part, rng)
    base = test_gap(model, records.validation)
    label: dict[str, Any] = {
        "label": "+".join(effects) or "~own",
        "also": list(RIGS[name].also),
        "stages": [],
    }
    baseline = others if part == "baseline" else ()
    if not effects:
        label |= {"gap": base, "base": base, "size": {}}
        return Made(model, chosen, baseline, records.validation, label)
    both = tuple(zip((chosen, records.validation), (test_gap(model, chosen), base), strict=True))
    wide, put, tests = model, list(chosen), list(records.validation)
    size: dict[str, float] = {}
    # The rod's forces come first, then what stands between them and a reading.
    for effect in sorted(effects, key=lambda e: STAGES.index(FORMS[e].stage)):
        if any(refusal(effect, model, half) for half, _ in both):
            return None
        injection = Injection.draw(effect, model, (*records.train, *records.validation), rng)
        target = float(np.exp(rng.uniform(np.log(LEAST), np.log(MOST))))

        def ratio(strength: float, injection: Injection = injection) -> float:
            # Of the records too: what slow tests hardly show may be out of all bounds in fast ones.
            spiked = [[injection.put(r, strength) for r in half] for half, _ in both]
            wider = widened(model, [*spiked[0], *spiked[1]])
            return max(test_gap(wider, some) / own for some, (_, own) in zip(spiked, both, strict=True))

        strength = strength_of(ratio, target)
        if strength is None:
            return None
        put, tests = ([injection.put(r, strength) for r in half] for half in (put, tests))
        wide = widened(model, [*put, *tests])
        size |= injection.parameters(strength)
    if bent:
        wide = widened(identified(name, model.law, put), [*put, *tests])
    after = test_gap(wide, tests)
    if after < SHOWN * base:
        return None
    label |= {"stages": sorted({FORMS[e].stage for e in effects}), "gap": after, "base": base, "size": size}
    return Made(wide, tuple(put), baseline, tuple(tests), label)


def _split(
    records: tuple[Record, ...], part: str, rng: np.random.Generator
) -> tuple[tuple[Record, ...], tuple[Record, ...]]:
    if part == "all" or len(records) < 3:
        return records, ()
    count = max(2, round(_PART * len(records)))
    kept = set(rng.choice(len(records), count, replace=False).tolist())
    if part == "part" and _levels(records) > 1:  # every level of the command stays, once at least
        for level in {_level(r) for r in records} - {_level(records[k]) for k in kept}:
            kept.add(next(k for k, r in enumerate(records) if _level(r) == level))
    return (
        tuple(r for k, r in enumerate(records) if k in kept),
        tuple(r for k, r in enumerate(records) if k not in kept),
    )


def _level(record: Record) -> float:
    return round(float(np.mean(record.command)), 2)


def _levels(records: Sequence[Record]) -> int:
    return len({_level(r) for r in records})


def write(made: Made, name: str, out: Path) -> None:
    """The case's folder and its tests; the label last of all, by `main`."""
    folder = out / "cases" / name
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for record, prefix in [*((r, "") for r in made.records), *((r, "baseline_") for r in made.baseline)]:
        record.save(folder / f"{prefix}{record.name}.csv.gz")
        files.append(f"{prefix}{record.name}.csv.gz")
    channels = [c for c in made.records[0].channels if all(c in r.channels for r in made.records)]
    body = made.model.to_dict()["model"]
    data: dict[str, Any] = {"name": name, "format": 1, "rig": "damper", "nominal": body, "channels": channels}
    data["records"] = files[: len(made.records)]
    if made.baseline:
        data["baseline"] = files[len(made.records) :]
    write_atomic(folder / "case.json", json.dumps(data, indent=1) + "\n")
    arrays: dict[str, Any] = {}
    for r in made.tests:
        arrays |= {f"{r.name}/{c}": np.asarray(v) for c, v in r.channels.items()}
        arrays[f"{r.name}/nominal_N"] = np.asarray(r.channel("force_N")) - residual(made.model, r)
    (out / "tests").mkdir(parents=True, exist_ok=True)
    np.savez_compressed(out / "tests" / f"{name}.npz", **arrays)


def slots(
    count: int, controls: int, pairs: int, sets: Sequence[str], rng: np.random.Generator
) -> list[tuple[str, tuple[str, ...]]]:
    """Sets and effects (none: a control), each effect about as often as any other, sets in turn. The last `pairs` have
    a second effect of another stage."""
    out: list[tuple[str, tuple[str, ...]]] = []
    for n in range(controls):
        out.append((sets[n % len(sets)], ()))
    effects = [e for e in FORMS if e not in NOT_DRAWN]
    possible = {e: [s for s in sets if e not in RIGS[s].also] for e in effects}
    used = dict.fromkeys(sets, 0)
    order: list[str] = []
    while len(out) < count:
        order = order or [str(e) for e in rng.permutation([e for e in effects if possible[e]])]
        effect = order.pop()
        options = sorted(possible[effect], key=lambda s: (used[s], rng.random()))
        second = (_second(effect, options[0], rng),) if len(out) >= count - pairs else ()
        out.append((options[0], (effect, *second)))
        used[options[0]] += 1
    return out


def _second(first: str, name: str, rng: np.random.Generator) -> str:
    """An effect of another stage that the set can have."""
    other = [e for e in drawn(name) if FORMS[e].stage != FORMS[first].stage]
    return str(rng.choice(other))


def drawn(name: str) -> list[str]:
    """Effects that are put into a set."""
    return [e for e in FORMS if e not in (*NOT_DRAWN, *RIGS[name].also)]


def main() -> int:
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("out", type=Path)
    p.add_argument("--cases", type=int, default=45)
    p.add_argument("--controls", type=int, default=9)
    p.add_argument("--pairs", type=int, default=0, help="cases with two effects (default: %(default)s)")
    p.add_argument("--seed", type=int, default=1)
    p.add_argument("--bent", action="store_true", help="simulators identified on the records with the effect")
    p.add_argument("--baseline", action="store_true", help="each case has the set's other records as its baseline")
    p.add_argument("--sets", nargs="*", default=list(RIGS), choices=list(RIGS))
    p.add_argument("--models", type=Path, help="folder of the identified simulators")
    a = p.parse_args()
    models = a.models or a.out.parent / "spike_models"
    sets = {name: records_of(name) for name in a.sets}
    rng = np.random.default_rng(a.seed)
    labels: dict[str, Any] = {}
    for number, (name, effects) in enumerate(slots(a.cases, a.controls, a.pairs, a.sets, rng)):
        begun = time.monotonic()
        own = np.random.default_rng([a.seed, number])
        made = None
        # What a draw cannot do on one set is drawn again: another law, another effect that the set can have.
        for again in range(_EXACT_AGAIN):
            law = LAWS[(number + again) % len(LAWS)]
            model = nominal(models, name, law, sets[name])
            part = "all" if a.bent else str(own.choice(["all", "all", "part", "baseline"]))
            part = "baseline" if a.baseline else part
            made = make(name, effects, model, sets[name], part, own, a.bent)
            if made is not None:
                break
            if again % 3 == 2:
                first = str(own.choice(drawn(name)))
                effects = (first, _second(first, name, own)) if len(effects) > 1 else (first,)
        if made is None:
            print(f"{number}: {name}: nothing can be put in", file=sys.stderr)
            continue
        case = f"spike_{a.seed}_{number:03d}_{name}"
        write(made, case, a.out)
        labels[case] = made.label
        write_atomic(a.out / "labels.json", json.dumps(labels, indent=1) + "\n")
        one = made.label
        print(
            f"{case}: {one['label']} {made.model.law} {len(made.records)}+{len(made.baseline)} records"
            f" gap {one['gap']:.3f} base {one['base']:.3f} {time.monotonic() - begun:.1f} s",
            flush=True,
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
