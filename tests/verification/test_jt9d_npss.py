"""89 operating points of the public JT9D model solved by NPSS 2.4; the same maps and scalars here.

Only efficiency times heating value was chosen with the cases in view (see the data's design file).
"""

from __future__ import annotations

import jt9d_npss
import numpy as np
import pytest
import shared_data

pytestmark = [
    pytest.mark.shared_data,
    pytest.mark.skipif(not shared_data.available("jt9d"), reason=shared_data.reason("jt9d")),
]
FOLDER = shared_data.DATA / "jt9d"


@pytest.fixture(scope="module", params=["Wf_kg_s", "N1_rpm"])
def deviations(request, tmp_path_factory):
    """|calculated/NPSS − 1| in % by column, with fuel flow and with fan speed as power setting."""
    return jt9d_npss.compare(FOLDER, tmp_path_factory.mktemp("jt9d"), request.param)


def test_every_case_solves(deviations):
    assert len(deviations["T3_K"]) == 89
    assert all(np.isfinite(d).all() for d in deviations.values())


@pytest.mark.parametrize("station", jt9d_npss.STATIONS)
@pytest.mark.parametrize("what", ["T{}_K", "P{}_Pa", "W{}_kg_s"])
def test_station_states_agree_within_0_4_percent_and_0_15_in_the_median(deviations, station, what):
    d = deviations[what.format(station)]
    assert d.max() <= 0.4
    assert np.median(d) <= 0.15


def test_speeds_agree_within_0_2_percent(deviations):
    assert deviations["N1_rpm"].max() <= 0.2
    assert deviations["N2_rpm"].max() <= 0.2


def test_net_thrust_agrees_within_0_5_percent(deviations):
    assert deviations["Fn_N"].max() <= 0.5
