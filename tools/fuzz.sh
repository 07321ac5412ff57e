#!/bin/sh
# Fuzzes every target of plugin_cpp/fuzz under the sanitizers for SECONDS in all: by libFuzzer where there
# is clang++, else by the driver in plugin_cpp/fuzz/driver.   BIN=.venv/bin tools/fuzz.sh SECONDS
set -eu
cd "$(dirname "$0")/.."
bin=$(cd "${BIN:-.venv/bin}" && pwd)
seconds=${1:-60}
log=build/fuzz.log
mkdir -p build
compiler=$(command -v clang++ || command -v g++)
"$bin/cmake" -S . -B build/fuzz -G Ninja -DCMAKE_MAKE_PROGRAM="$bin/ninja" -DCMAKE_CXX_COMPILER="$compiler" \
  -DMRDAMP_PLUGIN=OFF -DMRDAMP_FUZZ=ON -DMRDAMP_SANITIZE=address,undefined,float-cast-overflow >"$log" 2>&1 &&
  "$bin/cmake" --build build/fuzz >>"$log" 2>&1 || {
  cat "$log"
  exit 1
}
set -- plugin_cpp/fuzz/*.cc
share=$((seconds / $#))
# Without it undefined behaviour ends the run and leaves no input behind.
export UBSAN_OPTIONS=abort_on_error=1
for source in "$@"; do
  target=$(basename "$source" .cc)
  corpus=plugin_cpp/fuzz/corpus/$target
  # libFuzzer adds what it finds to the first folder; the corpus itself stays as it is.
  mkdir -p "build/fuzz/found/$target"
  echo "fuzz: $target, $share s"
  (
    cd build/fuzz
    "plugin_cpp/fuzz/$target" "-max_total_time=$share" "found/$target" "../../$corpus"
  ) >"$log" 2>&1 || {
    cat "$log"
    exit 1
  }
  tail -n 1 "$log"
done
