from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.simulation.missions import FOOT_M, KNOT_M_S, mach_from_cas


@pytest.mark.parametrize(
    ("cas_kt", "altitude_ft", "mach"),
    # published airspeed tables (e.g. Boeing, Jet Transport Performance Methods): 250 kt at 10,000 ft is
    # M 0.452; 300 kt at sea level is M 0.4535; 300 kt meets M 0.78 near 29,300 ft
    [(300.0, 0.0, 0.4535), (250.0, 10000.0, 0.452), (300.0, 29300.0, 0.780)],
)
def test_mach_agrees_with_published_airspeed_tables(cas_kt, altitude_ft, mach):
    assert mach_from_cas(cas_kt * KNOT_M_S, altitude_ft * FOOT_M) == pytest.approx(mach, abs=0.001)


def test_at_sea_level_calibrated_airspeed_is_mach_times_speed_of_sound():
    assert mach_from_cas(0.5 * 340.294, 0.0) == pytest.approx(0.5, rel=1e-5)


def test_mach_rises_with_altitude_at_constant_airspeed():
    assert np.all(np.diff(mach_from_cas(130.0, np.linspace(0.0, 13000.0, 50))) > 0.0)
