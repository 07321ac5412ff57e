"""The main job: records -> a fitted damper -> its errors -> MJCF -> a controlled frame -> one page."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mrdamp import pictures
from mrdamp.control import clipped_optimal, force_tracking, passive_off, passive_on
from mrdamp.control.base import Controller
from mrdamp.control.registry import balanced
from mrdamp.envs.frame_xml import Animation, Clip, animate
from mrdamp.errors import InputError
from mrdamp.files import csv_text, together, write_atomic
from mrdamp.identify import Fit, RecordError, identify, laws, simulate
from mrdamp.inverse import LawInverse
from mrdamp.library import library_path
from mrdamp.model import Model
from mrdamp.motions import TIME_SCALE, GroundMotion, embedded_motion, read_motion
from mrdamp.parallel import Progress, silent
from mrdamp.pictures import LoopData
from mrdamp.records import Record, RecordSet, embedded, read_records
from mrdamp.records.checks import check_explained
from mrdamp.report import Page
from mrdamp.simulation.criteria import Criteria, evaluate
from mrdamp.simulation.mjcf import write_mjcf
from mrdamp.simulation.stepping import FrameRun, run_frame
from mrdamp.structures import dyke1996

#: Effects fitted along with the law: what records of a real damper nearly always need.
EXTRAS = ("offset", "driver_lag", "saturation")
UNCONTROLLED = "no damper"
#: Drifts against accelerations in what force tracking regulates, and the price of its force (N^-2).
BALANCE, FORCE_PRICE = 100.0, 1e-6
#: Fewer and smaller pictures than the README's: drawing them takes 3 s without a graphics card.
CLIP = Clip(size=(240, 380), count=40, slower=8.0, rate=16.0)
#: 1/s; a command with more full swings than twice the frame's highest natural frequency (23 Hz) is a switching one.
SWITCHING = 46.0


class DemoResult(NamedTuple):
    """What the main job found: the fit, the frame's runs and criteria by controller, and where the page lies."""

    records: RecordSet
    fit: Fit
    runs: dict[str, FrameRun]
    criteria: dict[str, Criteria]
    page: Path


def demo(
    out: Path | str,
    data: Path | str | None = None,
    *,
    law: str = "modified_bouc_wen",
    motion: Path | str | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> DemoResult:
    """Runs the main job and writes index.html, model.json, tables and MJCF into the folder `out`.

    data: a folder of records (see `mrdamp.records.read_records`), None: the embedded set. motion: a ground motion's
    file, None: the embedded one. A fit that `out` holds of the same records is taken again. Raises InputError.
    """
    out = Path(out)
    records = embedded() if data is None else read_records(data)
    ground = embedded_motion() if motion is None else read_motion(motion)
    out.mkdir(parents=True, exist_ok=True)

    tell = progress or silent
    fit = _fit(out, records, law, seed, lambda what, share: tell(f"identify: {what}", 0.65 * share))
    check_explained(records.train, fit.train_nrmse)
    frame_model = replace(
        fit.model, rig="frame", structure=dyke1996(), name=f"{records.name} damper in the frame"
    )
    runs = _runs(fit.model, frame_model, ground.compressed(TIME_SCALE), tell)
    structure = dyke1996()
    criteria = {
        name: evaluate(structure, r.time, r.drift, r.acceleration, r.force, None, r.command, None)
        for name, r in runs.items()
    }
    best = min((c for c in criteria if c != UNCONTROLLED), key=lambda c: criteria[c].peak_drift.max())
    tell("drawing the frame", 0.9)
    drawn = _drawn(frame_model, runs, best)
    tell("page", 0.95)
    with together():
        fit.model.write(out / "model.json")
        write_mjcf(replace(fit.model, name=f"{records.name} damper"), out / "rig")
        write_mjcf(frame_model, out / "frame")
        page = _page(out, records, fit, ground, runs, criteria, best, drawn)
    tell("done", 1.0)
    return DemoResult(records, fit, runs, criteria, page)


def _drawn(model: Model, runs: dict[str, FrameRun], best: str) -> Animation | None:
    """The frame in motion; None on a machine that has no renderer."""
    try:
        names, command_max = (UNCONTROLLED, best), model.parameters.get("command_max", 1.0)
        return animate(model, [runs[name] for name in names], names, command_max, CLIP)
    except InputError:
        return None


def command_unit(records: RecordSet) -> str:
    """ "A", or "V" for records whose files say so in their names; the channel itself carries no unit."""
    return "V" if records.name == "nees" else "A"


def _runs(damper: Model, model: Model, ground: GroundMotion, tell: Progress) -> dict[str, FrameRun]:
    command_max = model.parameters.get("command_max", 1.0)
    assert model.structure is not None
    inverse = LawInverse(damper, commands=(0.0, command_max))
    controllers: dict[str, Controller | None] = {
        UNCONTROLLED: None,
        "passive-off": passive_off(),
        "passive-on": passive_on(command_max),
        "clipped-optimal": clipped_optimal(model.structure, command_max),
        "force-tracking": force_tracking(
            model.structure, inverse, regulate=balanced(model.structure, BALANCE), r=FORCE_PRICE
        ),
    }
    runs = {}
    for count, (name, controller) in enumerate(controllers.items()):
        tell(f"frame: {name}", 0.65 + 0.25 * count / len(controllers))
        runs[name] = run_frame(model, ground, controller)
    return runs


def _fit(out: Path, records: RecordSet, law: str, seed: int, progress: Progress) -> Fit:
    """The fit, or the one that an earlier run of the same job left in `out`."""
    digest = hashlib.sha256(f"{law} {seed} {EXTRAS}".encode())
    # Another version of the fit or of the chain is another job.
    for source in (*sorted(Path(laws.__file__).parent.glob("*.py")), library_path()):
        digest.update(source.read_bytes())
    for record in records.records:
        for name, values in record.channels.items():
            digest.update(name.encode())
            digest.update(values.tobytes())
    key, path, counts = digest.hexdigest(), out / "fit.json", ("starts", "evaluations")
    with suppress(OSError, ValueError, KeyError, TypeError):  # none, or one of another version: fit again
        kept = json.loads(path.read_text())
        if kept["key"] == key:
            train, held = (tuple(RecordError(**e) for e in kept[half]) for half in ("train", "held_out"))
            return Fit(Model.from_dict(kept["fit"], str(path)), train, held, *(kept[name] for name in counts))
    fit = identify(law, records.train, records.validation, extras=EXTRAS, seed=seed, progress=progress)
    kept = {"key": key, "fit": fit.model.to_dict()} | {name: getattr(fit, name) for name in counts}
    kept |= {half: [e._asdict() for e in getattr(fit, half)] for half in ("train", "held_out")}
    write_atomic(path, json.dumps(kept, indent=1) + "\n")
    return fit


def _loop(model: Model, record: Record, note: str, unit: str) -> LoopData:
    return LoopData(
        name=record.name,
        time=record.time,
        displacement=record.displacement,
        velocity=record.velocity(cutoff_hz=min(60.0, 0.2 / record.sample_time)),  # for the eye alone
        command=record.command,
        measured=record.channel("force_N"),
        simulated=simulate(model, record),
        command_unit=unit,
        note=note,
    )


def _shown(fit: Fit, records: RecordSet) -> list[Record]:
    """Held-out records for the pictures: the worst, the best and some between, by their error."""
    order = [e.record for e in sorted(fit.held_out, key=lambda e: -e.nrmse)]
    picks = [order[round(k)] for k in np.linspace(0, len(order) - 1, min(4, len(order)))]
    held = {record.name: record for record in records.validation}
    return [held[name] for name in dict.fromkeys(picks)]


def _page(
    out: Path,
    records: RecordSet,
    fit: Fit,
    ground: GroundMotion,
    runs: dict[str, FrameRun],
    criteria: dict[str, Criteria],
    best: str,
    drawn: Animation | None,
) -> Path:
    unit = command_unit(records)
    base = criteria[UNCONTROLLED]
    summary = (
        f"The free-run error of a {fit.model.law} damper, fitted to {len(records.train)} records of "
        f"`{records.name}`, is {fit.held_out_nrmse:.1%} of the force's standard deviation on "
        f"{len(records.validation)} held-out records. In the three-storey frame, {best} reduces the peak drift to "
        f"{criteria[best].peak_drift.max() / base.peak_drift.max():.0%} of the one without a damper."
    )
    page = Page(f"mrdamp: {records.name}", summary, footer="Made by `mrdamp demo`.")
    compare = [
        (
            name,
            1e3 * c.peak_drift.max(),
            c.peak_acceleration.max(),
            1e3 * c.rms_drift.max(),
            c.rms_acceleration.max(),
            c.peak_force if name != UNCONTROLLED else None,
            c.mean_command if name != UNCONTROLLED else None,
            c.dissipated_energy if name != UNCONTROLLED else None,
        )
        for name, c in criteria.items()
    ]
    columns = (
        "controller",
        "peak drift (mm)",
        "peak acceleration (m/s2)",
        "RMS drift (mm)",
        "RMS acceleration (m/s2)",
        "peak force (N)",
        f"mean command ({unit})",
        "energy in the damper (J)",
    )
    heading = "The frame under an earthquake"
    if drawn:
        page.animation(
            heading,
            drawn,
            f"Left without a damper, right with the fitted damper under {best}. Drifts {CLIP.exaggeration:g} times as "
            f"large as they are, time {CLIP.slower:g} times as slow. The damper's colour is its current, from none "
            "(blue) to the largest (orange).",
            f"Two three-storey frames that sway: one without a damper, one under {best}.",
        )
    page.table(
        "" if drawn else heading,
        columns,
        compare,
        f"Ground motion: {ground.name}, peak {ground.pga:.2f} m/s2, at {TIME_SCALE:g} times its speed. "
        "Frame of Dyke et al. (1996), damper under the first floor, stepped by MuJoCo.",
    )
    if remarks := accelerated(criteria):
        page.text("", remarks)
    _frame_pictures(page, ground, runs, criteria, unit)
    of = {e.record: e.nrmse for e in fit.held_out}
    loops = [
        _loop(fit.model, record, f"held out, error {of[record.name]:.3f}", unit)
        for record in _shown(fit, records)
    ]
    page.figure(
        "The damper, measured and simulated",
        pictures.loops(loops),
        "Held-out records: the largest error, the smallest and two between.",
        "Hysteresis loops of force over displacement and over velocity, measured and simulated.",
    )
    page.figure(
        "", pictures.histories(loops), "The same over time, with the residual below.", "Force over time."
    )
    rows = [
        (e.record, half, e.rmse, 100 * e.nrmse)
        for half, errors in (("fitted", fit.train), ("held out", fit.held_out))
        for e in errors
    ]
    page.figure(
        "Errors by record",
        pictures.error_bars(
            [r[0] for r in rows], [r[3] / 100 for r in rows], [r[1] == "held out" for r in rows]
        ),
        f"Free-run error. Pooled: {fit.train_nrmse:.3f} on the fitted records, {fit.held_out_nrmse:.3f} on the others.",
        "Bars of the free-run error of each record.",
    )
    page.table("", ("record", "", "RMS error (N)", "of the force's standard deviation (%)"), rows)
    attributes = fit.model.attributes
    page.table(
        "Parameters",
        ("attribute", "value"),
        [(k, f"{v:.6g}") for k, v in attributes.items()],
        "As in `model.json` and in the MJCF files beside this page.",
    )
    errors = [(r, half, f"{rmse:.6g}", f"{nrmse / 100:.6g}") for r, half, rmse, nrmse in rows]
    write_atomic(out / "errors.csv", csv_text(("record", "half", "rmse_N", "nrmse"), errors))
    write_atomic(out / "controllers.csv", csv_text(columns, compare))
    path = out / "index.html"
    page.write(path)
    return path


def accelerated(criteria: Mapping[str, Criteria]) -> list[str]:
    """A sentence for each controller with a peak acceleration above that of the frame without a damper: what causes it.

    The damper is under the first floor.
    """
    base = criteria[UNCONTROLLED]
    free, out = float(base.peak_acceleration.max()), []
    for name, c in criteria.items():
        peak, floor = float(c.peak_acceleration.max()), int(c.peak_acceleration.argmax()) + 1
        if name == UNCONTROLLED or peak <= free:
            continue
        text = (
            f"{name} has a peak acceleration of {peak:#.3g} m/s2 at floor {floor}, above the {free:#.3g} m/s2 of the "
            "frame without a damper."
        )
        if c.switching_rate > SWITCHING:
            text += (
                " It has the published weights and switches the command between zero and its maximum "
                f"{c.switching_rate:.0f} times a second. Each switch changes the force on floor 1 by up to "
                f"{c.peak_force:.0f} N within milliseconds."
            )
        elif c.peak_drift[0] < base.peak_drift[0] and c.peak_drift[1:].max() > base.peak_drift[1:].max():
            text += (
                f" The damper holds storey 1 nearly rigid ({1e3 * c.peak_drift[0]:.2f} mm of drift instead of "
                f"{1e3 * base.peak_drift[0]:.2f} mm), and the storeys above drift more "
                f"({1e3 * c.peak_drift[1:].max():.2f} mm instead of {1e3 * base.peak_drift[1:].max():.2f} mm)."
            )
        out.append(text)
    return out


def _frame_pictures(
    page: Page, ground: GroundMotion, runs: dict[str, FrameRun], criteria: dict[str, Criteria], unit: str
) -> None:
    time = runs[UNCONTROLLED].time
    driven = {name: r for name, r in runs.items() if name in ("clipped-optimal", "force-tracking")}
    commands, forces = ({n: getattr(r, what) for n, r in driven.items()} for what in ("command", "force"))
    for drawn, caption, alternative in (
        (
            pictures.controllers(criteria, unit),
            "Each controller over the frame without a damper.",
            "Bars of peak drift, acceleration and force by controller.",
        ),
        (pictures.profile(criteria, ground.pga), "Peaks over the height.", "Peak drift and acceleration by floor."),
        (
            pictures.drifts(time, {name: r.drift for name, r in runs.items()}),
            "Storey drifts.",
            "Storey drifts over time under each controller.",
        ),
        (
            pictures.command_history(time, commands, forces, unit),
            "Commands of clipped-optimal and force tracking, and the resulting forces.",
            "Command and force over time.",
        ),
    ):
        page.figure("", drawn, caption, alternative)
