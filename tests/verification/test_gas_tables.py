"""Gas properties against printed tables: ideal-gas air, and the JANAF tables of the species.

Sources: air, h and s° of M. J. Moran and H. N. Shapiro, Fundamentals of Engineering Thermodynamics, table A-22
(after J. H. Keenan and J. Kaye, Gas Tables, 1948), cp of table A-20; species, H°(T) − H°(298.15 K) and cp of
M. W. Chase, NIST-JANAF Thermochemical Tables, 4th ed., 1998; steam and CO2 in engineering form: Y. A. Cengel and
M. A. Boles, Thermodynamics, tables A-20 and A-23.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import trapezoid

from enginediag_cli.engine.gas import DRY_AIR, Gas, Mixture, molar_heat_capacity

GAS = Gas()
CARBON = Gas(0.0)  # its "fuel products" are CO2 less O2
MOLAR_MASS_C, MOLAR_MASS_H2O = 12.0107e-3, 18.01528e-3

AIR = {  # T K: h kJ/kg, s° kJ/(kg K)
    300: (300.19, 1.70203),
    400: (400.98, 1.99194),
    500: (503.02, 2.21952),
    600: (607.02, 2.40902),
    800: (821.95, 2.71787),
    1000: (1046.04, 2.96770),
    1200: (1277.79, 3.17888),
    1500: (1635.97, 3.44516),
    2000: (2252.1, 3.7994),
}
AIR_CP = {300: 1.005, 400: 1.013, 500: 1.029, 600: 1.051, 800: 1.099, 1000: 1.142}  # kJ/(kg K)
JANAF = {  # species: (cp(300 K), cp(1000 K)) J/(mol K); H(1000 K), H(2000 K) less H(298.15 K), kJ/mol
    "N2": ((29.125, 32.697), (21.463, 56.137)),
    "O2": ((29.385, 34.870), (22.703, 59.175)),
    "CO2": ((37.221, 54.308), (33.397, 91.439)),
    "H2O": ((33.596, 41.268), (26.000, 72.790)),
}


def species_enthalpy(name, T):
    """∫cp dT from 298.15 K [kJ/mol]."""
    grid = np.linspace(298.15, T, 4001)
    return trapezoid(molar_heat_capacity(name, grid), grid) * 1e-3


def water_enthalpy(T):
    """h of the water in moist gas [kJ/mol], from the mixing rule."""
    humid = 2.0 * GAS.enthalpy(np.array([T]), Mixture(war=np.ones(1)))
    return float((humid - GAS.enthalpy(np.array([T]), DRY_AIR))[0] * MOLAR_MASS_H2O * 1e-3)


def co2_less_o2_enthalpy(T):
    burnt = Mixture(far=np.full(1, 0.05))
    h = (1.05 * CARBON.enthalpy(np.array([T]), burnt) - CARBON.enthalpy(np.array([T]), DRY_AIR)) / 0.05
    return float(h[0] * MOLAR_MASS_C * 1e-3)


@pytest.mark.parametrize("T", [t for t in AIR if t != 300])
def test_enthalpy_of_air_from_300_K_is_that_of_the_tables_within_a_tenth_of_a_percent(T):
    found = (GAS.enthalpy(np.array([float(T)]), DRY_AIR) - GAS.enthalpy(np.array([300.0]), DRY_AIR))[0] * 1e-3
    assert found == pytest.approx(AIR[T][0] - AIR[300][0], rel=1e-3)


@pytest.mark.parametrize("T", [t for t in AIR if t != 300])
def test_entropy_of_air_from_300_K_is_that_of_the_tables_within_a_tenth_of_a_percent(T):
    phi = GAS.enthalpy_and_entropy(np.array([300.0, float(T)]), DRY_AIR)[1]
    assert (phi[1] - phi[0]) * 1e-3 == pytest.approx(AIR[T][1] - AIR[300][1], rel=1e-3)


@pytest.mark.parametrize("T", AIR_CP)
def test_heat_capacity_of_air_is_that_of_the_tables_to_their_last_digit(T):
    assert GAS.heat_capacity(np.array([float(T)]), DRY_AIR)[0] * 1e-3 == pytest.approx(AIR_CP[T], abs=1.1e-3)


def test_the_gas_constant_of_dry_air_is_287_05():
    assert GAS.constant(DRY_AIR) == pytest.approx(287.05, abs=0.01)


@pytest.mark.parametrize("name", JANAF)
def test_heat_capacity_of_the_species_is_that_of_the_janaf_tables(name):
    found = molar_heat_capacity(name, np.array([300.0, 1000.0]))
    assert np.allclose(found, JANAF[name][0], rtol=1.5e-3)


@pytest.mark.parametrize("name", JANAF)
def test_enthalpy_of_the_species_is_that_of_the_janaf_tables(name):
    found = [species_enthalpy(name, T) for T in (1000.0, 2000.0)]
    # the NASA coefficients of water rest on a later evaluation, 0.35 % above JANAF's at 2000 K
    assert np.allclose(found, JANAF[name][1], rtol=4e-3 if name == "H2O" else 1e-3)


def test_steam_in_the_mixture_has_the_enthalpy_of_the_steam_tables():
    # Cengel & Boles A-23: 35 882 − 9 966 kJ/kmol from 300 to 1000 K
    assert water_enthalpy(1000.0) - water_enthalpy(300.0) == pytest.approx(25.916, rel=2e-3)
    for T, h in ((1000.0, 26.000), (2000.0, 72.790)):
        assert water_enthalpy(T) == pytest.approx(h, rel=4e-3)


def test_burning_carbon_replaces_oxygen_by_carbon_dioxide():
    # Cengel & Boles: CO2 42 769 − 9 431, O2 31 389 − 8 736 kJ/kmol from 300 to 1000 K
    assert co2_less_o2_enthalpy(1000.0) - co2_less_o2_enthalpy(300.0) == pytest.approx(33.338 - 22.653, rel=5e-3)
    for T, k in ((1000.0, 0), (2000.0, 1)):
        assert co2_less_o2_enthalpy(T) == pytest.approx(JANAF["CO2"][1][k] - JANAF["O2"][1][k], rel=5e-3)


def test_products_of_kerosene_have_the_mass_of_their_atoms():
    """R of the products from the molar masses alone: CH_x + (1 + x/4) O2 → CO2 + x/2 H2O."""
    x, far = 1.9185, 0.03
    fuel_moles = far / (12.0107e-3 + x * 1.00794e-3)
    moles = 1.0 / 28.9651e-3 + fuel_moles * (1.0 + 0.5 * x - (1.0 + 0.25 * x))
    expected = 8.31446 * moles / (1.0 + far)
    assert Gas(x).constant(Mixture(far=np.full(1, far)))[0] == pytest.approx(expected, rel=1e-4)
