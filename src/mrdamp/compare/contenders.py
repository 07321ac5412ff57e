"""Who is compared: controllers by name, tuned ones, and learned ones whose several files are several seeds."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from mrdamp.compare.bench import Bench
from mrdamp.compare.tuning import Setting
from mrdamp.control import registry, told
from mrdamp.control.policy import Policy
from mrdamp.errors import InputError
from mrdamp.files import differing, digest

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

    @property
    def seeds(self) -> tuple[int, ...]:
        """Of the specs: those of their folders, or files, `seed_N`; else from 1."""
        found = [re.search(r"\bseed_(\d+)(/policy)?\.json(\.gz)?$", spec) for spec in self.specs]
        numbers = tuple(int(one[1]) for one in found if one)
        return numbers if len(set(numbers)) == len(found) else tuple(range(1, len(found) + 1))


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
    policies = [Policy.read(file) for file in files]
    periods, told = policies[0].about.get("timesteps"), _settings(policies[0])
    first: dict[str, Path] = {}
    for file, policy in zip(files, policies, strict=True):
        own = _settings(policy)
        known = told.keys() & own.keys()  # a policy of an older version says less
        if other := next(differing({k: told[k] for k in known}, {k: own[k] for k in known}), None):
            raise InputError(
                f"compare: {file}: trained with another {other.removeprefix('learner.')} than {files[0]}; allowed: "
                "seeds of one training"
            )
        first.setdefault(digest([policy.to_dict()]), file)
    specs = tuple(f"{registry.POLICY}:{file}" for file in first.values())
    return Contender(name, specs, periods=periods, repeated=len(files) - len(specs))


def _settings(policy: Policy) -> Mapping[str, Any]:
    """What a policy says that it was trained with; nothing where it says nothing. A training that was extended may
    keep its best policy, which tells the shorter length."""
    found = policy.about.get("settings")
    return {k: v for k, v in found.items() if k != "n_timesteps"} if isinstance(found, Mapping) else {}


def _files(path: Path) -> tuple[Path, ...]:
    """A file, or those of a folder: policy.json in its subfolders, as training leaves them, or every .json in it."""
    if path.is_dir():
        trained = sorted(path.glob("**/policy.json"))
        return tuple(trained or sorted(f for f in path.iterdir() if f.name.endswith(_SUFFIXES)))
    if not path.is_file():
        raise InputError(f"{path}: no such policy file")
    return (path,)
