"""A blind test: cases from a secret seed, sealed labels, a diagnosis of every case, opened labels, scores."""

from __future__ import annotations

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import joblib
import numpy as np

from mrdamp.errors import InputError
from mrdamp.files import write_atomic
from mrdamp.model import Model
from mrdamp.records import Record
from mrdamp.simulation.predict import INPUTS, free_run
from studies.blindtest import case_sampling, score, seal
from studies.blindtest.make import make_one
from studies.blindtest.rig import Array
from studies.blindtest.score import Row
from studies.blindtest.sizing import Task

Progress = Callable[[str, float], None]


class Folders:
    """Folders of a blind test. sealed: labels, seed and the tests outside the cases."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.cases, self.answers = root / "cases", root / "answers"
        self.sealed = root / "sealed"
        self.tests = self.sealed / "tests"


@dataclass(frozen=True)
class Plan:
    """Composition of a blind test."""

    count: int
    rig: str = "both"
    timeout: float = 300.0
    jobs: int = 1
    misfit: bool = False

    @property
    def drawn(self) -> dict[str, Any]:
        """Entries that must be equal when a folder is resumed."""
        return {"count": self.count, "rig": self.rig, "misfit": self.misfit}


def make_cases(out: Folders, plan: Plan, seed: int, progress: Progress) -> str:
    """Makes the missing cases and seals all labels; returns their hash.

    The first call seals the seed; later calls use the sealed one.
    """
    if seal.is_sealed(out.sealed, "labels"):
        return seal.digest_of(out.sealed, "labels")
    if not seal.is_sealed(out.sealed, "seed"):
        seal.seal(out.sealed, "seed", {"seed": {"entropy": seed, **plan.drawn}})
    drawn = seal.open_labels(out.sealed, "seed")[1]["seed"]
    if {"misfit": False, **drawn} != {**plan.drawn, "entropy": drawn["entropy"]}:
        kind = "with" if drawn.get("misfit") else "without"
        raise InputError(
            f"{out.root}: holds a blind test of {drawn['count']} cases, rig {drawn['rig']}, {kind} --misfit; "
            "name another folder"
        )
    deal, draws = np.random.SeedSequence(drawn["entropy"]).spawn(2)
    tasks = case_sampling.draw(deal, plan.count, plan.rig, misfit=plan.misfit)
    left = [
        (task, own)
        for task, own in zip(tasks, draws.spawn(len(tasks)), strict=True)
        if not seal.is_sealed(out.sealed, task.name)
    ]
    work = joblib.Parallel(n_jobs=plan.jobs, return_as="generator_unordered")
    for done, _ in enumerate(work(joblib.delayed(_make_sealed)(out, task, own) for task, own in left), 1):
        ready = plan.count - len(left) + done
        progress(f"cases {ready}/{plan.count}", ready / plan.count)
    labels = {task.name: seal.open_labels(out.sealed, task.name)[1][task.name] for task in tasks}
    digest = seal.seal(out.sealed, "labels", labels)
    write_atomic(out.root / "labels.sha256", f"{digest}\n")
    return digest


def diagnose_cases(out: Folders, plan: Plan, progress: Progress) -> None:
    """Runs `mrdamp diagnose` on each case without an answer, each in its own process."""
    cases = sorted(path.name for path in out.cases.iterdir() if (path / "case.json").is_file())
    left = [name for name in cases if not (out.answers / name / "run.json").is_file()]
    work = joblib.Parallel(n_jobs=plan.jobs, return_as="generator_unordered")
    cores = max(1, (os.cpu_count() or 1) // plan.jobs)  # per diagnosis
    runs = work(
        joblib.delayed(diagnose_one)(out.cases / n, out.answers / n, plan.timeout, cores) for n in left
    )
    for done, _ in enumerate(runs, 1):
        ready = len(cases) - len(left) + done
        progress(f"diagnoses {ready}/{len(cases)}", ready / len(cases))


def diagnose_one(case: Path, out: Path, timeout: float, jobs: int = 1) -> None:
    """One diagnosis; run.json contains its exit state and its time."""
    out.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", "mrdamp.cli", "diagnose", str(case), "-o", str(out), "--jobs", str(jobs)]
    quiet = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    start = time.monotonic()
    process = subprocess.Popen(
        command,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, **quiet},
    )
    try:
        messages = process.communicate(timeout=timeout)[1]
        verdict = "done" if process.returncode == 0 else "failed"
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        messages, verdict = process.communicate()[1], "timeout"
    last = messages.strip().splitlines()[-1:] if verdict != "done" else []
    run = {"verdict": verdict, "seconds": round(time.monotonic() - start, 2), "error": "".join(last)[:300]}
    write_atomic(out / "run.json", json.dumps(run) + "\n")


def open_and_score(out: Folders) -> list[Row]:
    """Opens the labels, writes them to labels.json, and scores every answer."""
    salt, labels = seal.open_labels(out.sealed, "labels")
    write_atomic(out.root / "labels.json", json.dumps(labels, indent=1, sort_keys=True) + "\n")
    write_atomic(out.root / "labels.salt", f"{salt}\n")
    return [
        judge(name, label, out.answers / name, out.tests / f"{name}.npz") for name, label in labels.items()
    ]


def judge(case: str, label: dict[str, Any], answers: Path, tests: Path) -> Row:
    """The row of a case with its answer in a folder."""
    run = json.loads((answers / "run.json").read_text())
    if run["verdict"] != "done":
        return score.failed(case, label, run["verdict"], run["seconds"], run["error"])
    try:
        answer = score.read_answer(answers)
        model = Model.read(answers / "corrected.json")
        gaps = score.gaps(tests, lambda inputs: predicted(model, inputs))
        return score.row(case, label, answer, gaps, run["seconds"])
    except (OSError, KeyError, ValueError) as error:
        return score.failed(case, label, "failed", run["seconds"], str(error)[:300])


def answers_digest(out: Folders) -> str:
    """SHA-256 over all answers, given before the labels are opened."""
    total = hashlib.sha256()
    for path in sorted(out.answers.glob("*/diagnosis.json")):
        total.update(path.read_bytes())
    return total.hexdigest()


def predicted(model: Model, inputs: Mapping[str, Array]) -> dict[str, Array]:
    """Simulated channels of a test, as `mrdamp predict` gives them."""
    channels = {name: inputs[name] for name in INPUTS[model.rig]}
    return free_run(model, Record("test", None, sample_time(inputs), channels))


def sample_time(inputs: Mapping[str, Array]) -> float:
    """s, of a test."""
    return float(inputs["time_s"][1] - inputs["time_s"][0])


def _make_sealed(out: Folders, task: Task, seed: np.random.SeedSequence) -> None:
    label = make_one(task, out.cases, out.tests, seed)
    seal.seal(out.sealed, task.name, {task.name: label})
