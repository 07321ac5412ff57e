"""Who is compared: controllers by name, tuned ones, and learned ones whose several files are several seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from mrdamp.compare.bench import Bench
from mrdamp.compare.tuning import Setting
from mrdamp.control import registry, told
from mrdamp.control.policy import Policy
from mrdamp.errors import InputError
from mrdamp.files import digest

_SUFFIXES = (".json", ".json.gz")


@dataclass(frozen=True)
class Contender:
    """A row of the table. specs: one for each seed, see `mrdamp.control.registry`; of a bound its name alone.

    periods: of control, that it was tuned with, or each seed trained with; None: not known. repeated: how
    many of the policies given were another one again, and are no seeds.
    """

    name: str
    specs: tuple[str, ...]
    bound: bool = False
    periods: int | None = 0
    repeated: int = 0

    @property
    def learned(self) -> bool:
        return self.specs[0].startswith(f"{registry.POLICY}:")


def contenders(
    bench: Bench,
    names: Sequence[str],
    settings: Mapping[str, Setting],
    shipped: Mapping[str, Sequence[Path]] | None = None,
) -> tuple[Contender, ...]:
    """Rows of names on a bench; each is a tuned controller's, a shipped policy's, a spec, `policy:FILE,FILE,FOLDER`,
    one from outside the package (`mrdamp.control.told`), or one of these with a name of its own, `NAME=...`.

    All are made and asked once, at rest, so that a bad file is found before anything runs. settings: of the tuned ones.
    Raises InputError.
    """
    rows = [_contender(bench, name, settings, shipped or {}) for name in names]
    known = {*bench.site.options, *bench.tuned, *bench.bounds, *(shipped or {})}
    for given, row in zip(names, rows, strict=True):
        if row.name in known and row.name != given:
            raise InputError(f"compare: {given}: {row.name} is the name of another controller; give it one of its own")
    taken = [row.name for row in rows]
    for name in taken:
        if taken.count(name) > 1:
            raise InputError(
                f"compare: controller {name} is named twice; give one another name, as in {name}2=..."
            )
    for spec in dict.fromkeys(spec for row in rows for spec in row.specs):
        bench.check(spec)
    return tuple(rows)


def shipped_policies(environment: str) -> dict[str, tuple[Path, ...]]:
    """Trained policies that come with the package, by name; their files are seeds. environment: frame, cable or
    car."""
    folder = resources.files("mrdamp") / "data" / "policies" / environment
    if not folder.is_dir():
        return {}
    root = Path(str(folder))
    folders = {path.name: _files(path) for path in sorted(root.iterdir()) if path.is_dir()}
    return {name: files for name, files in folders.items() if files}


def _contender(
    bench: Bench, given: str, settings: Mapping[str, Setting], shipped: Mapping[str, Sequence[Path]]
) -> Contender:
    head, equals, rest = given.partition("=")
    # An option has an equals sign too, but a colon stands before it.
    name, what = (head, rest) if equals and ":" not in head else ("", given)
    if what in settings:
        return Contender(name or what, (settings[what].spec,), periods=settings[what].periods)
    if what in shipped:
        return _policies(name or what, shipped[what])
    if what.startswith(f"{registry.POLICY}:"):
        files = [f for part in what.partition(":")[2].split(",") for f in _files(Path(part))]
        if not files:
            raise InputError(f"compare: {what}: no policy file there; allowed: {', '.join(_SUFFIXES)}")
        return _policies(name or files[0].stem, files)
    if told.is_own(what) and what.partition(":")[0] not in bench.site.options:
        place = what.partition(":")[0].partition(",")[0]
        return Contender(name or Path(place).stem, (f"{registry.OWN}:{what}",), periods=None)
    if what in bench.tuned:
        raise InputError(f"compare: {what} has not been tuned for this model; add --tune")
    if what.partition(":")[0] not in bench.site.options:
        known = (*bench.site.options, *bench.tuned, *shipped, f"{registry.POLICY}:FILES", "module:Class", "model.zip")
        raise InputError(f"controller {what!r} is unknown; there are {', '.join(known)}")
    return Contender(name or what, (what,))


def _policies(name: str, files: Sequence[Path]) -> Contender:
    periods = Policy.read(files[0]).about.get("timesteps")
    first: dict[str, Path] = {}
    for file in files:
        first.setdefault(digest([Policy.read(file).to_dict()]), file)
    specs = tuple(f"{registry.POLICY}:{file}" for file in first.values())
    return Contender(name, specs, periods=periods, repeated=len(files) - len(specs))


def _files(path: Path) -> tuple[Path, ...]:
    """A file, or those of a folder: policy.json in its subfolders, as training leaves them, or every .json in it."""
    if path.is_dir():
        trained = sorted(path.glob("**/policy.json"))
        return tuple(trained or sorted(f for f in path.iterdir() if f.name.endswith(_SUFFIXES)))
    if not path.is_file():
        raise InputError(f"{path}: no such policy file")
    return (path,)
