"""`python -m benchmarks.identification`: our networks compared with common alternatives, on the same split.

The split is the self-sensing paper's: one record of varying current cut 4000:2000:1500 at 500 Hz, and two records of
another motion as further tests. Errors are over the standard deviation of the force; time is CPU time of one fit, as
a ratio to ours.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from benchmarks.result import machine
from mrdamp.identify import identify as identify_law
from mrdamp.identify import simulate
from mrdamp.model.core import Array
from mrdamp.narx import lagged, train_narx
from mrdamp.narx.data import Series
from mrdamp.narx.evaluation import free_run_force, one_step_force
from mrdamp.narx.splits import DataSplit, cut_varying, varying_command
from mrdamp.records import embedded

RECORD = "sine_5.0Hz_2.5mm_random_current"
PAGE = Path(__file__).resolve().parents[1] / "docs" / "identification" / "comparison.md"
LAGS = 4  # lag space, as in the paper
SKIP = 10  # samples at a start that do not count

#: Force (n,) N of a stretch in free run, and one step ahead from the sample LAGS + 1 on.
Predict = Callable[[Series], Array]


@dataclass(frozen=True)
class Rival:
    """A fitted model and the CPU time of its fit, s."""

    name: str
    free: Predict
    one: Predict | None
    seconds: float


@dataclass(frozen=True)
class Effort:
    """How long each is trained: initialisations of ours; epochs of the others."""

    initialisations: int = 3
    horizons: tuple[int | None, ...] = (5, 20, 100, 400, None)
    iterations: int = 150
    epochs: int = 100


def ours(s: DataSplit, effort: Effort) -> Rival:
    """The 15-20-1 network, every initialisation and the free-run training counted."""
    start = time.process_time()
    fit = train_narx(
        s.train, s.validation, inputs=lagged("viF", LAGS), hidden=(20,), initialisations=effort.initialisations,
        horizons=effort.horizons, one_step_iterations=effort.iterations,
    )  # fmt: skip
    spent = time.process_time() - start
    net = fit.network
    return Rival(
        f"mrdamp, NARX {net.topology}",
        lambda x: free_run_force(net, x),
        lambda x: one_step_force(net, x),
        spent,
    )


def law(extras: Sequence[str], name: str) -> Rival:
    """The modified Bouc-Wen law, fitted by this package to the same training part."""
    part = cut_varying(embedded(), RECORD)
    start = time.process_time()
    fit = identify_law("modified_bouc_wen", part.train, extras=extras, threads=1)
    spent = time.process_time() - start
    records = {r.name: r for r in part.validation}
    return Rival(name, lambda s: simulate(fit.model, records[s.name]), None, spent)


def engine(extras: Sequence[str], name: str) -> Rival:
    """The same law and the same numbers, fitted by MuJoCo's own identification."""
    from benchmarks import sysid

    part = cut_varying(embedded(), RECORD)
    start = time.process_time()
    model, _ = sysid.fit("modified_bouc_wen", part.train[0], extras)
    spent = time.process_time() - start
    records = {r.name: r for r in part.validation}
    return Rival(name, lambda s: simulate(model, records[s.name]), None, spent)


def perceptron(s: DataSplit, effort: Effort) -> Rival:
    """scikit-learn's MLPRegressor over the same regressors, scaled, run free in a loop of ours."""
    from sklearn.neural_network import MLPRegressor

    scale = _Scale.of(s.train)
    start = time.process_time()
    found = []
    for seed in range(effort.initialisations):
        model = MLPRegressor(hidden_layer_sizes=(20,), activation="tanh", solver="lbfgs", tol=1e-9, alpha=1e-4,
                             max_iter=30 * effort.epochs, random_state=seed)  # fmt: skip
        rows = np.concatenate([scale.regressors(x)[LAGS + 1 :] for x in s.train])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # it says that it could go on
            model.fit(rows, np.concatenate([scale.force(x)[LAGS + 1 :] for x in s.train]))
        found.append((_error(_looped(model.predict, scale), s.validation), seed, model))
    spent = time.process_time() - start
    best = min(found, key=lambda item: item[:2])[2]
    return Rival(
        "scikit-learn, MLP 15-20-1", _looped(best.predict, scale), _stepped(best.predict, scale), spent
    )


def polynomial(s: DataSplit, effort: Effort) -> Rival:
    """sysidentpy's polynomial NARX: FROLS over all terms of degree 2, their number by AIC."""
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS
    from sysidentpy.parameter_estimation import LeastSquares

    lags = list(range(1, LAGS + 1))
    model = FROLS(order_selection=True, n_info_values=min(30, effort.epochs), ylag=lags, xlag=[lags, lags],
                  basis_function=Polynomial(degree=2), estimator=LeastSquares(), info_criteria="aic")  # fmt: skip
    return _sysidentpy("sysidentpy, polynomial NARX", model, s, 1)


def neural(s: DataSplit, effort: Effort) -> Rival:
    """sysidentpy's neural NARX: a torch network of 20 tanh units, Adam."""
    import torch
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.neural_network import NARXNN

    torch.manual_seed(0)
    torch.set_num_threads(1)
    lags = list(range(1, LAGS + 1))
    net = torch.nn.Sequential(torch.nn.Linear(3 * LAGS, 20), torch.nn.Tanh(), torch.nn.Linear(20, 1))
    model = NARXNN(net=net, ylag=LAGS, xlag=LAGS, basis_function=Polynomial(degree=1), epochs=effort.epochs,
                   batch_size=100, learning_rate=1e-3, optimizer="Adam", loss_func="mse_loss",
                   optim_params={})  # fmt: skip
    model.xlag = [lags, lags]  # needed for two inputs, and not taken by the constructor (0.9.0)
    return _sysidentpy("sysidentpy, neural NARX 12-20-1", model, s, 1)


def _sysidentpy(name: str, model: Any, s: DataSplit, ahead: int) -> Rival:
    """Fits to scaled v, i and F. Its regressors start at lag 1, so its inputs are shifted to lag 0 first."""
    scale = _Scale.of(s.train)
    (train,) = s.train

    def inputs(x: Series) -> tuple[Array, Array]:
        u = np.column_stack([scale.v(x), scale.i(x)])
        return np.vstack([u[1:], u[-1:]]), scale.force(x)[:, None]

    start = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        u, y = inputs(train)
        model.fit(X=u, y=y)
    spent = time.process_time() - start

    def predict(x: Series, steps: int | None) -> Array:
        u, y = inputs(x)
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            out = model.predict(X=u, y=y if steps else y[:LAGS], steps_ahead=steps)
        return scale.newton(np.asarray(out, dtype=float).ravel())

    return Rival(name, lambda x: predict(x, None), lambda x: predict(x, ahead)[LAGS + 1 :], spent)


@dataclass(frozen=True)
class _Scale:
    """Channels of the training part to [-1, 1]."""

    spans: dict[str, tuple[float, float]]

    @classmethod
    def of(cls, train: Sequence[Series]) -> _Scale:
        spans = {}
        for name in ("v", "i", "force"):
            y = np.concatenate([getattr(s, name) for s in train])
            spans[name] = (float(y.max() + y.min()) / 2, float(np.ptp(y)) / 2)
        return cls(spans)

    def v(self, s: Series) -> Array:
        return self._to("v", s.v)

    def i(self, s: Series) -> Array:
        return self._to("i", s.i)

    def force(self, s: Series) -> Array:
        return self._to("force", s.force)

    def newton(self, y: Array) -> Array:
        middle, half = self.spans["force"]
        return middle + half * y

    def regressors(self, s: Series) -> Array:
        """v and i at lags 0 to 4, F at 1 to 5, as our network's."""
        scaled = Series(s.name, s.sample_time, s.x, self.v(s), self.i(s), self.force(s))
        return scaled.regressors(lagged("viF", LAGS))

    def _to(self, name: str, y: Array) -> Array:
        middle, half = self.spans[name]
        return np.asarray((y - middle) / half)


def _looped(predict: Callable[[Array], Array], scale: _Scale) -> Predict:
    """Free run over its own past; the first samples measured, as sysidentpy takes them."""

    def run(s: Series) -> Array:
        rows, force = scale.regressors(s), scale.force(s)
        out = force.copy()
        feedback = slice(2 * (LAGS + 1), 3 * (LAGS + 1))
        for k in range(LAGS + 1, s.n):
            rows[k, feedback] = out[k - 1 : k - LAGS - 2 : -1] if k > LAGS + 1 else out[LAGS::-1]
            out[k] = np.clip(predict(rows[k : k + 1])[0], -50.0, 50.0)
        return scale.newton(out)

    return run


def _stepped(predict: Callable[[Array], Array], scale: _Scale) -> Predict:
    return lambda s: scale.newton(predict(scale.regressors(s)[LAGS + 1 :]))


def _error(free: Predict, parts: Sequence[Series]) -> float:
    """RMS error over the standard deviation of the force, mean squares pooled."""
    squares, variances = [], []
    for s in parts:
        with np.errstate(all="ignore"):
            squares.append(float(np.mean((free(s)[SKIP:] - s.force[SKIP:]) ** 2)))
        variances.append(float(np.var(s.force[SKIP:])))
    return float(np.sqrt(np.mean(squares) / np.mean(variances)))


def _one(one: Predict, parts: Sequence[Series]) -> float:
    def padded(s: Series) -> Array:
        return np.concatenate([s.force[: LAGS + 1], one(s)])

    return _error(padded, parts)


_PLAIN = ("offset",)
_EFFECTS = ("offset", "driver_lag", "saturation")

#: Each with what it needs besides the package; bench-narx goes into an environment of its own, or over bench.
COMPARED: dict[str, tuple[str, Callable[[DataSplit, Effort], Rival]]] = {
    "scikit-learn, MLP": ("the extra bench", perceptron),
    "sysidentpy, polynomial NARX": ("the extra bench-narx", polynomial),
    "sysidentpy, neural NARX": ("the extra bench-narx", neural),
    "mrdamp, modified Bouc-Wen": ("", lambda _, __: law(_PLAIN, "mrdamp, modified Bouc-Wen")),
    "mujoco.sysid, modified Bouc-Wen": (
        "the extra bench",
        lambda _, __: engine(_PLAIN, "mujoco.sysid, modified Bouc-Wen"),
    ),
    "mrdamp, modified Bouc-Wen with effects": (
        "",
        lambda _, __: law(_EFFECTS, "mrdamp, modified Bouc-Wen with effects"),
    ),
    "mujoco.sysid, modified Bouc-Wen with effects": (
        "the extra bench",
        lambda _, __: engine(_EFFECTS, "mujoco.sysid, modified Bouc-Wen with effects"),
    ),
}


HEAD = ("model", "test part", "sets 1, 2", "test part, one step", "sets 1, 2, one step", "time of a fit")


def percent(error: float) -> str:
    """A share as the table shows it; a run that leaves the record diverges."""
    return f"{100 * error:.2f} %" if error < 10.0 else "diverges"


def measure(effort: Effort | None = None) -> list[tuple[str, ...]]:
    """Cells of the table, a row a model; a library that is not installed has its reason in place of figures."""
    effort = effort or Effort()
    splits = varying_command(embedded(), RECORD)
    sets = tuple(s for s in splits.test if s.name.startswith(("sine_1.0Hz", "triangle_2.5Hz")))
    parts = splits.test[:1], sets
    rows: list[tuple[str, ...]] = []
    with threadpool_limits(limits=1):
        mine = ours(splits, effort)
        rivals = [mine]
        for name, (needs, make) in COMPARED.items():
            try:
                rivals.append(make(splits, effort))
            except ImportError as error:
                rows.append((name, f"needs {needs} ({error})", "", "", "", ""))
    for rival in rivals:
        free = [percent(_error(rival.free, some)) for some in parts]
        one = [percent(_one(rival.one, some)) if rival.one else "" for some in parts]
        rows.append((rival.name, *free, *one, f"{rival.seconds / mine.seconds:.2f} x"))
    return rows


TEXT = """Error in free run over the force's standard deviation, on the embedded record of 5 Hz, 2.5 mm and random
current: 4000 samples to train on, 2000 to choose on, 1500 never used (*test part*); *sets 1, 2*: the self-
sensing paper's testing sets. Lag space 4, 20 tanh units. Time: CPU, over the first row's. `mujoco.sysid` fits
the same law with the plugin in its rollouts, in our coordinates and bounds, from our first start; ours fits
from four."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints the page and writes it."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.identification", description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=PAGE, help="the page to write")
    options = parser.parse_args(arguments)
    table = "\n".join(f"| {' | '.join(cells)} |" for cells in [HEAD, ("---",) * len(HEAD), *measure()])
    page = "\n\n".join(
        [
            "# Beside other libraries",
            TEXT,
            table,
            "```\npython -m benchmarks.identification\n```",
            f"{machine()}.",
        ]
    )
    print(page)
    options.output.parent.mkdir(parents=True, exist_ok=True)
    options.output.write_text(page + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
