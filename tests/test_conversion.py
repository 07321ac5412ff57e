"""Tables as rigs write them become records: names, units, separators, clocks, signs; faults in a line each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io

from mrdamp.cli import main
from mrdamp.records import read_record
from mrdamp.records.channels import CHANNELS
from mrdamp.records.conversion import Converted, column, convert
from refusals import refuses

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


def test_every_channel_has_a_unit_of_its_own_and_one_in_a_columns_name_counts() -> None:
    assert {column(f"{name}=a").factor for name in CHANNELS if "floorN" not in name} == {1.0}
    assert column("charge_pC=a:nC").factor == 1000.0
    assert column("force_N=F [kN]:kN").factor == pytest.approx(1e3)
    assert column("displacement_m=LVDT (m)").factor == 1
    assert column("force_N=cell (2)").source == "cell (2)"


@pytest.mark.parametrize(
    ("steps", "told"),
    [
        (2e-3 + 4e-4 * np.sin(np.arange(1000) * 1.7), (1.6e-3, 2.4e-3)),
        # slower by .75 % from the middle, where a uniform clock would be 11 ms off
        (np.r_[np.full(1500, 0.002), np.full(1500, 0.002015)], (2e-3, 2.015e-3)),
    ],
    ids=["wanders", "drifts"],
)
def test_a_clock_that_is_not_uniform_is_followed(steps: np.ndarray, told: tuple[float, float], tmp_path: Path) -> None:
    time = np.cumsum(steps)
    found = converted(tmp_path / "a.csv", table(time))
    assert found.steps == pytest.approx(told, abs=2e-6)
    record = found.record
    assert record.sample_time == pytest.approx(2e-3, rel=6e-3)
    np.testing.assert_allclose(record.displacement, 5e-3 * np.sin(WAVE * record.time), atol=2e-6)
    assert record.time[-1] == pytest.approx(time[-1], abs=2.5e-3)


def test_samples_that_are_missing_are_counted(tmp_path: Path) -> None:
    found = converted(tmp_path / "a.csv", table(np.delete(EVEN, [100, 500, 501])))
    assert found.missing == 3
    assert found.steps == pytest.approx((2e-3, 6e-3))


def test_a_rate(tmp_path: Path) -> None:
    own = converted(tmp_path / "a.csv", table(EVEN), COLUMNS[1:], 500.0).record
    np.testing.assert_allclose(own.time, EVEN, atol=1e-12)
    fewer = converted(tmp_path / "a.csv", table(EVEN), COLUMNS, 250.0).record
    assert fewer.sample_time == pytest.approx(4e-3)
    inner = slice(50, -50)
    wanted = 5e-3 * np.sin(WAVE * fewer.time)
    np.testing.assert_allclose(fewer.displacement[inner], wanted[inner], atol=2e-5)


def quoted(text: str) -> str:
    """Every cell in quotes, as Instron's Bluehill writes them, below a line that is not a table."""
    head, *rows = text.rstrip().split("\n")
    cells = ['"' + row.replace(",", '","') + '"' for row in rows]
    return 'General : End date,"10/11/2022, 3:18 PM"\n\n' + "\n".join([head, *cells]) + "\n"


def in_blocks(text: str) -> str:
    """The header with units again before every 300th row, as MTS 793 writes each buffer."""
    head, *rows = text.rstrip().split("\n")
    block = ["", "Data Acquisition,,,Time:,1.0,Sec,7:48", head, "-,ms,kN,mm,mA,-"]
    lines = [x for k in range(0, len(rows), 300) for x in (*block, *rows[k : k + 300])]
    return "\n".join(lines) + "\n"


def stamped(text: str) -> str:
    head, *rows = text.rstrip().split("\n")
    start = datetime(2025, 11, 14, 23, 59, 59)
    cells = [row.split(",") for row in rows]
    for row in cells:
        row[1] = str(start + timedelta(milliseconds=float(row[1])))
    return "\n".join([head, *(",".join(row) for row in cells)]) + "\n"


def headless(text: str) -> str:
    return text.split("\n", 1)[1]


def with_units(text: str) -> str:
    return text.replace("\n", "\n-,ms,kN,mm,mA,-\n", 1)


NUMBERED = ("time_s=2:ms", "displacement_m=4:mm", "command=5:mA", "force_N=-3:kN")


@pytest.mark.parametrize(
    ("text", "columns"),
    [
        (table(EVEN), COLUMNS),
        (table(EVEN, ";", ","), COLUMNS),
        (table(EVEN, "\t", ".", "Rig 7, room 3\nsampled: yes\n\n"), COLUMNS),
        (table(EVEN, ";", ".", "a;b\n"), COLUMNS),
        (with_units(table(EVEN)), COLUMNS),
        (quoted(table(EVEN)), COLUMNS),
        (in_blocks(table(EVEN)), COLUMNS),
        (stamped(table(EVEN)), ("time_s=t [ms]", *COLUMNS[1:])),
        (headless(table(EVEN)), NUMBERED),
        ("a note\n" + headless(table(EVEN)), NUMBERED),
        (table(EVEN), (*COLUMNS[:2], "command=-750:mA", COLUMNS[3])),
        (headless(table(EVEN)), (*NUMBERED[:2], "command=0.75", NUMBERED[3])),
    ],
)
def test_names_units_signs_and_forms_of_tables(text: str, columns: Sequence[str], tmp_path: Path) -> None:
    found = converted(tmp_path / "Test 1.TXT", text, columns)
    record = found.record
    assert (record.name, record.n, found.steps) == ("Test 1", len(EVEN), None)
    assert record.sample_time == pytest.approx(2e-3, rel=1e-9)
    np.testing.assert_allclose(record.time - record.time[0], EVEN, atol=1e-9)
    np.testing.assert_allclose(record.displacement, 5e-3 * np.sin(WAVE * EVEN), atol=1e-11)
    np.testing.assert_allclose(record.channel("force_N"), 800.0 * np.cos(WAVE * EVEN), atol=1e-5)
    np.testing.assert_allclose(np.abs(record.command), 0.75)


def arrays() -> dict[str, Any]:
    x, v = 5.0 * np.sin(WAVE * EVEN), np.cos(WAVE * EVEN)
    return {"t": EVEN, "x": x, "load": np.column_stack([v, -0.8 * v])}


def save_hdf5(path: Path) -> None:
    with pytest.importorskip("h5py").File(path, "w", userblock_size=512) as file:
        for name, array in arrays().items():
            file[name] = array.T  # MATLAB's order


def flat() -> dict[str, Any]:
    found = arrays()
    load = found.pop("load")
    return found | {"load(1)": load[:, 0], "load(2)": load[:, 1]}


def save_parquet(path: Path) -> None:
    pyarrow = pytest.importorskip("pyarrow")
    pytest.importorskip("pyarrow.parquet").write_table(pyarrow.table(flat()), path)


def save_xlsx(path: Path) -> None:
    book = pytest.importorskip("openpyxl").Workbook()
    book.active.append(list(flat()))
    for row in zip(*flat().values(), strict=True):
        book.active.append([float(cell) for cell in row])
    book.save(path)


@pytest.mark.parametrize(
    ("save", "suffix"),
    [
        (lambda path: np.savez_compressed(path, **arrays()), "npz"),
        (lambda path: scipy.io.savemat(path, arrays()), "mat"),
        (save_hdf5, "mat"),
        (save_parquet, "parquet"),
        (save_xlsx, "xlsx"),
    ],
)
def test_arrays_of_other_programs(save: Callable[[Path], None], suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"a.{suffix}"
    save(path)
    columns = [column(c) for c in ("time_s=t", "displacement_m=x:mm", "command=0", "force_N=-load(2):kN")]
    record = convert(path, columns).record
    assert record.name == "a"
    np.testing.assert_allclose(record.time, EVEN, atol=1e-12)
    np.testing.assert_allclose(record.displacement, 5e-3 * np.sin(WAVE * EVEN), atol=1e-11)
    np.testing.assert_allclose(record.channel("force_N"), 800.0 * np.cos(WAVE * EVEN), atol=1e-6)
    refuses(lambda: convert(path, [*columns[:3], column("force_N=f")]), "no column 'f'; the file has ")
    path.write_bytes(path.read_bytes()[:100])
    refuses(lambda: convert(path, columns), rf"a\.{suffix}: no \.{suffix} file")
    np.savez(tmp_path / "pickled.npz", t=np.array([{}], dtype=object))
    refuses(lambda: convert(tmp_path / "pickled.npz", columns), r"pickled\.npz: no \.npz file")


def test_a_preload_over_an_open_path_is_no_turned_sign(tmp_path: Path) -> None:
    """160 N hold while the rod goes out and half the way back: they do more work than 8 N of friction take."""
    x = 1e-3 * np.concatenate([np.linspace(38, 0, 600), np.linspace(0, 20, 401)])
    force = 160.0 + 8.0 * np.sign(np.gradient(x))
    assert np.mean(force * np.gradient(x)) < 0
    lines = ["x,F", *(f"{a:.9f},{b:.6f}" for a, b in zip(x, force, strict=True))]
    columns = ("displacement_m=x", "command=0", "force_N=F")
    assert converted(tmp_path / "a.csv", "\n".join(lines), columns, 50.0).record.n == 1001
    turned = (*columns[:2], "force_N=-F")
    refuses(lambda: converted(tmp_path / "a.csv", "\n".join(lines), turned, 50.0), "would drive the rig")


def holed(text: str) -> str:
    lines = text.split("\n")
    return "\n".join(lines[:300] + lines[320:])


@pytest.mark.parametrize(
    ("columns", "change", "told"),
    [
        ((*COLUMNS[:3], "force_N=Load:kN"), str, "the damper would drive the rig .* force_N=-NAME"),
        (("time_s=Zeit:s", *COLUMNS[1:]), str, r"no column 'Zeit'; the file has No, t \[ms\], Load"),
        (COLUMNS, headless, "the file has no header and 6 columns: name them by their numbers, such as time_s=1:ms"),
        (COLUMNS, lambda text: in_blocks(text).replace("\n700,", "\n700;"), "line 713 has 5 cells, 6 columns are"),
        (("time_s=t [ms]", *COLUMNS[1:]), lambda text: stamped(text).replace("14 23:59:59.014", "x"),
         "line 9: t .* neither a number nor a d"),
        (COLUMNS, holed, r"sample 300: 0\.04 s are missing at 0\.596 s"),
        (COLUMNS, lambda text: text.replace("\n7,14.0", "\n7,4.0"), r"sample 8: the time does not increase"),
        ((*COLUMNS[:3], "force_N=-Load:N"), with_units, "the row of units says kN for 'Load', the option N"),
        (
            (*COLUMNS[:3], "force_N=-Load:N"), lambda text: with_units(text).replace("\n-,", "\nm/s^2,"),
            "says kN for 'Load'",
        ),
    ],
)  # fmt: skip
def test_faults_are_told(columns: tuple[str, ...], change: Callable[[str], str], told: str, tmp_path: Path) -> None:
    refuses(lambda: converted(tmp_path / "a.csv", change(table(EVEN)), columns), told)


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
    (tmp_path / "c.txt").write_text(table(EVEN).replace("I coil", "I"))
    call = [*call[:3], str(tmp_path / "c.txt"), *call[3:], "-o", str(tmp_path / "again")]
    assert main(call) == 2
    said = capsys.readouterr().err
    assert "b.txt: sample 300" in said
    assert "c.txt: no column 'I coil'" in said
    assert said.endswith("nothing is written; --skip writes the other 1\n")
    assert not (tmp_path / "again").exists()
    assert main([*call, "--skip"]) == 0
    assert [p.name for p in (tmp_path / "again").iterdir()] == ["a.csv"]
    assert main(["convert", str(tmp_path / "a.txt"), *call[1:], "--skip"]) == 2
    assert "a.txt is given twice" in capsys.readouterr().err


@pytest.mark.parametrize(("mark", "separator"), [(",", ","), (",", ";"), (".", ";")])
def test_marks_between_thousands_are_refused(mark: str, separator: str, tmp_path: Path) -> None:
    """Read as decimals, the largest forces would be a thousandth."""
    decimal = "," if separator == ";" else "."
    rows = []
    for t in EVEN:
        force = f"{round(1200 * np.cos(WAVE * t)):,}".replace(",", mark)
        numbers = [f"{value:.4f}".replace(".", decimal) for value in (t, 5 * np.sin(WAVE * t))]
        rows.append([*numbers, f'"{force}"'])
    path = tmp_path / "a.csv"
    path.write_text("\n".join(separator.join(row) for row in [["t", "x", "f"], *rows]))
    columns = [column(c) for c in ("time_s=t", "displacement_m=x:mm", "command=0", "force_N=f")]
    refuses(lambda: convert(path, columns), "numbers have no marks between their thousands")
    plain = [[*row[:2], row[2].replace(mark, "").strip('"')] for row in rows]
    path.write_text("\n".join(separator.join(row) for row in [["t", "x", "f"], *plain]))
    assert np.abs(convert(path, columns).record.channel("force_N")).max() == 1200


@pytest.mark.parametrize(
    ("forces", "fine"),
    [
        (["851", "1.100", "999", "1.020"], False),  # whole newtons that jump about
        (["4.851", "5.100", "4.999", "5.020"], False),  # the file's decimals have commas
        (["4,851", "5,1", "4,999", "0,020"], True),
        (["4,851", "5,100", "4,999", "5,020"], True),
    ],
)
def test_a_mark_before_three_digits_is_read_by_what_else_the_file_holds(
    forces: list[str], fine: bool, tmp_path: Path
) -> None:
    path = tmp_path / "a.csv"
    rows = [f"{0.01 * k:.2f};{0.002 * (k % 4):.3f};".replace(".", ",") + forces[k % 4] for k in range(40)]
    path.write_text("\n".join(["t;x;f", *rows]))
    columns = [column(c) for c in ("time_s=t", "displacement_m=x:mm", "command=0", "force_N=f")]
    if fine:
        assert convert(path, columns).record.channel("force_N")[0] == 4.851
    else:
        refuses(lambda: convert(path, columns), "numbers have no marks between their thousands")


@pytest.mark.parametrize(
    ("head", "join"),
    [("# t,x,F\n", ","), ("  t   x F\n", "  "), ("#t;x;F\n# s;mm;kN\n", ";"), ("t x F\ns mm kN\n", " ")],
)
def test_commented_headers_and_spaces(head: str, join: str, tmp_path: Path) -> None:
    rows = [(f"{t:.4f}", f"{5 * np.sin(WAVE * t):.6f}", f"{np.cos(WAVE * t):.6f}") for t in EVEN]
    text = head + "\n".join(join.join(row) for row in rows) + "\n"
    found = converted(tmp_path / "a.dat", text, ("time_s=t", "displacement_m=x:mm", "command=0:A", "force_N=F:kN"))
    np.testing.assert_allclose(found.record.displacement, 5e-3 * np.sin(WAVE * EVEN), atol=1e-9)
    np.testing.assert_allclose(found.record.channel("force_N"), 1e3 * np.cos(WAVE * EVEN), atol=1e-3)


def test_a_record_of_a_frame(tmp_path: Path) -> None:
    rows = ["t,ag,a1,x1,u", *(f"{t:.4f},{0.1 * np.sin(WAVE * t):.9f},{t:.4f},{2 * t:.4f},1.5" for t in EVEN)]
    columns = ("time_s=t", "ground_acceleration_m_s2=ag:g", "floor1_acceleration_m_s2=a1", "command=u:V")
    text = "\n".join(rows)
    record = converted(tmp_path / "a.csv", text, (*columns, "floor1_displacement_m=x1:mm")).record
    np.testing.assert_allclose(record.channel("ground_acceleration_m_s2"), 0.980665 * np.sin(WAVE * EVEN), atol=1e-7)
    np.testing.assert_allclose(record.channel("floor1_displacement_m"), 2e-3 * EVEN, atol=1e-9)
    few = (columns[0], columns[1], columns[3])
    refuses(lambda: converted(tmp_path / "a.csv", text, few), "no column is named for a floor or for force_N")
    few = (columns[0], columns[2], columns[3])
    refuses(lambda: converted(tmp_path / "a.csv", text, few), "no column is named for ground_acceleration_m_s2")
