"""The commands identify, table1 and calibrate, as a user calls them; errors and norms by hand."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

from command_call import caller
from laboratory import grid, straight
from mrdamp.commands import calibrate, identify
from mrdamp.identify import simulate
from mrdamp.identify.comparison import paper_network, table_1
from mrdamp.identify.norms import CENTIMETRE, delta_1, delta_2, foam_norms, nrmse, record_norms, rmse
from mrdamp.model import Model
from mrdamp.records import Record, RecordSet, read_record, read_records
from mrdamp.simulation.predict import predict
from refusals import refuses

run = caller(identify.add_to, calibrate.add_to)


def run_bingham(folder: Path, *arguments: str | Path) -> int:
    return run("identify", folder, "--law", "bingham", "--starts", "1", *arguments)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("set")
    for half, commands, seed in (("train", (0.0, 0.6, 1.2), 0), ("validation", (0.3, 0.9), 50)):
        (root / half).mkdir()
        for record in grid(straight, commands, seed):
            record.save(root / half / f"{record.name}.csv.gz")
    return root


def test_intervals_and_json_that_holds_the_figures_of_the_text(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "model.json"
    assert run_bingham(folder, "--intervals", "-o", out, "--resamples", "20", "--json") == 0
    said = capsys.readouterr()
    report, lines = json.loads(said.out), said.err.splitlines()
    assert Model.read(out).parameters["fyb"] == pytest.approx(300.0, rel=0.03)
    assert report["model"] == str(out)
    assert report["attributes"] == pytest.approx(Model.read(out).attributes)
    offset = next(line for line in lines if "force offset or preload" in line)
    assert float(offset.split()[-2]) == pytest.approx(12.0, abs=0.5)
    rows = report["held_out"]["records"]
    for row in rows:
        line = next(line.split() for line in lines if line.split()[:1] == [row["record"]])
        assert float(line[-3]) == pytest.approx(row["rmse_N"], abs=0.06)
        assert float(line[-1]) == pytest.approx(row["nrmse"], abs=6e-4)
    assert len(rows) == 2 * len(report["fitted"]["records"]) / 3
    (slope,) = (i for i in report["intervals"] if i["parameter"] == "fyb")
    assert slope["low"] < 300.0 < slope["high"]
    assert slope["not_identifiable"] is None
    told = {line.split()[0]: line.split() for line in lines if line.startswith("       ")}
    assert float(told["fyb"][2]) < 300.0 < float(told["fyb"][3])


def test_table1(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Bingham's row is the error of that law's own identification."""
    picture = tmp_path / "t.svg"
    run_bingham(folder, "-o", tmp_path / "m.json")
    alone = float(capsys.readouterr().out.split("held-out records ")[1].split()[0])
    assert run("table1", folder, "--starts", "1", "--no-network", "--json", "--picture", picture) == 0
    assert "<svg" in picture.read_text()
    said = capsys.readouterr()
    found = json.loads(said.out)
    rows = {row["model"]: row for row in found["rows"]}
    assert list(rows) == ["bingham", "bouc_wen", "hyperbolic_tangent"]
    assert rows["bingham"]["nrmse"] == pytest.approx(alone, abs=6e-4)
    assert rows["bingham"]["nrmse"] < 0.03
    assert rows["bingham"]["paper"]["e_t"] == 0.4734
    assert found["held_out"] == ["0.3A_4mm", "0.3A_8mm", "0.9A_4mm", "0.9A_8mm"]
    (told,) = (line.split() for line in said.err.splitlines() if line.split()[:1] == ["bingham"])
    assert float(told[4]) == pytest.approx(rows["bingham"]["nrmse"], abs=6e-4)


def test_both_papers_measures_and_loops_of_a_law(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Against the papers' formulas, on a law that is half of the damper's."""
    out, picture = tmp_path / "m.json", tmp_path / "loops.png"
    assert run_bingham(folder, "--extras", "-o", out, "--norms", "--json", "--picture", picture) == 0
    assert Model.read(out).effects == ()
    report = json.loads(capsys.readouterr().out)
    record = next(r for r in read_records(folder).validation if r.name == "0.3A_4mm")
    (row,) = (r for r in report["norms"] if r["record"] == record.name)
    skip = round(0.02 / record.sample_time)
    force = record.channel("force_N")[skip:]
    gap = (simulate(Model.read(out), record)[skip:] - force) ** 2
    weight = 100 * np.abs(record.velocity()[skip:])  # cm/s
    assert row["delta_2"] == pytest.approx(np.sqrt(np.mean(gap) / np.mean(force**2)), rel=1e-6)
    assert row["e_t"] == pytest.approx(np.sqrt(np.mean(gap)) / np.std(force), rel=1e-2)
    assert row["e_x"] == pytest.approx(np.sqrt(np.mean(gap * weight)) / np.std(force), rel=2e-2)
    assert row["e_v"] > 0
    assert picture.stat().st_size > 5000


def test_force_from_charge(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A charge of known sensitivity and lag: 2 degrees of lag are an error of sin 2, whatever the paper's 90 is."""
    dt, lag, size = 1e-3, math.radians(2.0), 800.0
    t = dt * np.arange(6000)
    tests, records = tmp_path / "tests", tmp_path / "records"
    tests.mkdir()
    records.mkdir()
    for k, hz in enumerate((4.0, 1.0, 2.0)):
        w = 2 * np.pi * hz
        columns = {
            "time_s": t,
            "reference_force_N": size * np.sin(w * t),
            "charge_pC": -158.248 * math.cos(lag) * size * np.sin(w * t - lag),
        }
        rows = np.column_stack(list(columns.values()))
        np.savetxt(tests / f"{k}.csv", rows, delimiter=",", header=",".join(columns), comments="", fmt="%.9g")
        extra = {"displacement_m": 1e-3 * np.cos(w * t), "command": np.full(len(t), 0.5 * (k > 0))}
        Record(f"r{k}", None, dt, {**extra, **columns}).save(records / f"r{k}.csv")
    picture = tmp_path / "sensitivities.png"
    assert run("calibrate", tests, "--records", records, "--picture", picture, "-o", tmp_path / "out") == 0
    assert picture.is_file()
    text = capsys.readouterr().out
    assert re.findall(r"^ +(\S+) Hz", text, re.MULTILINE) == ["1.00", "2.00", "4.00"]
    assert "mean sensitivity -158.25 pC/N, delta_1 with it 3.49 %" in text
    assert "command      0.5    3.49 %   3.49 %  2 records  the paper's damper 2.30 %" in text
    made = read_record(tmp_path / "out" / "records" / "r1.csv")
    error = made.channel("force_N") - made.channel("reference_force_N")
    assert np.sqrt(2 * np.mean(error**2)) == pytest.approx(size * math.sin(lag), rel=1e-4)
    page = (tmp_path / "out" / "index.html").read_text()
    assert page.count("<svg") == 4
    alone = {name: made.channel(name) for name in ("displacement_m", "command", "charge_pC")}
    (tmp_path / "one").mkdir()
    Record("alone", None, dt, alone).save(tmp_path / "one" / "alone.csv")
    for given in (tmp_path / "one", tmp_path / "one" / "alone.csv"):
        assert run("calibrate", tests, "--records", given, "-o", tmp_path / "out") == 0
        assert read_record(tmp_path / "out" / "records" / "alone.csv").n == made.n


@pytest.mark.parametrize(
    ("call", "said"),
    [
        ("identify {set} --law bingham --page {here}/p.html -o {here}/m.json",
         r"--page is for a network \(--law narx\); the law is bingham"),
        ("identify {set} --law bingham --follows k1 -o {here}/m.json",
         "no coefficient k1 that may follow the command; allowed: c0, fy"),
        ("table1 {set} --network {here}/bingham.json", "law bingham; --network takes a network"),
    ],
)  # fmt: skip
def test_bad_requests_are_told(call: str, said: str, folder: Path, tmp_path: Path) -> None:
    law = {"c0a": 1.0, "c0b": 0.0, "fya": 1.0, "fyb": 0.0, "v_ref": 0.01}
    Model("bingham", law).write(tmp_path / "bingham.json")
    refuses(lambda: run(*call.format(set=folder, here=tmp_path).split()), said)


def test_the_error_of_the_file_is_told_beside_that_of_prepared_records(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of means taken off, the force's and the displacement's, `predict` knows nothing."""
    for record in read_records(folder):
        record.with_channels({"force_N": record.channel("force_N") + 300.0}).save(tmp_path / f"{record.name}.csv")
    out = tmp_path / "m.json"
    assert run_bingham(tmp_path, "--zero-mean", "--extras", "-o", out) == 0
    said = next(line for line in capsys.readouterr().out.splitlines() if "as they are" in line)
    told = float(said.split()[-1])
    held = read_records(tmp_path).validation
    force = [predict(Model.read(out), r)["force_N"] for r in held]
    squares = [np.mean((f - r.channel("force_N"))[10:] ** 2) for f, r in zip(force, held, strict=True)]
    spread = [np.var(r.channel("force_N")[10:]) for r in held]
    assert told == pytest.approx(float(np.sqrt(np.mean(squares) / np.mean(spread))), rel=0.02)
    assert told > 0.3


def test_table_1_of_a_network_that_is_off_by_a_constant() -> None:
    train, held = grid(straight, (0.0, 0.8)), grid(straight, (0.4,), seed=50)
    records = RecordSet("grid", tuple(train), tuple(held))
    # A "network" that is 3 N off throughout: its figures are known.
    network = {r.name: r.channel("force_N") + 3.0 for r in held}
    table = table_1(records, ("bingham",), {"network": network}, starts=1)
    rows = {row.model: row for row in table.rows}
    deviation = np.sqrt(np.mean([np.var(r.channel("force_N")) for r in held]))
    assert rows["network"].norms.e_t == pytest.approx(3.0 / deviation, rel=0.01)
    assert rows["network"].nrmse == pytest.approx(3.0 / deviation, rel=0.01)
    speed = np.mean([np.mean(np.abs(r.velocity())) for r in held]) * 100  # cm/s
    assert rows["network"].norms.e_x == pytest.approx(3.0 / deviation * np.sqrt(speed), rel=0.01)
    assert rows["bingham"].nrmse == pytest.approx(table.fits["bingham"].held_out_nrmse, rel=1e-9)
    assert rows["bingham"].paper is not None
    # One cycle of 2 Hz at 500 Hz is the last 251 samples.
    one = table_1(records, (), {"network": network}, condition=held[0].name, starts=1).rows[0]
    assert one.norms.e_t == pytest.approx(3.0 / np.std(held[0].channel("force_N")[-251:]), rel=1e-6)


@pytest.mark.slow
def test_the_papers_network_is_not_chosen_on_the_held_out_records() -> None:
    """10 and 4 units over four samples of four channels; other held-out forces give the same weights."""
    train, held = grid(straight, (0.0, 0.8)), grid(straight, (0.4,), seed=50)[:1]
    fit = paper_network(RecordSet("grid", tuple(train[:1] + train[2:3]), tuple(held)), initialisations=1)
    assert fit.network.topology == "16-10-4-1"
    assert {channel for channel, _ in fit.network.inputs} == set("xviF")
    other = held[0].with_channels({"force_N": 0.5 * held[0].channel("force_N")})
    again = paper_network(RecordSet("grid", tuple(train[:1] + train[2:3]), (other,)), initialisations=1)
    np.testing.assert_array_equal(again.network.theta, fit.network.theta)
    assert again.free_run.test[0].rmse != pytest.approx(fit.free_run.test[0].rmse, rel=0.1)


def test_rmse_and_its_relatives_by_hand() -> None:
    measured = np.array([1.0, 3.0, 5.0, 7.0])  # mean 4, variance 5, mean square 21
    simulated = measured + np.array([2.0, 0.0, -2.0, 0.0])  # mean squared error 2
    assert rmse(measured, simulated) == pytest.approx(math.sqrt(2))
    assert nrmse(measured, simulated) == pytest.approx(math.sqrt(2 / 5))
    assert delta_1(measured, simulated) == pytest.approx(math.sqrt(2 / 5))
    assert delta_2(measured, simulated) == pytest.approx(math.sqrt(2 / 21))


def test_eq_9_in_closed_form() -> None:
    # F = cos wt and an error e cos wt under x = X sin wt, over whole periods: <cos^2 |cos|> = 4/(3 pi),
    # <cos^2 |sin|> = 2/(3 pi), deviation 1/sqrt 2.
    w, size, stroke, n = 2 * math.pi * 4.0, 0.1, 0.008, 20000
    t = np.arange(n + 1) / n  # four periods
    force = np.cos(w * t)
    found = foam_norms(t[1], force, (1 - size) * force, stroke * w * force, -stroke * w**2 * np.sin(w * t))
    assert found.e_t == pytest.approx(size, rel=1e-4)
    assert found.e_x == pytest.approx(size * math.sqrt(2 * stroke * w * 4 / (3 * math.pi)), rel=1e-3)
    assert found.e_v == pytest.approx(size * math.sqrt(2 * stroke * w**2 * 2 / (3 * math.pi)), rel=1e-3)
    cm = foam_norms(
        t[1], force, (1 - size) * force, stroke * w * force, -stroke * w**2 * np.sin(w * t), CENTIMETRE
    )
    assert (cm.e_t, cm.e_x, cm.e_v) == pytest.approx((found.e_t, 10 * found.e_x, 10 * found.e_v))


def test_a_record_gives_its_own_velocity_and_acceleration() -> None:
    w, stroke, dt = 2 * math.pi * 2.0, 0.01, 0.001
    t = dt * np.arange(4001)
    force = 100 * np.cos(w * t)
    channels = {"displacement_m": stroke * np.sin(w * t), "command": np.zeros(len(t)), "force_N": force}
    by_record = record_norms(Record("r", None, dt, channels), 0.9 * force)
    direct = foam_norms(dt, force, 0.9 * force, stroke * w * np.cos(w * t), stroke * w**2 * np.sin(w * t))
    assert by_record.e_t == pytest.approx(direct.e_t)
    assert by_record.e_x == pytest.approx(direct.e_x, rel=1e-3)
    assert by_record.e_v == pytest.approx(direct.e_v, rel=0.01)
