"""RMS and χ² in the units that the field uses."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.identification.nominal import assign_regimes, sensor_quality, shown_unit


@pytest.mark.parametrize(
    ("column", "unit"),
    [
        ("T3_K", "K"),
        ("Wf_kg_s", "%"),
        ("P3_psi", "%"),
        ("N2_rpm", "rpm"),
        ("N2_pct", "pct"),
        ("power_MW", "%"),
        ("OPR", ""),
        ("Fn_N", "%"),
    ],
)
def test_flows_pressures_and_powers_are_judged_in_per_cent(column, unit):
    assert shown_unit(column) == unit


def test_rms_is_relative_to_the_prediction_and_missing_readings_do_not_count():
    e = np.array([[2.0, 3.0], [-2.0, np.nan], [2.0, -3.0]])
    y = np.array([[100.0, 900.0], [100.0, 900.0], [200.0, 900.0]])
    table = sensor_quality(("Wf_kg_s", "T3_K"), e, y, np.array([1.0, 3.0]), np.array(["cruise", "climb", "cruise"]))
    found = {(q.sensor, q.regime): q for q in table}
    assert found["Wf_kg_s", "all"].rms == pytest.approx(np.sqrt((4 + 4 + 1) / 3))
    assert found["Wf_kg_s", "cruise"].rms == pytest.approx(np.sqrt((4 + 1) / 2))
    assert (found["T3_K", "all"].n, found["T3_K", "all"].rms, found["T3_K", "all"].chi2) == (2, 3.0, 1.0)
    assert ("T3_K", "climb") not in found


def test_climb_cruise_and_descent_come_from_the_altitude_rate():
    t = np.arange(0.0, 3000.0, 10.0)
    altitude = np.interp(t, [0, 100, 1000, 2000, 2900, 3000], [0, 0, 9000, 9000, 0, 0])
    mach = np.where((t < 100) | (t > 2900), 0.02, 0.6)
    label = assign_regimes([{"time_s": t, "altitude_m": altitude, "mach": mach}], ())[0]
    assert label[5] == "ground" and label[50] == "climb" and label[150] == "cruise" and label[250] == "descent"


def test_a_phase_column_is_taken_as_it_is():
    assert assign_regimes([{"phase": np.array(["taxi", "hold"])}], ())[0].tolist() == ["taxi", "hold"]


def test_without_time_the_first_input_that_is_not_ambient_gives_bands_common_to_all_recordings():
    recordings = [
        {"mach": np.zeros(30), "TIT_K": np.linspace(1000, 1030, 30)},
        {"mach": np.zeros(60), "TIT_K": np.linspace(1031, 1090, 60)},
    ]
    a, b = assign_regimes(recordings, ("mach", "TIT_K"))
    assert set(a) == {"low TIT_K"}
    assert set(b) == {"middle TIT_K", "high TIT_K"}
