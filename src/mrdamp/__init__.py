"""Magnetorheological dampers for MuJoCo, from measured record to controlled structure.

    fit = mrdamp.identify("records/")                     # a force law from records of a rig
    columns = mrdamp.predict(fit.model, "new_record.csv")   # its force on another record
    answer = mrdamp.diagnose("case/")                     # why simulator and rig differ: print(answer)
    table = mrdamp.compare("frame", ["passive-on", "clipped-optimal"])    # controllers of a structure
    mrdamp.train("mrdamp/Frame-v0", "out/frame")          # a learned one

Answers have `plot()`, a Matplotlib figure, and show it in a notebook. `help(mrdamp.api)` has the arguments. Files:
`Record`, `read_record`, `read_records`, `read_case`, `read_motion`. Simulators: `Model`, `Effect`, `run_frame`,
`write_mjcf`. Wrong input raises `InputError`, in one line.

Importing the package registers the environments with Gymnasium. MuJoCo's own import loads the plugins `mrdamp.damper`
and `mrdamp.force_sensor` by the entry point `mujoco.plugins`.
"""

from __future__ import annotations

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

import mrdamp.interrupts  # noqa: F401  (before what takes time to import)
from mrdamp.errors import EngineError, InputError, MrdampError
from mrdamp.library import library_path, load_plugin
from mrdamp.registration import register

if TYPE_CHECKING:
    from mrdamp.api import compare, diagnose, identify, train
    from mrdamp.diagnosis.case.folder import read_case
    from mrdamp.model import Effect, Model
    from mrdamp.motions import GroundMotion, read_motion
    from mrdamp.records import Record, RecordSet, read_record, read_records
    from mrdamp.simulation.mjcf import write_mjcf
    from mrdamp.simulation.predict import predict
    from mrdamp.simulation.stepping import run_frame

__all__ = [
    "Effect",
    "EngineError",
    "GroundMotion",
    "InputError",
    "Model",
    "MrdampError",
    "Record",
    "RecordSet",
    "__version__",
    "compare",
    "diagnose",
    "identify",
    "library_path",
    "load_plugin",
    "predict",
    "read_case",
    "read_motion",
    "read_record",
    "read_records",
    "run_frame",
    "train",
    "write_mjcf",
]
#: Module -> what is taken from it when it is first asked for: `import mrdamp` alone stays quick.
_LATER = {
    "api": ("diagnose",),
    "diagnosis.case.folder": ("read_case",),
    "model": ("Effect", "Model"),
    "motions": ("GroundMotion", "read_motion"),
    "records": ("Record", "RecordSet", "read_record", "read_records"),
    "simulation.mjcf": ("write_mjcf",),
    "simulation.predict": ("predict",),
    "simulation.stepping": ("run_frame",),
}

#: Packages that are called as the functions of their names in `mrdamp.api`.
_CALLED = "compare", "identify", "train"

register()
if "mujoco" in sys.modules:  # which warned of another engine than the plugins'; here it is an error
    load_plugin()


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


def __getattr__(name: str) -> Any:
    if name in _CALLED:
        return import_module(f"mrdamp.{name}")
    for module, names in _LATER.items():
        if name in names:
            return getattr(import_module(f"mrdamp.{module}"), name)
    if name == "__version__":  # reading metadata takes longer than the rest of this module
        from importlib import metadata

        try:
            return metadata.version("mrdamp")
        except metadata.PackageNotFoundError:  # a source tree that was not installed
            return "0+unknown"
    raise AttributeError(f"module 'mrdamp' has no attribute {name!r}")
