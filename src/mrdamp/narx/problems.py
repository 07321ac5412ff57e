"""What training minimises: the one-step error, and the free-run error with its exact sensitivities.

In free run the network reads its own past forces. With f the network and y its force,
dy_k/dtheta = df/dtheta + sum over lags of df/dy_(k-lag) dy_(k-lag)/dtheta,
carried forward in time (Williams and Zipser, Neural Computation 1 (1989), doi 10.1162/neco.1989.1.2.270).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mrdamp.model.core import Array
from mrdamp.narx import network as nn
from mrdamp.narx.data import Series
from mrdamp.narx.network import Network

_BLOCK = 6_000_000  # numbers of a Jacobian that are held at a time
_RUN_AWAY = 50.0  # scaled force at which a free run counts as unbounded


@dataclass(frozen=True, eq=False)
class OneStep:
    """Residuals over measured past forces; scaled units (force 2 from the least to the largest of the training).

    inputs: number of them; hidden: units per layer; a: scaled regressors (N, inputs); target: scaled forces (N,).
    """

    inputs: int
    hidden: tuple[int, ...]
    a: Array
    target: Array

    @classmethod
    def of(cls, network: Network, train: Sequence[Series], most: int | None = None) -> OneStep:
        """All rows whose lags lie within one part, or `most` of them, evenly spread."""
        lag = network.max_lag
        a = np.concatenate([network.scaled(s.regressors(network.inputs)[lag:]) for s in train])
        force = np.concatenate([s.force[lag:] for s in train])
        target = (force - network.force_offset) / network.force_scale
        if most is not None and len(a) > most:
            keep = np.linspace(0, len(a) - 1, most).astype(int)
            a, target = a[keep], target[keep]
        return cls(len(network.inputs), network.hidden, np.ascontiguousarray(a), target)

    @property
    def count(self) -> int:
        return len(self.target)

    def cost(self, theta: Array) -> float:
        residual = nn.output(nn.unpack(theta, self.inputs, self.hidden), self.a) - self.target
        return float(residual @ residual)

    def normal(self, theta: Array) -> tuple[Array, Array, float]:
        layers, m = nn.unpack(theta, self.inputs, self.hidden), len(theta)
        a, g, e = np.zeros((m, m)), np.zeros(m), 0.0
        rows = max(1, _BLOCK // m)
        for start in range(0, self.count, rows):
            cut = slice(start, start + rows)
            y, jacobian, _ = nn.derivatives(layers, self.a[cut])
            residual = y - self.target[cut]
            a += jacobian.T @ jacobian
            g += jacobian.T @ residual
            e += float(residual @ residual)
        return a, g, e


@dataclass(frozen=True, eq=False)
class FreeRun:
    """Residuals of free runs over segments, which start from measured past forces or as the plugin starts.

    network: inputs, scaling and layers; its weights are not used. a: scaled regressors (H, S, inputs), S segments of up
    to H samples; the force's columns are not read. past: scaled measured forces (max_lag, S) in front of the segments.
    target: (H, S), scaled. counts: (H, S) bool, residuals that count.
    """

    network: Network
    a: Array
    past: Array
    target: Array
    counts: Array

    @classmethod
    def of(
        cls, network: Network, train: Sequence[Series], horizon: int | None, most: int | None = None,
        *, skip: int = 0, disturb: float = 0.0,
    ) -> FreeRun:  # fmt: skip
        """Segments of `horizon` samples end to end from measured lags, or with None whole parts from rest.

        most: samples at most; segments are left out evenly, and of whole parts the beginnings are kept.
        skip: samples at a start from rest, or from disturbed forces, that do not count.
        disturb: every other segment starts from forces that are off by up to so many half ranges of the training
            force, all alike: the network must find back from there, or a free run may stay on a wrong branch.
        """
        lag = network.max_lag
        starts = []
        for s in train:
            if horizon is None:
                share = s.n if most is None else max(most // len(train), 10 * lag + skip)
                starts.append((s, 0, min(s.n, share)))
            else:
                first = range(lag, max(s.n - horizon, lag) + 1, horizon)
                starts += [(s, k, min(horizon, s.n - k)) for k in first]
        if horizon is not None and most is not None and sum(length for *_, length in starts) > most:
            keep = max(1, int(most / (sum(length for *_, length in starts) / len(starts))))
            starts = [starts[int(k)] for k in np.linspace(0, len(starts) - 1, keep)]
        longest = max(length for *_, length in starts)
        shape = (longest, len(starts))
        a, past = np.zeros((*shape, len(network.inputs))), np.zeros((lag, len(starts)))
        target, counts = np.zeros(shape), np.zeros(shape, dtype=bool)
        rest = -network.force_offset / network.force_scale
        rng = np.random.default_rng(len(starts))
        tables = {id(s): network.scaled(s.regressors(network.inputs)) for s in train}
        for j, (s, start, length) in enumerate(starts):
            force = (s.force - network.force_offset) / network.force_scale
            a[:length, j] = tables[id(s)][start : start + length]
            a[length:, j] = a[length - 1, j]  # runs on at rest, uncounted
            past[:, j] = force[start - lag : start] if horizon is not None else rest
            target[:length, j] = force[start : start + length]
            off = disturb if horizon is not None and j % 2 and length > 2 * skip else 0.0
            past[:, j] += off * rng.uniform(-1.0, 1.0)
            counts[skip if horizon is None or off else 0 : length, j] = True
        return cls(network, a, past, target, counts)

    @property
    def count(self) -> int:
        return int(np.count_nonzero(self.counts))

    def cost(self, theta: Array) -> float:
        """Sum of squared residuals; infinite for a run that grows without bound."""
        _, y = self._run(theta, slice(None))
        residual = np.where(self.counts, y - self.target, 0.0)
        e = float(np.sum(residual * residual))
        return e if np.isfinite(e) else np.inf

    def normal(self, theta: Array) -> tuple[Array, Array, float]:
        m = len(theta)
        a, g, e = np.zeros((m, m)), np.zeros(m), 0.0
        horizon, segments = self.target.shape
        block = max(1, _BLOCK // (m * horizon))
        for start in range(0, segments, block):
            cut = slice(start, start + block)
            y, jacobian = self.sensitivities(theta, cut)
            counts = self.counts[:, cut].ravel()
            rows = jacobian.reshape(-1, m)
            rows = rows if counts.all() else rows[counts]
            residual = (y - self.target[:, cut]).ravel()[counts]
            a += rows.T @ rows
            g += rows.T @ residual
            e += float(residual @ residual)
        return a, g, e

    def sensitivities(self, theta: Array, cut: slice = slice(None)) -> tuple[Array, Array]:
        """Scaled force (H, S) and its derivatives (H, S, M) of the segments in `cut`."""
        net = self.network
        a, y = self._run(theta, cut)
        horizon, segments = y.shape
        feedback = list(net.feedback)
        _, flat, slopes = nn.derivatives(
            nn.unpack(theta, len(net.inputs), net.hidden), a.reshape(horizon * segments, -1), feedback
        )
        jacobian = flat.reshape(horizon, segments, -1)
        slopes = slopes.reshape(horizon, segments, -1) * (net.force_scale * net.scale[feedback])
        lags = [net.inputs[k][1] for k in feedback]
        scratch = np.empty(jacobian.shape[1:])
        for k in range(1, horizon):
            row = jacobian[k]
            for j, lag in enumerate(lags):
                if lag <= k:
                    np.multiply(jacobian[k - lag], slopes[k, :, j, None], out=scratch)
                    row += scratch
        return y, jacobian

    def _run(self, theta: Array, cut: slice) -> tuple[Array, Array]:
        """Scaled regressors (H, S, inputs) with the run's own forces, and the force (H, S)."""
        net = self.network
        layers = nn.unpack(theta, len(net.inputs), net.hidden)
        a, lag = self.a[:, cut].copy(), net.max_lag
        horizon, segments, _ = a.shape
        feedback = list(net.feedback)
        a[:, :, feedback] = 0.0
        first, bias = layers[0]
        known = a @ first.T + bias
        back = np.ascontiguousarray(first[:, feedback].T)
        lags = np.array([net.inputs[k][1] for k in feedback], dtype=int)
        gain = net.force_scale * net.scale[feedback]
        shift = (net.force_offset - net.offset[feedback]) * net.scale[feedback]
        y = np.empty((lag + horizon, segments))
        y[:lag] = self.past[:, cut]
        own = np.empty((horizon, segments, len(feedback)))
        with np.errstate(over="ignore", invalid="ignore"):
            for k in range(horizon):
                now = y[lag + k - lags].T * gain + shift
                own[k] = now
                inner = known[k] + now @ back
                for weight, offset in layers[1:]:
                    inner = np.tanh(inner) @ weight.T + offset
                # Bounded here, so that a run away stays a number; its cost is infinite below.
                y[lag + k] = np.clip(inner[:, 0], -_RUN_AWAY, _RUN_AWAY)
        a[:, :, feedback] = own
        force = y[lag:]
        if np.any(np.abs(force) >= _RUN_AWAY):
            force = np.full_like(force, np.inf)
        return a, force
