"""Ground motions: recorded ones from CSV and PEER .AT2 files, and artificial ones of a Kanai-Tajimi spectrum."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from importlib import resources
from numbers import Real
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft, rfftfreq

from mrdamp.errors import InputError
from mrdamp.files import decode, read_bytes, write_atomic
from mrdamp.records import csv_file, sampling
from mrdamp.records.channels import listed, show

Array = NDArray[np.float64]

#: A frame with five times the building's frequencies takes a record at five times its speed (Dyke et al. 1996).
TIME_SCALE = 5.0
#: s, sample time of a file at most: records have .02 s or less.
_LONGEST = 0.1


@dataclass(frozen=True, eq=False)
class GroundMotion:
    """Ground acceleration (n,) m/s2 every sample_time (s), read-only; the first sample is at t = 0.

    name: from the file; source: where it comes from, in words; speed: how many times as fast as it was recorded. Raises
    InputError.
    """

    name: str
    sample_time: float
    acceleration: Array
    source: str = ""
    speed: float = 1.0

    def __post_init__(self) -> None:
        values = np.array(self.acceleration, dtype=np.float64)
        _check(self.name, self.sample_time, values)
        values.setflags(write=False)
        object.__setattr__(self, "acceleration", values)

    def __repr__(self) -> str:
        return f"GroundMotion({self.name!r}, {self.n} samples, {self.duration:.4g} s, peak {self.pga:.3g} m/s2)"

    @property
    def n(self) -> int:
        """Number of samples."""
        return len(self.acceleration)

    @property
    def time(self) -> Array:
        """(n,) s, from 0."""
        return np.arange(self.n, dtype=np.float64) * self.sample_time

    @property
    def duration(self) -> float:
        """From the first to the last sample, s."""
        return (self.n - 1) * self.sample_time

    @property
    def pga(self) -> float:
        """Peak ground acceleration, m/s2."""
        return float(np.abs(self.acceleration).max())

    def scaled(self, factor: float) -> GroundMotion:
        """Every acceleration times ``factor``."""
        if not np.isfinite(factor):
            raise InputError(f"{self.name}: scale factor {factor}: it must be a finite number")
        return replace(self, acceleration=self.acceleration * factor)

    def compressed(self, factor: float) -> GroundMotion:
        """Played ``factor`` times as fast, accelerations as they are: the sample time is divided.

        A model frame whose frequencies are five times the building's takes the motion at five times its
        speed (Dyke, Spencer, Sain, Carlson 1996, 10.1088/0964-1726/5/5/006, sec. 5).
        """
        if not 0.0 < factor < np.inf:
            raise InputError(f"{self.name}: time compression {factor}: it must be positive")
        return replace(self, sample_time=self.sample_time / factor, speed=self.speed * factor)

    def resampled(self, sample_time: float) -> GroundMotion:
        """On another sample time (s), see `mrdamp.records.sampling.resampled`."""
        values = sampling.resampled(self.acceleration, self.sample_time, sample_time)
        return replace(self, sample_time=sample_time, acceleration=values)

    def save(self, path: Path | str, digits: int = 6) -> None:
        """Writes the one-column CSV that `read_motion` reads, in one go."""
        path = Path(path)
        if not path.name.endswith(".csv"):
            raise InputError(f"{path}: a ground motion is written as .csv")
        body = "\n".join(f"%.{digits}g" % value for value in self.acceleration)
        source = " ".join(self.source.split())
        head = f"# {source}\n# dt_s={self.sample_time:.12g} n={self.n} pga_m_s2={self.pga:.4f}\n"
        write_atomic(path, f"{head}# acceleration in m/s^2, first sample t=0\n{body}\n")


def read_motion(path: Path | str, sample_time: float | None = None) -> GroundMotion:
    """A ground motion's file, in one of three forms; a name that ends in .gz is unpacked. Raises InputError.

    * ``.AT2`` of the PEER database: acceleration in g, turned into m/s2 (1 g = 9.80665 m/s2);
    * CSV with one column, m/s2, and ``dt_s=0.02`` in a ``#`` line (``n=`` is checked where given),
      or with ``sample_time`` (s) given here;
    * CSV with a time column in s and an acceleration column: without a header m/s2; a header names
      ``time_s`` and ``ground_acceleration_m_s2``, ``acceleration_m_s2`` or ``acceleration_g``.
    """
    path = Path(path)
    found = _parse(str(path), path.name, decode(str(path), read_bytes(path)), sample_time)
    if found.sample_time > _LONGEST:
        raise InputError(f"{path}: a sample every {found.sample_time:g} s; allowed: up to {_LONGEST} s (ms?)")
    return found


def embedded_motion() -> GroundMotion:
    """The motion that comes with the package, made by `kanai_tajimi` (data/README.md)."""
    folder = resources.files("mrdamp") / "data" / "motions"
    name = "synthetic_firm_soil.csv"
    data = folder.joinpath(name).read_bytes()
    return _parse(f"motions/{name}", name, decode(name, data), None)


def kanai_tajimi(
    seed: int,
    *,
    duration: float = 25.0,
    sample_time: float = 0.01,
    pga: float = 3.4,
    ground_frequency: float = 15.6,
    ground_damping: float = 0.6,
    filter_frequency: float = 1.56,
    filter_damping: float = 0.6,
    rise: float = 3.0,
    plateau: float = 8.0,
    decay: float = 0.35,
) -> GroundMotion:
    """Synthetic motion: white noise under an envelope, through the Clough-Penzien filter, scaled to a peak.

    The noise w(t) times the envelope e(t) drives the soil layer, and a high-pass takes out what would
    let the ground drift::

        x_g'' + 2 z_g w_g x_g' + w_g^2 x_g = -e w      a_g = -2 z_g w_g x_g' - w_g^2 x_g
        x_f'' + 2 z_f w_f x_f' + w_f^2 x_f =  a_g      a   = x_f''

    so that with e = 1 the spectrum of a is, up to a factor, ::

        [w_g^4 + (2 z_g w_g w)^2] / [(w_g^2 - w^2)^2 + (2 z_g w_g w)^2]
            * w^4 / [(w_f^2 - w^2)^2 + (2 z_f w_f w)^2]

    e(t) = (t / rise)^2 up to ``rise``, 1 for ``plateau``, exp(-decay (t - rise - plateau)) after.
    The filters act in the frequency domain, so that the samples have this spectrum up to half the sampling rate.
    Joined by straight lines, as the structures take them, they have (sin q / q)^4 of it with q = w dt / 2: half at
    .32 of the sampling rate.

    Sources: Kanai 1957 (Bull. Earthq. Res. Inst. 35, 309) and Tajimi 1960 (2nd World Conf. Earthq. Eng.)
    for the soil layer, Clough and Penzien, Dynamics of Structures, for the second filter, Amin and Ang
    1968 (J. Eng. Mech. Div. ASCE 94, 559) for the envelope. Defaults: firm soil.

    seed: of NumPy's default generator; duration, rise, plateau: s; sample_time: s, at most a tenth of the ground's
    period; pga: m/s2, the peak; ground_frequency, filter_frequency: w_g and w_f, rad/s; ground_damping, filter_damping:
    z_g and z_f; decay: 1/s. Raises InputError.
    """
    positive = {
        "duration": duration, "sample_time": sample_time, "pga": pga, "ground_frequency": ground_frequency,
        "ground_damping": ground_damping, "filter_frequency": filter_frequency, "filter_damping": filter_damping,
        "rise": rise, "decay": decay,
    }  # fmt: skip
    for name, value in positive.items():
        if not 0.0 < value < np.inf:
            raise InputError(f"kanai_tajimi: {name} is {value}: it must be positive")
    if not 0.0 <= plateau < np.inf:
        raise InputError(f"kanai_tajimi: plateau is {plateau}: it must be 0 or more")
    longest = 0.2 * np.pi / ground_frequency
    if sample_time > longest or duration < 10.0 * sample_time:
        raise InputError(
            f"kanai_tajimi: sample_time is {sample_time:g} s: at most {longest:.4g} s (a tenth of the"
            f" ground's period) and a tenth of the duration ({duration:g} s)"
        )
    time = np.arange(round(duration / sample_time) + 1) * sample_time
    fade = np.exp(-decay * np.maximum(time - rise - plateau, 0.0))
    noise = np.random.default_rng(seed).standard_normal(len(time)) * np.minimum(time / rise, 1.0) ** 2 * fade
    soil = 2.0 * ground_damping * ground_frequency
    cut = 2.0 * filter_damping * filter_frequency
    # As long again in silence: there the filters' response dies away, instead of at the start.
    size = next_fast_len(2 * len(time) + math.ceil(20.0 / (filter_damping * filter_frequency * sample_time)), real=True)
    w = 2j * np.pi * rfftfreq(size, sample_time)
    layer = (soil * w + ground_frequency**2) / (w**2 + soil * w + ground_frequency**2)
    highpass = w**2 / (w**2 + cut * w + filter_frequency**2)
    values = irfft(rfft(noise, size) * layer * highpass, size)[: len(time)]
    values *= pga / np.abs(values).max()
    source = (
        f"Synthetic (Clough-Penzien filtered noise, seed {seed}): ground {ground_frequency:g} rad/s,"
        f" damping {ground_damping:g}; filter {filter_frequency:g} rad/s, damping {filter_damping:g};"
        f" rise {rise:g} s, plateau {plateau:g} s, decay {decay:g} 1/s"
    )
    return GroundMotion(f"kanai_tajimi_{seed}", sample_time, values, source)


def _parse(file: str, name: str, text: str, sample_time: float | None) -> GroundMotion:
    base = re.sub(r"\.gz$", "", name, flags=re.IGNORECASE)
    stem = re.sub(r"\.(csv|txt|dat|at2)$", "", base, flags=re.IGNORECASE)
    if base.lower().endswith(".at2"):
        step, values, source = parse_at2(file, text)
    else:
        step, values, source = parse_csv(file, text, sample_time)
    _check(file, step, values)
    return GroundMotion(stem, step, values, source or stem)


def _check(label: str, sample_time: float, values: Array) -> None:
    if values.ndim != 1 or len(values) < 3:
        raise InputError(f"{label}: acceleration has shape {values.shape}: it must be (n,), n of 3 or more")
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        raise InputError(
            f"{label}: sample {bad[0] + 1} is {values[bad[0]]}: every one must be a finite number"
        )
    if not (isinstance(sample_time, Real) and 0.0 < sample_time < np.inf):
        shown = f"{sample_time:g}" if isinstance(sample_time, Real) else repr(sample_time)[:60]
        raise InputError(f"{label}: sample time {shown} s: it must be positive")


Parsed = tuple[float, Array, str]  # sample time in s, acceleration (n,) in m/s2, source

STANDARD_GRAVITY = 9.80665  # m/s2 per g

_COLUMNS = {"ground_acceleration_m_s2": 1.0, "acceleration_m_s2": 1.0, "acceleration_g": STANDARD_GRAVITY}
_VALUE = r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?)"


def parse_csv(file: str, text: str, sample_time: float | None) -> Parsed:
    """A CSV with one column (m/s2, ``dt_s=`` in a comment or ``sample_time``) or with time and acceleration. Raises
    InputError."""
    lines = text.rstrip().split("\n")
    comments = [line for line in lines if line.startswith("#")]
    skip = 0
    while skip < len(lines) and (lines[skip].startswith("#") or not lines[skip].strip()):
        skip += 1
    if skip == len(lines):
        raise InputError(f"{file}: no samples")
    header = [cell.strip() for cell in lines[skip].split(",")]
    named = any(re.match(r"[A-Za-z_]", cell) and cell.lower() not in ("nan", "inf") for cell in header)
    if named:
        skip += 1
        name = next((name for name in _COLUMNS if name in header), None)
        if name is None:
            raise InputError(f"{file}: no acceleration column: the file has {listed(header)};"
                             f" it is one of {', '.join(_COLUMNS)}")  # fmt: skip
        column, factor = header.index(name), _COLUMNS[name]
        time_column = header.index("time_s") if "time_s" in header else None
        if time_column is None and len(header) > 1:
            raise InputError(f"{file}: no time_s column: the file has {listed(header)}")
    elif len(header) <= 2:
        column, factor, time_column = len(header) - 1, 1.0, 0 if len(header) == 2 else None
    else:
        raise InputError(f"{file}: {len(header)} columns and no header: name them, or give one or two")
    picked = [column] if time_column is None else [column, time_column]
    names = header if named else [f"column {k + 1}" for k in range(len(header))]
    table = csv_file.numbers(file, names, lines[skip:], picked, skip + 1)
    stated = _stated(file, comments, "dt_s")
    if time_column is not None:
        stated = csv_file.uniform_step(file, table[:, 1], skip + 1)
    sample_time = stated if stated is not None else sample_time
    if sample_time is None:
        raise InputError(f"{file}: no sample time: a one-column motion needs a line such as # dt_s=0.02")
    count = _stated(file, comments, "n")
    if count is not None and count != len(table):
        raise InputError(f"{file}: {len(table)} samples, its header says n={count:g}")
    source = comments[0].lstrip("# ").strip() if comments else ""
    return sample_time, table[:, 0] * factor, source


def parse_at2(file: str, text: str) -> Parsed:
    """PEER .AT2: four lines of header, the last with NPTS and DT in one of its forms, then values in g.

    The forms are ``NPTS=  4000, DT=   .0050 SEC`` and the older ``4000    0.0050    NPTS, DT``. Raises InputError.
    """
    lines = text.rstrip().split("\n")
    place = next((k for k, line in enumerate(lines[:12]) if re.search("NPTS", line, re.IGNORECASE)), None)
    if place is None:
        raise InputError(f"{file}: no NPTS, DT line in the header of this .AT2 file")
    line = lines[place]
    count = re.search(r"NPTS\s*=\s*(\d{1,9})", line, re.IGNORECASE)
    step = re.search(r"\bDT\s*=\s*" + _VALUE, line, re.IGNORECASE)
    older = re.match(r"\s*(\d{1,9})\s*,?\s+" + _VALUE, line)
    if count is not None and step is not None:
        points, sample_time = int(count.group(1)), _number(step.group(1))
    elif older is not None:
        points, sample_time = int(older.group(1)), _number(older.group(2))
    else:
        raise InputError(f"{file}: line {place + 1}: NPTS and DT not understood: {show(line.strip())}")
    units = " ".join(lines[:place]).upper()
    if re.search(r"\b(VELOCITY|DISPLACEMENT) TIME SERIES", units):
        raise InputError(f"{file}: a velocity or displacement series: the .AT2 file has the acceleration")
    stated = re.search(r"UNITS\s+OF\s+(\S+)", units)
    if stated is not None and stated.group(1).strip(".,()") != "G":
        raise InputError(f"{file}: units of {show(stated.group(1))}: an .AT2 file is in units of G")
    values: list[float] = []
    for k, row in enumerate(lines[place + 1 :], start=place + 2):
        # Fortran columns may touch: a sign after a digit starts a new number.
        for cell in re.sub(r"(?<=[\d.])(?=[+-])", " ", row).split():
            if not re.fullmatch(_VALUE, cell):
                raise InputError(f"{file}: line {k}: not a number: {show(cell)}")
            values.append(_number(cell))
    if len(values) != points:
        raise InputError(f"{file}: {len(values)} samples, its header says NPTS={points}")
    title = "; ".join(" ".join(line.split()) for line in lines[: min(place, 2)] if line.strip())
    return sample_time, np.asarray(values, dtype=np.float64) * STANDARD_GRAVITY, title


def _number(text: str) -> float:
    return float(text.lower().replace("d", "e"))


def _stated(file: str, comments: list[str], key: str) -> float | None:
    """The number after ``key=`` in the comments; None where there is none."""
    for comment in comments:
        match = re.search(rf"(?:^|[\s#,;]){key}\s*=\s*(\S*)", comment)
        if match is not None:
            text = match.group(1).rstrip(",;")
            if not re.fullmatch(_VALUE, text):
                raise InputError(f"{file}: {key}={show(text)} in the header is not a number")
            return _number(text)
    return None
