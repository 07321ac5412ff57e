"""Where the shared library lies, and how MuJoCo comes to know the plugins in it."""

from __future__ import annotations

import sys
import threading
from pathlib import Path

from mrdamp.errors import EngineError

MUJOCO_VERSION = "4.0.0"

_lock = threading.Lock()
_loaded = False


def library_path() -> Path:
    """Path of the shared library with the plugin and the C entries; the ImportError states how to install it."""
    # An editable install keeps the compiled library in site-packages and the Python files where they stand.
    for folder in sys.modules[__name__.partition(".")[0]].__path__:
        path = Path(folder) / "plugin" / "libmrdamp.so"
        if path.is_file():
            return path
    raise ImportError("mrdamp: plugin/libmrdamp.so is missing from the package; install again: pip install .")


def load_plugin() -> None:
    """Registers `mrdamp.damper` and `mrdamp.force_sensor` with MuJoCo, once a process; safe to call again.

    Raises EngineError, an ImportError, where another MuJoCo than the one that the plugin was built for is installed.
    """
    global _loaded
    import mujoco

    with _lock:
        if _loaded:
            return
        if mujoco.__version__ != MUJOCO_VERSION:
            raise EngineError(
                f"mrdamp needs MuJoCo {MUJOCO_VERSION}, but {mujoco.__version__} is installed: "
                f"pip install mujoco=={MUJOCO_VERSION}"
            )
        mujoco.mj_loadPluginLibrary(str(library_path()))
        _loaded = True
