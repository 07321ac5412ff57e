"""Records: channels, derivatives, parts, other rates, saving, and sets that are fitted to and held out."""

from __future__ import annotations

import gzip
import os
from pathlib import Path

import numpy as np
import pytest

from mrdamp.identify import identify
from mrdamp.records import Record, RecordSet, read_record, read_records
from mrdamp.records.checks import check_sign, warnings_of
from record_tables import HEADER, table, write
from refusals import refuses


def sine(n: int = 2001, dt: float = 0.001, f: float = 2.0, extra: bool = False) -> Record:
    t = np.arange(n) * dt
    w = 2 * np.pi * f
    channels = {"displacement_m": 0.003 * np.sin(w * t), "command": np.where(t < 1.0, 0.2, 0.9)}
    channels["force_N"] = 100 * np.cos(w * t)
    if extra:
        channels["velocity_m_s"] = 0.0033 * w * np.cos(w * t)
    return Record("sine", None, dt, channels)


def test_reads_channels_in_file_order(tmp_path: Path) -> None:
    lines = table(header="force_N,time_s,command,displacement_m")
    lines[1:] = [f"{k},{k * 0.002:.3f},0.5,{k * 1e-5:.6f}" for k in range(20)]
    record = read_record(write(tmp_path, lines, "one.two.csv"))
    assert list(record.channels) == ["force_N", "time_s", "command", "displacement_m"]
    assert record.name == "one.two"
    assert record.n == 20
    assert record.sample_time == pytest.approx(0.002, rel=1e-12)
    assert record.duration == pytest.approx(0.038, rel=1e-12)
    assert record.force is not None
    np.testing.assert_array_equal(record.force, np.arange(20.0))
    np.testing.assert_allclose(record.displacement, np.arange(20) * 1e-5, rtol=1e-12)
    assert not record.displacement.flags.writeable


def test_velocity_and_acceleration_of_a_sine() -> None:
    record = sine()
    w, t = 4 * np.pi, record.time
    v, a = 0.003 * w * np.cos(w * t), -0.003 * w**2 * np.sin(w * t)
    assert np.abs(record.velocity() - v).max() < 1e-4 * 0.003 * w * 2
    assert np.abs(record.acceleration()[2:-2] - a[2:-2]).max() < 1e-4 * 0.003 * w**2
    inside = slice(200, -200)
    assert np.abs(record.velocity(60.0) - v)[inside].max() < 2e-3 * 0.003 * w
    refuses(lambda: record.velocity(500.0), "cutoff_hz is 500: it must lie between 0 and 500")


def test_the_velocity_is_the_displacements_whether_one_was_measured_or_not() -> None:
    record = sine(extra=True)
    np.testing.assert_array_equal(record.velocity(), sine().velocity())
    measured = record.with_channels({"acceleration_m_s2": np.full(record.n, 3.0)})
    np.testing.assert_array_equal(measured.acceleration(), 3.0)


@pytest.mark.parametrize(("factor", "ratio"), [(1e3, "1.1e[+]03"), (-1.0, "-1.1"), (0.0, "0"), (1 / 3, "0.367")])
def test_a_measured_velocity_of_another_unit_is_refused(factor: float, ratio: str, tmp_path: Path) -> None:
    record = sine(extra=True)
    noise = 1e-5 * np.random.default_rng(0).standard_normal(record.n)
    noisy = record.with_channels({"displacement_m": record.displacement + noise})
    noisy.save(tmp_path / "a.csv")
    assert read_record(tmp_path / "a.csv").n == record.n
    noisy.with_channels({"velocity_m_s": factor * record.channel("velocity_m_s")}).save(tmp_path / "b.csv")
    refuses(lambda: read_record(tmp_path / "b.csv"), f"velocity_m_s is {ratio} times the rate of displacement_m")


def test_a_force_of_the_other_sign_is_refused() -> None:
    """A dashpot takes the power c v^2; turned, it gives as much. A preload and a spring do not count."""
    record = sine(extra=True)
    force = 200.0 * record.velocity() + 5e3 * record.displacement + 30.0
    right, turned = (record.with_channels({"force_N": f}) for f in (force, -force))
    check_sign(right)
    assert not warnings_of([right])
    check_sign(record.with_channels({"force_N": 3.0 * record.acceleration()}))  # a mass takes nothing and gives nothing
    watt = -200.0 * float(np.mean(record.velocity() ** 2))
    said = f"force_N: the damper would drive the rig .* {watt:.3g} W"
    refuses(lambda: check_sign(turned), said)
    refuses(lambda: identify("bingham", [right, turned]), said)
    assert len(warnings_of([right, turned])) == 1


def test_no_file_is_waited_for_or_read_without_end(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.csv")
    (tmp_path / "zero.csv").symlink_to("/dev/zero")
    for name in ("pipe.csv", "zero.csv"):
        refuses(lambda n=name: read_record(tmp_path / n), "is a device or a pipe")  # type: ignore[misc]
    (tmp_path / "bomb.csv.gz").write_bytes(13 * gzip.compress(bytes(40 << 20), 1))
    refuses(lambda: read_record(tmp_path / "bomb.csv.gz"), "more than 512 MiB")


@pytest.mark.parametrize(("frequency", "gain"), [(5.0, 16 / 17), (10.0, 1 / 2), (20.0, 1 / 17)])
def test_lowpass_gain(frequency: float, gain: float) -> None:
    """1 / (1 + (f / f_c)^4): a second-order Butterworth run twice."""
    t = np.arange(20000) * 1e-3
    record = Record("a", None, 1e-3, {"acceleration_m_s2": np.sin(2 * np.pi * frequency * t)})
    assert np.abs(record.acceleration(10.0)[8000:12000]).max() == pytest.approx(gain, rel=0.02)


def test_signals_as_the_foam_paper_takes_them() -> None:
    """Zero means, and 60 and 110 Hz of both channels through a low-pass at 80 Hz: 1 / (1 + (f / 80)^4), about."""
    t = np.arange(2048) / 256
    wave = {f: np.sin(2 * np.pi * f * t) for f in (2.0, 60.0, 110.0)}
    total = np.sum(list(wave.values()), axis=0)
    channels = {"displacement_m": 0.01 * total + 0.3, "force_N": 9.0 * total - 4.0}
    record = Record("a", None, 1 / 256, {"command": 0 * t, **channels})
    taken = RecordSet("s", (record,), (record,), (record,)).smoothed(80.0, force=True, zero_mean=True)
    for one in taken:
        for name, size in (("displacement_m", 0.01), ("force_N", 9.0)):
            x = one.channel(name)
            assert abs(x.mean()) < 1e-9
            parts = {f: 2 * np.abs(np.mean(x * np.exp(-2j * np.pi * f * t))) / size for f in wave}
            assert parts[2.0] == pytest.approx(1.0, abs=0.01)
            assert 0.6 < parts[60.0] < 0.9
            assert parts[110.0] < 0.1
    only = RecordSet("s", (record,), ()).smoothed(80.0)
    np.testing.assert_array_equal(only.train[0].channel("force_N"), record.channel("force_N"))


def test_test_records_stand_apart_and_a_folder_goes_before_a_set_of_the_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert len(read_records("foam").test) == 5
    for half in ("train", "validation", "test"):
        (tmp_path / "foam" / half).mkdir(parents=True)
        sine(f=len(half)).save(tmp_path / "foam" / half / f"{half}.csv")
    found = read_records("foam")
    assert [r.name for r in found.test] == ["test"]
    assert [r.name for r in found.held_out] == ["validation", "test"]
    assert [r.name for r in found] == ["train", "validation", "test"]


def test_part_keeps_its_stamps() -> None:
    part = sine().part(0.5, 1.25)
    assert (part.n, part.time[0], part.time[-1]) == (751, pytest.approx(0.5), pytest.approx(1.25))
    np.testing.assert_array_equal(part.displacement, sine().displacement[500:1251])
    refuses(lambda: sine().part(1.0, 1.001), "fewer than 3 samples from 1 to 1.001 s; the record runs from 0 to 2 s")


@pytest.mark.parametrize("dt", [0.0005, 0.002, 0.004, 0.0013])
def test_resample_keeps_the_signal_and_the_steps_of_the_command(dt: float) -> None:
    record = sine().part(0.25, 2.0).resample(dt)
    assert record.sample_time == dt
    assert record.time[0] == 0.25
    assert record.time[-1] <= 2.0 + 1e-12
    assert record.n == int(1.75 / dt + 1e-9) + 1
    x = 0.003 * np.sin(4 * np.pi * record.time)
    assert np.abs(record.displacement - x)[30:-30].max() < 0.01 * 0.003
    assert set(np.round(record.command, 12)) <= {0.2, 0.9} or dt == 0.0005 or dt == 0.0013
    assert record.command.min() >= 0.2
    assert record.command.max() <= 0.9


def test_resample_does_not_fold_noise_back() -> None:
    rng = np.random.default_rng(3)
    noise = Record("n", None, 1e-3, {"force_N": rng.standard_normal(40000)}).resample(0.01)
    assert noise.force is not None
    assert np.var(noise.force) == pytest.approx(0.08, rel=0.2)  # 40 Hz of 500


@pytest.mark.parametrize("name", ["out.csv", "out.csv.gz"])
def test_save_and_read_back(tmp_path: Path, name: str) -> None:
    record = sine(extra=True)
    record.save(tmp_path / name)
    back = read_record(tmp_path / name)
    assert list(back.channels) == list(record.channels)
    for channel, x in record.channels.items():
        np.testing.assert_allclose(back.channels[channel], x, rtol=1e-8, atol=1e-12)
    assert os.listdir(tmp_path) == [name]
    first = (tmp_path / name).read_bytes()
    record.save(tmp_path / name)
    assert (tmp_path / name).read_bytes() == first
    if name.endswith(".gz"):
        assert first[3:8] == bytes(5)  # no name and no time in the gzip header
    refuses(lambda: record.save(tmp_path / "a.npz"), r"written as \.csv")


@pytest.mark.parametrize(
    ("channels", "expected"),
    [
        ({"force_N": [1.0, 2.0]}, "2 samples"),
        ({"force_N": [1.0, 2.0, np.nan]}, "NaN"),
        ({"force_N": [1.0, 2.0, 3.0], "command": [1.0] * 4}, "equally long"),
    ],
)
def test_record_refuses(channels: dict[str, list[float]], expected: str) -> None:
    refuses(lambda: Record("a", None, 0.1, {name: np.array(x) for name, x in channels.items()}), expected)


def names(records: tuple[Record, ...]) -> list[str]:
    return [record.name for record in records]


def test_a_sample_time_that_is_not_the_clocks_is_refused() -> None:
    channels = sine(n=100).channels
    refuses(lambda: Record("r", None, 0.002, channels), "sample time 0.002 s, but time_s has steps of 0.001 s")


def test_flat_folder_holds_out_every_third_record(tmp_path: Path) -> None:
    for k in range(7):
        write(tmp_path, table(50 + k), f"{k}.csv")
    (tmp_path / "case.json").write_text("{}")
    (tmp_path / ".0.csv").write_text("hidden")
    found = read_records(tmp_path)
    assert found.name == tmp_path.name
    assert names(found.train) == ["0", "1", "3", "4", "6"]
    assert names(found.validation) == ["2", "5"]
    assert len(found) == 7
    assert found["5"].n == 55
    refuses(lambda: found["9"], "no record '9'")
    (tmp_path / "8.csv").symlink_to(tmp_path / "gone.csv")
    refuses(lambda: read_records(tmp_path), r"8\.csv: a link to nothing")
    two = read_records([write(tmp_path, table(50 + k), f"{name}.csv") for k, name in enumerate("ba")])
    assert (names(two.train), names(two.validation)) == (["a"], ["b"])


def test_no_record_is_held_out_whose_command_the_rest_does_not_reach(tmp_path: Path) -> None:
    for name, command in (("a", 0.0), ("b", 0.5), ("c", 1.0), ("d", 0.5), ("e", 0.0), ("f", 0.5)):
        write(tmp_path, [HEADER, *(f"{0.002 * k:.3f},{k % 7},{command},{ord(name)}" for k in range(60))], f"{name}.csv")
    found = read_records(tmp_path)
    assert len(found.validation) == 2
    assert "c" not in names(found.validation)


def test_a_repeat_stays_with_the_test_it_repeats(tmp_path: Path) -> None:
    for k in range(5):
        rows = [f"{j * 0.002:.3f},{k},{k * j % 7},1" for j in range(60)]
        write(tmp_path, [HEADER, *rows], f"{k}.csv")
    for k, side in ((2, "validation"), (3, "train")):
        (tmp_path / "5_repeat.csv").write_text((tmp_path / f"{k}.csv").read_text().replace(",1\n", ",1.5\n"))
        assert "5_repeat" in names(getattr(read_records(tmp_path), side))


def test_one_record_is_cut_in_time(tmp_path: Path) -> None:
    found = read_records(write(tmp_path, table(301)))
    (fitted,), (held_out,) = found.train, found.validation
    assert held_out.n == 301
    assert held_out.lead == fitted.n == pytest.approx(201, abs=3)
    assert held_out.resample(0.001).lead == 2 * fitted.n
    assert [(r.n, r.lead) for r in found.whole] == [(301, 0)]


def test_sets_that_are_none(tmp_path: Path) -> None:
    refuses(lambda: read_records(tmp_path / "nowhere"), "no such folder or file")
    refuses(lambda: read_records(tmp_path), r"no \.csv or \.csv\.gz")
    refuses(lambda: read_records([]), "no records")
    write(tmp_path, table(), "a.csv")
    (tmp_path / "a.csv.gz").write_bytes(gzip.compress("\n".join(table()).encode()))
    refuses(lambda: read_records(tmp_path), "two records are named a")
    (tmp_path / "train").mkdir()
    refuses(lambda: read_records(tmp_path), "a set has both")
    (tmp_path / "validation").mkdir()
    refuses(lambda: read_records(tmp_path), r": no \.csv")


def test_a_record_that_is_there_twice_is_refused(tmp_path: Path) -> None:
    lines = table()
    for digit, name in enumerate(("a.csv", "b.csv", "c.csv")):
        lines[9] = f"{lines[9]}{digit}"  # a digit of one force: another record
        write(tmp_path, lines, name)
    assert len(read_records(tmp_path)) == 3
    write(tmp_path, lines, "d.csv")
    refuses(lambda: read_records(tmp_path), r"d\.csv: it holds the same samples as .*c\.csv")
    for half, name in (("train", "e.csv"), ("validation", "f.csv")):
        (tmp_path / half).mkdir()
        write(tmp_path / half, lines, name)
    refuses(lambda: read_records(tmp_path), r"f\.csv: it holds the same samples as .*e\.csv")
