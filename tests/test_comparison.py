"""Table 1: laws and a given network on records held out."""

from __future__ import annotations

import numpy as np
import pytest

from mrdamp.comparison import table_1
from mrdamp.errors import InputError
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
    assert rows["bingham"].nrmse == pytest.approx(table.fits["bingham"].held_out_nrmse, rel=0.01)
    assert rows["bingham"].paper is not None
    fig = table.picture(held[0].name)
    assert len(fig.axes) == 4
    with pytest.raises(InputError, match="no held-out record"):
        table.picture("x")
    with pytest.raises(InputError, match="network: no force"):
        table_1(records, ("bingham",), {"network": {held[0].name: np.zeros(3)}}, starts=1)
