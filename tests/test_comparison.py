"""Table 1: laws and a given network on records held out."""

from __future__ import annotations

import numpy as np
import pytest

from mrdamp.errors import InputError
from mrdamp.identify.comparison import paper_network, table_1
from mrdamp.records import RecordSet
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
    with pytest.raises(InputError, match="no held-out record"):
        table_1(records, ("bingham",), condition="x")
    with pytest.raises(InputError, match="network: no force"):
        table_1(records, ("bingham",), {"network": {held[0].name: np.zeros(3)}}, starts=1)


@pytest.mark.slow
def test_the_papers_network_is_not_chosen_on_the_held_out_records() -> None:
    """10 and 4 units over four samples of four channels; other held-out forces give the same weights."""
    train, held = grid(straight, (0.0, 0.8)), grid(straight, (0.4,), seed=50)[:1]
    fit = paper_network(RecordSet("grid", tuple(train[:1] + train[2:3]), tuple(held)), initialisations=1)
    assert fit.network.topology == "16-10-4-1"
    assert {channel for channel, _ in fit.network.inputs} == set("xviF")
    other = held[0].with_channels({"force_N": -held[0].channel("force_N")})
    again = paper_network(RecordSet("grid", tuple(train[:1] + train[2:3]), (other,)), initialisations=1)
    np.testing.assert_array_equal(again.network.theta, fit.network.theta)
    assert again.free_run.test[0].rmse != pytest.approx(fit.free_run.test[0].rmse, rel=0.1)
