#!/bin/sh
# Builds the sdist and a manylinux wheel from it (dist/), installs the wheel in fresh environments outside the
# repository, one for each Python that is found, and tries it there. Then the sdist by pip alone, and what an
# environment with another MuJoCo says.
#   BIN=.venv/bin [PYTHONS="python3.12 /opt/python3.13/bin/python"] [OTHER_MUJOCO=3.3.7] tools/wheel_test.sh
set -eu
cd "$(dirname "$0")/.."
repo=$PWD
bin=$(cd "${BIN:-.venv/bin}" && pwd)
away=$(mktemp -d)
trap 'rm -rf "$away"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1
wanted="3.11 3.12 3.13 3.14"

quietly() { # runs a command and shows what it wrote only where it fails
  "$@" >"$away/log" 2>&1 || {
    cat "$away/log" >&2
    exit 1
  }
}

# The Python of a version: from PYTHONS or PATH, else of pyenv; nothing where the machine has none.
find_python() {
  for candidate in ${PYTHONS:-} "python$1" "${PYENV_ROOT:-$HOME/.pyenv}"/versions/"$1".*/bin/python; do
    if "$candidate" -c "import sys, venv, ensurepip; sys.exit('%d.%d' % sys.version_info[:2] != '$1')" 2>/dev/null; then
      echo "$candidate"
      return
    fi
  done
}

echo "wheel: sdist, the wheel from it, auditwheel"
quietly env PIP_CONSTRAINT="$repo/constraints.txt" "$bin/python" -m build --outdir "$away/dist" .
# The engine is that of the package mujoco-core, which the wheel requires; it must not be copied in.
quietly env PATH="$bin:$PATH" auditwheel repair --exclude libmujoco.so.4.0.0 --wheel-dir "$repo/dist" "$away"/dist/*.whl
wheel=$(ls -t "$repo"/dist/mrdamp-*manylinux*.whl | head -n 1)
sdist=$(ls "$away"/dist/*.tar.gz)
cp "$sdist" "$repo/dist/"
echo "wheel: dist/$(basename "$wheel"), $(($(wc -c <"$wheel") / 1024)) KiB; dist/$(basename "$sdist")"

cd "$away"
tried=""
for version in $wanted; do
  python=$(find_python "$version")
  if [ -z "$python" ]; then
    echo "wheel: Python $version: not on this machine, not tried"
    continue
  fi
  quietly "$python" -m venv "$away/py$version"
  try="$away/py$version/bin"
  # The pins are those of Python 3.11; elsewhere the newest releases are tried.
  [ "$version" = 3.11 ] && pins="-c $repo/constraints.txt" || pins=""
  if ! "$try/python" -m pip install -q --only-binary :all: $pins "$wheel" pytest hypothesis >"$away/log" 2>&1; then
    tail -n 2 "$away/log"
    echo "wheel: Python $version: a dependency has no wheel for it, not tried"
    [ "$version" = 3.11 ] && exit 1
    continue
  fi
  quietly "$try/python" -m pytest -q -p no:cacheprovider "$repo/tests/test_packaging.py"
  quietly "$try/mrdamp" identify --law bingham --starts 1 -o "$away/model$version.json"
  quietly "$try/mrdamp" mjcf "$away/model$version.json" -o "$away/rig$version"
  echo "wheel: Python $version: installed, packaging tests, identify, mjcf"
  tried="$tried $version"
done
[ -n "$tried" ] || { echo "wheel: no Python was found to try it with" >&2; exit 1; }
first=$(echo "$tried" | cut -d' ' -f2)
quietly "$away/py$first/bin/mrdamp" demo -o "$away/demo"
echo "wheel: Python $first: demo"

quietly "$(find_python "$first")" -m venv "$away/sdist"
quietly "$away/sdist/bin/python" -m pip install -q "$sdist"
quietly "$away/sdist/bin/mrdamp" mjcf dyke1996_3kN -o "$away/rig_sdist"
echo "wheel: the sdist by pip install, without make: mjcf"

other=${OTHER_MUJOCO:-3.3.7}
if "$away/sdist/bin/python" -m pip uninstall -q -y mujoco mujoco-core mujoco-studio >/dev/null 2>&1 &&
  "$away/sdist/bin/python" -m pip install -q --no-deps --only-binary :all: "mujoco==$other" >/dev/null 2>&1; then
  said=$("$away/sdist/bin/mrdamp" mjcf dyke1996_3kN -o "$away/other" 2>&1) && {
    echo "wheel: MuJoCo $other is not refused" >&2
    exit 1
  }
  [ "$(echo "$said" | wc -l)" = 1 ] || { echo "$said" >&2; exit 1; }
  echo "wheel: with MuJoCo $other: $said"
else
  echo "wheel: MuJoCo $other cannot be installed here, its message is tried by the packaging tests alone"
fi
