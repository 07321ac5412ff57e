"""Work over processes: the order, one thread of BLAS, other backends."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_info  # type: ignore[import-untyped]

from mrdamp.errors import InputError
from mrdamp.parallel import mapped


def late(k: int, of: int) -> tuple[int, int]:
    time.sleep(0.02 * (of - k))
    return k, os.getpid()


def threads() -> int:
    np.ones((4, 4)) @ np.ones((4, 4))
    return max((int(pool["num_threads"]) for pool in threadpool_info()), default=1)


@pytest.mark.slow
def test_results_come_in_the_order_of_the_tasks_from_other_processes() -> None:
    out = list(mapped(late, [(k, 4) for k in range(4)], jobs=2))
    assert [k for k, _ in out] == [0, 1, 2, 3]
    assert os.getpid() not in {pid for _, pid in out}


def test_one_job_stays_here_and_is_lazy() -> None:
    work = mapped(late, [(k, 2) for k in range(2)], jobs=1)
    assert next(work) == (0, os.getpid())


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_task_has_one_thread_of_blas(jobs: int) -> None:
    assert list(mapped(threads, [(), ()], jobs)) == [1, 1]


def test_an_unknown_backend_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MRDAMP_BACKEND", "dask")
    with pytest.raises(InputError, match=r"MRDAMP_BACKEND is 'dask'; allowed: loky, ray"):
        list(mapped(late, [(0, 0), (1, 1)], jobs=2))


@pytest.mark.slow
def test_a_killed_process_leaves_no_worker() -> None:
    code = (
        "import os, time\nfrom mrdamp.parallel import mapped\n"
        "def work(k):\n    print(os.getpid(), flush=True)\n    time.sleep(60)\n"
        "list(mapped(work, [(k,) for k in range(2)], jobs=2))\n"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as run:
        assert run.stdout
        workers = [int(run.stdout.readline()) for _ in range(2)]
        run.kill()
        assert run.pid not in workers
        ends = time.monotonic() + 20.0
        while any(map(alive, workers)) and time.monotonic() < ends:
            time.sleep(0.2)
    assert not any(map(alive, workers))


def alive(pid: int) -> bool:
    """A process that has ended may wait for its parent to take notice."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
