"""pyCycle's turboshafts and mixed-flow turbofan against the numbers that its regression tests print."""

from __future__ import annotations

import pycycle_examples
import pytest
import shared_data

NEEDS_MAPS = "maps of pyCycle not found: install om-pycycle, or export them with tests/verification/pycycle_maps.py"


@pytest.fixture(scope="module")
def tables():
    found = pycycle_examples.maps()
    if found is None:
        pytest.skip(f"{NEEDS_MAPS}; {shared_data.reason(pycycle_examples.FOLDER)}")
    return found


def deviations(compared):
    """What is calculated here over what is printed there, less one, in %."""
    return {name: 100.0 * (here / there - 1.0) for name, (here, there) in compared.items()}


def test_the_single_spool_turboshaft_at_its_design_point(tmp_path):
    d = deviations(pycycle_examples.turboshaft_at_design(tmp_path))
    assert abs(d["T3"]) < 0.002
    assert abs(d["power"]) < 0.15
    assert max(map(abs, d.values())) < 0.35, d


def test_the_multi_spool_turboshaft_at_its_design_point(tmp_path):
    d = deviations(pycycle_examples.multi_spool_at_design(tmp_path))
    assert abs(d["T3"]) < 0.005
    assert abs(d["fuel over power"]) < 0.2
    assert max(map(abs, d.values())) < 0.45, d


def test_the_mixed_flow_turbofan_at_its_design_point_with_its_afterburner_lit(tmp_path):
    d = deviations(pycycle_examples.mixed_flow_at_design(tmp_path))
    assert abs(d["T3"]) < 0.005
    fuels = ("fuel-air ratio", "afterburner fuel over gas")
    assert max(abs(x) for name, x in d.items() if name not in fuels) < 0.2
    assert abs(d["gross thrust, lit"]) < 0.1
    assert abs(d["fuel-air ratio"]) < 0.85, d
    assert abs(d["afterburner fuel over gas"]) < 1.1, d


@pytest.mark.parametrize(
    ("compare", "T4", "fuel_air", "heating"),
    [
        (pycycle_examples.turboshaft_at_design, 1316.7, 0.0176, pycycle_examples.JP7_HEATING_VALUE),
        (pycycle_examples.multi_spool_at_design, 1522.2, 0.0214, pycycle_examples.EFFECTIVE_HEATING_VALUE),
    ],
)
def test_the_fuel_that_pycycle_burns_more_makes_the_nitric_oxide_of_its_equilibrium_gas(
    compare, T4, fuel_air, heating, tmp_path
):
    """Here products are frozen: 90 kJ per mole of NO, a thousandth of the gas, are 0.2 to 0.4 % of the fuel."""
    oxygen = 0.2095 - 3.1 * fuel_air  # a kilogram of CH2 takes 3.1 times the moles of oxygen that a kilogram of air is
    moles = 1.0 / 0.02889  # of gas per kg, about those of air
    share = pycycle_examples.nitric_oxide_heat(T4, 0.77, oxygen) * moles * (1.0 + fuel_air) / (fuel_air * heating)
    assert deviations(compare(tmp_path))["fuel-air ratio"] == pytest.approx(-100.0 * share, abs=0.03)


def test_the_single_spool_turboshaft_off_design_with_pycycles_maps(tmp_path, tables):
    d = deviations(pycycle_examples.turboshaft_off_design(tmp_path, tables))
    assert abs(d["N1"]) < 0.03
    assert max(map(abs, d.values())) < 0.2, d


def test_the_multi_spool_turboshaft_off_design_with_pycycles_maps(tmp_path, tables):
    d = deviations(pycycle_examples.multi_spool_off_design(tmp_path, tables))
    assert max(abs(d["N1"]), abs(d["N2"])) < 0.1
    assert max(map(abs, d.values())) < 0.35, d
