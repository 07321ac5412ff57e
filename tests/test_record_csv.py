"""The CSV of a record: what is read, and what is refused with which line. Any bytes are one or the other."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mrdamp.errors import InputError
from mrdamp.files import decode
from mrdamp.records import csv_file as record_csv
from mrdamp.records import read_record
from mrdamp.records.channels import DAMPER_INPUTS
from record_tables import HEADER, message, table, write
from refusals import refuses


def test_gzip_windows_lines_byte_order_mark_and_end_blanks(tmp_path: Path) -> None:
    text = "\ufeff" + "\r\n".join(table()) + "\r\n\r\n"
    path = tmp_path / "a.csv.gz"
    path.write_bytes(gzip.compress(text.encode()))
    assert read_record(path).n == 50


@pytest.mark.parametrize(
    ("wrong", "right"),
    [
        ("velocity_mm_s", "velocity_m_s"), ("acceleration_g", "acceleration_m_s2"),
        ("floor2_acceleration_g", "floor2_acceleration_m_s2"), ("floor0_displacement_m", "floor1_displacement_m"),
        ("time_ms", "time_s"),
    ],
)  # fmt: skip
def test_wrong_unit_names_the_right_channel(tmp_path: Path, wrong: str, right: str) -> None:
    path = write(tmp_path, table(header=f"{HEADER},{wrong}"))
    assert f"{wrong!r} must be {right} " in message(path)


@pytest.mark.parametrize("name", ["force_N_filtered", "timestamp", "pressure_Pa", "voltage_V", "command_raw"])
def test_another_quantity_is_no_wrong_unit(tmp_path: Path, name: str) -> None:
    """It is ignored, and may hold text."""
    lines = [line + (f",{name}" if k == 0 else ",ok") for k, line in enumerate(table())]
    assert read_record(write(tmp_path, lines)).ignored == (name,)


def test_missing_channel_says_what_is_there(tmp_path: Path) -> None:
    text = message(write(tmp_path, table(header="time_s,displacement_m,force_N,extra")))
    assert "missing channel command; the file has time_s, displacement_m, force_N, extra;" in text
    assert "reference_force_N" in text
    text = message(write(tmp_path, table(header="displacement_m,command")), required=("command",))
    assert "missing channel time_s" in text


def test_frame_channels_decide_what_is_required(tmp_path: Path) -> None:
    head = "time_s,ground_acceleration_m_s2,command,floor1_acceleration_m_s2,floor12_displacement_m"
    assert "floor12_displacement_m" in read_record(write(tmp_path, table(header=head))).channels
    text = message(write(tmp_path, table(header="time_s,command,floor1_displacement_m")))
    assert "missing channel ground_acceleration_m_s2" in text
    text = message(write(tmp_path, table(header=head)), required=DAMPER_INPUTS)
    assert "missing channel displacement_m" in text


@pytest.mark.parametrize(
    ("row", "cell", "expected"),
    [
        (7, "0.014,nan,0.5,1", "line 9: displacement_m is NaN"),
        (7, "0.014,0.1,0.5,1e308", "line 9: force_N is 1e+308: every cell must be a finite number up to 1e+30"),
        (7, "0.014,0.1,,1", "line 9: command is empty"),
        (7, "0.014,0.1,0.5", "line 9 has 3 cells, 4 columns are needed"),
        (7, "0.014,0.1,1_0,1", "line 9: command is not a number"),
    ],
)
def test_bad_cells_are_found_with_their_line(tmp_path: Path, row: int, cell: str, expected: str) -> None:
    lines = table()
    lines[row + 1] = cell
    assert expected in message(write(tmp_path, lines))


def test_files_that_are_no_record(tmp_path: Path) -> None:
    good = gzip.compress("\n".join(table(500)).encode())
    cases: list[tuple[str, bytes, str]] = [
        ("empty.csv", b"", "the file is empty"),
        ("cut.csv.gz", good[: len(good) // 2], "truncated"),
        ("plain.csv.gz", b"time_s,command\n", "not gzip"),
        ("packed.csv", good, "must end in .gz"),
        ("semicolon.csv", b"time_s;displacement_m;command\n0;1;2\n", "separated by commas"),
        ("twice.csv", b"time_s,command,command,displacement_m\n", "two columns are named"),
        ("two.csv", b"time_s,displacement_m,command\n0,1,2\n1,1,2\n", "2 samples: at least 3"),
    ]
    for name, data, expected in cases:
        path = tmp_path / name
        path.write_bytes(data)
        assert expected in message(path), name
    assert "no such file" in message(tmp_path / "nowhere.csv")
    (tmp_path / "folder.csv").mkdir()
    assert "is a folder" in message(tmp_path / "folder.csv")


def stamped(folder: Path, stamps: list[str]) -> Path:
    return write(folder, ["time_s,displacement_m,command", *(f"{stamp},0,0" for stamp in stamps)])


@pytest.mark.parametrize("form", ["%.6f", "%.6g", "%.9g", "%.4f"])
@pytest.mark.parametrize("rate", [3004.8, 1000.0, 200.0, 50.0])
def test_rounded_stamps_are_uniform(tmp_path: Path, form: str, rate: float) -> None:
    n = 12000
    time = 3.25 + np.arange(n) / rate
    record = read_record(stamped(tmp_path, [form % t for t in time]))
    assert record.sample_time == pytest.approx(1.0 / rate, abs=1e-3 / (n - 1))
    np.testing.assert_allclose(record.time, time, atol=6e-4)
    assert np.ptp(np.diff(record.time)) < 1e-12


@pytest.mark.parametrize("rate", [3004.8, 1000.0])
@pytest.mark.parametrize("place", [1, 700, 3998])
def test_dropped_sample_is_found(tmp_path: Path, rate: float, place: int) -> None:
    stamps = [f"{k / rate:.6f}" for k in range(4000)]
    del stamps[place]
    text = message(stamped(tmp_path, stamps))
    assert f"line {place + 2}: non-uniform clock" in text


@pytest.mark.parametrize(
    ("index", "value", "expected"),
    [
        (40, 0.0795, "line 42: non-uniform clock"),  # a quarter of a step early
        (40, 0.078, "line 42: time_s does not increase: 0.078 after 0.078"),
        (99, 0.1985, "line 101: non-uniform clock"),
    ],
)
def test_one_bad_stamp_is_found(tmp_path: Path, index: int, value: float, expected: str) -> None:
    stamps = [f"{k * 0.002:.3f}" for k in range(100)]
    stamps[index] = f"{value:.4f}"
    assert expected in message(stamped(tmp_path, stamps))


def test_wandering_clock_is_found(tmp_path: Path) -> None:
    time = np.arange(5000) * 0.002
    pairs = 0.015 * 0.002 * (-1.0) ** np.arange(5000)
    jitter = np.random.default_rng(0).uniform(-0.1, 0.1, 5000) * 0.002
    for off in (2e-3 * np.sin(0.2 * time), pairs, jitter):
        assert "non-uniform clock" in message(stamped(tmp_path, [f"{t:.9g}" for t in time + off]))


def test_a_table_is_read_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Parts of 7 rows: the numbers are those of the cells, and a fault has the line of the whole file."""
    monkeypatch.setattr(record_csv, "_ROWS", 7)
    lines = table(50)
    channels, _, _ = record_csv.parse("a.csv", "\n".join(lines))
    for k, name in enumerate(HEADER.split(",")):
        assert channels[name].tolist() == [float(line.split(",")[k]) for line in lines[1:]]
    lines[23] = lines[23].replace(",", ",x", 1)
    refuses(lambda: record_csv.parse("a.csv", "\n".join(lines)), "line 24: displacement_m is not a number")


def parses_or_refuses(name: str, data: bytes) -> None:
    refusal = None
    try:
        channels, _, sample_time = record_csv.parse(name, decode(name, data))
    except InputError as error:
        refusal = str(error)
    if refusal is not None:
        assert refusal.startswith(name)
        assert "\n" not in refusal
        return
    sizes = {len(values) for values in channels.values()}
    assert len(sizes) == 1
    assert min(sizes) >= 3
    assert sample_time > 0.0
    assert all(np.isfinite(values).all() for values in channels.values())


CELLS = st.one_of(
    st.sampled_from(
        ["", "nan", "-inf", "1e999", "0e400", "1e-400", "1e308", "-1e308", "1d5", "0x1p3", "١", "1 2"]
    ),
    st.floats(allow_nan=False).map(repr),
    st.text(max_size=5),
)


@settings(max_examples=150, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 12), st.integers(0, 3), CELLS), max_size=4))
def test_any_cells_are_read_or_refused(changes: list[tuple[int, int, str]]) -> None:
    rows = [line.split(",") for line in table(12)]
    for row, column, cell in changes:
        rows[row][column] = cell
    parses_or_refuses("a.csv", "\n".join(",".join(row) for row in rows).encode("utf-8", "surrogatepass"))


def test_an_epochs_clock_keeps_its_steps() -> None:
    t = np.asarray(1.7e9 + 0.002 * np.arange(500), dtype=np.float64)
    columns = {"time_s": t, "displacement_m": np.zeros(500), "command": np.zeros(500)}
    lines = record_csv.render(columns).splitlines()[1:]
    found = np.array([float(line.split(",")[0]) for line in lines])
    np.testing.assert_allclose(np.diff(found), 0.002, atol=2e-6)  # a double of this size has steps of 0.24 us
