"""Table 1: laws and a given network on records held out; figures of error against values by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mrdamp.errors import InputError
from mrdamp.identify.comparison import paper_network, table_1
from mrdamp.identify.norms import CENTIMETRE, delta_1, delta_2, foam_norms, nrmse, record_norms, rmse
from mrdamp.records import Record, RecordSet
from refusals import refuses
from sine_records import grid, straight


def test_table_1_and_its_picture() -> None:
    train, held = grid(straight, (0.0, 0.8)), grid(straight, (0.4,), seed=50)
    records = RecordSet("grid", tuple(train), tuple(held))
    # A "network" that is 3 N off throughout: its figures are known.
    network = {r.name: r.channel("force_N") + 3.0 for r in held}
    table = table_1(records, ("bingham",), {"network": network}, starts=1)
    rows = {row.model: row for row in table.rows}
    deviation = np.sqrt(np.mean([np.var(r.channel("force_N")) for r in held]))
    assert rows["network"].norms.e_t == pytest.approx(3.0 / deviation, rel=0.01)
    assert rows["network"].nrmse == pytest.approx(3.0 / deviation, rel=0.01)
    speed = np.mean([np.mean(np.abs(r.velocity())) for r in held]) * 100  # cm/s
    assert rows["network"].norms.e_x == pytest.approx(3.0 / deviation * np.sqrt(speed), rel=0.01)
    assert rows["bingham"].nrmse == pytest.approx(table.fits["bingham"].held_out_nrmse, rel=1e-9)
    assert rows["bingham"].paper is not None
    # One cycle of 2 Hz at 500 Hz is the last 251 samples.
    one = table_1(records, (), {"network": network}, condition=held[0].name, starts=1).rows[0]
    assert one.norms.e_t == pytest.approx(3.0 / np.std(held[0].channel("force_N")[-251:]), rel=1e-6)
    fig = table.picture()
    assert len(fig.axes) == 4
    refuses(lambda: table_1(records, ("bingham",), condition="x"), "no held-out record")
    with pytest.raises(InputError, match="network: no force"):
        table_1(records, ("bingham",), {"network": {held[0].name: np.zeros(3)}}, starts=1)


@pytest.mark.slow
def test_the_papers_network_is_not_chosen_on_the_held_out_records() -> None:
    """10 and 4 units over four samples of four channels; other held-out forces give the same weights."""
    train, held = grid(straight, (0.0, 0.8)), grid(straight, (0.4,), seed=50)[:1]
    fit = paper_network(RecordSet("grid", tuple(train[:1] + train[2:3]), tuple(held)), initialisations=1)
    assert fit.network.topology == "16-10-4-1"
    assert {channel for channel, _ in fit.network.inputs} == set("xviF")
    other = held[0].with_channels({"force_N": 0.5 * held[0].channel("force_N")})
    again = paper_network(RecordSet("grid", tuple(train[:1] + train[2:3]), (other,)), initialisations=1)
    np.testing.assert_array_equal(again.network.theta, fit.network.theta)
    assert again.free_run.test[0].rmse != pytest.approx(fit.free_run.test[0].rmse, rel=0.1)


def test_rmse_and_its_relatives_by_hand() -> None:
    measured = np.array([1.0, 3.0, 5.0, 7.0])  # mean 4, variance 5, mean square 21
    simulated = measured + np.array([2.0, 0.0, -2.0, 0.0])  # mean squared error 2
    assert rmse(measured, simulated) == pytest.approx(math.sqrt(2))
    assert nrmse(measured, simulated) == pytest.approx(math.sqrt(2 / 5))
    assert delta_1(measured, simulated) == pytest.approx(math.sqrt(2 / 5))
    assert delta_2(measured, simulated) == pytest.approx(math.sqrt(2 / 21))


def test_eq_9_in_closed_form() -> None:
    # F = cos wt and an error e cos wt under x = X sin wt, over whole periods: <cos^2 |cos|> = 4/(3 pi),
    # <cos^2 |sin|> = 2/(3 pi), deviation 1/sqrt 2.
    w, size, stroke, n = 2 * math.pi * 4.0, 0.1, 0.008, 20000
    t = np.arange(n + 1) / n  # four periods
    force = np.cos(w * t)
    found = foam_norms(t[1], force, (1 - size) * force, stroke * w * force, -stroke * w**2 * np.sin(w * t))
    assert found.e_t == pytest.approx(size, rel=1e-4)
    assert found.e_x == pytest.approx(size * math.sqrt(2 * stroke * w * 4 / (3 * math.pi)), rel=1e-3)
    assert found.e_v == pytest.approx(size * math.sqrt(2 * stroke * w**2 * 2 / (3 * math.pi)), rel=1e-3)
    cm = foam_norms(
        t[1], force, (1 - size) * force, stroke * w * force, -stroke * w**2 * np.sin(w * t), CENTIMETRE
    )
    assert (cm.e_t, cm.e_x, cm.e_v) == pytest.approx((found.e_t, 10 * found.e_x, 10 * found.e_v))


def test_a_record_gives_its_own_velocity_and_acceleration() -> None:
    w, stroke, dt = 2 * math.pi * 2.0, 0.01, 0.001
    t = dt * np.arange(4001)
    force = 100 * np.cos(w * t)
    channels = {"displacement_m": stroke * np.sin(w * t), "command": np.zeros(len(t)), "force_N": force}
    by_record = record_norms(Record("r", None, dt, channels), 0.9 * force)
    direct = foam_norms(dt, force, 0.9 * force, stroke * w * np.cos(w * t), stroke * w**2 * np.sin(w * t))
    assert by_record.e_t == pytest.approx(direct.e_t)
    assert by_record.e_x == pytest.approx(direct.e_x, rel=1e-3)
    assert by_record.e_v == pytest.approx(direct.e_v, rel=0.01)


def test_what_cannot_be_compared_is_told() -> None:
    one = np.ones(5)
    refuses(lambda: nrmse(one, 2 * one), "constant")
    refuses(lambda: delta_2(0 * one, one), "zero throughout")
    refuses(lambda: rmse(one, np.ones(4)), r"\(5,\) and \(4,\)")
