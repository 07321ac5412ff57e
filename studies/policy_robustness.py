"""Policies on the real frames of `studies.gap`: the score less passive-on's, 95 % intervals over motions and seeds.

    python -m studies.policy_robustness [--as-trained | --sensor-lag S] [--effects NAME ...] [--loads N] POLICY.json ...

The rig shares no code with the plugin, has no driver lag but with `driver_lag`, and one effect at a time. --as-trained:
without the lag that a policy is given on a faster driver (`Policy.matched`). --sensor-lag: that of the force sensor, as
the policies are told it. The policies are seeds of one training.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from mrdamp.compare.comparison import interval
from mrdamp.control.base import Controller
from mrdamp.control.passive import passive_on
from mrdamp.control.policy import Policy
from mrdamp.control.registry import Site
from mrdamp.errors import InputError
from mrdamp.gap import Options
from studies.gap.real import EFFECTS, NONE, RealFrame, RigScenario, nominal_frame


def main(arguments: list[str] | None = None) -> int:
    """Prints a row of the table for each effect."""
    causes = (NONE, *EFFECTS)
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("policies", nargs="+", type=Path, metavar="POLICY.json")
    told = p.add_mutually_exclusive_group()
    told.add_argument("--as-trained", action="store_true")
    told.add_argument("--sensor-lag", type=float, default=0.0, metavar="S", help="s (default: none)")
    p.add_argument(
        "--effects", nargs="+", choices=causes, default=causes, metavar="NAME", help=", ".join(causes)
    )
    p.add_argument("--loads", type=int, default=6, help="unseen motions (default: %(default)s)")
    a = p.parse_args(arguments)
    try:
        policies = [Policy.read(file) for file in a.policies]
        scenario = RigScenario(nominal_frame(), Options("constant", a.loads))
        if not a.as_trained:
            policies = [q.matched(scenario.nominal.command_lag, a.sensor_lag) for q in policies]
    except InputError as error:
        p.exit(2, f"policy_robustness: {error}\n")
    site = Site.of(scenario.nominal)

    def scores(real: RealFrame, controller: Controller) -> list[float]:
        return [
            scenario.score([scenario.criteria(real, controller, load)], [load]) for load in scenario.loads
        ]

    print("| real frame | passive-on | policies | less passive-on |\n|---|---:|---:|---|")
    for cause in a.effects:
        print(f"{cause}: {1 + len(policies)} controllers, {a.loads} motions", file=sys.stderr)
        real = RealFrame(scenario.nominal, cause)
        base = np.array(scores(real, passive_on(site.command_max, site.period)))
        found = np.array([scores(real, policy) for policy in policies])
        low, high = interval((found - base)[:, :, None])
        mean = float((found - base).mean())
        print(
            f"| {cause} | {base.mean():.3f} | {found.mean():.3f} | {mean:+.3f} ({low:+.3f} to {high:+.3f}) |",
            flush=True,
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
