"""What makes records unfit, told in a line; where a record is cut; the catalogue of public sets, and a fetch."""

from __future__ import annotations

import gc
import hashlib
import math
import re
import threading
import warnings
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest

from laboratory import grid
from modules import SHARED, needs
from mrdamp import datasets
from mrdamp.cli import main
from mrdamp.datasets import CATALOGUE, Dataset, Source, fetch, utfsm
from mrdamp.identify import identify
from mrdamp.model.core import Array
from mrdamp.records import Record, embedded, read_records
from mrdamp.records.checks import check_clipping, clipped, warnings_of
from mrdamp.records.motion import cut, path, share_of_stroke
from mrdamp.simulation.predict import predict
from refusals import refuses


def test_a_clipped_force_is_told_and_a_whole_one_passes() -> None:
    records = grid()
    check_clipping(records)
    check_clipping(embedded().records)
    force = records[-1].channel("force_N")
    cut = np.minimum(force, 0.9 * force.max())
    found = clipped(cut)
    assert found is not None
    assert found[0] == 0.9 * force.max()
    assert found[1] == pytest.approx(np.mean(force >= 0.9 * force.max()))
    assert clipped(np.maximum(force, 0.9 * force.min())) is not None
    bad = [*records[:-1], records[-1].with_channels({"force_N": cut})]
    refuses(lambda: identify("bingham", bad), r"1.2A_8mm: channel force_N is clipped: .* %")


def test_a_coarse_converter_or_a_pause_at_the_end_of_a_stroke_is_not_clipping() -> None:
    t = np.arange(4000) / 1000
    noise = np.random.default_rng(0).normal(0, 2.0, len(t))
    assert clipped(np.round((500 * np.sin(2 * np.pi * 0.5 * t) + noise) / 3) * 3) is None
    assert clipped(np.concatenate([np.full(600, -0.01), -0.01 * np.cos(2 * np.pi * t)])) is None


def test_a_constant_channel_or_too_few_samples_are_told() -> None:
    records = grid()
    dead = records[2].with_channels({"force_N": np.full(records[2].n, 3.0)})
    said = r"0.4A_4mm: channel force_N is constant \(3\)"
    refuses(lambda: identify("bingham", [*records[:2], dead]), said)
    short = [r.part(0.0, 0.02) for r in records[:4]]
    said = "44 samples to fit 6 free numbers to; at least 120"
    refuses(lambda: identify("bingham", short), said)


@pytest.mark.parametrize(
    ("channel", "factor", "told"),
    [
        ("displacement_m", 1000.0, "2.4A_4mm: displacement_m spans 8 m; usual are 0.0001 to 3"),
        ("force_N", 1e-3, "2.4A_4mm: force_N is up to 0.[0-9]+ N; usual are 2 to 1e[+]07"),
        ("command", 1000.0, "2.4A_4mm: command is up to 2.4e[+]03; usual are 0 to 50"),
        ("displacement_m", 300.0, "2.4A_4mm: displacement_m spans 2.4 m, the other records 0.01[26]"),
    ],
)
def test_units_are_doubted(channel: str, factor: float, told: str) -> None:
    """By what dampers are, and by the other records of the set."""
    records = grid(commands=(0.0, 1.2, 2.4))
    assert warnings_of(records) == []
    k = next(k for k, r in enumerate(records) if r.name == "2.4A_4mm")
    records[k] = records[k].with_channels({channel: factor * records[k].channel(channel)})
    (line,) = warnings_of(records)
    assert re.match(f"{told}: channels are in m, N, s, pC, and A or V", line)


def test_milliseconds_taken_for_seconds_are_doubted() -> None:
    record = grid()[0]
    slow = Record(record.name, None, 1000 * record.sample_time, {"command": record.command})
    (line,) = warnings_of([slow])
    told = "the clock runs at 0.5 Hz, and every 0.5 ms is computed; usual are 20 to 100000"
    assert line.startswith(f"{record.name}: {told}")


DT = 0.002


def write(file: Path, x: Array, v: Array, seed: int = 0, noise: float = 2e-6) -> Path:
    """A Bingham damper's record with noise in displacement (2 um) and force (2 N), written out in NumPy."""
    rng, t = np.random.default_rng(seed), DT * np.arange(len(x))
    force = 300 * v + 200 * np.tanh(v / 0.01) + 15 + rng.normal(0, 2, len(t))
    columns = np.column_stack([t, x + rng.normal(0, noise, len(t)), np.full(len(t), 0.5), force])
    names = "time_s,displacement_m,command,force_N"
    np.savetxt(file, columns, delimiter=",", header=names, comments="", fmt="%.12g")
    return file


def burst(seconds: float, begin: float, end: float) -> tuple[Array, Array]:
    """At rest but for a burst of 2 Hz, whose displacement (m) and velocity (m/s) are given."""
    t = DT * np.arange(round(seconds / DT))
    size = np.where((t > begin) & (t < end), np.sin(math.pi * (t - begin) / (end - begin)) ** 2, 0.0)
    x = 0.01 * size * np.sin(4 * math.pi * (t - begin))
    return x, np.gradient(x, DT)


def told(capsys: pytest.CaptureFixture[str], out: Path, *records: Path) -> tuple[int, str, str]:
    command = ["identify", *map(str, records), "--law", "bingham", "--starts", "1", "-o", str(out)]
    code = main(command)
    said = capsys.readouterr()
    return code, said.out, said.err


def test_path_counts_motion_and_not_noise() -> None:
    x = burst(9, 6.2, 8)[0] + np.random.default_rng(1).normal(0, 2e-6, 4500)
    travelled = path(x)
    assert travelled[3000] == 0.0
    assert travelled[-1] == travelled[4100]
    sine = np.sin(np.linspace(0, 20 * math.pi, 4000))
    assert path(sine)[-1] == pytest.approx(40, rel=0.03)
    assert cut(sine) == pytest.approx(4000 * 2 / 3, rel=0.02)
    assert cut(np.zeros(301)) == 200  # where nothing moves, in its time


@pytest.mark.parametrize(("begin", "end"), [(6.2, 8.0), (0.0, 2.0), (3.0, 5.0)])
def test_a_single_record_is_cut_where_both_parts_move(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], begin: float, end: float
) -> None:
    # Cut at two thirds of its time, the first of these was fitted at rest: errors of 5.59 and 0.998.
    file = write(tmp_path / "r.csv", *burst(9, begin, end), noise=0.0)
    parts = read_records(file)
    spans = [np.ptp(record.displacement[record.lead :]) for record in parts]
    assert min(spans) > 0.3 * max(spans)
    code, out, _ = told(capsys, tmp_path / "m.json", file)
    assert code == 0
    errors = out.splitlines()[2].replace(",", "").split()
    # Its own law: what is left is the force's noise, 2 N of 57 to 118 N.
    assert float(errors[2]) < 0.06
    assert float(errors[5]) < 0.06
    # The held-out part goes on from the fitted one: its error is that of a prediction of the whole record.
    (record,), at = parts.whole, parts.validation[0].lead
    force = record.channel("force_N")[at:]
    left = predict(tmp_path / "m.json", record)["force_N"][at:] - force
    assert float(errors[5]) == pytest.approx(np.sqrt(np.mean(left**2)) / np.std(force), abs=6e-4)


@pytest.mark.parametrize(
    ("what", "said"),
    [
        ("ramp", "the loop never closes: the rod never turns back"),
        ("little", "too little motion: 0.0"),
        ("constant", "the force is constant but for its noise (1"),
    ],
)
def test_a_record_that_shows_no_law_gets_a_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], what: str, said: str
) -> None:
    t = DT * np.arange(4000)
    x = {"ramp": 2e-4 * t, "little": 4e-6 * np.sin(6 * t), "constant": 0.01 * np.sin(6 * t)}[what]
    file = write(tmp_path / "r.csv", x, np.zeros(len(t)))
    code, out, err = told(capsys, tmp_path / "m.json", file)
    assert code == 2
    assert all(line.startswith("check: ") for line in out.splitlines())
    assert not (tmp_path / "m.json").exists()
    last = err.splitlines()[-1]
    assert last.startswith(f"mrdamp: {file}: the law explains this force no better than a constant")
    assert said in last


def test_the_share_of_a_stroke_grows_from_each_turn() -> None:
    """Over a triangle: up by 10, back by 10; a turn back by a hundredth of the range is none."""
    up = np.linspace(0, 10, 101)
    x = np.concatenate([up, up[::-1][1:]])
    share = share_of_stroke(x)
    assert share[:101] == pytest.approx(up / 10)
    assert share[125:] == pytest.approx(up[25:] / 10)
    bent = x.copy()
    bent[50] -= 0.2
    assert share_of_stroke(bent)[60:100] == pytest.approx(up[60:100] / 10)


# The first lines of the public file of that name.
TABLE = """\
   0.0000000e+00   4.2749043e-03   1.0100000e+00   2.5208754e+01
   1.0000000e-03   5.3749043e-03   1.1000000e+00   2.6286505e+01
   2.0000000e-03   6.4749043e-03   1.1000000e+00   2.7393675e+01
   3.0000000e-03   7.7249043e-03   1.2500000e+00   2.8500846e+01
"""


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: object) -> None:
        pass


@pytest.fixture
def served(tmp_path: Path) -> Iterator[tuple[Path, Dataset]]:
    pytest.importorskip("pooch", reason="fetching needs the extra `data`")
    root = tmp_path / "served"
    (root / "rev 1").mkdir(parents=True)
    for name in ("10mm1Hz0A", "5mm3Hz0x25A"):
        (root / "rev 1" / f"{name}.txt").write_text(TABLE)
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(root)))
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    files = {"rev%201/10mm1Hz0A.txt": f"sha256:{hashlib.sha256(TABLE.encode()).hexdigest()}",
             "rev%201/5mm3Hz0x25A.txt": ""}  # fmt: skip
    source = Source(f"http://127.0.0.1:{server.server_port}/", files, utfsm)
    yield root, replace(CATALOGUE["utfsm"], source=source)
    server.shutdown()
    thread.join()
    server.server_close()
    with warnings.catch_warnings():  # pooch leaves the connection of a file that it refuses to the collector
        warnings.simplefilter("ignore", ResourceWarning)
        gc.collect()


def test_a_set_is_fetched_and_read(served: tuple[Path, Dataset], tmp_path: Path) -> None:
    _, known = served
    root = fetch(known, tmp_path / "data")
    assert root == tmp_path / "data" / "utfsm"
    assert datasets.found(tmp_path / "data") == {"utfsm": 2}
    (train,), (held,) = (datasets.read("utfsm", tmp_path / "data").train,
                         datasets.read("utfsm", tmp_path / "data").validation)  # fmt: skip
    assert (train.name, held.name) == ("sine_05mm_3.00Hz_0.25A", "sine_10mm_1.00Hz_0.00A")
    assert train.sample_time == pytest.approx(1e-3)
    np.testing.assert_allclose(train.displacement[0], 4.2749043e-6, rtol=1e-8)
    np.testing.assert_allclose(train.channel("velocity_m_s")[3], 1.25e-3, rtol=1e-8)
    np.testing.assert_allclose(train.channel("force_N")[1], 26.286505, rtol=1e-8)
    assert (train.command == 0.25).all()


def test_a_file_that_changed_is_refused(served: tuple[Path, Dataset], tmp_path: Path) -> None:
    """One has its hash in the catalogue, the other from the first fetch; what is there is not fetched again."""
    folder, known = served
    root = fetch(known, tmp_path / "data")
    (folder / "rev 1").rename(folder / "away")
    fetch(known, tmp_path / "data")
    (folder / "away").rename(folder / "rev 1")
    for name in ("10mm1Hz0A", "5mm3Hz0x25A"):
        (root / "source" / f"{name}.txt").unlink()
        (folder / "rev 1" / f"{name}.txt").write_text(TABLE.replace("2.5208754e+01", "9.9e+01"))
        refuses(lambda: fetch(known, tmp_path / "data"), "hash")
        (folder / "rev 1" / f"{name}.txt").write_text(TABLE)


@needs(SHARED / "data")
@pytest.mark.parametrize("name", CATALOGUE)
def test_measured_sets_are_what_the_catalogue_says(name: str) -> None:
    known, found = CATALOGUE[name], datasets.read(name, SHARED / "data")
    assert datasets.found(SHARED / "data")[name] == len(found) > 0
    for record in found:
        assert set(record.channels) <= set(known.channels)
        assert {"time_s", "displacement_m", "command", "force_N"} <= set(record.channels)
    largest = {"utfsm": 1.0, "utfpr": 3.21 / 4.4, "nees": 6.0}[name]  # A, A, V
    assert max(float(r.command.max()) for r in found) <= largest * 1.02
    strokes = [float(np.ptp(r.displacement)) for r in found]
    assert 1e-3 < min(strokes) < max(strokes) < 0.06  # m, and not mm
