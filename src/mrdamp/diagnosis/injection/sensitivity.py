"""Sensitivity of a diagnosis of a rig's own records: every effect is inserted in several sizes and diagnosed.

The records keep the rig's own law, noise and tests, so that the result holds for this rig and these tests.
Results are stored one by one; an interrupted run is resumed.
"""

from __future__ import annotations

import hashlib
import json
import time
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mrdamp import __version__
from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.injection.forms import FORMS
from mrdamp.diagnosis.injection.inject import (
    Injection,
    NotPut,
    change_of,
    refusal,
    strength_of,
    widened,
)
from mrdamp.errors import InputError
from mrdamp.files import decode, read_bytes, write_atomic
from mrdamp.model.damper import damper_effects
from mrdamp.parallel import mapped

#: Effects of a damper that can be selected.
EFFECTS = (*FORMS, *(effect for effect in damper_effects() if effect not in FORMS))
#: RMS change of the simulator's error over the RMS of the force: from the repeatability of a good rig to an
#: obvious fault.
SIZES = (0.02, 0.05, 0.15, 0.4)
#: Name of the trial without an inserted effect.
AS_THEY_ARE = "as they are"
Tell = Callable[[str, float], None]


class Trial(NamedTuple):
    """One effect in one size (see `SIZES`); `AS_THEY_ARE` with size 0: the records without an effect."""

    effect: str
    size: float

    @property
    def name(self) -> str:
        """Name of its file."""
        return f"{self.effect.replace(' ', '_')}_{self.size:g}"


@dataclass(frozen=True)
class Answer:
    """The diagnosis of a trial.

    parameters: of the inserted effect; empty if no strength of it reaches the size (`reached`). named:
    effects in the answer. error: one line if the diagnosis failed.
    """

    effect: str
    size: float
    reached: bool = True
    parameters: Mapping[str, float] | None = None
    verdict: str = ""
    named: tuple[str, ...] = ()
    tied: tuple[tuple[str, ...], ...] = ()
    probabilities: Mapping[str, float] | None = None
    sentence: str = ""
    nominal_gap: float | None = None
    corrected_gap: float | None = None
    seconds: float = 0.0
    error: str = ""


@dataclass(frozen=True)
class Study:
    """Trials on a case. never: effects that its records cannot show, with the reason. untried: effects that
    they might show but that cannot be inserted exactly."""

    case: Case
    trials: tuple[Trial, ...]
    never: Mapping[str, str]
    untried: Mapping[str, str]
    seed: int = 0

    @classmethod
    def of(
        cls, case: Case, effects: Sequence[str] = (), sizes: Sequence[float] = SIZES, seed: int = 0
    ) -> Study:
        """effects: names; empty: all. Raises InputError: a frame, an unknown effect, an invalid size."""
        where = case.folder / "case.json"
        if case.model.rig != "damper":
            raise InputError(
                f"{where}: rig {case.model.rig}: effects are put into a damper's records only (rig damper)"
            )
        if not all("force_N" in r.channels for r in case.records):
            raise InputError(f"{where}: channels: force_N is needed, the force that the effects are put into")
        for effect in effects:
            if effect not in EFFECTS:
                raise InputError(f"--effects: '{effect}' is unknown; allowed: {', '.join(EFFECTS)}")
        for size in sizes:
            if not 0 < size <= 1:
                raise InputError(
                    f"--sizes: {size:g}; allowed: more than 0 and at most 1 (a share of the RMS force)"
                )
        if not sizes:
            raise InputError("--sizes: at least one is needed")
        selected = [e for e in EFFECTS if not effects or e in effects]
        reasons = {e: refusal(e, case.model, case.records) for e in selected}
        possible = [e for e in selected if not reasons[e]]
        trials = [Trial(e, s) for s in sorted(set(sizes), reverse=True) for e in possible]
        never, untried = (
            {e: r for e, r in reasons.items() if r and isinstance(r, NotPut) is untried} for untried in (False, True)
        )
        return cls(case, (Trial(AS_THEY_ARE, 0.0), *trials), never, untried, seed)

    @property
    def key(self) -> str:
        """Hash of the case, the seed and the version; results with another key are ignored."""
        case = self.case
        h = hashlib.sha256(f"{self.seed} {__version__} {json.dumps(case.model.to_dict(), sort_keys=True)}".encode())
        for record in (*case.records, *(r for r, _ in case.repeats), *case.baseline):
            for name, values in record.channels.items():
                h.update(name.encode())
                h.update(np.ascontiguousarray(values).tobytes())
        return h.hexdigest()[:16]


def injected(study: Study, trial: Trial) -> tuple[Case, dict[str, float]] | None:
    """The case with an effect of that size in all of its records, and its parameters; None if the effect
    cannot have the size."""
    case = study.case
    if trial.effect == AS_THEY_ARE:
        return case, {}
    # The same side and shape in every size.
    rng = np.random.default_rng([study.seed, zlib.crc32(trial.effect.encode())])
    injection = Injection.draw(trial.effect, case.model, case.records, rng)
    change = change_of(case.model, case.records)
    strength = strength_of(lambda s: change(injection, s), trial.size)
    if strength is None:
        return None
    records = tuple(injection.put(r, strength) for r in case.records)
    repeats = tuple((injection.put(r, strength), of) for r, of in case.repeats)
    model = widened(case.model, (*records, *(r for r, _ in repeats)))
    return replace(case, model=model, records=records, repeats=repeats), injection.parameters(strength)


def answer(study: Study, trial: Trial, folder: Path) -> Answer:
    """Inserts the effect, diagnoses, and stores the answer in the folder."""
    from mrdamp.diagnosis import run

    begun = time.monotonic()
    made = injected(study, trial)
    found = Answer(trial.effect, trial.size, made is not None)
    if made is not None:
        case, parameters = made
        found = replace(found, parameters=parameters)
        try:
            d = run.diagnose(case, jobs=1)
            found = replace(
                found,
                verdict=d.verdict,
                named=tuple(e.effect for e in d.effects),
                tied=d.indistinguishable,
                probabilities=dict(d.probabilities),
                sentence=d.sentence,
                nominal_gap=d.gap.nominal,
                corrected_gap=d.gap.corrected,
            )
        except (InputError, ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
            found = replace(found, error=" ".join(str(error).split())[:300] or type(error).__name__)
    found = replace(found, seconds=time.monotonic() - begun)
    if not found.error:  # failed trials are repeated
        text = json.dumps({"key": study.key, **asdict(found)}, indent=1)
        write_atomic(folder / f"{trial.name}.json", text + "\n")
    return found


def kept(study: Study, trial: Trial, folder: Path) -> Answer | None:
    """Stored answer of a trial from an earlier run; None if there is none or it belongs to another case."""
    path = folder / f"{trial.name}.json"
    try:
        data = json.loads(decode(str(path), read_bytes(path)))
        if data.pop("key") != study.key:
            return None
        data["named"] = tuple(data["named"])
        data["tied"] = tuple(tuple(t) for t in data["tied"])
        return Answer(**data)
    except (InputError, ValueError, KeyError, TypeError, AttributeError):
        return None  # no file, or one damaged by an abort


def run_study(
    study: Study, out: Path, jobs: int = 1, tell: Tell = lambda what, share: None
) -> Iterator[list[Answer]]:
    """Yields all answers so far, after each new one and at least once. out: folder, with the answers in
    `runs`."""
    folder = out / "runs"
    folder.mkdir(parents=True, exist_ok=True)
    answers = [a for t in study.trials if (a := kept(study, t, folder)) is not None]
    begun, new = time.monotonic(), 0
    tell(f"{len(answers)} diagnosed", len(answers) / len(study.trials))
    yield answers
    while left := due(study, answers):
        # The records as they are go along with the largest size.
        batch = [t for t in left if t.size in (0.0, max(t.size for t in left))]
        for found in mapped(answer, [(study, t, folder) for t in batch], jobs):
            answers, new = [*answers, found], new + 1
            more = len(due(study, answers))
            rest = lasting((time.monotonic() - begun) / new * more)
            tell(f"{len(answers)} diagnosed, at most {more} more, {rest}", len(answers) / (len(answers) + more))
            yield answers


def due(study: Study, answers: Sequence[Answer]) -> list[Trial]:
    """Trials without an answer; an effect that was not found in a size is not tried in smaller ones."""
    missed: dict[str, float] = {}
    for a in answers:
        if a.reached and not a.error and not any(a.effect in named for named in (a.named, *a.tied)):
            missed[a.effect] = max(a.size, missed.get(a.effect, 0.0))
    seen = {(a.effect, a.size) for a in answers}
    return [t for t in study.trials if t not in seen and t.size >= missed.get(t.effect, 0.0)]


def lasting(seconds: float) -> str:
    """A duration: `40 s`, `12 min`, `2 h 5 min`."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"
