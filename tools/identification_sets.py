"""What docs/identification/README.md shows: models of each set, their commands, an independent fit's errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

LAWS = ("bingham", "hyperbolic_tangent", "bouc_wen", "modified_bouc_wen")
VARYING = "sine_5.0Hz_2.5mm_random_current"


@dataclass(frozen=True)
class Row:
    """A model: its name in the table, its file, the command's arguments, and an independent fit's error."""

    name: str
    file: str
    arguments: tuple[str, ...]
    mark: float | None = None


@dataclass(frozen=True)
class Table:
    """Models evaluated on the same held-out records, under one protocol.

    cutoff: Hz, low-pass of the displacement. sample_time: s; evaluated at this rate too, all channels low-passed.
    without: part of names; evaluated without these records too. one_step: networks are also evaluated one step ahead.
    """

    title: str
    text: str
    rows: tuple[Row, ...]
    cutoff: float | None = None
    protocol: str = "records"
    sample_time: float | None = None
    without: str = ""
    one_step: bool = False


@dataclass(frozen=True)
class Page:
    """A set's section.

    shown: models whose command's own words and pictures are shown. loops: record and models of each picture.
    left_out: parts of names; all records of one such are left out in turn to evaluate the laws; the last is of
    another day.
    """

    title: str
    text: str
    tables: tuple[Table, ...]
    shown: tuple[str, ...] = ()
    loops: tuple[tuple[str, tuple[str, ...]], ...] = ()
    left_out: tuple[str, ...] = ()


def _laws(marks: Sequence[float | None], *options: str, suffix: str = "", note: str = "") -> tuple[Row, ...]:
    """A row per law with the same options; suffix of the files, note after the names."""
    return tuple(
        Row(law.replace("_", " ") + note, law + suffix, ("--law", law, *options), mark)
        for law, mark in zip(LAWS, marks, strict=True)
    )


_NONE = (None, None, None, None)
_CUT = ("--protocol", "varying", "--record", VARYING)
_EFFECTS = ("--extras", "offset", "driver_lag", "saturation", "gas_spring", "channel_shift")


_EMBEDDED = Page(
    "Embedded records",
    "Simulated, with other physics than the package's (`src/mrdamp/data/embedded/`).",
    (
        Table(
            "Whole records",
            "Nine records are fitted, eight others held out.",
            (
                *_laws(_NONE),
                Row("modified Bouc-Wen with effects", "effects", ("--law", "modified_bouc_wen", *_EFFECTS)),
                Row("network 15-20-1", "narx", ("--law", "narx")),
            ),
        ),
        Table(
            "Varying current, 4000:2000:1500 samples at 500 Hz",
            "Held out: test part and other records of random current.",
            (
                Row("modified Bouc-Wen", "cut_plain", ("--law", "modified_bouc_wen", *_CUT)),
                Row(
                    "modified Bouc-Wen with effects",
                    "cut_effects",
                    ("--law", "modified_bouc_wen", *_EFFECTS, *_CUT),
                ),
                Row("network 15-20-1", "cut_narx", ("--law", "narx", "--initialisations", "3", *_CUT)),
                Row(
                    "network, chosen and pruned",
                    "cut_chosen",
                    ("--law", "narx", "--select", "--prune", "--picture", "cut_chosen.png", *_CUT),
                ),
            ),
            protocol="varying",
            one_step=True,
        ),
    ),
    ("cut_narx", "cut_chosen"),
    (
        ("triangle_2.5Hz_2.5mm_random_current", ("cut_plain", "cut_effects", "cut_narx")),
        ("sine_1.0Hz_10.0mm_0.75A", ("hyperbolic_tangent", "bouc_wen", "modified_bouc_wen", "narx")),
    ),
)

_UTFSM = Page(
    "UTFSM press",
    "About 1.6 kN at 1 A, servo-hydraulic (github.com/DanielMaurelE/vRTHS_AMBC_MRdamper, MIT licence). Training: "
    "sines (25 mm 0.5 Hz, 10 mm 2 Hz, 5 mm 3 Hz; 0, .25, .5, 1 A). Held out: 25 mm 0.25 Hz, and a 2 mm sweep from"
    " 0 to 15 Hz of another day.",
    (
        Table(
            "Laws and network",
            "On the day of the sweep the damper was stronger (at .5 A 1.16 to 1.21 times). S: "
            "`quadratic_saturating`.",
            (
                *_laws((0.24, 0.14, 0.13, 0.12), "--dependence", "quadratic"),
                *_laws(
                    (0.24, 0.14, 0.13, 0.12), "--dependence", "quadratic_saturating", suffix="_s", note=", S"
                ),
                Row(
                    "network 9-8-1",
                    "narx",
                    (
                        "--law",
                        "narx",
                        "--lags",
                        "2",
                        "--hidden",
                        "8",
                        "--initialisations",
                        "4",
                        "--refined",
                        "4",
                    ),
                ),
            ),
        ),
    ),
    ("narx",),
    (("sine_25mm_0.25Hz_0.50A", ("hyperbolic_tangent", "modified_bouc_wen", "narx")),),
    left_out=("25mm_0.50Hz", "10mm_2.00Hz", "05mm_3.00Hz", "25mm_0.25Hz", "chirp"),
)

_UTFPR = Page(
    "UTFPR sine rig",
    "RD-8041, motor-driven (doi 10.5281/zenodo.4445334, A. N. Vargas, MIT licence). Sines of 3.6 to 20 mm at .46 "
    "to 1.5 Hz and four coil voltages. The current is inferred.",
    (
        Table(
            "As recorded",
            "The tests at 0 V named 50Hz have ten times the noise in the displacement. Bouc-Wen's force reverses over "
            "a displacement, this damper's over a velocity.",
            (
                *_laws((0.24, 0.12, 0.13, 0.09), "--dependence", "quadratic"),
                Row(
                    "network 6-6-1",
                    "narx",
                    (
                        "--law",
                        "narx",
                        "--lags",
                        "1",
                        "--hidden",
                        "6",
                        "--initialisations",
                        "3",
                        "--refined",
                        "3",
                    ),
                ),
            ),
            without="50Hz",
        ),
        Table(
            "Displacement low-passed at 8 Hz",
            "The motions end at 1.5 Hz.",
            _laws((0.24, 0.12, 0.13, 0.09), "--starts", "2", suffix="_8Hz"),
            cutoff=8.0,
            without="50Hz",
        ),
    ),
    ("narx",),
    (("1.98V_ensaio.B.6", ("modified_bouc_wen", "narx")),),
)

_NEES = Page(
    "NEES prototype",
    "Lord's 3 kN prototype (S. Dyke, doi 10.4231/D3V11VM6X; licence not verified). Random displacement to 50 Hz, "
    "random two-level voltage, 3004.8 Hz. Three training records, one held out.",
    (
        Table(
            "Plain laws",
            "Last row: preload k1 x0 as an offset, quadratic in the command, as the reference.",
            (
                *_laws((0.48, 0.37, 0.37, 0.34), "--starts", "2", "--extras"),
                Row(
                    "modified Bouc-Wen, its preload as offset",
                    "offset",
                    ("--law", "modified_bouc_wen", "--dependence", "quadratic"),
                    0.34,
                ),
            ),
        ),
        Table(
            "With effects, and the network",
            "The network and its reference run at 300 Hz on low-passed velocities.",
            (
                *_laws((0.31, 0.21, 0.18, 0.165), "--starts", "2", "--extras", "offset", "gas_spring", "driver_lag",
                       "--dependence", "quadratic", suffix="_effects", note=", effects"),
                Row(
                    "modified Bouc-Wen, channel shift too",
                    "shift",
                    ("--law", "modified_bouc_wen", "--starts", "2", "--extras", "offset", "gas_spring", "driver_lag",
                     "channel_shift"),
                ),
                Row("network 15-20-1", "narx", ("--law", "narx", "--sample-time", "0.003328", "--lags", "4"), 0.09),
            ),
            sample_time=3.328e-3,
        ),
    ),
    ("narx",),
    (("random_4", ("modified_bouc_wen", "modified_bouc_wen_effects", "shift", "narx")),),
)  # fmt: skip

SETS: Mapping[str, Page] = {"embedded": _EMBEDDED, "utfsm": _UTFSM, "utfpr": _UTFPR, "nees": _NEES}
