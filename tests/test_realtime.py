"""The C99 example: built by the two commands of its README, without MuJoCo, and run."""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from scipy.integrate import solve_ivp

SOURCE = Path(__file__).resolve().parents[1] / "plugin_cpp"
Array = npt.NDArray[np.float64]


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The example, compiled by the README's own lines in a copy of the sources."""
    for compiler in ("gcc", "g++"):
        if shutil.which(compiler) is None:
            pytest.skip(f"{compiler} is not installed")
    folder = tmp_path_factory.mktemp("realtime") / "plugin_cpp"
    shutil.copytree(SOURCE, folder)
    commands = re.findall(r"^    (g.*)$", (SOURCE / "realtime" / "README.md").read_text(), re.MULTILINE)
    assert len(commands) == 2
    strict = commands[0].replace("-std=c99", "-std=c99 -pedantic-errors -Wall -Wextra -Werror")
    for command in (strict, commands[1]):
        subprocess.run(command, shell=True, cwd=folder, check=True)
    return folder / "damper"


def run(program: Path, *arguments: str, text: str = "") -> subprocess.CompletedProcess[str]:
    return subprocess.run([program, *arguments], input=text, capture_output=True, text=True, timeout=60)


def table(program: Path, *arguments: str, text: str = "") -> Array:
    """(n, 5) of t x v u F."""
    done = run(program, *arguments, text=text)
    assert (done.returncode, done.stderr) == (0, "")
    return np.array([[float(cell) for cell in line.split()] for line in done.stdout.splitlines()])


@pytest.mark.slow
def test_bingham_from_standard_input_is_the_closed_form(program: Path) -> None:
    time = 1e-3 * np.arange(400)
    x, v, u = 0.01 * np.sin(20 * time), 0.2 * np.cos(20 * time), 1.0 + np.cos(3 * time)
    rows = np.stack([x, v, u], axis=1)
    lines = "".join("{!r} {!r} {!r}\n".format(*row) for row in rows.tolist())
    got = table(program, "-i", "bingham", "c0a=600", "c0b=150", "fya=40", "fyb=300", "v_ref=0.02", text=lines)
    np.testing.assert_allclose(got[:, 0], time, atol=1e-9)
    np.testing.assert_allclose(got[:, 1:4], rows, rtol=1e-8)
    force = (600 + 150 * u) * v + (40 + 300 * u) * np.tanh(v / 0.02)
    np.testing.assert_allclose(got[:, 4], force, rtol=1e-6, atol=1e-5)


@pytest.mark.slow
def test_built_in_sine_is_the_modified_bouc_wen_law_of_spencer_1997(program: Path) -> None:
    got = table(program, "-n", "600")
    volt, omega, amplitude = 1.5, 2 * np.pi * 2.5, 0.015
    alpha, c0, c1 = 14000 + 69500 * volt, 2100 + 350 * volt, 28300 + 295 * volt
    k0, k1, gamma, beta, a = 4690.0, 500.0, 3.63e6, 3.63e6, 301.0

    def rates(t: float, state: Array) -> list[float]:
        y, z = state
        x, v = amplitude * np.sin(omega * t), amplitude * omega * np.cos(omega * t)
        ydot = (alpha * z + c0 * v + k0 * (x - y)) / (c0 + c1)
        return [ydot, -gamma * abs(v - ydot) * z * abs(z) - beta * (v - ydot) * z * z + a * (v - ydot)]

    time = got[:, 0]
    exact = solve_ivp(rates, (0.0, time[-1]), [0.0, 0.0], "Radau", time, rtol=1e-8, atol=1e-12)
    x = amplitude * np.sin(omega * time)
    ydot = np.array([rates(t, state)[0] for t, state in zip(time, exact.y.T, strict=True)])
    force = c1 * ydot + k1 * x
    error = np.sqrt(np.mean((got[:, 4] - force) ** 2) / np.mean(force**2))
    assert error < 0.01


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "text", "named"),
    [
        (["dahl"], "", "dahl"),
        (["bingham", "nonsense=1"], "", "nonsense"),
        (["bingham", "c0a=1,5"], "", "1,5"),
        (["bingham", "c0a=nan"], "", "nan"),
        (["bingham", "c0a"], "", "name=value"),
        (["bingham", "v_ref=-1"], "", "v_ref"),
        (["-n", "0"], "", "usage"),
        (["-i"], "0 0.1 1\n0 0.1\n", "line 2"),
        (["-i"], "0 inf 1\n", "line 1"),
    ],
    ids=["law", "attribute", "comma", "nan", "no-equals", "range", "steps", "two-numbers", "infinite"],
)
def test_bad_input_gives_one_line(program: Path, arguments: list[str], text: str, named: str) -> None:
    done = run(program, *arguments, text=text)
    assert done.returncode == 2
    assert named in done.stderr
    assert done.stderr.count("\n") == 1
