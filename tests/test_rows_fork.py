"""Rows on threads in a process that was forked after its parent had stepped some."""

import os
import signal

import numpy as np
import pytest

from mrdamp.envs.frame_task import FrameTask

ROWS = 8


def measured(task: FrameTask) -> bytes:
    """What all rows measure after three periods at half of the largest command."""
    for _ in range(3):
        values = task.rows.advance(np.full((ROWS, 1), 0.5 * task.command_max))[1]
    return bytes(values.tobytes())


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
def test_a_forked_process_steps_rows_as_its_parent_does() -> None:
    task = FrameTask(ROWS, engine="chain", threads=2)
    task.reset(range(ROWS), [np.random.default_rng(k) for k in range(ROWS)])
    start = measured(task)
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        signal.alarm(20)  # ends a child that waits for threads that it has not
        os.write(write, measured(task))
        os._exit(0)
    os.close(write)
    _, status = os.waitpid(child, 0)
    found = os.read(read, 1 << 16)
    os.close(read)
    assert os.waitstatus_to_exitcode(status) == 0
    assert found != start
    assert found == measured(task)
