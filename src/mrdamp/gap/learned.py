"""Controllers that are learned in a simulator: `learned`, `learned:algorithm=ppo,timesteps=200000`."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from mrdamp.control import registry
from mrdamp.control.base import Controller
from mrdamp.control.told import told
from mrdamp.errors import InputError
from mrdamp.model import Effect, Model
from mrdamp.structures import ShearFrame

LEARNED = "learned"
Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Learning:
    """How a policy is trained in a simulator. algorithm: of `mrdamp train`; timesteps: control periods in all, None: as
    its hyperparameters say; folder: where trainings are kept, a folder each, and go on."""

    algorithm: str
    timesteps: int | None
    seed: int
    folder: Path

    @classmethod
    def of(cls, spec: str, seed: int, folder: Path) -> Learning | None:
        """Of a controller's spec; None where it is none that is learned. Raises InputError."""
        kind, _, rest = spec.partition(":")
        if kind != LEARNED:
            return None
        given = dict.fromkeys(("algorithm", "timesteps"), "")
        for part in filter(None, rest.split(",")):
            key, _, value = part.partition("=")
            if key not in given:
                raise InputError(
                    f"controller {LEARNED}: option {key!r} is unknown; allowed: {', '.join(given)}"
                )
            given[key] = value
        steps = given["timesteps"]
        if steps and (not steps.isdecimal() or int(steps) < 1):
            raise InputError(f"controller {LEARNED}: timesteps is {steps!r}; allowed: a whole number > 0")
        return cls(given["algorithm"] or "es", int(steps) if steps else None, seed, folder)

    def train(
        self, models: Sequence[Model], site: registry.Site, progress: Progress | None = None
    ) -> Controller:
        """The policy of a training in a simulator, or over several, which continues where it was stopped.

        What a linear frame can hold of a model's effects goes into its structure. Raises InputError.
        """
        from mrdamp.train.learn import train
        from mrdamp.train.settings import Options

        simulators = [straightened(model) for model in models]
        key = "".join(json.dumps(simulator.to_dict(), sort_keys=True) for simulator in simulators)
        folder = self.folder / hashlib.sha256(key.encode()).hexdigest()[:12]
        folder.mkdir(parents=True, exist_ok=True)
        files = [folder / f"model_{k + 1}.json" for k in range(1, len(simulators))]
        files = [folder / "model.json", *files]
        for simulator, file in zip(simulators, files, strict=True):
            simulator.write(file)
        options = Options(
            algorithm=self.algorithm,
            seed=self.seed,
            timesteps=self.timesteps,
            model=files[0],
            others=tuple(files[1:]),
        )
        found = train(options, folder / "training", progress)
        return told(partial(registry.make, f"{registry.POLICY}:{found.folder / 'policy.json'}"), site)


def straightened(model: Model) -> Model:
    """The same simulator with other masses, stiffnesses and damping in place of the effects that are just that."""
    linear = tuple(e for e in model.effects if _is_linear(e))
    frame, s = replace(model, effects=linear).frame, model.structure
    assert s is not None
    structure = ShearFrame(frame.mass, frame.stiffness, frame.damping, s.damper_between)
    return replace(model, structure=structure, effects=tuple(e for e in model.effects if not _is_linear(e)))


def _is_linear(effect: Effect) -> bool:
    return effect.name in ("storey_stiffness", "floor_mass") or (
        effect.name == "storey_damping" and not effect.parameters.get("quadratic")
    )
