"""Nominal points of a high-bypass turbofan solved by pyCycle 4.4, with bleeds between the stages, cooled
turbines, a shaft power off-take and fan speed as power setting; the same maps and design point here."""

from __future__ import annotations

import numpy as np
import pycycle_hbtf
import pytest
import shared_data

pytestmark = [
    pytest.mark.shared_data,
    pytest.mark.skipif(not shared_data.available("pycycle_hbtf"), reason=shared_data.reason("pycycle_hbtf")),
]


def test_every_column_of_every_nominal_point_agrees_within_1_percent(tmp_path):
    deviations = pycycle_hbtf.compare(shared_data.DATA / "pycycle_hbtf", tmp_path)
    assert {"N2_rpm", "Wf_kg_s", "T3_K", "P3_Pa", "T45_K", "T5_K", "W2_kg_s", "Fn_N"} <= set(deviations)
    assert len(deviations["T3_K"]) == 80
    for column, d in deviations.items():
        assert np.isfinite(d).all(), column
        assert d.max() <= 1.0, column
