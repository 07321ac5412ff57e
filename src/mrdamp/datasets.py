"""Public measured records of MR dampers: what there is, read from a folder, fetched from their source.

None of them is part of the package. They lie in the folder of the environment variable MRDAMP_DATA, one folder a
set with `train/` and `validation/`, files as in `mrdamp.records.channels.CHANNELS`.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any
from urllib.parse import unquote

import numpy as np

from mrdamp.errors import InputError, optional
from mrdamp.files import decode, read_bytes, write_atomic
from mrdamp.parallel import Progress
from mrdamp.records import SUFFIXES, Record, RecordSet, read_records


@dataclass(frozen=True)
class Source:
    """Where a set is fetched from.

    base: URL that file names are put behind, or `doi:...` of an archive whose registry lists files and hashes. files:
    name behind the base -> hash (`sha256:...`), or "" where none was published: it is then written down at the first
    fetch and checked from then on; empty for a DOI: all of its files. converter: of a file its half of the set and its
    record; None where the files stay as they are.
    """

    base: str
    files: Mapping[str, str] = field(default_factory=dict)
    converter: Callable[[Path], tuple[str, Record]] | None = None


@dataclass(frozen=True)
class Dataset:
    """A public set. name: of its folder. rig, tests: in words. licence: as in the source. doi: "" for none. url: the
    source's page. channels: in a record of it. command: what the command is, and its unit. source: None where it is to
    be fetched by hand from the page."""

    name: str
    rig: str
    tests: str
    licence: str
    doi: str
    url: str
    channels: tuple[str, ...]
    command: str
    source: Source | None


_UTFSM_NAME = re.compile(r"(\d+)mm(\d+(?:x\d+)?)Hz(\d+(?:x\d+)?)A")
_UTFSM_HELD_OUT = {("10", "1"), ("25", "0x25")}  # other amplitudes and frequencies than the rest


def utfsm(path: Path) -> tuple[str, Record]:
    """`25mm0x25Hz0x5A.txt`: columns s, mm, mm/s and N without a head; the name contains the current."""
    match = _UTFSM_NAME.fullmatch(path.stem)
    if match is None:
        raise InputError(f"{path}: the name does not tell amplitude, frequency and current")
    try:
        columns = np.loadtxt(path, ndmin=2).T
    except ValueError as error:
        raise InputError(f"{path}: not a table of numbers: {' '.join(str(error).split())[:80]}") from None
    if len(columns) != 4 or columns.shape[1] < 3:
        raise InputError(
            f"{path}: {len(columns)} columns of {columns.shape[1]} rows; 4 of at least 3 are needed"
        )
    t, x, v, force = columns
    step = float(t[-1] - t[0]) / (len(t) - 1)
    if not step > 0 or np.abs(np.diff(t) - step).max() > 0.02 * step:
        raise InputError(f"{path}: the time does not run evenly")
    amplitude, frequency, current = (text.replace("x", ".") for text in match.groups())
    channels = {
        "displacement_m": 1e-3 * x, "velocity_m_s": 1e-3 * v, "command": np.full(len(t), float(current)),
        "force_N": force,
    }  # fmt: skip
    half = "validation" if match.groups()[:2] in _UTFSM_HELD_OUT else "train"
    name = f"sine_{int(amplitude):02d}mm_{float(frequency):.2f}Hz_{float(current):.2f}A"
    return half, Record(name, None, step, channels)


_UTFSM = "https://raw.githubusercontent.com/DanielMaurelE/vRTHS_AMBC_MRdamper/"
# Two fits share the tests between them: folder, with the revision that holds the files.
_UTFSM_PARTS = {
    "8751c95d233df91120b7d7bb48b564a063d27486/Cap7_ModeloMR/BoucWen%20Ajuste%201/": (
        "10mm1Hz0x75A 10mm1Hz1A 25mm0x1Hz0x5A 25mm0x1Hz0x75A 25mm0x1Hz1A 25mm0x25Hz0A 25mm0x25Hz0x5A "
        "25mm0x25Hz0x75A 25mm0x5Hz0x25A 25mm0x5Hz0x5A 2mm5Hz0A 2mm5Hz0x25A 2mm5Hz1A 5mm3Hz0A 5mm3Hz1A"
    ),
    "5b174646f17316f63c8c95a12048178030094a0d/Cap7_ModeloMR/BoucWen%20Ajuste%202/": (
        "10mm1Hz0A 10mm1Hz0x25A 10mm1Hz0x5A 25mm0x1Hz0A 25mm0x1Hz0x25A 25mm0x25Hz0x25A 25mm0x25Hz1A "
        "25mm0x5Hz0A 25mm0x5Hz0x75A 25mm0x5Hz1A 2mm5Hz0x5A 2mm5Hz0x75A 5mm3Hz0x25A 5mm3Hz0x5A 5mm3Hz0x75A"
    ),
}
_UTFSM_FILES = {
    f"{part}Preprocesamiento-sinusoidales/Preprocesados/{test}.txt": ""
    for part, tests in _UTFSM_PARTS.items()
    for test in tests.split()
}

CATALOGUE: Mapping[str, Dataset] = MappingProxyType({
    found.name: found
    for found in (
        Dataset(
            "utfsm", "MR damper of about 1.6 kN at 1 A on an MTS press, UTFSM, 2022",
            "sines of 2 to 25 mm, 0.1 to 5 Hz, at 0, 0.25, 0.5, 0.75 and 1 A", "MIT", "",
            "https://github.com/DanielMaurelE/vRTHS_AMBC_MRdamper",
            ("time_s", "displacement_m", "velocity_m_s", "command", "force_N"), "nominal coil current, A",
            Source(_UTFSM, _UTFSM_FILES, utfsm),
        ),
        Dataset(
            "utfpr", "MR damper on a motor-driven sine rig, UTFPR, A. N. Vargas, 2020",
            "sines of 3.6 to 20 mm, 0.46 to 1.5 Hz, at 0, 0.87, 1.98 and 3.21 V", "MIT", "10.5281/zenodo.4445334",
            "https://doi.org/10.5281/zenodo.4445334", ("time_s", "displacement_m", "command", "force_N"),
            "coil voltage over 4.4 ohm, A", Source("doi:10.5281/zenodo.4445334/"),
        ),
        Dataset(
            "nees", "Lord prototype MR damper of 3 kN, S. J. Dyke, 1994 to 1996 (NEES-2012-1158)",
            "random displacement of 0 to 50 Hz under a random voltage of two levels, 3004.8 Hz", "not verified",
            "10.4231/D3V11VM6X", "https://doi.org/10.4231/D3V11VM6X",
            ("time_s", "displacement_m", "acceleration_m_s2", "command", "force_N"), "command voltage, V", None,
        ),
    )
})  # fmt: skip


def dataset(name: str) -> Dataset:
    if name not in CATALOGUE:
        raise InputError(f"data set '{name}' is unknown; there are {', '.join(CATALOGUE)}")
    return CATALOGUE[name]


VARIABLE = "MRDAMP_DATA"


def data_folder(folder: Path | str | None = None) -> Path:
    """The folder of the sets: as given, or of MRDAMP_DATA. Raises InputError where neither is there."""
    named = folder or os.environ.get(VARIABLE)
    if not named:
        raise InputError(f"no folder for data sets: set {VARIABLE}, or name one")
    return Path(named)


def found(folder: Path | str | None = None) -> dict[str, int]:
    """Number of records by set that lies in the folder; none where there is no folder."""
    try:
        root = data_folder(folder)
    except InputError:
        return {}
    halves = ("train", "validation")
    counts = {
        name: sum(file.name.endswith(SUFFIXES) for half in halves for file in (root / name / half).glob("*"))
        for name in CATALOGUE
    }
    return {name: count for name, count in counts.items() if count}


def read(name: str, folder: Path | str | None = None) -> RecordSet:
    """A set's records. Raises InputError: unknown, or not in the folder."""
    known, path = dataset(name), data_folder(folder) / name
    if not path.is_dir():
        mend = f"fetch it: mrdamp datasets {name} --fetch" if known.source else f"it is at {known.url}"
        raise InputError(f"{path}: no such folder; {mend}")
    return read_records(path)


HASHES = "hashes.json"


def fetch(known: Dataset, folder: Path, progress: Progress | None = None) -> Path:
    """Fetches a set into folder/NAME: the source's files into `source/`, and records where they can be made.

    Files with the right hash are not fetched again, so an interrupted fetch continues. Hashes are the catalogue's, the
    archive's own for a DOI, or those of the first fetch, which are kept in `hashes.json`. Raises
    InputError: no public source, pooch missing, no connection, a wrong hash.
    """
    if known.source is None:
        raise InputError(
            f"data set {known.name} cannot be fetched ({known.licence} licence); it is at {known.url}"
        )
    root = folder / known.name
    kept = root / HASHES
    seen: dict[str, str] = json.loads(decode(str(kept), read_bytes(kept))) if kept.is_file() else {}
    puller = _puller(known, root / "source", seen)
    files = sorted(puller.registry)
    for count, name in enumerate(files):
        if progress:
            progress(Path(unquote(name)).name, count / len(files))
        path = _pull(puller, name, known.url)
        if name not in seen:
            seen[name] = f"sha256:{hashlib.sha256(path.read_bytes()).hexdigest()}"
            write_atomic(kept, json.dumps(seen, indent=1) + "\n")
        if known.source.converter:
            half, record = known.source.converter(path)
            (root / half).mkdir(exist_ok=True)
            record.save(root / half / f"{record.name}.csv.gz")
    return root


def _puller(known: Dataset, folder: Path, seen: dict[str, str]) -> Any:
    pooch = optional("pooch", "data", "fetching needs pooch")
    assert known.source is not None
    pooch.get_logger().setLevel("WARNING")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made: {error.strerror}") from None
    # On disk a file has the last part of its name, without the revision and what is quoted.
    names = {name: Path(unquote(name)).name for name in known.source.files}
    puller = pooch.create(
        path=folder, base_url=known.source.base,
        urls={short: known.source.base + name for name, short in names.items()},
        registry={short: known.source.files[name] or seen.get(short) for name, short in names.items()},
    )  # fmt: skip
    if not names:
        try:
            puller.load_registry_from_doi()
        except Exception as error:  # whatever the connection or the archive raises
            raise InputError(f"{known.source.base}: {_line(error)}; fetch by hand from {known.url}") from None
    return puller


def _pull(puller: Any, name: str, url: str) -> Path:
    import requests

    try:
        return Path(puller.fetch(name))
    except ValueError as error:  # pooch has taken the file away again
        raise InputError(f"{name}: the hash is not the known one; {_line(error)}") from None
    except (OSError, requests.RequestException) as error:
        raise InputError(f"{name}: {_line(error)}; fetch by hand from {url}") from None


def _line(error: Exception) -> str:
    """One line of an error; without a connection its end, where the system says why, is left out."""
    host = re.match(r"HTTPS?ConnectionPool\(host='([^']*)'", str(error))
    return f"no connection to {host[1]}" if host else " ".join(str(error).split())[:160]
