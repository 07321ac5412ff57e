"""Steps per second against OpenSees: its three-storey frame with a Bouc-Wen element, in a process of its own."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import accuracy
from benchmarks.frames import Stepper, frame, multisine, profiling_clock
from benchmarks.result import Figure, Section, of_ratio
from benchmarks.timing import Effort, Ratio, interleave, ratio

STEP, FINE = 5e-4, 2e-4  # s
TITLE = "Plugin against OpenSees"


class MissingError(Exception):
    """OpenSees is not there; the text says why."""


class OpenSees(AbstractContextManager["OpenSees"]):
    """The frame in OpenSees at a time step (s), run by the interpreter `python`. Raises MissingError."""

    def __init__(self, python: str, time_step: float, ground_step: float, steps: int) -> None:
        ground = multisine(np.arange(round(60.0 / ground_step)) * ground_step)
        spec = {
            "time_step": time_step,
            "mass": accuracy.MASS.tolist(),
            "stiffness": accuracy.STIFFNESS.tolist(),
            "damping": accuracy.DAMPING.tolist(),
            "ground_step": ground_step,
            "ground": ground.tolist(),
            "damper": accuracy.SIMPLE,
        }
        self.steps = steps
        self.folder = tempfile.TemporaryDirectory()
        file, self.errors = Path(self.folder.name) / "spec.json", Path(self.folder.name) / "errors"
        file.write_text(json.dumps(spec))
        script = Path(__file__).with_name("opensees_frame.py")
        try:
            with self.errors.open("w") as errors:
                self.process = subprocess.Popen(
                    [python, str(script), str(file)],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=errors,
                    text=True,
                )
            self.version: str = self._read()["version"]
        except OSError as error:
            self.folder.cleanup()
            raise MissingError(f"{python}: {error.strerror}") from None
        except MissingError:
            self.__exit__()
            raise

    def _read(self) -> dict[str, Any]:
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            self.process.wait()
            last = [said for said in self.errors.read_text().splitlines() if said.strip()]
            raise MissingError(f"no OpenSees: {last[-1].strip() if last else 'it ended without a word'}")
        answer: dict[str, Any] = json.loads(line)
        if "error" in answer:
            raise RuntimeError(f"OpenSees: {answer['error']}")
        return answer

    def ask(self, number: int) -> dict[str, Any]:
        """See opensees_frame.py."""
        assert self.process.stdin is not None
        self.process.stdin.write(f"{number}\n")
        self.process.stdin.flush()
        return self._read()

    def __call__(self) -> float:
        """Cost of a step, us."""
        return float(self.ask(self.steps)["cost"])

    def __exit__(self, *_: object) -> None:
        self.process.communicate()
        self.folder.cleanup()


def force_error(python: str, time_step: float, end: float) -> float:
    """OpenSees' force against SciPy's, for the same law and motion."""
    with OpenSees(python, time_step, accuracy.GRID, 1) as frame_there:
        twin = accuracy.reference(end, "bouc_wen").every(time_step)
        force = frame_there.ask(1 - len(twin.t))["force"]
    return accuracy.error(np.array(force), twin.force[1:])


def measure(effort: Effort, python: str = sys.executable, end: float = 3.0) -> list[Section]:
    """The table; a row that says why where OpenSees is not installed for `python`."""
    text = (
        "BoucWen material with n = 2 and a dashpot in place of the modified law, without driver and sensor; Newmark, "
        "Newton to 1e-8 m, ProfileSPD, many steps in one call."
    )
    try:
        with OpenSees(python, STEP, 5e-3, effort.steps) as there:
            plugin = Stepper(frame(STEP), effort.steps)
            costs = interleave({"opensees": there, "plugin": plugin}, effort.rounds)
            with profiling_clock(False):
                quiet = interleave({"opensees": there, "plugin": plugin}, effort.rounds)
    except MissingError as error:
        return [Section(TITLE, text, (Figure("steps per second", target=">= 4", skipped=str(error)),))]
    r, times = ratio(costs["opensees"], costs["plugin"]), STEP / FINE
    fine = Ratio(r.value * times, r.low * times, r.high * times, r.top, r.bottom)
    errors = {dt: force_error(python, dt, end) for dt in (STEP, FINE)}
    ours = accuracy.frame_error(STEP, end)
    notes = {dt: f"force error {ours:.2%} against OpenSees' {e:.2%}" for dt, e in errors.items()}
    per_second = f"steps per second, both at {STEP * 1e3:g} ms"
    return [
        Section(
            TITLE,
            f"{text} Version {there.version}.",
            (
                of_ratio(per_second, r, ">= 4", notes[STEP]),
                of_ratio(f"{per_second}, no engine clock", ratio(quiet["opensees"], quiet["plugin"])),
                of_ratio(f"a simulated second, OpenSees at {FINE * 1e3:g} ms", fine, ">= 4", notes[FINE]),
            ),
        )
    ]
