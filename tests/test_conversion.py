"""Tables as rigs write them become records: names, units, separators, clocks, signs; faults in a line each."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from mrdamp.cli import main
from mrdamp.errors import InputError
from mrdamp.records import read_record
from mrdamp.records.channels import CHANNELS
from mrdamp.records.conversion import Converted, column, convert

COLUMNS = ("time_s=t [ms]:ms", "displacement_m=LVDT:mm", "command=I coil:mA", "force_N=-Load:kN")
WAVE = 2 * np.pi * 2.0


def table(time: np.ndarray, separator: str = ",", decimal: str = ".", head: str = "") -> str:
    """5 mm at 2 Hz, 800 N against the motion counted the other way, 750 mA; time in s."""
    x, v = 5.0 * np.sin(WAVE * time), np.cos(WAVE * time)
    rows = [separator.join(["No", "t [ms]", "Load", "LVDT", "I coil", "note"])]
    for k, (t, a, b) in enumerate(zip(time, x, v, strict=True)):
        cells = [str(k), f"{1e3 * t:.6f}", f"{-0.8 * b:.9f}", f"{a:.9f}", "750", "ok"]
        rows.append(separator.join(cell.replace(".", decimal) for cell in cells))
    return head + "\n".join(rows) + "\n"


def converted(
    path: Path, text: str, columns: Sequence[str] = COLUMNS, rate: float | None = None
) -> Converted:
    path.write_text(text, encoding="utf-8")
    return convert(path, [column(c) for c in columns], rate)


EVEN = np.arange(1001) * 2e-3


def test_every_channel_has_a_unit_of_its_own() -> None:
    assert {column(f"{name}=a").factor for name in CHANNELS if "floorN" not in name} == {1.0}
    assert column("charge_pC=a:nC").factor == 1000.0


@pytest.mark.parametrize(
    ("separator", "decimal", "head"),
    [(",", ".", ""), (";", ",", ""), ("\t", ".", "Rig 7, room 3\nsampled: yes\n\n"), (";", ".", "a;b\n")],
)
def test_names_units_signs_and_separators(separator: str, decimal: str, head: str, tmp_path: Path) -> None:
    found = converted(tmp_path / "Test 1.TXT", table(EVEN, separator, decimal, head))
    record = found.record
    assert (record.name, found.steps) == ("Test 1", None)
    assert record.sample_time == pytest.approx(2e-3, rel=1e-9)
    np.testing.assert_allclose(record.displacement, 5e-3 * np.sin(WAVE * EVEN), atol=1e-11)
    np.testing.assert_allclose(record.channel("force_N"), 800.0 * np.cos(WAVE * EVEN), atol=1e-5)
    np.testing.assert_allclose(record.command, 0.75)


def test_a_line_of_units_is_passed_over(tmp_path: Path) -> None:
    lines = table(EVEN).split("\n")
    found = converted(tmp_path / "a.csv", "\n".join([lines[0], "-,ms,kN,mm,mA,-", *lines[1:]]))
    assert found.record.n == len(EVEN)


def test_a_clock_that_wanders_is_made_uniform(tmp_path: Path) -> None:
    time = np.cumsum(2e-3 + 4e-4 * np.sin(np.arange(1000) * 1.7))
    found = converted(tmp_path / "a.csv", table(time))
    assert found.steps == pytest.approx((1.6e-3, 2.4e-3), abs=2e-6)
    record = found.record
    assert record.sample_time == 2e-3
    np.testing.assert_allclose(record.displacement, 5e-3 * np.sin(WAVE * record.time), atol=2e-6)
    assert record.time[-1] == pytest.approx(time[-1], abs=2.5e-3)


def test_a_rate(tmp_path: Path) -> None:
    """Without a time column the rate is the file's own; with one the record is resampled."""
    own = converted(tmp_path / "a.csv", table(EVEN), COLUMNS[1:], 500.0).record
    np.testing.assert_allclose(own.time, EVEN, atol=1e-12)
    fewer = converted(tmp_path / "a.csv", table(EVEN), COLUMNS, 250.0).record
    assert fewer.sample_time == pytest.approx(4e-3)
    inner = slice(50, -50)
    wanted = 5e-3 * np.sin(WAVE * fewer.time)
    np.testing.assert_allclose(fewer.displacement[inner], wanted[inner], atol=2e-5)


def holed(text: str) -> str:
    lines = text.split("\n")
    return "\n".join(lines[:300] + lines[320:])


@pytest.mark.parametrize(
    ("columns", "change", "told"),
    [
        (("time_s=t [ms]:ms", "displacement_m=LVDT:mm", "command=I coil:mA", "force_N=Load:kN"), str,
         "the damper would drive the rig .* force_N=-NAME"),
        (("time_s=Zeit:s", *COLUMNS[1:]), str, r"no column 'Zeit'; the file has No, t \[ms\], Load"),
        (COLUMNS[1:], str, "no column is named for time_s"),
        (COLUMNS[:3], str, "no column is named for force_N"),
        ((*COLUMNS, "force_N=Load"), str, "a channel is named twice"),
        (COLUMNS, holed, r"sample 300: 0\.042 s are missing at 0\.596 s"),
        (COLUMNS, lambda text: text.replace("\n7,14.0", "\n7,4.0"), r"sample 8: the time does not increase"),
        (COLUMNS, lambda text: text.replace("750,ok\n9,", "x,ok\n9,"), r"line 10: I coil is not a number: 'x'"),
    ],
)  # fmt: skip
def test_faults_are_told(columns: tuple[str, ...], change: object, told: str, tmp_path: Path) -> None:
    assert callable(change)
    with pytest.raises(InputError, match=told):
        converted(tmp_path / "a.csv", change(table(EVEN)), columns)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("LVDT", "allowed: CHANNEL=NAME:UNIT"),
        ("stroke=LVDT:mm", "allowed: CHANNEL=NAME:UNIT"),
        ("displacement_m=LVDT:kN", "unit 'kN' is unknown; allowed: m, cm, mm, um, in"),
        ("displacement_m=:mm", "no name"),
    ],
)
def test_a_column_that_cannot_be(text: str, told: str) -> None:
    with pytest.raises(InputError, match=told):
        column(text)


def test_the_command_writes_what_is_read_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.txt").write_text(table(EVEN))
    (tmp_path / "b.txt").write_text(table(EVEN[:-1] + 0.1))
    call = ["convert", str(tmp_path / "a.txt"), str(tmp_path / "b.txt"), "--columns", *COLUMNS]
    assert main([*call, "-o", str(tmp_path / "records")]) == 0
    said = capsys.readouterr().out
    assert "a: 2 s at 500 Hz; displacement_m -0.005 to 0.005" in said
    record = read_record(tmp_path / "records" / "a.csv")
    assert float(record.channel("force_N").max()) == pytest.approx(800.0)
    (tmp_path / "b.txt").write_text(holed(table(EVEN)))
    assert main([*call, "-o", str(tmp_path / "again")]) == 2
    assert not (tmp_path / "again").exists()
