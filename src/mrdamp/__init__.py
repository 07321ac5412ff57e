"""Magnetorheological dampers for MuJoCo, from measured record to controlled structure.

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
    from mrdamp.diagnosis.case.folder import read_case
    from mrdamp.diagnosis.run import diagnose
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
    "diagnose",
    "library_path",
    "load_plugin",
    "predict",
    "read_case",
    "read_motion",
    "read_record",
    "read_records",
    "run_frame",
    "write_mjcf",
]
#: Module -> what is taken from it when it is first asked for: `import mrdamp` alone stays quick.
_LATER = {
    "diagnosis.case.folder": ("read_case",),
    "diagnosis.run": ("diagnose",),
    "model": ("Effect", "Model"),
    "motions": ("GroundMotion", "read_motion"),
    "records": ("Record", "RecordSet", "read_record", "read_records"),
    "simulation.mjcf": ("write_mjcf",),
    "simulation.predict": ("predict",),
    "simulation.stepping": ("run_frame",),
}

register()
if "mujoco" in sys.modules:  # which warned of another engine than the plugins'; here it is an error
    load_plugin()


def __getattr__(name: str) -> Any:
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
