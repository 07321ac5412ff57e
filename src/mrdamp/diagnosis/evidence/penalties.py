"""Fits whose causes are there in name only, and what is held against them (nats)."""

from __future__ import annotations

from collections.abc import Collection

from mrdamp.diagnosis.constants import LOGIT_LAW, LOOPS, NOT_ITSELF, REDUCIBLE, SENSOR_AGREES
from mrdamp.diagnosis.evidence.verdict import idle_price
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.problem.rig import Rig

#: Numbers that together make a cause: where they stand at their lower ends it is another one. A mount without its
#: clearance is a spring, and what is left of a lag without its time is a form of something else.
_MAKING = (frozenset({"backlash_gap"}), frozenset({"driver_lag_tau", "driver_lag_tau2"}))


def of_itself(found: Fit) -> float:
    """Against a fit with a cause that is gone where it stands."""
    return NOT_ITSELF * gone(found)


def of_damper(
    rig: Rig, found: Fit, free: Fit, *, clears_sensor: bool = False, inexact: bool = False
) -> float:
    """Against a fit of a damper's records on which free numbers alone (`free`) do as well or would say the same.

    clears_sensor: the load cell beside the force sensor speaks against all of its effects. inexact: the law
    is not the rig's, and its numbers are no plainer statement than a gain: the two are told as tied.
    """
    penalty = 0.0 if inexact else NOT_ITSELF * unreferenced(rig, found)
    law = rig.model({}).law if inexact else ""
    if {c.partition("@")[0] for c in found.hypothesis.causes} & LOOPS.get(law, frozenset()):
        penalty += LOGIT_LAW
    if clears_sensor and any(c.startswith("sensor_") for c in found.hypothesis.causes):
        penalty += SENSOR_AGREES
    if found.hypothesis.nominal and found.hypothesis.causes and found.cost > (1 - REDUCIBLE) * free.cost:
        penalty += idle_price(found.move)
    return penalty


def of_parts(found: Fit, clean: Collection[str]) -> float:
    """Against a fit of a frame's records with a cause in a storey or an accelerometer that is in balance. clean: names
    of the parts that are."""
    placed = (t for t in found.hypothesis.terms if t.place is not None)
    parts = {f"{'accelerometer' if t.stage == 'sensor' else 'storey'} {t.place}" for t in placed}
    return SENSOR_AGREES * len(parts & set(clean))


def gone(found: Fit) -> bool:
    """True where one of its causes is there in name only."""
    low = set(found.at_lower_bounds)
    own = {c.name for c in found.hypothesis.coordinates}
    return any(making & own and making & own <= low for making in _MAKING)


def unreferenced(rig: Rig, found: Fit) -> bool:
    """True where a gain of the force channel is only a common factor in the law's numbers: with no reference beside
    the sensor no record can tell the two apart, and numbers that are off are the plainer statement."""
    if "reference_force_N" in rig.channels or not rig.nominal:
        return False
    return "sensor_gain" in found.hypothesis.causes
