from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.simulation.airspeed import FOOT_M, KNOT_M_S, cas_from_mach, mach_from_cas


def test_cas_and_mach_are_inverse_of_each_other():
    altitude, cas = np.meshgrid(np.linspace(-200.0, 14000.0, 40), np.linspace(20.0, 190.0, 30))
    np.testing.assert_allclose(cas_from_mach(mach_from_cas(cas, altitude), altitude), cas, rtol=1e-12)


@pytest.mark.parametrize(
    ("cas_kt", "altitude_ft", "mach"),
    # published airspeed tables (e.g. Boeing, Jet Transport Performance Methods): 250 kt at 10,000 ft is
    # M 0.452; 300 kt at sea level is M 0.4535; 300 kt meets M 0.78 near 29,300 ft
    [(300.0, 0.0, 0.4535), (250.0, 10000.0, 0.452), (300.0, 29300.0, 0.780)],
)
def test_mach_agrees_with_published_airspeed_tables(cas_kt, altitude_ft, mach):
    assert mach_from_cas(cas_kt * KNOT_M_S, altitude_ft * FOOT_M) == pytest.approx(mach, abs=0.001)


def test_at_sea_level_calibrated_airspeed_is_mach_times_speed_of_sound():
    assert cas_from_mach(0.5, 0.0) == pytest.approx(0.5 * 340.294, rel=1e-5)


def test_cas_of_cruise_falls_with_altitude_at_constant_mach():
    assert np.all(np.diff(cas_from_mach(0.8, np.linspace(0.0, 13000.0, 50))) < 0.0)
