"""Gas properties: inverses, derivatives, mixing and the size of the humidity effect."""

from __future__ import annotations

import numpy as np
import pytest
from engine_makers import GAS, fourth_order, gradient, seeds

from enginediag_cli.engine.dual import value
from enginediag_cli.engine.gas import DRY_AIR, DRY_AIR_MOLE_FRACTION, MOLAR_MASS, Gas, Mixture, molar_heat_capacity

T = np.linspace(200.0, 2400.0, 441)
# kg of fuel and of water vapour per kg of dry air
MIXTURES = {
    "air": (None, None),
    "lean products": (0.02, None),
    "rich products": (0.06, None),
    "humid air": (None, 0.01),
    "very humid air": (None, 0.03),
    "humid products": (0.03, 0.02),
}
ROUND_TRIP_K = {
    "air": 1e-9,
    "lean products": 1e-9,
    "rich products": 1e-9,
    "humid air": 1e-7,
    "very humid air": 1e-6,
    "humid products": 1e-7,
}


def enthalpy(temperature, m):
    return GAS.enthalpy(temperature, m)


def entropy(temperature, m):
    return GAS.enthalpy_and_entropy(temperature, m)[1]


def heat_capacity(temperature, m):
    return GAS.heat_capacity(temperature, m)


def temperature_from_enthalpy(h, m):
    return GAS.temperature_from_enthalpy(h, m)[0]


def temperature_from_entropy(phi, m):
    return GAS.temperature_from_entropy(phi, m)[0]


def mixture(far, war, n=T.size):
    return Mixture(*(None if x is None else np.full(n, x) for x in (far, war)))


@pytest.mark.parametrize("name", MIXTURES)
def test_temperature_from_enthalpy_inverts_the_enthalpy(name):
    m = mixture(*MIXTURES[name])
    assert np.abs(temperature_from_enthalpy(enthalpy(T, m), m) - T).max() < ROUND_TRIP_K[name]


@pytest.mark.parametrize("name", MIXTURES)
def test_temperature_from_entropy_inverts_the_entropy_function(name):
    m = mixture(*MIXTURES[name])
    assert np.abs(temperature_from_entropy(entropy(T, m), m) - T).max() < ROUND_TRIP_K[name]


@pytest.mark.parametrize("name", MOLAR_MASS)
def test_the_published_polynomials_meet_at_1000_K(name):
    below, above = molar_heat_capacity(name, np.array([1000.0 - 1e-9, 1000.0]))
    assert above == pytest.approx(below, rel=2e-4)


def test_the_fitted_heat_capacity_of_air_stays_near_the_published_polynomials():
    per_kg = sum(x * molar_heat_capacity(s, T) for s, x in DRY_AIR_MOLE_FRACTION.items())
    per_kg /= sum(x * MOLAR_MASS[s] for s, x in DRY_AIR_MOLE_FRACTION.items())
    assert np.abs(heat_capacity(T, DRY_AIR) / per_kg - 1.0).max() < 1e-3


def test_the_fitted_enthalpy_of_air_stays_within_25_J_per_kg_of_the_published_polynomials():
    fine = np.linspace(200.0, 2400.0, 44001)
    per_kg = sum(x * molar_heat_capacity(s, fine) for s, x in DRY_AIR_MOLE_FRACTION.items())
    per_kg /= sum(x * MOLAR_MASS[s] for s, x in DRY_AIR_MOLE_FRACTION.items())
    integral = np.concatenate([[0.0], np.cumsum(0.5 * (per_kg[1:] + per_kg[:-1]) * np.diff(fine))])
    h = enthalpy(fine, DRY_AIR)
    at = np.searchsorted(fine, 298.15)
    assert np.abs((h - h[at]) - (integral - integral[at])).max() < 25.0


def test_enthalpy_and_entropy_function_are_zero_at_298_15_K():
    m = mixture(0.03, 0.02, 1)
    for mix in (DRY_AIR, m):
        assert abs(enthalpy(np.array([298.15]), mix)[0]) < 1e-6
        assert abs(entropy(np.array([298.15]), mix)[0]) < 1e-9


def test_heat_capacity_is_the_derivative_of_enthalpy_and_T_times_that_of_entropy():
    inner = T[5:-5]
    m = mixture(0.03, 0.01, inner.size)
    cp = heat_capacity(inner, m)
    assert np.abs(fourth_order(lambda t: enthalpy(inner + t, m), 2.0) / cp - 1.0).max() < 1e-7
    assert np.abs(inner * fourth_order(lambda t: entropy(inner + t, m), 2.0) / cp - 1.0).max() < 1e-7


FUNCTIONS = {
    f.__name__: f for f in (enthalpy, entropy, heat_capacity, temperature_from_enthalpy, temperature_from_entropy)
}
FUNCTIONS["entropy at an enthalpy"] = lambda h, m: GAS.temperature_from_enthalpy(h, m)[1]
FUNCTIONS["enthalpy at an entropy"] = lambda phi, m: GAS.temperature_from_entropy(phi, m)[1]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_derivatives_with_respect_to_state_fuel_and_water_match_high_order_differences(name):
    function = FUNCTIONS[name]
    temperature = np.linspace(250.0, 2200.0, 30)
    far, war = np.full(30, 0.025), np.full(30, 0.012)
    x = temperature
    if "from" in name or "at" in name.split():
        x = (enthalpy if name.endswith("enthalpy") else entropy)(temperature, Mixture(far, war))
    state, fuel, water = seeds(x, far, war)
    exact = gradient(function(state, Mixture(fuel, water)), 3)
    steps = (1e-3 * np.abs(x).max(), 2e-3, 2e-3)
    numeric = (
        fourth_order(lambda t: function(x + t, Mixture(far, war)), steps[0]),
        fourth_order(lambda t: function(x, Mixture(far + t, war)), steps[1]),
        fourth_order(lambda t: function(x, Mixture(far, war + t)), steps[2]),
    )
    for k, want in enumerate(numeric):
        assert np.abs(exact[k] - want).max() < 2e-7 * np.abs(want).max()


def test_properties_of_a_mixture_are_mass_averages():
    far, war = 0.03, 0.02
    one = np.full(T.size, 1.0)
    air = enthalpy(T, DRY_AIR)
    fuel = 2.0 * enthalpy(T, Mixture(far=one)) - air
    water = 2.0 * enthalpy(T, Mixture(war=one)) - air
    mixed = enthalpy(T, mixture(far, war))
    expected = (air + far * fuel + war * water) / (1.0 + far + war)
    assert np.abs(mixed - expected).max() < 1e-8 * np.abs(expected).max()


def test_zero_fuel_and_zero_water_are_dry_air():
    none = mixture(0.0, 0.0)
    for name in ("enthalpy", "entropy", "heat_capacity"):
        assert np.allclose(FUNCTIONS[name](T, none), FUNCTIONS[name](T, DRY_AIR), rtol=1e-12, atol=1e-8)
    assert np.allclose(GAS.constant(none), GAS.constant(DRY_AIR), rtol=1e-15)


def test_a_hundredth_of_water_raises_R_by_0_60_percent_and_cp_by_0_85_percent():
    humid, at = mixture(None, 0.01, 1), np.array([300.0])
    assert value(GAS.constant(humid))[0] / GAS.constant(DRY_AIR) == pytest.approx(1.0060, abs=1e-4)
    assert heat_capacity(at, humid)[0] / heat_capacity(at, DRY_AIR)[0] == pytest.approx(1.0085, abs=1e-4)


def test_burning_leaves_R_of_kerosene_products_within_half_a_percent_of_air():
    R = GAS.constant(mixture(0.03, None, 1))[0]
    assert R == pytest.approx(GAS.constant(DRY_AIR), rel=5e-3)


def test_hydrogen_fuel_makes_more_water_and_a_larger_R_than_kerosene():
    rich_in_hydrogen = Gas(4.0)
    m = mixture(0.03, None, 1)
    assert rich_in_hydrogen.constant(m)[0] > GAS.constant(m)[0]


def test_entropy_at_an_enthalpy_and_enthalpy_at_an_entropy_agree_with_the_direct_functions():
    m = mixture(0.03, 0.01)
    assert np.abs(GAS.temperature_from_enthalpy(enthalpy(T, m), m)[1] - entropy(T, m)).max() < 1e-8
    assert np.abs(GAS.temperature_from_entropy(entropy(T, m), m)[1] - enthalpy(T, m)).max() < 1e-5


def test_the_critical_pressure_ratio_of_cold_air_is_that_of_gamma_1_4():
    # (1.2)^3.5 = 1.8929
    assert np.exp(GAS.critical_log_pressure_ratio(np.array([290.0]), DRY_AIR)[0]) == pytest.approx(1.8929, rel=1e-3)


def test_the_critical_pressure_ratio_meets_the_sonic_condition():
    for far, war in ((None, None), (0.025, None), (0.025, 0.02)):
        total = np.linspace(260.0, 1400.0, 50)
        m = mixture(far, war, 50)
        h, phi = GAS.enthalpy_and_entropy(total, m)
        R = value(GAS.constant(m))
        T_star, h_star = GAS.temperature_from_entropy(phi - R * GAS.critical_log_pressure_ratio(total, m), m)
        cp = heat_capacity(T_star, m)
        mach = np.sqrt(2.0 * (h - h_star) / (cp / (cp - R) * R * T_star))
        assert np.abs(mach - 1.0).max() < 5e-5


def flame_temperature(equivalence_ratio, inlet_K):
    far = np.array([0.0682 * equivalence_ratio])
    h = (enthalpy(np.array([inlet_K]), DRY_AIR) + far * 43.1e6) / (1.0 + far)
    return temperature_from_enthalpy(h, Mixture(far=far))[0]


def test_the_flame_of_kerosene_and_air_at_half_stoichiometry_is_near_1500_K():
    # equilibrium calculations for kerosene and jet fuels at 298 K, 1 atm and half stoichiometry: 1480–1530 K
    assert 1480.0 < flame_temperature(0.5, 298.15) < 1530.0


def test_the_stoichiometric_flame_without_dissociation_is_near_2400_K():
    # with dissociation the published value is 2270–2300 K; it takes 100–150 K
    assert 2350.0 < flame_temperature(1.0, 298.15) < 2450.0


def test_a_gas_turbine_combustor_from_800_K_to_1500_K_needs_a_fifth_of_stoichiometric_fuel_and_a_half():
    # W & F and other texts: fuel–air ratio 0.020–0.021 for a rise of 700 K from 800 K
    assert flame_temperature(0.0205 / 0.0682, 800.0) == pytest.approx(1500.0, abs=15.0)


@pytest.mark.parametrize("name", MIXTURES)
def test_one_point_in_plain_floats_is_one_of_many_to_the_last_digit(name):
    m = mixture(*MIXTURES[name])
    h, phi = GAS.enthalpy_and_entropy(T, m)
    many = *GAS.temperature_from_enthalpy(h, m), *GAS.temperature_from_entropy(phi, m)
    for k in range(0, T.size, 20):
        one = Mixture(*(None if x is None else x[k : k + 1] for x in (m.far, m.war)))
        found = *GAS.temperature_from_enthalpy(h[k : k + 1], one), *GAS.temperature_from_entropy(phi[k : k + 1], one)
        assert all(a.shape == (1,) and a[0] == b[k] for a, b in zip(found, many, strict=True))


def test_one_point_that_is_no_number_stays_none():
    found = GAS.temperature_from_enthalpy(np.array([np.nan]), DRY_AIR)
    assert np.isnan(found[0]).all() and np.isnan(found[1]).all()
    with np.errstate(all="ignore"):
        assert GAS.temperature_from_enthalpy(np.array([np.inf]), DRY_AIR)[0].shape == (1,)
