"""NARX networks: the plugin's free run against NumPy's, other timesteps, and where weights come from."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from dampers import rms
from excitation import Array, multisine, random_steps, sine, wave
from mjcf_builders import HEAVY, Damper, Sensor, compiled, document, drive, grid, slider
from mrdamp.model import core
from networks import Network, random_network
from refusals import refuses

NETWORKS = {
    "linear": random_network(1, ()),
    "one layer": random_network(2, (15,)),
    "two layers": random_network(3, (12, 7)),
}
END = 1.0  # s


def inputs(dt: float, kind: str) -> tuple[Array, Array, Array]:
    """x (m), v (m/s) and command: smooth, or random motion with jumps of the command every 50 ms."""
    t = grid(END, dt)
    if kind == "smooth":
        x, v, _ = sine(0.004, 2.0, phase=0.4).sample(t)
        return x, v, wave(0.2, 1.0, 1.3).sample(t)
    x, v, _ = multisine(0.002, 0.5, 8.0, seed=2).sample(t)
    return x, v, random_steps(0.0, 1.2, 0.05, 20, seed=8).sample(t)


def rig(
    timestep: float, *, weights: str = "text:net", extra: str = "", more: dict[str, float] | None = None
) -> str:
    damper = Damper("narx", {"weights": weights, **(more or {})})
    return document(slider(HEAVY), [damper], (Sensor(),), timestep=timestep, extra=extra)


def custom(net: Network) -> str:
    return f'<custom><text name="net" data="{net.text()}"/></custom>'


@pytest.mark.parametrize("kind", ["smooth", "jumps"])
@pytest.mark.parametrize("name", NETWORKS)
def test_free_run_at_its_own_sample_time_is_that_of_numpy(name: str, kind: str) -> None:
    """Of the C entry and in MuJoCo."""
    net = NETWORKS[name]
    x, v, u = inputs(net.sample_time, kind)
    expected = net.free_run(x, v, u)
    assert rms(expected - np.mean(expected)) > 2.0  # there is something to compare
    found = [
        core.run("narx", {}, net.sample_time, x, v, u=u, hold=hold, narx=core.Narx(net.text()))["force"]
        for hold in (False, True)
    ]
    start = {"command_start": float(u[0])}  # the network's past holds the first command
    found.append(drive(rig(net.sample_time, extra=custom(net), more=start), x, v, u)["force"])
    for force in found:
        np.testing.assert_allclose(force, expected, rtol=0.0, atol=1e-9 * rms(expected))


@pytest.mark.parametrize("ratio", [0.1, 0.5, 0.37, 1.3, 2.5])
@pytest.mark.parametrize("name", NETWORKS)
def test_other_timesteps_give_nearly_the_same_force(name: str, ratio: float) -> None:
    """Timesteps shorter and longer than the network's sample time, and in no simple ratio to it."""
    net = NETWORKS[name]
    dt = ratio * net.sample_time
    fine = grid(END, net.sample_time)
    expected = net.free_run(*inputs(net.sample_time, "smooth"))
    x, v, u = inputs(dt, "smooth")
    found = drive(rig(dt, extra=custom(net)), x, v, u)["force"]
    there = np.interp(np.arange(len(x)) * dt, fine, expected)
    late = slice(round(0.05 / dt), round(0.98 * END / dt))  # behind the start from no force
    assert rms(found[late] - there[late]) < 0.03 * rms(there[late] - np.mean(there))


def test_effects_act_on_a_network_too() -> None:
    """A gas spring and a driver's lag: the network sees the lagged current."""
    net = NETWORKS["one layer"]
    dt, tau = net.sample_time, 0.02
    x, v, _ = inputs(dt, "smooth")
    u = np.where(np.arange(len(x)) * dt < 0.3, 0.2, 1.1)
    current = np.full(len(x), u[0])
    for k in range(1, len(x)):
        current[k] = u[k - 1] + (current[k - 1] - u[k - 1]) * np.exp(-dt / tau)
    expected = net.free_run(x, v, current) + 2e4 * x
    more = {"driver_lag_tau": tau, "gas_spring_k": 2e4, "command_start": 0.2}
    found = drive(rig(dt, extra=custom(net), more=more), x, v, u)["force"]
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9 * rms(expected))


def test_weights_from_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An absolute path, one relative to the working folder, and one in a folder of MRDAMP_PATH."""
    net = NETWORKS["two layers"]
    x, v, u = (channel[:100] for channel in inputs(net.sample_time, "jumps"))
    expected = drive(rig(net.sample_time, extra=custom(net)), x, v, u)["force"]
    (tmp_path / "far").mkdir()
    (tmp_path / "far" / "net.txt").write_text(net.text())
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("MRDAMP_PATH", raising=False)
    for weights in (str(tmp_path / "far" / "net.txt"), "far/net.txt"):
        found = drive(rig(net.sample_time, weights=weights), x, v, u)["force"]
        np.testing.assert_array_equal(found, expected)
    with pytest.raises(ValueError, match="no such file"):
        compiled(rig(net.sample_time, weights="net.txt"))
    monkeypatch.setenv("MRDAMP_PATH", f"{tmp_path}/near:{tmp_path}/far")
    found = drive(rig(net.sample_time, weights="net.txt"), x, v, u)["force"]
    np.testing.assert_array_equal(found, expected)


BROKEN = (
    ("version", "mrdamp-narx 1", "mrdamp-narx 2", "outside"),
    ("keyword", "sample_time", "sampletime", "`sampletime` where `sample_time` is expected"),
    ("channel", "F:1", "G:1", "`G:1` is none of"),
    ("lag of the force", "F:1", "F:0", "`F:0` is none of"),
    ("lag too long", "F:5", "F:33", "`F:33` is none of"),
    ("number", "sample_time 0.002", "sample_time 0,002", "`0,002` is not a finite number"),
    ("not finite", "sample_time 0.002", "sample_time nan", "`nan` is not a finite number"),
    ("sample time", "sample_time 0.002", "sample_time 0", "outside"),
    ("layers", "hidden 1 15", "hidden 3 15", "outside"),
    ("units", "hidden 1 15", "hidden 1 14", "is expected"),
    ("text behind the end", "end", "end more", "goes on behind `end`"),
    ("cut off", "bias", "", "where `bias` is expected"),
)


@pytest.mark.parametrize("row", BROKEN, ids=lambda row: row[0])
def test_broken_weights_are_named_in_one_line(row: tuple[str, str, str, str]) -> None:
    _, old, new, message = row
    text = NETWORKS["one layer"].text()
    assert old in text
    refuses(lambda: core.Narx(text.replace(old, new, 1)), f"^NARX weights: .*{re.escape(message)}")
