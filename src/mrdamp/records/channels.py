"""Names of the channels of a record, with the unit in the name, and what a wrong name was meant to be."""

from __future__ import annotations

import re
from collections.abc import Sequence

from mrdamp.errors import InputError

CHANNELS: dict[str, str] = {
    "time_s": "uniform time, s",
    "displacement_m": "piston displacement as the transducer reads it, m",
    "command": "commanded coil current, A (or driver voltage, V)",
    "force_N": "the damper's own (self-sensed) force, N",
    "reference_force_N": "the machine's load cell, N",
    "charge_pC": "charge of the damper's own force sensor, pC",
    "current_A": "measured coil current, A",
    "temperature_C": "fluid temperature, degree Celsius",
    "velocity_m_s": "measured piston velocity, m/s",
    "acceleration_m_s2": "measured piston acceleration, m/s2",
    "ground_acceleration_m_s2": "frame: ground acceleration, m/s2",
    "floorN_acceleration_m_s2": "frame: absolute acceleration of floor N = 1, 2, ..., m/s2",
    "floorN_displacement_m": "frame: displacement of floor N = 1, 2, ... to the ground, m",
}
"""Every channel a record may hold, and what it is."""

DAMPER_INPUTS = ("time_s", "displacement_m", "command")
"""What a simulation of a damper needs of a record."""

FRAME_INPUTS = ("time_s", "ground_acceleration_m_s2", "command")
"""What a simulation of a frame needs of a record."""

_FLOOR = re.compile(r"floor[1-9][0-9]*_(acceleration_m_s2|displacement_m)", re.ASCII)
#: Channel by its name without the unit.
_QUANTITIES = {re.sub("_(s|m|N|pC|A|C|m_s2?)$", "", name): name for name in CHANNELS if "floorN" not in name}
_UNIT = re.compile(
    r"[kmc]?n|lbf?|kgf"  # force
    r"|[mcun]?m|in(ch)?|ft"  # length
    r"|[mun]?s|sec(onds)?|min"  # time
    r"|m?a|amp(ere)?|m?v|volts?|[pn]c"  # current, voltage, charge
    r"|(deg_?)?[cfk]"  # temperature
    r"|([mc]?m|in|ft)_s(_?2)?|mps|g|gal"  # velocity, acceleration
)


def is_channel(name: str) -> bool:
    """True for a name of the table above (``floor3_displacement_m`` included)."""
    return (name in CHANNELS and "floorN" not in name) or _FLOOR.fullmatch(name) is not None


def canonical_name(name: str) -> str | None:
    """The channel that a name with a wrong, missing or differently written unit was meant to be.

    ``force_kN`` -> ``force_N``; ``Displacement [mm]`` -> ``displacement_m``; None where the name is
    right already, or is of another quantity altogether.
    """
    if is_channel(name):
        return None
    plain = re.sub(r"[^a-z0-9]+", "_", name.strip().lower()).strip("_")
    floor = re.fullmatch(r"floor_?([0-9]+)_(acceleration|displacement)(?:_(.*))?", plain, re.ASCII)
    if floor is not None:
        number, quantity, unit = floor.groups()
        if unit is None or _UNIT.fullmatch(unit):
            return f"floor{max(int(number[:6]), 1)}_{_QUANTITIES[quantity]}"
        return None
    for quantity, right in _QUANTITIES.items():
        unit = plain.removeprefix(quantity)
        if unit != plain and (not unit or (unit[0] == "_" and _UNIT.fullmatch(unit[1:]))):
            return right
    return None


def check_header(file: str, header: Sequence[str], required: Sequence[str] | None) -> tuple[str, ...]:
    """The channels of a header's stripped names, in file order.

    required: channels that must be there; None: the inputs of a damper, or of a frame where the file has a frame's
    channels. Raises InputError: a column without a name, a name twice, a wrong unit, a missing channel.
    """
    seen: set[str] = set()
    for position, name in enumerate(header, start=1):
        if not name:
            raise InputError(f"{file}: column {position} has no name in the header")
        if name in seen:
            raise InputError(f"{file}: two columns are named {show(name)}")
        seen.add(name)
        right = canonical_name(name)
        if right is not None:
            what = CHANNELS.get(right, "frame channel, SI units")
            raise InputError(f"{file}: column {show(name)} must be {right} ({what})")
    present = tuple(name for name in header if is_channel(name))
    if required is None:
        frame = any(name.startswith(("floor", "ground")) for name in present)
        required = FRAME_INPUTS if frame else DAMPER_INPUTS
    missing = [name for name in required if name not in present]
    if missing:
        raise InputError(
            f"{file}: missing channel {', '.join(missing)}; the file has {listed(header)};"
            f" channels are {', '.join(CHANNELS)}"
        )
    return present


def show(text: str) -> str:
    """Foreign text, quoted, printable and short, for an error line."""
    return ascii(text if len(text) <= 40 else text[:37] + "...")


def listed(names: Sequence[str]) -> str:
    """Column names for an error line: printable, the first twelve."""
    shown = [name if name.isascii() and name.isprintable() else ascii(name) for name in names[:12]]
    shown = [name if len(name) <= 40 else name[:37] + "..." for name in shown]
    return ", ".join(shown) + (f" and {len(names) - 12} more" if len(names) > 12 else "")
