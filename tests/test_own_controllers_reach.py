"""What a controller of one's own, and a policy in a loop of one's own, can and cannot reach."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mrdamp
from env_arguments import OWN as ISOLATED
from mrdamp.compare.benches import bench_of
from mrdamp.compare.contenders import contenders
from mrdamp.control.policy import Policy
from refusals import refuses
from test_own_controllers import BENCH, OWN, write

SHIPPED = next((Path(mrdamp.__file__).parent / "data/policies/frame/learned").glob("*.json"))


@pytest.mark.parametrize("structure", ["cable", "car", "own"])
def test_no_controller_sees_behind_the_sensor(tmp_path: Path, structure: str) -> None:
    bench = bench_of(ISOLATED if structure == "own" else structure, engine="chain")
    assert {"force", "stroke"} <= set(bench.measured)
    mine = f"mine={write(tmp_path, 'y[{!r}]'.format('true_force'))}:Broken"
    refuses(lambda: contenders(bench, [mine], {}), "KeyError: 'true_force'")


def test_what_a_controller_changes_in_its_site_is_not_the_plants(tmp_path: Path) -> None:
    """Passive-on beside one that weakens the damper's parameters and the matrices that it is given."""
    file = tmp_path / "weaken.py"
    file.write_text(
        OWN.replace("{body}", "0.0").replace(
            "self.value = site.command_max / 2",
            "self.value = 0.0\n        own = site.damper.parameters\n        own.update({k: 0.2 * own[k] for k in own})"
            "\n        if hasattr(site, 'structure'):\n            site.structure.at[:] = 0.0",
        )
    )
    for bench in (replace(BENCH, engine="chain"), bench_of(ISOLATED, engine="chain")):
        load = bench.unseen_loads()[:1]
        spec = spec_of(bench, file)
        alone = bench.run("passive-on", load[0], 1.0)
        bench.run(spec, load[0], 1.0)
        assert bench.run("passive-on", load[0], 1.0) == alone


def spec_of(bench: Any, file: Path) -> str:
    ((spec,),) = (row.specs for row in contenders(bench, [f"mine={file}:Steady"], {}))
    return str(spec)


def test_a_policy_says_so_where_a_measurement_is_no_number() -> None:
    policy = Policy.read(SHIPPED)
    y = dict.fromkeys(policy.observer.signals, 0.0) | {"force": 0.0}
    before = policy.command(0.0, y)
    refuses(
        lambda: policy.command(0.005, y | {policy.observer.signals[0]: np.nan}),
        "is nan; allowed: finite numbers",
    )
    policy.reset()
    assert policy.command(0.0, y) == before
