"""The published table of Dyke, Spencer, Sain and Carlson 1996, through MuJoCo and the plugin.

Smart Materials and Structures 5 (1996) 565-575, doi 10.1088/0964-1726/5/5/006: the three-storey frame under El Centro
1940 NS at five times its speed; peak floor displacements, storey drifts, absolute accelerations and damper force.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mrdamp import sets
from mrdamp.compare import tables
from mrdamp.control import clipped_optimal, passive_off, passive_on
from mrdamp.control.base import Controller
from mrdamp.errors import InputError
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.motions import TIME_SCALE, GroundMotion, read_motion
from mrdamp.pictures.compare import deviations
from mrdamp.report import Page
from mrdamp.simulation.criteria import evaluate
from mrdamp.simulation.stepping import run_frame
from mrdamp.structures import dyke1996

COLUMNS = ("x1", "x2", "x3", "d1", "d2", "d3", "a1", "a2", "a3", "f")
UNITS = ("cm",) * 6 + ("cm/s2",) * 3 + ("N",)
COMMAND_MAX = 2.25  # V
PERIOD = 5e-4  # s; above 1 ms clipped-optimal's accelerations grow
FILE = "elcentro_1940_ns_iia001.csv"

PUBLISHED: Mapping[str, tuple[float, ...]] = {
    "uncontrolled": (0.538, 0.820, 0.962, 0.538, 0.319, 0.201, 856, 1030, 1400),
    "passive-off": (0.211, 0.357, 0.455, 0.211, 0.153, 0.103, 420, 480, 717, 258),
    "passive-on": (0.076, 0.196, 0.306, 0.076, 0.158, 0.110, 281, 494, 767, 979),
    "clipped-optimal": (0.114, 0.185, 0.212, 0.114, 0.090, 0.101, 696, 739, 703, 941),
}


@dataclass(frozen=True, eq=False)
class TableRow:
    """A controller: values (9,) or, with a damper, (10,) as COLUMNS, in UNITS; published; deviation in percent."""

    controller: str
    values: Array
    published: Array
    deviation: Array

    @property
    def mean_deviation(self) -> float:
        """Of the magnitudes, percent."""
        return float(np.abs(self.deviation).mean())


def frame_model() -> Model:
    return replace(sets.load("dyke1996_3kN").model(), rig="frame", structure=dyke1996())


def el_centro(given: Path | None = None) -> GroundMotion:
    """El Centro 1940 NS, the corrected digitisation IIA001 (peak 3.417 m/s2), from a file or from where it is looked
    for: `shared/data/earthquakes` beside or above the working folder. Raises InputError where it is not."""
    if given is not None:
        return read_motion(given)
    here = Path.cwd()
    for folder in (here, *here.parents):
        path = folder / "shared" / "data" / "earthquakes" / FILE
        if path.is_file():
            return read_motion(path)
    raise InputError(
        f"{FILE}: not found in shared/data/earthquakes here or above; name a file of El Centro 1940 NS (Caltech IIA001,"
        " 3.417 m/s2) with --motions FILE"
    )


def table(
    motion: GroundMotion, period: float = PERIOD, progress: Callable[[str, float], None] | None = None
) -> tuple[TableRow, ...]:
    """The four rows under a motion at full size's speed; period: of control, s."""
    frame = dyke1996()
    controllers: Mapping[str, Controller | None] = {
        "uncontrolled": None,
        "passive-off": passive_off(period),
        "passive-on": passive_on(COMMAND_MAX, period),
        "clipped-optimal": clipped_optimal(frame, COMMAND_MAX, period=period),
    }
    played, model = motion.compressed(TIME_SCALE), frame_model()
    rows = []
    for k, (name, controller) in enumerate(controllers.items()):
        if progress:
            progress(name, k / len(controllers))
        run = run_frame(model, played, controller, period=period)
        c = evaluate(frame, run.time, run.drift, run.acceleration, run.force, None, run.command, COMMAND_MAX)
        published = np.array(PUBLISHED[name])
        peaks = np.concatenate([c.peak_displacement, c.peak_drift, c.peak_acceleration, [c.peak_force / 100]])
        values = 100 * peaks[: len(published)]
        rows.append(TableRow(name, values, published, 100 * (values / published - 1)))
    if progress:
        progress("done", 1.0)
    return tuple(rows)


def shown(rows: Sequence[TableRow], motion: GroundMotion) -> tables.Table:
    """Found values with the deviation from the published one in percent."""
    heads = ("", *(f"{name} ({unit})" for name, unit in zip(COLUMNS, UNITS, strict=True)))
    note = f"{motion.source}; at five times its speed. In parentheses: deviation, percent."
    return tables.Table(heads, [(row.controller, *_cells(row)) for row in rows], note)


def markdown(rows: Sequence[TableRow], motion: GroundMotion) -> str:
    """The table, published and computed values."""
    heads, body, _ = shown(rows, motion)
    means = (f"{row.mean_deviation:.2f} %" for row in rows)
    table = tables.markdown((*heads, "mean deviation"), [(*r, m) for r, m in zip(body, means, strict=True)])
    text = f"# Dyke et al. 1996\n\n{motion.source}; at five times its speed.\n\n"
    return f"{text}{table}\nIn parentheses: deviation from the published value, percent.\n"


def to_dict(rows: Sequence[TableRow], motion: GroundMotion) -> dict[str, Any]:
    return {
        "motion": motion.name,
        "columns": [f"{name} {unit}" for name, unit in zip(COLUMNS, UNITS, strict=True)],
        "rows": {
            row.controller: {
                "found": row.values.tolist(),
                "published": row.published.tolist(),
                "deviation_percent": row.deviation.tolist(),
                "mean_deviation_percent": row.mean_deviation,
            }
            for row in rows
        },
    }


def page(rows: Sequence[TableRow], motion: GroundMotion) -> Page:
    worst = max(row.mean_deviation for row in rows)
    page = Page(
        "Dyke et al. 1996",
        f"The published peaks, met within {worst:.1f} % on average in every row, through MuJoCo and the plugin.",
        footer="Made by `mrdamp compare --preset dyke1996`.",
    )
    page.table("Peaks", *shown(rows, motion))
    page.figure(
        "",
        deviations({row.controller: row.deviation.tolist() for row in rows}, COLUMNS),
        "Deviation from the published values.",
        "Deviation in percent of every peak by controller.",
    )
    return page


def _cells(row: TableRow) -> tuple[str, ...]:
    cells = [
        f"{v:{'.0f' if v > 20 else '.3f'}} ({d:+.1f})" for v, d in zip(row.values, row.deviation, strict=True)
    ]
    return (*cells, *["–"] * (len(COLUMNS) - len(cells)))
