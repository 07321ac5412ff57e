"""Start-up time of the package against that of NumPy, MuJoCo and Gymnasium."""

from __future__ import annotations

import resource
import subprocess
import sys
from pathlib import Path

from benchmarks.result import Figure, Section, of_ratio
from benchmarks.timing import Effort, Task, interleave, ratio

#: What is started, each in an interpreter of its own; `mrdamp --help` as its console script runs it.
STARTS = {
    "python": "pass",
    "numpy": "import numpy",
    "mujoco": "import mujoco",
    "gymnasium": "import gymnasium",
    "mrdamp": "import mrdamp",
    "help": "import sys; sys.argv = ['mrdamp', '--help']; from mrdamp.cli import main; main()",
    "environment": "import mrdamp, gymnasium; gymnasium.make('mrdamp/Frame-v0')",
}
_TEXT = (
    "CPU time of a new interpreter with warm files. `import mrdamp` registers environments in Gymnasium."
)


def start(code: str) -> Task:
    """CPU time of an interpreter that runs the code, us."""

    def run() -> float:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(
            [sys.executable, "-c", code],
            check=True,
            stdout=subprocess.DEVNULL,
            cwd=Path(sys.executable).parent,
        )
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return 1e6 * (after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)

    return run


def measure(effort: Effort) -> list[Section]:
    """A section: starting times as ratios."""
    costs = interleave({name: start(code) for name, code in STARTS.items()}, min(effort.rounds, 15))
    rows: list[Figure] = [
        of_ratio("`import mrdamp` over `import numpy`", ratio(costs["mrdamp"], costs["numpy"]), "<= 1"),
        of_ratio("`import mrdamp` over Python alone", ratio(costs["mrdamp"], costs["python"])),
        of_ratio("`mrdamp --help` over `import numpy`", ratio(costs["help"], costs["numpy"]), "<= 1"),
        of_ratio("`import mujoco`, with the plugin, over `import numpy`", ratio(costs["mujoco"], costs["numpy"])),
        of_ratio(
            '`gymnasium.make("mrdamp/Frame-v0")` over `import gymnasium`',
            ratio(costs["environment"], costs["gymnasium"]),
        ),
    ]
    return [Section("Start", _TEXT, tuple(rows))]
