"""Public modules under the paths of earlier releases: `mrdamp.mjcf` is `mrdamp.simulation.mjcf`."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

#: Former path -> module. Both names give the same module.
FORMER_PATHS = {
    "mrdamp.calibration": "mrdamp.identify.calibration",
    "mrdamp.core": "mrdamp.model.core",
    "mrdamp.criteria": "mrdamp.simulation.criteria",
    "mrdamp.intervals": "mrdamp.identify.intervals",
    "mrdamp.laws": "mrdamp.identify.laws",
    "mrdamp.mjcf": "mrdamp.simulation.mjcf",
    "mrdamp.norms": "mrdamp.identify.norms",
    "mrdamp.predict": "mrdamp.simulation.predict",
    "mrdamp.stepping": "mrdamp.simulation.stepping",
}


class FormerPaths(MetaPathFinder):
    """Finds the modules of the table; it is the last entry of `sys.meta_path`."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        there = FORMER_PATHS.get(fullname)
        return None if there is None else ModuleSpec(fullname, _Loader(there), origin=there)


class _Loader(Loader):
    def __init__(self, there: str) -> None:
        self.there = there
        self.spec: ModuleSpec | None = None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        module = importlib.import_module(self.there)
        self.spec = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        module.__spec__ = self.spec  # the import system has set the former path's
