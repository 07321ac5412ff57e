"""The studies run, and their figures are those worked out by hand. One test a study."""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from modules import STUDIES, loaded
from mrdamp.compare import FrameBench
from mrdamp.compare import dyke1996 as preset
from mrdamp.compare.bench import UNCONTROLLED
from mrdamp.identify import identify
from mrdamp.motions import kanai_tajimi
from mrdamp.records import RecordSet, embedded

pytestmark = pytest.mark.slow
POLICIES = resources.files("mrdamp") / "data" / "policies" / "frame"



def test_what_is_known_ahead_counts_for_nothing_before_it_is_learned(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("torch")
    study = loaded(STUDIES / "forecast_study.py")
    some = study.reported_motions()[4::14]  # one amplitude
    monkeypatch.setattr(study, "reported_motions", lambda: some)
    one, _ = study.trained(0, (), 1, lambda text, share: None)
    two, after = study.trained(0, (0.0, 0.02), 1, lambda text, share: None)
    assert one.shape == (6, 2)
    np.testing.assert_allclose(two, one, rtol=1e-5)
    assert np.abs(after - two).max() > 1e-4


def test_right_single_causes_with_a_comparable_parameter_count(tmp_path: Path) -> None:
    """The label of a rig's gain is its change; a place is part of the name; a wrong cause does not count."""
    study = loaded(STUDIES / "interval_coverage.py")
    cases = {
        "1": ("sensor_gain@2", {"floor2.gain": 0.25}, ("sensor_gain", 2, "g", 1.2, [1.15, 1.3])),
        "2": ("sensor_leakage", {"tau": 0.5}, ("sensor_leakage", None, "tau", 0.4, [0.38, 0.42])),
        "3": ("sensor_leakage", {"tau": 0.5}, ("sensor_gain", None, "g", 1.2, [1.1, 1.3])),
    }
    labels = {case: {"label": label, "size": size} for case, (label, size, _) in cases.items()}
    (tmp_path / "labels.json").write_text(json.dumps(labels))
    for case, (_, _, (name, place, key, value, interval)) in cases.items():
        effect = {"name": name, "place": place, "parameters": {key: value}, "intervals": {key: interval}}
        (tmp_path / "answers" / case).mkdir(parents=True)
        (tmp_path / "answers" / case / "diagnosis.json").write_text(json.dumps({"effects": [effect]}))
    lines = study.table(list(study.values(tmp_path))).splitlines()
    assert lines[2] == "| sensor_gain | 1 of 1 | 4.0 % |"  # 1.2 for 1.25
    assert lines[-1].startswith("| all | 1 of 2 (0.50;")
    assert lines[-1].endswith("| 12.0 % |")  # the median of 4 and 20


def test_the_chance_of_a_proposed_test() -> None:
    """Of four tests of each case two and one settle it: the chance of one or more of two is 1 - (1/2) (3/4)."""
    study = loaded(STUDIES / "next_test_study.py")
    assert study.at_least([np.array([0.5, 0.5])] * 4, 3) == pytest.approx(5 / 16)

    def outcome(resolved: bool, margin: float, behind: float) -> object:
        return study.Outcome("driver_lag" if resolved else "none", resolved, margin, behind)

    def row(proposed: object, *others: object) -> object:
        left_open = outcome(False, -5.0, 1.0)
        return study.Row("c", "driver_lag", "none", "6 s", ("driver_lag",), left_open, proposed, others)

    good = row(outcome(True, 9, 4), outcome(False, 1, 1), outcome(True, 3, 2), outcome(False, -2, 1))
    poor = row(outcome(False, -1, 1), outcome(True, 2, 2), outcome(False, -1, 2), outcome(False, -3, 1))
    text = study.table([good, poor])
    assert "proposed: 1 of 2 resolved, 0.50" in text
    assert "random: 2 of 6 resolved, 0.33" in text
    assert f"p = {1 - 0.5 * 0.75:.2g}" in text
    assert "1.41 (" in text  # geometric mean of 4 and 1/2


def test_a_policy_is_worse_under_noise_of_its_sensors(monkeypatch: pytest.MonkeyPatch) -> None:
    study = loaded(STUDIES / "policy_noise.py")
    policy = study.Policy.read(str(POLICIES / "adjoint" / "seed_0.json"))
    some = study.reported_motions()[3::7]
    monkeypatch.setattr(study, "reported_motions", lambda: some)
    clean, base = study.peaks([policy], 0.0)
    noisy, same = study.peaks([policy], 2e-3)
    np.testing.assert_array_equal(base, same)  # a constant command sees nothing
    assert clean.mean() < base.mean() - 0.02
    assert noisy.mean() > clean.mean() + 0.01


def test_a_policy_that_is_told_its_sensors_lag_is_better(capsys: pytest.CaptureFixture[str]) -> None:
    study = loaded(STUDIES / "policy_robustness.py")
    file = str(POLICIES / "learned" / "seed_1.json")
    found = []
    for options in ([], ["--sensor-lag", "0.003"]):
        assert study.main([*options, "--effects", "sensor_lag", "--loads", "1", "--", file]) == 0
        found.append(float(capsys.readouterr().out.splitlines()[-1].split("|")[3]))
    assert found[1] < found[0] - 0.01


def test_a_tenth_of_a_second_of_forecast_lowers_both_peaks() -> None:
    study = loaded(STUDIES / "preview_study.py")
    bench = FrameBench(preset.frame_model(), engine="chain", timestep=5e-4)
    motion = kanai_tajimi(5, duration=4.0, rise=0.5, plateau=2.0, decay=0.5)
    values = study.Plans(bench).run(study.Known(motion, 1.0, 0.1))["values"]
    on = bench.values(bench.run("passive-on", motion, 1.0), bench.run(UNCONTROLLED, motion, 1.0))
    assert values["J1"] + values["J2"] < 0.9 * (on["J1"] + on["J2"])


def test_a_sensors_effect_is_put_in_after_a_force_on_the_rod() -> None:
    """A regression of the added force on the acceleration finds the mass; in the other order it is off by the gain."""
    study = loaded(STUDIES / "spike_bench.py")
    every = study.records_of("embedded")
    records = RecordSet("embedded", every.train[:4], every.validation[:2])
    simulator = identify("bouc_wen", embedded().train[:4], dependence="linear", starts=1, threads=1).model
    own = records.train[0]
    acceleration = np.gradient(np.gradient(own.displacement)) / own.sample_time**2
    ratios = []
    for effects in (("moving_mass",), ("sensor_gain", "moving_mass")):
        case = study.make("embedded", effects, simulator, records, "all", np.random.default_rng(3))
        size = case.label["size"]
        force = np.asarray(case.records[0].channel("force_N")) / size.get("g", 1.0)
        added = (force - np.asarray(own.channel("force_N")))[50:-50]
        ratios.append(float(np.polyfit(acceleration[50:-50], added, 1)[0]) / float(size["m"]))
    assert abs(np.log(size["g"])) > 0.1
    assert ratios[0] == pytest.approx(0.85, abs=0.05)  # below 1 by the displacement's noise
    assert ratios[1] == pytest.approx(ratios[0], rel=0.03)
