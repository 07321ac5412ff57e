"""The public measured sets: where they come from, what is in them, and those in the folder of MRDAMP_DATA."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

from mrdamp.errors import InputError
from mrdamp.records import SUFFIXES, RecordSet, read_records


@dataclass(frozen=True)
class Source:
    """Where a set is fetched from.

    Attributes:
        base: URL that file names are put behind, or `doi:...` of an archive whose registry lists files and hashes.
        files: name behind the base -> hash (`sha256:...`), or "" where none was published: it is then written down at
            the first fetch and checked from then on. Empty for a DOI: all of its files.
        converter: how the files become records, see `mrdamp.datasets.convert`; "" where they stay as they are.
    """

    base: str
    files: Mapping[str, str] = field(default_factory=dict)
    converter: str = ""


@dataclass(frozen=True)
class Dataset:
    """A public set.

    Attributes:
        name: of its folder. rig, tests: in words. licence: as in the source. doi: "" for none. url: the source's
            page. channels: in a record of it. command: what the command is, and its unit. source: None where it is
            to be fetched by hand from the page.
    """

    name: str
    rig: str
    tests: str
    licence: str
    doi: str
    url: str
    channels: tuple[str, ...]
    command: str
    source: Source | None


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
            Source(_UTFSM, _UTFSM_FILES, "utfsm"),
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
    """The set of that name. Raises InputError."""
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
