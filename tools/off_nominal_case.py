"""Records a frame whose stiffness or mass is not as thought, in MuJoCo, as a case for `mrdamp diagnose`.

    python tools/off_nominal_case.py --stiffness -10 out/soft
    mrdamp diagnose out/soft/case -o out/soft/diagnosis
    mrdamp compare frame --model out/soft/true.json --told out/soft/diagnosis/corrected.json -o out/soft/told

Three records at 500 Hz with white noise, of motions that no controller is judged on: without command, with the largest,
and with commands that switch at random.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from mrdamp.compare.benches import scaled
from mrdamp.compare.dyke1996 import frame_model
from mrdamp.control.passive import Replay
from mrdamp.envs.training_loads import tuning_motions
from mrdamp.files import write_atomic
from mrdamp.motions import TIME_SCALE
from mrdamp.records.csv_file import render
from mrdamp.simulation.stepping import run_frame

PERIOD, HELD = 2e-3, 25  # s of a sample; samples that a command is held for
#: Standard deviations of the noise: m/s2, m, N.
NOISE = {"acceleration": 5e-3, "displacement": 5e-6, "force": 1.0}


def main() -> None:
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    p.add_argument("out", type=Path)
    p.add_argument("--stiffness", type=float, default=0.0, help="percent more than the nominal one")
    p.add_argument("--mass", type=float, default=0.0, help="percent more than the nominal one")
    a = p.parse_args()
    nominal = frame_model()
    true = scaled(scaled(nominal, "stiffness", 1 + a.stiffness / 100), "mass", 1 + a.mass / 100)
    case, rng = a.out / "case", np.random.default_rng(11)
    case.mkdir(parents=True, exist_ok=True)
    true.write(a.out / "true.json")
    largest, files = nominal.attributes["command_max"], []
    for k, motion in enumerate(tuning_motions()):
        played = motion.compressed(TIME_SCALE)
        n = int(played.duration / PERIOD) + 2
        levels = rng.uniform(0.0, largest, n // HELD + 1) * rng.integers(0, 2, n // HELD + 1)
        commands = (np.zeros(n), np.full(n, largest), np.repeat(levels, HELD)[:n])[k]
        found = run_frame(true, played, Replay(commands, PERIOD, "record"), timestep=2.5e-4)
        assert true.structure is not None
        x = true.structure.displacement(found.drift)
        record = {
            "time_s": found.time,
            "ground_acceleration_m_s2": np.interp(found.time, played.time, played.acceleration),
            "command": found.command,
        }
        for name, values in (("acceleration_m_s2", found.acceleration), ("displacement_m", x)):
            noise = NOISE[name.partition("_")[0]] * rng.standard_normal(values.shape)
            record |= {f"floor{j + 1}_{name}": column for j, column in enumerate((values + noise).T)}
        record["force_N"] = found.force + NOISE["force"] * rng.standard_normal(len(found.force))
        files.append(f"{k + 1}_{motion.name}.csv")
        write_atomic(case / files[-1], render(record))
    body = nominal.to_dict()["model"]
    head = {"name": a.out.name, "format": 1, "rig": "frame", "sample_rate_hz": 1 / PERIOD}
    about = {**head, "hold": True, "nominal": body, "channels": list(record), "records": files}
    write_atomic(case / "case.json", json.dumps(about, indent=1) + "\n")


if __name__ == "__main__":
    main()
