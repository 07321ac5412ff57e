"""The catalogue of public sets, and a fetch from a local HTTP server."""

from __future__ import annotations

import hashlib
import json
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest

from mrdamp import datasets
from mrdamp.cli import main
from mrdamp.datasets import CATALOGUE, Dataset, Source, fetch
from mrdamp.datasets.convert import utfsm
from mrdamp.errors import InputError
from mrdamp.records.channels import is_channel
from record_tables import table, write
from refusals import refuses

pytest.importorskip("pooch", reason="fetching needs the extra `data`")

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"
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
    """A folder that is served, and a set of two files in it."""
    root = tmp_path / "served"
    (root / "rev 1").mkdir(parents=True)
    for name in ("10mm1Hz0A", "5mm3Hz0x25A"):
        (root / "rev 1" / f"{name}.txt").write_text(TABLE)
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(root)))
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    files = {"rev%201/10mm1Hz0A.txt": f"sha256:{hashlib.sha256(TABLE.encode()).hexdigest()}",
             "rev%201/5mm3Hz0x25A.txt": ""}  # fmt: skip
    source = Source(f"http://127.0.0.1:{server.server_port}/", files, "utfsm")
    yield root, replace(CATALOGUE["utfsm"], source=source)
    server.shutdown()
    thread.join()
    server.server_close()


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


@pytest.mark.parametrize("name", ["10mm1Hz0A", "5mm3Hz0x25A"])
def test_a_file_that_changed_is_refused(served: tuple[Path, Dataset], tmp_path: Path, name: str) -> None:
    """One has its hash in the catalogue, the other from the first fetch; what is there is not fetched again."""
    folder, known = served
    root = fetch(known, tmp_path / "data")
    (folder / "rev 1").rename(folder / "away")
    fetch(known, tmp_path / "data")
    (folder / "away").rename(folder / "rev 1")
    assert set(json.loads((root / "hashes.json").read_text())) == {"10mm1Hz0A.txt", "5mm3Hz0x25A.txt"}
    (root / "source" / f"{name}.txt").unlink()
    (folder / "rev 1" / f"{name}.txt").write_text(TABLE.replace("2.5208754e+01", "9.9e+01"))
    with pytest.raises(InputError, match="hash"):
        fetch(known, tmp_path / "data")
    assert not (root / "source" / f"{name}.txt").exists()


def test_a_missing_file_is_told(served: tuple[Path, Dataset], tmp_path: Path) -> None:
    folder, known = served
    (folder / "rev 1" / "10mm1Hz0A.txt").unlink()
    with pytest.raises(InputError, match=r"10mm1Hz0A\.txt.*by hand from https://github\.com"):
        fetch(known, tmp_path / "data")


def test_what_cannot_be_fetched_or_is_not_there_is_told(
    served: tuple[Path, Dataset], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, known = served
    data = tmp_path / "data"
    assert known.source is not None
    dead = replace(known, source=replace(known.source, base="http://127.0.0.1:9/"))
    (tmp_path / "file").write_text("")
    monkeypatch.delenv("MRDAMP_DATA", raising=False)
    by_hand = r"fetch by hand from https://github\.com"
    cases: tuple[tuple[Callable[[], object], str], ...] = (
        (lambda: fetch(dead, data), rf"no connection to 127\.0\.0\.1; {by_hand}"),
        (lambda: fetch(known, tmp_path / "file"), "cannot be made: Not a directory"),
        (lambda: datasets.read("utfpr", data), "mrdamp datasets utfpr --fetch"),
        (datasets.data_folder, "MRDAMP_DATA"),
    )
    for call, said in cases:
        with pytest.raises(InputError, match=said):
            call()


@pytest.mark.parametrize(
    ("name", "text", "named"),
    [("10mm1Hz", TABLE, "name"), ("1mm1Hz0A", "a b\n", "numbers"), ("1mm1Hz0A", "1 2 3\n4 5 6\n7 8 9\n", "columns"),
     ("1mm1Hz0A", TABLE.replace("2.0000000e-03", "2.9000000e-03"), "evenly")],
)  # fmt: skip
def test_bad_files_are_told(tmp_path: Path, name: str, text: str, named: str) -> None:
    path = tmp_path / f"{name}.txt"
    path.write_text(text)
    refuses(lambda: utfsm(path), named)


def test_the_catalogue_says_what_a_user_needs() -> None:
    for name, known in CATALOGUE.items():
        assert name == known.name
        assert known.rig
        assert known.licence
        assert known.url.startswith("https://")
        assert all(is_channel(channel) for channel in known.channels)
    assert len(CATALOGUE["utfsm"].source.files) == 30  # type: ignore[union-attr]


@pytest.mark.skipif(not SHARED.is_dir(), reason="needs the folder ../shared/data")
@pytest.mark.parametrize("name", CATALOGUE)
def test_measured_sets_are_what_the_catalogue_says(name: str) -> None:
    known, found = CATALOGUE[name], datasets.read(name, SHARED)
    assert datasets.found(SHARED)[name] == len(found) > 0
    for record in found:
        assert set(record.channels) <= set(known.channels)
        assert {"time_s", "displacement_m", "command", "force_N"} <= set(record.channels)
    largest = {"utfsm": 1.0, "utfpr": 3.21 / 4.4, "nees": 6.0}[name]  # A, A, V
    assert max(float(r.command.max()) for r in found) <= largest * 1.02
    strokes = [float(np.ptp(r.displacement)) for r in found]
    assert 1e-3 < min(strokes) < max(strokes) < 0.06  # m, and not mm


def test_the_command_lists_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("MRDAMP_DATA", raising=False)
    assert main(["datasets"]) == 0
    text = capsys.readouterr().out
    assert "doi:10.5281/zenodo.4445334, licence MIT" in text
    assert "here      no; to be fetched by hand" in text
    (tmp_path / "nees" / "train").mkdir(parents=True)
    write(tmp_path / "nees" / "train", table(), "random_1.csv")
    monkeypatch.setenv("MRDAMP_DATA", str(tmp_path))
    assert main(["datasets", "nees", "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert (row["records_here"], row["can_be_fetched"], row["doi"]) == (1, False, "10.4231/D3V11VM6X")
    assert main(["datasets", "nees", "--fetch"]) == 2
    assert "cannot be fetched" in capsys.readouterr().err
    assert main(["datasets", "other"]) == 2
    assert "utfsm" in capsys.readouterr().err
