"""Does a test fail where the physics is wrong? `python tools/mutants.py [--only TEXT ...] [--again]`.

Each mutant is one wrong sign, factor or unit, or one missing term, of a law, an effect, a criterion or a reward. The
tree is copied to build/mutants. There all mutants of C++ are compiled into one library, and the environment variable
MRDAMP_MUTANT chooses one; those of Python are written into the copy. For each, the tests that should see it run until
the first one fails. Results are kept in build/mutants/results.json, and the same command goes on where it was stopped.
Prints the score; the exit code is 1 where a mutant survives.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.util
import json
import multiprocessing
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy  # noqa: F401  (with SciPy, for the forks)
import pytest
import scipy.integrate
import scipy.optimize
import scipy.signal  # noqa: F401

ROOT = Path(__file__).resolve().parents[1]
WORK = ROOT / "build" / "mutants"
TREE = WORK / "tree"
RESULTS = WORK / "results.json"
_TIME = 900  # s, of the tests of one mutant
_NO_TESTS = 5  # exit code of pytest
_COPIED = ("src", "tests", "tools", "studies", "models_xml", "examples")
#: Packs take most of the compiler's time; they have the numbers of the plain library, to the bit.
_NO_PACKS = ('MATCHES "x86_64|AMD64"', 'MATCHES "none"')
_SWITCH = """#include <cstdlib>
namespace mrdamp {
inline const int kMutant = std::getenv("MRDAMP_MUTANT") ? std::atoi(std::getenv("MRDAMP_MUTANT")) : 0;
}
"""
_REAL = '#include "core/real.h"\n'  # which has the switch
@dataclass(frozen=True)
class Mutant:
    """`wrong` in place of `right`, which stands once in the file behind `before`; tests: files that should see it."""

    of: str
    file: str
    right: str
    wrong: str
    tests: tuple[str, ...]
    before: str = ""

    @property
    def cpp(self) -> bool:
        return self.file.endswith((".h", ".cc"))

    @property
    def name(self) -> str:
        return f"{self.of}: {self.before}{self.right} -> {self.wrong}"

    def applied(self, text: str, number: int) -> str:
        """The file's text with the mutant; of C++ as a choice by `number`. Raises ValueError where it does not
        stand there once."""
        whole = self.before + self.right
        if text.count(whole) != 1:
            raise ValueError(f"{self.file}: {whole!r} stands there {text.count(whole)} times; once is needed")
        new = f"(kMutant == {number} ? ({self.wrong}) : ({self.right}))" if self.cpp else self.wrong
        return text.replace(whole, self.before + new)


def _some(of: str, file: str, tests: str, *pairs: tuple[str, ...]) -> Iterator[Mutant]:
    for right, wrong, *before in pairs:
        yield Mutant(of, file, right, wrong, tuple(f"tests/test_{t}.py" for t in tests.split()), *before)


_L, _E = "plugin_cpp/laws/", "plugin_cpp/effects/"
_FORMS = "effect_forms current_forms effects"
_MOUNT = "current_forms effect_forms effects"
MUTANTS = (
    *_some("bingham", _L + "bingham.h", "laws plugin_physics",
           ("k.c0 * v + k.yield * turn", "k.c0 * v - k.yield * turn"),
           ("k.c0 + k.yield * (1 - turn * turn) / width", "0.5 * k.c0")),
    *_some("bouc_wen", _L + "bouc_wen.h", "laws plugin_physics",
           ("k.c0 * v + k.yield * z", "0.5 * k.c0 * v + k.yield * z"),
           ("x - p.x0", "x + p.x0")),
    *_some("Bouc-Wen z", _L + "hysteresis.h", "laws",
           ("c * (u + c * t) / (c + u * t)", "c * (u + c * t) / (c - u * t)"),
           ("-expm1(-k * s) / k", "0.5 * -expm1(-k * s) / k"),
           ("A - k * power * a", "A - 0.5 * k * power * a"),
           ("beta + Select(back, -gamma, gamma)", "gamma + Select(back, -beta, beta)")),
    *_some("hyperbolic_tangent", _L + "hyperbolic_tangent.h", "laws plugin_physics",
           ("k.k1 * (x - g) + k.c1 * (v - rate)", "k.k1 * (x - g) + k.c1 * v"),
           ("mass * *rate + k.k1 * x1 + k.c1 * m.vb - spring * from", "mass * *rate + k.k1 * x1 + k.c1 * m.vb"),
           ("p.m0 / dt", "0.5 * p.m0 / dt", "double dt = m.dt;\n    const Real mass = ")),
    *_some("modified_bouc_wen", _L + "modified_bouc_wen.h", "laws plugin_physics",
           ("k.c1 * v - k.yield * z - k.k0 * r", "k.c1 * v - k.yield * z + k.k0 * r"),
           ("k.k1 * (x - p.x0)", "k.k1 * x")),
    *_some("narx", _L + "narx.cc", "narx",
           ("from[0] * force_scale + force_offset", "from[0] * force_scale"),
           ("std::tanh(s)", "std::atan(s)")),
    *_some("dependence on the field", _L + "coefficients.h", "laws effects",
           ("slope + c * b", "slope - c * b"),
           ("1 - exp(-r * max(b, 0.0))", "exp(-r * max(b, 0.0))")),
    *_some("hysteresis_rate", _L + "bouc_wen.h", "laws effects",
           ("exp(-p.hysteresis_rate * max(f.b, 0.0))", "exp(-2 * p.hysteresis_rate * max(f.b, 0.0))")),
    *_some("shear_thinning", _L + "coefficients.h", _FORMS,
           ("(p.shear_thinning_m - 1) / a", "(1 - p.shear_thinning_m) / a")),
    *_some("shear_thinning of c1", _L + "law.h", _FORMS,
           ("1 + p.shear_thinning_series * (thin - 1)", "1 - p.shear_thinning_series * (thin - 1)")),
    *_some("asymmetry", _L + "law.h", _FORMS,
           ("1 + p.asymmetry_yield * side", "1 - p.asymmetry_yield * side"),
           ("1 + p.asymmetry_viscous * side", "1 + 0.5 * p.asymmetry_viscous * side")),
    *_some("driver_lag", _E + "driver.h", _FORMS,
           ("u1 - trail + (i - u0 + trail) * exp(-dt / tau)", "u1 + (i - u0) * exp(-dt / tau)"),
           ("fabs(mean) < fabs(from)", "fabs(mean) > fabs(from)"),
           ("p.driver_lag_rate * dt", "2 * p.driver_lag_rate * dt"),
           ("2 * p.driver_lag_ratio / p.driver_lag_tau", "p.driver_lag_ratio / p.driver_lag_tau"),
           ("gain * e / reset", "gain * e * reset"),
           ("first.y + share * (second - first.y)", "first.y + (1 - share) * (second - first.y)"),
           ("e * (b * divided - Lag(0, 1, decay, tau2, dt))", "0 * e")),
    *_some("command_delay", _E + "driver.h", _FORMS,
           ("t - Head(p.command_delay_d)", "t - 0.5 * Head(p.command_delay_d)", "sent = "),
           ("line.Mean(sent - spread, sent + spread, hold)", "line.Mean(sent - 2 * spread, sent + 2 * spread, hold)"),
           ("Tick(p, t + kSame) + Head(p.command_delay_phase)", "Tick(p, t + kSame)")),
    *_some("saturation", _E + "magnetics.h", _FORMS,
           ("p.saturation_i_s * tanh(q)", "0.9 * p.saturation_i_s * tanh(q)"),
           ("pow(1 + pow(fabs(q), p.saturation_shape), 1 / p.saturation_shape)",
            "pow(1 + pow(fabs(q), p.saturation_shape), p.saturation_shape)"),
           ("b * p.saturation_full / SaturationCurve(p, p.saturation_full)", "b")),
    *_some("remanence", _E + "magnetics.h", _FORMS,
           ("i - p.remanence_b * faded", "i + p.remanence_b * faded"),
           ("exp(-q * q)", "exp(-q)"),
           ("sign * i < 0", "sign * i > 0"),
           ("p.remanence_d * 2 * (k + 1) / (kStops + 1)", "p.remanence_d * (k + 1) / (kStops + 1)")),
    *_some("heating", _E + "fluid.h", _FORMS,
           ("exp(-loss / capacity * dt)", "exp(-0.5 * loss / capacity * dt)"),
           ("exp(-p.heating_kappa * rise)", "exp(p.heating_kappa * rise)"),
           ("r.fluid - r.body", "r.fluid + r.body")),
    *_some("asymmetry", _E + "fluid.h", _FORMS,
           ("1 + p.asymmetry_a * t", "1 - p.asymmetry_a * t", "return "),
           ("f * (1 + p.asymmetry_a * t)", "f"),
           ("2 * path / p.asymmetry_travel", "path / p.asymmetry_travel")),
    *_some("trapped_gas", _E + "fluid.h", _FORMS,
           ("1 - p.trapped_gas_d * moving * lost", "1 + p.trapped_gas_d * moving * lost"),
           ("fmax(1 - power, 0.0)", "fmax(1 - 0.5 * power, 0.0)"),
           ("pow(left, p.trapped_gas_shape)", "pow(left, -p.trapped_gas_shape)"),
           ("exp(-dt / p.trapped_gas_time)", "exp(-2 * dt / p.trapped_gas_time)"),
           ("p.trapped_gas_force * expm1(-p.trapped_gas_shape * log1p(-share))",
            "0.5 * p.trapped_gas_force * expm1(-p.trapped_gas_shape * log1p(-share))")),
    *_some("gas_spring", _E + "mechanics.h", _FORMS,
           ("(p.gas_spring_k2 + p.gas_spring_k3 * x) * x", "(p.gas_spring_k2 - p.gas_spring_k3 * x) * x"),
           ("p.gas_spring_f0", "-p.gas_spring_f0")),
    *_some("moving_mass", _E + "mechanics.h", _FORMS + " plugin_stability",
           ("p.moving_mass_m * (1 - p.moving_mass_share)", "p.moving_mass_m"),
           ("2 * kPi * p.moving_mass_hz", "p.moving_mass_hz", "sprung->first.Step("),
           ("second - first", "second + first")),
    *_some("moving_mass", "plugin_cpp/core/chain.cc", _FORMS,
           ("RodMass(p, HasMount(p)) * a", "-RodMass(p, HasMount(p)) * a")),
    *_some(
        "channel_shift", "plugin_cpp/core/record.cc", _FORMS, ("p.channel_shift_d", "-p.channel_shift_d", "TakeBack(")
    ),
    *_some("motion_lag", "plugin_cpp/core/shift.h", _FORMS,
           ("tau * v[i]", "-tau * v[i]", "x[i] += "),
           ("w[kGrid + j] * off", "-w[kGrid + j] * off", "own[i + j] += ")),
    *_some("seal_friction", _E + "mechanics.h", _FORMS,
           ("breakaway - 1", "breakaway", "coulomb * (1 + ("),
           ("Select(dx > 0, limit, -limit) / sigma", "Select(dx > 0, -limit, limit) / sigma"),
           ("limit * t", "0.5 * limit * t")),
    *_some("mount_compliance", _E + "mount.h", _MOUNT,
           ("d * (1 + p.mount_compliance_k3 * d * d)", "d * (1 - p.mount_compliance_k3 * d * d)"),
           ("more * Beyond(p.mount_compliance_stop, d)", "0.5 * more * Beyond(p.mount_compliance_stop, d)"),
           ("spring + p.mount_compliance_friction * share", "spring - p.mount_compliance_friction * share"),
           ("MountStiffness(p) * p.mount_compliance_loss * Eased(p, d, over)", "0 * d")),
    *_some("backlash", _E + "mount.h", _MOUNT, ("0.5 * p.backlash_gap", "p.backlash_gap", "Beyond(")),
    *_some("sensor_*", _E + "sensor.h", "effects effect_forms frame_entry",
           ("p.gain * (f - in) / dt * tau * (1 - decay)", "0.5 * p.gain * (f - in) / dt * tau * (1 - decay)"),
           ("p.gain * f", "f", "if (!(Head(tau) > 0)) return "),
           ("second + p.offset + p.settle * unsettled", "second - p.offset + p.settle * unsettled"),
           ("exp(-dt / p.settle_time)", "exp(-dt * p.settle_time)"),
           ("charge + p.share * (charge2 - charge)", "charge + (1 - p.share) * (charge2 - charge)"),
           ("Lag(first, from, now, p.lag, dt)", "Lag(first, from, now, 2 * p.lag, dt)"),
           ("2 * p.ratio / p.lag", "p.ratio / p.lag")),
    *_some("effects of a frame", "src/mrdamp/model/damper.py", "model frame_entry",
           ("[k] *= 1 + value", "[k] *= 1 - value"), ('columns["mass"][k] += value', 'columns["mass"][k] -= value'),
           ("np.zeros(s.storeys))[k] = value", "np.zeros(s.storeys))[k] = 2 * value")),
    *_some("criteria", "src/mrdamp/simulation/criteria.py", "criteria",
           ('"J1": float(self.peak_drift.max() / u', '"J1": float(self.peak_drift.min() / u'),
           ('"J2": float(self.peak_acceleration.max()', '"J2": float(self.peak_acceleration.min()'),
           ('"J3": self.peak_base_shear / u.peak_base_shear', '"J3": self.peak_base_shear / u.rms_base_shear'),
           ('"J4": float(self.rms_drift.max()', '"J4": float(self.peak_drift.max()'),
           ('"J5": float(self.rms_acceleration.max()', '"J5": float(self.peak_acceleration.max()'),
           ('"J6": self.rms_base_shear / u.rms_base_shear', '"J6": self.rms_base_shear / u.peak_base_shear'),
           ('"J11": self.peak_force / self.weight', '"J11": self.rms_force / self.weight'),
           ('"J12": self.peak_stroke / u.peak_stroke', '"J12": u.peak_stroke / self.peak_stroke'),
           ("(f[1:] + f[:-1]) / 2", "(f[1:] + f[:-1])"),
           ("np.abs(u[:-1]).mean(axis=1) @ held", "u[:-1].mean(axis=1) @ held"),
           ("shear = a @ frame.mass", "shear = a @ frame.stiffness"),
           ("np.trapezoid(values**2, t, axis=0) / (t[-1] - t[0])", "np.trapezoid(values**2, t, axis=0)")),
    *_some("comfort (ISO 2631-1)", "src/mrdamp/simulation/criteria.py", "env_car",
           ("([w4 * w4 / w3, w4 * w4]", "([w4 / w3, w4 * w4]"),
           ("(2 * math.pi * f for f", "(math.pi * f for f")),
    *_some("rewards", "envs/structure.py", "env_frame env_contract",
           ("x - v[self._kept[part.column, part.over, True]]", "v[self._kept[part.column, part.over, True]] - x"),
           ("period[part.column] / v[part.over]", "period[part.column] * v[part.over]"),
           ("power = part.power * self.weights.exponent", "power = self.weights.exponent"),
           ("sign / v[-1]", "sign"),
           ("v[at] + x", "x"),
           ("x = x / v[-2]", "x = x"),
           ("root(x) / root(v[t.over])", "root(x) / v[t.over]")),
    *_some("reward of the frame", "envs/frame.py", "env_frame env_contract",
           ('Part("drift", 0, 0, 1.0)', 'Part("drift", 0, 1, 1.0)'),
           ("0.5 * frame.stiffness @ drift**2", "frame.stiffness @ drift**2")),
    *_some("reward of the cable", "envs/cable.py", "env_frame env_cable env_contract",
           ('Part("motion", 0, 0, 0.5)', 'Part("motion", 1, 0, 0.5)'),
           ("0.5 * (v * v + w * w * q * q)", "0.5 * (v * v + w * q * q)"),
           ("push - damping * v - w * w * q", "push + damping * v - w * w * q")),
    *_some("reward of the car", "envs/car.py", "env_frame env_car env_contract",
           ('Part("airborne", 4)', 'Part("airborne", 3)'),
           ("CONVENTIONAL = 0.3", "CONVENTIONAL = 0.6"),
           ("out[0] *= wk(np.maximum(f, 1e-9))", "out[1] *= wk(np.maximum(f, 1e-9))")),
    *_some("a structure of one's own", "src/mrdamp/structures/lumped.py", "own_structure",
           ("-np.linalg.solve(self.mass, np.hstack", "np.linalg.solve(self.mass, np.hstack"),
           ("(-np.linalg.solve(self.mass, self.stroke)", "(np.linalg.solve(self.mass, self.stroke)"),
           ("self.stroke)[:, None])", "self.stroke)[:, None] * 0.5)"),
           ("return int(self.absolute)", "return int(not self.absolute)")),
    *_some("a structure of one's own", "envs/linear_rows.py", "own_structure",
           ("qacc = qacc - (ground", "qacc = qacc + (ground")),
    *_some("a structure of one's own", "envs/linear.py", "own_structure",
           ("np.trapezoid(x * x) /", "np.trapezoid(np.abs(x)) /")),
)  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs what has no result yet, and prints every survivor and the score."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--only", nargs="+", default=[""], metavar="TEXT", help="mutants with one of these in their names")
    p.add_argument("--again", action="store_true", help="forget earlier results")
    a = p.parse_args(arguments)
    chosen = [m for m in MUTANTS if any(text in m.name for text in a.only)]
    known: dict[str, str] = {}
    if RESULTS.is_file() and not a.again:
        known = {name: found for name, found in json.loads(RESULTS.read_text()).items() if found == "killed"}
    left = [m for m in chosen if m.name not in known]
    if left:
        prepare(build=any(m.cpp for m in left))
    for k, mutant in enumerate(left):
        known[mutant.name] = outcome(mutant)
        RESULTS.write_text(json.dumps(known, indent=1) + "\n")
        print(f"{k + 1} of {len(left)}: {known[mutant.name]}  {mutant.name}", flush=True)
    survivors = [m.name for m in chosen if known[m.name] != "killed"]
    for name in survivors:
        print(f"survives: {name}")
    table = (ROOT / "plugin_cpp" / "core" / "attributes.def").read_text()
    for name in sorted(set(re.findall(r"^MRDAMP_(?:LAW|CAUSE)\((\w+),", table, re.M)) - {m.of for m in MUTANTS}):
        print(f"has no mutant: {name}")
    print(f"{len(chosen) - len(survivors)} of {len(chosen)} mutants are seen by a test")
    return 1 if survivors else 0


def prepare(*, build: bool) -> None:
    """Copies the tree, and compiles the library with every mutant of C++ in it. Raises CalledProcessError."""
    WORK.mkdir(parents=True, exist_ok=True)
    for name in _COPIED:
        shutil.rmtree(TREE / name, ignore_errors=True)
        shutil.copytree(ROOT / name, TREE / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md"):
        shutil.copy2(ROOT / name, TREE)
    if not build:
        code = "import mrdamp; print(mrdamp.library_path().parents[1])"
        own = subprocess.run([sys.executable, "-c", code], cwd=WORK, check=True, capture_output=True, text=True).stdout
        for library in Path(own.strip()).glob("*/lib*.so"):
            _install(library, library.parent.name)
        return
    switched = [ROOT / "CMakeLists.txt", *(f for f in (ROOT / "plugin_cpp").rglob("*") if f.is_file())]
    for file in switched:
        _write(TREE / file.relative_to(ROOT), _switched(file))
    tools = Path(sys.executable).parent
    path = {**os.environ, "PATH": f"{tools}{os.pathsep}{os.environ['PATH']}"}
    made = WORK / "cmake"
    for command in (
        f"cmake -S {TREE} -B {made} -G Ninja --log-level=WARNING -DPython_EXECUTABLE={sys.executable}",
        f"cmake --build {made} --target mrdamp -- --quiet",
    ):
        subprocess.run(shlex.split(command), check=True, env=path)
    _install(made / "libmrdamp.so", "plugin")


def _switched(file: Path) -> bytes:
    """A file of C++ with its mutants, or the build without packs."""
    name = str(file.relative_to(ROOT))
    own = [(number, m) for number, m in enumerate(MUTANTS, start=1) if m.file == name]
    if name == "CMakeLists.txt":
        return file.read_text().replace(*_NO_PACKS).encode()
    if name == "plugin_cpp/core/real.h":
        return file.read_text().replace("namespace mrdamp {\n", _SWITCH + "namespace mrdamp {\n", 1).encode()
    if not own:
        return file.read_bytes()
    text = file.read_text()
    for number, mutant in own:
        text = mutant.applied(text, number)
    return (text if _REAL in text else _REAL + text).encode()


def _write(file: Path, content: bytes) -> None:
    """What is the same stays as it is: it is not compiled again."""
    if not file.is_file() or file.read_bytes() != content:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content)


def _install(library: Path, folder: str) -> None:
    target = TREE / "src" / "mrdamp" / folder
    target.mkdir(exist_ok=True)
    shutil.copy2(library, target)


def outcome(mutant: Mutant) -> str:
    """killed, survives, or what went wrong with the tests themselves. Tests with its name in theirs come first."""
    number = str(MUTANTS.index(mutant) + 1)
    # envs and train are links in src/mrdamp, and folders in the copy
    file = TREE / (mutant.file if mutant.cpp or mutant.file.startswith("src") else f"src/mrdamp/{mutant.file}")
    text = file.read_text()
    if not mutant.cpp:
        file.write_text(mutant.applied(text, 0))
    try:
        for named in (["-k", mutant.of], []) if mutant.of.isidentifier() else ([],):
            code = _pytest([*mutant.tests, *named], number)
            if code not in (0, _NO_TESTS):
                break
    finally:
        file.write_text(text)
    return {0: "survives", 1: "killed", None: "killed"}.get(code, f"no result: exit code {code} of pytest")


def _pytest(arguments: Sequence[str], number: str) -> int | None:
    """Exit code of pytest on the copy; None: it takes for ever. A fork, so that most imports are made once for all."""
    child = multiprocessing.get_context("fork").Process(target=_in_copy, args=(arguments, number))
    child.start()
    child.join(_TIME)
    if child.exitcode is None:
        child.kill()
    return child.exitcode


def _in_copy(arguments: Sequence[str], number: str) -> None:
    os.chdir(TREE)
    os.environ["MRDAMP_MUTANT"] = number
    sys.meta_path[:] = [f for f in sys.meta_path if "ScikitBuild" not in type(f).__name__]  # the editable install
    sys.path.insert(0, str(TREE / "src"))
    sys.dont_write_bytecode = True
    if importlib.util.find_spec("mrdamp").origin != str(TREE / "src" / "mrdamp" / "__init__.py"):  # type: ignore[union-attr]
        os._exit(99)  # another copy would let every mutant live
    with open(os.devnull, "w") as nowhere, contextlib.redirect_stdout(nowhere):
        code = pytest.main(["-q", "-x", "-p", "no:cacheprovider", "-m", "not slow", *arguments])
    os._exit(code)


if __name__ == "__main__":
    sys.exit(main())
