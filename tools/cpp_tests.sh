#!/bin/sh
# Builds the C++ tests, a replay of the fuzz corpus and the real-time example in build/NAME, without
# MuJoCo, and runs them by ctest.   BIN=.venv/bin tools/cpp_tests.sh NAME [-DNAME=VALUE ...]
set -eu
cd "$(dirname "$0")/.."
name=$1
shift
bin=$(cd "${BIN:-.venv/bin}" && pwd)
jobs=$(nproc 2>/dev/null || echo 2)
log=build/$name.log
echo "C++ tests: $name $*"
mkdir -p build
{
  "$bin/cmake" -S . -B "build/$name" -G Ninja -DCMAKE_MAKE_PROGRAM="$bin/ninja" -DMRDAMP_PLUGIN=OFF \
    -DMRDAMP_TESTS=ON -DMRDAMP_FUZZ=ON -DMRDAMP_REALTIME=ON -DMRDAMP_WERROR=ON "$@" &&
    "$bin/cmake" --build "build/$name" -j "$jobs"
} >"$log" 2>&1 || {
  cat "$log"
  exit 1
}
export UBSAN_OPTIONS=print_stacktrace=1
# The thread sanitizer of older g++ cannot place its shadow under address-space randomisation.
run=
case "$*" in *SANITIZE=thread*) command -v setarch >/dev/null && run="setarch $(uname -m) -R" ;; esac
$run "$bin/ctest" --test-dir "build/$name" --output-on-failure --no-tests=error -j "$jobs" >"$log" 2>&1 || {
  cat "$log"
  exit 1
}
grep -E '^[0-9]+% tests passed|^100%' "$log"
