"""The three-storey frame with a Bouc-Wen element in OpenSees, a process of its own: `python opensees_frame.py SPEC`.

SPEC: JSON with time_step (s), mass (kg), stiffness (N/m) and damping (N s/m) by storey, ground (accelerations at
`ground_step` s, m/s2) and damper: c0 (N s/m), k0 (N/m), alpha (N), A, beta, gamma, n of the Bouc-Wen law.
Then, on standard input, one number a line: that many steps are made, and the answer is a line of JSON with their
CPU time (`cost`, us a step) or, for a negative number, that many steps one by one with floor 1's displacements
(`drift`, m) and the damper's force (`force`, N). Needs nothing but openseespy, and imports nothing of mrdamp.
"""

from __future__ import annotations

import ctypes
import importlib.util
import json
import sys
import time
from pathlib import Path
from typing import Any


def load() -> Any:
    """The module opensees; its own copies of the libraries it needs are not on the loader's path."""
    spec = importlib.util.find_spec("openseespylinux")
    for place in (spec.submodule_search_locations or ()) if spec else ():
        for name in (
            "libquadmath.so.0",
            "libgfortran.so.4",
            "libblas.so.3",
            "liblapack.so.3",
            "libgomp.so.1",
        ):
            if (file := Path(place) / "lib" / name).is_file():
                ctypes.CDLL(str(file), mode=ctypes.RTLD_GLOBAL)
    from openseespy import opensees

    return opensees


def build(ops: Any, spec: dict[str, Any]) -> None:
    """Nodes on a line with one degree of freedom each; storeys and damper are elements of no length."""
    ops.wipe()
    ops.model("basic", "-ndm", 1, "-ndf", 1)
    ops.node(0, 0.0)
    ops.fix(0, 1)
    for j, (mass, k, c) in enumerate(zip(spec["mass"], spec["stiffness"], spec["damping"], strict=True), 1):
        ops.node(j, 0.0)
        ops.mass(j, mass)
        ops.uniaxialMaterial("Elastic", j, k, c)
        ops.element("zeroLength", j, j - 1, j, "-mat", j, "-dir", 1)
    d = spec["damper"]
    # Force: share k x + (1 - share) k z, so that the spring is k0 and the hysteretic part alpha z.
    stiff = d["k0"] + d["alpha"]
    ops.uniaxialMaterial(
        "BoucWen", 10, d["k0"] / stiff, stiff, d["n"], d["gamma"], d["beta"], d["A"], 0.0, 0.0, 0.0
    )
    ops.uniaxialMaterial("Elastic", 11, 0.0, d["c0"])
    ops.element("zeroLength", 10, 0, 1, "-mat", 10, "-dir", 1)
    ops.element("zeroLength", 11, 0, 1, "-mat", 11, "-dir", 1)
    ops.timeSeries("Path", 1, "-dt", spec["ground_step"], "-values", *spec["ground"])
    ops.pattern("UniformExcitation", 1, 1, "-accel", 1)
    ops.constraints("Plain")
    ops.numberer("Plain")
    ops.system(spec.get("system", "ProfileSPD"))
    ops.test("NormDispIncr", 1e-8, 20)
    ops.algorithm("Newton")
    ops.integrator("Newmark", 0.5, 0.25)
    ops.analysis("Transient")


def main() -> None:
    ops, spec = load(), json.loads(Path(sys.argv[1]).read_text())
    build(ops, spec)
    dt, end = spec["time_step"], spec["ground_step"] * (len(spec["ground"]) - 2)
    print(json.dumps({"version": ops.version()}), flush=True)
    for line in sys.stdin:
        n = int(line)
        if ops.getTime() + abs(n) * dt > end:
            build(ops, spec)
        if n >= 0:
            begin = time.thread_time_ns()
            failed = ops.analyze(n, dt)
            answer: dict[str, Any] = {"cost": (time.thread_time_ns() - begin) * 1e-3 / n}
        else:
            failed, answer = 0, {"drift": [], "force": []}
            for _ in range(-n):
                failed = failed or ops.analyze(1, dt)
                answer["drift"].append(ops.nodeDisp(1, 1))
                # No damping counted in a basicForce; the dashpot's share is put to it by its velocity.
                answer["force"].append(ops.basicForce(10)[0] + spec["damper"]["c0"] * ops.nodeVel(1, 1))
        if failed:
            answer = {"error": f"analyze returned {failed}"}
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
