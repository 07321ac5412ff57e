"""`python -m studies.blindtest`: cases whose causes are withheld, diagnosed, then opened and scored."""

from __future__ import annotations

import argparse
import secrets
import sys
from functools import partial

from mrdamp.cli import main as run
from mrdamp.commands import OutFolder, Parser, described, progress_bar
from mrdamp.errors import InputError
from studies.blindtest import baselines, misfit_score, report, score
from studies.blindtest import run as blind


def parser() -> argparse.ArgumentParser:
    p = described(
        Parser("python -m studies.blindtest"),
        run_blindtest,
        "check the diagnosis on cases of a reference rig whose causes are sealed until it has answered",
        "python -m studies.blindtest out/blind --cases 200 --jobs 2",
    )
    p.add_argument("out", type=OutFolder, help="folder to write; an interrupted run continues")
    p.add_argument("--cases", type=int, default=200, help="(default: %(default)s)")
    p.add_argument(
        "--rig", choices=["damper", "frame", "both"], default="both", help="(default: %(default)s)"
    )
    p.add_argument(
        "--misfit",
        action="store_true",
        help="rigs with another law than the simulator's: error 3 to 15 %% without a cause",
    )
    seed = p.add_mutually_exclusive_group()
    seed.add_argument("--seed-from-os", action="store_true", help="a secret seed (the default)")
    seed.add_argument("--seed", type=int, help="a known seed, for development: no evidence")
    p.add_argument("--jobs", type=int, default=1, help="cases at a time (default: %(default)s)")
    p.add_argument(
        "--timeout", type=float, default=300.0, help="seconds a diagnosis may take (default: %(default)s)"
    )
    p.add_argument("--cases-only", action="store_true", help="only make and seal the cases")
    p.add_argument(
        "--baselines", action="store_true", help="also simpler methods on the same cases"
    )
    return p


def run_blindtest(a: argparse.Namespace) -> int:
    """Makes the cases, prints the hash of their labels, diagnoses, opens, scores; writes index.html and tables."""
    if a.cases < 1 or a.jobs < 1 or a.timeout <= 0:
        raise InputError("--cases and --jobs must be at least 1, and --timeout positive")
    if a.seed is not None and a.seed < 0:
        raise InputError(f"--seed {a.seed}: it must not be negative")
    out = blind.Folders(a.out)
    plan = blind.Plan(a.cases, a.rig, a.timeout, a.jobs, a.misfit)
    a.out.mkdir(parents=True, exist_ok=True)
    with progress_bar() as progress:
        digest = blind.make_cases(out, plan, secrets.randbits(64) if a.seed is None else a.seed, progress)
    print(f"labels sealed; SHA-256 of salt and labels: {digest}", flush=True)
    if a.cases_only:
        return 0
    with progress_bar() as progress:
        blind.diagnose_cases(out, plan, progress)
    print(f"answers given; SHA-256 of all answers:     {blind.answers_digest(out)}", flush=True)
    rows = blind.open_and_score(out)
    others = {}
    if a.baselines:
        with progress_bar() as progress:
            others = baselines.run_all(out, plan.jobs, progress)
    report.write(a.out, rows, digest, others)
    for r in rows:
        print(f"{'ok ' if r.right else 'NO '} {r.case}  {r.label:34s} -> {report.answer_text(r)}")
    for name, share in score.shares(rows).items():
        if share.of:
            print(f"{name}: {share.right}/{share.of} = {share.value:.3f}")
    n = score.numbers(rows)
    print(f"shrink on unseen tests: median {n.shrink_median:.3f}, worst tenth {n.shrink_worst_tenth:.3f}")
    print(f"expected calibration error {n.calibration_error:.3f}")
    print(f"seconds a case: median {n.seconds_median:.1f}, worst {n.seconds_worst:.1f}")
    if a.misfit:
        for line in (misfit_score.COLUMNS, *misfit_score.table(rows)):
            print("  ".join(f"{cell:<{36 if k == 0 else 20}s}" for k, cell in enumerate(line)).rstrip())
    print(f"page: {a.out / 'index.html'}")
    return 0


#: From words, those of the command line by default, to the exit code.
main = partial(run, parser=parser())


if __name__ == "__main__":
    sys.exit(main())
