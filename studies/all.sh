#!/bin/sh
# Runs the studies as the docs show them.   BIN=.venv/bin studies/all.sh
set -eu
cd "$(dirname "$0")/.."
python="$BIN/python" policies=src/mrdamp/data/policies/frame

"$python" -m studies.car_front
"$python" -m studies.preview_study --amplitudes 1 --seconds 0 0.02 0.05 0.1 0.3 1 \
  --controllers passive-on force-tracking-tuned learned adjoint -o out/compare
"$python" -m studies.forecast_study --ahead "" 0 0,5,10,15,20 -o out/forecast.md
for kind in learned adjoint; do
  "$python" -m studies.policy_noise "$policies/$kind"/*.json
  "$python" -m studies.policy_robustness "$policies/$kind"/*.json
  "$python" -m studies.policy_robustness --sensor-lag 0.003 --effects sensor_lag -- "$policies/$kind"/*.json
done
"$python" -m studies.next_test_study --seed 20 --rounds 3 -o out/next_test \
  --effects driver_lag command_delay remanence saturation moving_mass gas_spring trapped_gas channel_shift sensor_lag asymmetry
"$python" -m studies.blindtest out/misfit --misfit --cases 200 --jobs 2 --timeout 900
"$python" -m studies.interval_coverage out/misfit

data=${MRDAMP_DATA:-../shared/data}
if [ ! -d "$data" ]; then
  echo "studies: no measured records in $data; the studies on them are left out"
  exit
fi
"$python" -m studies.measured_studies
"$python" -m studies.other_rig out/rig --seed 504
python3 ../shared/cases/natural.py out/rig/cases.json out/rig out/rig_answers || true  # its exit says whether .8 are right
"$python" -m studies.spike_bench out/bench --seed 25 --cases 30 --controls 8
for case in out/bench/cases/*; do
  answer=out/bench/answers/$(basename "$case")
  [ -e "$answer/diagnosis.json" ] || "$BIN/mrdamp" diagnose "$case" -o "$answer"
done
"$python" -m studies.bench_table out/bench --misses
