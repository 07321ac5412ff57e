#!/bin/sh
# Builds the sdist and the wheel from it, installs the wheel in a fresh environment outside the repository
# and tries it there.   BIN=.venv/bin tools/wheel_test.sh
set -eu
cd "$(dirname "$0")/.."
repo=$PWD
bin=$(cd "${BIN:-.venv/bin}" && pwd)
away=$(mktemp -d)
trap 'rm -rf "$away"' EXIT
export PIP_CONSTRAINT="$repo/constraints.txt" PIP_DISABLE_PIP_VERSION_CHECK=1

echo "wheel: sdist, then the wheel from it"
"$bin/python" -m build --outdir "$away/dist" . >"$away/log" 2>&1 || {
  cat "$away/log"
  exit 1
}
ls "$away/dist"
"$bin/python" -m venv "$away/venv"
"$away/venv/bin/python" -m pip install -qq "$away"/dist/*.whl pytest hypothesis
cd "$away"
venv/bin/mrdamp --version
venv/bin/python -m pytest -q -p no:cacheprovider "$repo/tests/test_packaging.py"
venv/bin/mrdamp demo -o "$away/demo" >"$away/log" 2>&1 || {
  cat "$away/log"
  exit 1
}
echo "wheel: installed and tried in a fresh environment"
