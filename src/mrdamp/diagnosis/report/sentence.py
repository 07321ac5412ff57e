"""Summary sentence and table of a diagnosis."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from mrdamp.diagnosis.constants import TIE_PROBABLE
from mrdamp.diagnosis.fits.final import AGREEMENT
from mrdamp.diagnosis.hypotheses.nominal_effects import setting_name
from mrdamp.diagnosis.hypotheses.outside import PLAIN
from mrdamp.diagnosis.report.changes import unit_of
from mrdamp.diagnosis.report.result import Diagnosis, Gap, Named
from mrdamp.model.attributes import effects

#: Of a frame's structure; a damper's effects have theirs in their row of the C table.
_STRUCTURE = {
    "storey_stiffness": "a storey's stiffness is wrong",
    "storey_damping": "a storey's damping is wrong",
    "joint_friction": "friction in a storey's joints",
    "floor_mass": "a floor's mass is wrong",
}


#: The same for a floor's accelerometer in a frame.
_PLAIN_FLOOR = {
    "sensor_gain": "the sensitivity of that floor's accelerometer is wrong",
    "sensor_offset": "that floor's accelerometer has a bias",
    "sensor_leakage": "the charge of that floor's accelerometer leaks away",
    "sensor_lag": "that floor's accelerometer lags: a low bandwidth or a delay",
}


def in_words(e: Named) -> str:
    """What an effect does."""
    if e.effect == "driver_lag" and "rate" in e.parameters:
        return f"the coil current changes by no more than {e.parameters['rate']:.3g} a second, a largest rate"
    if e.place is None:
        return effects()[e.effect].words
    return (_PLAIN_FLOOR if e.stage == "sensor" else _STRUCTURE)[e.effect]


def percent(x: float) -> str:
    return f"{100 * x:.1f} %"


def sentence(d: Diagnosis) -> str:
    """The answer in a few sentences; with a law that was identified again, if there is one."""
    if d.other_law is not None:
        other = d.other_law
        then = "it is handed over" if other["handed_over"] else "identify the simulator again"
        return (
            f"{_sentence(d)} Another law ({other['law']}), identified on these records, leaves {percent(other['gap'])}"
            f" without {' and '.join(other['without'])}, which leaves {percent(other['gap_with'])} in left-out records:"
            f" {then}."
        )
    some, of = d.covered
    said = _sentence(d)
    if some < of and d.beyond_baseline is None:
        said += f" This is said of {some} of {of} records; the others leave the regimes of the baseline."
    if d.baseline_law is None:
        return said
    again = d.baseline_law
    return (
        f"{said} The law was identified again on the baseline ({again['law']}); without a cause it leaves"
        f" {percent(again['gap'])}."
    )


def _sentence(d: Diagnosis) -> str:
    """Result in a few sentences: the cause, the reduction of the gap, the remainder."""
    g = d.gap
    shrink = f"the gap goes from {percent(g.nominal)} to {_corrected(g)}"
    noise = f"noise {percent(g.noise_floor)}"
    likely = f"probability {d.probabilities.get(d.verdict, 0.0):.2f}"
    if d.verdict == "none":
        if g.baseline is not None:
            return (
                f"No change since the baseline shows ({likely}): the simulator's gap is {percent(g.nominal)} on these"
                f" records and {percent(g.baseline)} on the baseline's.{_hidden(d)}"
            )
        agreed = f"its gap is {percent(g.nominal)}, the noise of the records {percent(g.noise_floor)}"
        return f"The simulator agrees with the rig ({likely}): {agreed}.{_hidden(d)}"
    if d.verdict == "parameters":
        return (
            f"The parameters of the simulator are wrong, its form is right ({likely}). Recalibrated, {shrink};"
            f" {noise}.{_rest(d)}"
        )
    if d.verdict == "unknown":
        return _unknown(d)
    parts = []
    for e in d.effects:
        place = f" {e.place}" if e.place is not None else ""
        parts.append(f"{e.effect}{place} ({in_words(e)}; probability {e.probability:.2f})")
    them, one = ("it", "cause") if len(parts) == 1 else ("them", "causes")
    # What is left over shows that the answer is not complete.
    said = f"The gap is due to {' and '.join(parts)}."
    if d.question == "changed":
        said = f"What has changed since the baseline: {' and '.join(parts)}."
    elif d.question == "missed":
        said = f"What the simulator misses on the records that it was identified on: {' and '.join(parts)}."
    elif d.remainder is not None:
        said = f"The most probable {one} of the gap: {' and '.join(parts)}."
    named = {e.cause for e in d.effects}
    others = sorted({name for tie in d.indistinguishable for name in tie} - named)
    best = max(e.probability for e in d.effects)
    for close, text in ((True, f"The records do not distinguish {them} from"), (False, f"Nearly the same as {them}:")):
        rivals = [(name, d.probabilities.get(name, 0.0)) for name in others]
        rivals = [(name, p) for name, p in rivals if (p >= TIE_PROBABLE * best) == close]
        if rivals:
            said += f" {text} {', '.join(f'{name} (probability {p:.2f})' for name, p in rivals)}."
    last = d.waterfall[-1].name.removeprefix("+ ").split(" + ") if d.waterfall else []
    unnamed = " and ".join(cause for cause in last if cause not in named)
    more = f" and with {unnamed}, which is not established," if unnamed else ""
    return f"{said} With {them}{more} in the simulator, {shrink}; {noise}.{_rest(d)}"


def _corrected(g: Gap) -> str:
    """The gap of the simulator that is handed over, and that on records left out where it is another figure."""
    said = percent(g.corrected)
    if percent(g.left_out) != said:
        said += f", {percent(g.left_out)} on records left out of the fit"
        said += " with the noise of the motion smoothed away" * (g.left_out < g.corrected - AGREEMENT)
    return said


def _hidden(d: Diagnosis) -> str:
    """What an answer without a cause does not exclude."""
    names = ", ".join(str(row["effect"]) for row in d.unseen)
    hidden = f" These records hardly show {names}." if names else ""
    near = {c: p for c, p in d.probabilities.items() if c not in ("none", "unknown") and p >= TIE_PROBABLE}
    said = ", ".join(f"{cause} (probability {p:.2f})" for cause, p in near.items())
    return f" Not excluded: {said}.{hidden}" if near else hidden


def _rest(d: Diagnosis) -> str:
    """The remaining error of the corrected simulator."""
    if d.remainder is None:
        return ""
    left = percent(d.remainder.gap)
    if d.remainder.of == "law":
        leaves = "" if d.gap.ceiling is None else f", which leaves {percent(d.gap.ceiling)}"
        return f" The remaining gap of {left} is predicted in part by a regression on the other records{leaves}."
    if d.remainder.of == "outside" and d.outside is not None:
        return f" The remaining gap of {left} is most similar to {d.outside['what']}."
    return f" The remaining gap of {left} is not predicted by a regression on the other records."


def _unknown(d: Diagnosis) -> str:
    g = d.gap
    if d.outside is not None:
        return (
            f"The gap of {percent(g.nominal)} is most similar to {d.outside['what']}, which is outside the catalogue:"
            f" fitted to these records it leaves {percent(d.outside['gap'])}, the best effect of the catalogue"
            f" {percent(d.outside['nearest_gap'])}. A cause outside the catalogue has probability"
            f" {d.probabilities.get('unknown', 0.0):.2f}."
        )
    stage, *others = sorted(d.where.stages, key=lambda s: -d.where.stages[s])
    next_one = max((d.where.stages[s] for s in others), default=0.0)
    leads = d.question != "missed" and d.where.stages[stage] > 1.2 * next_one
    apart = next((row for row in d.compared if row["unexplained"]), None)
    alone = g.nominal if d.baseline_law is None else float(d.baseline_law["gap"])
    unchanged = "unchanged" if d.baseline_law is None else "with the law of the baseline and no effect"
    if d.beyond_baseline is not None:
        return (
            f"No change is named for the gap of {percent(g.nominal)}: the records leave the regimes of the baseline"
            f" ({d.beyond_baseline}), so that it may have been there before. The simulator is handed over {unchanged}."
        )
    same = abs(g.corrected - alone) <= 1e-3 * alone
    if apart is not None and same:
        one, other = apart["channels"]
        places = {name: share for name, share in d.where.places.items() if name != "damper"}
        most = f", the most at {max(places, key=lambda name: places[name])}" if places else ""
        explained = (
            f"and no effect explains it{most}"
            if not apart["effect"]
            else f"which {PLAIN[apart['effect']]} explains to {percent(apart['left'])}"
        )
        return (
            f"No cause in the catalogue is established for the gap of {percent(g.nominal)}: whatever the damper's law,"
            f" {one} and {other} differ by {percent(apart['difference'])} (noise {percent(apart['noise'])}),"
            f" {explained}. The simulator is handed over {unchanged}."
        )
    if same:
        handed = (
            f"no correction holds on records left out of its fit, so the simulator is handed over {unchanged}"
        )
    else:
        by = d.waterfall[-1].name.removeprefix("+ ") if d.waterfall else ""
        handed = f"the best correction{f' ({by})' if by else ''} leaves {_corrected(g)}"
    tried = {cause for c in d.candidates for cause in c.causes} - {"unknown", "parameters"}
    first = next((f"{cause} (probability {p:.2f})" for cause, p in d.probabilities.items() if cause in tried), "")
    return (
        f"No cause in the catalogue is established for the gap of {percent(g.nominal)}"
        f"{f'; the most probable one is {first}' if first else ''}."
        f"{f' The most probable stage is {stage}.' if leads else ''}"
        f" {handed[0].upper()}{handed[1:]}.{_rest(d)}"
    )


def number(name: str, value: float, interval: tuple[float, float] | None, unit: str = "") -> str:
    """A parameter with its unit and interval."""
    if interval is None:
        return f"{name} = {value:.4g} {unit}".rstrip()
    said, low, high = spelled(value, interval)
    return f"{f'{name} = {said} {unit}'.rstrip()} ({low} to {high})"


def spelled(value: float, interval: tuple[float, float], least: int = 4) -> list[str]:
    """A value and the ends of its interval: `least` digits, or as many as tell the ends of a narrow one apart."""
    wide, size = interval[1] - interval[0], max(map(abs, interval))
    digits = min(max(least, math.ceil(math.log10(size / wide)) + 1), 8) if wide > 0 else least
    return [f"{x:.{digits}g}" for x in (value, *interval)]


def settings_of(row: Mapping[str, Any]) -> str:
    """Parameters of the effect that explains why two channels differ."""
    return ", ".join(number(name, value, None, unit_of(name)) for name, value in row["parameters"].items())


def share(value: float, interval: tuple[float, float] | None) -> str:
    """A share with its interval, in per cent."""
    text = f"{round(100 * value)} %"
    return text if interval is None else f"{text} ({round(100 * interval[0])} to {round(100 * interval[1])})"


def table(d: Diagnosis) -> str:
    """Waterfall, effects, candidates and ties as text."""
    lines = ["  gap (RMS error over RMS): nominal on all records, else on records left out of the fit"]
    for s in d.waterfall:
        low, high = (percent(end) for end in s.interval)
        lines.append(f"    {s.name:40s} {percent(s.gap):>8s}   {low} to {high}")
    lines.append(f"    {'noise floor':40s} {percent(d.gap.noise_floor):>8s}")
    if d.effects:
        lines.append("  effects")
        for e in d.effects:
            numbers = ", ".join(
                number(k, v, e.intervals.get(k), unit_of(setting_name(e.effect, k, e.place)))
                for k, v in e.parameters.items()
            )
            lines.append(f"    {e.cause:22s} {e.stage:10s} probability {e.probability:.2f}   {numbers}")
    lines.append("  candidates: probability of just these causes; gap of the search, the answer's of whole records")
    for c in d.candidates:
        name = " + ".join(c.causes) or "none"
        lines.append(f"    {name:40s} probability {c.probability:.2f}   gap {percent(c.heldout_gap)}")
    stages = sorted(d.where.stages.items(), key=lambda item: -item[1])
    shown = [f"{name} {share(v, d.where.intervals.get(name))}" for name, v in stages if v > 0.005]
    lines += ["  stages: " + ", ".join(shown)] if d.verdict != "none" else []
    found = [
        f"{name} {share(v, d.where.place_intervals.get(name))}"
        for name, v in d.where.places.items()
        if v > 0.005
    ]
    lines += ["  places: " + ", ".join(found)] if found else []
    for m in d.where.measured if d.verdict != "none" else ():
        text = f"  measured, {m.between}: {share(m.share, m.interval)} of the nominal gap"
        lines.append(text + (f" ({m.part_by} would part it)" if m.part_by else ""))
    if d.signatures:
        lines.append("  loops: measured, nominal, corrected simulator (medians over the records)")
        lines += [
            f"    {s.name:40s} {s.measured:9.3g} {s.nominal:9.3g} {s.corrected:9.3g} {s.unit}" for s in d.signatures
        ]
    for row in d.compared:
        one, other = row["channels"]
        cause = f", which is {row['effect']} ({settings_of(row)}): {percent(row['left'])} left" if row["effect"] else ""
        noise = percent(row["noise"])
        lines.append(f"  {one} and {other} differ by {percent(row['difference'])}{cause} (noise {noise})")
    if d.outside is not None:
        numbers = ", ".join(number(name, value, None) for name, value in d.outside["parameters"].items())
        lines.append(f"  outside the catalogue: {d.outside['cause']} {d.outside['form']}   {numbers}")
    for tie in d.indistinguishable:
        lines.append(f"  not distinguishable with these records: {', '.join(tie)}")
    if d.stepped:
        apart = max(abs(row["mujoco_gap"] - row["offline_gap"]) for row in d.stepped)
        where = ", ".join(str(row["record"]) for row in d.stepped)
        lines.append(
            f"  MJCF stepped in MuJoCo on {where}: within {100 * apart:.2f} % of the RMS of the offline gap"
        )
    lines.append(f"  next test: {d.next_experiment.get('signal', '')} ({d.next_experiment.get('why', '')})")
    lines += [f"  note: {n}" for n in d.notes]
    return "\n".join(lines)
