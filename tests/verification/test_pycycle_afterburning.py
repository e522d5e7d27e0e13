"""pyCycle's afterburning turbojet against the numbers that its regression test prints."""

from __future__ import annotations

import numpy as np
import pycycle_afterburning
import pytest
import shared_data


@pytest.fixture(scope="module")
def tables():
    found = pycycle_afterburning.maps()
    if found is None:
        pytest.skip(f"maps of pyCycle not found: {shared_data.reason(pycycle_afterburning.FOLDER)}")
    return found


def deviations(compared):
    """What is calculated here over what is printed there, less one, in %."""
    return {name: 100.0 * (here / there - 1.0) for name, (here, there) in compared.items()}


def test_the_design_point_without_afterburning(tmp_path):
    d = deviations(pycycle_afterburning.dry_at_design(tmp_path))
    assert abs(d["T3"]) < 0.002
    assert max(map(abs, d.values())) < 0.17, d  # fuel, by the nitric oxide of its equilibrium gas


def test_the_design_point_with_the_afterburner_lit(tmp_path):
    d = deviations(pycycle_afterburning.lit_at_design(tmp_path))
    assert abs(d["gross thrust"]) < 0.1
    assert abs(d["SFC"]) < 0.15


def test_flight_to_mach_1_6_with_the_nozzle_expanding_to_ambient_pressure(tmp_path, tables):
    d = deviations(pycycle_afterburning.off_design(tmp_path, tables))
    assert all(np.abs(d[name]).max() < 0.007 for name in ("air", "OPR", "N1", "T3")), d
    assert np.abs(d["gross thrust"]).max() < 0.11
    assert np.abs(d["fuel-air ratio"]).max() < 0.22  # printed to four digits


def test_mach_0_8_with_the_afterburner_lit(tmp_path, tables):
    d = deviations(pycycle_afterburning.lit_at_mach_08(tmp_path, tables))
    assert abs(d["gross thrust"]) < 0.1, d
    assert abs(d["SFC"]) < 0.1, d
