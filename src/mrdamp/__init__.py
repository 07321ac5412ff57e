"""Magnetorheological dampers for MuJoCo, from measured record to controlled structure.

Importing the package registers the environments with Gymnasium. MuJoCo's own import loads the plugins `mrdamp.damper`
and `mrdamp.force_sensor` by the entry point `mujoco.plugins`.
"""

from __future__ import annotations

import sys

from mrdamp.errors import EngineError, InputError, MrdampError
from mrdamp.library import library_path, load_plugin
from mrdamp.registration import register

__all__ = ["EngineError", "InputError", "MrdampError", "__version__", "library_path", "load_plugin"]

register()
if "mujoco" in sys.modules:  # which warned of another engine than the plugins'; here it is an error
    load_plugin()


def __getattr__(name: str) -> str:
    if name == "__version__":  # reading metadata takes longer than the rest of this module
        from importlib import metadata

        try:
            return metadata.version("mrdamp")
        except metadata.PackageNotFoundError:  # a source tree that was not installed
            return "0+unknown"
    raise AttributeError(f"module 'mrdamp' has no attribute {name!r}")
