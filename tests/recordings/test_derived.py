from __future__ import annotations

import io

import numpy as np
import pytest
from shared_recordings import shared_data

from enginediag_cli.errors import ConfigError
from enginediag_cli.recordings.derived import (
    consensus,
    humidity_ratio,
    isa_pressure,
    isa_temperature,
    lowpass,
    mach_from_cas,
    mach_from_tas,
    saturation_pressure,
    static_temperature,
)
from enginediag_cli.recordings.read import read_all
from enginediag_cli.recordings.recorder_file import load_recorder


def test_the_standard_atmosphere_has_its_published_temperatures():
    np.testing.assert_allclose(
        isa_temperature(np.array([0.0, 5000.0, 11000.0, 15000.0])), [288.15, 255.65, 216.65, 216.65]
    )


def test_saturation_pressure_is_that_of_the_steam_tables():
    # IAPWS saturation pressures in Pa; the enhancement by air is taken off
    celsius = np.array([0.01, 10.0, 20.0, 30.0, 40.0])
    published = np.array([611.66, 1228.2, 2339.3, 4247.0, 7384.9])
    pressure = 101325.0
    without_air = saturation_pressure(celsius + 273.15, pressure) / (1.0007 + 3.46e-6 * pressure / 100)
    np.testing.assert_allclose(without_air, published, rtol=2e-3)


def test_humidity_ratio_of_saturated_air_is_that_of_the_psychrometric_chart():
    # ASHRAE Fundamentals 2009, moist air at 101,325 Pa: 0.014758 at 20 °C, 0.007661 at 10 °C
    ratio = humidity_ratio(np.ones(2), np.array([293.15, 283.15]), np.full(2, 101325.0))
    np.testing.assert_allclose(ratio, [0.014758, 0.007661], rtol=3e-3)
    assert humidity_ratio(np.array([1.002]), np.array([293.15]), np.array([101325.0]))[0] == ratio[0]


@pytest.mark.filterwarnings("error")
def test_no_air_is_as_hot_or_thin_as_a_fill_value():
    temperature = np.array([-9999.0, 0.0, 32.18, 9999.0, 372.0, np.nan])
    pressure = np.full(6, 2e4)
    assert np.isnan(humidity_ratio(np.ones(6), temperature, pressure)).all()
    assert np.isnan(saturation_pressure(temperature, pressure)).tolist() == [True, True, True, True, False, True]


def test_total_and_static_temperature_agree_at_mach_one():
    assert static_temperature(np.array([300.0]), np.array([1.0]))[0] == pytest.approx(250.0)


def test_the_low_pass_answers_a_step_with_its_exponential_at_any_time_stamps():
    rng = np.random.default_rng(0)
    time = np.concatenate([[0.0], np.cumsum(rng.uniform(0.1, 5.0, 100))])
    x = np.where(time > 0.0, 1.0, 0.0)
    np.testing.assert_allclose(lowpass(x, time, 20.0), 1.0 - np.exp(-time / 20.0), atol=1e-12)


def test_the_low_pass_holds_over_missing_values_and_starts_afresh_where_time_runs_back():
    time = np.array([0.0, 1.0, 2.0, 3.0, 0.0, 1.0])
    x = np.array([np.nan, 4.0, np.nan, 4.0, 9.0, 9.0])
    np.testing.assert_allclose(lowpass(x, time, 5.0), [4.0, 4.0, 4.0, 4.0, 9.0, 9.0])
    assert np.isnan(lowpass(np.full(3, np.nan), time[:3], 5.0)).all()


def test_mach_from_calibrated_airspeed_agrees_with_tables_of_the_standard_atmosphere():
    kt, ft = 1852 / 3600, 0.3048
    # 661.47 kt at sea level is Mach 1; 250 kt at 10,000 ft is Mach 0.452; Mach 0.8 at 35,000 ft is 271.9 kt
    cas, altitude = np.array([661.4788, 250.0, 271.9]) * kt, np.array([0.0, 10_000.0, 35_000.0]) * ft
    np.testing.assert_allclose(mach_from_cas(cas, altitude), [1.0, 0.452, 0.8], atol=6e-4)
    np.testing.assert_allclose(isa_pressure(np.array([0.0, 11_000.0, 15_000.0])), [101325, 22632, 12045], rtol=1e-4)


def test_mach_from_true_airspeed_takes_a_static_or_a_total_temperature():
    mach = np.array([0.0, 0.4, 0.8])
    static = np.array([288.15, 250.0, 216.65])
    tas = mach * np.sqrt(1.4 * 287.05287 * static)
    np.testing.assert_allclose(mach_from_tas(tas, static), mach)
    for recovery in (0.9, 1.0):
        np.testing.assert_allclose(mach_from_tas(tas, static * (1 + 0.2 * recovery * mach**2), recovery), mach)
    assert np.isnan(mach_from_tas(np.array([900.0]), np.array([300.0]), 1.0)).all()


@pytest.mark.shared_data
def test_mach_from_airspeeds_is_what_an_air_data_computer_recorded():
    r = read_all(shared_data("c550_jt15d/flight_ref.csv"))
    flying = r["mach"] > 0.25
    from_cas = mach_from_cas(r["cas_kt"] * 1852 / 3600, r["altitude_ft"] * 0.3048)
    from_tas = mach_from_tas(r["tas_kt"] * 1852 / 3600, r["sat_degC"] + 273.15)
    assert np.abs(from_cas - r["mach"])[flying].max() < 0.0015
    assert np.abs(from_tas - r["mach"])[flying].max() < 0.0006


def test_a_gauge_pressure_and_the_ambient_one_make_an_absolute_pressure(tmp_path):
    path = tmp_path / "r.yaml"
    path.write_text(
        "kind: recorder\ndescription: x\ncolumns:\n  ambient_pressure_Pa: {from: pa, unit: hPa}\n"
        "  P3_gauge_Pa: {from: p3, unit: bar}\n"
        "derived: [{name: P3_Pa, rule: sum, of: [P3_gauge_Pa, ambient_pressure_Pa]}]\n"
    )
    r = load_recorder(path).read(io.StringIO("pa,p3\n1013.25,10\n900,\n"))[0].recording
    np.testing.assert_allclose(r["P3_Pa"], [1101325.0, np.nan])
    path.write_text(path.read_text().replace("P3_gauge_Pa: {from: p3, unit: bar}", "P3_gauge_K: {from: p3, unit: K}"))
    with pytest.raises(ConfigError):
        load_recorder(path)


@pytest.mark.parametrize(
    ("probes", "least", "value"),
    [
        ([700, 702, 704], 1, 702),
        ([700, 702, 900], 1, 701),  # two of three agree
        ([np.nan, 702, 900], 1, np.nan),  # nobody knows which of two is wrong
        ([np.nan, np.nan, 702], 1, 702),
        ([np.nan, np.nan, 702], 2, np.nan),
        ([700, 701, 900, 901], 1, np.nan),  # two pairs
        ([np.nan, np.nan, np.nan], 1, np.nan),
        ([700, 709, 718], 1, 709),  # a chain, all within 10 of the middle one
    ],
)
def test_of_redundant_probes_those_that_agree_are_averaged(probes, least, value):
    readings = np.array([probes], dtype=float).T
    for order in ([*range(len(probes))], [*range(len(probes))][::-1]):
        np.testing.assert_allclose(consensus(readings[order], 10.0, least), [value])
