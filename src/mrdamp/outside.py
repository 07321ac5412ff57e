"""Classes and functions from outside the package: `module:NAME` or `file.py:NAME`."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import re
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

from mrdamp.errors import InputError, first_line
from mrdamp.files import read_bytes

NAMED = re.compile(r"(?P<place>.+\.py|[A-Za-z_][\w.]*):(?P<name>[A-Za-z_]\w*)")


def named(spec: str, what: str) -> Any:
    """The object of a spec; what: it is, for messages. Raises InputError."""
    found = NAMED.fullmatch(spec)
    if found is None:
        raise InputError(f"{what} {spec!r}; allowed: module:NAME, file.py:NAME")
    module = load(found["place"])
    if not hasattr(module, found["name"]):
        raise InputError(f"{what} {spec}: there is no {found['name']} in {found['place']}")
    return getattr(module, found["name"])


def with_imports(file: Path) -> list[Path]:
    """A Python file and those that it imports, they as well, from its folder; of a package every module."""
    found = [file]
    for path in found:
        nodes: list[ast.AST] = []
        with suppress(SyntaxError, ValueError):  # of a module that is never run
            nodes = list(ast.walk(ast.parse(read_bytes(path))))
        names = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
        names += [node.module for node in nodes if isinstance(node, ast.ImportFrom) and node.module]
        for place in (file.parent / name.partition(".")[0] for name in names):
            beside = place.rglob("*.py") if (place / "__init__.py").is_file() else [place.with_suffix(".py")]
            found += sorted(other for other in beside if other.is_file() and other not in found)
    return found


def load(place: str) -> Any:
    """A module by its name, also from the working folder, or from a file. Raises InputError."""
    try:
        if not place.endswith(".py"):
            if "" not in sys.path and "." not in sys.path:
                sys.path.append("")
            return importlib.import_module(place)
        path = Path(place)
        if not path.is_file():
            raise InputError(f"{place}: no such file")
        folder = str(path.resolve().parent)
        if folder not in sys.path:
            sys.path.insert(0, folder)  # as that of a script, for what it imports now or later
        # By its path: its stem may be the name of another module.
        spec = importlib.util.spec_from_file_location(str(path.resolve()), path)
        assert spec is not None
        assert spec.loader is not None
        module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)  # a dataclass looks there
        spec.loader.exec_module(module)
        for beside in with_imports(path)[1:]:
            other = getattr(sys.modules.get(beside.stem, beside), "__file__", beside)
            if str(beside.parent.resolve()) == folder and not beside.samefile(str(other)):
                raise InputError(f"{place}: its {beside.name} is hidden by {other}; give it another name")
    except InputError:
        raise
    except (Exception, SystemExit) as error:  # of its own code
        raise InputError(f"{place}: cannot be imported: {type(error).__name__}: {first_line(error)}") from None
    return module
