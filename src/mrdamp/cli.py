"""The command `mrdamp`."""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from mrdamp.commands import (
    OutFile,
    OutFolder,
    Parser,
    Run,
    add_command,
    add_json,
    calibrate,
    controllers,
    diagnosis,
    identify,
    inverse,
    progress_bar,
    records,
)
from mrdamp.errors import EngineError, InputError, first_line
from mrdamp.interrupts import unguard
from mrdamp.outside import NAMED
from mrdamp.sets import named_model


def main(argv: Sequence[str] | None = None, parser: argparse.ArgumentParser | None = None) -> int:
    """Runs a command, of another parser if one is given.

    Bad input gives one line and exit code 2, an interrupt 130, a reader that has gone 141.
    """
    unguard()
    try:
        given = sys.argv[1:] if argv is None else argv
        if "" in given:  # as from a variable of the shell that is not set
            raise InputError("an argument is empty; allowed: a value")
        arguments = (parser or build_parser()).parse_args(given)
        run: Run = arguments.run
        code = run(arguments)
        sys.stdout.flush()
        return code
    except (InputError, EngineError) as error:
        print(f"mrdamp: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("mrdamp: interrupted; run the same command again", file=sys.stderr)
        return 130
    except BrokenPipeError:  # of `mrdamp sets | head`; the interpreter would flush once more at its end
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except OSError as error:
        where = error.filename2 or error.filename or "output"  # of a copy: the copy
        print(f"mrdamp: {where}: {error.strerror}; give another file or folder", file=sys.stderr)
        return 2


class _Version(argparse.Action):
    """`--version`, which reads the package's metadata only on demand."""

    def __init__(self, option_strings: Sequence[str], dest: str, **options: Any) -> None:
        super().__init__(option_strings, argparse.SUPPRESS, nargs=0, default=argparse.SUPPRESS, **options)

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from mrdamp import __version__

        print(f"mrdamp {__version__}")
        parser.exit()


def build_parser() -> argparse.ArgumentParser:
    """The whole command line, as completion and the reference see it too."""
    parser = Parser(
        prog="mrdamp",
        description="Magnetorheological dampers for MuJoCo, from measured record to controlled structure.",
    )
    parser.add_argument("--version", action=_Version, help="show the version and exit")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    add = partial(add_command, commands)
    demo = add(
        "demo",
        _demo,
        "records -> fitted damper -> controlled frame -> one HTML page",
        "mrdamp demo -o out/demo",
    )
    demo.add_argument("--data", type=Path, help="folder of records (default: the embedded set)")
    demo.add_argument("--law", default="modified_bouc_wen", help="force law to fit (default: %(default)s)")
    demo.add_argument("--motion", type=Path, help="ground motion, CSV or AT2 (default: the embedded one)")
    demo.add_argument("--seed", type=int, default=0, help="of random numbers (default: %(default)s)")
    demo.add_argument(
        "-o", "--out", type=OutFolder, default="out/demo", help="folder to write (default: %(default)s)"
    )

    identify.add_to(commands)
    calibrate.add_to(commands)
    diagnosis.add_to(commands)
    inverse.add_to(commands)
    controllers.add_to(commands)

    about = "a model's free run over a record's inputs"
    predict = add("predict", _predict, about, "mrdamp predict model.json record.csv -o pred.csv")
    predict.add_argument("model", help="case.json, corrected.json or a model file, or the name of a parameter set")
    predict.add_argument("record", type=Path)
    predict.add_argument(
        "-o", "--out", type=OutFile, required=True,
        help="CSV to write, simulated alone: force_N of the damper's sensor, reference_force_N of a load cell without"
        " errors; of a frame its floors",
    )  # fmt: skip

    mjcf = add(
        "mjcf",
        _mjcf,
        "a model as MJCF: the damper in a test rig, or in its frame",
        "mrdamp mjcf model.json -o damper",
    )
    mjcf.add_argument("model", help="a model file, or the name of a parameter set")
    mjcf.add_argument("-o", "--out", type=OutFolder, required=True, help="folder to write")

    view = add("view", _view, "look at a model in MuJoCo's viewer", "mrdamp view frame3")
    view.add_argument(
        "model", nargs="?", default="frame3",
        help="model file, MJCF file, a packaged model, or file.py:NAME of a structure",
    )  # fmt: skip

    sets = add("sets", _sets, "list the published parameter sets", "mrdamp sets")
    sets.add_argument("name", nargs="?", help="print this one as a model file")
    add_json(sets)
    sets.add_argument("--include", action="store_true", help="print the path of the set's MJCF, for <include>")

    records.add_to(commands)
    cite = add(
        "citation", _citation, "what to cite for a force law or a published parameter set",
        "mrdamp citation modified_bouc_wen --bibtex",
    )  # fmt: skip
    cite.add_argument("name", nargs="?", help="law or parameter set (default: every law)")
    cite.add_argument("--bibtex", action="store_true", help="the law's sources as BibTeX")
    add_json(cite)
    plugin_path = add("plugin-path", _plugin_path, "print where the plugin library lies", "mrdamp plugin-path")
    plugin_path.add_argument("--include", action="store_true", help="print the folder of mrdamp.h, the C interface")
    complete = add(
        "completion",
        partial(_completion, parser),
        "print the shell's completion script; load it with: source <(mrdamp completion bash)",
        "mrdamp completion bash > ~/.local/share/bash-completion/completions/mrdamp",
    )
    complete.add_argument("shell", choices=("bash", "zsh"))
    return parser


def _demo(a: argparse.Namespace) -> int:
    if "MUJOCO_GL" not in os.environ and not _has_display():
        os.environ["MUJOCO_GL"] = (
            "egl"  # before MuJoCo is imported; without EGL the page has no moving picture
        )
    from mrdamp.demo import UNCONTROLLED, demo

    with progress_bar() as progress:
        result = demo(a.out, a.data, law=a.law, motion=a.motion, seed=a.seed, progress=progress)
    fit = result.fit
    print(f"{result.records.name}: {fit.model.law}, free-run error over the force's standard deviation:")
    print(f"  fitted records {fit.train_nrmse:.3f}, held-out records {fit.held_out_nrmse:.3f}")
    print(
        f"  {'controller':16s} {'peak drift':>10s} {'peak acc.':>10s} {'peak force':>11s} {'mean command':>13s}"
    )
    for name, c in result.criteria.items():
        force, mean = (
            (f"{c.peak_force:9.0f} N", f"{c.mean_command:13.3f}") if name != UNCONTROLLED else ("", "")
        )
        print(
            f"  {name:16s} {1e3 * c.peak_drift.max():7.2f} mm {c.peak_acceleration.max():5.2f} m/s2 {force:>11s} {mean}"
        )
    print(f"page: {result.page}")
    return 0


def _predict(a: argparse.Namespace) -> int:
    import numpy as np

    from mrdamp.identify.excerpts import skipped
    from mrdamp.identify.fit import error_of
    from mrdamp.records import read_record
    from mrdamp.records.checks import warnings_of
    from mrdamp.simulation.predict import INPUTS, clamped, noisy_motion, write_prediction

    model = named_model(a.model)
    record = read_record(a.record, required=INPUTS[model.rig])
    columns = write_prediction(model, record, a.out)
    for name in columns:
        if name != "time_s" and name in record.channels:
            found, moves = error_of(record, name, columns[name]), np.ptp(record.channel(name)[skipped(record) :]) > 0
            than = f"{found.nrmse:.3f} of its standard deviation" if moves else "the measured one is constant"
            print(f"{name}: RMS error {found.rmse:.4g}, {than}")
    said = [clamped(model, record)]
    if model.rig == "damper":
        said.append(noisy_motion(model, record, columns["force_N"]))
    for check in [*(f"{a.record}: {line}" for line in said if line), *warnings_of([record])]:
        print(f"check: {check}", file=sys.stderr)
    return 0


def _mjcf(a: argparse.Namespace) -> int:
    from mrdamp.simulation.mjcf import write_mjcf

    print(write_mjcf(named_model(a.model), a.out))
    return 0


def _view(a: argparse.Namespace) -> int:
    from mrdamp import models_xml
    from mrdamp.simulation.mjcf import write_mjcf

    if a.model in models_xml.names():
        return _launch(models_xml.path(a.model, "scene.xml"))
    if a.model.endswith(".xml"):
        path = Path(a.model)
        if not path.is_file():
            raise InputError(f"{path}: no such file")
        return _launch(path)
    with tempfile.TemporaryDirectory() as folder:
        if NAMED.fullmatch(a.model):
            from mrdamp.envs.linear import own_kind

            path = Path(folder) / "model.xml"
            path.write_text(own_kind(a.model)().mjcf(5e-4, drawn=True), encoding="utf-8")
            return _launch(path)
        return _launch(write_mjcf(named_model(a.model), Path(folder) / "model"))


def _has_display() -> bool:
    return not sys.platform.startswith("linux") or any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")
    )


def _launch(path: Path) -> int:
    """Opens MuJoCo's viewer on a file: only then does it aim its camera at the model."""
    import mujoco

    try:
        mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise InputError(f"{path}: {first_line(error)}") from None
    if not _has_display():
        raise InputError(
            "the viewer needs a display, and DISPLAY is not set; mujoco.Renderer draws without one"
        )
    import mujoco.viewer

    try:
        mujoco.viewer.launch_from_path(str(path))
    except (mujoco.FatalError, RuntimeError) as error:
        raise InputError(f"the viewer needs a display: {first_line(error)}") from None
    return 0


def _sets(a: argparse.Namespace) -> int:
    from mrdamp import models_xml, sets

    if a.name:
        found = sets.load(a.name)
        if a.include:
            print(models_xml.damper(a.name))
            return 0
        print(json.dumps(found.model().to_dict(), indent=1))
        return 0
    if a.include:
        raise InputError("--include needs a set: mrdamp sets NAME --include")
    every = [sets.load(name) for name in sets.names()]
    if a.json:
        keys = ("id", "law", "status", "device", "sources")
        print(json.dumps([{key: getattr(found, key) for key in keys} for found in every], indent=1))
        return 0
    for found in every:
        print(f"{found.id:28s} {found.law:20s} {found.status}  {found.device}")
    return 0


def _citation(a: argparse.Namespace) -> int:
    from mrdamp.model.citations import citation, references

    if a.bibtex and a.json:
        raise InputError("--bibtex and --json exclude each other")
    names = [a.name] if a.name else list(references())
    found = {name: citation(name) for name in names}
    if a.json:
        out = {
            name: {"cite": lines, "references": [asdict(r) for r in sources]}
            for name, (lines, sources) in found.items()
        }
        print(json.dumps(out, indent=1))
    elif a.bibtex:
        unique = {r.key: r for _, sources in found.values() for r in sources}
        print("\n\n".join(reference.bibtex() for reference in unique.values()))
    else:
        for name, (lines, _) in found.items():
            print("\n  ".join([f"{name}:", *lines]))
    return 0


def _plugin_path(a: argparse.Namespace) -> int:
    from mrdamp.library import library_path

    path = library_path()
    print(path.parents[1] / "include" if a.include else path)
    return 0


def _completion(parser: argparse.ArgumentParser, a: argparse.Namespace) -> int:
    print("\n".join(script(parser, a.shell)))
    return 0


def script(parser: argparse.ArgumentParser, shell: str) -> Iterator[str]:
    """Lines of the script: commands first, then the command's options, an option's choices, files elsewhere."""
    (commands,) = (a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    if shell == "zsh":
        yield "autoload -Uz bashcompinit && bashcompinit"
    yield "_mrdamp() {"
    yield '  local now="${COMP_WORDS[COMP_CWORD]}" before="${COMP_WORDS[COMP_CWORD-1]}" words=""'
    yield "  COMPREPLY=()"
    yield "  if [ $COMP_CWORD -eq 1 ]; then"
    yield f'    words="{" ".join([*commands.choices, *_options(parser)])}"'
    yield '    COMPREPLY=($(compgen -W "$words" -- "$now"))'
    yield "    return"
    yield "  fi"
    yield '  case "${COMP_WORDS[1]}:$before" in'
    for name, command in commands.choices.items():
        for action in command._actions:
            if action.choices and action.option_strings:
                pattern = "|".join(f"{name}:{option}" for option in action.option_strings)
                yield f'    {pattern}) words="{" ".join(map(str, action.choices))}" ;;'
    yield "  esac"
    yield '  if [ -z "$words" ]; then'
    yield '    case "${COMP_WORDS[1]}" in'
    for name, command in commands.choices.items():
        # Names of a positional's choices stand among the options: there is no telling where it comes.
        own = [
            str(c) for action in command._actions if not action.option_strings for c in action.choices or ()
        ]
        yield f'      {name}) words="{" ".join([*_options(command), *own])}" ;;'
    yield "    esac"
    yield '    case "$now" in'
    yield "      -*) ;;"
    yield '      *) COMPREPLY=($(compgen -f -- "$now")) ;;'
    yield "    esac"
    yield "  fi"
    yield '  COMPREPLY+=($(compgen -W "$words" -- "$now"))'
    yield "}"
    yield "complete -o filenames -F _mrdamp mrdamp"


def _options(parser: argparse.ArgumentParser) -> list[str]:
    return [
        option for action in parser._actions for option in action.option_strings if option.startswith("--")
    ]


if __name__ == "__main__":
    sys.exit(main())
