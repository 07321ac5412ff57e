"""NARX networks: the plugin's free run against NumPy's, other timesteps, where weights come from; and the commands as a
user calls them."""

from __future__ import annotations

import json
import re
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from command_call import caller
from dampers import rms
from excitation import Array, multisine, random_steps, sine, wave
from mjcf_builders import HEAVY, Damper, Sensor, compiled, document, drive, grid, slider
from mrdamp.commands.identify import add_to
from mrdamp.model import Model, core
from mrdamp.narx import splits
from mrdamp.narx.network import Network
from mrdamp.records import Record, embedded
from mrdamp.simulation.predict import predict
from narx_data import made, recursion
from networks import Network as Written
from networks import random_network, twin
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


def custom(net: Written) -> str:
    return f'<custom><text name="net" data="{net.text()}"/></custom>'


@pytest.mark.parametrize("kind", ["smooth", "jumps"])
@pytest.mark.parametrize("name", NETWORKS)
def test_free_run_at_its_own_sample_time_is_that_of_numpy(name: str, kind: str) -> None:
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
    ("lag too long", "F:5", "F:33", "`F:33` is none of"),
    ("not finite", "sample_time 0.002", "sample_time nan", "`nan` is not a finite number"),
    ("units", "hidden 1 15", "hidden 1 14", "is expected"),
)


@pytest.mark.parametrize("row", BROKEN, ids=lambda row: row[0])
def test_broken_weights_are_named_in_one_line(row: tuple[str, str, str, str]) -> None:
    _, old, new, message = row
    text = NETWORKS["one layer"].text()
    assert old in text
    for reader in (core.Narx, lambda weights: Model("narx", {}, weights=weights)):
        refuses(partial(reader, text.replace(old, new, 1)), f"^NARX weights: .*{re.escape(message)}")


SMALL = ("--law", "narx", "--hidden", "4", "--lags", "1", "--initialisations", "1")


run = caller(add_to)


def as_record(n: int, seed: int, name: str, command: float | None = None) -> Record:
    s = made(n, seed, name=name)
    channels = {"displacement_m": s.x, "velocity_m_s": s.v, "command": s.i, "force_N": s.force}
    if command is not None:
        i = np.full(n, command)
        noise = np.random.default_rng(seed).normal(0.0, 2.0, n)
        channels |= {"command": i, "force_N": recursion(s.x, s.v, i, s.sample_time) + noise}
    return Record(name, None, s.sample_time, channels)


def saved(root: Path, train: list[Record], validation: list[Record]) -> Path:
    for half, records in (("train", train), ("validation", validation)):
        (root / half).mkdir(parents=True)
        for r in records:
            r.save(root / half / f"{r.name}.csv.gz", digits=15)
    return root


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("set")
    return saved(root, [as_record(600, 1, "a"), as_record(500, 2, "b")], [as_record(400, 3, "c")])


def errors(text: str, record: str) -> tuple[float, float, float, float]:
    row = next(line.split() for line in text.splitlines() if line.split()[:1] == [record])
    return float(row[2]), float(row[4]), float(row[5]), float(row[7])


def test_both_errors_are_printed(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, picture, page = tmp_path / "m.json", tmp_path / "p.png", tmp_path / "p.html"
    assert run("identify", folder, *SMALL, "--json", "--picture", picture, "--page", page, "-o", out) == 0
    said = capsys.readouterr()
    text, report = said.err, json.loads(said.out)
    model = Model.read(out)
    assert model.weights is not None
    net = Network.from_text(model.weights)
    assert net.topology == "6-4-1"
    assert "narx 6-4-1: 33 weights" in text
    assert (report["topology"], report["weights"]) == ("6-4-1", 33)
    assert report["test"]["free_run"] == {"nrmse": None, "records": []}
    s = made(400, 3)
    found = errors(text, "c")
    for k, way in enumerate(("free_run", "one_step")):
        (row,) = report["validation"][way]["records"]
        assert row["record"] == "c"
        assert (row["rmse_N"], row["nrmse"]) == pytest.approx(found[2 * k : 2 * k + 2], rel=1e-3, abs=0.06)
    force = twin(net).free_run(s.x, s.v, s.i)[10:]
    assert found[0] == pytest.approx(float(np.sqrt(np.mean((force - s.force[10:]) ** 2))), abs=0.2)
    assert found[1] == pytest.approx(found[0] / float(np.std(s.force)), abs=2e-3)
    one = net.forward(s.regressors(net.inputs)[2:])
    assert found[2] == pytest.approx(float(np.sqrt(np.mean((one - s.force[2:]) ** 2))), abs=0.2)
    assert sorted(p.name for p in tmp_path.glob("*.png")) == ["p-free_run.png", "p-one_step.png"]
    assert "They are predicted as well as the training records" in page.read_text()


def test_protocol_of_varying_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One record in three parts; its share of the RMS force as the paper gives it; the others are tests."""
    name = "sine_5.0Hz_2.5mm_random_current"
    call = ("identify", *SMALL, "--protocol", "varying", "--record", name, "--counts", "1200:600:500")
    assert run(*call, "-o", tmp_path / "m.json") == 0
    text = capsys.readouterr().out
    rmse, _, one, _ = errors(text, f"{name}:test")
    force = embedded()[name].channel("force_N")[1800:2300]
    rms = float(np.sqrt(np.mean(force**2)))
    line = next(row for row in text.splitlines() if row.startswith("test part"))
    assert f"free run {rmse:.1f} N, {100 * rmse / rms:.2f}"[:-1] in line
    assert f"one step {one:.1f} N, {100 * one / rms:.2f}"[:-1] in line
    for other in ("sine_1.0Hz_2.5mm_random_current", "triangle_2.5Hz_2.5mm_random_current"):
        errors(text, other)  # the paper's testing sets 1 and 2
    # Beyond the commands that it was trained with it stays at their ends.
    model, record = Model.read(tmp_path / "m.json"), embedded()[name]
    low, high = record.command[:1200].min(), record.command[:1200].max()
    assert model.parameters == {"command_min": low, "command_max": high}
    beyond, ends = (
        predict(model, record.with_channels({"command": u}))["force_N"]
        for u in (1 - 3 * record.command, np.clip(1 - 3 * record.command, low, high))
    )
    np.testing.assert_array_equal(beyond, ends)


def test_protocols_take_the_records_that_they_say() -> None:
    half = splits.of_records(splits.at_constant_command(embedded(), 0.5))
    assert {s.name for s in half.train} == {"sine_5.0Hz_5.0mm_0.50A", "triangle_1.0Hz_5.0mm_0.50A"}
    assert {s.name for s in half.validation} == {"sine_2.5Hz_1.0mm_0.50A", "triangle_2.5Hz_5.0mm_0.50A"}
    assert (half.channels, half.lags, half.units) == ("vF", 4, (9,))
    whole = splits.of_records(embedded())
    assert (whole.channels, whole.lags, whole.units) == ("viF", 4, (20,))
    refuses(lambda: splits.varying_command(embedded(), counts=(90000, 9, 9)), "are too few for 90018 samples")


def test_bad_input_is_told_in_a_line(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "m.json"
    good = as_record(600, 1, "a")
    still = good.with_channels({"command": np.full(good.n, 0.5)})
    stuck = good.with_channels({"displacement_m": np.zeros(good.n)})
    cut = good.with_channels({"force_N": np.minimum(good.channel("force_N"), 300.0)})
    sets = {
        name: saved(tmp_path / name, [record.part(0.0, 0.6)], [record.part(0.6, 1.2)])
        for name, record in (("still", still), ("stuck", stuck), ("cut", cut))
    }
    cases: tuple[tuple[tuple[str | Path, ...], str], ...] = (
        ((sets["still"], *SMALL, "--inputs", "viF"), "the command never varies"),
        ((folder, *SMALL, "--protocol", "constant"), "no training record has a constant command"),
        ((sets["stuck"], *SMALL), "channel displacement_m is constant"),
        ((sets["cut"], *SMALL), "clipped"),
        ((folder, *SMALL, "--hidden", "90"), "1100 samples for 721 weights; at least 1442"),
    )
    for arguments, message in cases:
        refuses(partial(run, "identify", *arguments, "-o", out), message)
        assert not out.exists()
