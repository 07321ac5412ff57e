"""Page of a diagnosis: a summary sentence, then figures and tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from mrdamp import __version__
from mrdamp.diagnosis.hypotheses.nominal_effects import setting_name
from mrdamp.diagnosis.problem.residuals import squared_gap
from mrdamp.diagnosis.report.changes import changes, unit_of
from mrdamp.diagnosis.report.result import LAW_AGAIN, Diagnosis, Named
from mrdamp.diagnosis.report.sentence import settings_of, share, spelled
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.pictures import diagnosis as pictures
from mrdamp.records import Record
from mrdamp.records.sampling import derivative
from mrdamp.report import Page
from mrdamp.report.page import Cell
from mrdamp.simulation.predict import free_run

_SHOWN = 2  # records with residuals


def page(found: Diagnosis, nominal: Model, records: Sequence[Record]) -> Page:
    """The whole page. nominal: the nominal simulator; records: all of the case.

    Actionable results come first: the next step, the stage, the reduction of the gap, the remainder.
    """
    out = Page(f"Diagnosis of {found.case}", found.sentence, f"mrdamp {__version__}, `mrdamp diagnose`")
    # Of each record the force, or the floor acceleration with the largest gap.
    shown = [_view(nominal, found.corrected, r) for r in records]
    order = sorted(range(len(shown)), key=lambda k: -_nrms(shown[k].nominal, shown[k].measured, shown[k].time))
    worst = [shown[k] for k in order[:_SHOWN]]
    _next(out, found)
    _answer(out, found)
    _changes(out, found, nominal)
    _stages(out, found)
    _shrink(out, found)
    _remains(out, found, worst)
    _loops(out, found, worst[0])
    for effect in found.effects:
        _by_regime(out, effect)
    _where(out, found, shown)
    _records(out, found, shown)
    _handed_over(out, found)
    _uncertainty(out, found)
    return out


def chain_picture(found: Diagnosis) -> Figure:
    """The chain from command to sensor, with each stage's share of the correction, or of the gap."""
    of = "correction" if found.verdict == "effect" else "gap"
    return pictures.chain(found.where.stages, found.where.intervals, {e.stage for e in found.effects}, of)


def _stages(out: Page, found: Diagnosis) -> None:
    if found.verdict == "none":
        return
    stages, named = found.where.stages, {e.stage for e in found.effects}
    of = "correction" if found.verdict == "effect" else "gap"
    out.figure(
        "Where in the chain",
        chain_picture(found),
        f"The chain from command to sensor, with each stage's share of the {of} and its 95 % interval"
        + (f"; green: {', '.join(s for s in stages if s in named)}." if named else ".")
        + (" What the corrected simulator still misses is in no stage." if named and found.remainder else ""),
        "Bars: " + ", ".join(f"{k} {100 * v:.0f} %" for k, v in stages.items()),
    )


def _next(out: Page, found: Diagnosis) -> None:
    """Recommended next steps."""
    steps = []
    if found.verdict in ("effect", "parameters"):
        steps.append(
            "Use `corrected.json`, or `mjcf/scene.xml` in MuJoCo, in place of the nominal simulator."
        )
    elif _unchanged(found):
        steps.append("Keep the simulator as it is.")
    elif found.verdict == "none":
        steps.append("Nothing has changed. `corrected.json` has the law that was identified again on the baseline.")
    elif found.verdict == "unknown":
        steps.append(
            "These records establish no cause. "
            + (
                "`corrected.json` is the given simulator."
                if found.gap.corrected == found.gap.nominal
                else "`corrected.json` predicts left-out records better, by numbers or an effect that need not be the"
                " rig's: try it on other records before use."
            )
        )
    if found.remainder is not None and found.remainder.of == "law":
        if found.rig == "damper":
            better = "Identify another law, or a NARX network, from these records"
        else:
            better = "Check the channels, the structure and the damper's law"
        steps.append(f"{better}: what remains follows in part from the same inputs.")
    for row in found.compared:
        if row["effect"]:
            steps.append(
                f"Check {row['effect']} on the rig: with {settings_of(row)} it explains why {row['channels'][1]} and"
                f" {row['channels'][0]} differ, whatever the law."
            )
        elif row["unexplained"]:
            one, other = row["channels"]
            steps.append(f"Look for the fault on the rig: {one} and {other} disagree, whatever the law.")
    why, signal = (str(found.next_experiment.get(key, "")) for key in ("why", "signal"))
    if signal and signal != "none":
        steps.append(f"Next test (`next_experiment.csv`): {signal}; {why}.")
    if steps:
        out.text("What to do next", steps)


def _answer(out: Page, found: Diagnosis) -> None:
    heading = "The cause" if found.effects else "Is there a cause?"
    if found.effects:
        rows = [
            (e.cause.replace("@", " at "), e.stage, f"{e.probability:.2f}", f"{100 * e.share:.0f} %")
            for e in found.effects
        ]
        columns = "effect", "stage", "probability", "share of the excess"
        note = (
            "Excess: the nominal gap's square less that of the noise. Share: what the fit takes off it by this cause,"
            " in the mean over the orders in which causes and changed parameters are switched on."
        )
        for law in (s for s in found.waterfall if s.name == LAW_AGAIN):
            note += f" The law of the baseline takes {100 * (1 - found.gap.share(law.gap)):.0f} % off it."
        out.table(heading, columns, rows, note)
        heading = ""
    likeliest = sorted(found.probabilities.items(), key=lambda item: -item[1])[:3]
    out.figure(
        heading,
        pictures.probabilities(found.probabilities, [e.cause for e in found.effects]),
        "Probability of each cause. `none`: no gap beyond the noise; `parameters`: only numbers are wrong; "
        "`unknown`: a cause outside the catalogue.",
        "Bars: " + ", ".join(f"{k} {v:.2f}" for k, v in likeliest),
    )
    if found.indistinguishable:
        ties = (", ".join(f"`{name}`" for name in tie) for tie in found.indistinguishable)
        out.text("", [f"Hard to tell apart with these records: {tie}." for tie in ties])


def _changes(out: Page, found: Diagnosis, nominal: Model) -> None:
    rows: list[Sequence[Cell]] = []
    for c in changes(nominal, found):
        said: Sequence[Cell] = (c.new, None, None)
        if c.interval is not None and c.new is not None:
            said = spelled(c.new, c.interval, 3)
        rows.append((c.name, c.unit, c.old, *said))
    law, other = nominal.law, found.corrected.law
    note = "What `corrected.json` has in place of the nominal simulator's numbers. A dash: not there."
    note += f" The law is {other} in place of {law}." if other != law else ""
    _table(out, "Old and new values", ("parameter", "unit", "nominal", "corrected", "95 % from", "to"), rows, note)


def _table(out: Page, heading: str, columns: Sequence[str], rows: Sequence[Sequence[Cell]], note: str = "") -> None:
    """A table, if it has rows."""
    if rows:
        out.table(heading, columns, rows, note)


def _unchanged(found: Diagnosis) -> bool:
    """Whether the corrected simulator is the nominal one, as nothing is wrong with it."""
    return found.verdict == "none" and found.baseline_law is None


def _by_regime(out: Page, effect: Named) -> None:
    """The first parameter of an effect by regime, and the gaps there with and without the effect."""
    if not effect.by_regime:
        return
    heading, name = f"Is {effect.effect} the same in every regime?", next(iter(effect.by_regime[0].parameters))
    unit = unit_of(setting_name(effect.effect, name, effect.place))
    label_of = f"{name} ({unit})" if unit else name
    rows, points = [], []
    for r in effect.by_regime:
        label, value, (low, high) = r.label(), r.parameters[name], r.intervals[name]
        if r.determined:
            points.append((label, value, (low, high)))
        said = "{} ({} to {})".format(*spelled(value, (low, high), 3)) if r.determined else "not determined"
        rows.append((label, len(r.records), 100 * r.gap_without, 100 * r.gap_with, said))
    if points:
        out.figure(
            heading,
            pictures.by_regime(
                f"{effect.effect} {label_of}", points, (effect.parameters[name], effect.intervals.get(name))
            ),
            f"`{name}` from the records of each regime alone, and from all records. A real cause has one value.",
            "Points: " + ", ".join(f"{label} {value:.3g}" for label, value, _ in points),
        )
    out.table(
        "" if points else heading,
        ("regime", "records", "gap without, %", "gap with, %", f"{label_of}, 95 %"),
        rows,
        f"Gaps of the corrected simulator without {effect.effect}, and with its parameters from all records.",
    )


def _where(out: Page, found: Diagnosis, shown: Sequence[pictures.ResidualData]) -> None:
    parts = () if found.verdict == "none" else found.where.measured
    if parts:
        out.table(
            "Details of where the gap lies",
            ("between measured channels", "stages", "share of the nominal gap", "channel that would separate them"),
            [
                (m.between, ", ".join(m.stages), share(m.share, m.interval), m.part_by)
                for m in parts
            ],
            "Measured signals put in at the chain's interfaces; a share below 0 undoes another part's error.",
        )
    out.figure(
        "" if parts else "Details of where the gap lies",
        pictures.gap_map(shown),
        "RMS residual over piston velocity and command, on one scale.",
        "Maps of the residual over velocity and command.",
    )
    rows = [
        (r.what, f"{100 * r.share_of_gap:.0f} %", f"{100 * r.share_of_samples:.0f} %")
        for r in found.where.regimes
    ]
    _table(out, "", ("regime", "share of the gap", "share of the samples"), rows)
    if any(found.where.places.values()):
        ends = found.where.place_intervals
        places = [(n, share(v, ends.get(n))) for n, v in found.where.places.items()]
        out.table("", ("place", "share of the gap"), places)


def _shrink(out: Page, found: Diagnosis) -> None:
    gap = found.gap
    steps = [(s.name, s.gap, s.interval) for s in found.waterfall]
    if steps and not _unchanged(found):
        out.figure(
            "How far it shrinks",
            pictures.waterfall(steps, gap.noise_floor, gap.ceiling),
            "RMS error over the RMS of the measurement: of the nominal simulator on all records, of the others on"
            " records left out of their fits.",
            "Bars: " + ", ".join(f"{name} {100 * value:.2g} %" for name, value, _ in steps),
        )


_REMAINDER = {
    "law": "is predicted in part by a regression on the recorded inputs, fitted to the other records",
    "unpredictable": "is not predicted by a regression on the recorded inputs, fitted to the other records",
    "outside": "comes from a cause outside the catalogue",
}


def _remains(out: Page, found: Diagnosis, worst: Sequence[pictures.ResidualData]) -> None:
    """Error of the corrected simulator, drawn for the records with the largest nominal gap."""
    rest = found.remainder
    if found.verdict == "none":
        said = f"{100 * found.gap.corrected:.2g} % of the RMS, "
        said += "the noise." if found.gap.baseline is None else "no more than on the baseline."
    elif rest is None:
        said = f"The corrected simulator meets the noise: {100 * found.gap.corrected:.2g} % of the RMS."
    else:
        said = (
            f"{100 * rest.gap:.2g} % of the RMS, {100 * rest.share:.0f} % of the nominal excess over the noise. "
            f"It {_REMAINDER[rest.of]}."
        )
        if rest.regimes:
            said += f" It is largest in: {', '.join(r.what for r in rest.regimes)}."
    out.text("What remains", [said])
    out.figure(
        "",
        pictures.residuals(worst),
        "Measured less simulated, on the records with the largest gap; a record's rows have one scale.",
        "Residuals over time of the nominal and the corrected simulator.",
    )


def _loops(out: Page, found: Diagnosis, worst: pictures.ResidualData) -> None:
    """What the loops show without a law, and the loops of the record with the largest nominal gap."""
    if worst.displacement is None:
        return
    out.figure(
        "What the loops show",
        pictures.loops(worst),
        "Measured and simulated force over displacement and velocity.",
        "Hysteresis loops: measured and simulated.",
    )
    rows = [
        (f"{s.name}, {s.unit}", *(f"{v:.4g}" for v in (s.measured, s.nominal, s.corrected)))
        for s in found.signatures
        if any((s.measured, s.nominal, s.corrected))
    ]
    columns = "from turn to turn", "measured", "nominal", "corrected"
    _table(out, "", columns, rows, "Medians over the records; no law is in them.")


def _records(out: Page, found: Diagnosis, shown: Sequence[pictures.ResidualData]) -> None:
    kinds = ("nominal",) if _unchanged(found) else ("nominal", "corrected")
    shares = found.where.records
    rows: list[tuple[str | float, ...]] = [
        (r.name, *(100 * _nrms(getattr(r, k), r.measured, r.time) for k in kinds), 100 * shares.get(r.name, 0.0))
        for r in shown
    ]
    some, of = found.covered
    fitted = "All records, to which the corrected simulator was fitted; its bar is of records left out."
    note = "" if _unchanged(found) else fitted
    if some < of:
        note = f"All records; {of - some} of them leave the regimes of the baseline, and nothing was fitted to these."
    columns = ("record", *(f"{kind}, %" for kind in kinds), "share of the nominal gap, %")
    drawn = "Of a damper's force_N." if found.rig == "damper" else "Of the floor acceleration with the largest gap."
    out.table("Gap by record", columns, rows, f"{drawn} {note}".strip())


def _handed_over(out: Page, found: Diagnosis) -> None:
    gaps = "offline_gap", "mujoco_gap", "difference"
    _table(
        out,
        "The corrected simulator in MuJoCo",
        ("record", "gap offline, %", "gap in MuJoCo, %", "between the two, %"),
        [(row["record"], *(f"{100 * row[k]:.2f}" for k in gaps)) for row in found.stepped],
        "The written MJCF, stepped on the record's inputs, and the simulation of the diagnosis.",
    )


def _uncertainty(out: Page, found: Diagnosis) -> None:
    tried = [
        (" + ".join(c.causes) or "none", f"{c.probability:.2f}", 100 * c.heldout_gap)
        for c in found.candidates
    ]
    note = "Gaps of left-out records of the search, excerpts of long ones; that of the answer of whole records."
    _table(out, "What else was tried", ("effects", "probability of just these", "left-out gap, %"), tried, note)
    hidden = [(u["effect"], u["setting"], u["could_hide"], unit_of(u["setting"])) for u in found.unseen]
    columns = "effect", "parameter", "may be as far as", "unit"
    _table(out, "What these records cannot show", columns, hidden)
    test = found.next_experiment
    if test:
        file = f" Its inputs are in `{test['file']}`." if "file" in test else ""
        out.text("The next experiment", [f"Why: {test['why']}.", f"Test: {test['signal']}.{file}"])
        parted = "simulator", "rival, fitted to it again", "distance"
        rows = [(row["one"], row["rival"], row["separation"]) for row in test.get("separates", ())]
        note = "RMS over the length of the test, in standard deviations of noise and model error."
        _table(out, "", parted, rows, note)
    if found.notes:
        out.text("Notes", found.notes)


def _nrms(simulated: Array, measured: Array, time: Array) -> float:
    return float(np.sqrt(squared_gap(simulated, measured, float(time[1] - time[0]))))


#: Channels of a frame that are drawn, the first kind that is measured, and their units.
_UNITS = {"acceleration_m_s2": "m/s²", "displacement_m": "m", "force_N": "N"}


def _view(nominal: Model, corrected: Model, record: Record) -> pictures.ResidualData:
    before, after = (free_run(m, record) for m in (nominal, corrected))
    shown = "force_N"
    more: dict[str, Any] = {}
    if nominal.structure is None:
        velocity, more = record.velocity(), {"displacement": record.displacement}
    else:
        channels = [[f for f in before if f.endswith(kind) and f in record.channels] for kind in _UNITS]
        measured = next(some for some in channels if some)
        shown = max(measured, key=lambda f: _nrms(before[f], record.channel(f), record.time))
        low, high = (
            after[f"floor{k}_displacement_m"] if k else np.zeros(record.n)
            for k in nominal.structure.damper_between
        )
        velocity = derivative(high - low, record.sample_time)
        place = f"floor {shown[5:].partition('_')[0]}" if shown.startswith("floor") else "damper"
        more = {"note": place, "unit": next(unit for kind, unit in _UNITS.items() if shown.endswith(kind))}
    return pictures.ResidualData(
        record.name,
        record.time,
        velocity,
        record.channel("command"),
        record.channel(shown),
        before[shown],
        after[shown],
        **more,
    )
