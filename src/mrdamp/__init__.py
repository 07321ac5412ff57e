"""Magnetorheological dampers for MuJoCo, from measured record to controlled structure.

Importing the package registers the plugins `mrdamp.damper` and `mrdamp.force_sensor` with MuJoCo.
"""

from __future__ import annotations

from importlib import metadata

from mrdamp.errors import InputError, MrdampError
from mrdamp.library import library_path, load_plugin

try:
    __version__ = metadata.version("mrdamp")
except metadata.PackageNotFoundError:  # a source tree that was not installed
    __version__ = "0+unknown"

load_plugin()

__all__ = ["InputError", "MrdampError", "__version__", "library_path", "load_plugin"]
