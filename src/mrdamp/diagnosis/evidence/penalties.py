"""Penalties (nats) of fits whose causes are nominal only, or cannot be separated from others."""

from __future__ import annotations

import math
from collections.abc import Collection

from mrdamp.diagnosis.constants import CAUSE, LAW, LOOPS
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.problem.rig import Rig

#: Parameters that together define a cause; with all of them at their lower limits it is another cause. A
#: mount without clearance is a spring, and a lag without its time constant is a form of another effect.
_MAKING = (frozenset({"backlash_gap"}), frozenset({"driver_lag_tau", "driver_lag_tau2"}))


def of_itself(found: Fit, beside: int = 0) -> float:
    """Penalty of a fit with a cause whose parameters make it another one, and of its forms: those of a cause share its
    prior, or a cause with many forms would count as many causes. On opened cases without that, mounts (5 forms) and
    trapped gas (8) were right in 18 of 32 answers, all other causes in 238 of 242. beside: number of its terms that are
    taken for granted."""
    return CAUSE * gone(found) + sum(math.log(t.forms) for t in found.hypothesis.terms[beside:])


def of_damper(rig: Rig, found: Fit, *, unsure: bool = False) -> float:
    """Penalty of a fit of a damper's records if free nominal parameters alone or another law are as good or equivalent.

    The nominal parameters are no simpler explanation than a gain of the sensor beside fixed ones: the two are reported
    as tied. unsure: neither the noise, which no fit reaches, nor baseline records show that the law is the rig's.
    """
    penalty = CAUSE * (bool(found.hypothesis.nominal) and unreferenced(rig, found))
    return penalty + (of_law(rig, found.hypothesis.causes) if unsure else 0.0)


def of_law(rig: Rig, causes: Collection[str]) -> float:
    """Penalty of causes with the hysteresis that the law lacks, if it is not known to be the rig's."""
    return LAW * bool({c.partition("@")[0] for c in causes} & LOOPS.get(rig.model({}).law, frozenset()))


def gone(found: Fit) -> bool:
    """True if a cause of the fit has vanished, or is another one by its parameters."""
    if any(t.is_other is not None and t.is_other(found.settings) for t in found.hypothesis.terms):
        return True
    low = set(found.at_lower_bounds)
    own = {c.name for c in found.hypothesis.coordinates}
    return any(making & own and making & own <= low for making in _MAKING)


def unreferenced(rig: Rig, found: Fit) -> bool:
    """True if a gain of the force channel is a common factor of the nominal parameters. Without a reference
    for the sensor no record can separate the two, and wrong parameters are the simpler explanation."""
    if "reference_force_N" in rig.channels or not rig.nominal:
        return False
    return "sensor_gain" in found.hypothesis.causes
