"""Magnetorheological dampers for MuJoCo, from measured record to controlled structure.

Importing the package registers the plugins `mrdamp.damper` and `mrdamp.force_sensor` with MuJoCo, and the environments
with Gymnasium. Both happen when the other package is imported, so that `import mrdamp` itself loads neither.
"""

from __future__ import annotations

import sys

from mrdamp.errors import EngineError, InputError, MrdampError
from mrdamp.former_paths import FormerPaths
from mrdamp.library import library_path, load_plugin
from mrdamp.on_import import on_import
from mrdamp.registration import register

__all__ = ["EngineError", "InputError", "MrdampError", "__version__", "library_path", "load_plugin"]

# MuJoCo's own import loads the plugin by the entry point `mujoco.plugins`; this is for trees without metadata, and
# turns the warning that MuJoCo makes of an error into the error.
on_import("mujoco", load_plugin)
on_import("gymnasium", register)
sys.meta_path.append(FormerPaths())


def __getattr__(name: str) -> str:
    if name == "__version__":  # reading metadata takes longer than the rest of this module
        from importlib import metadata

        try:
            return metadata.version("mrdamp")
        except metadata.PackageNotFoundError:  # a source tree that was not installed
            return "0+unknown"
    raise AttributeError(f"module 'mrdamp' has no attribute {name!r}")
