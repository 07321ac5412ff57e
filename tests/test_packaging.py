"""What an installation must bring, tried from outside: editable, from a wheel, or from an sdist alike."""

import importlib.metadata
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]
MODEL = """
<mujoco>
  <extension><plugin plugin="mrdamp.damper"/><plugin plugin="mrdamp.force_sensor"/></extension>
  <worldbody><body><joint name="j" type="slide"/><geom size="0.1"/></body></worldbody>
</mujoco>
"""


def package_folders() -> list[Path]:
    """Where the package lies: one folder; with an editable install also that of the sources."""
    spec = importlib.util.find_spec("mrdamp")
    assert spec is not None
    assert spec.submodule_search_locations is not None
    return [Path(folder) for folder in spec.submodule_search_locations]


def library() -> Path:
    paths = [folder / "plugin" / "libmrdamp.so" for folder in package_folders()]
    return next(path for path in paths if path.exists())


def python(code: str, cwd: Path) -> str:
    """Standard output of a new interpreter in another folder, warnings being errors."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        cwd=cwd, env=environment, capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout.strip()


def test_plugin_library_is_a_real_file() -> None:
    # mj_loadAllPluginLibraries passes over links
    path = library()
    assert path.is_file()
    assert not path.is_symlink()
    assert not path.parent.is_symlink()


def test_plugin_library_finds_the_engine_beside_it_and_nowhere_else() -> None:
    readelf = shutil.which("readelf")
    if readelf is None:
        pytest.skip("readelf (binutils) is not installed")
    dynamic = subprocess.run([readelf, "-d", library()], capture_output=True, text=True, check=True).stdout
    assert re.findall(r"\((RPATH|RUNPATH)\).*\[(.*)\]", dynamic) == [("RUNPATH", "$ORIGIN/../../mujoco")]
    assert "libmujoco.so.4.0.0" in re.findall(r"\(NEEDED\).*\[(.*)\]", dynamic)
    assert (library().parent / "../../mujoco/libmujoco.so.4.0.0").resolve().is_file()


def test_plugin_library_holds_no_path_of_the_build_machine() -> None:
    content = library().read_bytes()
    for folder in (REPOSITORY, Path(sys.prefix), Path.home()):
        assert f"{folder}/".encode() not in content


def test_code_for_vector_units_is_reached_by_packs_alone() -> None:
    """A function that a linker may share (`W`) would run AVX code on a processor without it."""
    packs = sorted(REPOSITORY.glob("build/plugin/CMakeFiles/mrdamp_*_[48]_*.dir/plugin_cpp/lanes/pack.cc.o"))
    if not packs or shutil.which("nm") is None:
        pytest.skip("needs the build folder and nm")
    for pack in packs:
        listed = subprocess.run(["nm", "-C", "--defined-only", pack], capture_output=True, text=True, check=True)
        symbols = [line.split(" ", 2)[1:] for line in listed.stdout.splitlines()]
        shared = [name for kind, name in symbols if kind in "WVu"]
        assert [s for s in shared if "in_mrdamp_" not in s and not s.startswith("DW.ref.")] == [], pack


def test_import_loads_nothing_heavy(tmp_path: Path) -> None:
    heavy = "{'mujoco', 'scipy', 'matplotlib', 'torch', 'rich'}"
    for name in ("mrdamp", "mrdamp.cli"):
        assert python(f"import {name}, sys; print(sorted({heavy} & set(sys.modules)))", tmp_path) == "[]"


OPENED = f"print(mujoco.MjModel.from_xml_string('''{MODEL}''').nq)"
MADE = "[print(gymnasium.make(f'mrdamp/{name}-v0').spec.id) for name in ('Frame', 'Cable')]"
NAMES = "mrdamp/Frame-v0\nmrdamp/Cable-v0"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("code", "printed"),
    [
        *((f"import {first}; {MADE}", NAMES) for first in ("mrdamp, gymnasium", "gymnasium, mrdamp")),
        ("import gymnasium as g; print(g.make('mrdamp:mrdamp/Frame-v0').spec.id)", "mrdamp/Frame-v0"),
        *((f"import {first}, mujoco; {OPENED}", "1") for first in ("mrdamp", "mujoco, mrdamp", "mrdamp.cli")),
        # by the entry point; so `python -m mujoco.viewer` and other people's programs open a model with a damper
        (f"import mujoco; {OPENED}", "1"),
    ],
)
def test_imports_from_anywhere_register_environments_and_plugins(tmp_path: Path, code: str, printed: str) -> None:
    assert python(code, tmp_path) == printed
    assert list(tmp_path.iterdir()) == []


MAIN = "from mrdamp.cli import main; sys.exit(main(['mjcf', 'dyke1996_3kN', '-o', 'rig']))"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("then", "who"),
    [
        ("import mujoco, mrdamp", "mrdamp.errors.EngineError"),
        ("import mrdamp.model.native; mrdamp.model.native.library()", "mrdamp.errors.EngineError"),
        ("import mrdamp; mrdamp.load_plugin()", "mrdamp.errors.EngineError"),
        (MAIN, "mrdamp"),
    ],
)
def test_another_mujoco_is_refused_with_the_command_that_mends_it(tmp_path: Path, then: str, who: str) -> None:
    (tmp_path / "mujoco").mkdir()
    (tmp_path / "mujoco" / "__init__.py").write_text("__version__ = '3.3.0'\n")
    call = [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(tmp_path)!r}); {then}"]
    done = subprocess.run(call, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    needed = "mrdamp needs MuJoCo 4.0.0, but 3.3.0 is installed: pip install mujoco==4.0.0"
    *before, last = done.stderr.splitlines()
    assert last == f"{who}: {needed}"
    if then == MAIN:
        assert (done.returncode, done.stdout, before) == (2, "", [])


def test_every_direct_dependency_is_pinned() -> None:
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())
    lists = [project["project"]["dependencies"], project["build-system"]["requires"],
             *project["project"]["optional-dependencies"].values()]  # fmt: skip
    lines = [line for line in (REPOSITORY / "constraints.txt").read_text().splitlines() if line[:1] != "#"]
    assert all(re.fullmatch(r"[A-Za-z0-9_.-]+==[0-9][0-9a-z.]*", line) for line in lines)
    pins = {re.sub(r"[-_.]+", "-", line.split("==")[0]).lower(): line.split("==")[1] for line in lines}
    for requirement in (item for items in lists for item in items):
        name, _, version = re.sub(r"\[.*\]", "", requirement).partition("==")
        assert name in pins
        assert version in ("", pins[name])
