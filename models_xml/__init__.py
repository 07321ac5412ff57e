"""Ready MuJoCo models that ship with the package, one folder a rig.

| name | what |
|---|---|
| `car` | car on four MR dampers, its wheels in contact with the road |
| `cable` | stay cable with sag, an MR damper near its anchorage |
| `frame3` | three-storey shear frame on a shake table, an MR damper under the first floor |
| `quarter_car` | wheel and body of a quarter car on a moving road, an MR damper between them |
| `rig` | displacement-driven testing machine with one MR damper |

`dampers/NAME.xml` are the published sets, to be included in a model. Each other folder has `model.xml` (the
mechanics), `scene.xml` (the same with light and ground, for the viewer) and a README with sources. Loading one
needs the plugins: `import mrdamp` registers them.
"""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from mrdamp import sets
from mrdamp.errors import InputError


def names() -> tuple[str, ...]:
    """The models' names, sorted."""
    return tuple(sorted(folder.name for folder in _root().iterdir() if (folder / "model.xml").is_file()))


def path(name: str, file: str = "model.xml") -> Path:
    """The path of a model's file. Raises InputError where there is no such model or file."""
    if name not in names():
        raise InputError(f"model {name!r} is unknown; there are: {', '.join(names())}")
    folder = _root() / name
    there = sorted(entry.name for entry in folder.iterdir() if entry.is_file())
    if file not in there:
        raise InputError(f"model {name!r} has no file {file!r}; it has: {', '.join(there)}")
    return folder / file


def damper(name: str) -> Path:
    """The path of a published set as MJCF, to be included in a model. Raises InputError where there is no such set."""
    sets.load(name)
    return _root() / "dampers" / f"{name}.xml"


def _root() -> Path:
    return Path(str(files(__name__)))
