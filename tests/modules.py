"""Files that are no modules of a package, loaded as such; what code loads; and what lies beside the repository."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[1]
STUDIES, TOOLS = ROOT / "studies", ROOT / "tools"
#: Beside the repository: measured records, and cases whose truth is known.
SHARED = ROOT.parent / "shared"
DATA, CASES = Path(os.environ.get("MRDAMP_DATA", SHARED / "data")), SHARED / "cases"
#: Modules of mrdamp that what is evidence against it may use.
WITHOUT_PHYSICS = ("errors", "files", "interrupts", "library", "registration")


def loaded(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module  # a dataclass looks its module up
    spec.loader.exec_module(module)
    return module


def package_modules(code: str) -> list[str]:
    """Modules of mrdamp, without its name, that an interpreter has loaded after some code."""
    listed = f"import sys; {code}; print(*(m for m in sys.modules if m.startswith('mrdamp.')))"
    run = subprocess.run([sys.executable, "-c", listed], cwd=ROOT, capture_output=True, text=True, check=True)
    return [name.removeprefix("mrdamp.") for name in run.stdout.split()]


def needs(folder: Path) -> pytest.MarkDecorator:
    """For a test that is skipped where the folder is not there."""
    return pytest.mark.skipif(not folder.is_dir(), reason=f"needs the folder {folder}")
