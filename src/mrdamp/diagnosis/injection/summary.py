"""Summary of a sensitivity study: results by effect, confusions, and sentences."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mrdamp.diagnosis.injection.forms import FORMS
from mrdamp.diagnosis.injection.sensitivity import AS_THEY_ARE, Answer, Study, due

#: Largest tie that counts as informative (as in the scoring of cases).
_TIE = 3


@dataclass(frozen=True)
class Finding:
    """Result for one effect: outcome by size, the least size from which on it is named, and the effects named
    instead."""

    effect: str
    stage: str
    outcomes: Mapping[float, str]
    probability: Mapping[float, float]
    named_from: float | None
    parameters: Mapping[str, float]
    taken_for: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        return {
            "effect": self.effect,
            "stage": self.stage,
            "named_from": self.named_from,
            "parameters": dict(self.parameters),
            "outcomes": {f"{s:g}": o for s, o in self.outcomes.items()},
            "probability": {f"{s:g}": p for s, p in self.probability.items()},
            "taken_for": list(self.taken_for),
        }


def own_effects(answers: Sequence[Answer]) -> tuple[str, ...] | None:
    """Effects named for the unchanged records; None before that trial."""
    for a in answers:
        if a.effect == AS_THEY_ARE and not a.error:
            return a.named
    return None


def outcome(a: Answer, own: Sequence[str]) -> str:
    """Of a trial, best first: `named`; `unsure`, named in a tie of two or three; `already`, the unchanged records give
    the same answer, so that nothing is shown; `unknown`; `parameters`; `none`; `wrong`, an effect that was not inserted
    and that the unchanged records do not show; `failed`; `out of reach`."""
    if a.error:
        return "failed"
    if not a.reached:
        return "out of reach"
    if a.effect in a.named:
        return "already" if a.effect in own else "named"
    new = [e for e in a.named if e not in own]
    if any(a.effect in t and len(t) <= _TIE and set(a.named) & set(t) for t in a.tied):
        return "unsure"
    if new:
        return "wrong"
    return "none" if a.verdict == "effect" else a.verdict  # the rig's own effects and no new one


def findings(answers: Sequence[Answer]) -> list[Finding]:
    """Findings by effect, in the order of the chain."""
    own = own_effects(answers) or ()
    out = []
    for effect in FORMS:
        mine = sorted((a for a in answers if a.effect == effect), key=lambda a: a.size)
        if not mine:
            continue
        outcomes = {a.size: outcome(a, own) for a in mine}
        reached = [a for a in mine if outcomes[a.size] != "out of reach"]
        missed = max((a.size for a in reached if outcomes[a.size] != "named"), default=0.0)
        first = next((a for a in reached if a.size > missed), None)
        taken = Counter(e for a in mine for e in taken_for(a, own))
        out.append(
            Finding(
                effect,
                FORMS[effect].stage,
                outcomes,
                {a.size: float((a.probabilities or {}).get(effect, 0.0)) for a in mine},
                first.size if first else None,
                dict(first.parameters or {}) if first else {},
                tuple(e for e, _ in taken.most_common()),
            )
        )
    return out


def taken_for(a: Answer, own: Sequence[str]) -> tuple[str, ...]:
    """Effects named instead of, or in addition to, the inserted one; empty if it was named alone."""
    if outcome(a, own) in ("failed", "out of reach"):
        return ()
    new = tuple(e for e in a.named if e not in own and e != a.effect)
    return new or (() if a.effect in a.named else (outcome(a, own),))


def confusion(answers: Sequence[Answer]) -> tuple[list[str], list[str], list[list[int]]]:
    """Rows (inserted), columns (named; the rows first, then the other answers), and counts over the sizes."""
    own = own_effects(answers) or ()
    rows = [f.effect for f in findings(answers)]
    counts: Counter[tuple[str, str]] = Counter()
    for a in answers:
        if a.effect in rows:
            hit = (a.effect,) if a.effect in a.named else ()
            for said in (*hit, *taken_for(a, own)):
                counts[a.effect, said] += 1
    others = sorted({said for _, said in counts} - set(rows))
    columns = [*rows, *others]
    return rows, columns, [[counts[r, c] for c in columns] for r in rows]


def sentence(study: Study, answers: Sequence[Answer]) -> str:
    """Summary of the study in one or two sentences."""
    found = findings(answers)
    named = sorted((f for f in found if f.named_from is not None), key=lambda f: f.named_from or 0.0)
    parts = [f"{f.effect} from {percent(f.named_from or 0.0)}" for f in named]
    text = (
        f"Named on these records: {', '.join(parts)} of the force."
        if parts
        else "Nothing is named in any size."
    )
    missed = [f.effect for f in found if f.named_from is None]
    if missed:
        text += f" Not reliably: {', '.join(missed)}."
    if study.never:
        text += f" These records cannot show {', '.join(study.never)}."
    if study.untried:
        text += f" Not tried: {', '.join(study.untried)}."
    return text


def table(study: Study, answers: Sequence[Answer]) -> str:
    """Table for a terminal."""
    found = findings(answers)
    sizes = sorted({s for f in found for s in f.outcomes})
    head = "".join(f"{percent(s):>13s}" for s in sizes)
    lines = [f"{'effect':18s}{head}   taken for"]
    for f in found:
        cells = "".join(f"{f.outcomes.get(s, ''):>13s}" for s in sizes)
        lines.append(f"{f.effect:18s}{cells}   {', '.join(f.taken_for)}".rstrip())
    lines += [f"{effect:18s}   never: {why}" for effect, why in study.never.items()]
    lines += [f"{effect:18s}   not tried: {why}" for effect, why in study.untried.items()]
    own = own_effects(answers)
    if own:
        lines.append(f"the records as they are: {', '.join(own)}")
    return "\n".join(lines)


def to_dict(study: Study, answers: Sequence[Answer]) -> dict[str, Any]:
    """Content of sensitivity.json."""
    rows, columns, counts = confusion(answers)
    return {
        "case": study.case.name,
        "format": 1,
        "seed": study.seed,
        "complete": not due(study, answers),
        "sentence": sentence(study, answers),
        "as_they_are": list(own_effects(answers) or ()),
        "effects": [f.to_dict() for f in findings(answers)],
        "never": dict(study.never),
        "not_tried": dict(study.untried),
        "confusion": {"rows": rows, "columns": columns, "counts": counts},
        "trials": [
            {
                "effect": a.effect,
                "size": a.size,
                "parameters": dict(a.parameters or {}),
                "verdict": a.verdict,
                "named": list(a.named),
                "tied": [list(t) for t in a.tied],
                "gap": {"nominal": a.nominal_gap, "corrected": a.corrected_gap},
                "sentence": a.sentence,
                "seconds": round(a.seconds, 1),
                "error": a.error,
            }
            for a in answers
        ],
    }


def percent(share: float) -> str:
    """0.05 as `5 %`."""
    return f"{100 * share:.3g} %"
